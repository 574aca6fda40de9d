"""The smoother, on simulated hands; and what a stop shows of the matrices of its sensor."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pbd.data import Demonstration, Recording
from pbd.pose import (
    Array,
    lengths,
    matrix_log,
    quat_exp,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    yaw_toward,
)
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.sensor_model import SENSOR_MODELS
from pbd.simulation.simulate import World, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.estimate import Estimate, estimate
from pbd.tracking.first_rest import find_rest
from pbd.tracking.moving_windows import Spans
from pbd.tracking.noise import BARE, FACTORY, Noise, acc_sigma_factor, noise_of
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.tracking.smoother import normal_equations
from pbd.tracking.smoother.attitude import gyro_frame_of
from pbd.tracking.smoother.doubtful_stops import MOVING_WEIGHT, revised_stops
from pbd.tracking.smoother.factors import (
    GAUGE_WEIGHT,
    _add_device_attitude,
    _add_priors,
    _add_reach,
    _add_stops,
    compass_heading,
    linearise,
    robust_weights,
    whitener,
)
from pbd.tracking.smoother.gauss_newton import Descent
from pbd.tracking.smoother.knots import Problem, Samples, _fix_sway, _turn_sigma
from pbd.tracking.smoother.large_errors import _large_lag_and_scale
from pbd.tracking.smoother.normal_equations import BAND, STATE, STATE_ACC_BIAS, STATE_GYR_BIAS, NormalEquations, Solved
from pbd.tracking.smoother.preintegration import ACC_MATRIX, ERRORS, GYR_MATRIX, LAG, POS, ROT, VEL, GyroFrame, Legs
from pbd.tracking.smoother.smooth import _initial_state
from pbd.tracking.smoother.state import SHARED, SHARED_PIVOT, State, lower_matrix
from tests.benchmarks.trials import with_drift
from tests.not_none import not_none
from tests.scenarios import simulate


def smoothed(recording: Recording) -> Estimate:
    recording, _ = repair_recording(recording)
    rest = find_rest(recording)
    return estimate(recording, rest, noise_of(recording, rest))


SENSORS = ("os5000", "wt901", "modern")


def test_the_error_of_a_devices_own_attitude_has_the_same_sigma_at_all_knots() -> None:
    """A measurement at each knot, all independent, would make it far smaller."""
    solution = not_none(smoothed(simulate("pour", "os5000-nogyro", 0).recording).solution)
    problem, m = solution.problem, len(solution.problem.rows)
    equations = NormalEquations.empty(m, SHARED)
    _add_device_attitude(equations, problem, replace(solution.state, E=np.tile(np.eye(3), (m, 1, 1))))
    walk = np.diff(np.eye(m), axis=0)
    turned = lengths(matrix_log(problem.C[:-1].transpose(0, 2, 1) @ problem.C[1:]))
    turned += problem.noise.device_drift * problem.legs.T
    of_legs = walk.T / (problem.noise.gyr_turn**2 * turned) @ walk
    sigma = np.sqrt(np.diagonal(np.linalg.inv(np.diag(equations.diagonal[:, 0, 0]) + of_legs)))
    assert sigma == pytest.approx(problem.noise.device_attitude, rel=0.1)


@pytest.mark.parametrize("sensor", ["os5000", "wt901"])
def test_what_a_devices_own_attitude_lags_is_found_and_undone(sensor: str) -> None:
    demo = simulate("pour", sensor, 1)
    solution = not_none(smoothed(replace(demo.recording, gyr=None)).solution)
    model, middle = SENSOR_MODELS[sensor], 0.5 / SENSOR_MODELS[sensor].rate_hz  # a sample is the mean of an interval
    found = solution.removed.lag + solution.state.shared[0]
    assert found == pytest.approx(not_none(model.attitude).time_constant_s - middle, abs=0.01)


def test_a_devices_own_attitude_tells_the_heading_so_nothing_else_fixes_it() -> None:
    solution = not_none(smoothed(simulate("pour", "os5000-nogyro", 0).recording).solution)
    tilt_x, tilt_y, heading = np.sqrt(np.diagonal(solution.solved.covariance_of_knots(ROT)[solution.fixed.origin]))
    assert heading > max(tilt_x, tilt_y)  # gravity shows the tilt too


def test_the_first_and_the_last_row_are_knots() -> None:
    solution = not_none(smoothed(simulate("pour", "modern", 0).recording).solution)
    assert (solution.problem.rows[0], solution.problem.rows[-1]) == (0, len(solution.problem.frame.t) - 1)


def test_a_hand_at_rest_may_turn_twice_as_far_as_it_sways_about_a_steady_turn() -> None:
    t, sway = np.arange(0.0, 4.0, 0.01), 0.003
    gyr = np.zeros((len(t), 3))
    gyr[1:, 1] = np.diff(sway * np.sin(2.0 * np.pi * t) + 0.02 * t) / 0.01
    rows, within, unused = np.array([0, 100, 200, 399]), np.array([True, True, False]), np.zeros((len(t), 3))
    frame = GyroFrame(t, gyr, unused, unused, unused, unused, unused)
    sigma = _turn_sigma(frame, rows, within, 1e-3)
    assert sigma == pytest.approx([np.hypot(1e-3, 2.0 * sway)] * 2 + [1e-3], rel=1e-3)


def test_a_rest_has_no_noise_of_motion_however_far_the_gyro_frame_drifts() -> None:
    """The gyro's bias of 1 degree a second tilts gravity by 20 degrees in the gyro frame."""
    recording = simulate("pour", "modern", 0).recording
    problem = not_none(smoothed(recording).solution).problem
    frame = gyro_frame_of(recording, problem.rest.gyro_bias + np.radians((1.0, 0.0, 0.0)))
    samples = Samples(frame, problem.rest, problem.noise, problem.stops, None, frame.t, (), (), (), (), no_gyro=False)
    white, _, motion = samples.density[1][:, problem.rows[problem.stop_of >= 0]]
    assert (motion < 0.01 * white).all()


def test_a_gap_hides_a_move_from_rest_to_rest_and_a_turn() -> None:
    """A move of `unseen_speed` times its length: the integral of a random walk that is tied to zero at both ends."""
    problem = not_none(smoothed(simulate("pour", "modern", 0).recording).solution).problem
    frame, rest, noise, gap = problem.frame, problem.rest, problem.noise, (20, 29)
    samples = (
        Samples(frame, rest, noise, problem.stops, None, frame.t, (), (), gaps, (), no_gyro=False)
        for gaps in ([], [gap])
    )
    seen, hidden = (each.density for each in samples)
    turn, move = (after[0] - before[0] for before, after in zip(seen, hidden, strict=True))
    lasts = frame.t[29] - frame.t[20]
    s = np.linspace(0.0, lasts, 501)
    tied = np.minimum.outer(s, s) - np.outer(s, s) / lasts
    assert np.sqrt(move[20:30] * tied.mean()) * lasts == pytest.approx(noise.unseen_speed * lasts, rel=0.01)
    assert np.sqrt(turn[20:30] * lasts) == pytest.approx(noise.unseen_rate * lasts)
    assert not move[[19, 30]].any()


@pytest.mark.parametrize("sensor", ["modern", "os5000-nogyro"])
def test_the_first_knots_biases_are_as_large_as_such_a_device_has_them(sensor: str) -> None:
    """The random walk ties the other knots' biases to the first."""
    solution = not_none(smoothed(simulate("pour", sensor, 0).recording).solution)
    problem, x, noise = solution.problem, solution.state, solution.problem.noise
    equations = NormalEquations.empty(len(problem.rows), SHARED)
    _add_priors(equations, problem, x, solution.fixed)
    for block, bias, sigma in (
        (STATE_GYR_BIAS, x.gyr_bias, noise.gyr_bias),
        (STATE_ACC_BIAS, x.acc_bias, acc_sigma_factor(noise, problem.rest) * noise.sensor.acc_bias),
    ):
        information = np.diagonal(equations.diagonal, axis1=1, axis2=2)[:, block]
        assert information[0] == pytest.approx(np.full(3, sigma**-2.0))
        assert not information[1:].any()
        assert equations.g[0, block] == pytest.approx(bias[0] / sigma**2)


def errors(demo: Demonstration) -> tuple[Array, Array, Estimate]:
    """Errors of each stop relative to the first: position (k, 3) m, rotation vector (k, 3) rad."""
    found, truth = smoothed(demo.recording), demo.truth
    assert truth is not None
    rows = [(stop.start + stop.stop - 1) // 2 for stop in found.stops]
    p, wxyz = found.path.p[rows], found.path.wxyz[rows]
    p_true, wxyz_true = truth.p_nav_sensor[rows], truth.wxyz_nav_sensor[rows]
    up = np.array([0.0, 0.0, 1.0])
    yaw = -yaw_toward(wxyz[0], wxyz_true[0])
    turn = quat_log(quat_multiply(wxyz, quat_inverse(wxyz_true))) - yaw * up
    return p - p[0] - (p_true - p_true[0]) - yaw * np.cross(up, p - p[0]), turn, found


@pytest.mark.parametrize("sensor", SENSORS)
def test_every_stop_is_found_and_the_truth_lies_within_its_sigma(sensor: str) -> None:
    """Of normal errors 68 % lie within one sigma and 95 % within two; here 44 in position, 48 in rotation a seed."""
    scaled: list[Array] = []
    for seed in range(4, 8):
        off, turn, found = errors(simulate("pour", sensor, seed))
        assert [stop.weight for stop in found.stops] == 11 * [1.0]
        sigma = np.sqrt(np.diagonal(found.covariance.of_each, axis1=1, axis2=2))
        scaled += [off[1:] / sigma[1:, :3], turn[1:] / sigma[1:, 3:]]
    for z in (np.abs(np.concatenate(scaled[::2])), np.abs(np.concatenate(scaled[1::2]))):
        assert (z < 1.0).mean() > 0.55
        assert (z < 2.0).mean() > 0.88
        assert np.sqrt((z**2).mean()) > 0.2  # nor is it ten times too wide


@pytest.mark.parametrize(("late_s", "scale"), [(0.01, 1.0), (0.03, 1.08), (0.06, 1.0)])
def test_a_gyro_that_is_late_or_reads_too_much_loses_no_stop(late_s: float, scale: float) -> None:
    demo = simulate(random_task(5, moves=5, max_turn=np.radians(80.0)), "modern", 5)
    recording = demo.recording
    assert recording.gyr is not None
    late = np.column_stack([scale * np.interp(recording.t - late_s, recording.t, axis) for axis in recording.gyr.T])
    off, _, found = errors(replace(demo, recording=replace(recording, gyr=late + 0.05)))
    assert found.solution is not None
    assert np.abs(found.solution.state.gyr_bias[0]).max() < 1e-3  # the first rest showed it
    assert found.solution.removed.lag + found.solution.state.shared[0] == pytest.approx(late_s, abs=1.5e-3)
    assert len(found.stops) == 6
    assert np.linalg.norm(off, axis=1).max() < 0.01


def test_a_foot_turns_about_the_point_that_it_treads_on() -> None:
    """Ten strides. In each stance of 0.3 s the sensor tips by 3 degrees about a point 8 cm below it."""
    rng, every, dt, r = np.random.default_rng(0), 10, 1e-3, np.array([-0.02, 0.0, 0.08])
    t = np.arange(0.0, 16.0, dt)
    beat = np.clip(t - 3.0, 0.0, 10.0 - 1e-9)
    swing = np.clip(beat % 1.0 / 0.7, 0.0, 1.0)
    trodden = np.floor(beat) + swing**3 * (10.0 + swing * (6.0 * swing - 15.0))
    stance = np.sin(np.pi * np.clip((beat % 1.0 - 0.7) / 0.3, 0.0, 1.0)) ** 2
    tip = np.cumsum(0.25 * stance + 3.0 * np.sin(2.0 * np.pi * swing) * np.sin(np.pi * swing) ** 2) * dt
    tip -= np.interp(beat, np.arange(12.0), tip[np.searchsorted(t, np.arange(3.0, 15.0))]) * (t > 3.0)
    wxyz = np.column_stack((np.cos(0.5 * tip), np.zeros_like(tip), np.sin(0.5 * tip), np.zeros_like(tip)))
    p = np.column_stack((trodden, np.zeros_like(t), np.zeros_like(t))) + quat_rotate(wxyz, r)
    a = np.gradient(np.gradient(p, dt, axis=0), dt, axis=0) + 9.8 * np.array([0.0, 0.0, 1.0])
    acc, gyr = quat_rotate(quat_inverse(wxyz), a), np.gradient(tip, dt)[:, None] * (0.0, 1.0, 0.0)
    t, acc, gyr = (values.reshape(-1, every, *values.shape[1:]).mean(axis=1) for values in (t, acc, gyr))
    noisy = [values + rng.normal(size=values.shape) * sigma for values, sigma in ((acc, 0.03), (gyr, 0.002))]
    found = smoothed(Recording(t - t[0], *noisy))
    assert len(found.stops) == 11
    assert not_none(found.solution).state.shared[SHARED_PIVOT] == pytest.approx(r, abs=0.03)
    assert np.linalg.norm(found.path.p[-1] - found.path.p[0]) == pytest.approx(10.0, abs=0.02)


def test_a_pivot_further_away_moves_a_stops_knots_as_their_hessian_says() -> None:
    solution = not_none(smoothed(simulate("pour", "modern", 0).recording).solution)
    m = len(solution.problem.rows)
    known = replace(solution.problem, stop_of=np.full(m, -1), stood=np.ones(m - 1, dtype=np.bool_))
    x, gradients = solution.state, list[Array]()
    for further in (0.0, 0.1):
        equations = NormalEquations.empty(m, SHARED)
        shared = x.shared.copy()
        shared[SHARED_PIVOT] += (further, 0.0, 0.0)  # m
        _add_stops(equations, known, replace(x, shared=shared), solution.fixed, 1.0)
        gradients.append(equations.g[:, POS].copy())
    by_pivot = equations.border[:, POS, SHARED_PIVOT][:, :, 0]
    assert np.abs(by_pivot).max() > 0.0
    np.testing.assert_allclose(gradients[1] - gradients[0], 0.1 * by_pivot, rtol=1e-6, atol=1e-6)


def test_a_perfect_sensor_is_followed_to_half_a_millimetre() -> None:
    for seed in range(2):
        off, turn, _ = errors(simulate(random_task(seed), "ideal", rate_hz=100.0))
        assert np.linalg.norm(off, axis=1).max() < 5e-4
        assert np.abs(turn).max() < np.radians(0.05)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_reach_of_a_hand_pulls_no_stop_of_a_foot_that_walks_far_away(seed: int) -> None:
    """28 m out, back and out again, with a gyro that drifts."""
    strides = [Waypoint(rest_s=2.0)]
    for k in range(60):
        x = strides[-1].p[0] + (-1.4 if k // 20 == 1 else 1.4)
        strides.append(Waypoint((x, 0.0, 0.0), (0.0, 0.5 * (-1) ** k, np.pi * (k in (20, 40))), 1.0, 0.3))
    demo = simulate(Task("walk", tuple(strides)), "wt901", seed)
    found = smoothed(with_drift(replace(demo.recording, mag=None), 1.0, seed))
    assert len(found.stops) == 61
    assert np.linalg.norm(found.path.p[-1] - found.path.p[0]) == pytest.approx(28.0, abs=0.3)


def test_a_gyro_that_warms_up_loses_no_stop() -> None:
    """By 0.12 deg/s each second, 3 deg/s at the end: the estimate of the bias shows which windows are quiet."""
    turns = (Waypoint((0.15 * (k % 2), 0.0, 0.0), (0.0, 0.7 * (k % 2), 0.0), move_s=1.0, rest_s=1.0) for k in (1, 2, 3))
    recording = simulate(Task("warm", (Waypoint(rest_s=20.0), *turns)), "os5000", 3).recording
    warm = not_none(recording.gyr) + np.radians(0.12) * recording.t[:, None] * (0.6, 0.0, 0.8)
    assert len(smoothed(replace(recording, gyr=warm)).stops) == 4


def test_only_a_hand_that_moves_for_long_is_within_reach() -> None:
    """Not within half a stride, one second, of a knot that stands still, wherever that is."""
    t, near, far = 0.6 * np.arange(12.0), (1.0, 0.0, 0.0), (7.0, 0.0, 0.0)
    problem: Any = SimpleNamespace(t=t, duration=np.ones(12), noise=Noise(0.0, 0.0, FACTORY))
    state: Any = SimpleNamespace(p=np.array([near] * 6 + [far] * 6))
    equations = NormalEquations.empty(12, SHARED)
    _add_reach(equations, problem, state, np.arange(12) % 6 == 3, 1.0)
    expected = [0.2, 0.2, 0.0, 0.0, 0.0, 0.2, 7 / 53, 7 / 53, 0.0, 0.0, 0.0, 7 / 53]
    assert equations.g[:, POS.start] == pytest.approx(expected)


def test_a_hand_that_moves_on_for_long_is_brought_back_from_where_dead_reckoning_ends() -> None:
    """The reach's robust factor alone would leave it metres away, with false stops there."""
    task = random_task(8, moves=60, reach_m=0.6, max_turn=1.0, move_s=(0.4, 1.0), rest_s=(0.0, 0.0))
    last = replace(task.waypoints[-1], rest_s=2.0)
    demo = simulate(replace(task, waypoints=(*task.waypoints[:-1], last)), "modern", 8)
    found = smoothed(demo.recording)
    assert len(found.stops) == 2
    assert np.abs(found.path.p - not_none(demo.truth).p_nav_sensor).max() < 0.3


def test_without_a_gyro_the_devices_attitude_serves() -> None:
    off, _, found = errors(simulate("pour", "os5000-nogyro", 0))
    assert len(found.stops) == 11
    assert np.linalg.norm(off[-1]) < 0.02


@pytest.mark.parametrize("at_once", [4, 256])
def test_normal_equations_are_solved_as_dense_ones(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr(normal_equations, "KNOTS_AT_ONCE", at_once)
    rng = np.random.default_rng(0)
    m, s = 6, 4
    equations = NormalEquations.empty(m, s)
    equations.add_legs(rng.normal(size=(m - 1, 40, BAND + s + 1)))
    changes = (
        (0, STATE_GYR_BIAS, -1.0),
        (1, STATE_GYR_BIAS, 1.0),
        (0, POS, -1.0),
        (None, slice(1, 4), rng.normal(size=(m - 1, 3, 3))),
    )
    equations.add(rng.normal(size=(m - 1, 3)), rng.uniform(1.0, 2.0, m - 1), *changes)
    by_turn = (0, ROT, rng.normal(size=(m, 3, 3)))
    equations.add(rng.normal(size=(m, 3)), rng.uniform(1.0, 2.0, m), (0, STATE_ACC_BIAS, 1.0), by_turn)
    n = m * STATE
    dense = np.zeros((n + s, n + s))
    for k in range(m):
        here = slice(k * STATE, (k + 1) * STATE)
        dense[here, here] = equations.diagonal[k]
        dense[here, n:], dense[n:, here] = equations.border[k, :, :s], equations.border[k, :, :s].T
        if k < m - 1:
            after = slice((k + 1) * STATE, (k + 2) * STATE)
            dense[after, here], dense[here, after] = equations.below[k], equations.below[k].T
    dense[n:, n:] = equations.corner[:, :s]
    gradient = np.concatenate((equations.g.ravel(), equations.corner[:, -1]))
    covariance, solved = np.linalg.inv(dense), equations.solve()
    step = np.concatenate((solved.d.ravel(), solved.d_shared))
    assert step == pytest.approx(-covariance @ gradient, rel=1e-8, abs=1e-10)
    assert solved.decrement == pytest.approx(np.sqrt(gradient @ covariance @ gradient), rel=1e-8)
    assert solved.shared == pytest.approx(covariance[n:, n:], rel=1e-8, abs=1e-12)
    right = rng.normal(size=(m, STATE, 2))
    assert solved.covariance_times(right).reshape(n, 2) == pytest.approx(
        covariance[:n, :n] @ right.reshape(n, 2), abs=1e-8
    )
    for k, block in enumerate(solved.covariance_of_knots()):
        here = slice(k * STATE, (k + 1) * STATE)
        assert block == pytest.approx(covariance[here, here], abs=1e-9)
    pair = np.r_[0:BAND, n : n + s]
    of_leg = solved.covariance_of_legs(np.eye(len(pair))[None])
    assert of_leg[0] == pytest.approx(covariance[np.ix_(pair, pair)], abs=1e-9)
    change = np.zeros((3, n))
    change[:, STATE_GYR_BIAS], change[:, STATE : 2 * STATE][:, STATE_GYR_BIAS] = -np.eye(3), np.eye(3)
    assert solved.covariance_of_changes(STATE_GYR_BIAS)[0] == pytest.approx(
        change @ covariance[:n, :n] @ change.T, abs=1e-9
    )
    known = np.column_stack((np.eye(s), np.ones(s)))
    dense[n:, n:] += np.eye(s)
    gradient[n:] += 1.0
    again = solved.plus(known)
    assert np.append(again.d, again.d_shared) == pytest.approx(-np.linalg.solve(dense, gradient), rel=1e-8, abs=1e-10)


def revised_at_100_hz(v: Array, candidate: tuple[int, int]) -> Spans:
    """An undoubted stop by the velocity (100, 3) m/s; sigma of zero velocity is 5 mm/s."""
    frame, legs = SimpleNamespace(t=0.01 * np.arange(100.0)), SimpleNamespace(parts=np.zeros((3, 2, 9, 9)))
    problem = cast(Problem, SimpleNamespace(frame=frame, legs=legs, rows=np.array([0, 50, 99])))
    return revised_stops(problem, v, cast(Solved, None), [candidate], np.array([False]), np.full(100, 5e-3))


@pytest.mark.parametrize(("rad", "sigmas", "last"), [(1e-3, 0.1, False), (1e-3, 0.01, True), (1e-4, 1.0, True)])
def test_a_step_that_turns_little_or_is_small_beside_its_sigma_is_the_last(
    rad: float, sigmas: float, last: bool
) -> None:
    """A heading that nothing determines may settle slowly, but by less than matters."""
    solved = SimpleNamespace(d=np.full((2, STATE), rad), decrement=sigmas)
    assert Descent(cast(State, None), np.ones(2), cast(Solved, solved)).converged is last


def test_a_stop_begins_where_the_hand_arrives_and_ends_where_it_leaves() -> None:
    v = np.zeros((100, 3))
    v[20:25, 0], v[25:29, 0], v[54:58, 1], v[58:61, 1] = 0.02, 1e-3, 1e-3, 0.02
    assert revised_at_100_hz(v, (20, 61)) == [(25, 58)]


@pytest.mark.parametrize(("faster", "left"), [(0.0, [(40, 61)]), (1.0, [])], ids=["it stays", "it reverses"])
def test_what_is_left_of_a_trimmed_stop_must_last(faster: float, left: Spans) -> None:
    """A hand that reverses with 1 m/s2 is slower than 15 mm/s for 0.03 s: no stop."""
    t = 0.01 * np.arange(100.0)
    v = np.outer(faster * (t - 0.5), (1.0, 0.0, 0.0))
    assert revised_at_100_hz(v, (40, 61)) == left


def test_a_field_stronger_beyond_all_measure_has_no_weight() -> None:
    """The first field may be as good as none: hypothesis found 1e-126 uT."""
    rest = simulate("pour", "modern", 0).recording
    noise = noise_of(rest, find_rest(rest))
    north, south = np.array([0.0, 0.5, -0.8]), np.array([0.0, -0.5, -0.8])
    for strength in (1e-126, 1e-300):
        assert not compass_heading(np.array([north, south]), strength, -1.0, noise)[2].any()
    strength, dip = float(np.linalg.norm(north)), float(np.arctan2(-0.8, 0.5))
    east = np.array([0.5, 0.0, -0.8])  # as strong and as steep, but by iron
    trusted, bent = compass_heading(np.array([north, east]), strength, dip, noise)[2]
    assert trusted > 0.99
    assert bent < 0.1


@pytest.mark.parametrize("sensor", ["wt901", "modern"])
def test_where_the_field_is_vertical_a_compass_changes_nothing(sensor: str) -> None:
    """With a dip of 88 degrees, as in the far north."""
    demo = simulate("pour", sensor, 0, world=World(field=(0.0, 2.0, -57.0)))
    seen, blind = (smoothed(replace(demo.recording, mag=mag)) for mag in (demo.recording.mag, None))
    assert not_none(seen.solution).converged
    np.testing.assert_allclose(seen.path.p, blind.path.p, rtol=0.0, atol=1e-5)


def test_without_a_compass_nothing_tells_the_heading() -> None:
    """Turning all about the vertical fits as well. A Hessian that says otherwise makes heading's sigma too small."""
    solution = not_none(smoothed(replace(simulate("pour", "wt901", 0).recording, mag=None)).solution)
    problem, x = solution.problem, solution.state
    equations, _ = linearise(problem, x, solution.fixed, whitener(problem, solution.fixed))
    turn = np.zeros((len(problem.rows), STATE))
    up = np.array([0.0, 0.0, 1.0])
    turn[:, ROT], turn[:, VEL], turn[:, POS] = up, np.cross(up, x.v), np.cross(up, x.p)
    own = np.einsum("ki,kij,kj", turn, equations.diagonal, turn)
    information = own + 2.0 * np.einsum("ki,kij,kj", turn[1:], equations.below, turn[:-1]) - GAUGE_WEIGHT
    assert information < 1.0  # a sigma of over 1 rad; what stops move by (under 2 mm) turns too


def test_lag_and_scale_are_read_once_they_have_settled() -> None:
    """An iteration whose robust weights go on changing may know both long before it ends."""
    x: Any = SimpleNamespace(shared=np.zeros(SHARED))
    x.shared[LAG], x.shared[GYR_MATRIX][::4] = 0.02, 0.15

    def after(*steps: float) -> tuple[float, float]:
        solved: Any = SimpleNamespace(shared=1e-6 * np.eye(SHARED), d_shared=np.zeros(SHARED))
        solved.d_shared[LAG], solved.d_shared[GYR_MATRIX][::4] = steps
        return _large_lag_and_scale(x, solved)

    assert after(9e-4, -5e-4) == pytest.approx((0.02, -0.15))
    assert after(-2e-3, 5e-4) == pytest.approx((0.0, -0.15))
    assert after(9e-4, 2e-3) == pytest.approx((0.02, 0.0))


def test_the_first_guess_moves_as_the_samples_say() -> None:
    """Without velocities the first step would turn the end of a long recording by radians."""
    solution = not_none(smoothed(simulate("pour", "modern", 0).recording).solution)
    first, _ = _initial_state(solution.problem, solution.fixed.prior)
    assert first.v == pytest.approx(solution.state.v, abs=0.1)
    assert np.abs(solution.state.v).max() > 0.3
    assert not first.v[solution.problem.stop_of >= 0].any()


def test_noise_makes_one_knot_in_twenty_seem_to_move() -> None:
    squares = np.square(np.random.default_rng(0).normal(size=(100_000, 3))).sum(axis=1)
    assert (robust_weights(squares) < MOVING_WEIGHT).mean() == pytest.approx(0.05, abs=0.005)


N = np.array((0.3, -0.2, 0.5, 0.7, -0.4, 0.1))
"""Entries of an accelerometer's matrix."""


@pytest.fixture(scope="module")
def problem() -> Problem:
    return not_none(smoothed(simulate("pour", "wt901", 0).recording).solution).problem


def test_in_a_stop_the_accelerometers_matrix_multiplies_the_mean_force(problem: Problem) -> None:
    legs, middle = problem.legs, (problem.rows[:-1] + problem.rows[1:]) // 2
    C = quat_to_matrix(problem.frame.wxyz[middle])
    gained = (C.transpose(0, 2, 1) @ legs.dU[:, :, None])[:, :, 0]
    for stop in range(len(problem.stops)):
        within = np.flatnonzero(problem.same_stop & (problem.stop_of[:-1] == stop))
        force = gained[within].sum(axis=0) / legs.T[within].sum()
        for k in within:
            change = -C[k] @ lower_matrix(N) @ force
            np.testing.assert_allclose(legs.J[k, VEL, ACC_MATRIX] @ N, change * legs.T[k], rtol=1e-9)
            np.testing.assert_allclose(legs.J[k, POS, ACC_MATRIX] @ N, change * legs.T[k] ** 2 / 2.0, rtol=1e-9)


def test_the_drift_of_the_gyro_frame_does_not_change_a_stops_force() -> None:
    """The bias is half a degree a second. The first stop has a knot, but no leg; the second is tested."""
    force, T = np.array((1.0, 2.0, 9.0)), np.ones(100)
    C = quat_to_matrix(quat_exp(np.radians(0.5) * np.arange(100.0)[:, None] * (1.0, 0.0, 0.0)))
    none = np.zeros((0, 0))
    legs = Legs(T, none, C @ force, none, np.ones((100, 9, ERRORS)), none)
    _fix_sway(legs, C, np.ones(100, dtype=np.intp))
    np.testing.assert_allclose(legs.J[:, VEL, ACC_MATRIX] @ N, -C @ lower_matrix(N) @ force, rtol=1e-9, atol=1e-12)


def test_only_moves_show_the_gyros_scales(problem: Problem) -> None:
    shown = problem.legs.J[:, :, GYR_MATRIX].any(axis=(1, 2))
    np.testing.assert_array_equal(shown, ~problem.same_stop)


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_and_sway_raise_no_scale(seed: int) -> None:
    """Pouring turns the hand about x, which stays level: gravity never shows this axis' scale, of a prior of 1 %."""
    found = not_none(smoothed(simulate("pour", "wt901", seed).recording).solution).state.shared[ACC_MATRIX]
    assert abs(found[0]) < 0.3 * BARE.acc_scale
