"""Hand-made and invalid mesh files. tests/test_bundled_meshes.py tests the bundled ones."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pbd.errors import RobotError
from pbd.io import meshes
from pbd.io.meshes import MESH_SUFFIXES, from_mesh, rounded_points
from pbd.pose import Array
from tests.reading_meshes import read_mesh
from tests.system_failures import full_disk

HAND_MADE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.001"/><up_axis>Y_UP</up_axis></asset>
<library_effects>
  <effect id="fx-red"><profile_COMMON><technique>
    <lambert><diffuse><color>1 0 0 1</color></diffuse></lambert>
  </technique></profile_COMMON></effect>
  <effect id="fx-img"><profile_COMMON><technique>
    <phong><diffuse><texture texture="t"/></diffuse></phong>
  </technique></profile_COMMON></effect>
</library_effects>
<library_materials>
  <material id="red"><instance_effect url="#fx-red"/></material>
  <material id="img"><instance_effect url="#fx-img"/></material>
</library_materials>
<library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="pa" count="15">0 0 0  1 0 0  1 1 0  0 1 0  0 0 1</float_array>
  <technique_common><accessor source="#pa" count="5" stride="3"><param name="X" type="float"/>
  <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  {primitives}
</mesh></geometry></library_geometries>
<library_nodes><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
  <instance_material symbol="a" target="#red"/><instance_material symbol="b" target="#img"/>
</technique_common></bind_material></instance_geometry></node></library_nodes>
<library_visual_scenes><visual_scene id="s">
  <node>{transforms}<instance_node url="#n"/></node>
</visual_scene></library_visual_scenes>
</COLLADA>"""

QUAD = """<polylist material="a">
  <input semantic="VERTEX" source="#v" offset="1"/><input semantic="NORMAL" source="#p" offset="0"/>{}
</polylist>"""


def hand_made(primitives: str, transforms: str = "") -> bytes:
    return HAND_MADE.format(primitives=primitives, transforms=transforms).encode()


def read(folder: Path, primitives: str, transforms: str = "") -> tuple[Array, Array]:
    path = folder / "hand_made.dae"
    path.write_bytes(hand_made(primitives, transforms))
    soup = read_mesh(path)
    return 1000.0 * soup.corners, soup.rgb


def test_polygons_become_triangles_with_their_materials(tmp_path: Path) -> None:
    corners, rgb = read(
        tmp_path,
        QUAD.format("<vcount>4 3</vcount><p>0 0 0 1 0 2 0 3  4 0 4 1 4 4</p>")
        + '<triangles material="b"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 4</p></triangles>'
        + '<polygons><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 3</p></polygons>'
        + '<lines><input semantic="VERTEX" source="#v" offset="0"/><p>0 1</p></lines>',
    )
    o, x, xy, y, z = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1.0]])
    wanted = [[o, x, xy], [o, xy, y], [o, x, z], [o, x, z], [o, x, xy], [o, xy, y]]
    np.testing.assert_allclose(corners, wanted, atol=1e-12)
    np.testing.assert_array_equal(rgb[:3], np.tile([1.0, 0.0, 0.0], (3, 1)))
    assert np.isnan(rgb[3:]).all()


def test_transforms_apply_in_their_order(tmp_path: Path) -> None:
    triangle = '<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 3</p></triangles>'
    moves = "<translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>"
    corners, _ = read(tmp_path, triangle, moves)
    np.testing.assert_allclose(corners, [[[10, 0, 0], [10, 2, 0], [9, 0, 0]]], atol=1e-6)


def test_a_mirrored_part_keeps_its_outside(tmp_path: Path) -> None:
    triangle = '<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 3</p></triangles>'
    mirror = "<matrix>1 0 0 0  0 1 0 0  0 0 -1 0  0 0 0 1</matrix>"
    corners, _ = read(tmp_path, triangle, mirror)
    normal = np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])
    assert normal[2] < 0.0


def test_a_part_that_is_placed_too_often_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file may place one part many times."""
    monkeypatch.setattr(meshes, "MOST_TRIANGLES", 3)
    quad = QUAD.format("<vcount>4</vcount><p>0 0 0 1 0 2 0 3</p>")
    assert len(read(tmp_path, quad)[0]) == 2
    with pytest.raises(RobotError, match="more than 3 triangles"):
        read(tmp_path, quad, '<instance_node url="#n"/>')


def test_rounded_points_are_different_and_in_order() -> None:
    corners = np.random.default_rng(0).uniform(-0.004, 0.004, (600, 3, 3))
    expected = np.unique(np.rint(corners.reshape(-1, 3) / 1e-3), axis=0) * 1e-3
    assert np.array_equal(rounded_points(corners, 1e-3), expected)


def test_what_concerns_a_scenes_looks_may_be_missing(tmp_path: Path) -> None:
    """Makers' own meshes refer to cameras (Fetch) and textures (ANYmal) that are not there."""
    primitives = (
        '<triangles count="1" material="a"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>'
    )
    shape, rgb = read(tmp_path, primitives)
    assert rgb.tolist() == [[1, 0, 0]]
    for tag in ("camera", "light"):
        corners, rgb = read(tmp_path, primitives, f'<instance_{tag} url="#nowhere"/>')
        np.testing.assert_array_equal(corners, shape)
        assert np.isnan(rgb).all()
    path = tmp_path / "hand_made.dae"
    sampler = '<newparam sid="t"><sampler2D><source>nowhere</source></sampler2D></newparam><technique><phong>'
    text = HAND_MADE.format(primitives=primitives, transforms="")
    path.write_text(text.replace("<technique>\n    <phong>", sampler))
    assert "nowhere" in path.read_text()
    np.testing.assert_array_equal(1000.0 * read_mesh(path).corners, shape)


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
TEXT_STL = "solid one\nfacet normal 0 0 1\nouter loop\n{}endloop\nendfacet\nendsolid one\n"
CONTENTS = {
    "binary.stl": bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, *TRIANGLE.ravel(), 0),
    "text.STL": TEXT_STL.format("".join(f"vertex {x} {y} {z}\n" for x, y, z in TRIANGLE)).encode(),
    "one.obj": b"mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
}


@pytest.mark.parametrize("name", CONTENTS)
def test_formats_without_colours(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(CONTENTS[name])
    soup = read_mesh(tmp_path / name)
    np.testing.assert_allclose(soup.corners, [TRIANGLE])
    assert np.isnan(soup.rgb).all()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.stl", None, r"can't be read \(No such file.*\); put it there"),
        ("a.obj", b"nothing", "convert it to STL"),
        ("a.dae", b"no xml", "a.dae"),
        ("a.dae", hand_made("", '<instance_geometry url="#nowhere"/>'), "a.dae"),
        ("a.dae", hand_made("<triangles><p>0 1 2</p></triangles>"), "a.dae"),
        ("a.step", b"ISO-10303-21;", f"none of {', '.join(MESH_SUFFIXES)}"),
        ("a.obj", b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "a vertex that is not a number or too far away"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "convert it to STL"),
        ("a.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", r"\(a vertex has not three coordinates\); convert it to STL"),
        ("a.dae", b'<!DOCTYPE COLLADA [<!ENTITY l "ha">]><COLLADA/>', r"\(a DOCTYPE is not allowed\); convert it"),
    ],
)
def test_an_invalid_mesh_is_refused(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RobotError, match=message) as caught:
        read_mesh(tmp_path / name)
    assert caught.value.fields["path"] == tmp_path / name


class TestCache:
    @pytest.fixture(autouse=True)
    def own_cache(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.file, self.made = tmp_path / "cache", tmp_path / "one.stl", 0
        self.file.write_bytes(CONTENTS["binary.stl"])
        monkeypatch.setenv("XDG_CACHE_HOME", str(self.folder))

    def area(self, scale: float = 1.0) -> float:
        def make(soup: object) -> dict[str, object]:
            self.made += 1
            return {"area": scale}

        return float(from_mesh(self.file, "areas", make, scale)["area"])

    def test_a_result_is_computed_once(self) -> None:
        assert [self.area(), self.area(), self.area(2.0), self.area(2.0)] == [1.0, 1.0, 2.0, 2.0]
        assert self.made == 2

    @pytest.mark.parametrize("damage", ["cut", "flipped", "emptied", "a folder"])
    def test_a_damaged_result_is_computed_again(self, damage: str) -> None:
        self.area()
        (kept,) = self.folder.rglob("*.npz")
        content = bytearray(kept.read_bytes())
        content[len(content) // 2] ^= 1
        kept.unlink()
        if damage == "a folder":
            kept.mkdir()
        else:
            kept.write_bytes(bytes({"cut": content[:-10], "flipped": content, "emptied": bytearray()}[damage]))
        assert self.area() == 1.0
        assert self.made == 2

    def test_a_full_disk_leaves_nothing(self) -> None:
        with full_disk(0):
            self.area()
        assert not [path for path in self.folder.rglob("*") if path.is_file()]

    @pytest.mark.parametrize("by", ["its owner", "its mode", "another key's name"])
    def test_what_another_user_may_have_written_is_computed_again(
        self, by: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Collisions are checked with what the cache holds."""
        self.area(), self.area(2.0)
        first, second = self.folder.rglob("*.npz")
        if by == "its owner":
            monkeypatch.setattr("os.geteuid", lambda: first.stat().st_uid + 1)
        elif by == "its mode":
            first.chmod(0o660)
            second.chmod(0o666)
        else:
            other = first.rename(self.folder / "other")
            second.rename(first)
            other.rename(second)
        assert [self.area(), self.area(2.0)] == [1.0, 2.0]
        assert self.made == 4

    def test_a_file_that_others_could_write_is_replaced_by_one_that_counts(self) -> None:
        """It took over the permissions of the old file, so the shapes were computed in every command."""
        self.area()
        (file,) = self.folder.rglob("*.npz")
        file.chmod(0o664)
        assert [self.area(), self.area()] == [1.0, 1.0]
        assert self.made == 2

    def test_a_link_in_the_cache_is_not_written_through(self, tmp_path: Path) -> None:
        self.area()
        (file,) = self.folder.rglob("*.npz")
        (tmp_path / "notes").write_text("mine")
        file.unlink()
        file.symlink_to(tmp_path / "notes")
        self.area()
        assert (tmp_path / "notes").read_text() == "mine"

    def test_a_cache_that_cannot_be_written_is_ignored(self) -> None:
        self.folder.write_text("a file where the folder should be")
        assert [self.area(), self.area()] == [1.0, 1.0]
        assert self.made == 2


def test_a_glb_whose_values_are_not_in_the_file_is_refused(tmp_path: Path) -> None:
    values = {"componentType": 5126, "count": 50_000_000, "type": "VEC3"}
    glb = {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [values]}
    text = json.dumps(glb).encode()
    path = tmp_path / "swelling.glb"
    path.write_bytes(struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text)
    with pytest.raises(RobotError, match="more than 4000000 triangles"):
        read_mesh(path)


def test_a_mesh_that_a_glb_shows_too_often_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = trimesh.Scene()
    for k in range(3):
        scene.add_geometry(trimesh.creation.box(), geom_name="box", node_name=f"{k}")
    path = tmp_path / "boxes.glb"
    path.write_bytes(trimesh.exchange.gltf.export_glb(scene))  # type: ignore[no-untyped-call]
    assert len(read_mesh(path).corners) == 36
    monkeypatch.setattr(meshes, "MOST_TRIANGLES", 35)
    with pytest.raises(RobotError, match="more than 35 triangles"):
        read_mesh(path)
