"""Where a demonstration's tip stood, and how its errors hang together: what is a move's own, what all moves share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.calibration.accelerometer import PRIOR_BIAS, PRIOR_LEAN, PRIOR_SCALE
from pbd.calibration.gyro import PRIOR as PRIOR_GYRO
from pbd.data import GRAVITY, Keyframe
from pbd.data.freeze import freeze
from pbd.pose import Array, quat_inverse, quat_log, quat_multiply, quat_rotate, quat_to_matrix

USUAL_SIZE = 0.02
"""Of a cheap sensor's own errors, as a bias over g: 20 mg, a tilt of one degree."""

LEAST_SHARE = 1e-3
"""Of a move's variance, what is its own at the least: no difference of two large figures is trusted further."""

_MATRIX = (np.eye(3) * (PRIOR_SCALE - PRIOR_LEAN) + PRIOR_LEAN).ravel()
SHAPE = np.concatenate((np.full(3, PRIOR_BIAS / GRAVITY), _MATRIX, np.full(9, PRIOR_GYRO))) * GRAVITY / PRIOR_BIAS
"""(21,) how large an accelerometer's bias over g, the nine of its matrix and the nine of a gyro's are to each other, as
the makers of such parts let expect."""


@dataclass(frozen=True, eq=False)
class Touches:
    """Where a demonstration's tip stood when it touched points.

    Attributes:
        p_nav_sensor: (m, 3) m, in the order of time.
        lever: (m, 3) m, from the sensor to the tip, in nav.
        cov: (3 m, 3 m) m2, of the tips' positions, without what is in `common`.
        common: (3 m, 21) m, by how much each is off for each of the sensor's own errors, whose size is not known but
            the same all along.
        stops: (m,) indices.
    """

    p_nav_sensor: Array
    lever: Array
    cov: Array
    common: Array
    stops: tuple[int, ...]

    def __post_init__(self) -> None:
        m = len(self.stops)
        freeze(self, p_nav_sensor=(m, 3), lever=(m, 3), cov=(3 * m, 3 * m), common=(3 * m, 21))

    def covariance(self, size: float = USUAL_SIZE) -> Array:
        """Of the tips' positions, (3 m, 3 m) m2, for a size of the sensor's own errors."""
        common = size * self.common
        cov: Array = self.cov + common @ common.T
        return cov

    def only(self, keep: Sequence[int]) -> Touches:
        """Some of them."""
        rows = rows_of(keep)
        return Touches(
            self.p_nav_sensor[list(keep)],
            self.lever[list(keep)],
            self.cov[np.ix_(rows, rows)],
            self.common[rows],
            tuple(self.stops[k] for k in keep),
        )


def rows_of(keep: Sequence[int]) -> NDArray[np.intp]:
    """The rows of some touches in a matrix that has three for each."""
    rows: NDArray[np.intp] = (3 * np.asarray(keep)[:, None] + np.arange(3)).ravel()
    return rows


def touches(keyframes: Sequence[Keyframe], stops: Sequence[int], p_sensor_tip: Array, stretch: float = 0.0) -> Touches:
    """Where the tip stood at some stops.

    What is each move's own adds up, so that the errors at two stops have in common what arose up to the earlier one:
    cov(j, k) = cov of the earlier. The attitude's errors turn the lever at each stop. What the sensor's own errors do
    to every move is shared by all (`common_errors`): with `stretch` it is taken out of the moves' own.

    Args:
        keyframes: all of a path that is not conditioned on known places.
        stops: indices of those that touch a point, in the points' order.
        p_sensor_tip: (3,) m, the tip in sensor axes.
        stretch: of the path; 0 leaves everything with the moves.
    """
    touched = [keyframes[k] for k in stops]
    m = len(touched)
    own = _own_variance(keyframes, stretch)
    cov = np.zeros((m, 3, m, 3))
    for j in range(m):
        for k in range(m):
            cov[j, :, k] = own[min(stops[j], stops[k])]
    lever = np.array([quat_rotate(keyframe.T_nav_sensor.wxyz, p_sensor_tip) for keyframe in touched])
    for k, keyframe in enumerate(touched):
        swing = np.cross(np.eye(3), lever[k]).T  # lever moves by turn x lever
        cov[k, :, k] += swing @ keyframe.cov[3:, 3:] @ swing.T
    p = np.array([keyframe.T_nav_sensor.p for keyframe in touched])
    common = common_errors(keyframes, p_sensor_tip)[list(stops)]
    return Touches(p, lever, cov.reshape(3 * m, 3 * m), common.reshape(3 * m, 21), tuple(stops))


def _own_variance(keyframes: Sequence[Keyframe], stretch: float) -> Array:
    """(k, 3, 3) m2, of the position at each keyframe, by what is each move's own."""
    p = np.array([keyframe.T_nav_sensor.p for keyframe in keyframes])
    cov = np.array([keyframe.cov[:3, :3] for keyframe in keyframes])
    moves = np.diff(cov, axis=0, prepend=np.zeros((1, 3, 3)))
    shared = stretch**2 * (np.diff(p, axis=0, prepend=p[:1]) ** 2).sum(axis=1)
    left = moves - shared[:, None, None] * np.eye(3)
    held = np.linalg.eigvalsh(left)[:, 0] < LEAST_SHARE * np.linalg.eigvalsh(moves)[:, 0]
    return np.cumsum(np.where(held[:, None, None], LEAST_SHARE * moves, left), axis=0)


def common_errors(keyframes: Sequence[Keyframe], p_sensor_tip: Array) -> Array:
    """By how much the tip is off at each keyframe, (k, 3, 21) m, for each of a sensor's errors.

    With b the accelerometer's bias over g and M the errors of its matrix, in sensor axes, it reads (1 + M) f + g b. At
    a rest in the attitude R the vertical z seems to lie along z + R c with c = b + M R^T z: the attitude is turned by
    -z x R c, and with it a move's displacement d and the lever. And the move's own acceleration is off, so that d is by
    R M R^T d. R is the mean of those at both rests, so that a sensor that is turned on its way has other errors then.

    With G the errors of the gyro's matrix, a turn w in sensor axes from rest to rest adds z . R G w to the heading,
    about which the rests say nothing and a magnetometer is slow: that turns all later displacements and levers.

    Unit errors are scaled by the priors of `accelerometer.py` and `gyro.py`, a bias over g of 1 being the unit.
    """
    wxyz = np.array([keyframe.T_nav_sensor.wxyz for keyframe in keyframes])
    R = quat_to_matrix(wxyz)
    p = np.array([keyframe.T_nav_sensor.p for keyframe in keyframes])
    d = np.diff(p, axis=0, prepend=p[:1])
    halfway = 0.5 * (R + np.roll(R, 1, axis=0))  # of the first, d is 0
    by_matrix = np.einsum("kab,kcd,kc->kabd", halfway, halfway, d).reshape(-1, 3, 9)  # of M's element b, d
    turns = quat_log(quat_multiply(quat_inverse(np.roll(wxyz, 1, axis=0)), wxyz))
    turns[0] = 0.0
    added = np.einsum("kb,kd->kbd", halfway[:, 2], turns).reshape(-1, 9)
    heading = np.cumsum(added, axis=0)
    lever = R @ p_sensor_tip
    errors = np.concatenate(
        (
            np.cumsum(_leaning(d, halfway) + np.pad(by_matrix, ((0, 0), (0, 0), (3, 0))), axis=0) + _leaning(lever, R),
            np.cumsum(_turning(d, heading - 0.5 * added), axis=0) + _turning(lever, heading),
        ),
        axis=2,
    )
    return np.asarray(errors * SHAPE)


def _leaning(vectors: Array, R: Array) -> Array:
    """(k, 3, 12), of vectors (k, 3) m and attitudes (k, 3, 3): the columns (-z x R c) x v for each b and M."""
    turns = -np.cross((0.0, 0.0, 1.0), R, axisb=1, axisc=1)
    by_bias = np.cross(turns, vectors[:, :, None], axisa=1, axisb=1, axisc=1)
    by_matrix = np.einsum("kab,kd->kabd", by_bias, R[:, 2]).reshape(-1, 3, 9)
    return np.concatenate((by_bias, by_matrix), axis=2)


def _turning(vectors: Array, heading: Array) -> Array:
    """(k, 3, 9), of vectors (k, 3) m and how the heading depends on each G (k, 9)."""
    columns: Array = np.cross((0.0, 0.0, 1.0), vectors)[:, :, None] * heading[:, None]
    return columns
