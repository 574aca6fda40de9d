"""Nav from touched points: exact without noise, with honest sigmas with noise; a wrong point is found."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pbd.calibration.points import fit_points
from pbd.calibration.registration import (
    PointObservations,
    RegistrationProblem,
    align,
    jacobian,
    misfit,
    moved,
    observe_points,
)
from pbd.data import Keyframe
from pbd.data.covariance import PoseCovariance
from pbd.errors import CalibrationError, PbdWarning
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate

POINTS = np.array([[0.3, -0.2, 0.0], [0.6, -0.15, 0.02], [0.55, 0.2, 0.0], [0.25, 0.15, 0.1], [0.4, 0.0, 0.3]])
small = st.floats(-1.0, 1.0)
vectors = st.tuples(small, small, small).map(np.array)


def walk(seed: int, m: int) -> Array:
    """Return the covariance (3 m, 3 m) of positions with errors that accumulate over independent moves."""
    rng = np.random.default_rng(seed)
    moves = np.repeat(rng.uniform(0.002, 0.006, m) ** 2, 3)
    total = np.kron(np.tril(np.ones((m, m))), np.eye(3))
    return np.asarray(total @ np.diag(moves) @ total.T)


def touched(
    T_base_nav: Pose, points: Array = POINTS, scale: float = 1.0, lever: Array | None = None
) -> PointObservations:
    """Return the observations of a perfect tracker."""
    m = len(points)
    lever = np.zeros((m, 3)) if lever is None else lever
    p = (T_base_nav.inverse().act(points) - lever) / scale
    return PointObservations(p, lever, walk(0, m), tuple(range(1, m + 1)))


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


@pytest.mark.parametrize("tracker", [1.0, 0.2, 3.0])
def test_errors_are_within_their_sigmas(tracker: float) -> None:
    """Two sigmas hold 95 %, also if all touches share an error, and no less if the tracker's sigmas are too small."""
    T_base_nav = Pose(np.array([0.1, -0.4, 0.2]), quat_about_z(-2.0))
    perfect = touched(T_base_nav, POINTS[:4])
    stretched = 0.01 * perfect.p_nav_sensor.ravel()  # an accelerometer's scale
    perfect = replace(perfect, cov=perfect.cov + np.outer(stretched, stretched))
    root = tracker * np.linalg.cholesky(perfect.cov + 0.001**2 * np.eye(12))
    inside, chi2, left_out = [], [], []
    for seed in range(60 if tracker == 1.0 else 30):
        noise = root @ np.random.default_rng(seed).normal(size=12)
        fit = fit_points(replace(perfect, p_nav_sensor=perfect.p_nav_sensor + noise.reshape(4, 3)), POINTS[:4])
        turn = quat_log(quat_multiply(fit.T_base_nav.wxyz, quat_inverse(T_base_nav.wxyz)))
        error = np.append(fit.T_base_nav.p - T_base_nav.p, turn[2])
        inside.append(np.abs(error) < 2.0 * np.sqrt(np.diagonal(fit.cov))[[0, 1, 2, 5]])
        left_out.append(np.abs(fit.left_out) < 2.0 * fit.left_out_sigma)
        chi2.append(fit.chi2)
    assert np.mean(inside) > 0.88  # 240 or 120 draws of 0.95, in fours: one sigma is up to 0.03 or 0.04
    assert np.mean(left_out) > 0.88
    if tracker == 1.0:
        assert np.mean(inside) < 0.99
        assert np.mean(left_out) < 1.0
        assert np.mean(chi2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 8.0 / 60.0))


def test_the_jacobian_agrees_with_finite_differences() -> None:
    rng = np.random.default_rng(0)
    problem = RegistrationProblem(
        touched(Pose.identity(), lever=0.1 * rng.normal(size=(5, 3))), POINTS, free=True, scaled=True
    )
    pose, scale = Pose(rng.normal(size=3), quat_exp(rng.normal(size=3))), 1.2
    found = jacobian(problem, pose, scale)
    for column, step in zip(found.T, 1e-6 * np.eye(7), strict=True):
        ahead, behind = (misfit(problem, *moved(pose, scale, way * step)) for way in (1.0, -1.0))
        assert_allclose(column, (ahead - behind).ravel() / 2e-6, atol=1e-8)


def test_weights_follow_the_growing_sigma() -> None:
    """The misfit of a late, uncertain touch hardly changes the pose; the same misfit of an early one does."""
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


def test_a_hand_that_seems_twice_as_large_halves_the_scale_and_its_sigma() -> None:
    exact = touched(Pose.identity())
    double = replace(exact, p_nav_sensor=2.0 * exact.p_nav_sensor, cov=4.0 * exact.cov)
    one, two = fit_points(exact, POINTS, scaled=True), fit_points(double, POINTS, scaled=True, touch_m=0.002)
    assert two.scale == pytest.approx(0.5 * one.scale)
    assert two.scale_sigma == pytest.approx(0.5 * one.scale_sigma)


def test_a_point_that_is_left_out_has_no_influence() -> None:
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
        CalibrationError,
        match=r"contradict the demonstration by up to .* unclear which one is wrong \(row .* of the points\); check",
    ):
        fit_points(base, wrong)


def test_points_that_fit_nothing_are_refused() -> None:
    """No single point explains the misfit; whole Gauss-Newton steps diverge from inches that were read as cm."""
    with pytest.raises(CalibrationError, match=r"contradict the demonstration .* their coordinates and their order"):
        fit_points(touched(Pose.identity()), POINTS / 2.54)


@pytest.mark.parametrize(
    ("mistake", "check"),
    [
        (np.diag([-1.0, 1.0, 1.0]), "x or y, and whether x and y are exchanged"),
        (np.eye(3)[[1, 0, 2]], "x or y, and whether x and y are exchanged"),
        (np.diag([1.0, 1.0, -1.0]), "z"),
    ],
    ids=["sign", "swapped", "upside down"],
)
@pytest.mark.parametrize("points", [POINTS, [[0.3, -0.2, 0.1], [0.4, -0.1, 0.1], [0.6, 0.1, 0.1], [0.5, -0.2, 0.4]]])
def test_mirrored_points_are_refused(points: Array, mistake: Array, check: str) -> None:
    """Of the second ones three lie on a line: all but one fit mirrored, and that one must not be called wrong."""
    points = np.array(points)
    with pytest.raises(CalibrationError, match=f"fit the demonstration as in a mirror; check the sign of {check}$"):
        fit_points(touched(Pose.identity(), points), points @ mistake.T)


@pytest.mark.parametrize(
    ("points", "free", "message"),
    [
        (POINTS[:1], False, "1 point is too few; touch 3 or more"),
        ([[0.3, 0.0, 0.0], [0.3, 0.0, 0.2], [0.31, 0.0, 0.4]], False, "lie above each other .* heading is unknown"),
        ([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [0.7, 0.001, 0.0]], True, "lie on a line .* touch a point beside it"),
        ([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [0.3, 0.0, 0.0]], False, "points 1 and 3 are the same place"),
    ],
)
def test_points_that_do_not_determine_a_pose_are_refused(points: Array, free: bool, message: str) -> None:
    points = np.array(points)
    with pytest.raises(CalibrationError, match=message):
        fit_points(touched(Pose.identity(), points), points, free=free)


def test_a_level_line_of_points_is_enough_with_gravity_but_hides_a_sign() -> None:
    points = np.array([[0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [0.7, 0.0, 0.0]])
    T_base_nav = Pose(np.array([0.1, 0.2, 0.0]), quat_about_z(0.5))
    with pytest.warns(
        PbdWarning, match="fit as in a mirror too, so a wrong sign does not show; check the sign of x or"
    ):
        fit = fit_points(touched(T_base_nav, points), points)
    assert fit.T_base_nav.distance(T_base_nav)[1] < 1e-7
    points = np.array([[0.3 + 0.1 * k, 0.0, 0.0] for k in range(6)])
    wrong = points + np.outer(np.arange(6) == 2, (0.0, 0.1, 0.1))
    exact = touched(T_base_nav, points)
    with pytest.warns(PbdWarning, match="fit as in a mirror too"):  # the wrong point breaks no symmetry
        assert not fit_points(replace(exact, cov=0.05 * exact.cov), wrong).used[2]


def test_the_joint_covariance_of_tips_follows_from_that_of_the_poses() -> None:
    """Oracle: tips computed from poses and a lever that are drawn from their covariances."""
    rng = np.random.default_rng(0)
    root = 0.003 * rng.normal(size=(24, 24))
    joint = (root @ root.T).reshape(4, 6, 4, 6)
    covariance = PoseCovariance(4, lambda columns: np.einsum("jakb,kbc->jac", joint, columns))
    tip, tip_root = np.array([0.0, 0.02, 0.1]), 0.005 * rng.normal(size=(3, 3))
    poses = [Pose(rng.normal(size=3), quat_exp(rng.normal(size=3))) for _ in range(4)]
    keyframes = [Keyframe(float(k), 1.0, pose, np.eye(6)) for k, pose in enumerate(poses)]
    found = observe_points(keyframes, covariance, tip, tip_root @ tip_root.T).only((3, 1))
    draws = 20_000
    off = (rng.normal(size=(draws, 24)) @ root.T).reshape(draws, 4, 6)
    tips = tip + rng.normal(size=(draws, 3)) @ tip_root.T
    drawn = np.concatenate(
        [
            poses[k].p + off[:, k, :3] + quat_rotate(quat_multiply(quat_exp(off[:, k, 3:]), poses[k].wxyz), tips)
            for k in (3, 1)
        ],
        axis=1,
    )
    assert_allclose(drawn.mean(axis=0), (found.p_nav_sensor + found.lever).ravel(), atol=1e-3)
    expected = np.cov(drawn.T)
    sigma = np.sqrt(np.diagonal(expected))
    assert_allclose(found.cov / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.04)


@settings(max_examples=20)
@given(st.integers(0, 1000))
def test_no_other_yaw_aligns_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p_from, p_to = rng.normal(size=(2, 5, 3))
    level = align(p_from, p_to)
    assert_allclose(level.p, p_to.mean(axis=0) - quat_rotate(level.wxyz, p_from.mean(axis=0)), atol=1e-12)

    def left(yaw: float) -> float:
        turned = quat_rotate(quat_about_z(yaw), p_from - p_from.mean(axis=0))
        return float(((p_to - p_to.mean(axis=0) - turned) ** 2).sum())

    found = left(float(2.0 * np.arctan2(level.wxyz[3], level.wxyz[0])))
    assert found <= min(map(left, np.linspace(-np.pi, np.pi, 100))) + 1e-9


def test_of_three_points_none_can_be_checked_by_the_others_while_the_tilt_is_free() -> None:
    off = 0.002 * np.random.default_rng(0).normal(size=(3, 3))
    T_base_nav = Pose(np.array([0.1, 0.2, 0.3]), quat_exp((0.1, -0.05, 1.0)))
    with pytest.warns(PbdWarning, match="the points fit as in a mirror too"):
        fit = fit_points(touched(T_base_nav, POINTS[:3] + off), POINTS[:3], free=True)
    assert np.abs(fit.residuals).max() > 1e-4
    assert_allclose(fit.left_out, fit.residuals)
    assert (fit.left_out_sigma > 0.0).all()
