"""Rotations about fixed axes: the canonical subproblems of Elias and Wen ("IK-Geo", 2022), for many angles at once.

They extend those of Paden and Kahan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel
from pbd.lazy import cached_property
from pbd.pose import Array

PARALLEL, INTERSECTING_M = 1e-3, 1e-3
"""Largest sine of the angle between parallel axes; largest distance between intersecting axes, m."""
TINY = 1e-12
"""Least denominator: v or n may lie along the axis."""


@dataclass(eq=False)
class Axis:
    """A joint's axis in base with all joints at zero: its direction h (3,), and a point p (3,) on it, m."""

    h: Array
    p: Array

    @cached_property
    def K(self) -> Array:
        """(3, 3): v @ K is the cross product h x v."""
        return np.cross(self.h, np.eye(3))

    def rotate(self, by: tuple[Array, Array], v: Array) -> Array:
        """Rotate v (..., 3) by angles (...); `by`: `sines` of them."""
        across = v @ self.K
        rotated: Array = v + by[0] * across + by[1] * (across @ self.K)
        return rotated

    def unrotate(self, by: tuple[Array, Array], v: Array) -> Array:
        """Rotate v (..., 3) by the negative angles."""
        return self.rotate((-by[0], by[1]), v)

    def align(self, v: Array, w: Array) -> Array:
        """Return the angles (...) that rotate v (..., 3) nearest to w (..., 3)."""
        across = v @ self.K
        angle: Array = np.arctan2(_dot(across, w), -_dot(across @ self.K, w))
        return angle

    def to_plane(self, n: Array, v: Array, d: Array) -> tuple[Array, Array]:
        """Return the two angles (2, ...) with n . rotated(v) = d (...), and their shortfall (...), rad.

        If no angle solves it, the nearest is returned. The shortfall is the imaginary part of the complex solution.
        """
        across = v @ self.K
        a, b = -(across @ self.K) @ n, across @ n
        cosine = (d - v @ n + a) / np.maximum(np.hypot(a, b), TINY)
        half, middle = np.arccos(np.clip(cosine, -1.0, 1.0)), np.arctan2(b, a)
        return np.stack((middle + half, middle - half)), np.arccosh(np.maximum(np.abs(cosine), 1.0))

    def to_distance(self, upper: Array, fore: Array, reach: Array) -> tuple[Array, Array]:
        """Return the angles with |upper + rotated(fore)| = |reach|, for vectors (..., 3), m, as `to_plane` does."""
        return self.to_plane(upper, fore, 0.5 * (_dot(reach, reach) - upper @ upper - fore @ fore))

    def crossing(self, other: Axis) -> Array | None:
        """Return the point (3,) of intersection with another axis, m; None if they do not intersect."""
        normal = np.cross(self.h, other.h)
        square, off = float(normal @ normal), other.p - self.p
        if square < PARALLEL**2 or abs(off @ normal) > INTERSECTING_M * math.sqrt(square):
            return None
        place: Array = other.p + other.h * float(np.cross(off, self.h) @ normal) / square
        return place

    def is_parallel(self, other: Axis) -> bool:
        """Whether it is parallel to another axis, in either direction."""
        return bool(np.linalg.norm(np.cross(self.h, other.h)) < PARALLEL)


def axes_of(arm: ArmModel) -> tuple[list[Axis], pin.SE3]:
    """Return the axes of an arm, and T_base_tool, with all joints at zero."""
    model, data = arm.model, arm.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    h = pin.computeJointJacobians(model, data, pin.neutral(model))[3:].T
    axes = [Axis(h[i].copy(), data.oMi[i + 1].translation.copy()) for i in range(len(h))]
    return axes, data.oMf[arm.tool_id].copy()


def sines(q: Array) -> tuple[Array, Array]:
    """Return the sine and the versine, 1 - cos, (..., 1) of angles (...)."""
    return np.sin(q)[..., None], (1.0 - np.cos(q))[..., None]


def _dot(v: Array, w: Array) -> Array:
    dot: Array = np.einsum("...i,...i", v, w)
    return dot


def wrap_to_limits(arm: ArmModel, q: Array) -> Array:
    """Turn joints (..., k) by whole turns to be nearest to the middle of their limits."""
    lower, upper = arm.limits.lower, arm.limits.upper
    middle = np.where(np.isfinite(upper - lower), 0.5 * (np.maximum(lower, -1e3) + np.minimum(upper, 1e3)), 0.0)
    nearest: Array = q - 2.0 * np.pi * np.round((q - middle) / (2.0 * np.pi))
    return nearest
