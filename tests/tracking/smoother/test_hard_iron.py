"""A field that turns with the sensor is found and removed, a room's is left as it is."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array, quat_exp, quat_rotate, quat_to_matrix
from pbd.simulation.simulate import random_task
from pbd.tracking.noise import Noise
from pbd.tracking.smoother.hard_iron import find_hard_iron
from tests.scenarios import simulate
from tests.tracking.nees import against

EARTH = np.array([8.0, 18.0, -44.0])
"""uT, in nav."""

KNOTS = 60
"""A minute of knots, one each second."""


def found(turns: Array, fields: Array) -> Array | None:
    """Hard iron of a sensor at the rotation vectors (KNOTS, 3) whose fields (KNOTS, 3) are given in nav."""
    R = quat_to_matrix(quat_exp(turns))
    knots = np.arange(KNOTS)
    given: Any = {"C": R, "rows": knots, "frame": SimpleNamespace(dt=1.0), "duration": np.ones(KNOTS), "noise": Noise}
    problem: Any = SimpleNamespace(**given)
    state: Any = SimpleNamespace(E=np.broadcast_to(np.eye(3), R.shape))
    return find_hard_iron(problem, np.einsum("kji,kj->ki", R, fields), state)


@given(st.integers(0, 2**32 - 1))
def test_iron_is_found_exactly_beside_a_passing_magnet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-1.5, 1.5, (KNOTS, 3))
    iron = 15.0 * quat_rotate(quat_exp(rng.normal(size=3)), np.array([0.0, 0.0, 1.0]))
    fields = EARTH + quat_rotate(quat_exp(turns), iron)
    fields[:3] += 300.0
    assert found(turns, fields) == pytest.approx(iron, abs=0.01)


@given(st.integers(0, 2**32 - 1))
def test_none_is_found_in_a_sound_room_and_where_the_sensor_does_not_turn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-1.5, 1.5, (KNOTS, 3))
    room = EARTH + Noise.compass_heading * float(np.hypot(EARTH[0], EARTH[1])) * rng.normal(size=(KNOTS, 3))
    assert found(turns, room) is None
    assert found(0.1 * turns, room) is None
    stuck = quat_rotate(quat_exp(turns), EARTH) + 0.3 * rng.normal(size=(KNOTS, 3))
    assert found(turns, stuck) is None
    assert found(0.0 * turns, np.tile(EARTH, (KNOTS, 1))) is None
    small = quat_rotate(quat_exp(turns), np.array([0.0, 0.0, 3.0]))  # a room's field differs by as much
    assert found(turns, EARTH + small) is None


@pytest.mark.parametrize("iron", [(10.0, -3.0, 11.0), (-30.0, 30.0, 5.0)])
def test_iron_turns_no_heading_and_nav_keeps_the_north_that_the_sensor_shows(iron: tuple[float, float, float]) -> None:
    """Robust weights alone would take another attitude's north for nav's, 11 degrees or more away."""
    task = random_task(3, moves=20, max_turn=0.5, move_s=(1.0, 1.6), rest_s=(0.0, 0.0))
    demo = simulate(task, "os5000", 3, rate_hz=50.0)
    mag, truth = demo.recording.mag, demo.truth
    assert mag is not None
    assert truth is not None
    mag = mag + np.array(iron)
    with pytest.warns(PbdWarning, match="part of the magnetic field turns with the sensor") as told:
        path = track(replace(demo.recording, mag=mag))
    assert not any("the magnetic field changes" in str(each.message) for each in told)
    assert np.degrees(np.abs(against(path, truth).turn[:, 2])).max() < 1.0
    rest = slice(path.stops[0].start, path.stops[0].stop)
    north = quat_rotate(path.wxyz_nav_sensor[rest], mag[rest]).mean(axis=0)
    assert abs(np.degrees(np.arctan2(north[0], north[1]))) < 1.0
