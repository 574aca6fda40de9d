"""Our values as meshcat's commands: compact meshes, and animations whose keys are typed arrays.

Meshcat's own Python classes send float32 vertices and one dictionary per animation key. Its viewer also reads these
smaller forms (three.js r129: BufferGeometryLoader, AnimationClip.parse).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import NDArray

from pbd.pose import Array, quat_to_xyzw
from pbd.view.compact_mesh import Mesh

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # meshcat's own import of zmq raises one
    from meshcat import Visualizer
    from meshcat.geometry import Geometry, MeshPhongMaterial
    from meshcat.geometry import Mesh as MeshcatMesh
    from meshcat.path import Path as ScenePath

__all__ = ["ScenePath", "Visualizer"]  # for others, who would have to suppress the warning too

EXTENSION_CODES = {
    "Uint8Array": 0x12,
    "Int16Array": 0x13,
    "Uint16Array": 0x14,
    "Uint32Array": 0x16,
    "Float32Array": 0x17,
}
"""Extension types of typed arrays in msgpack-lite, which meshcat's page uses."""

LEAST_SIGMA_M = 5e-5
"""Smallest sigma, m, of a drawn ellipsoid: the page can't read a rotation from the matrix of a flat one."""


def typed(values: NDArray[Any], kind: str) -> umsgpack.Ext:
    """Encode an array, flattened by rows, as a JavaScript typed array `kind`."""
    dtype = kind.removesuffix("Array").lower()
    return umsgpack.Ext(EXTENSION_CODES[kind], np.ascontiguousarray(values, dtype=dtype).tobytes())


class MeshGeometry(Geometry):  # type: ignore[misc]  # meshcat has no types
    """A `Mesh` as meshcat's geometry; its colours become linear light, which the page's renderer expects."""

    def __init__(self, mesh: Mesh) -> None:
        super().__init__()
        self.mesh = mesh

    def intrinsic_transform(self) -> Array:
        """Transform from the grid to metres, transposed, as meshcat flattens by rows what three.js reads by columns."""
        T = np.diag([self.mesh.step] * 3 + [1.0])
        T[:3, 3] = self.mesh.centre
        return T.T

    def lower(self, object_data: object) -> dict[str, Any]:
        """Return three.js' JSON."""
        index = "Uint16Array" if len(self.mesh.grid) < 2**16 else "Uint32Array"
        return {
            "uuid": self.uuid,
            "type": "BufferGeometry",
            "data": {
                "attributes": {
                    "position": _attribute(self.mesh.grid, "Int16Array", normalized=False),
                    "color": _attribute(linear_light(self.mesh.rgb), "Uint8Array", normalized=True),
                },
                "index": {"type": index, "array": typed(self.mesh.faces, index)},
            },
        }


def _attribute(values: NDArray[Any], kind: str, normalized: bool) -> dict[str, Any]:
    return {"itemSize": 3, "type": kind, "array": typed(values, kind), "normalized": normalized}


def linear_light(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert sRGB to linear light (IEC 61966-2-1), 8 bits each."""
    c = rgb / 255.0
    light = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * light).astype(np.uint8)


def scene_object(mesh: Mesh, opacity: float = 1.0) -> MeshcatMesh:
    """Make an object for `Visualizer.set_object` from a mesh, in the mesh's own colours; opacity in 0..1."""
    side = 0 if mesh.closed else 2  # three.js' FrontSide, DoubleSide
    material = MeshPhongMaterial(vertexColors=True, opacity=opacity, side=side, shininess=30, specular=0x1C1C1C)
    thing = MeshcatMesh(MeshGeometry(mesh), material)
    # These names need only differ within one object. Fixed ones give the same bytes for the same scene.
    thing.geometry.uuid, thing.material.uuid, thing.uuid = "geometry", "material", "mesh"
    return thing


def two_sigma_transform(p: Array, cov: Array) -> Array:
    """Return the matrix (4, 4) from the unit ball to the ellipsoid of two sigma of cov (3, 3) m2 about p (3,) m."""
    variance, axes = np.linalg.eigh(cov)
    axes[:, 0] *= np.sign(np.linalg.det(axes))  # a rotation, not a reflection
    T = np.eye(4)
    T[:3, :3] = 2.0 * axes * np.sqrt(np.maximum(variance, LEAST_SIGMA_M**2))
    T[:3, 3] = p
    return T


def is_still(values: Array) -> bool:
    """Whether values (n, k) over time, m or a quaternion's components, are too alike to be animated."""
    return bool(np.ptp(values, axis=0).max() < 1e-9)


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Poses of a node of the scene in its parent, at times t (n,) s: p (n, 3) m, wxyz (n, 4)."""

    path: ScenePath
    t: Array
    p: Array
    wxyz: Array

    def lower(self) -> dict[str, Any]:
        """Return meshcat's animation of one node; a constant position or rotation has one key."""
        tracks = [
            self._keys("position", "vector3", self.p),
            self._keys("quaternion", "quaternion", quat_to_xyzw(self.wxyz)),
        ]
        return {"path": self.path.lower(), "clip": {"fps": 1, "name": "default", "tracks": tracks}}

    def _keys(self, name: str, kind: str, values: Array) -> dict[str, Any]:
        t, values = (self.t[:1], values[:1]) if is_still(values) else (self.t, values)
        return {
            "name": f".{name}",
            "type": kind,
            "times": typed(t, "Float32Array"),
            "values": typed(values, "Float32Array"),
        }


@dataclass(frozen=True)
class SetTracks:
    """The command that loads an animation. The page itself advances the time."""

    tracks: Sequence[PoseTrack]

    def lower(self) -> Mapping[str, Any]:
        """Return meshcat's command."""
        animations = [track.lower() for track in self.tracks]
        return {
            "type": "set_animation",
            "animations": animations,
            "options": {"play": False, "repetitions": 1},
            "path": "",
        }
