"""Will it work? The probability that the tool is within its tolerance at each keyframe, and at all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pbd.calibration.tool_poses import KeyframesInBase
from pbd.calibration.touch_up import touched_up
from pbd.pose import Array, quat_to_matrix

DRAWS = 20_000
"""Draws of all errors together: a probability of 90 % is right within 0.2 %, far below what a covariance is worth."""

BANDS = ((0.5, "under 50 %"), (0.9, "50 to 90 %"), (np.inf, "over 90 %"))
"""What is told: bands, since a covariance is no more exact than that (tests/benchmarks/success.py)."""

ANYWHERE_M = 1e3
"""A tolerance of what may be anywhere, m."""


class Success(NamedTuple):
    """Probability (k,) that the tool is inside at each keyframe, and that it is inside at all of them."""

    of_each: Array
    of_all: float

    @property
    def band(self) -> str:
        """That of all, as it is told."""
        return next(words for bound, words in BANDS if self.of_all < bound)


def success_of(placed: KeyframesInBase, within_m: float | None = None, within_rad: float = np.inf) -> Success:
    """Say how likely the tool is where it belongs, after touch-ups.

    Args:
        placed: keyframes with their own tolerances; one without may be anywhere.
        within_m: a tolerance for all of them instead, with `within_rad`.
    """
    R, keyframes = quat_to_matrix(placed.T_base_nav.wxyz), placed.keyframes
    if within_m is None:
        axes = [np.full(3, ANYWHERE_M) if each.tolerance_m is None else each.tolerance_m for each in keyframes]
        turns = [np.inf if each.tolerance_rad is None else each.tolerance_rad for each in keyframes]
    else:
        axes, turns = [np.full(3, within_m)] * len(keyframes), [within_rad] * len(keyframes)
    tolerance_m2 = np.array([R @ np.diag(each**2) @ R.T for each in axes])
    cov = touched_up(placed).cov
    return success(cov, tolerance_m2, np.array(turns))


def success(cov_base_tool: Array, tolerance_m2: Array, tolerance_rad: Array) -> Success:
    """Draw the tool's errors at all keyframes together, and count.

    Args:
        cov_base_tool: (6k, 6k) m and rad, of `joint_tool_covariance`.
        tolerance_m2: (k, 3, 3) m2, square of the largest distance from where it belongs: an ellipsoid.
        tolerance_rad: (k,) largest angle.
    """
    nothing, rng = np.zeros(len(cov_base_tool)), np.random.default_rng(0)
    errors = rng.multivariate_normal(nothing, cov_base_tool, DRAWS, check_valid="ignore", method="eigh")
    errors = errors.reshape(DRAWS, len(tolerance_m2), 2, 3)
    near = np.einsum("dki,kij,dkj->dk", errors[:, :, 0], np.linalg.inv(tolerance_m2), errors[:, :, 0]) <= 1.0
    inside = near & (np.linalg.norm(errors[:, :, 1], axis=2) <= tolerance_rad)
    return Success(inside.mean(axis=0), float(inside.all(axis=1).mean()))
