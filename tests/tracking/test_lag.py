"""The gyro's lag behind the accelerometer, on simulated recordings with truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pbd.data import Demonstration
from pbd.pipeline import find_motion
from pbd.pose import quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.sensors.simulate import random_task, simulate
from pbd.tracking.lag import LAG_S, MOST_LAG_S, advance, find_lag, lag_acceleration
from pbd.tracking.rest import find_rest
from tests.scenarios import keyframes_and_errors


def lagging(demo: Demonstration, lag_s: float) -> Demonstration:
    """The same demonstration, its gyro late by so much."""
    recording = demo.recording
    assert recording.gyr is not None
    gyr = CubicSpline(recording.t, recording.gyr)(recording.t - lag_s)
    return replace(demo, recording=replace(recording, gyr=gyr))


def lag_found(demo: Demonstration, monkeypatch: pytest.MonkeyPatch) -> float:
    """What the tracker takes for the lag."""
    found: list[float] = []

    def noted(*args: Any) -> float:
        found.append(find_lag(*args))
        return found[-1]

    monkeypatch.setattr("pbd.tracking.smoothing.find_lag", noted)
    find_motion(demo.recording, find_rest(demo.recording))
    return found[-1]


@pytest.mark.parametrize("lag_ms", [-1.0, 0.0, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(2))
def test_turning_moves_tell_the_lag(lag_ms: float, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A good sensor's, to a third of a millisecond, whatever was expected."""
    demo = lagging(simulate(random_task(seed, moves=8), "modern", seed), 1e-3 * lag_ms)
    assert lag_found(demo, monkeypatch) == pytest.approx(1e-3 * lag_ms, abs=0.33e-3)


def test_a_perfect_sensor_tells_it_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    demo = lagging(simulate("pour", "ideal", 0), 2e-3)
    assert lag_found(demo, monkeypatch) == pytest.approx(2e-3, abs=2e-5)


def test_moves_that_do_not_turn_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    demo = simulate("pick-and-place-stops", "os5000", 0)
    recording = replace(demo.recording, gyr=np.zeros((len(demo.recording), 3)), mag=None)
    assert lag_found(replace(demo, recording=recording), monkeypatch) == pytest.approx(LAG_S, abs=1e-6)


def test_no_lag_beyond_what_can_be_one(monkeypatch: pytest.MonkeyPatch) -> None:
    assert lag_found(lagging(simulate("pour", "ideal", 0), 0.02), monkeypatch) == MOST_LAG_S


def test_keyframes_are_nearly_as_good_as_without_lag() -> None:
    """Of a good sensor whose gyro is late by 3 ms, within a tenth of the median error of one that is not."""
    plain: list[float] = []
    late: list[float] = []
    for seed in range(4):
        demo = simulate(random_task(seed, moves=8), "modern", seed)
        plain.extend(keyframes_and_errors(demo)[1][1:])
        late.extend(keyframes_and_errors(lagging(demo, 3e-3))[1][1:])
    assert np.median(late) < 1.1 * np.median(plain)


def test_advance_and_its_acceleration_against_finite_differences() -> None:
    rng = np.random.default_rng(0)
    rate, force, start = rng.normal(size=(3, 5, 3))
    wxyz, h = quat_exp(start), 1e-6
    turned = quat_log(quat_multiply(quat_inverse(wxyz), advance(wxyz, rate, h)))
    np.testing.assert_allclose(turned / h, rate, atol=1e-6)
    slope = (quat_rotate(advance(wxyz, rate, h), force) - quat_rotate(advance(wxyz, rate, -h), force)) / (2.0 * h)
    np.testing.assert_allclose(lag_acceleration(wxyz, rate, force), slope, atol=1e-7)
