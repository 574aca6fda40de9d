"""The joint estimate recovers a made-up task, the hand's scatter and outliers."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtrc

from pbd.fusion.elimination import Part, Precision
from pbd.fusion.joint_estimate import (
    HOLD,
    MAX_ITERATIONS,
    Observations,
    TaskState,
    _residuals,
    _updated,
    estimate_jointly,
)
from pbd.fusion.marginals import DEVICE_ERRORS
from pbd.fusion.outliers import disagreement, outlying_take, without_outlying_keyframes
from pbd.fusion.scatter import common_scatter, keyframe_scatter
from pbd.pose import Array, matrix_log
from pbd.simulation.sensor_model import SENSOR_MODELS
from tests.benchmarks.fuse import errors_of, one_device
from tests.fusion.made_up_takes import PRIOR, Truth, initial_state, observations, rotations, truth

MM = 1e-3


def test_the_jacobian_agrees_with_finite_differences() -> None:
    true = truth(3)
    takes, x = replace(observations(true, np.array(0.0), MM), frame=np.array((0, 0, 1, 1, 0, 0))), initial_state(true)
    H = rotations(0.03 * np.random.default_rng(0).normal(size=(3, 3)))
    x = replace(x, yaw=np.vstack((x.yaw, x.yaw + 0.01)), c=np.concatenate((x.c, x.c)), H=H)
    r, J = _residuals(takes, x)
    of_take, device, poses = np.split(1e-6 * np.eye(J.shape[1]), np.cumsum((17, DEVICE_ERRORS)), axis=1)
    of_first = np.zeros_like(of_take)  # it defines the frame, but its hand has an H of its own
    of_first[:, HOLD] = of_take[:, HOLD]
    steps = zip(of_first, of_take, of_take, device, poses, strict=True)
    found = np.column_stack([(_residuals(takes, _updated(x, step))[0] - r) / 1e-6 for step in steps])
    np.testing.assert_allclose(found, J, atol=0.03)  # the Jacobian neglects second order of a rotation of 0.03 rad


def test_errors_that_the_takes_do_not_show_are_the_priors() -> None:
    takes, true = observations(truth(2), np.array(MM), MM), truth(2)
    mean = np.linspace(0.1, 10.0, DEVICE_ERRORS)
    takes = replace(takes, marginals=tuple(replace(one, mean=mean) for one in takes.marginals))
    np.testing.assert_allclose(
        estimate_jointly(takes, initial_state(true), common_scatter(6)).state.devices[0], mean, rtol=1e-9
    )


@pytest.mark.parametrize("widest", [0, 1])
def test_a_doubt_of_one_take_holds_for_all_takes_of_its_device(widest: int) -> None:
    takes, true = observations(truth(2), np.array(MM), MM), truth(2)
    wide, narrow = PRIOR, 100.0 * PRIOR
    marginals = tuple(replace(one, prior=wide if k == widest else narrow) for k, one in enumerate(takes.marginals))
    takes = replace(takes, marginals=marginals)
    found = estimate_jointly(takes, initial_state(true), common_scatter(6))
    np.testing.assert_allclose(found.cov_devices[0], np.linalg.inv(wide), rtol=1e-6, atol=1e-12)


def test_a_hand_that_holds_the_sensor_otherwise_in_each_take_does_not_tilt_the_dock() -> None:
    """The rotation in the hand was that away from the dock: the dock was tilted, and all was as in the first take."""
    held, true = rotations(np.radians(((4, 0, 0), (-4, 3, 0), (0, -3, 5), (0, 0, -5)))), truth(4)
    true = replace(true, lever=np.zeros((4, 3)))  # levers show the rotation of a task too
    takes = observations(true, np.array(MM), MM)
    for take, Q, H in zip(takes.marginals, true.Q, held, strict=True):
        take.R[1:] = take.R[1:] @ Q @ H.T @ Q.T
    found = estimate_jointly(takes, initial_state(true), common_scatter(6))
    off = np.degrees(np.abs(matrix_log(found.state.A @ true.A.transpose(0, 2, 1))))
    assert off[0, :2].max() < 0.1
    assert off[1:].max() < 0.5  # the mean of the four
    cov = found.cov.reshape(6, 6, 6, 6)
    sigma = np.degrees(np.sqrt([np.linalg.eigvalsh(cov[j, 3:, j, 3:])[-1] for j in range(6)]))
    assert np.degrees(np.sqrt(np.diagonal(cov[0, 3:5, 0, 3:5])).max()) < 0.3
    assert np.all((sigma[1:] > 1.0) & (sigma[1:] < 2.5))  # 3 degrees rms, of four


def test_many_takes_held_otherwise_do_not_tilt_the_dock() -> None:
    """Sigma of H began so low that the scatter of the dock rose to 4 degrees instead."""
    held, true = rotations(np.radians(5.0) * np.random.default_rng(0).normal(size=(16, 3))), truth(16)
    true = replace(true, lever=np.zeros((16, 3)))
    takes = observations(true, np.array(MM), MM)
    for take, Q, H in zip(takes.marginals, true.Q, held, strict=True):
        take.R[1:] = take.R[1:] @ Q @ H.T @ Q.T
    found = estimate_jointly(takes, initial_state(true), common_scatter(6))
    assert np.degrees(np.linalg.norm(matrix_log(found.state.A[0] @ true.A[0].T))) < 0.1


def test_a_sensor_docked_with_another_heading_in_each_take_does_not_turn_the_task() -> None:
    """The hold away from the dock explained it: the heading was the first take's, to a fifth of a degree."""
    true = truth(8)
    takes = observations(true, np.array(MM), MM)
    for take, heading_deg in zip(takes.marginals, (2.0, -2.0, 2.0, 1.0, -2.0, 0.0, 1.0, -2.0), strict=True):
        take.R[0] = rotations(np.radians((0.0, 0.0, heading_deg))) @ take.R[0]
    found = estimate_jointly(takes, initial_state(true), common_scatter(6))
    off = np.degrees(matrix_log(found.state.A @ true.A.transpose(0, 2, 1))[0, 2])
    assert abs(off) < 1.0
    assert abs(off) < 2.0 * np.degrees(np.sqrt(found.cov[5, 5]))


def test_frames_levers_and_rotations_in_the_hand_are_found() -> None:
    true = truth(4)
    found = estimate_jointly(observations(true, np.array(0.0), 1e-5), initial_state(true), common_scatter(6)).state
    np.testing.assert_allclose(found.m, true.m, atol=5e-5)
    np.testing.assert_allclose(found.A, true.A, atol=1e-3)
    np.testing.assert_allclose(found.lever, true.lever, atol=2e-4)
    np.testing.assert_allclose(found.Q, true.Q, atol=1e-3)


def test_levers_are_held_near_zero_if_all_takes_hold_the_sensor_alike() -> None:
    """Free up to a hand's width, they would fit the scatter of 3 mm."""
    true = replace(truth(4), lever=np.zeros((4, 3)))
    found = estimate_jointly(observations(true, np.array(3.0 * MM), MM), initial_state(true), common_scatter(6)).state
    assert np.sqrt((found.lever[1:] ** 2).mean()) < 2.5 * MM


def test_without_the_first_take_the_frame_stays() -> None:
    """A tracker less certain along one axis: nothing but the first take that is left keeps all from turning on."""
    true, uneven = truth(4), np.tile((1.0, 5.0, 1.0), 12)
    takes = observations(true, np.array(2.0 * MM), MM)
    marginals = tuple(replace(one, cov=one.cov * np.outer(uneven, uneven)) for one in takes.marginals)
    takes = replace(takes, marginals=marginals)
    x = estimate_jointly(takes, initial_state(true), common_scatter(6)).state
    rest = estimate_jointly(takes.subset(takes.take > 0), x, common_scatter(6)).state
    np.testing.assert_allclose(rest.A, x.A, atol=0.05)


def test_one_iteration_suffices_for_another_scatter_held_fixed() -> None:
    true = truth(4)
    takes = observations(true, np.array(2.0 * MM), MM)
    joint = estimate_jointly(takes, initial_state(true), common_scatter(6))
    held = replace(joint.scatter, prior_log=joint.scatter.log, prior_spread=np.full(5, 1e-3))
    sets = list(np.arange(6 * len(takes.at)).reshape(-1, 6))
    one, all_ = (estimate_jointly(takes, joint.state, held, n).chi_squares(sets) for n in (1, MAX_ITERATIONS))
    np.testing.assert_allclose(one, all_, rtol=0.1)


@pytest.mark.parametrize(("hand", "sigma", "low", "high"), [(4.0, 1.0, 3.2, 4.8), (0.0, 4.0, 0.0, 1.6)])
def test_the_hands_scatter_is_separated_from_the_trackers(hand: float, sigma: float, low: float, high: float) -> None:
    true = truth(8)
    scatter = estimate_jointly(
        observations(true, np.array(hand * MM), sigma * MM), initial_state(true), common_scatter(6)
    ).scatter
    assert low * MM < np.exp(scatter.log[2]) < high * MM


def test_a_scatter_below_the_trackers_sigma_stays_near_its_prior() -> None:
    true = truth(2)
    scatter = estimate_jointly(
        observations(true, np.array(2.0 * MM), 20.0 * MM), initial_state(true), common_scatter(6)
    ).scatter
    assert 1.0 * MM < np.exp(scatter.log[2]) < 5.0 * MM


@pytest.mark.parametrize(("tracker", "off"), [(0.2, 0.3), (1.0, 0.5), (3.0, 0.2)])
def test_a_scatter_below_the_trackers_sigma_converges_without_oscillation(tracker: float, off: float) -> None:
    scatter = common_scatter(4)
    rows = scatter.group.ravel()
    drift, no_unknowns = np.full(len(rows), (tracker * MM) ** 2), Part(slice(None), slice(0), np.eye(0), np.zeros(0))
    for _ in range(40):
        variance, before = drift + np.exp(2.0 * scatter.log)[rows], scatter
        residuals = off * np.sqrt(drift)
        precision = Precision([np.diag(1.0 / variance)], [no_unknowns], np.zeros((len(rows), 0)))
        scatter = scatter.improved(precision, residuals / variance, rows, [np.diag(drift)])
    assert scatter.change(before) < 1e-3


def test_memory_grows_no_faster_than_takes_even_if_each_has_its_own_device() -> None:
    """A matrix over all residuals, or over all takes' unknowns, would grow with their square."""
    peaks = []
    for takes in (10, 20):
        shown, x = observations(truth(takes), np.array(MM), MM), initial_state(truth(takes))
        shown, x = replace(shown, device=tuple(range(takes))), replace(x, devices=np.zeros((takes, DEVICE_ERRORS)))
        tracemalloc.start()
        estimate_jointly(shown, x, common_scatter(6), iterations=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.2 * peaks[0]


def test_the_uncertain_heading_of_a_nav_does_not_matter() -> None:
    """A common heading error of 6 degrees, as a compass has, is in the covariance of all keyframes."""
    takes, x = observations(truth(3), np.array(MM), MM), initial_state(truth(3))
    unsure = []
    for marginal in takes.marginals:
        p = marginal.p - marginal.p[0]
        turned = 0.1 * np.column_stack((np.cross((0.0, 0.0, 1.0), p), np.tile((0.0, 0.0, 1.0), (len(p), 1)))).ravel()
        unsure.append(replace(marginal, cov=marginal.cov + np.outer(turned, turned)))
    found, other = (
        estimate_jointly(each, x, common_scatter(6)) for each in (takes, replace(takes, marginals=tuple(unsure)))
    )
    np.testing.assert_allclose(other.state.m, found.state.m, atol=1e-7)
    np.testing.assert_allclose(other.cov, found.cov, atol=1e-9)


def test_a_keyframe_that_scatters_along_one_axis_is_found() -> None:
    true, hand = truth(8), np.full((6, 3), MM)
    hand[3, 1] = 8.0 * MM
    takes = observations(true, hand, 0.3 * MM)
    joint = estimate_jointly(takes, initial_state(true), common_scatter(6))
    sigma = estimate_jointly(takes, joint.state, keyframe_scatter(joint.scatter)).scatter.sigma[:, :3]
    assert divmod(int(np.argmax(sigma)), 3) == (3, 1)
    assert 4.0 < sigma[3, 1] / np.median(sigma) < 8.0  # it is 8; a few takes show it half


def test_keyframes_of_an_even_hand_seem_no_more_uneven_than_their_standard_deviations() -> None:
    logs = []
    for seed in range(8):
        true = truth(8, seed)
        takes = observations(true, np.array(2.0 * MM), 0.2 * MM, seed)
        joint = estimate_jointly(takes, initial_state(true), common_scatter(6))
        sigma = estimate_jointly(takes, joint.state, keyframe_scatter(joint.scatter)).scatter.sigma[1:, :3]
        logs.append(np.log(sigma).std())
    assert np.mean(logs) < (2.0 * (8 - 1)) ** -0.5  # of the logarithm of a standard deviation of 8 values


def offsets(where: tuple[int, int], by: float, takes: int = 4) -> Array:
    values = np.zeros((takes, 6, 3))
    values[where] = by
    return values


def outliers(takes: Observations, true: Truth) -> tuple[int | None, tuple[tuple[int, int], ...]]:
    """Return the take that is an outlier, and the keyframes that are."""
    joint = estimate_jointly(takes, initial_state(true), common_scatter(6))
    return outlying_take(takes, joint), tuple(without_outlying_keyframes(takes, joint)[2])


@pytest.mark.parametrize(
    ("where", "by", "take", "keyframes"), [((2, 4), 0.03, None, ((2, 4),)), ((0, 0), 0.0, None, ())]
)
def test_an_outlying_keyframe_of_a_take_is_left_out(
    where: tuple[int, int], by: float, take: int | None, keyframes: tuple[tuple[int, int], ...]
) -> None:
    true = truth(4)
    takes = observations(true, np.array(2.0 * MM), MM, off=offsets(where, by))
    assert outliers(takes, true) == (take, keyframes)


@pytest.mark.parametrize(("by", "keyframes"), [(0.0, ()), (0.018, ()), (0.020, ((2, 4),))])
def test_the_scatter_that_three_takes_show_is_raised_before_one_is_tested(
    by: float, keyframes: tuple[tuple[int, int], ...]
) -> None:
    """With the scatter of the others as estimated, without its uncertainty, a sound keyframe would be an outlier."""
    true = truth(3, seed=3)
    takes = observations(true, np.array(2.0 * MM), 0.5 * MM, seed=3, off=offsets((2, 4), by, takes=3))
    assert outliers(takes, true) == (None, keyframes)


@pytest.mark.parametrize(("by", "left_out"), [(3.0, False), (3.1, True)])
def test_chance_reports_an_outlier_in_one_fusion_of_a_hundred(by: float, left_out: bool) -> None:
    """Each of 24 keyframes' position and attitude is tested. With a tracker's sigma of 1 m scatter does not matter."""
    takes = observations(truth(4), np.array(0.0), 1.0, off=offsets((2, 4), by))
    joint = estimate_jointly(takes, initial_state(truth(4)), common_scatter(6))
    chance = 48.0 * chdtrc(3, joint.chi_squares([6 * (2 * 6 + 4) + np.arange(3)])[0])
    assert 0.006 < chance < 0.016
    assert bool(outliers(takes, truth(4))[1]) == left_out == (chance < 0.01)


def test_a_start_beside_the_dock_is_an_outlier_though_it_raises_the_scatter_of_the_dock() -> None:
    true = truth(3)
    takes = observations(true, np.array(2.0 * MM), MM, off=offsets((1, 0), 0.1, takes=3))
    assert outliers(takes, true) == (None, ((1, 0),))


@pytest.mark.parametrize("takes_shown", [3, 4])
def test_a_take_that_is_off_at_all_keyframes_is_an_outlier(takes_shown: int) -> None:
    true, away = truth(takes_shown), np.random.default_rng(1).normal(scale=0.03, size=(takes_shown, 6, 3))
    away[[k for k in range(takes_shown) if k != 2]] = 0.0
    takes = observations(true, np.array(2.0 * MM), MM, off=away)
    assert outliers(takes, true)[0] == 2


def test_a_take_whose_sensor_was_turned_in_the_hand_half_way_is_an_outlier() -> None:
    true = truth(4)
    takes = observations(true, np.array(2.0 * MM), MM)
    R = takes.marginals[1].R.copy()
    R[3:] = R[3:] @ rotations(np.array((0.0, 0.0, 0.35)))
    marginals = (takes.marginals[0], replace(takes.marginals[1], R=R), *takes.marginals[2:])
    assert outliers(replace(takes, marginals=marginals), true)[0] == 1


def test_a_take_is_an_outlier_even_if_a_lever_of_metres_would_explain_it() -> None:
    true = truth(3)
    tilted = rotations(0.03 * np.random.default_rng(0).normal(size=(6, 3)))
    true = replace(true, A=tilted, lever=np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 2.0))))
    takes = observations(true, np.array(2.0 * MM), MM)
    assert outliers(takes, true)[0] == 2


def test_a_difference_of_two_takes_is_reported_without_leaving_one_out() -> None:
    true = truth(2)
    takes = observations(true, np.array(2.0 * MM), MM, off=offsets((1, 3), 0.05, takes=2))
    assert outliers(takes, true) == (None, ())
    joint = estimate_jointly(takes, initial_state(true), common_scatter(6))
    assert disagreement(takes, joint, ["tea1", "tea2"]).startswith("tea1 and tea2 differ at keyframe 3")


def test_the_first_take_defines_the_frame() -> None:
    true = truth(3)
    found: TaskState = estimate_jointly(
        observations(true, np.array(MM), MM), initial_state(true), common_scatter(6)
    ).state
    assert (found.yaw[0, 0], *found.c[0, 0], *found.lever[0]) == (0.0, *true.c[0], 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("aside", "known"), [(0.0, False), (0.2, True)])
def test_keyframes_above_each_other_leave_the_rotation_in_the_hand_uncertain(aside: float, known: bool) -> None:
    m = np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (aside, 0.0, 0.2)))
    true = replace(truth(2, count=3), m=m, A=np.tile(np.eye(3), (3, 1, 1)))
    sigma = estimate_jointly(
        observations(true, np.array(0.5 * MM), MM), initial_state(true), common_scatter(3)
    ).turn_sigma
    assert sigma[0] == 0.0
    assert (sigma[1] < np.radians(3.0)) == known
    assert known or sigma[1] > np.radians(45.0)


def test_the_axes_of_the_case_are_found_better_than_by_the_accelerometer() -> None:
    alone, both = [], []
    for seed in range(30):
        errors, case = errors_of(one_device(SENSOR_MODELS["wt901"], seed))
        x = replace(initial_state(truth(2)), devices=errors[None], A=np.eye(3)[None])
        alone.append(matrix_log(case))
        both.append(matrix_log(case @ x.in_case_axes(0).A[0].T))
    assert np.std(both) < 0.6 * np.std(alone)  # six misaligned angles are averaged instead of one: half the error
