"""Torques against a pendulum's equation and against MuJoCo; warnings and refusals of the planner."""

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.audit.arm import AuditArm
from pbd.audit.torque import Torque, _inertia, find_torque, torques
from pbd.cli import main
from pbd.data import GraspedObject, JointLimits, JointTrajectory, Load, MimicJoint, Robot
from pbd.data.world import gripped_spans
from pbd.errors import PbdWarning, PlanError
from pbd.planning import Plan, PlanOptions, plan_keyframes
from pbd.planning.torque import check_torque
from pbd.pose import Array, Pose
from tests.arm.bundled import FOLDER, KINDS, arm_of, keyframes_of
from tests.audit.mujoco_arm import MujocoArm
from tests.not_none import not_none

PENDULUM = """<robot name="pendulum">
<link name="room"/><link name="base"/>
<link name="rod">{inertial}</link>
<joint name="wall" type="fixed"><parent link="room"/><child link="base"/><origin rpy="0.3 -1.2 0.5"/></joint>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>"""
INERTIAL = """<inertial><origin xyz="0 0 -0.4"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.05" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def pendulum(folder: Path, inertial: str) -> AuditArm:
    """A rod that hangs along -z of its base and swings about y. The base is tilted in the URDF's world."""
    urdf, one = folder / "pendulum.urdf", np.ones(1)
    urdf.write_text(PENDULUM.format(inertial=inertial))
    limits = JointLimits(-9.0 * one, 9.0 * one, one, one, one, "a test")
    return AuditArm(
        Robot("", "", urdf, None, (), "base", "rod", Pose.identity(), ("hinge",), np.zeros(1), None, limits)
    )


def swing() -> JointTrajectory:
    """A cubic motion from 0.2 rad, at 0.7 rad/s."""
    cubic, none = np.array([0.2, 0.7, -1.5, 0.9]).reshape(1, 4, 1), np.zeros(0)
    return JointTrajectory(("hinge",), np.array([0.0, 2.0]), cubic, np.zeros(1), np.ones(1), none, np.zeros((0, 1)))


def test_torques_of_a_pendulum(tmp_path: Path) -> None:
    t, load = np.linspace(0.0, 1.9, 20), Load(3.0, (0.3, 0.0, -0.4))
    q, qdd = 0.2 + t * (0.7 + t * (-1.5 + t * 0.9)), -3.0 + 5.4 * t
    rod, ball = 0.4 * np.sin(q), 0.4 * np.sin(q) - 0.3 * np.cos(q)  # horizontal levers, m; the ball is at radius 0.5
    by_hand = (0.05 + 2.0 * 0.16 + 3.0 * 0.25) * qdd + 9.81 * (2.0 * rod + 3.0 * ball)
    arm = pendulum(tmp_path, INERTIAL)
    np.testing.assert_allclose(torques(arm, swing(), t, load)[:, 0], by_hand, atol=1e-12)
    still = 9.81 * (2.0 * rod + 3.0 * ball)
    np.testing.assert_allclose(torques(arm, swing(), t, load, pace=0.0)[:, 0], still, atol=1e-12)
    slower = still + 0.25 * (by_hand - still)
    np.testing.assert_allclose(torques(arm, swing(), t, load, pace=0.5)[:, 0], slower, atol=1e-12)


def test_a_peak_inside_a_long_piece_is_found(tmp_path: Path) -> None:
    """A constant turn through the horizontal, at 1.47 s of 2.8 s: both ends need less."""
    none, turn = np.zeros(0), np.array([0.1, 1.0, 0.0, 0.0]).reshape(1, 4, 1)
    motion = JointTrajectory(("hinge",), np.array([0.0, 2.8]), turn, np.zeros(1), np.ones(1), none, np.zeros((0, 1)))
    found = find_torque(pendulum(tmp_path, INERTIAL), motion, Load(), np.ones(1))
    assert found.value == pytest.approx(9.81 * 2.0 * 0.4, rel=1e-4)
    assert found.t == pytest.approx(np.pi / 2 - 0.1, abs=0.02)


def test_a_joint_bears_what_follows_it(tmp_path: Path) -> None:
    """A second rod of the same kind mimics the first at twice its angle."""
    q, t = 0.2, np.zeros(1)
    arm = pendulum(tmp_path, INERTIAL)
    alone = torques(arm, swing(), t, Load())[0, 0]
    arm.robot.urdf.write_text(
        PENDULUM.format(inertial=INERTIAL).replace(
            "</robot>",
            f"""<link name="other">{INERTIAL}</link><joint name="second" type="continuous"><parent link="base"/>
            <child link="other"/><axis xyz="0 1 0"/></joint></robot>""",
        )
    )
    both = AuditArm(replace(arm.robot, mimic_joints=(MimicJoint("second", "hinge", 2.0, 0.0),)))
    inertia, qdd = 0.05 + 2.0 * 0.16, -3.0
    by_hand = 2.0 * (inertia * 2.0 * qdd + 9.81 * 2.0 * 0.4 * np.sin(2.0 * q))
    assert torques(both, swing(), t, Load())[0, 0] - alone == pytest.approx(by_hand, abs=1e-12)


@pytest.mark.parametrize(
    ("shape", "size", "about"),
    [
        ("sphere", (0.1,), (2e-3, 2e-3, 2e-3)),
        ("cylinder", (0.1, 0.3), (16.25e-3, 16.25e-3, 2.5e-3)),
        ("box", (0.1, 0.2, 0.3), (13e-3 / 0.6, 10e-3 / 0.6, 5e-3 / 0.6)),
    ],
)
def test_inertia_of_a_grasped_object(shape: str, size: tuple[float, ...], about: tuple[float, ...]) -> None:
    """2 kg: 2/5 m r^2 for a sphere; 1/2 m r^2 and m (3 r^2 + l^2) / 12 for a cylinder; m (a^2 + b^2) / 12 for a box."""
    assert np.diag(_inertia(GraspedObject(shape, size, 2.0)).inertia) == pytest.approx(about)


def test_a_link_without_mass_is_named(tmp_path: Path) -> None:
    one = np.ones(1)
    assert find_torque(pendulum(tmp_path, INERTIAL), swing(), Load(), one).weightless == ()
    assert find_torque(pendulum(tmp_path, ""), swing(), Load(), one).weightless == ("hinge",)


@pytest.mark.parametrize(
    ("inertia", "impossible"),
    [
        ('ixx="0.1" iyy="0.05" izz="0.151" ixy="0" ixz="0" iyz="0"', False),  # rounded
        ('ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"', False),  # a point
        ('ixx="0.1" iyy="0.05" izz="0.16" ixy="0" ixz="0" iyz="0"', True),
        ('ixx="0.1" iyy="0.1" izz="0.1" ixy="0.05" ixz="0" iyz="0"', False),
        ('ixx="0.1" iyy="0.1" izz="0.1" ixy="0.06" ixz="0" iyz="0"', True),
        ('ixx="-0.1" iyy="-0.1" izz="-0.1" ixy="0" ixz="0" iyz="0"', True),
        ('ixx="0.1" iyy="-0.05" izz="0.1" ixy="0" ixz="0" iyz="0"', True),
    ],
)
def test_an_inertia_that_no_body_has_is_found(tmp_path: Path, inertia: str, impossible: bool) -> None:
    one, inertial = np.ones(1), INERTIAL.partition("<inertia ")[0] + f"<inertia {inertia}/></inertial>"
    found = find_torque(pendulum(tmp_path, inertial), swing(), Load(), one).impossible
    assert found == (("rod",) if impossible else ())
    standing = pendulum(tmp_path, INERTIAL)
    urdf = standing.robot.urdf.read_text().replace('<link name="base"/>', f'<link name="base">{inertial}</link>')
    standing.robot.urdf.write_text(urdf)
    assert find_torque(AuditArm(standing.robot), swing(), Load(), one).impossible == ()


LIFT, POUR = slice(0, 4), slice(3, 7)
"""Keyframes of pouring on the way to which the torques are nearly as large as on the whole way."""


def planned(name: str, part: slice = LIFT, **options: float) -> Plan:
    robot, keyframes = arm_of(name).robot, keyframes_of("pouring")[part]
    return plan_keyframes(keyframes, not_none(robot.dock), robot, PlanOptions(**options))  # type: ignore[arg-type]


def mujoco_torques(robot: Robot, trajectory: JointTrajectory, t: Array, load: Load) -> Array:
    """Torques by mj_inverse, with the load as a link of the URDF."""
    import mujoco

    arm, samples, said = MujocoArm(robot, load), trajectory.at(t), []
    for q, qd, qdd, opening in zip(samples.q, samples.qd, samples.qdd, samples.gripper, strict=True):
        arm.data.qpos[arm.at], arm.data.qvel[arm.driven], arm.data.qacc[arm.driven] = q, qd, qdd
        arm.open_gripper(opening)
        mujoco.mj_inverse(arm.model, arm.data)
        said.append(arm.data.qfrc_inverse[arm.driven].copy())
    return np.array(said)


@pytest.mark.parametrize("name", KINDS)
def test_torques_agree_with_mujoco(name: str) -> None:
    """For an arm of each kind, with a load beside the tool's point."""
    robot, trajectory, load = arm_of(name).robot, planned(name).trajectory, Load(0.5, (0.03, -0.02, 0.05))
    t = np.linspace(0.0, trajectory.duration, 200)[:-1]
    ours, theirs = torques(AuditArm(robot), trajectory, t, load), mujoco_torques(robot, trajectory, t, load)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-9)


def test_an_object_weighs_only_while_it_is_held() -> None:
    """An object without size weighs the same as a payload at the tool's point."""
    arm, trajectory = AuditArm(arm_of("panda").robot), planned("panda", slice(None)).trajectory
    ((start, end),) = gripped_spans(trajectory.gripper_t, trajectory.gripper_opening)
    t = np.linspace(0.0, trajectory.duration, 300)
    held = (start <= t) & (t <= end)
    said = torques(arm, trajectory, t, Load(grasped=GraspedObject("sphere", (1e-9,), 1.5)))
    np.testing.assert_allclose(said[held], torques(arm, trajectory, t, Load(1.5))[held], atol=1e-6)
    np.testing.assert_array_equal(said[~held], torques(arm, trajectory, t, Load())[~held])


def test_near_the_limit_is_warned() -> None:
    with pytest.warns(PbdWarning, match=r"panda_joint2 needs .* carrying 3 kg: 97 % of its torque limit of 87 N m"):
        report = planned("panda", payload=3.0).report
    assert not_none(report.torque).share == pytest.approx(0.97, abs=0.01)
    bare = not_none(planned("panda").report.torque)
    assert bare.share == pytest.approx(0.66, abs=0.01)


def test_above_an_assumed_limit_is_warned_and_far_above_refused() -> None:
    with pytest.warns(PbdWarning, match=r"carrying 3.5 kg: 147 % of its assumed torque limit"):
        planned("xarm7", payload=3.5)
    with pytest.raises(PlanError, match=r"1000 kg: \d+ times its assumed torque limit .*; a lower speed does not help"):
        planned("xarm7", payload=1000.0)


def test_above_a_makers_limit_is_refused_with_the_speed_that_fits() -> None:
    with pytest.raises(
        PlanError, match=r"10\d\.\d % of its torque limit of 87 N m; carry less, or use --speed 0"
    ) as caught:
        planned("panda", payload=3.5)
    fields = caught.value.fields
    assert fields["joint"] == "panda_joint2"
    assert isinstance(fields["t"], float)
    speed = float(caught.value.message.rpartition(" ")[2])
    with (
        pytest.warns(PbdWarning, match="100 % of its torque limit"),
        pytest.warns(PbdWarning, match="the rated payload of panda is 3 kg, and it would carry 3.5 kg"),
    ):
        planned("panda", payload=3.5, speed=speed)
    with pytest.raises(PlanError):
        planned("panda", payload=3.5, speed=speed + 0.02)


def test_a_load_too_heavy_at_any_speed_is_refused() -> None:
    with pytest.raises(
        PlanError, match=r"shoulder_lift .* 19\d\.\d % of its torque limit .*; a lower speed does not help: carry less$"
    ):
        planned("so101", POUR, payload=1.0)


def test_no_dock_makes_a_slide_lighter() -> None:
    lift = Torque(3.0, "lift", 1.0, 60.0, 20.0, "N", (), ())
    one = np.ones(1)
    limits = JointLimits(-one, one, one, one, one, "a sheet")
    found = not_none(check_torque(lift, limits, Load(), PlanOptions(), lambda speed: 3.0))
    assert found.error.message.endswith("; a lower speed does not help: correct `effort` or the URDF's masses")


def test_a_load_above_the_rated_payload_is_warned_of_though_the_torques_are_low() -> None:
    rated = "the rated payload of ur5 is 5 kg, and it would carry {} kg: carry less, or ask its maker whether it may"
    with pytest.warns(PbdWarning, match=f"^{rated.format(8)}$"):
        report = planned("ur5", payload=8.0).report
    assert not_none(report.torque).share < 0.5
    with warnings.catch_warnings():
        warnings.simplefilter("error", PbdWarning)
        planned("ur5", payload=5.0)
    thing = GraspedObject("box", (0.1, 0.1, 0.1), 3.0)
    assert Load(2.5, grasped=thing).heaviest == 5.5
    assert Load(2.5, grasped=replace(thing, mass=None)).heaviest == 2.5


def test_without_torque_limits_a_payload_gives_a_warning() -> None:
    robot = arm_of("panda").robot
    robot = replace(robot, limits=replace(robot.limits, effort=None))
    with pytest.warns(PbdWarning, match="torques are not checked despite 2 kg"):
        plan = plan_keyframes(keyframes_of("pouring")[LIFT], not_none(robot.dock), robot, PlanOptions(payload=2.0))
    assert plan.report.torque is None


def test_the_commands_take_the_mass_of_the_object_and_the_payload(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo, bundled = tmp_path / "heavy", FOLDER.parent / "demos" / "pouring"
    demo.mkdir()
    for file in bundled.iterdir():
        text = file.read_text(encoding="utf-8").replace("size = [0.06, 0.2]", "size = [0.06, 0.2]\nmass_kg = 1.0")
        (demo / file.name).write_text(text, encoding="utf-8")
    assert main(["replay", str(demo), "--robot", "ur5", "--json", "--payload", "0.5", "0", "0", "-0.05"]) == 0
    out, err = capsys.readouterr()
    assert "carrying 0.5 kg and a cylinder of 1 kg" in err
    assert json.loads(out)["limits"]["torque"] == pytest.approx(0.19, abs=0.04)
    assert main(["replay", "--robot", "ur5", "--payload", "1", "2"]) == 2
