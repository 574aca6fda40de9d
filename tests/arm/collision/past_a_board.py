"""A motion that carries a bottle past a board."""

from collections.abc import Sequence

import numpy as np

from pbd.arm.model import ArmModel
from pbd.data import GraspedObject, JointTrajectory, Obstacle
from pbd.pose import Pose, quat_from_rpy
from tests.arm.straight_moves import solve_path, time_keyframes

BOTTLE = GraspedObject("cylinder", (0.06, 0.2))


DOWN = quat_from_rpy((np.pi, 0.0, 0.0))


def through(
    arm: ArmModel, places: Sequence[tuple[float, float, float]], grips: Sequence[bool | None]
) -> JointTrajectory:
    """Return a motion from home through places, with the tool pointing down."""
    q = solve_path(arm, [Pose(np.array(place), DOWN) for place in places], arm.robot.home)
    return time_keyframes(arm, q, [0.2] * len(places), grips, arm.robot.home)


PLACES = [(0.5, -0.2, 0.35), (0.5, -0.2, 0.15), (0.5, -0.2, 0.35), (0.5, 0.2, 0.35), (0.5, 0.2, 0.15), (0.5, 0.2, 0.35)]


GRIPS = [None, True, None, None, False, None]


def board(low: float, high: float, thick: float = 0.02) -> Obstacle:
    """Return a board across the middle of the path, from one height to another, m."""
    middle = (0.6, 0.0, (low + high) / 2)
    return Obstacle("the board", "box", (0.3, thick, high - low), Pose.from_rpy(middle, (0, 0, 0)))
