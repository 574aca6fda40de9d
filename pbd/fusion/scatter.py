"""The hand's scatter from take to take, apart from the tracker's own uncertainty: variance components.

Marginal likelihood (the unknowns integrated out) with log-normal priors, by Fisher scoring; the factor of the tracker's
covariance has an inverse chi-square prior about one, and its average information.

Sources: D. A. Harville, Maximum likelihood approaches to variance component estimation, JASA 72 (1977); A. R. Gilmour,
R. Thompson and B. R. Cullis, Average information REML, Biometrics 51 (1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array

HAND_M, HAND_RAD, HAND_SPREAD = 0.002, np.radians(2.0), 1.4
"""Prior of a hand's scatter: m along each axis, rad about each axis, and the sigma of their logarithms."""

DOCK_M, DOCK_RAD, DOCK_SPREAD = 0.0005, np.radians(0.2), 1.0
"""Prior of the scatter at the first keyframe, the dock: m, rad, and the sigma of their logarithms."""

LIKE_OTHERS_SPREAD = 0.5
"""Prior sigma of the logarithm of one keyframe's scatter along one axis, about the scatter of all keyframes."""

TRACKER_WORTH = 1.0
"""Degrees of freedom of the prior that the tracker's covariance is right (factor 1). Chosen from 1, 3 and 10: with 1
the fused sigmas were honest for two, four and eight takes of simulated WT901, phone and OS5000."""

LARGEST_STEP = 1.0
"""Largest change of a logarithm in one step."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Standard deviations of the hand.

    Attributes:
        group: (J, 6) which of them holds for a keyframe's position (m) and turn (rad), along nav's axes.
        log: (g,) their logarithms.
        mean, spread: (g,) of the prior of those.
        unsure: (g,) spread of the logarithms as found.
        tracker: by which the tracker's own covariance is multiplied.
        worth: degrees of freedom that this is worth; infinite: it is held.
    """

    group: NDArray[np.intp]
    log: Array
    mean: Array
    spread: Array
    unsure: Array
    tracker: float = 1.0
    worth: float = np.inf

    @property
    def sigma(self) -> Array:
        """(J, 6) m and rad."""
        return np.asarray(np.exp(self.log)[self.group])

    @property
    def sigma_log(self) -> Array:
        """(J, 6) how sure that is: one sigma of its logarithm."""
        return self.unsure[self.group]

    def improved(self, precision: Array, weighted: Array, rows: NDArray[np.intp], drift: Array) -> Scatter:
        """A step of Fisher scoring.

        Args:
            precision: (N, N) of the residuals, the unknowns integrated out.
            weighted: (N,) precision times the residuals.
            rows: (N,) which standard deviation a residual has.
            drift: (N, N) the tracker's covariance, multiplied already.
        """
        count, variance = len(self.log), np.exp(2.0 * self.log)
        of = np.eye(count)[rows]  # (N, g)
        # Where a variance is too large the likelihood bends more than is expected, by its gradient: Fisher's step alone
        # would be too far, and go to and fro.
        by_data = variance * (of.T @ (weighted**2 - np.diagonal(precision)))
        gradient = by_data - (self.log - self.mean) / self.spread**2
        information = 2.0 * np.outer(variance, variance) * (of.T @ precision**2 @ of) + np.diag(self.spread**-2.0)
        covariance = np.linalg.inv(information)
        bent = information + np.diag(np.maximum(-2.0 * by_data, 0.0))
        step = np.clip(np.linalg.solve(bent, gradient), -LARGEST_STEP, LARGEST_STEP)
        found = replace(self, log=self.log + step, unsure=np.sqrt(np.diagonal(covariance)))
        if np.isinf(self.worth):
            return found
        drifted = drift @ weighted
        shown, due, prior = weighted @ drifted, (precision * drift).sum(), self.worth / self.tracker
        bent = drifted @ precision @ drifted + max(due - shown, 0.0) + prior
        step = np.clip((shown - due + prior - self.worth) / bent, -LARGEST_STEP, LARGEST_STEP)
        return replace(found, tracker=self.tracker * float(np.exp(step)))

    def change(self, before: Scatter) -> float:
        """Largest change of a logarithm."""
        return float(np.abs([*(self.log - before.log), np.log(self.tracker / before.tracker)]).max())


def alike(count: int) -> Scatter:
    """One scatter for all keyframes; the first, which is the dock, has its own."""
    group = np.tile(np.repeat((2, 3), 3), (count, 1))
    group[0] = np.repeat((0, 1), 3)
    mean = np.log((DOCK_M, DOCK_RAD, HAND_M, HAND_RAD))
    spread = np.array((DOCK_SPREAD, DOCK_SPREAD, HAND_SPREAD, HAND_SPREAD))
    return Scatter(group, mean, mean, spread, spread)


def each(found: Scatter) -> Scatter:
    """From that of all: each keyframe's own, of its position along each axis, of its turn."""
    count = len(found.group)
    group = np.arange(4 * count).reshape(count, 4)[:, (0, 1, 2, 3, 3, 3)]
    mean = found.log[found.group][:, :4].ravel()
    spread = np.full(4 * count, LIKE_OTHERS_SPREAD)
    return Scatter(group, mean, mean, spread, spread, found.tracker)
