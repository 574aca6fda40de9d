"""What stands in the replay: the robot and its motion, the hand's path, the keyframes, as meshcat commands.

How it looks (light, ground, camera, controls) is the page's business (pbd/view/web).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pbd.data import GraspedObject, JointTrajectory, Robot
from pbd.pose import Array, Pose, readonly
from pbd.view import grasp, shapes
from pbd.view.meshcat_api import Visualizer
from pbd.view.motion import Motion, Track
from pbd.view.visuals import Visual, read_visuals
from pbd.view.wire import PoseTrack, SetTracks, solid, typed

FRAME_RATE_HZ = 50.0
PATH_SPACING_M = 0.003
TOOL_PATH_RGB = (0.55, 0.57, 0.60)


@dataclass(frozen=True, eq=False)
class ReplayKeyframe:
    """A keyframe as the replay shows it.

    Attributes:
        label: a word for people; may be empty.
        t: s, when the arm reaches it.
        T_base_tool: where.
        sigma_m: (3,) m along base's axes, how sure we are; or None.
        grip: True where the gripper closes here, False where it opens.
    """

    label: str
    t: float
    T_base_tool: Pose
    sigma_m: Array | None = None
    grip: bool | None = None

    def __post_init__(self) -> None:
        if self.sigma_m is not None:
            object.__setattr__(self, "sigma_m", sigma := readonly(self.sigma_m))
            if sigma.shape != (3,):
                raise ValueError(f"ReplayKeyframe.sigma_m must have shape (3,), got {sigma.shape}")


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Everything that a replay shows.

    Attributes:
        title: the demonstration's name.
        robot: which arm.
        trajectory: what it does.
        hand_path_base: (n, 3) m, where the demonstrated tool went in base.
        hand_speed: (n,) m/s, colours the path; or None.
        keyframes: in order.
        table_height: m, z of the table's top in base; None: the ground at z = 0.
        grasped: what the gripper takes, or None.
        notes: what the viewer should know: warnings, "simulated data".
    """

    title: str
    robot: Robot
    trajectory: JointTrajectory
    hand_path_base: Array
    keyframes: tuple[ReplayKeyframe, ...]
    hand_speed: Array | None = None
    table_height: float | None = None
    grasped: GraspedObject | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        n = len(self.hand_path_base)
        for name, shape in (("hand_path_base", (n, 3)), ("hand_speed", (n,))):
            if (value := getattr(self, name)) is None:
                continue
            object.__setattr__(self, name, array := readonly(value))
            if array.shape != shape:
                raise ValueError(f"ReplayScene.{name} must have shape {shape}, got {array.shape}")
        object.__setattr__(self, "keyframes", tuple(self.keyframes))
        object.__setattr__(self, "notes", tuple(self.notes))


def build(scene: ReplayScene, into: Visualizer) -> None:
    """Send the scene to a visualizer in place of what was there, its description (which starts the page) last.

    Raises:
        RobotError: the robot's files can't be read, or lack a joint or link.
    """
    motion = Motion(scene.robot, scene.trajectory, FRAME_RATE_HZ)
    tool = motion.tool()
    visuals = read_visuals(scene.robot)
    into.delete()
    tracks = _robot(motion, visuals, into["robot"])
    _path(scene, into["hand_path"])
    into["tool_path"].set_object(solid(shapes.tube(_thinned(tool.p)[0], np.array(TOOL_PATH_RGB), 0.0012, sides=6)))
    _keyframes(scene, into["keyframes"])
    spans = grasp.holds(scene.trajectory.gripper_t, scene.trajectory.gripper_opening)
    if scene.grasped is not None and spans:
        into["object"].set_object(solid(grasp.mesh(scene.grasped)))
        moves = grasp.carried(scene.grasped, motion.t, tool, spans, scene.table_height)
        tracks.append(PoseTrack(into["object"].path, motion.t, moves.p, moves.wxyz))
    into.window.send(SetTracks(tracks))
    into["replay"].set_property("replay", describe(scene, _extent(scene, motion, tool, visuals)))


def _robot(motion: Motion, visuals: tuple[Visual, ...], into: Visualizer) -> list[PoseTrack]:
    """Nest the links as they hang on one another, so that each joint's own motion is all that is animated."""
    into.set_transform(motion.T_base_world.matrix())
    nodes = {0: into}
    tracks = []
    for joint, local in motion.local.items():
        node = nodes[joint] = nodes[motion.parent(joint)][motion.name(joint).replace("/", "_")]
        node.set_transform(local[0].matrix())
        tracks.append(PoseTrack(node.path, motion.t, local.p, local.wxyz))
    for i, visual in enumerate(visuals):
        joint, T_joint_link = motion.link("visual", visual.link)
        node = nodes[joint][f"{i}:{visual.link}".replace("/", "_")]
        node.set_object(solid(visual.mesh))
        node.set_transform((T_joint_link @ visual.T_link_visual).matrix())
    return tracks


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
    ball = solid(shapes.sphere(1.0, shapes.SPEED_RGB[0]), opacity=shapes.UNSURE_OPACITY)
    for i, keyframe in enumerate(scene.keyframes):
        into[f"{i}/triad"].set_object(mark)
        into[f"{i}/triad"].set_transform(keyframe.T_base_tool.matrix())
        if keyframe.sigma_m is not None:
            T = np.diag(np.append(2.0 * keyframe.sigma_m, 1.0))
            T[:3, 3] = keyframe.T_base_tool.p
            into[f"{i}/two_sigma"].set_object(ball)
            into[f"{i}/two_sigma"].set_transform(T)


def _extent(scene: ReplayScene, motion: Motion, tool: Track, visuals: tuple[Visual, ...]) -> Array:
    """The outermost points (k, 3) m in base of all that moves or stands, for the camera to fit."""
    points = [scene.hand_path_base, tool.p, *(keyframe.T_base_tool.p[None] for keyframe in scene.keyframes)]
    if scene.table_height is not None:  # what is gripped stands there
        gripped = [keyframe.T_base_tool.p for keyframe in scene.keyframes if keyframe.grip]
        points += [np.array([[p[0], p[1], scene.table_height]]) for p in gripped]
    every = max(len(motion.t) // 40, 1)
    for visual in visuals:
        joint, T_joint_link = motion.link("visual", visual.link)
        moves = motion.joint(joint)
        corners = (T_joint_link @ visual.T_link_visual).act(visual.mesh.bounds())
        points.append(Track(moves.p[::every], moves.wxyz[::every]).act(corners).reshape(-1, 3))
    everything: Array = np.concatenate(points)
    directions = np.array(list(np.ndindex(5, 5, 5))) - 2.0
    outermost: Array = everything[np.unique(np.argmax(directions @ everything.T, axis=1))]
    return outermost


def describe(scene: ReplayScene, extent: Array) -> Mapping[str, Any]:
    """What the page shows beside the scene: a plain value that msgpack carries."""
    trajectory = scene.trajectory
    samples = trajectory.sample(25.0)
    return {
        "title": scene.title,
        "robot": scene.robot.description or scene.robot.name,
        "duration": trajectory.duration,
        "rate": FRAME_RATE_HZ,
        "keyframes": [
            {
                "label": keyframe.label,
                "t": float(keyframe.t),
                "p": keyframe.T_base_tool.p.tolist(),
                "sigma": None if keyframe.sigma_m is None else keyframe.sigma_m.tolist(),
                "grip": keyframe.grip,
            }
            for keyframe in scene.keyframes
        ],
        "gripper": {"t": trajectory.gripper_t.tolist(), "opening": trajectory.gripper_opening.tolist()},
        "joints": {
            "names": list(trajectory.joint_names),
            "t": typed(samples.t, "Float32Array"),
            "q": typed(samples.q.T, "Float32Array"),
        },
        "speed": None if scene.hand_speed is None else float(scene.hand_speed.max()),
        "table": scene.table_height,
        "extent": extent.tolist(),
        "notes": list(scene.notes),
    }
