"""Simulated recordings with ground truth, and recordings with changed rows and channels."""

from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pbd.data import Calibration, Demonstration, Keyframe, Recording, Truth
from pbd.pipeline import track
from pbd.pose import Array
from pbd.simulation import simulate as simulation
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes

uncalibrated = pytest.mark.filterwarnings("ignore:at rest the accelerometer reads:pbd.errors.PbdWarning")
"""For the wt901 without calibration: its bias of about 20 mg may exceed 30 mg, which is warned of."""

simulate = lru_cache(maxsize=64)(simulation.simulate)
"""Simulates a demonstration once: its arrays are read-only, and a seed gives the same bytes (tests/simulation)."""


def truth_at(truth: Truth, t: float) -> Array:
    """The true position (3,) m at time t."""
    return np.array([np.interp(t, truth.t, axis) for axis in truth.p_nav_sensor.T])


def keyframes_and_errors(
    demo: Demonstration, calibration: Calibration | None = None
) -> tuple[tuple[Keyframe, ...], Array]:
    """The keyframes of a demonstration, and the distance of each from the truth, m."""
    keyframes = find_keyframes(track(demo.recording, calibration=calibration))
    assert demo.truth is not None
    return keyframes, np.array([np.linalg.norm(k.T_nav_sensor.p - truth_at(demo.truth, k.t)) for k in keyframes])


def with_rows(recording: Recording, rows: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Recording:
    """A recording with some of the rows."""
    return replace(
        recording,
        t=recording.t[rows],
        acc=recording.acc[rows],
        gyr=None if recording.gyr is None else recording.gyr[rows],
        mag=None if recording.mag is None else recording.mag[rows],
        device_rpy=None if recording.device_rpy is None else recording.device_rpy[rows],
    )


def with_hole(recording: Recording, start_s: float, stop_s: float) -> Recording:
    """A recording whose accelerometer reads NaN from start to stop."""
    acc = recording.acc.copy()
    acc[(recording.t >= start_s) & (recording.t < stop_s)] = np.nan
    return replace(recording, acc=acc)


def with_channel(recording: Recording, channel: str, values: Array | None) -> Recording:
    changes: dict[str, Any] = {channel: values}
    return replace(recording, **changes)


def broken(recording: Recording, channel: str, rows: slice, value: float) -> Recording:
    """Put one value into all columns of some rows of a channel."""
    values = np.array(getattr(recording, channel))
    values[rows] = value
    return with_channel(recording, channel, values)


@cache
def pour(sensor: str = "modern", seed: int = 0) -> Demonstration:
    """The simulated pouring task."""
    return simulate("pour", sensor, seed)


def with_long_stays() -> Demonstration:
    """A hand that stays for four seconds at keyframe 1 and at the end."""
    stays = [Waypoint((0.1 * i, 0.0, 0.0), move_s=1.0, rest_s=4.0) for i in (1, 2)]
    return simulate(Task("stay", (Waypoint(rest_s=2.0), *stays)))
