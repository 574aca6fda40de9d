"""A device without any gyro is known by its attitude, and none is blamed that has one inside."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from pbd.data import Recording
from pbd.errors import PbdWarning
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task
from pbd.simulation.tasks import Task
from pbd.tracking.repair.tilt_compass import warn_of_tilt_compass
from tests.scenarios import simulate


def with_tilt_of_its_accelerometer(recording: Recording, *time_constants: float) -> Recording:
    """Roll and pitch of the accelerometer, each low-pass after the other; the heading is anything."""
    acc = recording.acc
    for time_constant in time_constants:
        keep = np.exp(-1.0 / (time_constant * recording.rate_hz))
        acc = acc[0] + lfilter([1.0 - keep], [1.0, -keep], acc - acc[0], axis=0)
    roll, pitch = np.arctan2(acc[:, 1], acc[:, 2]), np.arctan2(-acc[:, 0], np.hypot(acc[:, 1], acc[:, 2]))
    return replace(recording, gyr=None, device_rpy=np.column_stack((roll, pitch, recording.t)))


@pytest.mark.parametrize("time_constants", [(), (0.3,), (0.1, 0.1)])
@pytest.mark.parametrize("task", ["pour", "pick-and-place-stops"])
def test_a_tilt_compass_is_named(task: str, time_constants: tuple[float, ...]) -> None:
    with pytest.warns(PbdWarning, match="seems to come from its accelerometer alone"):
        warn_of_tilt_compass(with_tilt_of_its_accelerometer(simulate(task, "wt901", 0).recording, *time_constants))


@pytest.mark.parametrize("sensor", ["os5000", "wt901", "modern"])
def test_an_attitude_that_a_gyro_aids_is_not(sensor: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for task in ("pour", "pick-and-place-stops", *map(random_task, range(5))):
            warn_of_tilt_compass(replace(simulate(task, sensor, 0).recording, gyr=None))


@pytest.mark.parametrize("sensor", ["os5000", "wt901", "modern"])
def test_a_hand_that_only_lifts_shows_neither(sensor: str) -> None:
    here, above = Waypoint(rest_s=1.0), Waypoint((0.0, 0.0, 0.3), move_s=1.0, rest_s=1.0)
    lift = Task("lift", (here, *(3 * (above, replace(here, move_s=1.0)))))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_tilt_compass(replace(simulate(lift, sensor, 0).recording, gyr=None))
