"""Bundled robots are drawn completely: each mesh has the size and place that pinocchio reads from the same files."""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from pbd import load_robot
from pbd.data import Robot
from pbd.io.meshes import mesh_file
from pbd.pose import Array
from pbd.view.visuals import read_visuals

ROBOTS = ("panda", "so101")
"""They contain each way in which a bundled URDF places a mesh; tests/test_bundled_meshes.py reads all meshes."""

LARGEST_COORDINATE = 1_000_000
"""Bytes of a mesh file. Larger ones are placed like these, and take most of the time to read."""


def boxes(parts: list[Array]) -> Array:
    """Bounding boxes (n, 6) of parts' vertices, sorted."""
    rows = [np.concatenate((corners.min(axis=0), corners.max(axis=0))) for corners in parts]
    return np.array(sorted(tuple(np.round(row, 6)) for row in rows))


def without_large_meshes(robot: Robot, folder: Path) -> Robot:
    """The same with a copy of the URDF in which large meshes are not drawn."""
    urdf = ElementTree.parse(robot.urdf)
    for link in urdf.iter("link"):
        for visual in link.findall("visual"):
            name = visual.find(".//mesh").attrib["filename"]  # type: ignore[union-attr]  # each has one
            if mesh_file(name, robot.urdf, robot.package_dirs).stat().st_size > LARGEST_COORDINATE:
                link.remove(visual)
    urdf.write(folder / robot.urdf.name)
    return replace(robot, urdf=folder / robot.urdf.name)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_part_is_there_and_complete(name: str, tmp_path: Path) -> None:
    robot = without_large_meshes(load_robot(name), tmp_path)
    model = pin.buildModelFromUrdf(str(robot.urdf))
    folders = [str(folder) for folder in robot.package_dirs]
    geometry = pin.buildGeomFromUrdf(model, str(robot.urdf), pin.GeometryType.VISUAL, package_dirs=folders)
    wanted, drawn = defaultdict(list), defaultdict(list)
    for each in geometry.geometryObjects:
        frame = model.frames[each.parentFrame]
        T_link_visual = (frame.placement.inverse() * each.placement).homogeneous
        corners = each.geometry.vertices() * each.meshScale
        wanted[frame.name].append(corners @ T_link_visual[:3, :3].T + T_link_visual[:3, 3])
    for visual in read_visuals(robot):
        drawn[visual.link].append(visual.T_link_visual.act(visual.mesh.vertices))
    assert len(drawn) > 4
    assert drawn.keys() == wanted.keys()
    for link, parts in drawn.items():
        np.testing.assert_allclose(boxes(parts), boxes(wanted[link]), atol=2e-4, err_msg=link)
