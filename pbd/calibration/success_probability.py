"""The probability that the tool is within its tolerance at each keyframe, and at all of them."""

from typing import NamedTuple

import numpy as np

from pbd.calibration.tool_poses import KeyframesInBase
from pbd.calibration.touch_up import touched_up
from pbd.pose import Array, quat_to_matrix

DRAWS = 20_000
"""Number of random draws. A probability of 90 % then has a sigma of 0.2 %, far below the accuracy of a covariance."""


class Success(NamedTuple):
    """Probability (k,) that the tool is within its tolerance at each keyframe, and that it is at all of them."""

    of_each: Array
    of_all: float

    @property
    def band(self) -> str:
        """The band of the probability for all keyframes, in words.

        A covariance allows no finer statement (tests/benchmarks/success.py).
        """
        return "under 50 %" if self.of_all < 0.5 else "50 to 90 %" if self.of_all < 0.9 else "over 90 %"


def success_of(placed: KeyframesInBase, within_m: float | None = None, within_rad: float = np.inf) -> Success:
    """Return the probability that the tool is within its tolerances, after touch-ups.

    Args:
        placed: keyframes with their own tolerances, which scale as the hand's path does. A keyframe without one may be
            anywhere.
        within_m, within_rad: tolerances of all keyframes instead, in base.
    """
    R, keyframes = quat_to_matrix(placed.T_base_nav.wxyz), placed.keyframes
    if within_m is None:
        scale = placed.scale * placed.calibration.scale
        anywhere = np.full(3, 1e3)  # m
        axes = [anywhere if each.tolerance_m is None else scale * each.tolerance_m for each in keyframes]
        turns = [np.inf if each.tolerance_rad is None else each.tolerance_rad for each in keyframes]
    else:
        axes, turns = [np.full(3, within_m)] * len(keyframes), [within_rad] * len(keyframes)
    tolerance_m2 = np.array([R @ np.diag(each**2) @ R.T for each in axes])
    return success(touched_up(placed).cov, tolerance_m2, np.array(turns))


def success(cov_base_tool: Array, tolerance_m2: Array, tolerance_rad: Array) -> Success:
    """Draw the tool's errors at all keyframes jointly, and count those within tolerance.

    Args:
        cov_base_tool: (6k, 6k) m and rad, from `touched_up`.
        tolerance_m2: (k, 3, 3) m2, matrix of the ellipsoid within which the position error must lie.
        tolerance_rad: (k,) largest rotation error.
    """
    mean, rng = np.zeros(len(cov_base_tool)), np.random.default_rng(0)
    errors = rng.multivariate_normal(mean, cov_base_tool, DRAWS, check_valid="ignore", method="eigh")
    errors = errors.reshape(DRAWS, len(tolerance_m2), 2, 3)
    near = np.einsum("dki,kij,dkj->dk", errors[:, :, 0], np.linalg.inv(tolerance_m2), errors[:, :, 0]) <= 1.0
    inside = near & (np.linalg.norm(errors[:, :, 1], axis=2) <= tolerance_rad)
    return Success(inside.mean(axis=0), float(inside.all(axis=1).mean()))
