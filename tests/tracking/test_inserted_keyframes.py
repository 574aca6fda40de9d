"""The covariance of a keyframe that a person inserted in a move."""

import numpy as np
from numpy.testing import assert_allclose

from pbd.data.covariance import PoseCovariance


def test_errors_in_a_move_are_those_of_white_noise() -> None:
    """Oracle: white noise of acceleration, summed twice, whose velocity is known at the end, and of the gyro."""
    steps, at = 2000, np.array([0.1, 0.5, 0.6, 1.0])
    times = (np.arange(steps) + 0.5) / steps
    moved, turned = np.maximum(at[:, None] - times, 0.0), at[:, None] > times  # by the noise at each time
    moved -= moved.mean(axis=1, keepdims=True)  # so that the velocity's error at the end is zero
    position, rotation = moved @ moved.T, turned.astype(float) @ turned.T
    of_move = np.diag(np.repeat((position[-1, -1], rotation[-1, -1]), 3))
    path = PoseCovariance.chained(np.array([np.zeros((6, 6)), of_move]))
    found = path.joint_at(at).reshape(4, 6, 4, 6)
    assert_allclose(found[:, 0, :, 0], position, atol=1e-3 * position.max())
    assert_allclose(found[:, 5, :, 5], rotation, atol=1e-3 * rotation.max())
