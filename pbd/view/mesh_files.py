"""Mesh files on the disk: reading them, and remembering what came of it.

DAE and binary STL are read here; everything else that assimp knows comes through coal, without colours.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from pbd.cache import recall, remember
from pbd.errors import RobotError
from pbd.paths import is_file
from pbd.view.collada import read_collada
from pbd.view.meshes import Mesh, Soup, compact

CACHE_VERSION = 3
"""Part of the cache's keys: raise it when the same file would give another mesh."""

STL_HEADER = 84
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_soup(path: Path) -> Soup:
    """Read a mesh file's triangles, in the file's units (DAE: metres).

    Raises:
        RobotError: the file is missing or is no mesh.
    """
    if not is_file(path):
        raise RobotError(f"mesh {path} is missing; put it there, or correct its address in the URDF", path=path)
    if path.suffix.lower() == ".dae":
        return read_collada(path)
    if path.suffix.lower() == ".stl" and (soup := _read_binary_stl(path)) is not None:
        return soup
    return _read_by_assimp(path)


def _read_binary_stl(path: Path) -> Soup | None:
    """None where the length does not fit the count in the header: then it is an STL in text."""
    data = path.read_bytes()
    count = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little")
    if len(data) != STL_HEADER + count * STL_FACE.itemsize:
        return None
    corners = np.frombuffer(data, STL_FACE, count, STL_HEADER)["corners"].astype(np.float64)
    return Soup(corners, np.full((count, 3), np.nan))


def _read_by_assimp(path: Path) -> Soup:
    import coal

    try:
        model = coal.MeshLoader().load(str(path), np.ones(3))
    except (RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise RobotError(f"mesh {path} can't be read ({reason}); convert it to STL or DAE", path=path) from error
    faces = [model.tri_indices(i) for i in range(model.num_tris)]
    index = np.array([(face[0], face[1], face[2]) for face in faces], dtype=np.int64).reshape(-1, 3)
    return Soup(model.vertices()[index], np.full((len(index), 3), np.nan))


def load_mesh(path: Path, scale: tuple[float, float, float], default_rgb: tuple[float, float, float]) -> Mesh:
    """Read a mesh file and make it compact, or take it from the user's cache, where it was made before.

    Raises:
        RobotError: the file can't be read as a mesh.
    """
    key = hashlib.sha256(repr((CACHE_VERSION, path.suffix, scale, default_rgb)).encode())
    if is_file(path):
        key.update(path.read_bytes())
    if (kept := recall("meshes", key.hexdigest())) is not None:
        return Mesh(kept["grid"], kept["centre"], float(kept["step"]), kept["faces"], kept["rgb"], bool(kept["closed"]))
    soup = read_soup(path)
    corners = soup.corners * np.array(scale)
    mesh = compact(Soup(corners[:, ::-1] if np.prod(scale) < 0.0 else corners, soup.rgb), default_rgb)
    remember("meshes", key.hexdigest(), vars(mesh))
    return mesh
