"""The rod that stands for a gripper if the model has none."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from pbd.arm import gripper
from pbd.arm.collision.clearance import MARGIN_M
from pbd.arm.collision.scene import CollisionScene, GraspState
from pbd.arm.gripper import ROD_RADIUS_M, ROD_SHORT_M, arm_bodies, gripper_links, opening_direction, tool_rod
from pbd.arm.ik.solver import solve
from pbd.arm.model import ArmModel, load_model
from pbd.data import GraspedObject, Obstacle
from pbd.data.world import TABLE, THE_TOOL, ObjectPhase
from pbd.errors import PbdWarning
from pbd.planning.preconditions import warn_of_frames
from pbd.pose import Array, Pose, quat_from_rpy
from tests.arm.bundled import NAMES, arm_of
from tests.arm.collision_oracles import coordinates, placements
from tests.not_none import not_none

WITHOUT = ("ur3", "ur5", "ur10", "xarm7")
DOWN = quat_from_rpy((np.pi, 0.0, 0.0))


def at(arm: ArmModel, z: float, roll: float = 0.0) -> Array:
    """Return joints with the tool over the dock at a height in base, m, pointing down or tilted."""
    dock = not_none(arm.robot.dock)
    x, y, _ = not_none(dock.T_base_dock).p
    result = solve(arm, Pose(np.array([x, y, z]), quat_from_rpy((np.pi + roll, 0.0, 0.0))), arm.robot.home)
    assert result.reached
    return result.q


def test_arms_without_a_gripper_in_the_model_have_one() -> None:
    assert [name for name in NAMES if tool_rod(arm_of(name)) is not None] == sorted(WITHOUT)
    assert THE_TOOL in gripper_links(arm_of("ur5"), arm_bodies(arm_of("ur5")))


@pytest.mark.parametrize(("gap_m", "needed"), [(0.015, False), (0.025, True)])
def test_a_bare_flange_at_the_tools_origin_needs_no_rod(
    monkeypatch: pytest.MonkeyPatch, gap_m: float, needed: bool
) -> None:
    monkeypatch.setattr(gripper, "link_bodies", lambda _: ())
    monkeypatch.setattr(arm_of("ur5"), "T_joint_tool", Pose.from_rpy((0.0, 0.0, gap_m), (0.0, 0.0, 0.0)))
    assert (tool_rod(arm_of("ur5")) is not None) == needed


@pytest.mark.parametrize("name", WITHOUT)
def test_the_rod_ends_just_before_the_tools_origin(name: str) -> None:
    arm = arm_of(name)
    rod = arm_bodies(arm)[-1]
    assert rod.name == THE_TOOL
    for x in coordinates(arm, 5):
        T_base_rod = placements(arm, x)[rod.joint] @ rod.T_joint_body
        ends = T_base_rod.act(np.array([[0.0, 0.0, side * 0.5 * rod.size[1]] for side in (-1, 1)]))
        tool = arm.forward(x[:-1])
        far, near = np.linalg.norm(ends - tool.p, axis=1)
        assert near == pytest.approx(ROD_SHORT_M + ROD_RADIUS_M, abs=1e-6)
        assert far == pytest.approx(np.linalg.norm(arm.robot.T_body_tool.p), abs=5e-3)


@pytest.mark.parametrize("name", WITHOUT)
def test_the_tool_may_come_down_to_the_table_and_no_farther(name: str) -> None:
    arm = arm_of(name)
    scene = CollisionScene(arm, 0.0)
    for roll in (0.0, 0.4):
        assert scene.hit(at(arm, 0.0, roll)) is None
    hit = not_none(scene.hit(at(arm, -0.02)))
    assert (hit.first, hit.second) == (THE_TOOL, TABLE)
    assert hit.distance == pytest.approx(ROD_SHORT_M - 0.02, abs=1e-4)


@pytest.mark.parametrize("name", WITHOUT)
def test_the_rod_may_touch_the_object_but_no_obstacle(name: str) -> None:
    arm = arm_of(name)
    q = at(arm, 0.2)
    for side, free in ((ROD_RADIUS_M + 0.01, False), (ROD_RADIUS_M + 0.01 + 2.0 * MARGIN_M, True)):
        p = arm.forward(q).act((side, 0.0, -0.08))
        ball = Obstacle("ball", "sphere", (0.02,), Pose(p, DOWN))
        hit = CollisionScene(arm, None, [ball]).hit(q)
        assert (hit is None) == free
        if hit is not None:
            assert (hit.first, hit.second) == (THE_TOOL, "ball")
    scene = CollisionScene(arm, 0.0, grasped=GraspedObject("cylinder", (0.06, 0.1)))
    assert scene.hit(q, GraspState(0.0, ObjectPhase(0.0, 1.0, True, Pose.identity()))) is None


@pytest.mark.parametrize("name", ["panda", "z1", "so100", "so101"])
def test_jaws_that_open_along_another_axis_are_warned_of(name: str) -> None:
    arm = arm_of(name)
    along = not_none(opening_direction(arm))
    assert abs(along[0]) > np.cos(np.radians(13.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_frames(arm)
    for rpy, axis in (((0.0, 0.0, np.pi / 2), "y"), ((0.0, np.pi / 2, 0.0), "z")):
        turned = arm.robot.T_body_tool @ Pose(np.zeros(3), quat_from_rpy(rpy))
        with pytest.warns(PbdWarning, match=f"the jaws of {name} open along the tool's {axis}, not its x: correct T_b"):
            warn_of_frames(load_model(replace(arm.robot, T_body_tool=turned)))


@pytest.mark.parametrize("name", ["panda", "z1", "so100", "so101"])
def test_jaws_that_part_when_they_close_are_warned_of(name: str) -> None:
    robot = arm_of(name).robot
    assert robot.gripper is not None
    swapped = replace(robot.gripper, open=robot.gripper.closed, closed=robot.gripper.open)
    with pytest.warns(PbdWarning, match=f"the jaws of {name} are farther apart when closed than when open: exchange"):
        warn_of_frames(load_model(replace(robot, gripper=swapped)))


def test_an_arm_without_jaws_opens_none() -> None:
    assert opening_direction(arm_of("kinova")) is None
