"""Recordings that tests are made of: simulated, with a truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from pbd.data import Demonstration, Keyframe, Recording, Truth
from pbd.pipeline import track
from pbd.pose import Array
from pbd.simulation.simulate import simulate
from pbd.tracking.keyframes import find_keyframes

uncalibrated = pytest.mark.filterwarnings("ignore:at rest the accelerometer reads:pbd.errors.PbdWarning")
"""For a sensor as it was sold (wt901): its bias of some 20 mg is told from 30 mg on."""


def truth_at(truth: Truth, t: float) -> Array:
    """The true position (3,) m at an instant."""
    return np.array([np.interp(t, truth.t, axis) for axis in truth.p_nav_sensor.T])


def keyframes_and_errors(demo: Demonstration) -> tuple[tuple[Keyframe, ...], Array]:
    """The keyframes of a demonstration and how far each is from the truth, m."""
    keyframes = find_keyframes(track(demo.recording))
    assert demo.truth is not None
    return keyframes, np.array([np.linalg.norm(k.T_nav_sensor.p - truth_at(demo.truth, k.t)) for k in keyframes])


def with_rows(recording: Recording, rows: NDArray[np.intp] | slice) -> Recording:
    """A recording of some of the rows."""
    return replace(
        recording,
        t=recording.t[rows],
        acc=recording.acc[rows],
        gyr=None if recording.gyr is None else recording.gyr[rows],
        mag=None if recording.mag is None else recording.mag[rows],
        device_rpy=None if recording.device_rpy is None else recording.device_rpy[rows],
    )


def with_hole(recording: Recording, start_s: float, stop_s: float) -> Recording:
    """A recording whose accelerometer says nothing for a while."""
    acc = recording.acc.copy()
    acc[(recording.t >= start_s) & (recording.t < stop_s)] = np.nan
    return replace(recording, acc=acc)


@cache
def pour(sensor: str = "modern", seed: int = 0) -> Demonstration:
    """The everyday task."""
    return simulate("pour", sensor, seed)
