"""Tasks for `pbd calibrate`: touch known points, turn about the tip, put the sensor down on its sides.

All start at rest with a level sensor. One sensor model and seed is one device, so what is calibrated from one task's
recording holds for the others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import radians

import numpy as np

from pbd.pose import Array, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.tasks import HEADING, Task

TOUCHED: Mapping[str, tuple[float, float, float]] = {
    "A": (0.30, -0.20, 0.00),
    "B": (0.60, -0.15, 0.02),
    "C": (0.55, 0.20, 0.00),
    "D": (0.25, 0.15, 0.10),
    "E": (0.40, 0.00, 0.30),
    "F": (0.65, -0.05, 0.15),
}
"""Points that `touch` touches, in this order, starting from DOCK: m in the robot's base."""

DOCK = (0.45, -0.15, 0.25)
"""Where `touch` starts, m in the robot's base. The sensor lies there with HEADING as its yaw."""

YAW_WORLD_BASE = radians(40.0)
"""Yaw of the robot's base in the simulated world, rad. It is not zero, so that code that forgets it fails."""

PIVOT_TIP = (0.03, -0.02, 0.093)
"""The tip that stays on one point in `pivot`, 10 cm from the sensor: m in sensor axes."""

_SIDES = ((0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, -1))
_EDGES = ((1, 1, 0), (0, 1, 1), (1, 0, 1), (-1, -1, 0), (0, -1, -1), (-1, 0, -1))
SIDES = np.array((*_SIDES, *_EDGES), dtype=np.float64) / np.repeat((1.0, np.sqrt(2.0)), 6)[:, None]
"""(12, 3): the up direction in sensor axes, for each side and six edges."""
SIDES.setflags(write=False)


def sides(seed: int, up_sensor: Array = SIDES, rest_s: float = 2.0) -> Task:
    """Put the sensor down with each direction (k, 3) roughly up, and turn it about that direction on the way."""
    rng = np.random.default_rng(seed)
    wxyz, waypoints = np.array([1.0, 0.0, 0.0, 0.0]), [Waypoint(rest_s=rest_s + 1.0)]
    for wanted in up_sensor[1:]:
        wanted = wanted + rng.normal(scale=0.05, size=3)
        wanted /= np.linalg.norm(wanted)
        turn = _turn_between(wanted, quat_rotate(quat_inverse(wxyz), (0.0, 0.0, 1.0)))
        spin = wanted * rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 1.5)
        waypoints.append(Waypoint(turn=_triple(turn), move_s=1.5, rest_s=0.3))
        waypoints.append(Waypoint(turn=_triple(spin), move_s=1.5, rest_s=rest_s))
        wxyz = quat_multiply(wxyz, quat_multiply(quat_exp(turn), quat_exp(spin)))
    description = f"Put the sensor down in {len(up_sensor)} orientations, and turn it about on the way"
    return Task("sides", tuple(waypoints), description)


def pivoting(seed: int, p_sensor_tip: tuple[float, float, float] = PIVOT_TIP) -> Task:
    """Tilt the hand to all sides while its tip, (3,) m in sensor axes, stays on one point."""
    rng = np.random.default_rng(seed)
    attitudes = []
    for k in range(9):
        to, tilt = 2.4 * k + rng.normal(scale=0.2), np.radians(rng.uniform(25.0, 45.0))
        tilted = quat_exp((tilt * np.cos(to), tilt * np.sin(to), 0.0))
        attitudes.append(quat_multiply(tilted, quat_exp((0.0, 0.0, rng.uniform(-0.5, 0.5)))))
    description = "Tilt the hand to 9 sides with its tip on one point"
    return replace(turning_through(attitudes, rng), name="pivot", description=description, p_sensor_point=p_sensor_tip)


def turning_through(attitudes: Sequence[Array], rng: np.random.Generator) -> Task:
    """Rotate on the spot from level through attitudes (4,), with a rest at each."""
    wxyz, waypoints = np.array([1.0, 0.0, 0.0, 0.0]), [Waypoint(rest_s=2.0)]
    for attitude in attitudes:
        turn = quat_log(quat_multiply(quat_inverse(wxyz), attitude))
        waypoints.append(Waypoint(turn=_triple(turn), move_s=rng.uniform(0.8, 1.3), rest_s=rng.uniform(0.6, 1.0)))
        wxyz = attitude
    return Task("turning", tuple(waypoints))


def _touch() -> Task:
    """Every second touch is level, as at the dock; at the others the hand is tilted or yawed a little."""
    lean = radians(12.0)
    turns = ((lean, 0.0, 0.0), (-lean, 0.0, 0.0), (0.0, lean, 0.0), (0.0, -lean, 0.0), (0.0, 0.0, lean))
    touches = [
        Waypoint(_triple(np.subtract(point, DOCK)), turn, move_s=1.1, rest_s=1.0)
        for point, turn in zip(TOUCHED.values(), (*turns, (0.0, 0.0, -lean)), strict=True)
    ]
    return Task(
        "touch",
        (Waypoint(rest_s=2.5), *touches, Waypoint(move_s=1.1, rest_s=1.5)),
        f"Touch {len(TOUCHED)} known points with the sensor itself and return to the dock",
        start_rpy=(0.0, 0.0, HEADING),
    ).rotated(YAW_WORLD_BASE)


def _turn_between(wanted: Array, now: Array) -> Array:
    """Return the rotation vector in sensor axes that makes `wanted` point where `now` does."""
    axis = np.cross(wanted, now)
    sine = float(np.linalg.norm(axis))
    return np.asarray(np.arctan2(sine, wanted @ now) * axis / sine)


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


CALIBRATION_TASKS: Mapping[str, Task] = {task.name: task for task in (_touch(), pivoting(1), sides(1))}
"""Name -> task. The tasks grip nothing, and no robot replays them."""
