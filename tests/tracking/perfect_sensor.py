"""Simulated hands with a perfect sensor that each tracking method can follow."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from pbd.data import HandPath, Stop, Truth
from pbd.pipeline import track
from pbd.pose import Array, quat_about_z, quat_inverse, quat_log, quat_multiply, quat_rotate, yaw_toward
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.sensor_model import AttitudeOutput, SensorModel
from pbd.simulation.simulate import SENSOR_MODELS, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.paper import LAMBDA_V
from tests.scenarios import simulate

PERFECT = replace(SENSOR_MODELS["ideal"], attitude=AttitudeOutput())
NORTHLESS = replace(PERFECT, mag=None)

RATE_HZ = {"default": 200.0, "paper": 40.0}
"""The paper's thresholds are per sample, for its sensor's rate. At 200 Hz it detects hardly any motion."""

MISSED = 2.0 * sqrt(LAMBDA_V)
"""m/s2: largest step of the resulting acceleration between two samples that Algorithm 1 does not detect. The variance
of two samples is a quarter of the square of their difference."""

with_and_without_north = pytest.mark.parametrize("sensor", [PERFECT, NORTHLESS], ids=["north", "no north"])


def hand(method: str, seed: int, turns: bool = True) -> Task:
    """A task that the method can follow. Algorithm 1 misses the slow beginning and end of an unhurried move."""
    if method == "default":
        return random_task(seed, moves=4, max_turn=np.radians(60.0) * turns)
    rng = np.random.default_rng(seed)
    p, waypoints = np.zeros(3), [Waypoint(rest_s=2.0)]
    for _ in range(4):
        way, turn = rng.normal(size=(2, 3))
        p = p + rng.uniform(0.1, 0.2) * way / np.linalg.norm(way)
        turn *= turns * rng.uniform(0.0, 0.5) / np.linalg.norm(turn)
        move_s, rest_s = rng.uniform((0.25, 0.6), (0.4, 1.2)).tolist()
        waypoints.append(Waypoint((p[0], p[1], p[2]), (turn[0], turn[1], turn[2]), move_s, rest_s))
    roll, pitch, yaw = rng.uniform(-0.5, 0.5, 3).tolist()
    return Task(f"swift-{seed}", tuple(waypoints), start_rpy=(roll, pitch, yaw))


STANDS_M = 3e-4
"""m: largest error of a keyframe, with a perfect sensor in a hand that stands perfectly still."""


def bound(method: str, task: Task) -> float:
    """Largest error of a keyframe, m, with a perfect sensor that does not turn.

    The default method must be right to STANDS_M, as it assumes that no hand stands stiller than 1 mm/s.

    The paper's rectangular sums of interval means are exact in velocity (at the intervals' ends), and in position to
    dt^4 / T^4 of a minimum-jerk move (Euler and Maclaurin: both velocity and acceleration vanish at its ends), a few
    hundredths of a millimetre at 40 Hz. What they lose is what Algorithm 1 doesn't see: the first sample of a swift
    move, if it is below MISSED, so that the velocity is wrong by MISSED dt throughout the move. (It sees the next one:
    the jerk of these moves is over 2 MISSED / dt.)
    """
    if method == "default":
        return STANDS_M
    return 1e-4 + MISSED / RATE_HZ["paper"] * sum(waypoint.move_s for waypoint in task.waypoints)


def perfect(method: str, task: Task, sensor: SensorModel = PERFECT) -> tuple[HandPath, Truth]:
    demo = simulate(task, sensor, rate_hz=RATE_HZ[method])
    assert demo.truth is not None
    return track(demo.recording, method), demo.truth


def middle(stop: Stop) -> int:
    return (stop.start + stop.stop - 1) // 2


def keyframe_errors(path: HandPath, truth: Truth) -> Array:
    """Errors of the keyframes, (k, 3) m, relative to position and heading of the first stop."""
    rows = [middle(stop) for stop in path.stops]
    found, true = path.p_nav_sensor[rows], truth.p_nav_sensor[rows]
    yaw = yaw_toward(path.wxyz_nav_sensor[rows[0]], truth.wxyz_nav_sensor[rows[0]])
    errors: Array = quat_rotate(quat_about_z(yaw), found - found[0]) - (true - true[0])
    return errors


def largest_angle(wxyz: Array, other: Array) -> float:
    return float(np.linalg.norm(quat_log(quat_multiply(quat_inverse(wxyz), other)), axis=-1).max())
