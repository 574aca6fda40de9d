"""Whether one shape lies wholly inside another whose mesh it doesn't touch: a surface alone would not tell."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np

from pbd.arm.audit_arm import Frame
from pbd.arm.audit_solids import Solid
from pbd.pose import Array


def is_inside(thing: Solid, T_base_thing: Frame, around: Solid, T_base_around: Frame) -> bool:
    """Whether a shape that doesn't touch a mesh is inside it; False of what isn't a mesh."""
    if not isinstance(around.exact, coal.BVHModelBase) or thing.floor:
        return False
    mesh = isinstance(thing.exact, coal.BVHModelBase)
    point = np.array(thing.exact.vertices()[0]) if mesh else thing.corners.mean(axis=0)
    return _turns_round((T_base_around.inverse() @ T_base_thing).act(point), _triangles(around.exact)) > 0.5


def _triangles(mesh: Any) -> Array:
    """Return (m, 3, 3) corners."""
    faces = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    return np.asarray(np.array(mesh.vertices())[np.array([(face[0], face[1], face[2]) for face in faces])])


def _turns_round(point: Array, triangles: Array) -> float:
    """How often a surface goes round a point (3,): its solid angles (Van Oosterom and Strackee, 1983) over 4 pi."""
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    dots = (np.einsum("ni,ni->n", one, other) for one, other in ((a, b), (b, c), (c, a)))
    ab, bc, ca = dots
    half = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return abs(float(half.sum())) / (2.0 * np.pi)
