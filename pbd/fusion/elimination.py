"""Least squares of takes, whose unknowns are eliminated part by part (Schur complements): time is linear in takes.

A take's own unknowns are in its residuals only, a device's errors in those of its takes, the keyframes in all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.lazy import cached_property
from pbd.pose import Array


@dataclass(frozen=True, eq=False)
class Part:
    """Unknowns that are eliminated at once.

    Attributes:
        rows: the residuals that depend on them.
        at: their columns; parts without common residuals have the same ones.
        information, gradient: (c, c) and (c,), of their prior.
    """

    rows: slice | NDArray[np.intp]
    at: slice
    information: Array
    gradient: Array


@dataclass(frozen=True, eq=False)
class Precision:
    """Inverse covariance (N, N) of the residuals of K takes, with the unknowns marginalised out; never stored whole.

    Attributes:
        weights: that of each take's residuals, given all unknowns.
        parts: the unknowns of the K takes, then those that takes share, in later columns.
        low: (N, C); a part takes away its rows and columns of it, times their transpose.
    """

    weights: Sequence[Array]
    parts: Sequence[Part]
    low: Array

    @cached_property
    def blocks(self) -> list[Array]:
        """The block of each take's residuals."""
        low = [self.low[part.rows] for part in self.parts]
        return [W - one @ one.T for W, one in zip(self.weights, low, strict=False)]

    def within_take(self, i: NDArray[np.intp]) -> Array:
        """Return rows and columns i (n,) of one take's residuals."""
        ends = np.cumsum([len(W) for W in self.weights])
        k = int(np.searchsorted(ends, i[0], side="right"))
        own = i - ends[k]  # from the end
        return np.asarray(self.weights[k][np.ix_(own, own)] - self.low[i] @ self.low[i].T)

    def times(self, vector: Array) -> Array:
        """Return its product with a vector (N,)."""
        product = by_take(self.weights, vector)
        for part in self.parts:
            low = self.low[part.rows, part.at]
            product[part.rows] -= low @ (low.T @ vector[part.rows])
        return product

    def squares(self, members: Array) -> Array:
        """Return the sums (g, g) of its squared elements over groups of residuals; members (N, g) are 1, others 0."""
        sums, blocks = np.zeros(2 * members.shape[1:]), self.blocks
        for part, block in zip(self.parts, blocks, strict=False):
            later, own = self.low[part.rows, part.at.stop :], members[part.rows]
            sums += own.T @ (block**2 - (later @ later.T) ** 2) @ own
        for part in self.parts[len(blocks) :]:  # squares of sums: each part's with itself, and twice with later ones
            low, later = self.low[part.rows, part.at], self.low[part.rows, part.at.stop :]
            low_later = np.hstack((low, np.sqrt(2.0) * later))
            products = np.empty((len(sums), low.shape[1] * low_later.shape[1]))
            for product, own in zip(products, members[part.rows].T > 0.0, strict=True):
                product[:] = (low[own].T @ low_later[own]).ravel()
            sums += products @ products.T
        return sums


@dataclass(frozen=True, eq=False)
class Solved:
    """Step and covariance of each part's unknowns, residuals (N,) after the step, the fall of chi-square."""

    steps: Sequence[Array]
    covs: Sequence[Array]
    residuals: Array
    fall: float
    precision: Precision


def solve(parts: Sequence[Part], weights: Sequence[Array], J: Array, r: Array) -> Solved:
    """Solve for residuals r (N,) with Jacobian J (N, C); for parts and weights see `Precision`."""
    WJ, Wr, low = by_take(weights, J), by_take(weights, r), np.empty_like(J)
    roots, towards = list[Array](), list[Array]()
    for part in parts:
        rows, at, later = part.rows, part.at, slice(part.at.stop, None)
        root = np.linalg.inv(np.linalg.cholesky(J[rows, at].T @ WJ[rows, at] + part.information))
        toward = root @ (J[rows, at].T @ Wr[rows] + part.gradient)
        low[rows, at] = own = WJ[rows, at] @ root.T
        WJ[rows, later] -= own @ (own.T @ J[rows, later])
        Wr[rows] -= own @ toward
        roots.append(root)
        towards.append(toward)
    # A part's errors are these columns times independent errors of variance 1; the last column is its step.
    fitted, columns = np.zeros((len(r), J.shape[1] + 1)), list[Array]()
    for part, root, toward in zip(parts[::-1], roots[::-1], towards[::-1], strict=True):
        right = low[part.rows, part.at].T @ fitted[part.rows]
        right[:, part.at] = np.eye(len(root))
        right[:, -1] += toward
        columns.insert(0, -root.T @ right)
        fitted[part.rows] += J[part.rows, part.at] @ columns[0]
    covs = [one[:, :-1] @ one[:, :-1].T for one in columns]
    fall = sum(float(toward @ toward) for toward in towards)
    return Solved([one[:, -1] for one in columns], covs, r + fitted[:, -1], fall, Precision(weights, parts, low))


def by_take(blocks: Sequence[Array], values: Array) -> Array:
    """Return the product of the takes' blocks along the diagonal with values (N,) or (N, c)."""
    ends = np.cumsum([len(block) for block in blocks])[:-1]
    return np.concatenate([block @ own for block, own in zip(blocks, np.split(values, ends), strict=True)])
