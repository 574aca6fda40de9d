"""Rotations and poses. Quaternions are unit, wxyz; this file is the only door to and from xyzw and matrices.

The functions take arrays of quaternions, shape (..., 4), and broadcast. `Pose` is one element of SE(3).
A rotation `wxyz_a_b` turns coordinates in b into coordinates in a; so does a pose `T_a_b`, and touching names cancel:
`T_a_c = T_a_b @ T_b_c`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbd.errors import WrongValueError, require_kind
from pbd.frozen_arrays import Array as Array
from pbd.frozen_arrays import Frozen, numeric, readonly

ROUNDING = 1e-3
"""Largest error of an element of a rotation matrix that is taken for one: matrices are rounded to three decimals."""

CACHE_BYTES = 2**20
"""Typical size of a processor core's own cache, bytes."""


def lengths(vectors: ArrayLike) -> Array:
    """Norms of vectors, (..., k) -> (...). numpy's own norm takes several times as long for many short vectors."""
    vectors = np.asarray(vectors, dtype=np.float64)
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def skew(v: Array) -> Array:
    """Cross product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Cross products of vectors (..., 3). numpy's own takes several times as long."""
    (x, y, z), (u, v, w) = _components(a), _components(b)
    return _vectors(y * w - z * v, z * u - x * w, x * v - y * u)


def quat_multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product of (..., 4) and (..., 4): the rotation by b, then by a."""
    # With complex w + x i and y + z i a quaternion is (w + x i) + (y + z i) j, and j c = conj(c) j.
    (p, q), (r, s) = _complex_pair(a), _complex_pair(b)
    product = np.empty((*np.broadcast_shapes(p.shape, r.shape), 2), dtype=np.complex128)
    np.subtract(p * r, q * s.conj(), out=product[..., 0])
    np.add(p * s, q * r.conj(), out=product[..., 1])
    return product.view(np.float64)


def _complex_pair(wxyz: ArrayLike) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """w + x i and y + z i of quaternions (..., 4)."""
    pair = np.ascontiguousarray(wxyz, dtype=np.float64).view(np.complex128)
    return pair[..., 0], pair[..., 1]


def quat_inverse(wxyz: ArrayLike) -> Array:
    """Inverse of unit quaternions (..., 4)."""
    return np.asarray(np.asarray(wxyz, dtype=np.float64) * (1.0, -1.0, -1.0, -1.0))


def quat_cumulative(wxyz: ArrayLike) -> Array:
    """Cumulative products of unit quaternions (n, 4): row k is q0 q1 ... qk, from those of neighbouring pairs."""
    products = np.array(wxyz, dtype=np.float64)
    if len(products) > 1:
        products[1::2] = quat_cumulative(quat_multiply(products[:-1:2], products[1::2]))
        products[2::2] = quat_multiply(products[1:-1:2], products[2::2])
    return products


def quat_rotate(wxyz: ArrayLike, vector: ArrayLike) -> Array:
    """Rotate vectors (..., 3) by unit quaternions (..., 4)."""
    (w, x, y, z), (a, b, c) = _components(wxyz), _components(vector)
    # vector + w t + xyz x t, with t twice the cross product of xyz and the vector
    t, u, v = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return _vectors(a + w * t + (y * v - z * u), b + w * u + (z * t - x * v), c + w * v + (x * u - y * t))


def _components(values: ArrayLike) -> list[Array]:
    """Columns of the last axis; contiguous copies beyond the cache's size, where strided ones are 4 times as slow."""
    array = np.asarray(values, dtype=np.float64)
    if array.nbytes > CACHE_BYTES:
        return list(np.ascontiguousarray(np.moveaxis(array, -1, 0)))
    return [array[..., i] for i in range(array.shape[-1])]


def _vectors(*components: Array) -> Array:
    """Stack components along a new last axis; each stays contiguous, with which numpy is several times as fast."""
    stacked = np.array(components)
    return stacked.transpose(*range(1, stacked.ndim), 0)


def quat_exp(rotation_vector: ArrayLike) -> Array:
    """Unit quaternions of rotation vectors (..., 3) in rad."""
    half = 0.5 * np.asarray(rotation_vector, dtype=np.float64)
    angle = np.maximum(lengths(half), 1e-99)[..., None]  # of such a small angle, sine and angle are equal
    return np.concatenate((np.cos(angle), half * (np.sin(angle) / angle)), axis=-1)


def quat_log(wxyz: ArrayLike) -> Array:
    """Rotation vectors (..., 3) in rad, of length at most pi, of unit quaternions (..., 4)."""
    q = quat_canonical(wxyz)
    sine = lengths(q[..., 1:])[..., None]
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    # angle / sine -> 2 as sine -> 0; below 1e-12 the quotient is 2 to the last bit
    return np.asarray(q[..., 1:] * np.where(sine < 1e-12, 2.0, angle / np.maximum(sine, 1e-12)))


def matrix_log(matrix: Array) -> Array:
    """Rotation vectors (..., 3) in rad of rotation matrices (..., 3, 3) with angles below pi."""
    sine = np.empty(matrix.shape[:-1])
    for i, (j, k) in enumerate(((2, 1), (0, 2), (1, 0))):
        sine[..., i] = 0.5 * (matrix[..., j, k] - matrix[..., k, j])
    length = lengths(sine)
    angle = np.arctan2(length, 0.5 * (np.trace(matrix, axis1=-2, axis2=-1) - 1.0))
    return np.asarray(sine * (angle / np.maximum(length, 1e-99))[..., None])


def quat_canonical(wxyz: ArrayLike) -> Array:
    """Return the same rotations with unit norm and w >= 0, as they are stored."""
    q: Array = np.asarray(wxyz, dtype=np.float64)
    sign: Array = np.where(q[..., 0] < 0.0, -1.0, 1.0)
    return np.asarray(q * (sign / lengths(q))[..., None])


def quat_continuous(q: Array) -> Array:
    """Return the same rotations (n, 4), in either order, with the signs that bring each nearest to the one before."""
    flips = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0
    return np.asarray(q * np.cumprod(np.append(1.0, np.where(flips, -1.0, 1.0)))[:, None])


def quat_slerp(start: ArrayLike, end: ArrayLike, fraction: ArrayLike) -> Array:
    """Interpolate at constant angular rate, by at most pi: ends (4,) or (n, 4), fractions (n,) in 0..1 -> (n, 4)."""
    turn = quat_log(quat_multiply(quat_inverse(start), end))
    return quat_multiply(start, quat_exp(np.asarray(fraction, dtype=np.float64)[..., None] * turn))


def quat_to_matrix(wxyz: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3); their columns are the rotated axes."""
    w, x, y, z = _components(wxyz)
    x2, y2, z2 = 2.0 * x, 2.0 * y, 2.0 * z
    rows = _vectors(
        *(1.0 - y * y2 - z * z2, x * y2 - w * z2, x * z2 + w * y2),
        *(x * y2 + w * z2, 1.0 - x * x2 - z * z2, y * z2 - w * x2),
        *(x * z2 - w * y2, y * z2 + w * x2, 1.0 - x * x2 - y * y2),
    )
    return np.ascontiguousarray(rows).reshape(*w.shape, 3, 3)


def quat_from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternions, w >= 0, of rotation matrices (..., 3, 3) (Bar-Itzhack's choice of the largest component)."""
    m = np.asarray(matrix, dtype=np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    zy, yz = m[..., 2, 1], m[..., 1, 2]
    xz, zx = m[..., 0, 2], m[..., 2, 0]
    yx, xy = m[..., 1, 0], m[..., 0, 1]
    # Row k is 4 q_k q; the row with the largest q_k is the best conditioned one.
    wx, wy, wz, yx, zx, zy = zy - yz, xz - zx, yx - xy, yx + xy, xz + zx, zy + yz
    rows = _vectors(
        *(1 + xx + yy + zz, wx, wy, wz),
        *(wx, 1 + xx - yy - zz, yx, zx),
        *(wy, yx, 1 - xx + yy - zz, zy),
        *(wz, zx, zy, 1 - xx - yy + zz),
    ).reshape(*xx.shape, 4, 4)
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    return quat_canonical(np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :])


def quat_from_rpy(rpy: ArrayLike) -> Array:
    """Unit quaternions of roll, pitch, yaw (..., 3) in rad: about x, then fixed y, then fixed z, as in URDF."""
    half = 0.5 * np.asarray(rpy, dtype=np.float64)
    (cr, cp, cy), (sr, sp, sy) = _components(np.cos(half)), _components(np.sin(half))
    w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
    y, z = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
    return quat_canonical(_vectors(w, x, y, z))


def quat_to_rpy(wxyz: ArrayLike) -> Array:
    """Roll, pitch, yaw (..., 3) in rad of unit quaternions. Pitch is within pi/2; at either end of it yaw is zero."""
    w, x, y, z = np.moveaxis(np.asarray(wxyz, dtype=np.float64), -1, 0)
    sine = np.clip(2.0 * (w * y - z * x), -1.0, 1.0)
    at_pole = np.abs(sine) > 1.0 - 1e-14  # there roll and yaw turn about one axis
    roll = np.where(at_pole, 2.0 * np.arctan2(x, w), np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    yaw = np.where(at_pole, 0.0, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return np.stack((roll, np.arcsin(sine), yaw), axis=-1)


def quat_from_xyzw(xyzw: ArrayLike) -> Array:
    """Reorder (..., 4) from the scalar-last order of ROS, scipy and pinocchio."""
    return quat_canonical(np.take(np.asarray(xyzw, dtype=np.float64), (3, 0, 1, 2), axis=-1))


def quat_to_xyzw(wxyz: ArrayLike) -> Array:
    """Reorder (..., 4) to the scalar-last order of ROS, scipy and pinocchio."""
    return np.take(np.asarray(wxyz, dtype=np.float64), (1, 2, 3, 0), axis=-1)


def yaw_toward(wxyz_measured: ArrayLike, wxyz_wanted: ArrayLike) -> float:
    """Yaw in rad, -pi to pi, that brings one rotation closest to another: wanted ~ Rz(yaw) measured.

    It maximises the scalar part of measured * wanted^-1 * Rz(yaw), which has a closed form.
    """
    w, _, _, z = quat_canonical(quat_multiply(wxyz_wanted, quat_inverse(wxyz_measured)))
    return float(2.0 * np.arctan2(z, w))


def quat_about_z(yaw: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of rotations about z by `yaw` (...) rad."""
    return quat_exp(np.multiply.outer(np.asarray(yaw, dtype=np.float64), (0.0, 0.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Pose(Frozen):
    """A rigid transform T_a_b: b's position in a, in metres, and the rotation from b to a.

    Attributes:
        p: (3,) position in metres.
        wxyz: (4,) unit quaternion, w >= 0 (normalised on the way in).
    """

    p: Array
    wxyz: Array

    def __post_init__(self) -> None:
        p, wxyz = numeric("Pose.p", self.p), numeric("Pose.wxyz", self.wxyz)
        if p.shape != (3,) or wxyz.shape != (4,):
            raise WrongValueError(f"a pose takes p (3,) and wxyz (4,), got {p.shape} and {wxyz.shape}")
        norm = np.linalg.norm(wxyz)
        if not (np.isfinite(p).all() and np.isfinite(norm) and norm > 1e-9):
            raise WrongValueError(f"a pose must be finite with a nonzero quaternion, got p {p} and wxyz {wxyz}")
        object.__setattr__(self, "p", p)
        object.__setattr__(self, "wxyz", readonly(quat_canonical(wxyz)))

    @staticmethod
    def identity() -> Pose:
        """No translation, no rotation."""
        return Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @staticmethod
    def from_rpy(p: ArrayLike, rpy: ArrayLike) -> Pose:
        """From a position in metres and roll, pitch, yaw in rad."""
        return Pose(np.asarray(p), quat_from_rpy(rpy))

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Pose:
        """From a homogeneous (4, 4) matrix; WrongValueError: it has another shape, or its axes are no rotation."""
        m = numeric("the matrix of a pose", matrix)
        if m.shape != (4, 4):
            raise WrongValueError(f"a pose takes a (4, 4) matrix, got one of {m.shape}")
        pose = Pose(m[:3, 3], quat_from_matrix(m[:3, :3]))
        if not np.allclose(pose.matrix(), m, atol=ROUNDING):
            raise WrongValueError(f"the matrix of a pose must have a rotation and a last row of 0, 0, 0, 1, got {m}")
        return pose

    @staticmethod
    def exp(twist: ArrayLike) -> Pose:
        """From (6,): translation in metres, then rotation vector in rad, independently (not the screw exponential)."""
        twist = np.asarray(twist, dtype=np.float64)
        return Pose(twist[:3], quat_exp(twist[3:]))

    def log(self) -> Array:
        """(6,): translation in metres, then rotation vector in rad; the inverse of `exp`."""
        return np.concatenate((self.p, quat_log(self.wxyz)))

    def matrix(self) -> Array:
        """Homogeneous (4, 4)."""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = quat_to_matrix(self.wxyz), self.p
        return m

    def inverse(self) -> Pose:
        """T_b_a of T_a_b."""
        wxyz = quat_inverse(self.wxyz)
        return Pose(-quat_rotate(wxyz, self.p), wxyz)

    def act(self, points: ArrayLike) -> Array:
        """Coordinates in a of points (..., 3) given in b, metres."""
        return quat_rotate(self.wxyz, points) + self.p

    def __matmul__(self, other: Pose) -> Pose:
        require_kind("the right side of @", other, "a Pose (T.act moves points)", isinstance(other, Pose))
        return Pose(self.act(other.p), quat_multiply(self.wxyz, other.wxyz))

    def distance(self, other: Pose) -> tuple[float, float]:
        """Distance between two poses in the same frame: metres, rad."""
        turn = quat_log(quat_multiply(quat_inverse(self.wxyz), other.wxyz))
        return float(np.linalg.norm(self.p - other.p)), float(np.linalg.norm(turn))


def level_onto(own: Pose, wanted: Pose) -> Pose:
    """Return the yaw and translation, as a pose, that bring `own` to `wanted`'s position, nearest to its attitude."""
    turn = quat_about_z(yaw_toward(own.wxyz, wanted.wxyz))
    return Pose(wanted.p - quat_rotate(turn, own.p), turn)
