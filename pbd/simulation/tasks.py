"""Tasks of the simulated hand: the paper's two tests, pouring, and random tasks.

World is x east, y magnetic north, z up. The paper gives its times (Table I) but no distances. These are assumed: a lift
of 0.10 m, 0.15 m along x, 0.15 m along y and a roll of 60 degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, isfinite, radians, sin

import numpy as np

from pbd.data import GraspedObject, GripEvent
from pbd.errors import SensorError, is_number, is_whole_number, require_kind
from pbd.simulation.hand_motion import HandMotion, Waypoint

BOTTLE = GraspedObject("cylinder", (0.06, 0.20))
"""The object that the hand grips: diameter and height, m."""

HEADING = radians(30.0)
"""Yaw of the level sensor at the first rest, rad. It is not zero, so that code that forgets it fails."""


@dataclass(frozen=True)
class Task:
    """A motion of the hand through waypoints.

    Attributes:
        name: the task's name.
        waypoints: at least one; at the first the hand rests at the start.
        description: one sentence for people.
        start_rpy: attitude of the sensor in world at the first rest: roll, pitch, yaw in URDF's order, rad.
        grasped: the object that the hand grips, or None.
        p_sensor_point: the point of the hand that follows the waypoints' `p` (the sensor, or a tip), m in sensor axes.

    Raises:
        SensorError: no waypoint, a move without a duration, a negative rest, or a number that is not finite.
    """

    name: str
    waypoints: tuple[Waypoint, ...]
    description: str = ""
    start_rpy: tuple[float, float, float] = (0.0, 0.0, HEADING)
    grasped: GraspedObject | None = None
    p_sensor_point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "waypoints", tuple(self.waypoints))
        if not self.waypoints:
            raise SensorError(f"task {self.name!r} has no waypoint; give it at least a first rest", task=self.name)
        for i, w in enumerate(self.waypoints):
            timed = w.rest_s >= 0.0 and (w.move_s > 0.0 if i else w.move_s == 0.0 and not any(w.turn))
            if not (timed and all(map(isfinite, (*w.p, *w.turn, w.move_s, w.rest_s)))):
                raise SensorError(
                    f"task {self.name!r}, waypoint {i}: {w} can't be simulated; give finite numbers, rest_s of 0 or "
                    "more and move_s above 0 (the first waypoint: move_s 0 and no turn)",
                    task=self.name,
                    waypoint=i,
                )

    @property
    def duration_s(self) -> float:
        """Time from the start of the first rest to the end of the last, s."""
        return sum(w.move_s + w.rest_s for w in self.waypoints)

    @property
    def motion(self) -> HandMotion:
        """The sensor's motion."""
        return HandMotion(self.waypoints, self.start_rpy, self.p_sensor_point)

    @property
    def closed(self) -> bool:
        """Whether the sensor, not only `p_sensor_point`, ends where it began."""
        start, end = self.motion.at((0.0, self.duration_s)).p
        return bool(np.allclose(start, end, rtol=0.0, atol=1e-9))

    @property
    def grip(self) -> tuple[GripEvent, ...]:
        """Grip events, each in the middle of its rest."""
        events, end = [], 0.0
        for w in self.waypoints:
            end += w.move_s + w.rest_s
            if w.grip is not None:
                events.append(GripEvent(end - 0.5 * w.rest_s, w.grip))
        return tuple(events)

    def rotated(self, yaw: float) -> Task:
        """Return the same task rotated about z by `yaw` rad, hand and path."""
        c, s = cos(yaw), sin(yaw)
        waypoints = (replace(w, p=(c * w.p[0] - s * w.p[1], s * w.p[0] + c * w.p[1], w.p[2])) for w in self.waypoints)
        roll, pitch, heading = self.start_rpy
        return replace(self, waypoints=tuple(waypoints), start_rpy=(roll, pitch, heading + yaw))


def random_task(
    seed: int,
    *,
    moves: int = 6,
    reach_m: float = 0.3,
    max_turn: float = radians(60.0),
    move_s: tuple[float, float] = (0.5, 1.5),
    rest_s: tuple[float, float] = (0.5, 1.2),
    first_rest_s: float = 2.0,
) -> Task:
    """Make a task with random stops in a cube and moves that turn about random axes.

    Args:
        seed: the same seed makes the same task.
        moves: number of moves.
        reach_m: edge of the cube around the first rest, m.
        max_turn: largest rotation of a move, rad.
        move_s: duration of the shortest and the longest move, s.
        rest_s: duration of the shortest and the longest rest, s.
        first_rest_s: duration of the first rest, s.

    Raises:
        WrongTypeError: an argument is of another kind.
    """
    for name, count in (("seed", seed), ("moves", moves)):
        require_kind(name, count, "a whole number, 0 or more", is_whole_number(count) and count >= 0)
    for name, number in (("reach_m", reach_m), ("max_turn", max_turn), ("first_rest_s", first_rest_s)):
        require_kind(name, number, "a number, 0 or more", is_number(number) and number >= 0.0)
    for name, pair in (("move_s", move_s), ("rest_s", rest_s)):
        numbers = isinstance(pair, Sequence) and len(pair) == 2 and all(map(is_number, pair))
        require_kind(name, pair, "two numbers, the shortest first", numbers and pair[0] <= pair[1])
    rng = np.random.default_rng(seed)
    waypoints = [Waypoint(rest_s=first_rest_s)]
    for _ in range(moves):
        x, y, z = rng.uniform(-0.5 * reach_m, 0.5 * reach_m, 3).tolist()
        axis = rng.normal(size=3)
        rx, ry, rz = (axis / np.linalg.norm(axis) * rng.uniform(0.0, max_turn)).tolist()
        waypoints.append(Waypoint((x, y, z), (rx, ry, rz), rng.uniform(*move_s), rng.uniform(*rest_s)))
    return Task(f"random-{seed}", tuple(waypoints), f"{moves} moves at random", (0.0, 0.0, rng.uniform(-np.pi, np.pi)))


def _table_1(first: int, last: int) -> float:
    """Duration of the samples first..last of the paper's Table I, at its 40 Hz, s."""
    return (last - first + 1) / 40.0


_FIRST_REST_S = _table_1(0, 86) - 0.5 / 40.0
"""Duration of the first rest, s. The middle of sample 0 is at t = 0, so half of its interval lies before."""

_ROLL_60 = (radians(60.0), 0.0, 0.0)
_PAPER_END = (0.15, 0.15, 0.10)

# The bottle is gripped in the first rest and never let go. The roll peaks at 640 deg/s. It saturates a gyro of
# 500 deg/s for three samples, so a tracker has to find the five lost degrees in the rest that follows.
_STOPS = Task(
    "pick-and-place-stops",
    (
        Waypoint(rest_s=_FIRST_REST_S, grip=True),
        Waypoint((0.00, 0.00, 0.10), move_s=_table_1(87, 94), rest_s=_table_1(95, 114)),
        Waypoint((0.15, 0.00, 0.10), move_s=_table_1(115, 126), rest_s=_table_1(127, 140)),
        Waypoint(_PAPER_END, move_s=_table_1(141, 155), rest_s=_table_1(156, 185)),
        Waypoint(_PAPER_END, _ROLL_60, move_s=_table_1(186, 192), rest_s=_table_1(193, 250)),
    ),
    "The paper's Test 1, timed by its Table I: 0.10 m up, 0.15 m along x, 0.15 m along y, roll 60 degrees to pour",
    grasped=BOTTLE,
)

_DIRECT = Task(
    "pick-and-place-direct",
    (
        Waypoint(rest_s=_FIRST_REST_S, grip=True),
        Waypoint(_PAPER_END, _ROLL_60, move_s=0.8, rest_s=_table_1(193, 250)),
    ),
    "The paper's Test 2: from the first rest straight to the pouring pose of Test 1 in one move of 0.8 s",
    grasped=BOTTLE,
)

# Axes are the sensor's at the dock, x ahead and y left; the roll tips the bottle left.
_DOCK, _ABOVE, _AT_BOTTLE = (0.0, 0.0, 0.0), (0.12, 0.05, 0.06), (0.12, 0.05, -0.10)
_LIFTED, _AT_CUP, _TIP = (0.12, 0.05, 0.10), (0.12, 0.30, 0.10), radians(80.0)
_POUR = Task(
    "pour",
    (
        Waypoint(_DOCK, rest_s=2.5),
        Waypoint(_ABOVE, move_s=1.0, rest_s=0.7),
        Waypoint(_AT_BOTTLE, move_s=0.9, rest_s=1.2, grip=True),
        Waypoint(_LIFTED, move_s=1.0, rest_s=0.7),
        Waypoint(_AT_CUP, move_s=1.3, rest_s=0.7),
        Waypoint(_AT_CUP, (_TIP, 0.0, 0.0), move_s=1.3, rest_s=1.2),
        Waypoint(_AT_CUP, (-_TIP, 0.0, 0.0), move_s=1.2, rest_s=0.7),
        Waypoint(_LIFTED, move_s=1.3, rest_s=0.7),
        Waypoint(_AT_BOTTLE, move_s=1.1, rest_s=1.2, grip=False),
        Waypoint(_ABOVE, move_s=0.9, rest_s=0.7),
        Waypoint(_DOCK, move_s=1.0, rest_s=1.5),
    ),
    "Fetch a bottle, pour by rolling the hand, put the bottle back and return to the dock",
    start_rpy=(0.0, 0.0, 0.0),
    grasped=BOTTLE,
).rotated(HEADING)

TASKS: Mapping[str, Task] = {task.name: task for task in (_STOPS, _DIRECT, _POUR)}
"""Name -> task."""
