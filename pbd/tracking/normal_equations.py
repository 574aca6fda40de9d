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

    def add_shared(
        self, block: slice, columns: slice, at: slice, jacobian: Array, residual: Array, weight: Array
    ) -> None:
        """What a factor on the knots `at` adds by shared unknowns: its Jacobian by them is (., 3, c)."""
        weighted = weight[:, None, None] * jacobian
        self.border[at, block, columns] += weighted
        self.corner[columns, columns] += np.tensordot(weighted, jacobian, axes=((0, 1), (0, 1)))
        self.g_shared[columns] += np.tensordot(weighted, residual, axes=((0, 1), (0, 1)))

    def add_legs(self, jacobian: Array, at: int = 0) -> None:
        """A factor from each knot, from the one `at`, to the next: (., r, 15 + 15 + s + 1) whitened, residual last."""
        shared = jacobian[:, :, 2 * STATE :]
        corner = np.tensordot(shared, shared, axes=((0, 1), (0, 1)))
        self.corner += corner[:-1, :-1]
        self.g_shared += corner[:-1, -1]
        end = at + len(jacobian)
        for knots, first in ((slice(at, end), 0), (slice(at + 1, end + 1), STATE)):
            own = jacobian[:, :, first : first + STATE].transpose(0, 2, 1)
            self.diagonal[knots] += own @ jacobian[:, :, first : first + STATE]
            by_shared = own @ shared
            self.border[knots] += by_shared[:, :, :-1]
            self.g[knots] += by_shared[:, :, -1]
        self.below[at:end] += own @ jacobian[:, :, :STATE]

    def solve(self) -> Solved:
        """Factorise."""
        from scipy.linalg import cholesky_banded
        from scipy.linalg.lapack import dtbtrs

        m, s = len(self.g), len(self.g_shared)
        # Jacobi scaling: rotations and metres differ by six orders of magnitude.
        scale = 1.0 / np.sqrt(np.diagonal(self.diagonal, axis1=1, axis2=2))
        diagonal = self.diagonal * (scale[:, :, None] * scale[:, None, :]) + ROUNDING * np.eye(STATE)
        below = self.below * (scale[1:, :, None] * scale[:-1, None, :])
        # Column by column what lies below the diagonal: in rows one longer each column begins one later.
        rows = np.zeros((m, STATE * (3 * STATE + 1)))
        columns = rows[:, :-STATE].reshape(m, STATE, 3 * STATE)
        columns[:, :, :STATE], columns[:-1, :, STATE : 2 * STATE] = diagonal, below.transpose(0, 2, 1)
        band = rows.reshape(m, STATE, -1)[:, :, : 2 * STATE].reshape(m * STATE, 2 * STATE).T
        cholesky = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        right = np.empty((s + 1, m, STATE))
        right[:s], right[s] = self.border.transpose(2, 0, 1), self.g
        right *= scale
        # Half the way down: L^-1 of border and gradient.
        half, _ = dtbtrs(cholesky, right.reshape(s + 1, -1).T, uplo="L", overwrite_b=True)
        product = half.T @ half
        shared: Array = np.asarray(np.linalg.inv(self.corner - product[:s, :s]), dtype=np.float64)
        d_shared = -shared @ (self.g_shared - product[:s, s])
        d, _ = dtbtrs(cholesky, -half[:, s] - half[:, :s] @ d_shared, uplo="L", trans="T")
        return Solved(d.reshape(m, STATE) * scale, d_shared, cholesky, scale, half[:, :s], shared)


@dataclass(frozen=True, eq=False)
class Solved:
    """The step (m, 15) and (s,), and the covariance, as far as somebody asks.

    Attributes:
        d, d_shared: the step to the minimum.
        cholesky: (30, m * 15), of the chain's Hessian scaled to a unit diagonal, banded.
        scale: (m, 15).
        half: (m * 15, s), the inverse of that factor times the border.
        shared: (s, s), covariance of the shared unknowns.
    """

    d: Array
    d_shared: Array
    cholesky: Array
    scale: Array
    half: Array
    shared: Array

    @cached_property
    def by_shared(self) -> Array:
        """How the knots go with the shared unknowns, less its sign, (m, 15, s)."""
        from scipy.linalg.lapack import dtbtrs

        solved, _ = dtbtrs(self.cholesky, self.half, uplo="L", trans="T")
        by_shared: Array = solved.reshape(*self.scale.shape, -1) * self.scale[:, :, None]
        return by_shared

    def columns(self, right: Array) -> Array:
        """Covariance of all knots' unknowns times columns: (m, 15, k) -> (m, 15, k)."""
        from scipy.linalg import cho_solve_banded

        m, _, k = right.shape
        scaled = (right * self.scale[:, :, None]).reshape(m * STATE, k)
        own = cho_solve_banded((self.cholesky, True), scaled, check_finite=False).reshape(m, STATE, k)
        border = np.tensordot(self.by_shared, right, axes=((0, 1), (0, 1)))
        columns: Array = own * self.scale[:, :, None] + self.by_shared @ (self.shared @ border)
        return columns

    @cached_property
    def _selected(self) -> tuple[Array, Array]:
        """Blocks of the chain's own inverse: of each knot (m, 15, 15), of the next by this (m - 1, 15, 15).

        With L's blocks D on the diagonal and B below, and G = B D^-1: S = (D D^T)^-1 + G^T S' G from the last back.
        """
        m = len(self.scale)
        rows = np.zeros((m, STATE * (3 * STATE + 1)))
        rows.reshape(m, STATE, -1)[:, :, : 2 * STATE] = self.cholesky.T.reshape(m, STATE, 2 * STATE)
        columns = rows[:, :-STATE].reshape(m, STATE, 3 * STATE)
        D, B = columns[:, :, :STATE].transpose(0, 2, 1), columns[:-1, :, STATE : 2 * STATE].transpose(0, 2, 1)
        root = np.linalg.inv(D)
        gain, inverse = B @ root[:-1], root.transpose(0, 2, 1) @ root
        for S, S_next, G in zip(inverse[-2::-1], inverse[:0:-1], gain[::-1], strict=True):
            S += G.T @ S_next @ G
        lower = -inverse[1:] @ gain
        here, after = self.scale[:-1, None, :], self.scale[1:, :, None]
        return inverse * (self.scale[:, :, None] * self.scale[:, None, :]), lower * (after * here)

    def of_knots(self) -> Array:
        """Covariance of each knot's unknowns, (m, 15, 15)."""
        covariance: Array = self._selected[0] + self.by_shared @ self.shared @ self.by_shared.transpose(0, 2, 1)
        return covariance

    def of_pairs(self, jacobian: Array) -> Array:
        """Covariance (m - 1, r, r) of what depends on two neighbours and the shared unknowns, (., r, 15 + 15 + s)."""
        own, lower = self._selected
        this, after = jacobian[:, :, :STATE], jacobian[:, :, STATE : 2 * STATE]
        by = this @ self.by_shared[:-1] + after @ self.by_shared[1:] - jacobian[:, :, 2 * STATE :]
        cross = after @ lower @ this.transpose(0, 2, 1)
        covariance: Array = by @ self.shared @ by.transpose(0, 2, 1) + cross + cross.transpose(0, 2, 1)
        for part, of_part in ((this, own[:-1]), (after, own[1:])):
            covariance += part @ of_part @ part.transpose(0, 2, 1)
        return covariance
