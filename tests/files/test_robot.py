import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pbd.arm.collision.shape_coverage import doubtful_shapes
from pbd.arm.model import load_model
from pbd.errors import PbdWarning, RobotError
from pbd.files.robot import read_robot
from pbd.files.urdf_tree import read_named_poses, read_urdf
from pbd.io.urdf import collision_shapes, read_shapes
from tests.not_none import not_none

PANDA = Path(__file__).parents[2] / "robots" / "panda.toml"


def test_panda_has_the_limits_of_its_data_sheet() -> None:
    robot = read_robot(PANDA)
    assert robot.name == "panda"
    assert robot.joints == tuple(f"panda_joint{i}" for i in range(1, 8))
    assert (robot.base, robot.body) == ("panda_link0", "panda_hand_tcp")
    limits = robot.limits
    # Franka's "Robot and interface specifications", limits for Panda
    np.testing.assert_array_equal(limits.upper, [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
    np.testing.assert_array_equal(limits.lower, [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
    np.testing.assert_array_equal(limits.velocity, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_array_equal(limits.acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_array_equal(limits.jerk, [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    assert "frankaemika.github.io" in limits.source
    assert robot.urdf.is_file()
    assert not_none(robot.srdf).is_file()
    np.testing.assert_array_equal(not_none(robot.gripper).open, [0.04, 0.04])
    assert robot.dock is not None
    assert robot.dock.name == "panda"
    assert robot.dock.robots == ("panda",)
    np.testing.assert_array_equal(not_none(robot.dock.T_base_dock).wxyz, [1, 0, 0, 0])
    # package:// in the URDF is found in package_dirs
    mesh = "example-robot-data/robots/panda_description/meshes/visual/link0.dae"
    assert any((folder / mesh).is_file() for folder in robot.package_dirs)


def test_loading_imports_no_robot_library() -> None:
    code = "import sys; from pathlib import Path; from pbd.files.robot import read_robot; read_robot(Path(sys.argv[1]))"
    heavy = "{'pinocchio', 'scipy', 'ruckig', 'meshcat', 'tomlkit'} & set(sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", f"{code}; print({heavy})", str(PANDA)], capture_output=True, text=True, check=True
    )
    assert run.stdout == "set()\n"


# --- a user's robot ---------------------------------------------------------------------------------------------------

TOML = """\
format = 1
name = "mine"
description = "two joints and a claw"

[model]
urdf = "mine.urdf"
base = "foot"
body = "hand"
T_body_tool = { xyz = [0.0, 0.0, 0.1], rpy_deg = [0.0, 0.0, 90.0] }

[arm]
home = [0.1, 0.2]

[gripper]
joints = ["claw"]
open = [0.5]
closed = [0.0]
stroke_s = 0.4

[limits]
source = "measured"
acceleration = [5.0, 6.0]
jerk = [100, 200]

[dock]
position = [0.3, 0.0, 0.2]
rpy_deg = [0.0, 0.0, 30.0]
"""

URDF = """<?xml version="1.0"?>
<robot name="mine">
  <link name="foot"/> <link name="upper"/> <link name="mid"/> <link name="hand"/> <link name="finger"/>
  <joint name="shoulder" type="revolute">
    <parent link="foot"/> <child link="upper"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="-2" upper="2" velocity="1.5"/>
  </joint>
  <joint name="mount" type="fixed"> <parent link="upper"/> <child link="mid"/> </joint>
  <joint name="elbow" type="continuous">
    <parent link="mid"/> <child link="hand"/> <axis xyz="0 1 0"/> <limit effort="1" velocity="2.5"/>
  </joint>
  <joint name="claw" type="revolute">
    <parent link="hand"/> <child link="finger"/> <axis xyz="1 0 0"/>
    <limit effort="1" lower="0" upper="0.5" velocity="3"/>
  </joint>
</robot>
"""

SRDF = """<robot name="mine">
  <group_state name="rest" group="arm"> <joint name="shoulder" value="0.5"/> <joint name="elbow" value="-1"/>
  </group_state>
  <group_state name="half" group="arm"> <joint name="shoulder" value="0.5"/> </group_state>
</robot>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.toml").write_text(TOML, encoding="utf-8")
    (tmp_path / "mine.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "mine.srdf").write_text(SRDF, encoding="utf-8")
    return tmp_path


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_a_users_own_urdf(folder: Path) -> None:
    robot = read_robot(folder / "mine.toml")
    assert robot.joints == ("shoulder", "elbow")
    assert robot.urdf == folder.resolve() / "mine.urdf"
    np.testing.assert_array_equal(robot.limits.velocity, [1.5, 2.5])  # the URDF's
    np.testing.assert_array_equal(robot.limits.lower, [-2, -np.inf])
    np.testing.assert_array_equal(robot.limits.upper, [2, np.inf])
    np.testing.assert_array_equal(robot.home, [0.1, 0.2])
    np.testing.assert_allclose(robot.T_body_tool.act([1, 0, 0]), [0, 1, 0.1], atol=1e-15)
    assert folder.resolve() in robot.package_dirs
    assert robot.dock is not None
    assert robot.dock.scale == 1.0
    assert robot.dock.table_height is None
    assert robot.dock.any_attitude is False


def test_optional_keys(folder: Path) -> None:
    toml = folder / "mine.toml"
    change(toml, TOML[TOML.index("[gripper]") : TOML.index("[limits]")], "")
    change(toml, TOML[TOML.index("[dock]") :], "")
    change(toml, "home = [0.1, 0.2]", 'joints = ["elbow"]\nhome_pose = "rest"')
    change(toml, 'urdf = "mine.urdf"', 'urdf = "mine.urdf"\nsrdf = "mine.srdf"')
    change(toml, "acceleration = [5.0, 6.0]\njerk = [100, 200]", "velocity = [1]\nacceleration = [5.0]\njerk = [100]")
    robot = read_robot(toml)
    assert robot.joints == ("elbow",)
    assert robot.gripper is None
    assert robot.dock is None
    np.testing.assert_array_equal(robot.home, [-1])
    np.testing.assert_array_equal(robot.limits.velocity, [1])


def test_the_docks_options(folder: Path) -> None:
    with (folder / "mine.toml").open("a", encoding="utf-8") as file:
        file.write("scale = 0.5\ntable_height = -0.02\nany_attitude = true\n")
    dock = not_none(read_robot(folder / "mine.toml").dock)
    assert (dock.scale, dock.table_height, dock.any_attitude) == (0.5, -0.02, True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "mine"', 'name = "../mine"', ":2: name must have no slash: files are named after it; correct it"),
        ("jerk = [100, 200]", "jerk = [100, 200]\njrek = 1",
         ":24: [limits] jrek is unknown; the keys here are source, velocity, acceleration, acceleration_source, jerk,"
         " jerk_source, effort, payload_kg; remove or rename it"),
        ("acceleration = [5.0, 6.0]", "velocity = [1.5, 2.6]\nacceleration = [5.0, 6.0]",
         ":22: [limits] velocity gives elbow 2.6, above the URDF's own 2.5; lower it, or correct the URDF"),
        ('source = "measured"\n', "", ": [limits] source is missing; add it"),
        ('source = "measured"', 'jerk_source = "measured"', ": [limits] source is missing; add it"),
        ("jerk = [100, 200]", "jerk = [100, 0]",
         ":23: [limits] jerk must hold only numbers above zero, got [100, 0]; correct it"),
        ("home = [0.1, 0.2]", "home = [2.1, 0.2]", ":12: [arm] home puts shoulder at 2.1, outside -2..2; correct it"),
        ("home = [0.1, 0.2]", "home = [0.1]",
         ":12: [arm] home must have 2 numbers (shoulder, elbow), got 1; correct it"),
        ("home = [0.1, 0.2]", 'home_pose = "rest"',
         ":12: [arm] home_pose names 'rest', which is not in the SRDF; its poses are (none); correct it"),
        ("home = [0.1, 0.2]", 'home = [0, 0]\nhome_pose = "rest"',
         ":13: [arm] home_pose is given together with home; remove one of them"),
        ("home = [0.1, 0.2]", 'joints = ["elbow", "shoulder"]\nhome = [0.1, 0.2]',
         ":12: [arm] joints must be some of shoulder, elbow, in that order (base to tool), got elbow, shoulder;"
         " correct it"),
        ('joints = ["claw"]', 'joints = ["mount"]',
         ":15: [gripper] joints names 'mount', which is not a movable joint; the URDF has shoulder, elbow, claw;"
         " correct it"),
        ("open = [0.5]", "open = [0.6]", ":16: [gripper] open puts claw at 0.6, outside 0..0.5; correct it"),
        ("stroke_s = 0.4", "stroke_s = 0", ":18: [gripper] stroke_s must be above zero, got 0; correct it"),
        ('base = "foot"', 'base = "feet"',
         "mine.urdf has no link 'feet'; set base to one of foot, upper, mid, hand, finger"),
        ('body = "hand"', 'body = "glove"',
         "mine.urdf has no link 'glove'; set body to one of foot, upper, mid, hand, finger"),
        ('base = "foot"', 'base = "hand"',
         "mine.urdf: no joint moves between 'hand' and 'hand'; choose another base or body"),
        ('base = "foot"', 'base = "finger"',
         "mine.urdf: no joints lead from 'finger' to 'hand'; choose another base"),
        ("[limits]\n", "limits = 3\n[limts]\n", ": limits is missing (there is 'limts'); add it"),
        ("rpy_deg = [0.0, 0.0, 30.0]", "rpy_deg = [0, 0, 0]\nscale = -1",
         ":28: [dock] scale must be above zero, got -1; correct it"),
        ("[arm]\nhome = [0.1, 0.2]", "", "mine.toml` proposes it"),
        ('["claw"]\nopen = [0.5]\nclosed = [0.0]', '["claw", "claw"]\nopen = [0.5, 0.5]\nclosed = [0.0, 0.0]',
         ":15: [gripper] joints names 'claw' twice; correct it"),
    ],
)  # fmt: skip
def test_a_fault_in_the_toml_is_named_in_one_line(folder: Path, old: str, new: str, message: str) -> None:
    change(folder / "mine.toml", old, new)
    with pytest.raises(RobotError) as caught:
        read_robot(folder / "mine.toml")
    assert caught.value.message.endswith(message)
    assert caught.value.message.startswith(str(folder.resolve() / "mine."))
    assert "\n" not in caught.value.message


def test_a_missing_urdf_is_named_with_the_folders(folder: Path) -> None:
    change(folder / "mine.toml", 'urdf = "mine.urdf"', 'urdf = "yours.urdf"')
    expected = rf":6: \[model\] urdf names 'yours.urdf', which is neither in {folder} nor in .*robots; correct it"
    with pytest.raises(RobotError, match=expected):
        read_robot(folder / "mine.toml")


def test_a_pose_that_leaves_a_joint_out(folder: Path) -> None:
    change(folder / "mine.toml", 'urdf = "mine.urdf"', 'urdf = "mine.urdf"\nsrdf = "mine.srdf"')
    change(folder / "mine.toml", "home = [0.1, 0.2]", 'home_pose = "half"')
    with pytest.raises(RobotError, match=r"home_pose 'half' says nothing of elbow; give home as a list instead"):
        read_robot(folder / "mine.toml")
    change(folder / "mine.toml", '"half"', '"full"')
    with pytest.raises(RobotError, match=r"which is not in the SRDF; its poses are rest, half; correct it"):
        read_robot(folder / "mine.toml")


def test_each_limit_may_have_its_own_source(folder: Path) -> None:
    limits = read_robot(folder / "mine.toml").limits
    assert dict(limits.sources) == {
        "position": "the URDF", "velocity": "the URDF", "acceleration": "measured", "jerk": "measured"
    }  # fmt: skip
    assert limits.source == "velocity: the URDF; acceleration: measured; jerk: measured"
    assert limits.assumed == ()
    change(folder / "mine.toml", "jerk = [100, 200]", 'jerk = [100, 200]\njerk_source = "assumed: slow"')
    limits = read_robot(folder / "mine.toml").limits
    assert limits.sources["acceleration"] == "measured"
    assert limits.sources["jerk"] == "assumed: slow"
    assert limits.assumed == ("jerk",)
    assert limits.effort is None  # the URDF's is not used
    change(folder / "mine.toml", 'source = "measured"', 'velocity = [1, 2]\nsource = "sheet"')
    assert read_robot(folder / "mine.toml").limits.source == "velocity: sheet; acceleration: sheet; jerk: assumed: slow"
    change(folder / "mine.toml", '\njerk_source = "assumed: slow"', "")
    assert read_robot(folder / "mine.toml").limits.source == "sheet"
    change(
        folder / "mine.toml", "jerk = [100, 200]", 'jerk = [100, 200]\neffort = [5, 6]\neffort_source = "assumed: weak"'
    )
    limits = read_robot(folder / "mine.toml").limits
    assert not_none(limits.effort).tolist() == [5.0, 6.0]
    assert limits.assumed == ("effort",)


def test_a_velocity_of_zero_in_the_urdf_means_unknown(folder: Path) -> None:
    change(folder / "mine.urdf", 'velocity="1.5"', 'velocity="0"')
    change(folder / "mine.toml", "acceleration = [5.0, 6.0]", "velocity = [7, 2]\nacceleration = [5.0, 6.0]")
    change(folder / "mine.urdf", 'velocity="3"', 'velocity="0"')  # the gripper's
    np.testing.assert_array_equal(read_robot(folder / "mine.toml").limits.velocity, [7, 2])


def test_a_gripper_whose_model_has_no_joints(folder: Path) -> None:
    change(
        folder / "mine.toml", 'joints = ["claw"]\nopen = [0.5]\nclosed = [0.0]', "joints = []\nopen = []\nclosed = []"
    )
    gripper = not_none(read_robot(folder / "mine.toml").gripper)
    assert gripper.joints == ()
    assert gripper.stroke_s == 0.4


FOLLOWER = """
  <link name="thumb"/> <joint name="thumb_joint" type="revolute"> <parent link="hand"/> <child link="thumb"/>
  <axis xyz="1 0 0"/> <limit effort="1" lower="-2" upper="2" velocity="3"/>
  <mimic joint="claw" multiplier="-2" offset="0.1"/> </joint>
</robot>"""


def test_a_finger_that_mimics_another_belongs_to_the_gripper(folder: Path) -> None:
    change(folder / "mine.urdf", "</robot>", FOLLOWER)
    gripper = not_none(read_robot(folder / "mine.toml").gripper)
    assert gripper.joints == ("claw", "thumb_joint")
    assert gripper.mimics == ("thumb_joint",)
    np.testing.assert_allclose(gripper.open, [0.5, -0.9])
    np.testing.assert_allclose(gripper.closed, [0.0, 0.1])


def test_a_joint_that_mimics_an_arms_joint_through_another_follows_it(folder: Path) -> None:
    """As the rods of a parallel linkage do. The one that is listed first follows the one that is listed last."""
    rod = """<link name="{0}"/><joint name="{0}" type="revolute"><parent link="foot"/><child link="{0}"/>
    <axis xyz="0 0 1"/><limit effort="1" lower="-9" upper="9" velocity="3"/>
    <mimic joint="{1}" multiplier="{2}" offset="{3}"/></joint>"""
    rods = rod.format("outer", "inner", -2, 0.5) + rod.format("inner", "elbow", 3, 0.1)
    loop = rod.format("head", "tail", 1, 0) + rod.format("tail", "head", 1, 0)
    change(folder / "mine.urdf", "</robot>", f"{rods}{loop}</robot>")
    outer, inner = read_robot(folder / "mine.toml").mimic_joints
    assert (inner.joint, inner.leader, inner.multiplier, inner.offset) == ("inner", "elbow", 3.0, 0.1)
    assert (outer.joint, outer.leader, outer.multiplier, outer.offset) == ("outer", "elbow", -6.0, 0.5 - 0.2)


LIMIT_OF_THUMB = 'lower="-2" upper="2" velocity="3"/>\n  '


def test_a_joint_that_slides_with_an_endless_one_needs_limits(folder: Path) -> None:
    """Without them, how far its link moves is unknown, and its contacts were missed."""
    slide = FOLLOWER.replace('joint="claw"', 'joint="elbow"').replace("revolute", "prismatic")
    change(folder / "mine.urdf", "</robot>", slide)
    limits = read_robot(folder / "mine.toml").limits
    np.testing.assert_allclose((limits.lower[1], limits.upper[1]), (-0.95, 1.05))
    change(folder / "mine.urdf", LIMIT_OF_THUMB, LIMIT_OF_THUMB.replace('"-2" upper="2"', '"0" upper="0"'))
    with pytest.raises(RobotError, match=r"joint 'elbow' has no room to move: lower 0.05, upper 0.05; correct its <li"):
        read_robot(folder / "mine.toml")


def test_a_rail_without_end_is_as_long_as_a_urdf_may_be(folder: Path) -> None:
    change(folder / "mine.urdf", 'name="shoulder" type="revolute"', 'name="shoulder" type="prismatic"')
    change(folder / "mine.urdf", 'lower="-2" upper="2"', 'lower="-1e16" upper="1e16"')
    with pytest.warns(PbdWarning, match=r"limits of many metres: shoulder -100..100 m; if these are mm, correct"):
        limits = read_robot(folder / "mine.toml").limits
    assert (limits.lower[0], limits.upper[0]) == (-100.0, 100.0)


def test_a_joint_keeps_to_its_soft_limits_and_to_what_mimics_it(folder: Path) -> None:
    soft = '<safety_controller k_velocity="9" soft_lower_limit="-1.5" soft_upper_limit="9"/>'
    change(folder / "mine.urdf", 'velocity="1.5"/>', f'velocity="1.5"/> {soft}')
    limits = read_robot(folder / "mine.toml").limits
    assert (limits.lower[0], limits.upper[0], limits.velocity[0]) == (-1.5, 2.0, 1.5)
    rod = FOLLOWER.replace('joint="claw"', 'joint="shoulder"')  # from -2 to 2 at 3: -2 times the shoulder + 0.1
    change(folder / "mine.urdf", "</robot>", rod.replace('velocity="3"', 'velocity="2"'))
    limits = read_robot(folder / "mine.toml").limits
    np.testing.assert_allclose((limits.lower[0], limits.upper[0], limits.velocity[0]), (-0.95, 1.05, 1.0))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('multiplier="-2"', 'multiplier="0"'),
        ('lower="-2" upper="2" velocity="3"', 'lower="1" upper="1" velocity="0"'),  # placeholders
    ],
)
def test_a_joint_that_mimics_without_limits_of_its_own_narrows_nothing(folder: Path, old: str, new: str) -> None:
    rod = FOLLOWER.replace('joint="claw"', 'joint="shoulder"')
    assert old in rod
    change(folder / "mine.urdf", "</robot>", rod.replace(old, new))
    limits = read_robot(folder / "mine.toml").limits
    assert (limits.lower[0], limits.upper[0], limits.velocity[0]) == (-2.0, 2.0, 1.5)


@pytest.mark.parametrize(
    ("urdf", "toml", "message"),
    [
        (('mimic joint="claw"', 'mimic joint="claws"'), None,
         r"mine.urdf: joint 'thumb_joint' mimics 'claws', which is not a joint of it; correct or remove its <mimic>"),
        ((LIMIT_OF_THUMB, LIMIT_OF_THUMB.replace("-2", "-0.8")), None,
         r":16: \[gripper\] open puts thumb_joint at -0.9, outside -0.8..2; correct it, or the joint's <limit> or its "
         "<mimic> of claw"),
        (None, ("stroke_s = 0.4", "stroke_s = 0.3"),
         r":18: \[gripper\] stroke_s moves thumb_joint at 3.33333, above the URDF's own 3; make it longer"),
        (None, ('"claw"]\nopen = [0.5]', '"thumb_joint"]\nopen = [0.5]'),
         r":15: \[gripper\] joints names 'thumb_joint', which mimics 'claw'; name 'claw' instead"),
        (None, ('"claw"]\nopen = [0.5]\nclosed = [', '"claw", "thumb_joint"]\nopen = [0.5, 0.9]\nclosed = [0.1, '),
         r":16: \[gripper\] open puts thumb_joint at 0.9, but it mimics claw, which puts it at -0.9; correct it"),
        (None, ('body = "hand"', 'body = "finger"'),
         r":15: \[gripper\] joints names 'claw', which moves the tool's body; set body to a link before that joint"),
    ],
)  # fmt: skip
def test_a_gripper_that_cannot_move_so_is_refused(
    folder: Path, urdf: tuple[str, str] | None, toml: tuple[str, str] | None, message: str
) -> None:
    change(folder / "mine.urdf", "</robot>", FOLLOWER)
    read_robot(folder / "mine.toml")
    for name, edit in (("mine.urdf", urdf), ("mine.toml", toml)):
        if edit is not None:
            change(folder / name, *edit)
    with pytest.raises(RobotError, match=message):
        read_robot(folder / "mine.toml")


def test_joints_that_nothing_moves_and_that_cannot_stand_at_zero_are_named(folder: Path) -> None:
    change(folder / "mine.toml", '["claw"]\nopen = [0.5]\nclosed = [0.0]', "[]\nopen = []\nclosed = []")
    change(folder / "mine.urdf", "</robot>", FOLLOWER.replace('offset="0.1"', ""))
    read_robot(folder / "mine.toml")
    change(folder / "mine.urdf", 'multiplier="-2"', 'multiplier="-2" offset="0.1"')
    change(folder / "mine.urdf", 'lower="0" upper="0.5"', 'lower="0.1" upper="0.5"')
    named = r"wrong for claw \(0.1..0.5\), thumb_joint \(mimics claw, which puts it at 0.1\); make each a fixed joint"
    with pytest.warns(PbdWarning, match=named):
        read_robot(folder / "mine.toml")


INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
MESH = '<link name="hand"><visual><geometry><mesh filename="ADDRESS"/></geometry></visual></link>'


@pytest.mark.parametrize(
    "address",
    [
        "package://mine/meshes/hand.stl",
        "package:///mine/meshes/hand.stl",
        "model://mine/meshes/hand.stl",
        "meshes/hand.stl",
    ],
)
def test_a_missing_mesh_is_named_with_its_link(folder: Path, address: str) -> None:
    change(folder / "mine.urdf", '<link name="hand"/>', MESH.replace("ADDRESS", address))
    with pytest.raises(RobotError) as caught:
        read_robot(folder / "mine.toml")
    message = caught.value.message
    assert message.startswith(
        f"{folder.resolve() / 'mine.urdf'}: the mesh '{address}' of link 'hand' is missing: there is"
    )
    assert message.endswith("hand.stl; put it there, or correct its address")
    assert "\n" not in message
    places = message.partition("there is no ")[2].partition(";")[0].split(", nor ")
    assert len(set(places)) == len(places)
    place = folder / ("meshes" if address.startswith("meshes") else "mine/meshes")
    place.mkdir(parents=True)
    (place / "hand.stl").write_bytes(b"")
    assert read_robot(folder / "mine.toml").body == "hand"


def test_a_link_without_its_visual_mesh_is_drawn_by_its_collision_shapes(folder: Path) -> None:
    """Nothing else needs the mesh. Where it is the link's only shape, collision checks do."""
    ball = '<collision><origin xyz="0 0 1"/><geometry><sphere radius="0.1"/></geometry></collision>'
    mesh = MESH.replace("ADDRESS", "hand.stl")
    change(folder / "mine.urdf", '<link name="hand"/>', mesh.replace("</link>", f"{ball}</link>"))
    said = r"mine.urdf: visual meshes are missing: hand.stl; their links are drawn by their collision shapes; put them"
    with pytest.warns(PbdWarning, match=said) as warned:
        robot = read_robot(folder / "mine.toml")
    assert len(warned) == 1
    shapes = read_shapes(robot)
    assert [(each.element, each.kind) for each in shapes] == [("visual", "sphere"), ("collision", "sphere")]
    assert [each.T_link_shape.p[2] for each in shapes] == [1.0, 1.0]
    assert len(collision_shapes(robot)) == 1
    assert "hand" not in doubtful_shapes(load_model(robot))
    change(folder / "mine.urdf", '<sphere radius="0.1"/>', '<mesh filename="ball.stl"/>')
    with pytest.raises(RobotError, match=r"the mesh 'ball.stl' of link 'hand' is missing"):
        read_robot(folder / "mine.toml")


def test_an_unnamed_joint_is_locked_at_zero_which_must_be_within_its_limits(folder: Path) -> None:
    change(folder / "mine.urdf", 'lower="-2"', 'lower="0.1"')
    change(folder / "mine.toml", "home = [0.1, 0.2]", 'joints = ["elbow"]\nhome = [0.2]')
    with pytest.raises(
        RobotError, match=r":12: \[arm\] joints leaves out shoulder, which is then locked at 0, outside"
    ):
        read_robot(folder / "mine.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('upper="2"', 'upper="-2"',
         r"mine.urdf: joint 'shoulder' has no room to move: lower -2, upper -2; correct its <limit> or"),
        (' lower="-2" upper="2"', "", r"mine.urdf: joint 'shoulder' has no room to move: lower 0, upper 0; correct"),
        ('name="shoulder" type="revolute"', 'name="shoulder" type="revolut"',
         r"mine.urdf: joint 'shoulder' has the type 'revolut'; make it one of revolute, continuous, .*, planar$"),
        ('name="mount" type="fixed"', 'name="mount" type="floating"',
         r"mine.urdf: joint 'mount', between 'foot' and 'hand', is floating, which pbd does not support in an arm"),
        ('<axis xyz="0 1 0"/>', '<mimic joint="shoulder"/>',
         r"mine.urdf: joint 'elbow', between 'foot' and 'hand', mimics 'shoulder', which pbd does not support"),
        ('<joint name="claw"', '<joint name="elbow"', r"mine.urdf: two joints are named 'elbow'; rename one of them"),
        ('<joint name="claw"', '<joint name="universe"', r"mine.urdf: a link or joint is named 'universe', .*; rename"),
        ('<link name="mid"/>', "",
         r"mine.urdf: joint 'mount' joins 'mid', which is not a link of it; correct it, or add the link$"),
        ('<link name="mid"/>', '<link name="mid"/><link name="mid"/>', r"mine.urdf: two links are named 'mid'; rename"),
        ('<link name="mid"/>', '<link name="mid"/><link name="loose"/>',
         r"mine.urdf: several root links: foot, loose; connect all but one$"),
        ('<child link="finger"/>', '<child link="hand"/>', r"mine.urdf: link 'hand' is the child of two joints; keep"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', r"mine.urdf: joint 'elbow' has no axis to move about; give it"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 y 0"/>',
         r"mine.urdf: xyz = '0 y 0' in the <axis> of joint 'elbow' is not three numbers; correct it"),
        ('<axis xyz="0 1 0"/>', '<origin xyz="0 1" rpy="0 0 0"/>',
         r"mine.urdf: xyz = '0 1' in the <origin> of joint 'elbow' is not three numbers; correct it"),
        ('velocity="1.5"', 'velocity="1e-320"',
         r"\[limits\] velocity is missing and the URDF sets no limit above zero for shoulder; add it"),
        ('velocity="1.5"', 'velocity="0"',
         r"\[limits\] velocity is missing and the URDF sets no limit above zero for shoulder; add it"),
        (' velocity="2.5"', "", r"\[limits\] velocity is missing and .* for elbow; add it"),
        ('lower="-2"', 'lower="minus two"', r"lower = 'minus two' in the <limit> of joint 'shoulder' is not a number"),
        ('velocity="1.5"', 'velocity="-1.5"',
         r"velocity = '-1.5' in the <limit> of joint 'shoulder' is smaller than 0; correct it"),
        ('effort="1" lower="-2"', 'effort="-1" lower="-2"', r"effort = '-1' in the .* of joint 'shoulder' is smaller"),
        ('lower="-2"', 'lower="inf"', r"lower = 'inf' in the <limit> of joint 'shoulder' is not a number; correct"),
        ('<parent link="foot"/>', "", r"mine.urdf: joint 'shoulder' has no <parent>; add it"),
        ("</robot>", '<xacro:hand xmlns:xacro="http://www.ros.org/wiki/xacro"/></robot>',
         r"mine.urdf: <xacro:hand> is not expanded; run `xacro mine.urdf > arm.urdf`, and give arm.urdf"),
        ('xyz="0 1 0"', 'xyz="0 ${l} 0"', r"mine.urdf: 0 \$\{l\} 0 is not expanded; run `xacro mine.urdf > arm.urdf`"),
        ('<joint name="claw"', "<joint", r"mine.urdf: a <joint> has no name; add it"),
        ("</robot>", "", r"mine.urdf: not valid XML: .*; correct it"),
        ('<link name="hand"/>', f'<link name="hand"><inertial><mass value="-1"/>{INERTIA}</inertial></link>',
         r"mine.urdf: value = '-1' in the <mass> of link 'hand' is smaller than 0; correct it"),
        ("robot", "sdf", r"mine.urdf is not a URDF: its root is <sdf>; give a file whose root is <robot>"),
    ],
)  # fmt: skip
def test_a_fault_in_the_urdf_is_named(folder: Path, old: str, new: str, message: str) -> None:
    change(folder / "mine.urdf", old, new)
    with pytest.raises(RobotError, match=message) as caught:
        read_robot(folder / "mine.toml")
    assert "\n" not in caught.value.message


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_doctype_is_refused_before_its_entities_expand(folder: Path, encoding: str) -> None:
    laughs = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    bomb = f'<!DOCTYPE robot [<!ENTITY l0 "ha">{laughs}]><robot name="&l11;"/>'
    (folder / "mine.urdf").write_text(bomb, encoding=encoding)
    with pytest.raises(RobotError, match=r"not valid XML: a DOCTYPE \(robot\) is not allowed; correct it"):
        read_urdf(folder / "mine.urdf")


def test_limits_in_degrees_are_doubted(folder: Path) -> None:
    change(folder / "mine.urdf", 'lower="-2" upper="2"', 'lower="-170" upper="170"')
    with pytest.warns(PbdWarning, match=r"limits of many turns: shoulder -170..170 rad; if these are degrees, correct"):
        read_robot(folder / "mine.toml")


def test_an_arm_in_mm_is_refused(folder: Path) -> None:
    change(folder / "mine.urdf", '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/> <origin xyz="0 0 90"/>')
    with pytest.raises(
        RobotError, match=r"origin> of joint 'elbow' has 90 m, beyond any arm's reach; give metres, not"
    ):
        read_robot(folder / "mine.toml")


def test_prefixes_need_not_be_declared(folder: Path) -> None:
    """Many URDFs in use have tags and attributes of Drake or Gazebo with undeclared prefixes; urdfdom reads them."""
    change(folder / "mine.urdf", 'velocity="1.5"', 'velocity="1.5" drake:acceleration="9"')
    change(folder / "mine.urdf", "</robot>", '<gazebo><sensor:camera name="eye"/></gazebo></robot>')
    robot = read_robot(folder / "mine.toml")
    assert robot.limits.velocity[0] == 1.5
    assert load_model(robot).model.nv == 2


def test_a_fixed_joint_mimics_nothing(folder: Path) -> None:
    change(folder / "mine.urdf", "</robot>", FOLLOWER.replace('type="revolute"', 'type="fixed"'))
    robot = read_robot(folder / "mine.toml")
    assert not_none(robot.gripper).joints == ("claw",)
    assert load_model(robot).links


def test_a_loop_of_joints_is_refused(folder: Path) -> None:
    change(folder / "mine.urdf", '<parent link="foot"/>', '<parent link="hand"/>')
    with pytest.raises(RobotError, match=r"the joints form a loop of links: .*hand.*; remove one joint"):
        read_urdf(folder / "mine.urdf").chain("foot", "hand")


def test_poses_of_an_srdf(folder: Path) -> None:
    poses = {"rest": {"shoulder": 0.5, "elbow": -1.0}, "half": {"shoulder": 0.5}}
    assert read_named_poses(folder / "mine.srdf") == poses
    change(
        folder / "mine.srdf",
        "</robot>",
        """<group_state name="stand"><joint name="elbow" value="-1"/>
           <joint name="free" value="0 0 1 0 0 0 1"/></group_state></robot>""",
    )  # a floating base has seven numbers
    assert read_named_poses(folder / "mine.srdf") == {**poses, "stand": {"elbow": -1.0}}


# --- files that would break the libraries -----------------------------------------------------------------------------


def test_a_misspelt_link_is_named_with_its_line_and_the_most_similar_links(folder: Path) -> None:
    change(folder / "mine.toml", 'base = "foot"', 'base = "foto"')
    text = (folder / "mine.urdf").read_text(encoding="utf-8")
    links = "".join(f'<link name="w{k}"/>' for k in range(60))
    joints = "".join(
        f'<joint name="j{k}" type="fixed"><parent link="foot"/><child link="w{k}"/></joint>' for k in range(60)
    )
    (folder / "mine.urdf").write_text(text.replace("</robot>", f"{links}{joints}</robot>"), encoding="utf-8")
    with pytest.raises(RobotError) as caught:
        read_robot(folder / "mine.toml")
    where = f"{folder / 'mine.toml'}:{caught.value.fields['line']}: [model] base is wrong"
    assert caught.value.message == f"{where}: {folder / 'mine.urdf'} has no link 'foto'; set base to one of foot"


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "mine.toml",
            'urdf = "mine.urdf"',
            'urdf = "~nouser/mine.urdf"',
            r"mine\.toml:\d+: \[model\] urdf names '~nouser/",
        ),
        ("mine.toml", "rpy_deg = [0.0, 0.0, 90.0]", "rpy_deg = [0.0, 0.0, 1e300]", r"rpy_deg must .* from -360 to 360"),
        ("mine.srdf", "</robot>", "", r"mine\.srdf: not valid XML: "),
        ("mine.srdf", '"-1"', '"up"', r"mine\.srdf: value = 'up' of a <joint> is not a number; correct it"),
        ("mine.toml", "[arm]", '[arm]\nmay_touch = [["foot", "fot"]]', r"may_touch names 'fot', which is no link of "),
        ("mine.toml", "[arm]", '[arm]\nmay_touch = ["foot"]', r"may_touch must be a list of pairs of strings, got "),
    ],
)
def test_a_fault_in_any_file_is_named(folder: Path, file: str, old: str, new: str, message: str) -> None:
    change(folder / "mine.toml", "[arm]", 'srdf = "mine.srdf"\n[arm]') if file == "mine.srdf" else None
    change(folder / file, old, new)
    with pytest.raises(RobotError, match=message):
        read_robot(folder / "mine.toml")


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (
            '<mesh filename="a.stl" scale="nan 1 1"/>',
            "scale = 'nan 1 1' in the <mesh> of link 'hand' is not three numbers",
        ),
        (
            '<mesh filename="a.stl" scale="0 1 1"/>',
            "scale = '0 1 1' in the <mesh> of link 'hand' is smaller than 1e-06",
        ),
        ('<sphere radius="-0.1"/>', "radius = '-0.1' in the <sphere> of link 'hand' is smaller than 1e-06"),
        ('<box size="1 1 1e9"/>', "size = '1 1 1e9' in the <box> of link 'hand' is larger than 100 m; "),
        ('<cylinder radius="0.1"/>', "a <cylinder> of link 'hand' has no length"),
        ("<box/>", "a <box> of link 'hand' has no size"),
        ('<mesh scale="1 1 1"/>', "a <mesh> of link 'hand' has no filename; correct it"),
        (
            '<sphere radius="1"/></geometry></collision><visual><origin xyz="a b c"/><geometry><sphere radius="1"/>'
            "</geometry></visual><collision><geometry>",
            "xyz = 'a b c' in the <origin> of link 'hand' is not three numbers",
        ),
        (
            '<sphere radius="1"/></geometry></collision><inertial><mass value="1"/></inertial><collision><geometry>',
            "the <inertial> of link 'hand' lacks its <mass> or <inertia>",
        ),
        (
            '<sphere radius="1"/></geometry></collision><inertial><mass value="1"/><inertia ixx="1"/></inertial>'
            "<collision><geometry>",
            "<inertia> of link 'hand' has no ixy",
        ),
        ("", "a <collision> of link 'hand' must hold one of box, cylinder, sphere, capsule, mesh, has (none)"),
    ],
)
def test_an_invalid_shape_is_refused(folder: Path, shape: str, message: str) -> None:
    """The distance computation would crash on some of them."""
    collision = f'<link name="hand"><collision><geometry>{shape}</geometry></collision></link>'
    change(folder / "mine.urdf", '<link name="hand"/>', collision)
    with pytest.raises(RobotError, match=re.escape(message)):
        read_robot(folder / "mine.toml")


@pytest.mark.parametrize(
    ("part", "count", "message"),
    [
        ('<link name="w{}"/>', 20_000, r"\d+ links, more than the 500 that are read; give a file of the arm alone"),
        ('<joint name="w{}" type="revolute"/>', 160, r"\d+ moving joints, more than the 150 that are read; give a"),
    ],
)
def test_a_robot_with_too_many_parts_is_refused(folder: Path, part: str, count: int, message: str) -> None:
    text = (folder / "mine.urdf").read_text(encoding="utf-8")
    parts = "".join(map(part.format, range(count)))
    (folder / "mine.urdf").write_text(text.replace("</robot>", f"{parts}</robot>"), encoding="utf-8")
    with pytest.raises(RobotError, match=message):
        read_robot(folder / "mine.toml")
