"""Rotations about fixed axes, many at a time: the canonical subproblems of Elias and Wen ("IK-Geo", 2022).

They are after Paden and Kahan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel
from pbd.pose import Array

PARALLEL, TOGETHER_M = 1e-3, 1e-3
"""Sine of the angle between parallel axes at most; distance of crossing ones at most, m."""
TINY = 1e-12
"""Keeps a ratio finite where a joint has no influence."""


@dataclass(eq=False)
class Axis:
    """A joint's axis with all joints at zero, in base: its direction h (3,), a point on it p (3,) m."""

    h: Array
    p: Array

    @cached_property
    def K(self) -> Array:
        """(3, 3): v @ K is the cross product h x v."""
        return np.cross(self.h, np.eye(3))

    def turn(self, by: tuple[Array, Array], v: Array) -> Array:
        """Turn vectors (..., 3) by angles (...) given by their `sines`."""
        return _turned(self.K, by, v)

    def back(self, by: tuple[Array, Array], v: Array) -> Array:
        """Turn them the other way."""
        return _turned(self.K.T, by, v)

    def align(self, v: Array, w: Array) -> Array:
        """Angles (...) that turn v nearest to w; both (..., 3)."""
        across = v @ self.K
        angle: Array = np.arctan2(_dot(across, w), -_dot(across @ self.K, w))
        return angle

    def meet(self, n: Array, v: Array, d: Array) -> tuple[Array, Array]:
        """Angles (2, ...) with n . turned(v) = d (...), to both sides; and by how much they fall short, rad.

        Where no angle solves it, the nearest is given; the shortfall is the imaginary part of the complex solution.
        """
        across = v @ self.K
        a, b = -(across @ self.K) @ n, across @ n
        cosine = (d - v @ n + a) / np.maximum(np.hypot(a, b), TINY)
        half, middle = np.arccos(np.clip(cosine, -1.0, 1.0)), np.arctan2(b, a)
        return np.stack((middle + half, middle - half)), np.arccosh(np.maximum(np.abs(cosine), 1.0))

    def bend(self, upper: Array, fore: Array, reach: Array) -> tuple[Array, Array]:
        """Angles with |upper + turned(fore)| = |reach|, of vectors (..., 3) m; returned as by `meet`."""
        return self.meet(upper, fore, 0.5 * (_dot(reach, reach) - upper @ upper - fore @ fore))

    def crossing(self, other: Axis) -> Array | None:
        """Point (3,) m where it crosses another axis; None where it doesn't."""
        normal = np.cross(self.h, other.h)
        square, off = float(normal @ normal), other.p - self.p
        if square < PARALLEL**2 or abs(off @ normal) > TOGETHER_M * math.sqrt(square):
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
    """Sine, and one less the cosine, (..., 1) of angles (...)."""
    return np.sin(q)[..., None], (1.0 - np.cos(q))[..., None]


def _turned(K: Array, by: tuple[Array, Array], v: Array) -> Array:
    across = v @ K
    turned: Array = v + by[0] * across + by[1] * (across @ K)
    return turned


def _dot(v: Array, w: Array) -> Array:
    dot: Array = np.einsum("...i,...i", v, w)
    return dot


def within_turns(arm: ArmModel, q: Array) -> Array:
    """Turn joints (..., k) by whole turns to where they are nearest to the middle of their limits."""
    lower, upper = arm.limits.lower, arm.limits.upper
    middle = np.where(np.isfinite(upper - lower), 0.5 * (np.maximum(lower, -1e3) + np.minimum(upper, 1e3)), 0.0)
    nearest: Array = q - 2.0 * np.pi * np.round((q - middle) / (2.0 * np.pi))
    return nearest


def beyond(arm: ArmModel, q: Array) -> Array:
    """How far (...) joints (..., k) are beyond their limits at most, rad; negative within."""
    farthest: Array = np.maximum(arm.limits.lower - q, q - arm.limits.upper).max(axis=-1)
    return farthest
