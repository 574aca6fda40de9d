"""Lines along the table to an object that is grasped there: on the way it stands on the table, not in the hand."""

from dataclasses import replace

import numpy as np
import pytest

import pbd
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.ik.solver import solve
from pbd.arm.motion_request import DETOUR, LINE, STRAIGHT
from pbd.data import GraspedObject, Keyframe, Obstacle, Robot
from pbd.errors import PbdWarning
from pbd.planning import Plan, PlanOptions, plan_keyframes
from pbd.pose import Pose, quat_exp
from pbd.replay import detours
from tests.arm.bundled import arm_of
from tests.not_none import not_none

CUP = GraspedObject("cylinder", (0.05, 0.12))


def along_the_table(robot: Robot, seed: int) -> list[Keyframe]:
    """Move from the dock down to the table, along it to the cup, and up with the cup, with random rotations."""
    dock = not_none(robot.dock)
    rng = np.random.default_rng(seed)
    low = not_none(dock.table_height) - not_none(dock.T_base_dock).p[2] + 0.5 * CUP.size[-1]
    beside, cup = (rng.uniform((-0.1, -0.1), (0.1, 0.4)) for _ in range(2))
    places = [(0.0, 0.0, 0.0), (*beside, low), (*cup, low), (*cup, low + 0.1)]
    turns = [0.0, *rng.uniform(-2.5, 2.5, 3)]
    return [
        Keyframe(
            2.0 * i, 0.5, Pose(np.array(p), quat_exp((0.0, 0.0, turn))), 1e-6 * np.eye(6), True if i == 2 else None
        )
        for i, (p, turn) in enumerate(zip(places, turns, strict=True))
    ]


def test_a_line_along_the_table_leads_to_a_grasp() -> None:
    """Of 120 random motions, this one fails if the cup counts as held on the way to it."""
    robot = pbd.load_robot("panda")
    alone = PlanOptions(path="line", approach=False, retreat=False)
    plan = plan_keyframes(along_the_table(robot, 16), not_none(robot.dock), robot, alone, None, CUP)
    assert {way.kind for way in plan.segments[1:]} == {LINE}


def test_the_object_is_held_from_its_keyframe_on() -> None:
    """A cup held 10 cm beside the grasp would slide along the table, which is a contact."""
    arm = arm_of("panda")
    grasp = Pose(np.array([0.5, 0.0, 0.5 * CUP.size[-1]]), np.array([0.0, 1.0, 0.0, 0.0]))
    beside = Pose(grasp.p + np.array([0.1, 0.0, 0.0]), grasp.wxyz)
    scene = CollisionScene(arm, 0.0, (), CUP)
    _, arrives, leaves = scene.grasp_states([beside, grasp], [None, True])
    q_beside, q_grasp = (solve(arm, pose, arm.robot.home).q for pose in (beside, grasp))
    assert scene.hit(q_beside, arrives) is None
    assert scene.hit(q_beside, leaves) is not None
    assert scene.hit(q_grasp, arrives) is None
    assert scene.hit(q_grasp, leaves) is None


def carried(*obstacles: Obstacle, y: float) -> Plan:
    """Plan: the cup is grasped at y, m, moved aside and never released; the arm retreats with it."""
    robot = pbd.load_robot("panda")
    dock = not_none(robot.dock)
    low = not_none(dock.table_height) - not_none(dock.T_base_dock).p[2] + 0.5 * CUP.size[-1]
    places = [(0.0, y, 0.0), (0.0, y, low), (0.0, y, low + 0.15), (0.05, y + 0.1, low)]
    keyframes = [
        Keyframe(2.0 * i, 0.5, Pose(np.array(p), quat_exp((0.0, 0.0, 0.0))), 1e-6 * np.eye(6), True if i == 1 else None)
        for i, p in enumerate(places)
    ]
    alone, dock = PlanOptions(approach=False), replace(dock, obstacles=obstacles)
    return plan_keyframes(keyframes, dock, robot, alone, grasped=CUP)


def test_a_held_object_may_touch_its_support_at_the_last_keyframe() -> None:
    back = not_none(carried(y=0.1).retreat)
    assert back.kind == STRAIGHT


def test_a_detour_of_the_retreat_carries_the_object() -> None:
    pytest.importorskip("ompl")
    wall = Obstacle("the wall", "box", (0.8, 0.02, 1.1), Pose.from_rpy((0.55, 0.22, 0.35), (0.0, 0.0, 0.0)))
    with pytest.warns(PbdWarning, match="^on its way back the arm goes around the wall"):
        plan = carried(wall, y=0.5)
    assert not_none(plan.retreat).kind == DETOUR
    assert detours(plan) == ((plan.trajectory.keyframe_t[-1], plan.trajectory.duration),)
