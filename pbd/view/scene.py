"""The replay's scene: the robot and its motion, the hand's path, the keyframes, as meshcat commands.

How it looks (light, ground, camera, controls) is the page's business (pbd/view/web).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

import numpy as np

from pbd.data import Obstacle
from pbd.pose import Array, Pose
from pbd.view import shapes
from pbd.view.meshcat_encoding import PoseTrack, SetTracks, Visualizer, solid, two_sigma
from pbd.view.page_values import describe
from pbd.view.replay_scene import ReplayScene, Rod
from pbd.view.robot_motion import FRAME_RATE_HZ, Poses, RobotMotion
from pbd.view.visuals import Visual, read_visuals

PATH_SPACING_M = 0.003
TOOL_PATH_RGB = (0.55, 0.57, 0.60)
DETOUR_RGB, DETOUR_RADIUS_M = (0.64, 0.28, 0.80), 0.003
"""Of the tool's path where the arm goes around something: thicker too, for eyes that don't tell the colour."""
TOUCHING_RGB = (0.86, 0.12, 0.10)
OBSTACLE_RGB, OBSTACLE_OPACITY = (0.62, 0.55, 0.47), 0.6
OBJECT_RGB, OBJECT_OPACITY = (0.16, 0.55, 0.53), 0.72
"""Translucent, so that the object does not hide keyframes and the path."""
THE_TOOL = "the tool"
"""What the checks for collisions call the rod, which stands for a gripper that the robot's model lacks."""
GRIPPER_RGB, GRIPPER_OPACITY = (0.55, 0.58, 0.63), 0.55
"""Colour of the rod, and of a palm with two fingers around it, which is a guess and is not checked."""
FINGER_M, HALF_STROKE_M = 0.055, 0.04
"""Size of that guess."""
OBSTACLE_MARGIN_M = 0.15
"""m: an obstacle extends the view by at most this much, as a wall may be long."""


def build(scene: ReplayScene, into: Visualizer) -> None:
    """Send the scene to a visualizer in place of what was there, its description (which starts the page) last.

    Raises:
        RobotError: the robot's meshes can't be read.
    """
    motion, tool = scene.motion, scene.motion.tool(scene.robot)
    visuals = read_visuals(scene.robot)
    into.delete()
    red = {body for each in scene.touching for body in each.bodies}
    nodes, tracks = _robot(motion, visuals, red, into["robot"])
    if scene.rod is not None:
        _placeholder(scene, scene.rod, THE_TOOL in red, nodes)
    _path(scene, into["hand_path"])
    into["tool_path"].set_object(solid(shapes.tube(_thinned(tool.p)[0], np.array(TOOL_PATH_RGB), 0.0012, sides=6)))
    for i, (start, end) in enumerate(scene.detours):
        points, _ = _thinned(tool.p[(start <= motion.t) & (motion.t <= end)])
        into[f"detour/{i}"].set_object(solid(shapes.tube(points, np.array(DETOUR_RGB), DETOUR_RADIUS_M, sides=6)))
    _keyframes(scene, into["keyframes"])
    carried = carried_object(scene, tool)
    if scene.grasped is not None and carried is not None:
        rgb = TOUCHING_RGB if f"the {scene.grasped.shape}" in red else OBJECT_RGB
        into["object"].set_object(solid(shapes.solid_of(scene.grasped.shape, scene.grasped.size, rgb), OBJECT_OPACITY))
        tracks.append(PoseTrack(into["object"].path, motion.t, carried.p, carried.wxyz))
    into.window.send(SetTracks(tracks))
    _obstacles(scene.obstacles, red, into["obstacles"])
    into["replay"].set_property("replay", describe(scene, _bounds(scene, tool, visuals, carried), FRAME_RATE_HZ))


def carried_object(scene: ReplayScene, tool: Poses) -> Poses | None:
    """T_base_object over time, where the tool is T_base_tool; None where nothing is grasped."""
    if not scene.phases:
        return None
    p, wxyz = np.empty_like(tool.p), np.empty_like(tool.wxyz)
    last = len(tool.p) - 1
    for phase in scene.phases:
        first, end = np.searchsorted(scene.motion.t, (phase.start, phase.end)).clip(0, last)
        rows, held = slice(first, end + 1), tool @ phase.pose
        p[rows] = held.p[rows] if phase.held else phase.pose.p
        wxyz[rows] = held.wxyz[rows] if phase.held else phase.pose.wxyz
    return Poses(p, wxyz)


def _robot(
    motion: RobotMotion, visuals: tuple[Visual, ...], red: Set[str], into: Visualizer
) -> tuple[dict[int, Visualizer], list[PoseTrack]]:
    """Nest the links as they hang on one another, so that each joint's own motion is all that is animated."""
    nodes, tracks = {0: into}, []
    for joint, parent, name, local in motion.joints():
        node = nodes[joint] = nodes[parent][name.replace("/", "_")]
        node.set_transform(local[0].matrix())
        tracks.append(PoseTrack(node.path, motion.t, local.p, local.wxyz))
    for i, visual in enumerate(visuals):
        joint, T_joint_link = motion.link(visual.link)
        node = nodes[joint][f"{i}:{visual.link}".replace("/", "_")]
        node.set_object(solid(visual.mesh.painted(TOUCHING_RGB) if visual.link in red else visual.mesh))
        node.set_transform((T_joint_link @ visual.T_link_visual).matrix())
    return nodes, tracks


def _placeholder(scene: ReplayScene, rod: Rod, red: bool, nodes: Mapping[int, Visualizer]) -> None:
    """Draw the rod that is checked, and a gripper that is not: it shows what holds the object."""
    joint, T_joint_body = scene.motion.link(scene.robot.body)
    node, rgb = nodes[joint]["placeholder"], TOUCHING_RGB if red else GRIPPER_RGB
    node.set_transform((T_joint_body @ scene.robot.T_body_tool).matrix())
    node["rod"].set_object(solid(shapes.capsule(0.5 * rod.diameter, rod.length, rgb)))
    node["rod"].set_transform(rod.T_tool_rod.matrix())
    for i, (size, p_tool) in enumerate(_gripper(scene)):
        node[str(i)].set_object(solid(shapes.box(size, rgb), GRIPPER_OPACITY))
        node[str(i)].set_transform(Pose(np.array(p_tool), np.array([1.0, 0.0, 0.0, 0.0])).matrix())


def _gripper(scene: ReplayScene) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Sizes of a palm and two fingers, as wide apart as what they hold, and where they are in the tool's frame, m.

    None where the model has fingers, or no room for them.
    """
    robot, grasped = scene.robot, scene.grasped
    fingers = robot.gripper is not None and len(robot.gripper.joints) > 0
    if fingers or float(np.linalg.norm(robot.T_body_tool.p)) <= FINGER_M:
        return []
    half = HALF_STROKE_M if grasped is None else min(0.5 * grasped.size[0], 2.0 * HALF_STROKE_M)
    finger, up = (0.012, 0.02, FINGER_M + 0.01), 0.5 * (0.01 - FINGER_M)
    palm = ((2.0 * half + 0.04, 0.04, 0.024), (0.0, 0.0, -FINGER_M))
    return [palm, (finger, (-half - 0.006, 0.0, up)), (finger, (half + 0.006, 0.0, up))]


def _path(scene: ReplayScene, into: Visualizer) -> None:
    if len(scene.hand_path_base) == 0:
        return
    points, index = _thinned(scene.hand_path_base)
    share = np.zeros(len(points))
    if scene.hand_speed is not None:
        share = scene.hand_speed[index] / max(float(scene.hand_speed.max()), 1e-9)
    into.set_object(solid(shapes.tube(points, shapes.speed_rgb(share), shapes.PATH_RADIUS_M)))


def _thinned(points: Array) -> tuple[Array, Array]:
    """Points about PATH_SPACING_M apart along the path, both ends included, and their indices."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    wanted = np.linspace(0.0, along[-1], max(int(along[-1] / PATH_SPACING_M), 1) + 1)
    index = np.unique(np.append(np.searchsorted(along, wanted).clip(0, len(points) - 1), len(points) - 1))
    return points[index], index


def _keyframes(scene: ReplayScene, into: Visualizer) -> None:
    mark = solid(shapes.triad(shapes.TRIAD_M, shapes.TRIAD_RADIUS_M))
    ball = solid(shapes.sphere(1.0, shapes.UNSURE_RGB), opacity=shapes.UNSURE_OPACITY)
    allowed = solid(shapes.sphere(1.0, shapes.TOLERANCE_RGB), opacity=shapes.TOLERANCE_OPACITY)
    for i, keyframe in enumerate(scene.keyframes):
        into[f"{i}/triad"].set_object(mark)
        into[f"{i}/triad"].set_transform(keyframe.T_base_tool.matrix())
        if keyframe.cov is not None and keyframe.cov[:3, :3].any():
            into[f"{i}/two_sigma"].set_object(ball)
            into[f"{i}/two_sigma"].set_transform(two_sigma(keyframe.T_base_tool.p, keyframe.cov[:3, :3]))
        if keyframe.tolerance is not None:
            into[f"{i}/tolerance"].set_object(allowed)
            into[f"{i}/tolerance"].set_transform(two_sigma(keyframe.T_base_tool.p, 0.25 * keyframe.tolerance))


def _obstacles(obstacles: Sequence[Obstacle], red: Set[str], into: Visualizer) -> None:
    for i, obstacle in enumerate(obstacles):
        rgb = TOUCHING_RGB if obstacle.name in red else OBSTACLE_RGB
        into[str(i)].set_object(solid(shapes.solid_of(obstacle.shape, obstacle.size, rgb), OBSTACLE_OPACITY))
        into[str(i)].set_transform(obstacle.T_base_obstacle.matrix())


def _bounds(scene: ReplayScene, tool: Poses, visuals: tuple[Visual, ...], carried: Poses | None) -> Array:
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
