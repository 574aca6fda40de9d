"""Preintegration from knot to knot."""

import numpy as np
import pytest

from pbd.pose import quat_inverse, quat_log, quat_multiply, quat_to_matrix
from pbd.tracking.smoother.preintegration import LAG, POS, VEL, LostMotion, gyro_frame, preintegrate


def test_samples_that_came_at_one_instant_are_an_empty_block() -> None:
    """With a repeated packet, one row is a knot, and its copy the edge of a block."""
    t = 0.01 * np.arange(101.0)
    t[41:] -= 0.01  # blocks are of 4 samples
    acc = np.tile((0.0, 0.0, 9.8), (101, 1))
    frame = gyro_frame(t, np.zeros((101, 3)), acc, 0.01)
    density = np.ones((3, 101)), np.ones((3, 101))
    legs = preintegrate(frame, np.array([0, 41, 100]), density)
    assert np.isfinite(legs.J).all()
    assert np.allclose(legs.dU, np.outer(legs.T, (0.0, 0.0, 9.8)))


def test_a_sensor_that_turns_while_it_samples_is_integrated_as_it_turned() -> None:
    """Specific force has one direction; the sensor turns by 0.15 rad per sample; samples are means."""
    n, dt, rate, g = 41, 0.025, 6.0, 9.8
    t = dt * np.arange(float(n))
    seen = g * np.sinc(0.5 * rate * dt / np.pi)
    acc = np.column_stack((np.zeros(n), seen * np.sin(rate * t), seen * np.cos(rate * t)))
    frame = gyro_frame(t, np.tile((rate, 0.0, 0.0), (n, 1)), acc, dt)
    assert np.allclose(frame.U[-1], (0.0, 0.0, g * t[-1]), atol=1e-3)  # 9e-3 without sculling


def test_a_late_gyro_turns_what_the_accelerometer_says() -> None:
    """The effect of a second of lag, against how the attitude changes from sample to sample."""
    n, dt = 101, 0.01
    t = dt * np.arange(float(n))
    gyr = 3.0 * np.sin(2.0 * np.pi * t[:, None] + np.arange(3.0))
    acc = np.array((0.0, 0.0, 9.8)) + 4.0 * np.cos(3.0 * np.pi * t[:, None] + np.arange(3.0))
    frame, density = gyro_frame(t, gyr, acc, dt), np.ones((3, n))
    J = preintegrate(frame, np.array([0, n - 1]), (density, density)).J[0]
    push = np.einsum("kij,kj->ki", np.gradient(quat_to_matrix(frame.wxyz), dt, axis=0), acc)
    v = np.vstack((np.zeros(3), np.cumsum(0.5 * dt * (push[1:] + push[:-1]), axis=0)))
    assert J[VEL, LAG][:, 0] == pytest.approx(v[-1], abs=0.02 * float(np.linalg.norm(v[-1])))
    p = (0.5 * dt * (v[1:] + v[:-1])).sum(axis=0)
    assert J[POS, LAG][:, 0] == pytest.approx(p, abs=0.02 * float(np.linalg.norm(p)))


def test_a_turn_that_is_lost_turns_what_comes_after_it() -> None:
    """The added covariance is that of a leg that contains the lost turn."""
    n, dt, row, size = 101, 0.01, 40, np.array([2e-4, -1e-4, 3e-4])
    t, gyr = dt * np.arange(float(n)), np.tile((1.0, -0.5, 0.3), (n, 1))
    acc = np.tile((1.0, 2.0, 9.8), (n, 1))
    density, knots = (np.zeros((3, n)), np.zeros((3, n))), np.array([0, n - 1])
    frame = gyro_frame(t, gyr, acc, dt)
    legs = preintegrate(frame, knots, density)
    unsure = preintegrate(frame, knots, density, [LostMotion(row, size, np.zeros(3))])
    kicked = gyr.copy()
    kicked[row] += size / dt
    true = gyro_frame(t, kicked, acc, dt)
    more = preintegrate(true, knots, density)
    turn = quat_log(quat_multiply(true.wxyz[-1], quat_inverse(frame.wxyz[-1])))
    effect = np.concatenate((turn, (more.dU - legs.dU)[0], (more.dP - legs.dP)[0]))
    added = unsure.parts[0, 0] - legs.parts[0, 0]
    assert np.allclose(added, np.outer(effect, effect), atol=0.03 * (effect @ effect))
