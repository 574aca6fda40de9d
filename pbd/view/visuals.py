"""A robot's appearance: the <visual> elements of its URDF, each as a compact mesh on its link.

A mesh's own colours win over the URDF's material, as in RViz.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.data import Robot
from pbd.errors import RobotError
from pbd.io.meshes import TriangleSoup, from_mesh
from pbd.io.urdf import Triple, read_shapes
from pbd.pose import Pose
from pbd.view import shapes
from pbd.view.compact_mesh import Mesh, compact

GREY: Triple = (0.75, 0.76, 0.78)
"""Colour of shapes whose file names none."""


@dataclass(frozen=True, eq=False)
class Visual:
    """A mesh, and its pose on a link."""

    link: str
    T_link_visual: Pose
    mesh: Mesh


def read_visuals(robot: Robot) -> tuple[Visual, ...]:
    """Read all visual elements of the robot's URDF, in the order of the file.

    Raises:
        RobotError: the URDF or a mesh can't be read.
    """
    visuals = []
    for shape in read_shapes(robot):
        rgb = shape.rgb or GREY
        if shape.element == "visual":
            is_mesh = shape.kind == "mesh"
            mesh = load_mesh(shape.mesh, shape.scale, rgb) if is_mesh else shapes.primitive(shape.kind, shape.size, rgb)
            visuals.append(Visual(shape.link, shape.T_link_shape, mesh))
    return tuple(visuals)


def load_mesh(path: Path, scale: Triple, default_rgb: Triple) -> Mesh:
    """Read a mesh file and compact it; the result is cached.

    Raises:
        RobotError: the file can't be read as a mesh, or no triangle of it has an area.
    """

    def compacted(soup: TriangleSoup) -> dict[str, object]:
        corners = soup.corners * np.array(scale)
        if np.prod(scale) < 0.0:  # a mirrored mesh
            corners = corners[:, ::-1]
        try:
            return vars(compact(TriangleSoup(corners, soup.rgb), default_rgb))
        except ValueError as reason:
            raise RobotError(f"mesh {path} can't be drawn ({reason}); export it anew", path=path) from None

    kept = from_mesh(path, "meshes", compacted, scale, default_rgb)
    return Mesh(kept["grid"], kept["centre"], float(kept["step"]), kept["faces"], kept["rgb"], bool(kept["closed"]))
