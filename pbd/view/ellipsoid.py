"""How sure a place is, as something to see: the ellipsoid of two sigma around it."""

from __future__ import annotations

import numpy as np

from pbd.pose import Array

LEAST_SIGMA_M = 5e-5
"""It is drawn at least so thick: what is flat has no turn that the page could read from its matrix."""


def two_sigma(p: Array, cov: Array) -> Array:
    """Return the matrix (4, 4) that makes the unit ball the ellipsoid of two sigma.

    Args:
        p: (3,) m, its middle.
        cov: (3, 3) m2, in the same axes.
    """
    variance, axes = np.linalg.eigh(cov)
    axes[:, 0] *= np.sign(np.linalg.det(axes))  # turned, not mirrored
    T = np.eye(4)
    T[:3, :3] = 2.0 * axes * np.sqrt(np.maximum(variance, LEAST_SIGMA_M**2))
    T[:3, 3] = p
    return T
