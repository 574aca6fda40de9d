"""Bounds of what the camera has to show."""

from __future__ import annotations

import numpy as np

from pbd.pose import Array
from pbd.view import shapes
from pbd.view.replay_values import ReplayScene
from pbd.view.robot_motion import Poses
from pbd.view.visuals import Visual

OBSTACLE_MARGIN_M = 0.15
"""m: an obstacle extends the view by at most this much, as a wall may be long."""


def bounds(scene: ReplayScene, tool: Poses, visuals: tuple[Visual, ...], carried: Poses | None) -> Array:
    """The outermost points (k, 3) m in base of all that moves or stands, for the camera to fit."""
    motion = scene.motion
    points = [scene.hand_path_base, tool.p, *(keyframe.T_base_tool.p[None] for keyframe in scene.keyframes)]
    for visual in visuals:
        joint, T_joint_link = motion.link(visual.link)
        corners = (T_joint_link @ visual.T_link_visual).act(_outermost(visual.mesh.vertices))
        points.append(_swept(motion.joint(joint), corners))
    if scene.grasped is not None and carried is not None:
        points.append(_swept(carried, _corners(scene.grasped.shape, scene.grasped.size)))
    everything: Array = np.concatenate(points)
    low, high = everything.min(axis=0) - OBSTACLE_MARGIN_M, everything.max(axis=0) + OBSTACLE_MARGIN_M
    around = [each.T_base_obstacle.act(_corners(each.shape, each.size)).clip(low, high) for each in scene.obstacles]
    return _outermost(np.concatenate((everything, *around)))


def _outermost(points: Array) -> Array:
    """Those of points (n, 3) that lie farthest out in some direction, about 100 at most."""
    directions = np.array(list(np.ndindex(5, 5, 5))) - 2.0
    return np.asarray(points[np.unique(np.argmax(directions @ points.T, axis=1))])


def _swept(poses: Poses, corners: Array) -> Array:
    every = max(len(poses.p) // 40, 1)
    return Poses(poses.p[::every], poses.wxyz[::every]).act(corners).reshape(-1, 3)


def _corners(shape: str, size: tuple[float, ...]) -> Array:
    return shapes.solid_of(shape, size, (0.0, 0.0, 0.0)).bounds()
