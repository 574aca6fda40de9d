"""Motions for the audit: random ones, and one whose samples have a fault."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from scipy.interpolate import BSpline, PPoly

from pbd.arm.model import ArmModel
from pbd.data import JointTrajectory
from pbd.pose import Array


def spline(arm: ArmModel, seed: int) -> tuple[JointTrajectory, PPoly]:
    """A random smooth motion from rest to rest: cubic B-splines whose first and last three control points are equal.

    Its extrema lie inside its pieces, not at the ends of ruckig's phases.
    """
    rng = np.random.default_rng(seed)
    control = arm.robot.home + rng.uniform(-0.2, 0.2, (12, 7))
    control[:3], control[-3:] = control[2], control[-3]
    curve = BSpline(0.4 * np.arange(-3, 13), control, 3)
    knots = 0.4 * np.arange(10.0)
    powers = np.stack([curve(knots[:-1], nu=order) / factorial(order) for order in range(4)])
    trajectory = JointTrajectory(
        joint_names=arm.robot.joints,
        knots=knots,
        coefficients=np.swapaxes(powers, 0, 1),
        gripper_t=np.zeros(1),
        gripper_opening=np.ones(1),
        keyframe_t=np.zeros(1),
        keyframe_q=control[:1],
    )
    return trajectory, PPoly(powers[::-1], knots)


def changed_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = JointTrajectory.sample

    def faulty(self: JointTrajectory, rate_hz: float) -> object:
        samples = sample(self, rate_hz)
        q: Array = samples.q.copy()
        q[len(q) // 2, 5] += 0.01
        return replace(samples, q=q)

    monkeypatch.setattr(JointTrajectory, "sample", faulty)
