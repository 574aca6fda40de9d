"""Random waypoints, and limits that are alike for all joints."""

import numpy as np
from scipy.interpolate import CubicSpline

from pbd.data import JointLimits
from pbd.pose import Array


def limits_of(velocity: float, acceleration: float, jerk: float, joints: int = 3) -> JointLimits:
    one = np.ones(joints)
    return JointLimits(-100.0 * one, 100.0 * one, velocity * one, acceleration * one, jerk * one, "a test")


def random_waypoints(seed: int, joints: int = 3, spread: float = 0.4) -> Array:
    corners = np.cumsum(np.random.default_rng(seed).normal(scale=spread, size=(6, joints)), axis=0)
    waypoints: Array = CubicSpline(np.linspace(0, 1, 6), corners)(np.linspace(0, 1, 50))
    return waypoints
