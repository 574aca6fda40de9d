"""Nav from touched points: exact without noise, honest about its sigma with noise; a wrong point is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from pbd.calibration.alignment import align
from pbd.calibration.points import fit_points
from pbd.calibration.registration import Problem, jacobian, misfit, moved
from pbd.calibration.touches import SHAPE, Touches, common_errors, touches
from pbd.data import Keyframe
from pbd.errors import CalibrationError
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.sensors.simulate import EARTH, simulate
from pbd.sensors.simulated_hand import Waypoint
from pbd.sensors.simulated_sensor import SENSOR_MODELS, Triad
from pbd.sensors.simulated_tasks import Task
from pbd.tracking.keyframes import find_keyframes
from tests.scenarios import uncalibrated

POINTS = np.array([[0.3, -0.2, 0.0], [0.6, -0.15, 0.02], [0.55, 0.2, 0.0], [0.25, 0.15, 0.1], [0.4, 0.0, 0.3]])
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
small = st.floats(-1.0, 1.0)
vectors = st.tuples(small, small, small).map(np.array)


def walk(seed: int, m: int) -> Array:
    """The covariance (3 m, 3 m) of positions that drift by independent moves."""
    rng = np.random.default_rng(seed)
    moves = np.repeat(rng.uniform(0.002, 0.006, m) ** 2, 3)
    total = np.kron(np.tril(np.ones((m, m))), np.eye(3))
    return np.asarray(total @ np.diag(moves) @ total.T)


def touched(T_base_nav: Pose, points: Array = POINTS, scale: float = 1.0, lever: Array | None = None) -> Touches:
    """What a perfect tracker says."""
    m = len(points)
    lever = np.zeros((m, 3)) if lever is None else lever
    p = (T_base_nav.inverse().act(points) - lever) / scale
    return Touches(p, lever, walk(0, m), np.zeros((3 * m, 21)), tuple(range(1, m + 1)))


@settings(max_examples=15)
@given(vectors, st.floats(-np.pi, np.pi), st.floats(0.8, 1.25), vectors)
def test_without_noise_the_pose_is_found_exactly(p: Array, yaw: float, scale: float, lever: Array) -> None:
    T_base_nav = Pose(p, quat_about_z(yaw))
    levers = np.array([quat_rotate(quat_exp((0.1 * k, 0.2, 0.3 * k)), 0.1 * lever) for k in range(len(POINTS))])
    fit = fit_points(touched(T_base_nav, scale=scale, lever=levers), POINTS, scaled=True)
    metres, rad = fit.T_base_nav.distance(T_base_nav)
    assert metres < 1e-7
    assert rad < 1e-7
    assert fit.scale == pytest.approx(scale, abs=1e-7)
    assert_allclose(fit.residuals, 0.0, atol=1e-7)
    assert_allclose(fit.left_out, 0.0, atol=1e-6)
    assert all(fit.used)


@settings(max_examples=8)
@given(vectors, vectors)
def test_a_free_tilt_is_found_exactly(p: Array, turn: Array) -> None:
    T_base_nav = Pose(p, quat_exp(3.0 * turn))
    metres, rad = fit_points(touched(T_base_nav), POINTS, free=True).T_base_nav.distance(T_base_nav)
    assert metres < 1e-7
    assert rad < 1e-7


@settings(max_examples=15)
@given(vectors, st.floats(-np.pi, np.pi))
def test_a_turned_base_turns_the_answer(p: Array, yaw: float) -> None:
    noisy = touched(Pose(np.array([0.1, 0.2, 0.3]), quat_about_z(1.0)))
    noise = np.linalg.cholesky(noisy.cov) @ np.random.default_rng(1).normal(size=15)
    noisy = replace(noisy, p_nav_sensor=noisy.p_nav_sensor + noise.reshape(5, 3))
    turn = Pose(p, quat_about_z(yaw))
    fit, turned = fit_points(noisy, POINTS), fit_points(noisy, turn.act(POINTS))
    metres, rad = turned.T_base_nav.distance(turn @ fit.T_base_nav)
    assert metres < 1e-6
    assert rad < 1e-6
    assert turned.chi2 == pytest.approx(fit.chi2, rel=1e-4)


@pytest.mark.parametrize(("tracker", "size"), [(1.0, 0.002), (0.2, 0.004), (3.0, 0.06)])
def test_errors_lie_within_the_sigmas_that_are_told(tracker: float, size: float) -> None:
    """Whatever the tracker's sigmas are worth, and however bad the sensor is: two sigma hold 95 %."""
    T_base_nav = Pose(np.array([0.1, -0.4, 0.2]), quat_about_z(-2.0))
    perfect = touched(T_base_nav, POINTS[:4])
    keyframes = [Keyframe(float(k), 1.0, Pose(p, LEVEL), np.eye(6)) for k, p in enumerate(perfect.p_nav_sensor)]
    perfect = replace(perfect, common=common_errors(keyframes, np.zeros(3)).reshape(12, 21))
    root = tracker * np.linalg.cholesky(perfect.covariance(size / tracker) + 0.001**2 * np.eye(12))
    inside, chi2, left_out = [], [], []
    for seed in range(30):
        noise = root @ np.random.default_rng(seed).normal(size=12)
        fit = fit_points(replace(perfect, p_nav_sensor=perfect.p_nav_sensor + noise.reshape(4, 3)), POINTS[:4])
        turn = quat_log(quat_multiply(fit.T_base_nav.wxyz, quat_inverse(T_base_nav.wxyz)))
        error = np.append(fit.T_base_nav.p - T_base_nav.p, turn[2])
        inside.append(np.abs(error) < 2.0 * np.sqrt(np.diagonal(fit.cov))[[0, 1, 2, 5]])
        left_out.append(np.abs(fit.left_out) < 2.0 * fit.left_out_sigma)
        chi2.append(fit.chi2)
    assert 0.88 < np.mean(inside) < 1.0  # 120 draws of 0.95, in fours: one sigma is up to 0.04
    assert 0.88 < np.mean(left_out) < 1.0
    if tracker == 1.0:
        assert np.mean(chi2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 8.0 / 30.0))


def test_the_jacobian_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(0)
    problem = Problem(touched(Pose.identity(), lever=0.1 * rng.normal(size=(5, 3))), POINTS, free=True, scaled=True)
    pose, scale = Pose(rng.normal(size=3), quat_exp(rng.normal(size=3))), 1.2
    found = jacobian(problem, pose, scale)
    for column, step in zip(found.T, 1e-6 * np.eye(7), strict=True):
        ahead, behind = (misfit(problem, *moved(pose, scale, way * step)) for way in (1.0, -1.0))
        assert_allclose(column, (ahead - behind).ravel() / 2e-6, atol=1e-8)


def test_weights_follow_the_growing_sigma() -> None:
    """A late touch that is far less sure hardly moves the answer; the same misfit of an early one does."""
    true = Pose.identity()
    base = touched(true)
    cov: Array = np.diag(np.repeat([1e-6, 1e-6, 1e-6, 1e-6, 1e-2], 3))
    shifts = []
    for k in (0, 4):
        p = base.p_nav_sensor.copy()
        p[k] += (0.003, 0.0, 0.0)
        shifts.append(fit_points(replace(base, p_nav_sensor=p, cov=cov), POINTS).T_base_nav.distance(true)[0])
    assert shifts[1] < 0.02 * shifts[0]


@pytest.mark.parametrize("wrong", range(5))
@pytest.mark.parametrize("free", [False, True])
def test_a_wrong_point_is_named_and_left_out(wrong: int, free: bool) -> None:
    T_base_nav = Pose(np.array([0.1, 0.2, 0.0]), quat_about_z(0.5))
    points = np.vstack((POINTS, [[0.7, 0.0, 0.15]]))
    exact = touched(T_base_nav, points)
    exact = replace(exact, cov=0.2 * exact.cov)
    moved = points.copy()
    moved[wrong] += (0.06, -0.05, 0.06)
    fit = fit_points(exact, moved, free=free)
    assert [k for k, used in enumerate(fit.used) if not used] == [wrong]
    assert fit.T_base_nav.distance(T_base_nav)[0] < 1e-6
    assert_allclose(fit.left_out[wrong], (0.06, -0.05, 0.06), atol=1e-6)


def test_leaving_a_point_out_means_that_it_has_no_say() -> None:
    base = touched(Pose.identity())
    moved = POINTS.copy()
    moved[2] += (0.004, -0.003, 0.002)
    before, after = fit_points(base, POINTS), fit_points(base, moved)
    assert_allclose(after.left_out[2] - before.left_out[2], (0.004, -0.003, 0.002), atol=1e-7)


def test_three_points_that_contradict_each_other_are_refused() -> None:
    base = touched(Pose.identity(), POINTS[:3])
    wrong = POINTS[:3].copy()
    wrong[1] += (0.0, 0.0, 0.2)
    with pytest.raises(
        CalibrationError, match=r"contradict the demonstration by up to .* unclear which one is wrong \(point .*check"
    ):
        fit_points(base, wrong)


@pytest.mark.parametrize(
    ("points", "free", "message"),
    [
        (POINTS[:2], False, "2 points are too few; touch 3 or more"),
        ([[0.3, 0.0, 0.0], [0.3, 0.0, 0.2], [0.31, 0.0, 0.4]], False, "lie above each other .* heading is unknown"),
        ([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [0.7, 0.001, 0.0]], True, "lie on a line .* touch a point beside it"),
        ([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [0.3, 0.0, 0.0]], False, "points 1 and 3 are the same place"),
    ],
)
def test_points_that_tell_too_little_are_refused(points: Array, free: bool, message: str) -> None:
    points = np.array(points)
    with pytest.raises(CalibrationError, match=message):
        fit_points(touched(Pose.identity(), points), points, free=free)


def test_a_level_line_of_points_is_enough_with_gravity() -> None:
    points = np.array([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [0.7, 0.0, 0.0]])
    T_base_nav = Pose(np.array([0.1, 0.2, 0.0]), quat_about_z(0.5))
    assert fit_points(touched(T_base_nav, points), points).T_base_nav.distance(T_base_nav)[1] < 1e-7


def test_touches_share_what_arose_before() -> None:
    """The oracle: errors drawn move by move, with the attitude's on the lever."""
    rng = np.random.default_rng(0)
    lever, p_sensor_tip = [], np.array([0.0, 0.02, 0.1])
    keyframes, variance = [], 0.0
    for k in range(4):
        cov = np.diag([*[variance] * 3, 1e-4, 2e-4, 3e-4])
        T_nav_sensor = Pose(rng.normal(size=3), quat_exp(rng.normal(size=3)))
        keyframes.append(Keyframe(float(k), 1.0, T_nav_sensor, cov))
        lever.append(quat_rotate(T_nav_sensor.wxyz, p_sensor_tip))
        variance += (k + 1.0) * 1e-4
    found = touches(keyframes, (1, 2, 3), p_sensor_tip)
    assert_allclose(found.lever, lever[1:])
    draws = 40_000
    steps = rng.normal(size=(draws, 3, 3)) * np.sqrt([1e-4, 2e-4, 3e-4])[:, None]
    turns = rng.normal(size=(draws, 3, 3)) * np.sqrt([1e-4, 2e-4, 3e-4])
    tips = np.cumsum(steps, axis=1) + np.cross(turns, np.array(lever[1:]))
    drawn = np.cov(tips.reshape(draws, 9).T)
    assert_allclose(found.cov, drawn, atol=5.0 * 6e-4 / np.sqrt(draws) * np.sqrt(2.0))


def test_what_all_moves_share_is_not_counted_twice() -> None:
    """The tracker's covariance has the stretch in it, as each move's own; the touches' has what is left."""
    rng, stretch, own, variance = np.random.default_rng(0), 0.015, 0.0, 0.0
    p, keyframes, left = np.zeros(3), [], []
    for k in range(5):
        step = rng.normal(scale=0.3, size=3) if k else np.zeros(3)
        more = 1e-6 * (k + 1.0) if k else 0.0
        p, own, variance = p + step, own + more, variance + more + stretch**2 * float(step @ step)
        keyframes.append(Keyframe(float(k), 1.0, Pose(p, LEVEL), np.diag([*[variance] * 3, 0.0, 0.0, 0.0])))
        left.append(own)
    cov = touches(keyframes, range(1, 5), np.zeros(3), stretch).cov.reshape(4, 3, 4, 3)
    for j in range(4):
        for k in range(4):
            assert_allclose(cov[j, :, k], left[1 + min(j, k)] * np.eye(3), atol=1e-12)


@uncalibrated
@pytest.mark.parametrize(
    ("kind", "errs", "columns"),
    [
        ("acc", Triad(bias=0.2), slice(3)),
        ("acc", Triad(scale=0.02, misalignment=0.02), slice(3, 12)),
        ("gyr", Triad(scale=0.02), slice(12, 21)),  # its misalignment tilts moves too, which the stops mostly undo
    ],
)
def test_what_all_moves_share_is_what_such_a_sensor_does(kind: str, errs: Triad, columns: slice) -> None:
    """The oracle: a simulated sensor with these errors and no others, tracked; the hand is yawed all along."""
    model = replace(SENSOR_MODELS["ideal"], mag=None)
    model = replace(model, acc=errs) if kind == "acc" else replace(model, gyr=errs)
    places = ((0.3, 0.0, 0.0), (0.3, 0.25, 0.1), (0.0, 0.2, -0.1))
    yawed = (0.0, 0.0, 0.1 if kind == "acc" else 0.8)
    task = Task("places", (Waypoint(rest_s=2.0), *(Waypoint(place, yawed, 1.0, 1.0) for place in places)))
    demo = simulate(task, model, seed=1)
    rng = np.random.default_rng(1).spawn(5)[1 if kind == "acc" else 2]  # as the simulator draws a device
    gain = np.diag(errs.scale * rng.normal(size=3)) + errs.misalignment * rng.normal(size=(3, 3)) * (1.0 - np.eye(3))
    bias = errs.bias * rng.normal(size=3) / EARTH.gravity
    keyframes = find_keyframes(track(demo.recording))
    by_unit = common_errors(keyframes, np.zeros(3)) / SHAPE
    assert demo.truth is not None
    true = np.array([demo.truth.p_nav_sensor[np.argmin(np.abs(demo.truth.t - each.t))] for each in keyframes])
    off = np.array([each.T_nav_sensor.p for each in keyframes]) - true
    expected = by_unit[:, :, columns] @ (bias if errs.bias else gain.ravel())
    assert np.linalg.norm(expected[-1]) > 0.002
    assert np.linalg.norm(off - expected) < 0.25 * np.linalg.norm(off)


@given(st.integers(0, 1000))
def test_alignment_agrees_with_second_implementations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p_from, p_to = rng.normal(size=(2, 5, 3))
    free = align(p_from, p_to, free=True)
    other, _ = Rotation.align_vectors(p_to - p_to.mean(axis=0), p_from - p_from.mean(axis=0))
    assert_allclose(free.matrix()[:3, :3], other.as_matrix(), atol=1e-6)

    level = align(p_from, p_to)
    assert_allclose(level.p, p_to.mean(axis=0) - quat_rotate(level.wxyz, p_from.mean(axis=0)), atol=1e-12)

    def left(yaw: float) -> float:
        turned = quat_rotate(quat_about_z(yaw), p_from - p_from.mean(axis=0))
        return float(((p_to - p_to.mean(axis=0) - turned) ** 2).sum())

    found = left(float(2.0 * np.arctan2(level.wxyz[3], level.wxyz[0])))
    best = min(
        float(minimize_scalar(left, bounds=(a, a + np.pi), method="bounded").fun) for a in (-np.pi, -0.5 * np.pi, 0.0)
    )
    assert found <= best + 1e-9
