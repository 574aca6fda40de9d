"""Mesh files as coloured triangles, read by trimesh and pycollada, with a cache of results computed from them.

Only the file itself is opened: no texture, no material library, no URL. DAE files are read by pycollada directly: their
colours are used, and a small file can describe a scene without end, so its size is checked here.
"""

import hashlib
import io
import json
import logging
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.cache import recall, remember
from pbd.errors import RobotError, no_library_warnings, printable
from pbd.io.atomic import is_file
from pbd.io.read_file import read_bytes
from pbd.pose import Array

MESH_SUFFIXES = (".dae", ".stl", ".obj", ".ply", ".glb")

MOST_TRIANGLES = 4_000_000
"""Largest number of triangles of a mesh. A small DAE or GLB file can repeat one geometry any number of times."""

MOST_NODES = 20_000
"""Largest number of nodes of a DAE or GLB scene; a node that is shown n times counts n times."""

LARGEST_COORDINATE = 1e6
"""Largest coordinate of a mesh, in the file's unit: a kilometre in mm."""

_VERSION = 6
"""Part of the cache's keys. Raise it when the code makes other triangles, hulls or drawings of the same file."""


@dataclass(frozen=True, eq=False)
class TriangleSoup:
    """Triangles: corners (m, 3, 3); sRGB colours (m, 3) in 0..1, NaN where the file has no colour."""

    corners: Array
    rgb: Array


def mesh_places(address: str, urdf: Path, package_dirs: Sequence[Path]) -> list[Path]:
    """Return the paths that a URDF's package:// (Gazebo: model://), file:// or relative address may mean.

    A package is a folder in one of package_dirs, or one of package_dirs itself.
    """
    scheme, _, path = address.rpartition("://")
    if scheme not in ("package", "model"):
        return [urdf.parent / address.removeprefix("file://")]
    inside = Path(path.lstrip("/"))
    places = [folder / inside for folder in package_dirs]
    places += [folder.parent / inside for folder in package_dirs if inside.parts[:1] == (folder.name,)]
    return list(dict.fromkeys(places))


def mesh_file(address: str, urdf: Path, package_dirs: Sequence[Path]) -> Path:
    """Return the first path of `mesh_places` that exists, else the first one: opening it raises the error."""
    places = mesh_places(address, urdf, package_dirs) or [Path(address)]
    return next((place for place in places if is_file(place)), places[0])


def from_mesh(
    path: Path, what: str, make: Callable[[TriangleSoup], Mapping[str, Any]], *options: object
) -> dict[str, NDArray[Any]]:
    """Return `make(triangles)` for a mesh file, from the user's cache where possible.

    The triangles are in the file's unit (DAE: metres). The cache's key is a hash of the file's bytes and the options.

    Args:
        what: the result's name ("hulls") and folder in the cache.
        make: computes named arrays.
        options: other values on which the result depends.

    Raises:
        RobotError: the file can't be read, has no face or too many, or a coordinate is not finite or too large.
    """
    data = read_bytes(path, RobotError, "put it there, or correct its address in the URDF", most=200_000_000)
    key = hashlib.sha256(repr((_VERSION, path.suffix, *options)).encode() + data).hexdigest()
    if (kept := recall(what, key)) is None:
        kept = {name: np.asarray(value) for name, value in make(_parse(path, data)).items()}
        remember(what, key, kept)
    return kept


def mesh_triangles(path: Path, scale: Sequence[float]) -> Array:
    """Read a mesh's triangles (m, 3, 3), scaled along x, y, z; raises as `from_mesh`."""
    triangles: Array = from_mesh(path, "triangles", lambda soup: {"corners": soup.corners})["corners"] * scale
    return triangles


def rounded_points(triangles: Array, step_m: float) -> Array:
    """Return the different corners (n, 3) of triangles, rounded to multiples of `step_m`, in ascending order."""
    steps = np.rint(triangles.reshape(-1, 3) / step_m)
    steps = steps[np.lexsort(steps.T[::-1])]  # np.unique with an axis takes ten times as long
    different = np.append(True, (steps[1:] != steps[:-1]).any(axis=1))
    points: Array = steps[different] * step_m
    return points


def _parse(path: Path, data: bytes) -> TriangleSoup:
    kind = path.suffix.lower()
    try:
        with np.errstate(all="ignore"), no_library_warnings():  # pycollada uses numpy's deprecated matrices
            parts = list(_collada(data) if kind == ".dae" else _trimesh(data, kind))
    except Exception as reason:  # the libraries have no error types of their own
        why = printable(" ".join(str(reason).split()))
        raise RobotError(f"mesh {path} can't be read ({why}); convert it to STL", path=path) from None
    if not sum(len(corners) for corners, _ in parts):
        raise RobotError(f"mesh {path} has no face; convert it to STL anew", path=path)
    corners, rgb = (np.concatenate(each) for each in zip(*parts, strict=True))
    if not (np.abs(corners) <= LARGEST_COORDINATE).all():
        raise RobotError(f"mesh {path} has a vertex that is not a number or too far away; export it anew", path=path)
    return TriangleSoup(corners, rgb)


def _trimesh(data: bytes, kind: str) -> Iterator[tuple[Array, Array]]:
    if kind not in MESH_SUFFIXES:
        raise ValueError(f"it is none of {', '.join(MESH_SUFFIXES)}")
    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else trimesh prints tracebacks of handled errors
    # A scene applies the poses of a GLB's parts. From bytes, trimesh can't open other files.
    if kind == ".glb":
        _refuse_swelling(json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")]))
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], process=False)
    shown = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
    _refuse_many(len(shown), sum(len(getattr(mesh, "faces", ())) for mesh in shown))
    for mesh in scene.dump():
        corners = np.asarray(getattr(mesh, "triangles", np.empty((0, 3, 3))), dtype=np.float64)
        if corners.shape[1:] != (3, 3):
            raise ValueError("a vertex has not three coordinates")
        yield corners, np.full((len(corners), 3), np.nan)


def _refuse_swelling(glb: Any) -> None:
    """Refuse a GLB whose parts take more memory than its bytes do: they may share values, or have none in the file."""
    parts = [part for mesh in glb.get("meshes", ()) for part in mesh["primitives"]]
    used = [at for part in parts for at in (*part["attributes"].values(), part.get("indices")) if at is not None]
    _refuse_many(len(parts), sum(glb["accessors"][at]["count"] for at in used) // 3)


def _refuse_many(nodes: int, triangles: int) -> None:
    for count, most, what in ((nodes, MOST_NODES, "nodes"), (triangles, MOST_TRIANGLES, "triangles")):
        if count > most:
            raise ValueError(f"more than {most} {what}")


def _collada(data: bytes) -> Iterator[tuple[Array, Array]]:
    """Yield corners and colours of each part. Like other URDF tools, apply the file's unit and ignore its up_axis."""
    if b"<!DOCTYPE" in data:
        raise ValueError("a DOCTYPE is not allowed")
    import collada

    @cache
    def node_count(node: Any) -> int:
        return 1 + sum(map(node_count, getattr(node, "children", ())))

    try:
        document = collada.Collada(io.BytesIO(data))
    except collada.common.DaeBrokenRefError:  # often of a camera, a light or a texture: read the geometry alone
        document = collada.Collada(io.BytesIO(_without_looks(data)))
    _refuse_many(sum(node_count(node) for scene in document.scenes for node in scene.nodes), 0)
    unit = document.assetInfo.unitmeter
    count = 0
    for geometry in (each for scene in document.scenes for each in scene.objects("geometry")):
        inside_out = np.linalg.det(geometry.matrix[:3, :3]) < 0.0
        for primitive in geometry.primitives():
            triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            if not isinstance(triangles, collada.triangleset.BoundTriangleSet) or triangles.vertex is None:
                continue  # lines are not drawn
            index = triangles.vertex_index[:, ::-1] if inside_out else triangles.vertex_index
            _refuse_many(0, count := count + len(index))
            corners = np.asarray(triangles.vertex, dtype=np.float64)[index]
            yield (1.0 if unit is None else unit) * corners, np.tile(_diffuse(triangles.material), (len(index), 1))


def _without_looks(data: bytes) -> bytes:
    """Remove from a DAE file what only concerns its looks."""
    looks = {"bind_material", "instance_camera", "instance_light"}
    looks |= {"library_effects", "library_images", "library_materials"}
    root = ET.fromstring(data)
    for element in [*root.iter()]:
        for child in [*element]:
            if child.tag.rpartition("}")[2] in looks:
                element.remove(child)
    return ET.tostring(root)


def _diffuse(material: Any) -> Array:
    """Return RGB in 0..1; NaN without a colour or with a texture, which pycollada would call black."""
    effect = getattr(material, "effect", None)
    if effect is None or effect.xmlnode.find(".//{*}diffuse/{*}color") is None:
        return np.full(3, np.nan)
    return np.array(effect.diffuse[:3], dtype=np.float64)
