"""Normal equations of a chain of knots and of unknowns shared by all: block tridiagonal with a border (an arrow)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.lapack import lapack
from pbd.lazy import cached_property
from pbd.pose import Array

STATE_GYR_BIAS, STATE_ACC_BIAS = slice(9, 12), slice(12, 15)
STATE = STATE_ACC_BIAS.stop
"""A knot's unknowns: rotation vector in nav (rad), velocity, position, biases."""

NEXT_STATE = STATE_GYR_BIAS.start
"""Unknowns of a leg's second knot on which its motion depends: not the biases, whose walk is a factor of its own."""

BAND = STATE + NEXT_STATE
"""Width of the band: the unknowns of a leg's first knot, and NEXT_STATE of its second."""

KNOTS_AT_ONCE = 128
"""Number of knots or legs per batch. With all their samples they fit into a processor's cache."""

Term = tuple[int | None, slice, Array | float]
"""Part of a factor: its first knot (None: shared by all), a block of unknowns, and the Jacobians (k, r, .) by these, or
a multiple of the identity."""


@dataclass(eq=False)
class NormalEquations:
    """Gauss-Newton Hessian A^T W A and gradient A^T W r, to which factors are added.

    Attributes:
        diagonal: (m, 15, 15), the block of each knot.
        below: (m - 1, 15, 15), rows of the next knot, columns of this one.
        border: (m, 15, s + 1), rows of each knot, columns of the shared unknowns; the last column is the gradient.
        corner: (s, s + 1), the shared unknowns' own block and gradient.
    """

    diagonal: Array
    below: Array
    border: Array
    corner: Array

    @classmethod
    def empty(cls, knots: int, shared: int) -> NormalEquations:
        """Without any factor."""
        return cls(
            np.zeros((knots, STATE, STATE)),
            np.zeros((knots - 1, STATE, STATE)),
            np.zeros((knots, STATE, shared + 1)),
            np.zeros((shared, shared + 1)),
        )

    @property
    def g(self) -> Array:
        """Gradient (m, 15) with respect to the knots' unknowns."""
        return self.border[:, :, -1]

    def add(self, residual: Array, weight: Array, *terms: Term) -> None:
        """Add a factor of k knots, or of each of them and the next: residuals (k, r), weights (k,), and its terms."""
        k = len(residual)
        for first, rows, jacobian in terms:
            own = jacobian * np.eye(3)[None] if isinstance(jacobian, float) else jacobian
            weighted = weight[:, None, None] * own.transpose(0, 2, 1)
            for other, columns, by_other in (*terms, (None, slice(-1, None), residual[:, :, None])):
                if other is None:
                    block = self.corner if first is None else self.border[first : first + k]
                elif first is None or first < other:
                    continue
                else:
                    block = self.diagonal[first : first + k] if first == other else self.below[other : other + k]
                added = weighted * by_other if isinstance(by_other, float) else weighted @ by_other
                block[..., rows, columns] += added.sum(axis=0) if first is None else added

    def add_legs(self, jacobian: Array, at: int = 0) -> None:
        """Add legs that begin at the knots from `at` on: whitened Jacobian, residual last, (., r, 15 + 9 + s + 1)."""
        this, after, shared = jacobian[:, :, :STATE], jacobian[:, :, STATE:BAND], jacobian[:, :, BAND:]
        end = at + len(jacobian)
        self.corner += np.tensordot(shared[:, :, :-1], shared, axes=((0, 1), (0, 1)))
        own = this.transpose(0, 2, 1)
        self.diagonal[at:end] += own @ this
        self.border[at:end] += own @ shared
        own = after.transpose(0, 2, 1)
        self.diagonal[at + 1 : end + 1, :NEXT_STATE, :NEXT_STATE] += own @ after
        self.border[at + 1 : end + 1, :NEXT_STATE] += own @ shared
        self.below[at:end, :NEXT_STATE] += own @ this

    def solve(self) -> Solved:
        """Factorise by banded Cholesky, with the shared unknowns by their Schur complement."""
        m = len(self.diagonal)
        # Jacobi scaling: entries of rotations and of positions differ by six orders of magnitude.
        scale = 1.0 / np.sqrt(np.diagonal(self.diagonal, axis1=1, axis2=2))
        band = np.empty((m * STATE, BAND))
        for knots in batches(m):
            own, after = scale[knots], scale[knots.start + 1 : knots.stop + 1]
            # LAPACK wants each column from its diagonal on. Rows longer by one shift each column by one.
            rows = np.zeros((len(own), STATE * (BAND + STATE)))
            columns = rows[:, :-STATE].reshape(len(own), STATE, -1)
            np.multiply(self.diagonal[knots], own[:, :, None] * own[:, None, :], out=columns[:, :, :STATE])
            below = self.below[knots].transpose(0, 2, 1) * own[: len(after), :, None] * after[:, None, :]
            columns[: len(after), :, STATE : 2 * STATE] = below
            band[_rows(knots)] = rows.reshape(-1, BAND + STATE)[:, :BAND]
        band[:, 0] += 1e-12  # rounding must not make it indefinite
        cholesky, info = lapack().dpbtrf(band.T, lower=1, overwrite_ab=1)
        if info > 0:
            raise np.linalg.LinAlgError("the normal equations are not positive definite")
        # Forward substitution: L^-1 times border and gradient.
        half = np.empty((m * STATE, self.border.shape[2]), order="F")
        for knots in batches(m):
            at, right = _rows(knots), (self.border[knots] * scale[knots, :, None]).reshape(-1, half.shape[1])
            if at.start:
                before = slice(at.start - STATE, at.start)
                right[:STATE] -= _blocks(cholesky[:, before])[1][0] @ half[before]
            half[at], _ = lapack().dtbtrs(cholesky[:, at], right, uplo="L")
        return Solved.at_corner(cholesky, scale, half, self.corner)


@dataclass(frozen=True, eq=False)
class Solved:
    """The solution of normal equations: a step, and the covariance, which is computed when it is read.

    Attributes:
        d_shared: (s,), step of the shared unknowns.
        cholesky: (BAND, m * 15), banded Cholesky factor L of the chain's Hessian, scaled to a unit diagonal.
        scale: (m, 15), that scaling.
        half: (m * 15, s + 1), L^-1 times the scaled border and gradient.
        corner: (s, s + 1), that of the normal equations.
        shared: (s, s), covariance of the shared unknowns.
    """

    d_shared: Array
    cholesky: Array
    scale: Array
    half: Array
    corner: Array
    shared: Array

    @classmethod
    def at_corner(cls, cholesky: Array, scale: Array, half: Array, corner: Array) -> Solved:
        """Solve for the shared unknowns, given their own block and gradient."""
        schur = corner - (half.T @ half)[:-1]
        shared: Array = np.asarray(np.linalg.inv(schur[:, :-1]), dtype=np.float64)
        return cls(-shared @ schur[:, -1], cholesky, scale, half, corner, shared)

    @cached_property
    def d(self) -> Array:
        """Step (m, 15) of the knots' unknowns."""
        d, _ = lapack().dtbtrs(self.cholesky, -self.half @ np.append(self.d_shared, 1.0), uplo="L", trans="T")
        step: Array = d.reshape(self.scale.shape) * self.scale
        return step

    @cached_property
    def decrement(self) -> float:
        """Newton's decrement: no function of the unknowns changes in this step by more than so many of its sigmas."""
        shared = self.d_shared @ np.linalg.solve(self.shared, self.d_shared)
        return float(np.sqrt(np.square(self.half[:, -1]).sum() + shared))

    def plus(self, corner: Array) -> Solved:
        """The solution with more information and gradient (s, s + 1) on the shared unknowns."""
        return Solved.at_corner(self.cholesky, self.scale, self.half, self.corner + corner)

    def covariance_times(self, right: Array) -> Array:
        """The joint covariance of all knots times columns: (m, 15, k) -> (m, 15, k)."""
        m, _, k = right.shape
        scaled = (right * self.scale[:, :, None]).reshape(m * STATE, k)
        own = lapack().dpbtrs(self.cholesky, scaled, lower=1)[0].reshape(m, STATE, k)
        border = np.tensordot(self.by_shared, right, axes=((0, 1), (0, 1)))
        columns: Array = own * self.scale[:, :, None] + self.by_shared @ (self.shared @ border)
        return columns

    @cached_property
    def _factor(self) -> tuple[Array, Array]:
        """D^-1 (m, 15, 15) and B D^-1 (m - 1, 15, 15), with L's diagonal blocks D and the blocks B below them."""
        root, gain = np.empty((2, len(self.scale), STATE, STATE))
        for knots in batches(len(root)):
            D, B = _blocks(self.cholesky[:, _rows(knots)])
            root[knots] = np.linalg.inv(D)
            gain[knots] = B @ root[knots]
        return root, gain[:-1]

    @cached_property
    def by_shared(self) -> Array:
        """Minus the derivative (m, 15, s) of the knots' unknowns by the shared ones, by back substitution."""
        root, gain = self._factor
        by_shared: Array = root.transpose(0, 2, 1) @ self.half[:, :-1].reshape(len(root), STATE, -1)
        for here, after, G in zip(by_shared[-2::-1], by_shared[:0:-1], gain[::-1], strict=True):
            here -= np.dot(G.T, after)
        by_shared *= self.scale[:, :, None]
        return by_shared

    @cached_property
    def selected(self) -> tuple[Array, Array]:
        """Blocks of the chain's inverse Hessian: diagonal (m, 15, 15), and below the diagonal (m - 1, 15, 15).

        With G = B D^-1, and S' the next knot's block: S = (D D^T)^-1 + G^T S' G, from the last knot back.
        """
        root, gain = self._factor
        self.__dict__.pop("_factor")  # of a long recording it is large
        inverse = root.transpose(0, 2, 1) @ root
        for here, after, G in zip(inverse[-2::-1], inverse[:0:-1], gain[::-1], strict=True):
            here += np.dot(np.dot(G.T, after), G)
        inverse *= self.scale[:, :, None]
        lower = -inverse[1:] @ gain
        inverse *= self.scale[:, None, :]
        lower *= self.scale[:-1, None, :]
        return inverse, lower

    def forget(self) -> None:
        """Free the memory of the covariance. It is computed again when it is read."""
        for name in ("_factor", "selected", "by_shared"):
            self.__dict__.pop(name, None)

    def covariance_of_knots(self, block: slice = slice(None)) -> Array:
        """Covariance (m, k, k) of a block of each knot's unknowns."""
        by = self.by_shared[:, block]
        return self.selected[0][:, block, block] + by @ self.shared @ by.transpose(0, 2, 1)

    def covariance_of_changes(self, block: slice) -> Array:
        """Covariance (m - 1, k, k) of the change of a block of unknowns from each knot to the next."""
        own, lower = self.selected
        by, cross = np.diff(self.by_shared[:, block], axis=0), lower[:, block, block]
        covariance: Array = own[1:, block, block] + own[:-1, block, block] - cross - cross.transpose(0, 2, 1)
        return covariance + by @ self.shared @ by.transpose(0, 2, 1)

    def covariance_of_moves(self, knots: Sequence[int], block: slice) -> Array:
        """Covariance (k - 1, b, b) of the change of a block of unknowns from each of k knots to the next of these."""
        by, own = np.diff(self.by_shared[knots, block], axis=0), self.selected[0]
        gain, at, after = self._factor[1], knots[:-1], knots[1:]
        self.__dict__.pop("_factor")  # of a long recording it is large
        cross = own[after, block] / self.scale[after, None]
        for here, (begin, end) in zip(cross, pairwise(knots), strict=True):
            for G in gain[begin:end][::-1]:
                here[:] = -np.dot(here, G)
        cross = (cross * self.scale[at, None])[:, :, block]
        covariance: Array = own[after, block, block] + own[at, block, block] - cross - cross.transpose(0, 2, 1)
        return covariance + by @ self.shared @ by.transpose(0, 2, 1)

    def covariance_of_legs(self, jacobian: Array, at: int = 0) -> Array:
        """Covariance (., r, r) of functions of a leg's two knots and the shared unknowns, from the knot `at` on.

        `jacobian` (., r, 15 + 9 + s) has their derivatives with respect to these.
        """
        by_shared, (own, lower) = self.by_shared, self.selected
        end = at + len(jacobian)
        this, after = jacobian[:, :, :STATE], jacobian[:, :, STATE:BAND]
        by = this @ by_shared[at:end] + after @ by_shared[at + 1 : end + 1, :NEXT_STATE] - jacobian[:, :, BAND:]
        cross = after @ lower[at:end, :NEXT_STATE] @ this.transpose(0, 2, 1)
        covariance: Array = by @ self.shared @ by.transpose(0, 2, 1) + cross + cross.transpose(0, 2, 1)
        covariance += this @ own[at:end] @ this.transpose(0, 2, 1)
        covariance += after @ own[at + 1 : end + 1, :NEXT_STATE, :NEXT_STATE] @ after.transpose(0, 2, 1)
        return covariance


def batches(n: int) -> Iterator[slice]:
    """Slices that cut n knots or legs into batches."""
    return (slice(first, first + KNOTS_AT_ONCE) for first in range(0, n, KNOTS_AT_ONCE))


def _rows(knots: slice) -> slice:
    return slice(knots.start * STATE, knots.stop * STATE)


def _blocks(cholesky: Array) -> tuple[Array, Array]:
    """Blocks of L (BAND, m * 15) on and below the diagonal, (m, 15, 15) each."""
    m = cholesky.shape[1] // STATE
    rows = np.zeros((m, STATE * (BAND + STATE)))
    rows.reshape(m, STATE, -1)[:, :, :BAND] = cholesky.T.reshape(m, STATE, BAND)
    columns = rows[:, :-STATE].reshape(m, STATE, -1).transpose(0, 2, 1)
    return columns[:, :STATE], columns[:, STATE : 2 * STATE]
