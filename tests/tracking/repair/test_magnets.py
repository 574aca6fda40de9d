"""A magnet near the hand, for a while or always, does not rotate the path; a clean field gives no warning."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pbd.data import Demonstration, Recording, Truth
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array, quat_inverse, quat_rotate
from pbd.simulation.simulate import SENSOR_MODELS, TASKS, World, random_task
from pbd.tracking.keyframes import find_keyframes
from tests.not_none import not_none
from tests.scenarios import pour, simulate, truth_at, uncalibrated

pytestmark = pytest.mark.usefixtures("cached_results")

MAGNETIC = re.compile(r"the magnetic field changes by (\d+) % from ([\d.]+) s on: heading is taken from the gyro")


def with_field(demo: Demonstration, more: Array) -> Recording:
    """Add a magnetic field (n, 3) or (3,) uT, in sensor axes."""
    return replace(demo.recording, mag=not_none(demo.recording.mag) + more)


def dipole(truth: Truth, place: Array, moment: Array) -> Array:
    """Field (n, 3) uT, in sensor axes, of a magnet with moment (3,) A m2 at a place (3,) m in nav."""
    away = truth.p_nav_sensor - place
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    unit = away / distance
    return quat_rotate(
        quat_inverse(truth.wxyz_nav_sensor), 0.1 * (3.0 * unit * (unit @ moment)[:, None] - moment) / distance**3
    )


def errors(recording: Recording, truth: Truth) -> tuple[Array, Array]:
    """Errors of the keyframes, m: as they are, and after the best common rotation about the vertical."""
    keyframes = find_keyframes(track(recording))
    p = np.array([k.T_nav_sensor.p for k in keyframes])
    true = np.array([truth_at(truth, k.t) for k in keyframes])
    across = (p[:, 0] * true[:, 1] - p[:, 1] * true[:, 0]).sum()
    yaw = np.arctan2(across, (p[:, :2] * true[:, :2]).sum())
    turned = quat_rotate((np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)), p)
    return np.linalg.norm(p - true, axis=1), np.linalg.norm(turned - true, axis=1)


def warned(recording: Recording) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", "at rest the accelerometer reads", PbdWarning)  # wt901's bias
        track(recording)
    return [str(warning.message) for warning in caught]


@uncalibrated
@pytest.mark.parametrize(
    ("sensor", "begin", "end"),
    [("os5000", 5.0, 9.0), ("wt901", 5.0, np.inf)],
)
def test_a_magnet_gripped_on_the_way_does_not_turn_the_path(sensor: str, begin: float, end: float) -> None:
    demo = pour(sensor, 1)
    assert demo.truth is not None
    gripped = (demo.truth.t >= begin) & (demo.truth.t < end)
    disturbed = with_field(demo, np.outer(gripped, (25.0, 15.0, 5.0)))
    (message,) = warned(disturbed)
    found = MAGNETIC.match(message)
    assert found
    assert 30 < int(found[1]) < 90
    assert float(found[2]) == pytest.approx(begin, abs=0.3)
    with pytest.warns(PbdWarning, match="magnetic field"):
        off, _ = errors(disturbed, demo.truth)
    assert off.max() < errors(demo.recording, demo.truth)[0].max() + 0.003


@pytest.mark.parametrize(
    ("sensor", "always"),
    [("modern", (25.0, 15.0, 5.0)), ("os5000", (-20.0, 5.0, 12.0))],
)
def test_a_magnet_on_the_hand_throughout_bends_nothing(sensor: str, always: tuple[float, float, float]) -> None:
    """North can't be known then. The path keeps its shape, as without a magnetometer."""
    for task in ("pour", random_task(5)):
        demo = simulate(task, sensor, 2)
        assert demo.truth is not None
        with pytest.warns(PbdWarning, match="magnetic field"):
            _, off = errors(with_field(demo, np.array(always)), demo.truth)
        _, without = errors(replace(demo.recording, mag=None), demo.truth)
        assert off.max() < without.max() + 0.002


@pytest.mark.parametrize("place", [(0.12, 0.15, -0.20), (0.2, 0.3, 0.2)])
def test_a_magnet_on_the_table_bends_nothing(place: tuple[float, float, float]) -> None:
    demo = pour("modern", 3)
    assert demo.truth is not None
    field = dipole(demo.truth, np.array(place), np.array((0.3, 1.5, 1.0)))
    with pytest.warns(PbdWarning, match="magnetic field"):
        _, off = errors(with_field(demo, field), demo.truth)
    assert off.max() < errors(replace(demo.recording, mag=None), demo.truth)[1].max() + 0.002


def test_a_magnetometer_that_jumps_once_does_no_harm() -> None:
    demo = pour("modern", 1)
    assert demo.truth is not None
    jump = np.zeros((len(demo.recording), 3))
    jump[700] = 5000.0
    with pytest.warns(PbdWarning, match="magnetic field"):
        off, _ = errors(with_field(demo, jump), demo.truth)
    assert off.max() < errors(demo.recording, demo.truth)[0].max() + 0.002


@settings(max_examples=5, deadline=None)
@example("wt901", "long", 441, World(field=(3.0, 12.0, 55.0)))  # steep, and a vertical that is wrong by 3 degrees
@given(
    st.sampled_from(["os5000", "wt901", "modern", "ideal"]),
    st.sampled_from([*TASKS, "random", "long"]),
    st.integers(0, 1000),
    st.sampled_from([World(), World(field=(0.0, 40.0, 5.0)), World(field=(3.0, 12.0, 55.0))]),
)
def test_a_clean_field_warns_of_nothing(sensor: str, task: str, seed: int, world: World) -> None:
    what = {"random": random_task(seed), "long": random_task(seed, moves=15)}.get(task, task)
    recording = simulate(what, SENSOR_MODELS[sensor], seed, world=world).recording
    assert not [message for message in warned(recording) if "magnetic" in message]


def test_heading_is_that_of_the_field() -> None:
    """In nav x is east and y magnetic north, with any declination."""
    for seed in range(3):
        demo = simulate(random_task(seed, moves=4), "modern", seed, world=World(field=(-6.0, 18.0, -44.0)))
        assert errors(demo.recording, not_none(demo.truth))[0].max() < 0.01


def test_the_field_of_a_sensor_without_noise_may_stand_still_but_not_at_zero() -> None:
    """Without rotation a perfect magnetometer is constant."""
    demo = simulate(random_task(1, max_turn=0.0), "ideal")
    field = np.tile(not_none(demo.recording.mag)[0], (len(demo.recording), 1))  # to the last bit
    demo = replace(demo, recording=replace(demo.recording, mag=field))
    assert warned(demo.recording) == []
    assert errors(demo.recording, not_none(demo.truth))[0].max() < 0.005
    none = replace(demo.recording, mag=np.zeros_like(demo.recording.acc))
    assert [line.partition(" and ")[0] for line in warned(none)] == ["the magnetometer always reads 0"]
