"""What the audit works out anew: where the joints are, how far they move, the gripper's rod, the object, the pairs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.audit_arm import AuditArm
from pbd.arm.audit_collision import STEP_M, find_touch
from pbd.arm.audit_grasp import follow_object, tool_rod
from pbd.arm.audit_nodes import node_times, nodes_at
from pbd.arm.audit_pairs import AuditScene
from pbd.arm.audit_solids import BEYOND_M, link_solids
from pbd.arm.collision import object_stays
from pbd.arm.hand import tool_rod as planned_rod
from pbd.arm.joint_path import solve_path
from pbd.arm.model import load_model
from pbd.arm.scene import CollisionScene
from pbd.arm.timing import time_keyframes
from pbd.data import Calibration, GraspedObject, JointLimits, JointTrajectory, Obstacle, Robot
from pbd.planning import plan_keyframes
from pbd.pose import Array, Pose
from tests.arm.bundled import NAMES, arm_of, keyframes_of, path_of
from tests.arm.conftest import random_joints

BOTTLE = GraspedObject("cylinder", (0.07, 0.2))
BENCH = Calibration("bench", T_base_dock=Pose.identity())
DOWN = (np.pi, 0.0, 0.0)


def configuration(robot: Robot, model: pin.Model, q: Array, opening: float) -> Array:
    values = dict(zip(robot.joints, q, strict=True))
    if robot.gripper:
        fingers = robot.gripper.closed + opening * (robot.gripper.open - robot.gripper.closed)
        values |= dict(zip(robot.gripper.joints, fingers, strict=True))
    found: Array = pin.neutral(model)
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        found[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return found


def test_joints_are_where_pinocchio_says(odd_robot: Robot) -> None:
    """Endless, sliding and slanted joints, a base that isn't the root, fingers."""
    for robot in (odd_robot, arm_of("panda").robot, arm_of("kinova").robot, arm_of("so101").robot):
        arm, model = AuditArm(robot), pin.buildModelFromUrdf(str(robot.urdf))
        q = random_joints(robot, 5, seed=1)
        x = np.column_stack((q, np.linspace(0.0, 1.0, 5)))
        placed, data = arm.placements(x), model.createData()
        for row, each in enumerate(x):
            pin.framesForwardKinematics(model, data, configuration(robot, model, each[:-1], each[-1]))
            base = data.oMf[model.getFrameId(robot.base, pin.FrameType.BODY)]
            for joint in range(1, model.njoints):
                wanted = base.inverse() * data.oMi[joint]
                np.testing.assert_allclose(placed.at(joint, row).R, wanted.rotation, atol=1e-12)
                np.testing.assert_allclose(placed.at(joint, row).p, wanted.translation, atol=1e-12)


def swing(robot: Robot, seed: int = 0) -> JointTrajectory:
    q = random_joints(robot, 4, seed=seed, margin=0.2)
    grips = (None, True, False, None) if robot.gripper else (None,) * 4
    return time_keyframes(arm_of(robot.name), q, [0.1] * 4, grips, robot.home)


@pytest.mark.parametrize("name", ["panda", "so101", "ur5"])
def test_no_point_moves_more_than_a_step_between_nodes(name: str) -> None:
    """The way of each corner between two nodes, summed up over a hundredth of the time between."""
    robot = arm_of(name).robot
    arm, trajectory = AuditArm(robot), swing(robot)
    solids = [solid for solid in link_solids(arm) if solid.joint > 0]
    bounds = [sum(arm.motion(each.joint, each.reach).values(), np.zeros(len(robot.joints) + 1)) for each in solids]
    fastest = np.max(bounds, axis=0)
    t = node_times(trajectory, fastest, STEP_M, [0.5])
    assert t[0] == 0.0
    assert t[-1] == trajectory.duration
    assert 0.5 in t
    nodes = nodes_at(arm, trajectory, t)
    assert (np.diff(nodes.moved @ fastest) <= STEP_M + 1e-12).all()
    for row in np.random.default_rng(0).integers(0, len(t) - 1, 40):
        fine = nodes_at(arm, trajectory, np.linspace(t[row], t[row + 1], 100))
        moved = nodes.moved[row + 1] - nodes.moved[row]
        assert (np.abs(np.diff(fine.x, axis=0)).sum(axis=0) <= moved + 1e-12).all()
        for solid, bound in zip(solids, bounds, strict=True):
            p = np.stack([fine.placed.points(solid.joint, corner) for corner in solid.T_joint_solid.act(solid.corners)])
            assert np.linalg.norm(np.diff(p, axis=1), axis=2).sum(axis=1).max() <= moved @ bound + 1e-12


@pytest.mark.parametrize("name", ["panda", "ur3", "so101", "z1"])
def test_a_hull_holds_all_of_its_mesh(name: str) -> None:
    directions = np.random.default_rng(0).normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for solid in link_solids(AuditArm(arm_of(name).robot)):
        if not hasattr(solid.exact, "vertices") and not hasattr(solid.exact, "points"):
            continue
        points = np.array(solid.exact.vertices() if hasattr(solid.exact, "vertices") else solid.exact.points())
        beyond = solid.support(directions) - (directions @ points.T).max(axis=1)
        assert beyond.min() >= -1e-9
        assert beyond.max() <= 2.0 * BEYOND_M
        assert (solid.box_support(directions) >= solid.support(directions) - 1e-9).all()


@pytest.mark.parametrize("name", NAMES)
def test_the_rod_is_the_planners(name: str) -> None:
    arm, planned = AuditArm(arm_of(name).robot), planned_rod(arm_of(name))
    rod = tool_rod(arm, link_solids(arm))
    assert (rod is None) == (planned is None)
    if rod is not None and planned is not None:
        ends = np.array([[0.0, 0.0, -0.5 * planned.size[1]], [0.0, 0.0, 0.5 * planned.size[1]]])
        np.testing.assert_allclose(rod.T_joint_solid.act(rod.corners), planned.T_joint_body.act(ends), atol=2e-3)
        assert rod.ball == 0.5 * planned.size[0]


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_the_object_goes_where_the_planner_takes_it(name: str) -> None:
    robot = arm_of(name).robot
    assert robot.dock is not None
    plan = plan_keyframes(keyframes_of("pouring"), robot.dock, robot, None, path_of("pouring"), BOTTLE)
    arm, scene = AuditArm(robot), CollisionScene.build(arm_of(name), robot.dock, BOTTLE)
    carried = follow_object(arm, plan.trajectory, BOTTLE, robot.dock.table_height)
    stays = object_stays(scene, plan.trajectory)
    assert [(each.start, each.end) for each in carried] == [(stay.start, stay.end) for stay in stays]
    for each, stay in zip(carried, stays, strict=True):
        if not stay.held:
            assert each.joint == 0
            assert each.T_joint_object.pose().distance(stay.pose) == pytest.approx((0.0, 0.0), abs=1e-7)
        else:
            rests = [rest.pose().distance(wanted) for rest, wanted in zip(each.rests, stay.rests, strict=True)]
            np.testing.assert_allclose(rests, 0.0, atol=1e-7)


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


def test_what_touches_in_nearly_every_configuration_is_left_out(tmp_path: Path, odd_robot: Robot) -> None:
    """A tall block on the second link always sticks in a plate of the base, one that is far out never does."""
    path = tmp_path / "stack.urdf"
    path.write_text(STACK, encoding="utf-8")
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
