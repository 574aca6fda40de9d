"""Normal equations of a chain of knots with a border of shared unknowns: block tridiagonal, and an arrow.

Unknowns of a knot are STATE numbers; the shared ones are common to all knots.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pbd.pose import Array

STATE = 15
ROT, VEL, POS, GYR_BIAS, ACC_BIAS = (slice(3 * i, 3 * i + 3) for i in range(5))
"""A knot's unknowns: rotation vector in nav (rad), velocity, position, biases."""

ROUNDING = 1e-12
"""Added to the scaled diagonal: what rounding may take from it."""

_LOW = np.tril_indices(STATE)
_ALL = np.indices((STATE, STATE)).reshape(2, -1)


@dataclass(eq=False)
class NormalEquations:
    """Half the Hessian and the gradient of a sum of squares; factors add to them.

    Attributes:
        diagonal: (m, 15, 15) of each knot.
        below: (m - 1, 15, 15), rows of the next knot and columns of this one.
        border: (m, 15, s), knots by shared unknowns.
        corner: (s, s).
        g: (m, 15) and g_shared (s,), gradients.
    """

    diagonal: Array
    below: Array
    border: Array
    corner: Array
    g: Array
    g_shared: Array

    @classmethod
    def empty(cls, knots: int, shared: int) -> NormalEquations:
        """No factor yet."""
        return cls(
            np.zeros((knots, STATE, STATE)),
            np.zeros((knots - 1, STATE, STATE)),
            np.zeros((knots, STATE, shared)),
            np.zeros((shared, shared)),
            np.zeros((knots, STATE)),
            np.zeros(shared),
        )

    def add_unary(self, block: slice, residual: Array, weight: Array) -> None:
        """A factor on each knot: (m, 3) residuals of a block of its state, (m,) weights."""
        i = np.arange(block.start, block.stop)
        self.diagonal[:, i, i] += weight[:, None]
        self.g[:, i] += weight[:, None] * residual

    def add_pairs(self, block: slice, residual: Array, weight: Array) -> None:
        """A factor on each two neighbours: (m - 1, 3) residuals, next less this, (m - 1,) weights."""
        i = np.arange(block.start, block.stop)
        weighted = weight[:, None] * residual
        self.diagonal[:-1, i, i] += weight[:, None]
        self.diagonal[1:, i, i] += weight[:, None]
        self.below[:, i, i] -= weight[:, None]
        self.g[:-1, i] -= weighted
        self.g[1:, i] += weighted

    def add_legs(self, jacobian: Array) -> None:
        """A factor from each knot to the next: (m - 1, r, 15 + 15 + s + 1) whitened, the residual last."""
        H = jacobian.transpose(0, 2, 1) @ jacobian
        this, after, shared = slice(0, STATE), slice(STATE, 2 * STATE), slice(2 * STATE, -1)
        self.diagonal[:-1] += H[:, this, this]
        self.diagonal[1:] += H[:, after, after]
        self.below += H[:, after, this]
        self.border[:-1] += H[:, this, shared]
        self.border[1:] += H[:, after, shared]
        self.corner += H[:, shared, shared].sum(axis=0)
        self.g[:-1] += H[:, this, -1]
        self.g[1:] += H[:, after, -1]
        self.g_shared += H[:, shared, -1].sum(axis=0)

    def solve(self) -> Solved:
        """Factorise."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        m, s = len(self.g), len(self.g_shared)
        # Jacobi scaling: rotations and metres differ by six orders of magnitude.
        scale = 1.0 / np.sqrt(self.diagonal[:, np.arange(STATE), np.arange(STATE)])
        diagonal = self.diagonal * scale[:, :, None] * scale[:, None, :] + ROUNDING * np.eye(STATE)
        below = self.below * scale[1:, :, None] * scale[:-1, None, :]
        band = np.zeros((2 * STATE, m, STATE))
        r, c = _LOW
        band[r - c, :, c] = diagonal[:, r, c].T
        r, c = _ALL
        band[STATE + r - c, :-1, c] = below[:, r, c].T
        cholesky = cholesky_banded(band.reshape(2 * STATE, -1), overwrite_ab=True, lower=True, check_finite=False)
        scaled = np.concatenate((self.border, self.g[:, :, None]), axis=2) * scale[:, :, None]
        flat = scaled.reshape(m * STATE, s + 1)
        solved = cho_solve_banded((cholesky, True), flat, check_finite=False)
        schur = self.corner - flat[:, :s].T @ solved[:, :s]
        shared: Array = np.asarray(np.linalg.inv(schur), dtype=np.float64)
        d_shared = -shared @ (self.g_shared - flat[:, :s].T @ solved[:, s])
        d = -(solved[:, s] + solved[:, :s] @ d_shared).reshape(m, STATE) * scale
        by_shared = solved[:, :s].reshape(m, STATE, s) * scale[:, :, None]
        return Solved(d, d_shared, diagonal, below, scale, np.asarray(cholesky, dtype=np.float64), by_shared, shared)


@dataclass(frozen=True, eq=False)
class Solved:
    """The step (m, 15) and (s,), and the covariance, as far as somebody asks.

    Attributes:
        d, d_shared: the step to the minimum.
        diagonal, below, scale: of the Hessian, scaled to a unit diagonal.
        cholesky: of that, banded.
        by_shared: (m, 15, s), how the knots go with the shared unknowns, less its sign.
        shared: (s, s), covariance of the shared unknowns.
    """

    d: Array
    d_shared: Array
    diagonal: Array
    below: Array
    scale: Array
    cholesky: Array
    by_shared: Array
    shared: Array

    def columns(self, right: Array) -> Array:
        """Covariance of all knots' unknowns times columns: (m, 15, k) -> (m, 15, k)."""
        from scipy.linalg import cho_solve_banded

        m, _, k = right.shape
        scaled = (right * self.scale[:, :, None]).reshape(m * STATE, k)
        own = cho_solve_banded((self.cholesky, True), scaled, check_finite=False).reshape(m, STATE, k)
        border = np.einsum("mis,mik->sk", self.by_shared, right)
        columns: Array = own * self.scale[:, :, None] + self.by_shared @ (self.shared @ border)
        return columns

    @cached_property
    def _selected(self) -> tuple[Array, Array]:
        """Blocks of the inverse of the scaled chain: of each knot (m, 15, 15), of the next by this (m - 1, 15, 15)."""
        m = len(self.diagonal)
        inverse, gain = np.empty_like(self.diagonal), np.empty_like(self.below)
        inverse[0] = np.linalg.inv(self.diagonal[0])
        for k in range(1, m):
            gain[k - 1] = self.below[k - 1] @ inverse[k - 1]
            inverse[k] = np.linalg.inv(self.diagonal[k] - gain[k - 1] @ self.below[k - 1].T)
        lower = np.empty_like(self.below)
        for k in range(m - 2, -1, -1):
            lower[k] = -inverse[k + 1] @ gain[k]
            inverse[k] -= gain[k].T @ lower[k]
        return inverse, lower

    def of_knots(self) -> Array:
        """Covariance of each knot's unknowns, (m, 15, 15)."""
        own = self._selected[0] * self.scale[:, :, None] * self.scale[:, None, :]
        covariance: Array = own + self.by_shared @ self.shared @ self.by_shared.transpose(0, 2, 1)
        return covariance

    def of_pairs(self) -> Array:
        """Covariance of the unknowns of each two neighbours and the shared ones, (m - 1, 30 + s, 30 + s)."""
        own, lower, m, s = *self._selected, len(self.scale), len(self.shared)
        joint = np.zeros((m - 1, 2 * STATE + s, 2 * STATE + s))
        joint[:, :STATE, :STATE], joint[:, STATE:-s, STATE:-s] = own[:-1], own[1:]
        joint[:, STATE:-s, :STATE], joint[:, :STATE, STATE:-s] = lower, lower.transpose(0, 2, 1)
        scale = np.concatenate((self.scale[:-1], self.scale[1:], np.zeros((m - 1, s))), axis=1)
        joint *= scale[:, :, None] * scale[:, None, :]
        by = np.concatenate(
            (self.by_shared[:-1], self.by_shared[1:], np.broadcast_to(-np.eye(s), (m - 1, s, s))), axis=1
        )
        joint += by @ self.shared @ by.transpose(0, 2, 1)
        return joint
