"""A robot's links as convex bodies, compared with pinocchio's reading of the URDF and with the raw meshes."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.arm.collision.allowed_collisions import link_pairs
from pbd.arm.collision.clearance import Clearance
from pbd.arm.collision.geometry import Body, _slabs, link_bodies
from pbd.arm.gripper import arm_bodies
from pbd.arm.model import load_model
from pbd.errors import RobotError
from pbd.pose import Array, Pose
from tests.arm.bundled import KINDS, arm_of
from tests.arm.collision.simple_robot import simple
from tests.arm.collision_oracles import coordinates, hull_distance, links_touching, links_watched, raw_meshes


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A separate, empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "pbd" / "hulls"


@pytest.mark.parametrize("name", KINDS)
def test_every_mesh_lies_in_the_bodies_of_its_link(name: str) -> None:
    """Checked for the extreme corner of each mesh in 6 directions, and the centre of other shapes, by pinocchio."""
    arm = arm_of(name)
    raw = raw_meshes(name)
    directions = np.random.default_rng(0).normal(size=(6, 3))
    for i, link in enumerate(raw.links):
        vertices = raw.vertices(i)
        joint = raw.geometry.geometryObjects[i].parentJoint
        bodies = [body for body in link_bodies(arm) if body.name == link]
        assert {body.joint for body in bodies} == {joint}
        for corner in vertices[np.unique(np.argmax(vertices @ directions.T, axis=0))]:
            assert any(gap(corner, body) < 1e-6 for body in bodies)


def gap(point: Array, body: Body) -> float:
    """Return the distance of a point, in the joint's frame, from a hull, or from the centre of another shape, m."""
    if body.shape != "hull":
        return float(np.linalg.norm(point - body.T_joint_body.p))
    return hull_distance(point[None], body.T_joint_body.act(body.points)) - body.pad


@pytest.mark.parametrize("name", KINDS)
def test_no_contact_of_the_meshes_is_missed_and_few_are_false(name: str) -> None:
    """Of the configurations that are free 2 in 100 at most are called contacts (by hulls alone it was up to 48)."""
    arm = arm_of(name)
    clearance = Clearance(arm, arm_bodies(arm), link_pairs(arm)[0])
    raw = raw_meshes(name)
    raw.watch(links_watched(clearance))
    x = coordinates(arm, 80 if len(link_bodies(arm)) > 20 else 300)
    true, called = [raw.touching(row) for row in x], [links_touching(clearance, row) for row in x]
    assert sum(map(bool, true)) > 5  # there is something to miss
    assert all(a <= b for a, b in zip(true, called, strict=True))
    seen = set(raw.links)
    made_up = [any(pair <= seen for pair in b) for a, b in zip(true, called, strict=True) if not a]
    assert np.mean(made_up) <= 0.02


SHAPES = '<{0}><origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/><geometry>{1}</geometry></{0}>'


@pytest.mark.parametrize(
    ("geometry", "shape", "size"),
    [
        ('<box size="0.1 0.2 0.3"/>', "box", (0.1, 0.2, 0.3)),
        ('<cylinder radius="0.1" length="0.5"/>', "cylinder", (0.2, 0.5)),
        ('<sphere radius="0.1"/>', "sphere", (0.2,)),
    ],
)
@pytest.mark.parametrize("element", ["collision", "visual"])
def test_simple_shapes_stay_what_they_are(
    tmp_path: Path, element: str, geometry: str, shape: str, size: tuple[float, ...]
) -> None:
    (body,) = link_bodies(load_model(simple(tmp_path, SHAPES.format(element, geometry))))
    assert (body.name, body.joint, body.shape, body.size) == ("hand", 2, shape, size)
    metres, rad = body.T_joint_body.distance(Pose.from_rpy((0.1, 0.2, 0.3), (0, 0, np.pi / 2)))
    assert max(metres, rad) < 1e-12


def test_a_capsule_is_a_cylinder_and_two_spheres(tmp_path: Path) -> None:
    capsule = SHAPES.format("collision", '<capsule radius="0.1" length="0.5"/>')
    bodies = link_bodies(load_model(simple(tmp_path, capsule)))
    assert [(body.shape, body.size) for body in bodies] == [
        ("cylinder", (0.2, 0.5)), ("sphere", (0.2,)), ("sphere", (0.2,)),
    ]  # fmt: skip
    assert_allclose([body.T_joint_body.p for body in bodies], [[0.1, 0.2, z] for z in (0.3, 0.05, 0.55)])


def test_visual_shapes_count_only_without_collision_shapes(tmp_path: Path) -> None:
    shapes = [
        SHAPES.format(e, g) for e, g in (("collision", '<sphere radius="1"/>'), ("visual", '<box size="1 1 1"/>'))
    ]
    assert [body.shape for body in link_bodies(load_model(simple(tmp_path, "".join(shapes))))] == ["sphere"]


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.mark.parametrize("address", ["package://meshes/t.obj", "meshes/t.obj", "file://meshes/t.obj"])
def test_a_mesh_is_found_and_scaled(tmp_path: Path, cache: Path, address: str) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "t.obj").write_text(OBJ, encoding="utf-8")
    mesh = f'<collision><geometry><mesh filename="{address}" scale="1 2 3"/></geometry></collision>'
    (body,) = link_bodies(load_model(simple(tmp_path, mesh)))
    assert_allclose(sorted(body.points.tolist()), [[0, 0, 0], [0, 0, 3], [0, 2, 0], [1, 0, 0]])
    assert len(list(cache.iterdir())) == 1


@pytest.mark.parametrize(
    ("content", "scale", "message"),
    [
        ("nonsense", 1, "t.obj has no face; convert it to STL"),
        (OBJ, 100, "t.obj has a corner at 100 m, beyond any arm's reach; if it is in mm, give it scale="),
        (None, 1, r"t.obj: can't be read \(No such file.*\); put it there, or "),
    ],
)
def test_a_faulty_mesh_is_one_line(tmp_path: Path, cache: Path, content: str | None, scale: int, message: str) -> None:
    good = simple(tmp_path, "")
    arm = load_model(good)  # before the fault: pinocchio reads some of it too
    (tmp_path / "meshes").mkdir()
    if content is not None:
        (tmp_path / "meshes" / "t.obj").write_text(content, encoding="utf-8")
    mesh = f'<mesh filename="meshes/t.obj" scale="{scale} {scale} {scale}"/>'
    element = f"<collision><geometry>{mesh}</geometry></collision>"
    good.urdf.write_text(good.urdf.read_text().replace('name="hand">', f'name="hand">{element}'), encoding="utf-8")
    with pytest.raises(RobotError, match=message) as caught:
        link_bodies(arm)
    assert "\n" not in caught.value.message
    assert "path" in caught.value.fields


FLAT = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n"


def test_a_mesh_of_two_parts_far_apart_has_no_slab_between_them() -> None:
    part = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.05], [0.0, 0.0, 0.1]])[[[0, 1, 2], [0, 1, 3]]]
    slabs = _slabs(np.concatenate((part, part + np.array((10.0, 0.0, 0.0)))))
    assert_allclose([corners[:, 0].min() for corners in slabs.values()], (0.0, 10.0))


def test_slabs_meet_where_the_mesh_is_cut() -> None:
    """The mesh is longest along x, and has no corner between its ends."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1.0, 0.0, 0.1]])
    slabs = list(_slabs(corners[[[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]]).values())
    ends = np.array([(part[:, 0].min(), part[:, 0].max()) for part in slabs])
    assert len(slabs) > 2
    assert_allclose(ends[1:, 0], ends[:-1, 1], atol=1e-9)
    assert_allclose(ends[[0, -1], [0, 1]], (0.0, 1.0), atol=1e-9)


def test_a_flat_mesh_becomes_a_thin_box(tmp_path: Path, cache: Path) -> None:
    (tmp_path / "t.obj").write_text(FLAT, encoding="utf-8")
    mesh = '<collision><geometry><mesh filename="t.obj"/></geometry></collision>'
    (body,) = link_bodies(load_model(simple(tmp_path, mesh)))
    assert_allclose(np.ptp(body.points, axis=0), (1.002, 1.002, 0.002))
