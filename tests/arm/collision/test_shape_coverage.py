"""Links without a shape, or with one far too small, are reported."""

from pathlib import Path
from xml.dom.minidom import parse

import pytest

from pbd.arm.collision.scene import CollisionScene
from pbd.arm.collision.shape_coverage import doubtful_shapes
from pbd.arm.model import load_model
from pbd.cli import main
from pbd.data.world import TABLE, THE_TOOL
from tests.arm.bundled import NAMES, arm_of
from tests.arm.collision.simple_robot import simple


@pytest.mark.parametrize("name", NAMES)
def test_every_body_is_in_some_checked_pair(name: str) -> None:
    """Every body of the arm, except perhaps the rod, is in some checked pair."""
    watch = CollisionScene(arm_of(name), -10.0).always
    watched = {watch.bodies[i] for pair in watch.pairs for i in pair}
    assert {body.name for body in set(watch.bodies) - watched} <= {TABLE, THE_TOOL}


@pytest.mark.parametrize("name", NAMES)
def test_the_bundled_arms_have_no_doubtful_shapes(name: str) -> None:
    assert doubtful_shapes(arm_of(name)) == {}


BOX = '<{0}><geometry><box size="0.2 0.2 0.2"/></geometry></{0}>'
MESH = '<{0}><geometry><mesh filename="t.obj" scale="{1} {1} {1}"/></geometry></{0}>'


@pytest.mark.parametrize(
    ("hand", "why"),
    [
        ("", "has no collision shape"),
        (BOX.format("collision"), None),
        (BOX.format("visual"), None),  # what is seen counts where nothing else is given
        (BOX.format("visual") + BOX.format("collision"), None),
        (BOX.format("visual") + MESH.format("collision", 0.001), "of 1.7 mm, but is drawn 34.6 cm large"),
        (BOX.format("visual") + BOX.format("collision").replace("0.2", "0.09"), "of 15.6 cm, but is drawn 34.6 cm"),
        (BOX.format("visual") + BOX.format("collision").replace("0.2", "0.11"), None),
        (MESH.format("visual", -0.2) + BOX.format("collision").replace("0.2", "0.05"), "8.7 cm, but is drawn 34.6 cm"),
    ],
)
def test_a_hand_without_a_shape_or_with_one_far_too_small(tmp_path: Path, hand: str, why: str | None) -> None:
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    found = doubtful_shapes(load_model(simple(tmp_path, hand)))
    if why is None:
        assert "hand" not in found
    else:
        assert why in found["hand"]


@pytest.mark.parametrize(("size", "why"), [(0.13, "of 22.5 cm, but its joints are 50.0 cm apart"), (0.2, None)])
def test_a_shape_far_smaller_than_the_distance_between_the_joints(tmp_path: Path, size: float, why: str | None) -> None:
    robot = simple(tmp_path, BOX.format("collision"))
    own = BOX.format("collision").replace("0.2", str(size))
    text = robot.urdf.read_text().replace('<link name="arm"/>', f'<link name="arm">{own}</link>')
    robot.urdf.write_text(text)
    found = doubtful_shapes(load_model(robot))
    assert found.get("arm") == (None if why is None else f"has a collision shape {why}")


@pytest.mark.parametrize(("joint", "why"), [("prismatic", None), ("revolute", "has no collision shape")])
def test_an_empty_root_on_which_the_arm_slides_is_only_a_frame(tmp_path: Path, joint: str, why: str | None) -> None:
    robot = simple(tmp_path, BOX.format("collision"))
    robot.urdf.write_text(robot.urdf.read_text().replace('"pan" type="revolute"', f'"pan" type="{joint}"'))
    found = doubtful_shapes(load_model(robot))
    assert found.get("foot") == why
    assert found["arm"] == "has no collision shape"


def test_a_link_without_a_shape_is_reported_by_robots_and_before_a_motion(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For a panda whose forearm has no mesh; the motion is planned nevertheless."""
    panda = arm_of("panda").robot
    toml = Path(__file__).parents[3] / "robots" / "panda.toml"
    (elsewhere / "robots").mkdir()
    document = parse(str(panda.urdf))
    for link in document.getElementsByTagName("link"):
        for kind in ("visual", "collision"):
            for shape in link.getElementsByTagName(kind) if link.getAttribute("name") == "panda_link4" else ():
                link.removeChild(shape)
    (elsewhere / "robots" / "mine.urdf").write_text(document.toxml())
    text = toml.read_text().replace('"panda_description/urdf/panda.urdf"', '"mine.urdf"')
    (elsewhere / "robots" / "mine.toml").write_text(text)
    assert main(["robots", "mine"]) == 0
    told = "contacts may be missed: panda_link4 has no collision shape"
    shown = capsys.readouterr().out
    assert told in shown
    assert "links without: panda_link4, panda_link8, panda_hand_tcp\n" in shown
    assert main(["export", "paper-test2", "--robot", "mine", "--format", "csv", "-o", "out.csv"]) == 0
    assert f"warning: {told}; correct the shapes in " in capsys.readouterr().err
