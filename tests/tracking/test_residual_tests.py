"""Warnings about a recording that its own solution contradicts."""

import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pbd.data import Stop
from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.errors import PbdWarning
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task
from pbd.simulation.tasks import Task
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise
from pbd.tracking.residual_tests import _move_alarms, _sensor_alarms, _stop_alarms
from pbd.tracking.smoother.large_errors import LargeErrors
from tests.scenarios import pour, simulate
from tests.simulation.sway import with_sway
from tests.tracking.nees import against


def test_many_moves_that_all_fit_badly_are_told() -> None:
    """All are at three sigmas, so none stands out."""
    solution: Any = SimpleNamespace(
        leg_residuals=(np.full((8, 9), 3.0), np.zeros((8, 9, 9))), problem=SimpleNamespace(t=np.arange(9.0))
    )
    (said,) = _move_alarms(solution)
    assert said.startswith("no motion between the stops fits the data from 0.0 to 1.0 s, and in 7 other places: ")


@pytest.mark.parametrize(
    ("row", "column", "value", "told"),
    [
        (0, 2, -0.04, "the accelerometer's x axis leans 4.0 % towards z, "),
        (1, 1, -0.04, "the accelerometer's y axis reads 4.0 % low, "),
        (1, 1, 0.04, "the accelerometer's y axis reads 4.0 % high, "),
    ],
)
def test_an_axis_that_leans_is_told_from_one_that_reads_high(row: int, column: int, value: float, told: str) -> None:
    def estimate(*shape: int) -> SimpleNamespace:
        return SimpleNamespace(value=np.zeros(shape), surprise=np.zeros(shape))

    matrix = estimate(3, 3)
    matrix.value[row, column], matrix.surprise[row, column] = value, 9.0
    found: Any = SimpleNamespace(lag=estimate(), gyr_matrix=estimate(3, 3), acc_bias=estimate(3), acc_matrix=matrix)
    solution: Any = SimpleNamespace(removed=LargeErrors())
    (said,) = _sensor_alarms(solution, found)
    assert said.startswith(told)


def test_a_stop_that_may_be_none_is_told() -> None:
    problem = SimpleNamespace(frame=SimpleNamespace(t=np.arange(5.0)), rest=None, stops=[])
    solution: Any = SimpleNamespace(problem=problem, candidates=[])
    stops = [Stop(0, 2, 1.0, DOUBTED_WEIGHT), Stop(3, 5, 1.0, DOUBTED_WEIGHT - 0.01)]
    (said,) = _stop_alarms(solution, stops)
    assert said.startswith(f"the stop at 3.5 s may be no stop ({100.0 * stops[1].weight:.0f} % sure): ")


def test_a_clock_that_is_fast_is_not_only_blamed_on_the_gyro() -> None:
    recording = load_demo("pouring").recording
    stretched = replace(recording, t=1.05 * recording.t, info=replace(recording.info, rate_hz=None))
    with pytest.warns(PbdWarning) as caught:
        track(stretched)
    said = [str(each.message) for each in caught if "far more than such a sensor should" in str(each.message)]
    assert said[0].startswith("the gyro's x axis reads ")
    assert all("should: the clock may be fast (check the rate), or pbd calibrate sensor" in one for one in said)


@pytest.mark.parametrize("yaw_deg", [0.0, 20.0])
def test_a_hand_that_sways_with_a_level_tool_does_not_scale_its_gyro(yaw_deg: float) -> None:
    """A gyro that reads nothing would explain best why it turns at stops. Gravity tells of the scale only in tilts."""
    places = ((0.2, 0.1, 0.05), (0.2, 0.1, -0.1), (0.2, 0.1, 0.05), (0.1, 0.2, 0.05), (0.1, 0.2, -0.1))
    moves = (Waypoint(p, (0.0, 0.0, np.radians(yaw_deg) * (k == 3)), 1.0, 0.8) for k, p in enumerate(places))
    task = Task("level", (Waypoint(rest_s=2.5), *moves))
    for seed in (0, 2):
        demo = simulate(with_sway(task, Noise.still_speed, seed, turn=np.radians(0.3)), "modern", seed)
        assert demo.truth is not None
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            errors = against(track(demo.recording), demo.truth)
        assert np.abs(errors.turn[:, 2]).max() < np.radians(1.0)
        assert np.abs(errors.in_sigmas[:, 5]).max() < OUTLIER_SIGMAS


def test_an_estimate_that_did_not_settle_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pbd.tracking.smoother.gauss_newton.MAX_ITERATIONS", 1)
    with pytest.warns(PbdWarning) as told:
        track(pour("wt901", 0).recording)
    assert any("the estimate did not settle" in str(each.message) for each in told)


def test_nothing_is_said_of_a_hand_that_never_turns() -> None:
    """Noise moves each knot of a rest by about one sigma."""
    recording = simulate(random_task(0, moves=16, max_turn=0.0), "os5000", 0, rate_hz=50.0).recording
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        track(recording)


@pytest.mark.parametrize("seed", [24, 52, 64])
def test_nothing_is_said_of_a_hand_that_sways_in_many_rests(seed: int) -> None:
    """Sway lasts longer than a knot: it moves all knots of a rest by more than a sigma as easily as one of them."""
    task = random_task(seed, max_turn=0.0, rest_s=(1.0, 1.5))
    recording = simulate(with_sway(task, Noise.still_speed, seed), "os5000", seed).recording
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        track(recording)
