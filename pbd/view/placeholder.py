"""A placeholder gripper, where the robot's model has none.

The rod is what the checks for collisions watch, drawn as it is. Palm and fingers are a guess, drawn translucent: they
show what holds the object, and are not checked.
"""

from __future__ import annotations

import numpy as np

from pbd.data import GraspedObject, Robot
from pbd.pose import Array
from pbd.view import shapes
from pbd.view.meshes import Mesh
from pbd.view.scene_values import Rod

RGB = (0.55, 0.58, 0.63)
OPACITY = 0.55
"""Of palm and fingers."""
PALM_M = 0.055
"""The fingers' length."""
HALF_STROKE_M = 0.04


def rod(checked: Rod) -> Mesh:
    """Draw the rod, about its middle."""
    return shapes.capsule(0.5 * checked.diameter, checked.length, RGB)


def gripper(robot: Robot, grasped: GraspedObject | None) -> list[tuple[Mesh, Array]]:
    """Draw a palm with two fingers, as wide apart as what they hold.

    Returns:
        Meshes, and where they are in the tool's frame, (3,) m; none where the model has fingers, or no room for them.
    """
    fingers = robot.gripper is not None and len(robot.gripper.joints) > 0
    if fingers or float(np.linalg.norm(robot.T_body_tool.p)) <= PALM_M:
        return []
    half = HALF_STROKE_M if grasped is None else min(0.5 * grasped.size[0], 2.0 * HALF_STROKE_M)
    finger = shapes.box((0.012, 0.02, PALM_M + 0.01), RGB)
    return [
        (shapes.box((2.0 * half + 0.04, 0.04, 0.024), RGB), np.array([0.0, 0.0, -PALM_M])),
        *((finger, np.array([side * (half + 0.006), 0.0, 0.5 * (0.01 - PALM_M)])) for side in (-1.0, 1.0)),
    ]
