"""Mesh files as coloured triangles, read by trimesh and pycollada, with a cache of what is computed from them.

Nothing but the file itself is opened: no texture, no material library, no address. DAE files, the only ones whose
colours are used, go to pycollada directly: a small one can describe a scene without end, which is bounded here.
"""

from __future__ import annotations

import hashlib
import io
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.cache import recall, remember
from pbd.errors import RobotError, printable
from pbd.io.atomic import is_file
from pbd.io.read_file import read_bytes
from pbd.pose import Array

FORMATS = (".dae", ".stl", ".obj", ".ply", ".glb")

MOST_BYTES = 200_000_000
"""Largest mesh file: four million triangles of a binary STL."""

MOST_TRIANGLES = 4_000_000
"""Most triangles of a mesh: a small DAE file can show one geometry any number of times."""

MOST_NODES = 20_000
"""Most nodes of a DAE scene, counted each time that one is shown."""

LARGEST = 1e6
"""Largest coordinate of a mesh, in its own unit: a kilometre in mm."""

_VERSION = 6
"""Part of the cache's keys: raise it when the same file would give other triangles, hulls or drawings."""


@dataclass(frozen=True, eq=False)
class Soup:
    """Loose triangles: corners (m, 3, 3); rgb (m, 3) in 0..1 as displayed, NaN where the file has no colour."""

    corners: Array
    rgb: Array


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
    """Return the first place that exists, else the first one, so that opening it raises the error."""
    places = mesh_places(address, urdf, package_dirs) or [Path(address)]
    return next((place for place in places if is_file(place)), places[0])


def from_mesh(
    path: Path, what: str, make: Callable[[Soup], Mapping[str, Any]], *options: object
) -> dict[str, NDArray[Any]]:
    """Make something of a mesh file's triangles (in its unit; DAE: metres), or take it from the user's cache.

    There it is kept by the file's bytes.

    Args:
        what: the name of what is made ("hull"); it stands for how it is made.
        make: makes it, as named arrays.
        options: what else the result follows from.

    Raises:
        RobotError: it can't be read, has no face or too many, or a vertex is no sound number.
    """
    data = read_bytes(path, RobotError, "put it there, or correct its address in the URDF", MOST_BYTES)
    key = hashlib.sha256(repr((_VERSION, path.suffix, *options)).encode() + data).hexdigest()
    if (kept := recall(what, key)) is None:
        kept = {name: np.asarray(value) for name, value in make(_parse(path, data)).items()}
        remember(what, key, kept)
    return kept


def mesh_triangles(path: Path, scale: Sequence[float]) -> Array:
    """Read a mesh's triangles (m, 3, 3), scaled; raises as `from_mesh`."""
    triangles: Array = from_mesh(path, "triangles", lambda soup: {"corners": soup.corners})["corners"] * scale
    return triangles


def _parse(path: Path, data: bytes) -> Soup:
    kind = path.suffix.lower()
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pycollada uses numpy's old matrices
            parts = list(_collada(data) if kind == ".dae" else _trimesh(data, kind))
    except Exception as reason:  # what the libraries raise has no type of their own
        why = printable(" ".join(str(reason).split()))
        raise RobotError(f"mesh {path} can't be read ({why}); convert it to STL", path=path) from None
    if not sum(len(corners) for corners, _ in parts):
        raise RobotError(f"mesh {path} has no face; convert it to STL anew", path=path)
    corners, rgb = (np.concatenate(each) for each in zip(*parts, strict=True))
    if not (np.abs(corners) <= LARGEST).all():
        raise RobotError(f"mesh {path} has a vertex that is not a number or too far away; export it anew", path=path)
    return Soup(corners, rgb)


def _trimesh(data: bytes, kind: str) -> Iterator[tuple[Array, Array]]:
    if kind not in FORMATS:
        raise ValueError(f"it is none of {', '.join(FORMATS)}")
    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints tracebacks of what it recovers from
    # A scene, so that the parts of a GLB are placed; without a path, so that it opens no other file.
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], process=False)
    for mesh in scene.dump():
        corners = np.asarray(getattr(mesh, "triangles", np.empty((0, 3, 3))), dtype=np.float64)
        if corners.shape[1:] != (3, 3):
            raise ValueError("a vertex has not three coordinates")
        yield corners, np.full((len(corners), 3), np.nan)


def _collada(data: bytes) -> Iterator[tuple[Array, Array]]:
    """As the tools around URDF do, it ignores up_axis and obeys the unit."""
    if b"<!DOCTYPE" in data:
        raise ValueError("a DOCTYPE is not allowed")
    import collada

    @cache
    def shown(node: Any) -> int:
        return 1 + sum(map(shown, getattr(node, "children", ())))

    document = collada.Collada(io.BytesIO(data))
    if sum(shown(node) for scene in document.scenes for node in scene.nodes) > MOST_NODES:
        raise ValueError(f"more than {MOST_NODES} nodes")
    unit = document.assetInfo.unitmeter
    count = 0
    for geometry in (each for scene in document.scenes for each in scene.objects("geometry")):
        inside_out = np.linalg.det(geometry.matrix[:3, :3]) < 0.0
        for primitive in geometry.primitives():
            triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            if not isinstance(triangles, collada.triangleset.BoundTriangleSet) or triangles.vertex is None:
                continue  # lines
            index = triangles.vertex_index[:, ::-1] if inside_out else triangles.vertex_index
            if (count := count + len(index)) > MOST_TRIANGLES:
                raise ValueError(f"more than {MOST_TRIANGLES} triangles")
            corners = np.asarray(triangles.vertex, dtype=np.float64)[index]
            yield (1.0 if unit is None else unit) * corners, np.tile(_diffuse(triangles.material), (len(index), 1))


def _diffuse(material: Any) -> Array:
    """RGB in 0..1, NaN where there is none: pycollada calls that, and a texture that is missing, black."""
    effect = getattr(material, "effect", None)
    if effect is None or effect.xmlnode.find(".//{*}diffuse/{*}color") is None:
        return np.full(3, np.nan)
    return np.array(effect.diffuse[:3], dtype=np.float64)
