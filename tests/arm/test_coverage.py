"""What has no shape, or one far too small, is told; what is in the file is checked."""

from __future__ import annotations

from pathlib import Path
from xml.dom.minidom import Element, parse

import coal
import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from pbd.arm.coverage import doubts
from pbd.arm.hand import THE_TOOL
from pbd.arm.hulls import link_bodies
from pbd.arm.model import load_model
from pbd.arm.motion_bounds import outline
from pbd.arm.scene import TABLE, CollisionScene
from pbd.cli import main
from pbd.data import Robot
from pbd.pose import Array, Pose
from tests.arm.bundled import NAMES, arm_of
from tests.arm.test_collision_hulls import simple

SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


def links_of(urdf: Path) -> list[Element]:
    root = parse(str(urdf)).documentElement
    assert root is not None
    return [each for each in root.childNodes if isinstance(each, Element) and each.tagName == "link"]


def shapes(link: Element) -> list[Element]:
    """The elements that count: what can be hit, or else what can be seen."""
    return link.getElementsByTagName("collision") or link.getElementsByTagName("visual")


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def corners(shape: Element, robot: Robot) -> Array:
    """Of a mesh, on its link."""
    mesh = shape.getElementsByTagName("mesh")[0]
    address = mesh.getAttribute("filename").removeprefix("package://")
    path = next(folder / address for folder in robot.package_dirs if (folder / address).is_file())
    vertices = np.array(coal.MeshLoader().load(str(path), np.ones(3)).vertices())
    origin = (shape.getElementsByTagName("origin") or [Element("origin")])[0]
    xyz, rpy = (numbers(origin.getAttribute(key) or "0 0 0") for key in ("xyz", "rpy"))
    return Pose.from_rpy(xyz, rpy).act(vertices * numbers(mesh.getAttribute("scale") or "1 1 1"))


@pytest.mark.parametrize("name", NAMES)
def test_every_shape_of_the_file_is_checked(name: str) -> None:
    arm = arm_of(name)
    links = links_of(arm.robot.urdf)
    bodies = link_bodies(arm)
    assert {body.name for body in bodies} == {link.getAttribute("name") for link in links if shapes(link)}
    for link in links:
        own = [body for body in bodies if body.name == link.getAttribute("name")]
        geometries = [shape.getElementsByTagName("geometry")[0].childNodes for shape in shapes(link)]
        found = [(e.nodeName, e) for nodes in geometries for e in nodes if isinstance(e, Element)]
        simple_ones = [body for body in own if body.shape != "hull"]
        assert [body.shape for body in simple_ones] == [kind for kind, _ in found if kind != "mesh"]
        for body, solid in zip(simple_ones, (solid for kind, solid in found if kind != "mesh"), strict=True):
            sizes = [x for key in SIZES[body.shape] for x in numbers(solid.getAttribute(key))]
            sizes[0] *= 1.0 if body.shape == "box" else 2.0  # ours are diameters
            assert_allclose(body.size, sizes)
        meshes = [shape for shape in shapes(link) if shape.getElementsByTagName("mesh")]
        if meshes:
            # Where the link is on its joint.
            frame = arm.full.frames[arm.full.getFrameId(link.getAttribute("name"), pin.FrameType.BODY)].placement
            p = np.concatenate([corners(shape, arm.robot) for shape in meshes]) @ frame.rotation.T + frame.translation
            reach = [(b.T_joint_body.act(outline(b)[0]), outline(b)[1]) for b in own]
            lower = np.min([(q - pad).min(axis=0) for q, pad in reach], axis=0)
            upper = np.max([(q + pad).max(axis=0) for q, pad in reach], axis=0)
            assert (lower <= p.min(axis=0) + 1e-6).all()
            assert (upper >= p.max(axis=0) - 1e-6).all()
            assert np.linalg.norm(upper - lower) < np.linalg.norm(np.ptp(p, axis=0)) + 0.02


@pytest.mark.parametrize("name", NAMES)
def test_every_body_is_watched_against_something(name: str) -> None:
    """Nothing on the arm is left out of all pairs, but for what never moves and what is next to it."""
    watch = CollisionScene(arm_of(name), -10.0).always.clearance
    watched = {watch.bodies[i] for pair in watch.pairs for i in pair}
    assert {body.name for body in set(watch.bodies) - watched} <= {TABLE, THE_TOOL}


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_doubted_of_the_bundled_arms(name: str) -> None:
    assert doubts(arm_of(name)) == ()


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
    found = {doubt.link: doubt.why for doubt in doubts(load_model(simple(tmp_path, hand)))}
    if why is None:
        assert "hand" not in found
    else:
        assert why in found["hand"]


@pytest.mark.parametrize(("size", "why"), [(0.13, "of 22.5 cm, but its joints are 50.0 cm apart"), (0.2, None)])
def test_a_link_far_smaller_than_the_way_between_its_joints(tmp_path: Path, size: float, why: str | None) -> None:
    robot = simple(tmp_path, BOX.format("collision"))
    own = BOX.format("collision").replace("0.2", str(size))
    text = robot.urdf.read_text().replace('<link name="arm"/>', f'<link name="arm">{own}</link>')
    robot.urdf.write_text(text)
    found = {doubt.link: doubt.why for doubt in doubts(load_model(robot))}
    assert found.get("arm") == (None if why is None else f"has a collision shape {why}")


def test_a_link_without_a_shape_is_told_by_robots_and_before_a_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A panda whose forearm has lost its mesh; the motion is planned all the same."""
    monkeypatch.chdir(tmp_path)
    panda = arm_of("panda").robot
    toml = Path(__file__).parents[2] / "robots" / "panda.toml"
    (tmp_path / "robots").mkdir()
    document = parse(str(panda.urdf))
    for link in document.getElementsByTagName("link"):
        for kind in ("visual", "collision"):
            for shape in link.getElementsByTagName(kind) if link.getAttribute("name") == "panda_link4" else ():
                link.removeChild(shape)
    (tmp_path / "robots" / "mine.urdf").write_text(document.toxml())
    text = toml.read_text().replace('"panda_description/urdf/panda.urdf"', '"mine.urdf"')
    (tmp_path / "robots" / "mine.toml").write_text(text)
    assert main(["robots", "mine"]) == 0
    told = "contacts may be missed: panda_link4 has no collision shape"
    shown = capsys.readouterr().out
    assert told in shown
    assert "links without: panda_link4, panda_link8, panda_hand_tcp\n" in shown
    assert main(["export", "paper-test2", "--robot", "mine", "--format", "csv", "-o", "out.csv"]) == 0
    assert f"warning: {told}; correct the shapes in " in capsys.readouterr().err
