"""The joint estimate finds what a task was made from, the hand's scatter, and outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pbd.fusion.joint_estimate import State, _Columns, _moved, _residuals, estimate_jointly
from pbd.fusion.marginals import DEVICE
from pbd.fusion.outliers import believed, disagreement
from pbd.fusion.scatter import alike, each
from pbd.pose import Array, matrix_log
from pbd.simulation.sensor_model import SENSOR_MODELS
from tests.benchmarks.fuse import errors_of, one_device
from tests.fusion.made import begun, parts, truth

MM = 1e-3


def test_the_derivatives_are_those_of_the_residuals() -> None:
    true = truth(3)
    takes, x = replace(parts(true, np.array(0.0), MM), frame=np.array((0, 0, 1, 1, 0, 0))), begun(true)
    x = replace(x, yaw=np.vstack((x.yaw, x.yaw + 0.01)), c=np.concatenate((x.c, x.c)))
    columns = _Columns(len(x.m), 2, 3, 1)
    r, J = _residuals(takes, x, columns)
    steps = 1e-6 * np.eye(columns.count)
    found = np.column_stack([(_residuals(takes, _moved(x, step, columns), columns)[0] - r) / 1e-6 for step in steps])
    np.testing.assert_allclose(found, J, atol=0.03)  # a rotation's residual of 0.03 rad is linear to so much


def test_what_takes_do_not_show_of_a_device_is_as_its_class_has_it() -> None:
    takes, true = parts(truth(2), np.array(MM), MM), truth(2)
    mean = np.linspace(0.1, 10.0, DEVICE)
    takes = replace(takes, marginals=tuple(replace(one, mean=mean) for one in takes.marginals))
    np.testing.assert_allclose(estimate_jointly(takes, begun(true), alike(6)).state.devices[0], mean, rtol=1e-9)


def test_frames_levers_and_how_sensors_sit_are_found_without_being_told() -> None:
    true = truth(4)
    found = estimate_jointly(parts(true, np.array(0.0), 1e-5), begun(true), alike(6)).state
    np.testing.assert_allclose(found.m, true.m, atol=5e-5)
    np.testing.assert_allclose(found.A, true.A, atol=1e-3)
    np.testing.assert_allclose(found.lever, true.lever, atol=2e-4)
    np.testing.assert_allclose(found.Q, true.Q, atol=1e-3)


@pytest.mark.parametrize(("hand", "sigma", "low", "high"), [(4.0, 1.0, 3.2, 4.8), (0.0, 4.0, 0.0, 1.6)])
def test_the_hands_scatter_is_told_from_the_trackers(hand: float, sigma: float, low: float, high: float) -> None:
    true = truth(8)
    scatter = estimate_jointly(parts(true, np.array(hand * MM), sigma * MM), begun(true), alike(6)).scatter
    assert low * MM < np.exp(scatter.log[2]) < high * MM


def test_where_the_tracker_hides_it_a_hand_scatters_as_hands_do() -> None:
    true = truth(2)
    scatter = estimate_jointly(parts(true, np.array(2.0 * MM), 20.0 * MM), begun(true), alike(6)).scatter
    assert 1.0 * MM < np.exp(scatter.log[2]) < 5.0 * MM


@pytest.mark.parametrize(("tracker", "off"), [(0.2, 0.3), (1.0, 0.5), (3.0, 0.2)])
def test_a_scatter_that_the_tracker_hides_is_found_without_going_to_and_fro(tracker: float, off: float) -> None:
    scatter = alike(4)
    rows = scatter.group.ravel()
    drift = np.full(len(rows), (tracker * MM) ** 2)
    for _ in range(40):
        variance, before = drift + np.exp(2.0 * scatter.log)[rows], scatter
        residuals = off * np.sqrt(drift)
        scatter = scatter.improved(np.diag(1.0 / variance), residuals / variance, rows, np.diag(drift))
    assert scatter.change(before) < 1e-3


def test_the_heading_of_a_nav_says_nothing_about_the_task() -> None:
    """A common error of 6 degrees, as a compass has; the smoother counts it to each keyframe."""
    takes, x = parts(truth(3), np.array(MM), MM), begun(truth(3))
    unsure = []
    for marginal in takes.marginals:
        p = marginal.p - marginal.p[0]
        turned = 0.1 * np.column_stack((np.cross((0.0, 0.0, 1.0), p), np.tile((0.0, 0.0, 1.0), (len(p), 1)))).ravel()
        unsure.append(replace(marginal, cov=marginal.cov + np.outer(turned, turned)))
    found, other = (estimate_jointly(each, x, alike(6)) for each in (takes, replace(takes, marginals=tuple(unsure))))
    np.testing.assert_allclose(other.state.m, found.state.m, atol=1e-7)
    np.testing.assert_allclose(other.cov, found.cov, atol=1e-9)


def test_a_keyframe_that_scatters_along_one_axis_is_found() -> None:
    true, hand = truth(8), np.full((6, 3), MM)
    hand[3, 1] = 8.0 * MM
    takes = parts(true, hand, 0.3 * MM)
    joint = estimate_jointly(takes, begun(true), alike(6))
    sigma = estimate_jointly(takes, joint.state, each(joint.scatter)).scatter.sigma[:, :3]
    assert divmod(int(np.argmax(sigma)), 3) == (3, 1)
    assert sigma[3, 1] > 2.0 * np.median(sigma)


def off(where: tuple[int, int], by: float, takes: int = 4) -> Array:
    values = np.zeros((takes, 6, 3))
    values[where] = by
    return values


@pytest.mark.parametrize(
    ("where", "by", "take", "keyframes"), [((2, 4), 0.03, None, ((2, 4),)), ((0, 0), 0.0, None, ())]
)
def test_a_keyframe_of_a_take_that_fits_no_other_is_left_out(
    where: tuple[int, int], by: float, take: int | None, keyframes: tuple[tuple[int, int], ...]
) -> None:
    true = truth(4)
    takes = parts(true, np.array(2.0 * MM), MM, off=off(where, by))
    found = believed(takes, estimate_jointly(takes, begun(true), alike(6)))[2]
    assert (found.take, found.keyframes) == (take, keyframes)


def test_no_keyframe_is_blamed_because_three_takes_show_little_of_the_scatter() -> None:
    """By the scatter that the others seem to have, one of these would be."""
    true = truth(3, seed=3)
    takes = parts(true, np.array(2.0 * MM), 0.5 * MM, seed=3)
    assert believed(takes, estimate_jointly(takes, begun(true), alike(6)))[2] == (None, ())


def test_a_take_that_is_off_everywhere_is_an_outlier() -> None:
    true, away = truth(4), np.random.default_rng(1).normal(scale=0.03, size=(4, 6, 3))
    away[[0, 1, 3]] = 0.0
    takes = parts(true, np.array(2.0 * MM), MM, off=away)
    assert believed(takes, estimate_jointly(takes, begun(true), alike(6)))[2].take == 2


def test_of_two_takes_none_is_blamed() -> None:
    true = truth(2)
    takes = parts(true, np.array(2.0 * MM), MM, off=off((1, 3), 0.05, takes=2))
    joint, _, found = believed(takes, estimate_jointly(takes, begun(true), alike(6)))
    assert (found.take, found.keyframes) == (None, ())
    assert disagreement(takes, joint, ["tea1", "tea2"]).startswith("tea1 and tea2 differ at keyframe 3")


def test_the_frame_is_the_first_takes() -> None:
    true = truth(3)
    found: State = estimate_jointly(parts(true, np.array(MM), MM), begun(true), alike(6)).state
    assert (found.yaw[0, 0], *found.c[0, 0], *found.lever[0]) == (0.0, *true.c[0], 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("aside", "known"), [(0.0, False), (0.2, True)])
def test_keyframes_above_each_other_do_not_show_how_the_sensor_is_turned(aside: float, known: bool) -> None:
    m = np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (aside, 0.0, 0.2)))
    true = replace(truth(2, count=3), m=m, A=np.tile(np.eye(3), (3, 1, 1)))
    sigma = estimate_jointly(parts(true, np.array(0.5 * MM), MM), begun(true), alike(3)).turn_sigma
    assert sigma[0] == 0.0
    assert (sigma[1] < np.radians(3.0)) == known
    assert known or sigma[1] > np.radians(45.0)


def test_the_case_is_nearer_to_what_both_sensors_lean_from_than_the_accelerometer_is() -> None:
    alone, both = [], []
    for seed in range(30):
        errors, case = errors_of(one_device(SENSOR_MODELS["wt901"], seed))
        x = replace(begun(truth(2)), devices=errors[None], A=np.eye(3)[None])
        alone.append(matrix_log(case))
        both.append(matrix_log(case @ x.of_case(0).A[0].T))
    assert np.std(both) < 0.6 * np.std(alone)  # a quarter of six angles that lean instead of one: a half
