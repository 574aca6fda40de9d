"""Where a URDF's meshes are, and reading them by assimp: what leaves here is finite."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.doors.atomic import is_file
from pbd.doors.opening import read_bytes
from pbd.errors import RobotError, printable
from pbd.pose import Array

MOST_BYTES = 200_000_000
"""Largest mesh file: four million triangles of a binary STL."""

LONGEST_LINE = 10_000
"""Longest line of an OBJ file, characters: assimp's time grows with its square."""

LARGEST = 1e6
"""Largest coordinate of a mesh, in its own unit: a kilometre in mm."""


def mesh_places(address: str, urdf: Path, package_dirs: Sequence[Path]) -> list[Path]:
    """Say where a URDF's package://, file:// or relative address may lead.

    A package may be a folder in one of package_dirs, or such a folder itself.
    """
    if not address.startswith("package://"):
        return [urdf.parent / address.removeprefix("file://")]
    inside = Path(address.removeprefix("package://"))
    places = [folder / inside for folder in package_dirs]
    return places + [folder.parent / inside for folder in package_dirs if inside.parts[:1] == (folder.name,)]


def mesh_file(address: str, urdf: Path, package_dirs: Sequence[Path]) -> Path:
    """Return the first of the places where there is something; else the first, for whoever opens it to say so."""
    places = mesh_places(address, urdf, package_dirs) or [Path(address)]
    return next((place for place in places if is_file(place)), places[0])


def read_mesh_bytes(path: Path) -> bytes:
    """Read a mesh file.

    Raises:
        RobotError: it is missing, no regular file, or too large.
    """
    return read_bytes(path, RobotError, "put it there, or correct its address in the URDF", MOST_BYTES)


def load_by_assimp(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Return a mesh's vertices (n, 3), in its own unit, and its faces (m, 3).

    Raises:
        RobotError: assimp can't read it, it has no face, or a vertex is no finite number.
    """
    import coal

    data = read_mesh_bytes(path)  # assimp would wait for a pipe
    if path.suffix.lower() == ".obj" and max(map(len, data.splitlines()), default=0) > LONGEST_LINE:
        raise RobotError(f"mesh {path} has a line of more than {LONGEST_LINE} characters; export it anew", path=path)
    try:
        # Boxes along the axes: the others' search for axes prints what it thinks of numbers that are none.
        model: Any = coal.MeshLoader(coal.BV_AABB).load(str(path), np.ones(3))
    except Exception as reason:  # assimp's and coal's have no type of their own
        why = printable(" ".join(str(reason).rpartition("message:")[2].split()))
        raise RobotError(f"mesh {path} can't be read ({why}); convert it to STL", path=path) from None
    faces = [model.tri_indices(i) for i in range(model.num_tris)]
    if not faces:
        raise RobotError(f"mesh {path} has no face; convert it to STL anew", path=path)
    vertices = np.array(model.vertices())
    refuse_unsound(path, vertices)
    return vertices, np.array([(t[0], t[1], t[2]) for t in faces], dtype=np.int64)


def refuse_unsound(path: Path, vertices: Array) -> None:
    """Refuse vertices (..., 3) that no mesh has: what measures distances crashes on them.

    Raises:
        RobotError: one is no finite number, or larger than LARGEST.
    """
    if not (np.abs(vertices) <= LARGEST).all():
        raise RobotError(f"mesh {path} has a vertex that is not a number or too far away; export it anew", path=path)
