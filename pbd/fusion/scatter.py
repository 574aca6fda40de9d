"""The hand's scatter from take to take, separated from the tracker's own uncertainty: variance components.

The scatter maximises the marginal likelihood (the unknowns integrated out) with log-normal priors, by Fisher scoring. A
factor of the tracker's covariance has an inverse chi-square prior about one, and uses the average information.

Sources: D. A. Harville, Maximum likelihood approaches to variance component estimation, JASA 72 (1977); A. R. Gilmour,
R. Thompson and B. R. Cullis, Average information REML, Biometrics 51 (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbd.data.calibration import DOCK_SIGMA_RAD
from pbd.fusion.elimination import Precision, by_take
from pbd.pose import Array

HAND_M, HAND_RAD, HAND_SPREAD = 0.002, np.radians(2.0), 1.4
"""Prior of a hand's scatter: m along each axis, rad about each axis, and the sigma of their logarithms."""

DOCK_M, DOCK_TILT, DOCK_SPREAD = 0.0005, np.radians(0.2), 1.0
"""Prior of the scatter at the first keyframe, the dock: m, rad of tilt, and the sigma of their logarithms. That of its
heading, which a table does not hold, is DOCK_SIGMA_RAD."""

LEVER_M = 0.005
"""Prior sigma of the sensor's shift in the hand between takes, m along each axis."""

KEYFRAME_SPREAD = 0.5
"""Prior sigma of the logarithm of one keyframe's scatter along one axis, about the scatter of all keyframes."""

TRACKER_FREEDOM = 1.0
"""Degrees of freedom of the prior that the tracker's covariance is right (factor 1). Chosen from 1, 3 and 10: with 1
the fused sigmas were honest for two, four and eight takes of simulated WT901, phone and OS5000."""

LARGEST_STEP = 1.0
"""Largest change of a logarithm in one step."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Standard deviations of the hand at J keyframes, in g groups that share one value.

    Attributes:
        group: (J, 6) index of the group of each component of a keyframe's position (m) and rotation (rad), in nav.
        log: (g,) logarithms of the standard deviations.
        prior_log, prior_spread: (g,) mean and sigma of their priors.
        log_sigma: (g,) one sigma of the logarithms as estimated.
        tracker: factor of the tracker's own covariance.
        tracker_freedom: degrees of freedom of that factor's prior; infinite holds the factor fixed.
        own_variances: of the levers (m2) and of H (rad2), see `pbd.fusion.joint_estimate`. They start at their priors:
            below, the dock's scatter would rise in their place.
    """

    group: NDArray[np.intp]
    log: Array
    prior_log: Array
    prior_spread: Array
    log_sigma: Array
    tracker: float = 1.0
    tracker_freedom: float = np.inf
    own_variances: tuple[float, float] = (LEVER_M**2, HAND_RAD**2)

    @property
    def sigma(self) -> Array:
        """Standard deviations (J, 6), m and rad."""
        return np.asarray(np.exp(self.log)[self.group])

    def improved(
        self, precision: Precision, weighted: Array, group: NDArray[np.intp], tracking: Sequence[Array]
    ) -> Scatter:
        """Return the scatter after a step of Fisher scoring.

        Args:
            precision: of the residuals.
            weighted: (N,) precision times the residuals.
            group: (N,) group of each residual.
            tracking: the tracker's covariance of each take's residuals, times the present factor.
        """
        count, variance = len(self.log), np.exp(2.0 * self.log)
        members, blocks = np.eye(count)[group], precision.blocks
        # Where a variance is too large, the likelihood's curvature exceeds Fisher's by its gradient. Then Fisher's step
        # alone would overshoot and oscillate.
        diagonal = np.concatenate([np.diagonal(block) for block in blocks])
        slope = variance * (members.T @ (weighted**2 - diagonal))
        gradient = slope - (self.log - self.prior_log) / self.prior_spread**2
        expected = 2.0 * np.outer(variance, variance) * precision.squares(members)
        information = expected + np.diag(self.prior_spread**-2.0)
        curvature = information + np.diag(np.maximum(-2.0 * slope, 0.0))
        step = np.clip(np.linalg.solve(curvature, gradient), -LARGEST_STEP, LARGEST_STEP)
        found = replace(self, log=self.log + step, log_sigma=np.sqrt(np.diagonal(np.linalg.inv(information))))
        if np.isinf(self.tracker_freedom):
            return found
        drifted = by_take(tracking, weighted)
        due = sum(float((block * cov).sum()) for block, cov in zip(blocks, tracking, strict=True))
        shown, prior = float(weighted @ drifted), self.tracker_freedom / self.tracker
        average_information = drifted @ precision.times(drifted) + max(due - shown, 0.0) + prior
        step = np.clip((shown - due + prior - self.tracker_freedom) / average_information, -LARGEST_STEP, LARGEST_STEP)
        return replace(found, tracker=self.tracker * float(np.exp(step)))

    def change(self, before: Scatter) -> float:
        """Return the largest change of a logarithm."""
        return float(np.abs([*(self.log - before.log), np.log(self.tracker / before.tracker)]).max())


def common_scatter(count: int) -> Scatter:
    """Return the prior of one scatter for all keyframes; the first keyframe, which is the dock, has its own."""
    group = np.tile(np.repeat((2, 3), 3), (count, 1))
    group[0] = (0, 0, 0, 1, 1, 4)
    mean = np.log((DOCK_M, DOCK_TILT, HAND_M, HAND_RAD, DOCK_SIGMA_RAD))
    spread = np.array((DOCK_SPREAD, DOCK_SPREAD, HAND_SPREAD, HAND_SPREAD, DOCK_SPREAD))
    return Scatter(group, mean, mean, spread, spread)


def keyframe_scatter(common: Scatter) -> Scatter:
    """Return the prior of a scatter for each keyframe, along each axis and in rotation (at the dock in tilt and in
    heading), from the common scatter."""
    count = len(common.group)
    group = np.arange(4 * count).reshape(count, 4)[:, (0, 1, 2, 3, 3, 3)]
    group[0, 5] = 4 * count
    mean = common.log[[*common.group[:, :4].ravel(), common.group[0, 5]]]
    spread = np.full(len(mean), KEYFRAME_SPREAD)
    return Scatter(group, mean, mean, spread, spread, common.tracker, own_variances=common.own_variances)
