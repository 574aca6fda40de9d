"""A user's own robot: with a URDF and a TOML file it replays as the bundled ones do."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.arm.ik.branches import configuration_cost
from pbd.arm.ik.starts import reach
from pbd.arm.model import load_model
from pbd.calibration.tool_poses import with_table
from pbd.cli.calibrate.dock import tool_at_joints
from pbd.data import Robot
from pbd.errors import PbdWarning, PlanError, collected_warnings
from pbd.files.robot import load_robot, read_robot
from pbd.planning import PlanOptions, plan_keyframes
from pbd.planning.preconditions import warn_of_frames
from pbd.planning.result import size_remark
from pbd.pose import quat_from_rpy, quat_to_matrix
from tests.arm.bundled import keyframes_of
from tests.arm.own_robot import AXES, GUIDE, LENGTHS, own_toml, own_urdf
from tests.not_none import not_none

TIP = 0.12  # m, from the last joint


LIGHT = "torques are underestimated: the URDF gives no link mass on joint1, joint2, joint3, joint4, joint5, joint6"


@pytest.fixture
def mine(elsewhere: Path) -> Robot:
    """A URDF of six joints, and the TOML that docs/robots.md gives."""
    (elsewhere / "robots").mkdir()
    (elsewhere / "robots" / "mine.urdf").write_text(own_urdf(), encoding="utf-8")
    (elsewhere / "robots" / "mine.toml").write_text(own_toml(), encoding="utf-8")
    return load_robot("mine")


def test_the_example_in_the_guide_replays(mine: Robot) -> None:
    bare = "contacts may be missed: base_link has no collision shape; link1 has no "
    with pytest.warns(PbdWarning, match=bare), pytest.warns(PbdWarning, match=LIGHT):
        plan = plan_keyframes(keyframes_of("pouring"), not_none(mine.dock), mine)
    assert plan.report.max_position_error_m < 1e-5
    assert mine.joints == tuple(f"joint{i}" for i in range(1, 7))
    assert mine.limits.assumed == ("acceleration", "jerk")


def test_the_guides_table_of_angles_is_right() -> None:
    rows = re.findall(r"(?m)^ *\| ([+-])([xyz]) \|(.*)\|(.*)\|(.*)\|$", GUIDE.read_text(encoding="utf-8"))
    assert len(rows) == 6
    for sign, approach, *cells in rows:
        for i, cell in enumerate(cells):
            assert (cell.strip() == "") == ("xyz"[i] == approach)
            if cell.strip():
                R = quat_to_matrix(quat_from_rpy(np.radians([float(angle) for angle in cell.split(",")])))
                np.testing.assert_allclose(R[:, 2], float(f"{sign}1") * np.eye(3)["xyz".index(approach)], atol=1e-12)
                np.testing.assert_allclose(np.abs(R[:, 0]), np.eye(3)[i], atol=1e-12)


def test_its_tool_is_where_the_guide_says(mine: Robot) -> None:
    arm = load_model(mine)
    here = arm.forward(np.zeros(6))  # all along x
    R = quat_to_matrix(here.wxyz)
    np.testing.assert_allclose(here.p, [sum(LENGTHS[3:]) + TIP, 0.0, sum(LENGTHS[:3])], atol=1e-12)
    np.testing.assert_allclose(R[:, 2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(R[:, 0], [0, 0, 1], atol=1e-12)
    home = quat_to_matrix(arm.forward(mine.home).wxyz)
    assert home[2, 2] < -0.999


def test_its_reach_is_the_sum_of_its_lengths(mine: Robot) -> None:
    assert reach(load_model(mine)) == pytest.approx(sum(LENGTHS[2:]) + TIP, abs=1e-3)


@pytest.mark.parametrize(("roll_deg", "warned"), [(0, False), (4, False), (6, True), (90, True), (180, True)])
def test_a_base_that_hangs_is_warned_of(mine: Robot, tmp_path: Path, roll_deg: int, warned: bool) -> None:
    """A robot that names the link on which the arm is mounted has its z up again."""
    mount = (
        '<robot name="mine"><link name="room"/><joint name="mount" type="fixed"><parent link="room"/>'
        f'<child link="base_link"/><origin xyz="0 0 2" rpy="{np.radians(roll_deg)} 0 0"/></joint>'
    )
    urdf = own_urdf().replace('<robot name="mine">', mount)
    (tmp_path / "robots" / "mine.urdf").write_text(urdf, encoding="utf-8")
    with collected_warnings() as said:
        warn_of_frames(load_model(replace(mine, base="room")))
        assert said == []
        warn_of_frames(load_model(mine))
    assert [f"{roll_deg} degrees off that of the URDF's root link room" in each for each in said] == [True] * warned


def test_an_arm_that_is_singular_everywhere_has_no_cost_for_it(mine: Robot, tmp_path: Path) -> None:
    """Its last three joints turn about one axis. Without a cost that is a number, no move would be the cheapest."""
    axes = (*AXES[:3], "1 0 0", "1 0 0", "1 0 0")
    (tmp_path / "robots" / "mine.urdf").write_text(own_urdf(axes), encoding="utf-8")
    arm = load_model(read_robot(tmp_path / "robots" / "mine.toml"))
    np.testing.assert_array_equal(configuration_cost(arm, np.array([arm.robot.home, 0.5 * arm.robot.home])), 0.0)


def test_a_start_of_a_joint_that_slides_is_told_in_metres(mine: Robot, tmp_path: Path) -> None:
    urdf = own_urdf().replace('name="joint1" type="revolute"', 'name="joint1" type="prismatic"')
    (tmp_path / "robots" / "mine.urdf").write_text(urdf, encoding="utf-8")
    rail, start = load_robot("mine"), PlanOptions(start=(9.0, *mine.home[1:].tolist()))
    with pytest.raises(PlanError, match=r"the start has joint1 at 9 m, outside its .* in m, or with --units mm"):
        plan_keyframes(keyframes_of("pouring"), not_none(mine.dock), rail, start)
    with pytest.raises(PlanError, match=r"joint joint1 can't be at 9: its limits are -3 to 3; give m within them"):
        tool_at_joints([9.0, *mine.home[1:].tolist()], rail)


def test_its_own_dock_is_named_where_it_has_no_table(mine: Robot) -> None:
    dock = replace(not_none(mine.dock), table_height=None)
    here = replace(mine, dock=dock)
    assert size_remark(here, with_table(dock, here), 1.0).endswith("(scale 0.7 of mine's own dock)")


def test_a_robot_without_a_gripper_leaves_out_what_the_hand_gripped(mine: Robot) -> None:
    bare, left_out = "contacts may be missed: base_link has no collision shape", "mine has no gripper"
    warned = [pytest.warns(PbdWarning, match=each) for each in (bare, left_out, LIGHT)]
    with warned[0], warned[1], warned[2]:
        plan = plan_keyframes(keyframes_of("paper-test1"), not_none(mine.dock), replace(mine, gripper=None))
    assert len(plan.trajectory.gripper_t) == 1
