"""The replay's scene: the robot and its motion, the hand's path, the keyframes, as meshcat commands.

How it looks (light, ground, camera, controls) is the page's business (pbd/view/web).
"""

from collections.abc import Mapping, Sequence, Set

import numpy as np

from pbd.data import Obstacle
from pbd.data.world import THE_TOOL
from pbd.pose import Array, Pose
from pbd.view import shapes
from pbd.view.meshcat_encoding import PoseTrack, SetTracks, Visualizer, scene_object, two_sigma_transform
from pbd.view.page_values import describe
from pbd.view.replay_scene import ReplayScene, Rod
from pbd.view.robot_motion import Poses, RobotMotion
from pbd.view.visuals import Visual, read_visuals

CONTACT_RGB = (0.86, 0.12, 0.10)
"""Colour of bodies that touch."""
FINGER_M, HALF_STROKE_M = 0.055, 0.04
"""Length of the fingers that are drawn for a model without a gripper, and half the distance between them when they hold
nothing, m: a guess."""


def build(scene: ReplayScene, into: Visualizer) -> None:
    """Send the scene to a visualizer, in place of what was there. The description, which starts the page, comes last.

    Raises:
        RobotError: the robot's meshes can't be read.
    """
    motion, tool = scene.motion, scene.motion.tool(scene.robot)
    visuals = read_visuals(scene.robot)
    into.delete()
    red = {body for contact in scene.contacts for body in contact.bodies}
    nodes, tracks = _robot(motion, visuals, red, into["robot"])
    if scene.rod is not None:
        _placeholder(scene, scene.rod, THE_TOOL in red, nodes)
    _hand_path(scene, into["hand_path"])
    _tool_path(tool.p, (0.55, 0.57, 0.60), 0.0012, into["tool_path"])
    for i, (start, end) in enumerate(scene.detours):  # thicker, for people who cannot distinguish the colours
        around = tool.p[(start <= motion.t) & (motion.t <= end)]
        _tool_path(around, (0.64, 0.28, 0.80), 0.003, into[f"detour/{i}"])
    _keyframes(scene, into["keyframes"])
    carried = carried_object(scene, tool)
    if scene.grasped is not None and carried is not None:
        rgb = CONTACT_RGB if f"the {scene.grasped.shape}" in red else (0.16, 0.55, 0.53)
        mesh = shapes.primitive(scene.grasped.shape, scene.grasped.size, rgb)
        into["object"].set_object(scene_object(mesh, 0.72))  # it must not hide keyframes and the path
        tracks.append(PoseTrack(into["object"].path, motion.t, carried.p, carried.wxyz))
    into.window.send(SetTracks(tracks))
    _obstacles(scene.calibration.obstacles, red, into["obstacles"])
    into["replay"].set_property("replay", describe(scene, _bounds(scene, tool, visuals, carried)))


def carried_object(scene: ReplayScene, tool: Poses) -> Poses | None:
    """T_base_object over time, given T_base_tool; None where nothing is grasped."""
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
    """Draw the links, each joint below its parent, so that only a joint's own motion is animated."""
    nodes, tracks = {0: into}, []
    for joint, parent, name, local in motion.joints():
        node = nodes[joint] = nodes[parent][name.replace("/", "_")]
        node.set_transform(local[0].matrix())
        tracks.append(PoseTrack(node.path, motion.t, local.p, local.wxyz))
    for i, visual in enumerate(visuals):
        joint, T_joint_link = motion.link(visual.link)
        node = nodes[joint][f"{i}:{visual.link}".replace("/", "_")]
        node.set_object(scene_object(visual.mesh.painted(CONTACT_RGB) if visual.link in red else visual.mesh))
        node.set_transform((T_joint_link @ visual.T_link_visual).matrix())
    return nodes, tracks


def _placeholder(scene: ReplayScene, rod: Rod, red: bool, nodes: Mapping[int, Visualizer]) -> None:
    """Draw the rod that is checked, and a gripper that is not checked: it shows what holds the object."""
    joint, T_joint_body = scene.motion.link(scene.robot.body)
    node, rgb = nodes[joint]["placeholder"], CONTACT_RGB if red else (0.55, 0.58, 0.63)
    node.set_transform((T_joint_body @ scene.robot.T_body_tool).matrix())
    node["rod"].set_object(scene_object(shapes.capsule(0.5 * rod.diameter, rod.length, rgb)))
    node["rod"].set_transform(rod.T_tool_rod.matrix())
    for i, (size, p_tool) in enumerate(_gripper(scene)):
        node[str(i)].set_object(scene_object(shapes.box(size, rgb), 0.55))
        node[str(i)].set_transform(Pose.from_rpy(p_tool, (0.0, 0.0, 0.0)).matrix())


def _gripper(scene: ReplayScene) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Sizes and positions, m in the tool frame, of a palm and two fingers, which are as wide apart as what they hold.

    Nothing where the model has fingers, or no room for them.
    """
    robot, grasped = scene.robot, scene.grasped
    fingers = robot.gripper is not None and len(robot.gripper.joints) > 0
    if fingers or float(np.linalg.norm(robot.T_body_tool.p)) <= FINGER_M:
        return []
    half = HALF_STROKE_M if grasped is None else min(0.5 * grasped.size[0], 2.0 * HALF_STROKE_M)
    finger, up = (0.012, 0.02, FINGER_M + 0.01), 0.5 * (0.01 - FINGER_M)
    palm = ((2.0 * half + 0.04, 0.04, 0.024), (0.0, 0.0, -FINGER_M))
    return [palm, (finger, (-half - 0.006, 0.0, up)), (finger, (half + 0.006, 0.0, up))]


def _hand_path(scene: ReplayScene, into: Visualizer) -> None:
    points, index = _thinned(scene.hand_path_base)
    share = scene.hand_speed[index] / max(float(scene.hand_speed.max()), 1e-9)
    into.set_object(scene_object(shapes.tube(points, shapes.speed_rgb(share), shapes.PATH_RADIUS_M)))


def _tool_path(p: Array, rgb: tuple[float, float, float], radius: float, into: Visualizer) -> None:
    into.set_object(scene_object(shapes.tube(_thinned(p)[0], np.array(rgb), radius, sides=6)))


def _thinned(points: Array) -> tuple[Array, Array]:
    """Points about 3 mm apart along the path, both ends included, and their indices."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    wanted = np.linspace(0.0, along[-1], max(int(along[-1] / 0.003), 1) + 1)
    index = np.unique(np.append(np.searchsorted(along, wanted).clip(0, len(points) - 1), len(points) - 1))
    return points[index], index


def _keyframes(scene: ReplayScene, into: Visualizer) -> None:
    triad = scene_object(shapes.triad(shapes.TRIAD_M, shapes.TRIAD_RADIUS_M))
    uncertain = scene_object(shapes.sphere(1.0, shapes.UNSURE_RGB), opacity=shapes.UNSURE_OPACITY)
    allowed = scene_object(shapes.sphere(1.0, (0.92, 0.59, 0.16)), opacity=0.3)  # `uncertain` inside stays visible
    for i, (T_base_tool, cov, tolerance) in enumerate(zip(scene.T_base_tool, scene.cov, scene.tolerance, strict=True)):
        into[f"{i}/triad"].set_object(triad)
        into[f"{i}/triad"].set_transform(T_base_tool.matrix())
        if cov[:3, :3].any():
            into[f"{i}/two_sigma"].set_object(uncertain)
            into[f"{i}/two_sigma"].set_transform(two_sigma_transform(T_base_tool.p, cov[:3, :3]))
        if np.isfinite(tolerance).all():
            into[f"{i}/tolerance"].set_object(allowed)
            into[f"{i}/tolerance"].set_transform(two_sigma_transform(T_base_tool.p, 0.25 * tolerance))


def _obstacles(obstacles: Sequence[Obstacle], red: Set[str], into: Visualizer) -> None:
    for i, obstacle in enumerate(obstacles):
        rgb = CONTACT_RGB if obstacle.name in red else (0.62, 0.55, 0.47)
        into[str(i)].set_object(scene_object(shapes.primitive(obstacle.shape, obstacle.size, rgb), 0.6))
        into[str(i)].set_transform(obstacle.T_base_obstacle.matrix())


def _bounds(scene: ReplayScene, tool: Poses, visuals: tuple[Visual, ...], carried: Poses | None) -> Array:
    """The outermost points (k, 3) m in base of everything in the scene, for the camera to fit."""
    motion = scene.motion
    points = [scene.hand_path_base, tool.p, np.array([pose.p for pose in scene.T_base_tool])]
    for visual in visuals:
        joint, T_joint_link = motion.link(visual.link)
        corners = (T_joint_link @ visual.T_link_visual).act(_outermost(visual.mesh.vertices))
        points.append(_swept(motion.joint(joint), corners))
    if scene.grasped is not None and carried is not None:
        points.append(_swept(carried, _corners(scene.grasped.shape, scene.grasped.size)))
    moving: Array = np.concatenate(points)
    low, high = moving.min(axis=0) - 0.15, moving.max(axis=0) + 0.15  # m; an obstacle may be a long wall
    obstacles = scene.calibration.obstacles
    standing = [each.T_base_obstacle.act(_corners(each.shape, each.size)).clip(low, high) for each in obstacles]
    return _outermost(np.concatenate((moving, *standing)))


def _outermost(points: Array) -> Array:
    """The points, of (n, 3), that are farthest in one of 125 directions."""
    directions = np.array(list(np.ndindex(5, 5, 5))) - 2.0
    return np.asarray(points[np.unique(np.argmax(directions @ points.T, axis=1))])


def _swept(poses: Poses, corners: Array) -> Array:
    """Positions (m, 3) of corners that move with the poses, at about 40 instants."""
    every = max(len(poses.p) // 40, 1)
    return Poses(poses.p[::every], poses.wxyz[::every]).act(corners).reshape(-1, 3)


def _corners(shape: str, size: tuple[float, ...]) -> Array:
    return shapes.primitive(shape, size, (0.0, 0.0, 0.0)).vertices
