"""DAE files: against assimp where it is right, and against hand-made files where it is not."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import coal
import numpy as np
import pytest

from pbd.errors import RobotError
from pbd.pose import Array
from pbd.view.collada import read_collada
from pbd.view.meshes import compact
from tests.view.scenes import share

ROBOTS = share() / "example-robot-data" / "robots"


def area(corners: Array) -> float:
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    )


@pytest.mark.parametrize(
    "name",
    [
        "panda_description/meshes/visual/finger.dae",  # two geometries, each in a node of its own
        "panda_description/meshes/visual/hand.dae",
        "ur_description/meshes/ur3/visual/wrist3.dae",  # polylists
        "kinova_description/meshes/ring_small.dae",
    ],
)
def test_the_same_surface_as_assimp(name: str) -> None:
    # coal mixes up geometries with several materials, so these have one each
    model = coal.MeshLoader().load(str(ROBOTS / name), np.ones(3))
    faces = [model.tri_indices(i) for i in range(model.num_tris)]
    wanted = model.vertices()[np.array([(face[0], face[1], face[2]) for face in faces])]
    got = read_collada(ROBOTS / name).corners
    assert area(got) == pytest.approx(area(wanted), rel=1e-5)
    for end in (np.min, np.max):
        np.testing.assert_allclose(end(got, axis=(0, 1)), end(wanted, axis=(0, 1)), atol=1e-6)


@pytest.mark.parametrize("part", ["base", "shoulder", "upperarm", "forearm", "wrist1", "wrist2", "wrist3"])
def test_ur5_is_whole(part: str) -> None:
    path = ROBOTS / "ur_description" / "meshes" / "ur5" / "visual" / f"{part}.dae"
    soup = read_collada(path)
    counts = [int(element.attrib["count"]) for element in ET.parse(path).iter() if element.tag.endswith("}triangles")]
    assert len(soup.corners) == sum(counts)
    assert compact(soup, (0.5, 0.5, 0.5)).closed  # every edge has its two faces: nothing is missing
    assert not np.isnan(soup.rgb).any()


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
  <source id="p"><float_array id="pa" count="15">0 0 0  1 0 0  1 1 0  0 1 0  0 0 1</float_array></source>
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


def read(folder: Path, primitives: str, transforms: str = "") -> tuple[Array, Array]:
    path = folder / "hand_made.dae"
    path.write_text(HAND_MADE.format(primitives=primitives, transforms=transforms))
    soup = read_collada(path)
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


def test_transforms_apply_as_written(tmp_path: Path) -> None:
    triangle = '<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 3</p></triangles>'
    moves = "<translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>"
    corners, _ = read(tmp_path, triangle, moves)
    np.testing.assert_allclose(corners, [[[10, 0, 0], [10, 2, 0], [9, 0, 0]]], atol=1e-12)


def test_a_mirrored_part_keeps_its_outside(tmp_path: Path) -> None:
    triangle = '<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 3</p></triangles>'
    mirror = "<matrix>1 0 0 0  0 1 0 0  0 0 -1 0  0 0 0 1</matrix>"
    corners, _ = read(tmp_path, triangle, mirror)
    normal = np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])
    assert normal[2] < 0.0


@pytest.mark.parametrize(
    "text",
    [
        "no xml",
        HAND_MADE.format(primitives="", transforms='<instance_geometry url="#nowhere"/>'),
        HAND_MADE.format(primitives="<triangles><p>0 1 2</p></triangles>", transforms=""),
        HAND_MADE.format(
            primitives='<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 99</p></triangles>',
            transforms="",
        ),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.dae"
    path.write_text(text)
    with pytest.raises(RobotError, match=r"broken\.dae") as caught:
        read_collada(path)
    assert caught.value.fields["path"] == path
