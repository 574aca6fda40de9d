"""Mesh files on the disk: reading them, and remembering what came of it.

DAE and binary STL are read here; everything else that assimp knows comes through coal, without colours.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from pbd.cache import recall, remember
from pbd.doors.meshes import load_by_assimp, read_mesh_bytes, refuse_unsound
from pbd.errors import RobotError
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
    if path.suffix.lower() == ".dae":
        return read_collada(path)
    if path.suffix.lower() == ".stl" and (soup := _read_binary_stl(path)) is not None:
        return soup
    return _read_by_assimp(path)


def _read_binary_stl(path: Path) -> Soup | None:
    """None where the length does not fit the count in the header: then it is an STL in text."""
    data = read_mesh_bytes(path)
    count = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little")
    if len(data) != STL_HEADER + count * STL_FACE.itemsize:
        return None
    corners = np.frombuffer(data, STL_FACE, count, STL_HEADER)["corners"].astype(np.float64)
    return Soup(corners, np.full((count, 3), np.nan))


def _read_by_assimp(path: Path) -> Soup:
    vertices, faces = load_by_assimp(path)
    return Soup(vertices[faces], np.full((len(faces), 3), np.nan))


def load_mesh(path: Path, scale: tuple[float, float, float], default_rgb: tuple[float, float, float]) -> Mesh:
    """Read a mesh file and make it compact, or take it from the user's cache, where it was made before.

    Raises:
        RobotError: the file can't be read as a mesh.
    """
    key = hashlib.sha256(repr((CACHE_VERSION, path.suffix, scale, default_rgb)).encode())
    key.update(read_mesh_bytes(path))
    if (kept := recall("meshes", key.hexdigest())) is not None:
        return Mesh(kept["grid"], kept["centre"], float(kept["step"]), kept["faces"], kept["rgb"], bool(kept["closed"]))
    soup = read_soup(path)
    refuse_unsound(path, soup.corners)
    corners = soup.corners * np.array(scale)
    try:
        mesh = compact(Soup(corners[:, ::-1] if np.prod(scale) < 0.0 else corners, soup.rgb), default_rgb)
    except ValueError as reason:
        raise RobotError(f"mesh {path} can't be drawn ({reason}); export it anew", path=path) from None
    remember("meshes", key.hexdigest(), vars(mesh))
    return mesh
