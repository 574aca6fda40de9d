"""Small replays for tests: a robot, a few moves from rest to rest, and a hand whose path is a few mm off the tool's."""

import importlib.metadata
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pbd.arm.model import load_model
from pbd.data import Calibration, GraspedObject, Gripper, JointLimits, JointTrajectory, Keyframe, Obstacle, Robot
from pbd.data.world import gripped_spans, object_phases
from pbd.pose import Array, Pose
from pbd.replay import robot_motion
from pbd.view.replay_scene import ReplayScene, TouchingPair
from pbd.view.robot_motion import FRAME_RATE_HZ

QUARTER_TURN = Pose.from_rpy(np.zeros(3), (0.0, 0.0, np.pi / 2))


def share() -> Path:
    files = importlib.metadata.files("example-robot-data") or []
    urdf = next(file for file in files if file.name == "panda.urdf")
    return Path(str(urdf.locate())).resolve().parents[4]


def robot(
    name: str,
    urdf: str | Path,
    base: str,
    body: str,
    joints: tuple[str, ...],
    gripper: Gripper | None = None,
    T: Pose = QUARTER_TURN,
) -> Robot:
    k = len(joints)
    return Robot(
        name=name,
        description=name.upper(),
        urdf=share() / "example-robot-data" / "robots" / urdf,
        srdf=None,
        package_dirs=(share(),),
        base=base,
        body=body,
        T_body_tool=T,
        joints=joints,
        home=np.zeros(k),
        gripper=gripper,
        limits=JointLimits(-3.0 * np.ones(k), 3.0 * np.ones(k), 0.5 * np.ones(k), np.ones(k), np.ones(k), "none"),
    )


PANDA: str | Path = "panda_description/urdf/panda.urdf"
"""The Panda's URDF. The tests replace it by one with fewer triangles (conftest.py)."""


def panda() -> Robot:
    fingers = ("panda_finger_joint1", "panda_finger_joint2")
    return robot(
        "panda",
        PANDA,
        "panda_link0",
        "panda_hand_tcp",
        tuple(f"panda_joint{i}" for i in range(1, 8)),
        Gripper(fingers, np.full(2, 0.04), np.zeros(2), 0.8),
    )


def ur5() -> Robot:
    parts = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    return robot(
        "ur5", "ur_description/urdf/ur5_robot.urdf", "base_link", "tool0", tuple(f"{part}_joint" for part in parts)
    )


def rest_to_rest(
    joints: tuple[str, ...], q: ArrayLike, move_s: float, grip: ArrayLike, dwell_s: float = 0.4
) -> JointTrajectory:
    """Through configurations q (f, k), standing still in each; the gripper opens and closes in the dwells."""
    q, grip = np.asarray(q, dtype=np.float64), np.asarray(grip, dtype=np.float64)
    pieces, knots, gripper_t, opening = [], [0.0], [0.0], [grip[0]]
    for i, (here, there) in enumerate(pairwise(q)):
        step, zero = there - here, np.zeros(q.shape[1])
        pieces += [[here, zero, 3 * step / move_s**2, -2 * step / move_s**3], [there, zero, zero, zero]]
        knots += [knots[-1] + move_s, knots[-1] + move_s + dwell_s]
        gripper_t += knots[-2:]
        opening += [grip[i], grip[i + 1]]
    arrive = np.array([0.0, *knots[1::2]])
    return JointTrajectory(joints, np.array(knots), np.array(pieces), np.array(gripper_t), np.array(opening), arrive, q)


def replay(
    arm: Robot, trajectory: JointTrajectory, labels: tuple[str, ...], grasped: GraspedObject | None = None
) -> ReplayScene:
    motion = robot_motion(load_model(arm), trajectory.sample(FRAME_RATE_HZ))
    tool, t = motion.tool(arm), motion.t
    sway = 0.008 * np.stack([np.sin(1.3 * t), np.cos(1.7 * t) - 1.0, np.sin(0.9 * t)], axis=1)
    path: Array = tool.p + sway

    def at(instant: float) -> Pose:
        return tool[int(np.searchsorted(t, instant).clip(0, len(t) - 1))]

    opening = np.interp(trajectory.keyframe_t + 0.41, trajectory.gripper_t, trajectory.gripper_opening)
    closes = [None if abs(change) < 0.1 else bool(change < 0) for change in np.diff(opening, prepend=1.0)]
    growth = 1.0 + np.arange(len(labels)) / 3.0
    cov = np.square(growth)[:, None, None] * np.diag(np.square([0.004, 0.005, 0.003, 0.01, 0.01, 0.02]))
    tolerance_m = np.array([0.002, 0.003, 0.002])
    T_base_tool = tuple(map(at, trajectory.keyframe_t))
    keyframes = tuple(
        Keyframe(float(instant), 0.4, pose, cov[k], closes[k], labels[k], tolerance_m)
        for k, (instant, pose) in enumerate(zip(trajectory.keyframe_t, T_base_tool, strict=True))
    )
    spans = gripped_spans(trajectory.gripper_t, trajectory.gripper_opening)
    return ReplayScene(
        title="Pouring",
        robot=arm,
        trajectory=trajectory,
        motion=motion,
        calibration=Calibration("bench", table_height=0.0),
        keyframes=keyframes,
        T_base_tool=T_base_tool,
        cov=cov,
        tolerance=np.tile(np.diag(tolerance_m**2), (len(labels), 1, 1)),
        inside=np.linspace(0.9, 0.6, len(labels)),
        off_rad=np.zeros((len(labels), 2)),
        hand_path_base=path,
        hand_speed=np.linalg.norm(np.gradient(path, t, axis=0), axis=1),
        grasped=grasped,
        phases=() if grasped is None else object_phases(grasped, spans, at, 0.0),
        torque=0.674,
        notes=("Simulated data: no sensor was held.",),
    )


@cache
def pouring() -> ReplayScene:
    q = (
        (-0.133, -0.066, -0.350, -2.448, -0.033, 2.386, 0.327),
        (-0.142, 0.232, -0.317, -2.484, 0.168, 2.699, 0.183),
        (0.105, -0.222, -0.568, -2.354, -0.143, 2.162, 0.413),
        (0.439, -0.110, -0.197, -2.163, -0.024, 2.055, 0.639),
        (0.402, 0.347, -0.421, -1.915, 1.144, 1.434, -0.009),
        (0.727, -0.122, -0.476, -2.163, -0.063, 2.053, 0.669),
        (0.357, 0.322, -0.777, -2.465, 0.487, 2.649, -0.044),
        (0.718, -0.261, -1.192, -2.420, -0.325, 2.295, 0.543),
    )
    labels = ("dock", "grasp", "lift", "over the cup", "pour", "upright", "put down", "away")
    arm = panda()
    trajectory = rest_to_rest(arm.joints, q, 1.1, (1, 0.75, 0.75, 0.75, 0.75, 0.75, 1, 1))
    return replay(arm, trajectory, labels, GraspedObject("cylinder", (0.058, 0.17)))


def in_the_way() -> ReplayScene:
    """The same with a post and a wall. The hand touches the post for a second; later a link touches the table."""
    post = Obstacle("the post", "cylinder", (0.06, 0.4), Pose(np.array([0.62, -0.28, 0.2]), np.eye(4)[0]))
    wall = Obstacle("the wall", "box", (0.02, 8.0, 1.0), Pose(np.array([-0.5, 0.0, 0.5]), np.eye(4)[0]))
    message = "panda_hand touches the post at 4.00 s, 12 mm deep; move the post"
    contacts = (
        TouchingPair(("panda_hand", "the post"), 4.0, 5.0, message),
        TouchingPair(
            ("panda_link6", "the table"), 7.0, 7.25, "t = 7.0 s: panda_link6 would touch the table, 3.0 mm deep"
        ),
    )
    calibration = Calibration("bench", table_height=0.0, obstacles=(post, wall))
    return replace(pouring(), calibration=calibration, contacts=contacts, warnings=(f"collision: {message}",))


@cache
def ur5_moves() -> ReplayScene:
    q = (
        (-0.642, -1.483, 1.961, -2.048, -1.571, -2.213),
        (-0.642, -1.273, 2.116, -2.415, -1.571, -2.213),
        (-0.642, -1.566, 1.776, -1.781, -1.571, -2.213),
        (0.195, -1.566, 1.776, -1.781, -1.571, -1.676),
        (0.293, -1.480, 1.818, -1.909, -1.571, -1.577),
    )
    arm = ur5()
    return replay(arm, rest_to_rest(arm.joints, q, 1.203, np.ones(5)), ("", "", "", "", ""))
