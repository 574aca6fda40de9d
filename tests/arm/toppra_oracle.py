"""The optimum along a path within velocity and acceleration limits, by toppra: an independent oracle."""

import numpy as np

from pbd.data import JointLimits
from pbd.pose import Array


def toppra_duration(s: Array, q: Array, limits: JointLimits, points: int = 4001) -> float:
    """Return the shortest duration, s, from rest to rest along the cubic spline through joints q (n, k) at s (n,)."""
    import toppra

    toppra.setup_logging("ERROR")
    bounds = [np.stack((-limit, limit), axis=1) for limit in (limits.velocity, limits.acceleration)]
    constraints = [
        toppra.constraint.JointVelocityConstraint(bounds[0]),
        toppra.constraint.JointAccelerationConstraint(
            bounds[1], discretization_scheme=toppra.constraint.DiscretizationType.Interpolation
        ),
    ]
    path = toppra.SplineInterpolator(s, q)
    solver = toppra.algorithm.TOPPRA(
        constraints, path, gridpoints=np.linspace(0.0, s[-1], points), parametrizer="ParametrizeConstAccel"
    )
    return float(solver.compute_trajectory(0, 0).duration)
