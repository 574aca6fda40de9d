"""What the camera has to show."""

from __future__ import annotations

import numpy as np

from pbd.data import Obstacle
from pbd.pose import Array
from pbd.view import grasp, shapes
from pbd.view.motion import Motion, Track
from pbd.view.scene_values import ReplayScene
from pbd.view.visuals import Visual

BESIDE_M = 0.15
"""Of an obstacle so much is shown beyond all else: a wall may be long."""


def extent(
    scene: ReplayScene, motion: Motion, tool: Track, visuals: tuple[Visual, ...], carried: Track | None
) -> Array:
    """The outermost points (k, 3) m in base of all that moves or stands, for the camera to fit."""
    points = [scene.hand_path_base, tool.p, *(keyframe.T_base_tool.p[None] for keyframe in scene.keyframes)]
    every = max(len(motion.t) // 40, 1)
    for visual in visuals:
        joint, T_joint_link = motion.link("visual", visual.link)
        moves = motion.joint(joint)
        corners = (T_joint_link @ visual.T_link_visual).act(_outermost(visual.mesh.vertices))
        points.append(_swept(moves, corners, every))
    if scene.grasped is not None and carried is not None:
        points.append(_swept(carried, _bounds(scene.grasped.shape, scene.grasped.size), every))
    everything: Array = np.concatenate(points)
    low, high = everything.min(axis=0) - BESIDE_M, everything.max(axis=0) + BESIDE_M
    everything = np.concatenate((everything, *(_corners(each).clip(low, high) for each in scene.obstacles)))
    return _outermost(everything)


def _outermost(points: Array) -> Array:
    """Those of points (n, 3) that lie farthest out in some direction, about 100 at most."""
    directions = np.array(list(np.ndindex(5, 5, 5))) - 2.0
    outermost: Array = points[np.unique(np.argmax(directions @ points.T, axis=1))]
    return outermost


def _swept(track: Track, corners: Array, every: int) -> Array:
    return Track(track.p[::every], track.wxyz[::every]).act(corners).reshape(-1, 3)


def _corners(obstacle: Obstacle) -> Array:
    return obstacle.T_base_obstacle.act(_bounds(obstacle.shape, obstacle.size))


def _bounds(shape: str, size: tuple[float, ...]) -> Array:
    return shapes.solid_of(shape, size, grasp.RGB).bounds()
