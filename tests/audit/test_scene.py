"""What the audit works out anew: how far joints move a solid, hulls, the gripper's rod, the object, the pairs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from pbd.arm.gripper import tool_rod as planned_rod
from pbd.arm.joint_path import solve_path
from pbd.arm.model import load_model
from pbd.audit.arm import AuditArm
from pbd.audit.collision_pairs import AuditScene
from pbd.audit.contact import SHARED, Motion, Pair, coordinates, find_touch
from pbd.audit.grasp import may_rest, tool_rod
from pbd.audit.solids import hull_distance, link_solids, simple_solid
from pbd.data import Calibration, GraspedObject, JointLimits, JointTrajectory, Obstacle, Robot
from pbd.data.world import Stay
from pbd.pose import Pose
from tests.arm.bundled import NAMES, arm_of
from tests.arm.conftest import random_joints
from tests.arm.straight import time_keyframes

BOTTLE = GraspedObject("cylinder", (0.07, 0.2))
BENCH = Calibration("bench", T_base_dock=Pose.identity())
DOWN = (np.pi, 0.0, 0.0)


def swing(robot: Robot, seed: int = 0) -> JointTrajectory:
    q = random_joints(robot, 4, seed=seed, margin=0.2)
    grips = (None, True, False, None) if robot.gripper else (None,) * 4
    return time_keyframes(load_model(robot), q, [0.1] * 4, grips, robot.home)


@pytest.mark.parametrize("name", ["odd", "panda", "so101", "kinova"])
def test_no_point_moves_farther_than_is_bounded(name: str, odd_robot: Robot) -> None:
    """The way of a point of each solid against base, summed up over 20 us, between instants of the grid."""
    robot = odd_robot if name == "odd" else arm_of(name).robot
    arm, trajectory = AuditArm(robot), swing(robot)
    motion, rng = Motion(arm, trajectory), np.random.default_rng(0)
    still = simple_solid("still", 0, pin.SE3.Identity(), "sphere", (0.1,))
    for joint in filter(arm.driven, range(1, arm.model.njoints)):
        p = rng.normal(0.0, 0.1, 3)
        thing = simple_solid("thing", joint, pin.SE3(np.eye(3), p), "sphere", (1e-6,))
        travel = motion.travel(Pair(thing, still))
        for row in rng.integers(0, len(motion.t) - 1, 10):
            fine = coordinates(trajectory, np.linspace(motion.t[row], motion.t[row + 1], 200))
            way = np.diff([arm.place(x)[joint].act(p) for x in fine], axis=0)
            assert np.linalg.norm(way, axis=1).sum() <= travel[row + 1] - travel[row] + 1e-9


@pytest.mark.parametrize("name", ["odd", "panda", "so101", "kinova"])
def test_nothing_touches_where_balls_are_too_far_apart(name: str, odd_robot: Robot) -> None:
    """All pairs, the table, a ball and a carried bottle among them, at instants of spans in which nobody looks."""
    robot = odd_robot if name == "odd" else arm_of(name).robot
    arm, rng = AuditArm(robot), np.random.default_rng(0)
    trajectory = swing(robot)
    ball = Obstacle("the ball", "sphere", (0.1,), Pose.from_rpy((0.3, 0.2, 0.3), DOWN))
    scene = AuditScene(arm, replace(BENCH, table_height=-0.1, obstacles=(ball,)), BOTTLE)
    motion, skipped = Motion(arm, trajectory), 0
    for pair in scene.pairs(trajectory):
        spans = (len(motion.t) - 1) // SHARED + 1
        for span in np.setdiff1d(np.arange(spans), motion.near(pair, motion.travel(pair))):
            row = int(rng.integers(span * SHARED, min((span + 1) * SHARED, len(motion.t) - 1) + 1))
            assert hull_distance(*pair.at(motion.at(row))) > 0.0
            skipped += 1
    assert skipped > 1000


def test_the_last_instant_is_in_a_span_however_many_there_are() -> None:
    robot, counts = arm_of("panda").robot, set()
    arm = AuditArm(robot)
    still, thing = (simple_solid("ball", j, pin.SE3.Identity(), "sphere", (9.0,)) for j in (0, arm.tool_joint))
    for dwell in 0.1 + 0.004 * np.arange(SHARED):
        motion = Motion(arm, time_keyframes(arm_of("panda"), robot.home[None], [dwell], [None], robot.home))
        pair, last = Pair(thing, still), len(motion.t) - 1
        assert motion.near(pair, motion.travel(pair))[-1] == last // SHARED
        counts.add(last % SHARED)
    assert len(counts) == SHARED


@pytest.mark.parametrize("name", ["panda", "ur3", "so101", "z1"])
def test_a_hull_holds_all_of_its_mesh_and_little_more(name: str) -> None:
    directions = np.random.default_rng(0).normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for solid in link_solids(AuditArm(arm_of(name).robot)):
        if solid.mesh is not None:
            hull, mesh = np.array(solid.hull.points()), solid.triangles.reshape(-1, 3)
            beyond = (directions @ hull.T).max(axis=1) + solid.pad - (directions @ mesh.T).max(axis=1)
            assert beyond.min() >= 0.0
            assert beyond.max() <= 2.0 * solid.pad


@pytest.mark.parametrize("name", NAMES)
def test_the_rod_is_the_planners(name: str) -> None:
    arm, planned = AuditArm(arm_of(name).robot), planned_rod(arm_of(name))
    rod = tool_rod(arm, link_solids(arm))
    assert (rod is None) == (planned is None)
    if rod is not None and planned is not None:
        ends = np.array([[0.0, 0.0, -0.5 * planned.size[1]], [0.0, 0.0, 0.5 * planned.size[1]]])
        own = [rod.T_joint_solid.act(np.array([0.0, 0.0, end])) for end in (-rod.hull.halfLength, rod.hull.halfLength)]
        np.testing.assert_allclose(own, planned.T_joint_body.act(ends), atol=2e-3)
        assert rod.hull.radius == 0.5 * planned.size[0]


def test_what_is_carried_is_looked_at() -> None:
    """A bottle in the hand meets a post that the hand itself stays clear of; where it stands it may touch the table."""
    robot = arm_of("panda").robot
    arm, own = arm_of("panda"), AuditArm(robot)
    places = [Pose.from_rpy((0.5, y, z), DOWN) for y, z in ((-0.2, 0.1), (-0.2, 0.25), (0.2, 0.25), (0.2, 0.1))]
    q = solve_path(arm, places, robot.home)
    trajectory = time_keyframes(arm, q, [0.5] * 4, (True, None, None, False), robot.home)
    post = Obstacle("the post", "box", (0.05, 0.05, 0.2), Pose.from_rpy((0.5, 0.0, 0.1), (0.0, 0.0, 0.0)))
    for obstacles, grasped, wanted in (((), BOTTLE, None), ((post,), None, None),
                                       ((post,), BOTTLE, ("the cylinder", "the post"))):  # fmt: skip
        world = replace(BENCH, table_height=0.0, obstacles=obstacles)
        scene = AuditScene(own, world, grasped)
        touch = find_touch(own, trajectory, scene.pairs(trajectory))
        assert (touch and touch.bodies) == wanted
    low = replace(post, T_base_obstacle=Pose.from_rpy((0.5, 0.0, 0.04), (0.0, 0.0, 0.0)))
    scene = AuditScene(own, replace(BENCH, table_height=0.0, obstacles=(low,)), BOTTLE)
    assert find_touch(own, trajectory, scene.pairs(trajectory)) is None


@pytest.mark.parametrize("name", NAMES)
def test_pairs_are_left_out_for_a_reason_only(name: str) -> None:
    robot = arm_of(name).robot
    assert robot.dock is not None
    scene = AuditScene(AuditArm(robot), robot.dock, None)
    for why in scene.left_out.values():
        assert why in ("both belong to the gripper", "next to each other", "SRDF: Adjacent", "SRDF: Never")


@pytest.mark.parametrize("wholly", [False, True])
def test_what_touches_in_nearly_every_configuration_is_left_out(wholly: bool, tmp_path: Path, odd_robot: Robot) -> None:
    """A tall block on the second link always sticks in a plate of the base, or is wholly inside its mesh; one that is
    far out never does.
    """
    path, urdf = tmp_path / "stack.urdf", STACK
    if wholly:
        trimesh.creation.box((0.4, 0.4, 0.2)).export(tmp_path / "plate.stl")
        urdf = STACK.replace('<box size="0.4 0.4 0.2"/>', '<mesh filename="plate.stl"/>').replace("-0.1", "-0.15")
    path.write_text(urdf.replace('length="0.2"', 'length="0.1"') if wholly else urdf, encoding="utf-8")
    limits = {name: getattr(odd_robot.limits, name)[:2] for name in ("velocity", "acceleration", "jerk")}
    lower, upper = np.full(2, -1.0), np.full(2, 1.0)
    stack = replace(
        odd_robot,
        name="stack",
        urdf=path,
        base="base",
        body="upper",
        joints=("first", "second"),
        home=np.zeros(2),
        limits=JointLimits(lower, upper, **limits, source="a test"),
    )
    scene = AuditScene(AuditArm(stack), BENCH, None)
    assert scene.left_out["base", "upper"] == "touch in nearly every configuration"
    own = [pair for pair in scene.pairs(time_of(stack)) if pair.first.name == "base" and pair.second.name == "upper"]
    assert len(own) == 1


def time_of(robot: Robot) -> JointTrajectory:
    return time_keyframes(load_model(robot), np.full((1, 2), 0.1), [0.0], [None], robot.home)


STACK = """<?xml version="1.0"?>
<robot name="stack">
  <link name="base">
    <collision><origin xyz="0 0 0.1"/><geometry><box size="0.4 0.4 0.2"/></geometry></collision>
  </link>
  <link name="lower">
    <collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.02" length="0.02"/></geometry></collision>
  </link>
  <link name="upper">
    <collision><origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.02" length="0.2"/></geometry></collision>
    <collision><origin xyz="0 0 0.3"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="first" type="revolute">
    <parent link="base"/> <child link="lower"/> <origin xyz="0 0 0.2"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="-1" upper="1" velocity="1"/>
  </joint>
  <joint name="second" type="revolute">
    <parent link="lower"/> <child link="upper"/> <origin xyz="0 0 0.05"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="-1" upper="1" velocity="1"/>
  </joint>
</robot>
"""


def ball_on_a_slope(degrees: float, gap_m: float, aside_m: float) -> bool:
    """Whether a held ball of 10 cm may touch a slope: let go so far above it, now so far aside."""
    own, turn = AuditArm(arm_of("panda").robot), pin.exp3(np.array([np.radians(degrees), 0.0, 0.0]))
    slope = simple_solid("slope", 0, pin.SE3(turn, np.zeros(3)), "box", (2.0, 2.0, 0.2))
    ball = simple_solid("ball", own.tool_joint, pin.SE3.Identity(), "sphere", (0.1,))
    rest = turn @ np.array([0.0, 0.0, 0.15 + gap_m])
    T_base_rest = Pose(own.T_universe_base.inverse().act(rest), Pose.identity().wxyz)
    allowed = may_rest(own, Stay(0.0, 1.0, True, Pose.identity(), (T_base_rest,)), ball, slope)
    now = pin.SE3(np.eye(3), rest + np.array([aside_m, 0.0, 0.0]))
    return allowed is not None and allowed({own.tool_joint: now})


@pytest.mark.parametrize(
    ("degrees", "gap_m", "aside_m", "free"),
    [(0.0, 0.028, 0.0, True), (0.0, 0.032, 0.0, False), (0.0, 0.0, 0.028, True), (0.0, 0.0, 0.032, False),
     (44.0, 0.0, 0.0, True), (46.0, 0.0, 0.0, False)],
)  # fmt: skip
def test_a_held_thing_may_touch_what_faces_up_within_three_centimetres(
    degrees: float, gap_m: float, aside_m: float, free: bool
) -> None:
    assert ball_on_a_slope(degrees, gap_m, aside_m) == free


def test_a_speed_that_peaks_between_two_instants_is_bounded() -> None:
    """It is zero at the instants of the grid, 2 ms apart, and 7.5 mrad/s between."""
    robot = arm_of("panda").robot
    coefficients = np.zeros((1, 4, len(robot.joints)))
    coefficients[0, 1:, 3] = 0.0, 7.5, -2500.0  # qd = 7500 s (2 ms - s)
    trajectory = JointTrajectory(
        joint_names=robot.joints,
        knots=np.array([0.0, 0.002]),
        coefficients=coefficients,
        gripper_t=np.zeros(1),
        gripper_opening=np.ones(1),
        keyframe_t=np.zeros(1),
        keyframe_q=np.zeros((1, len(robot.joints))),
    )
    motion = Motion(AuditArm(robot), trajectory)
    assert motion.t.tolist() == [0.0, 0.002]
    assert motion.moved[-1, 3] >= trajectory.at(motion.t).q[-1, 3] > 9e-6
