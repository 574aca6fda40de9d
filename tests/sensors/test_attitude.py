"""Attitude in plain floats against the same over arrays (pbd.pose)."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.pose import quat_about_z, quat_from_rpy, quat_multiply, quat_to_matrix, quat_to_rpy
from pbd.sensors.attitude import from_north_east_down, from_north_west_up, rpy_from_quaternion, wrap_angle

angles = st.floats(-pi, pi)
near_pole = st.sampled_from([-1.0, 1.0]).flatmap(lambda sign: st.floats(0.0, 1e-6).map(lambda x: sign * (pi / 2 - x)))
rpys = st.tuples(angles, st.floats(-pi / 2, pi / 2) | near_pole, angles)


@given(rpys, st.floats(0.5, 2.0))
def test_of_a_quaternion_of_any_length(rpy: tuple[float, float, float], length: float) -> None:
    q = quat_from_rpy(rpy)
    w, x, y, z = (length * q).tolist()
    ours = rpy_from_quaternion(w, x, y, z)
    assert quat_to_matrix(quat_from_rpy(ours)) == pytest.approx(quat_to_matrix(q), abs=2e-7)
    if abs(rpy[1]) < 1.5:
        assert np.exp(1j * np.array(ours)) == pytest.approx(np.exp(1j * quat_to_rpy(q)), abs=1e-9)  # -pi is pi


@given(rpys)
def test_frames(rpy: tuple[float, float, float]) -> None:
    """North-west-up is a quarter turn from east-north-up; north-east-down is half a turn about x from it."""
    q, north = quat_from_rpy(rpy), quat_about_z(pi / 2)
    over = np.array([0.0, 1.0, 0.0, 0.0])
    for ours, expected in (
        (from_north_west_up(rpy), quat_multiply(north, q)),
        (from_north_east_down(rpy), quat_multiply(quat_multiply(north, over), quat_multiply(q, over))),
    ):
        assert quat_to_matrix(quat_from_rpy(ours)) == pytest.approx(quat_to_matrix(expected), abs=1e-9)
        assert abs(ours[2]) <= pi


@given(st.floats(-100.0, 100.0))
def test_wrapped(angle: float) -> None:
    assert abs(wrap_angle(angle)) <= pi
    assert np.exp(1j * wrap_angle(angle)) == pytest.approx(np.exp(1j * angle))
