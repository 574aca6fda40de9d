"""A gripper where the robot's model has none, so that one sees what holds the object: a guess, drawn translucent."""

from __future__ import annotations

import numpy as np

from pbd.data import GraspedObject, Robot
from pbd.pose import Array
from pbd.view import shapes
from pbd.view.meshes import Mesh

RGB = (0.55, 0.58, 0.63)
OPACITY = 0.55
LEAST_M = 0.05
"""Where the tool lies nearer to its body than that, the model shows what is there."""
PALM_M = 0.055
"""The fingers' length."""
HALF_STROKE_M = 0.04


def is_missing(robot: Robot) -> bool:
    """Whether the tool lies in front of a body that shows no fingers."""
    fingers = robot.gripper is not None and len(robot.gripper.joints) > 0
    return not fingers and float(np.linalg.norm(robot.T_body_tool.p)) > LEAST_M


def gripper(robot: Robot, grasped: GraspedObject | None) -> list[tuple[Mesh, Array]]:
    """A stem from the body to a palm with two fingers, as wide apart as what they hold.

    Returns:
        Meshes, and where they are in the tool's frame, (3,) m.
    """
    half = HALF_STROKE_M if grasped is None else min(0.5 * grasped.size[0], 2.0 * HALF_STROKE_M)
    stem = np.linspace(robot.T_body_tool.inverse().p, (0.0, 0.0, -PALM_M), 3)
    finger = shapes.box((0.012, 0.02, PALM_M + 0.01), RGB)
    return [
        (shapes.tube(stem, np.array(RGB), 0.03, sides=32), np.zeros(3)),
        (shapes.box((2.0 * half + 0.04, 0.04, 0.024), RGB), np.array([0.0, 0.0, -PALM_M])),
        *((finger, np.array([side * (half + 0.006), 0.0, 0.5 * (0.01 - PALM_M)])) for side in (-1.0, 1.0)),
    ]
