"""Sigma of poses, where it is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbd.pose import Array


def one_sigma(cov: Array) -> Array:
    """One sigma (6,) m and rad of a pose's covariance (6, 6); NaN where it has no variance, as it was not measured."""
    variance = np.diagonal(cov)
    return np.sqrt(np.where(variance > 0.0, variance, np.nan))


def keyframe_sigmas(covs: Sequence[Array]) -> Array:
    """One sigma (k, 6) m and rad at keyframes, NaN where it is unknown.

    The position of the first is no measurement: nav's origin is there.
    """
    sigma = np.array([one_sigma(cov) for cov in covs]).reshape(-1, 6)
    sigma[:1, :3] = np.nan_to_num(sigma[:1, :3])
    return sigma
