"""A touch-up moves its keyframe as asked, and the others as a Kalman filter's update."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.calibration.dock import place_in_base
from pbd.calibration.touch_up import TOUCH_SIGMA_M, condition_on_touch_ups, touched_covariances
from pbd.calibration.uncertainty import tool_covariances
from pbd.data import Keyframe, TouchUp
from pbd.files.demo import load_demo
from pbd.files.robot import load_robot
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_about_z
from pbd.tracking.keyframes import keyframes_of

COUNT = 4
T_BASE_NAV = Pose(np.array([0.3, 0.1, 0.2]), quat_about_z(0.5 * np.pi))
BY_NAV, BY_BASE = np.array([0.0, 0.004, 0.001]), np.array([-0.004, 0.0, 0.001])
KEYFRAMES = tuple(Keyframe(float(k), 0.5, Pose.identity(), np.eye(6)) for k in range(COUNT))


def walk() -> Array:
    """Return the covariance of positions whose errors accumulate, 3 mm a move, and of independent rotations."""
    cov = np.zeros((COUNT, 6, COUNT, 6))
    for i in range(COUNT):
        for j in range(COUNT):
            cov[i, range(3), j, range(3)] = 0.003**2 * (1 + min(i, j))
        cov[i, range(3, 6), i, range(3, 6)] = 0.01**2
    return cov.reshape(6 * COUNT, 6 * COUNT)


def test_the_others_move_by_their_common_errors() -> None:
    """Oracle: the textbook's gain by hand: half of the shift for keyframe 0, all of it after keyframe 1."""
    found = condition_on_touch_ups([TouchUp(1.0, BY_NAV)], KEYFRAMES, T_BASE_NAV, walk())
    shares = np.array([1, 2, 2, 2]) * 0.003**2 / (2 * 0.003**2 + TOUCH_SIGMA_M**2)
    shares[1] = 1.0  # exactly where it was asked to
    np.testing.assert_allclose(found.shift, shares[:, None] * BY_BASE, atol=1e-12)
    variance = np.diagonal(found.cov).reshape(COUNT, 6)[:, 0]
    information = np.linalg.inv(walk()[::6, ::6]) + np.diag([0, TOUCH_SIGMA_M**-2, 0, 0])
    np.testing.assert_allclose(variance, np.diagonal(np.linalg.inv(information)), rtol=1e-9)
    np.testing.assert_array_equal(np.diagonal(found.cov).reshape(COUNT, 6)[:, 3:], 0.01**2)
    assert np.linalg.eigvalsh(found.cov).min() > -1e-18


def test_touch_ups_of_a_keyframe_add_up_without_undone_ones() -> None:
    once = condition_on_touch_ups([TouchUp(1.0, 2.0 * BY_NAV)], KEYFRAMES, T_BASE_NAV, walk())
    undone = TouchUp(3.0, BY_NAV, undone=True)
    twice = condition_on_touch_ups([TouchUp(1.0, BY_NAV), undone, TouchUp(1.0, BY_NAV)], KEYFRAMES, T_BASE_NAV, walk())
    np.testing.assert_allclose(twice.shift, once.shift, atol=1e-12)
    np.testing.assert_allclose(twice.cov, once.cov, atol=1e-15)


def test_a_touched_keyframe_stays_when_another_is_touched() -> None:
    touches = [TouchUp(1.0, BY_NAV), TouchUp(3.0, -BY_NAV)]
    found = condition_on_touch_ups(touches, KEYFRAMES, T_BASE_NAV, walk())
    first = condition_on_touch_ups(touches[:1], KEYFRAMES, T_BASE_NAV, walk())
    np.testing.assert_allclose(found.shift[1], BY_BASE, atol=1e-12)
    np.testing.assert_allclose(found.shift[3], first.shift[3] - BY_BASE, atol=1e-12)


def test_a_touch_up_of_one_keyframe_only_moves_no_other() -> None:
    found = condition_on_touch_ups([TouchUp(2.0, BY_NAV, only=True)], KEYFRAMES, T_BASE_NAV, walk())
    np.testing.assert_allclose(found.shift, np.outer([0, 0, 1, 0], BY_BASE), atol=1e-15)
    sigma = np.sqrt(np.diagonal(found.cov).reshape(COUNT, 6)[:, 0])
    np.testing.assert_allclose(sigma, [0.003, 0.003 * 2**0.5, TOUCH_SIGMA_M, 0.006], rtol=1e-9)


def test_a_keyframe_touched_alone_stays_when_another_is_touched() -> None:
    touches = [TouchUp(1.0, BY_NAV, only=True), TouchUp(3.0, -BY_NAV), TouchUp(1.0, BY_NAV), TouchUp(2.0, BY_NAV)]
    found = condition_on_touch_ups(touches, KEYFRAMES, T_BASE_NAV, walk())
    np.testing.assert_allclose(found.shift[1], 2.0 * BY_BASE, atol=1e-12)


@pytest.mark.parametrize("t", [1.4, -1.0, 9.0])
def test_a_touch_up_of_a_missing_keyframe_moves_nothing(t: float) -> None:
    assert not condition_on_touch_ups([TouchUp(t, BY_NAV)], KEYFRAMES, T_BASE_NAV, walk()).shift.any()


def test_touch_ups_that_were_undone_are_no_source_of_errors() -> None:
    path, dock = track(load_demo("pouring")), load_robot("panda").dock
    assert path.tracking is not None
    assert dock is not None
    t = keyframes_of(path)[1].t
    for touch, parts in ((TouchUp(t, BY_NAV, undone=True), set()), (TouchUp(t, BY_NAV), {"touch-ups"})):
        demo = replace(path.tracking.demo, touch_ups=(touch,))
        touched = replace(path, tracking=replace(path.tracking, demo=demo))
        placed = place_in_base(keyframes_of(path), dock, path=touched)
        assert touched_covariances(placed).keys() - tool_covariances(placed).keys() == parts
