"""The sensor's mount on the tool: the lever by pivoting the tip, the rotation by turns about named axes."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pbd.calibration.mount import AXES, PivotFit, fit_pivot, fit_turns
from pbd.data import Keyframe
from pbd.data.covariance import PoseCovariance
from pbd.errors import CalibrationError
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.simulation.calibration_tasks import pivoting
from pbd.simulation.simulate import simulate
from pbd.tracking.keyframes import find_keyframes
from tests.scenarios import uncalibrated

TIP = (0.03, -0.02, 0.0928)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def pivoted(attitudes: list[Array], tip: Array, point: Array) -> list[Keyframe]:
    """Return perfectly tracked keyframes of a tip that stands on a point."""
    sigma = [1e-6 * k for k in range(len(attitudes))]
    return [
        Keyframe(float(k), 1.0, Pose(point - quat_rotate(wxyz, tip), wxyz), np.diag([sigma[k]] * 3 + [1e-5] * 3))
        for k, wxyz in enumerate(attitudes)
    ]


def fitted(keyframes: list[Keyframe]) -> PivotFit:
    """Fit, with errors that accumulate from move to move."""
    return fit_pivot(keyframes, PoseCovariance.chained(np.array([keyframe.cov for keyframe in keyframes])))


@settings(max_examples=30)
@given(st.integers(0, 10_000), vectors, vectors)
def test_without_noise_the_tip_is_found_exactly(seed: int, tip: Array, point: Array) -> None:
    rng = np.random.default_rng(seed)
    attitudes = [quat_exp(rng.normal(scale=0.6, size=3)) for _ in range(8)]
    fit = fitted(pivoted(attitudes, 0.2 * tip, point))
    assert_allclose(fit.p_sensor_tip, 0.2 * tip, atol=1e-9)
    assert_allclose(fit.residuals, 0.0, atol=1e-9)


@uncalibrated
@pytest.mark.parametrize(("sensor", "close_m"), [("wt901", 0.003), ("modern", 0.001)])
def test_a_lever_of_10_cm_is_found_to_millimetres(sensor: str, close_m: float) -> None:
    """The benchmark has medians over many seeds. Here no error may be large, or beyond four of its own sigmas."""
    for seed in range(3):
        hand = track(simulate(pivoting(seed, TIP), sensor, seed).recording)
        fit = fit_pivot(find_keyframes(hand), hand.covariance)
        off = float(np.linalg.norm(fit.p_sensor_tip - TIP))
        assert off < min(close_m, 4.0 * float(np.sqrt(np.trace(fit.cov))))


def test_turns_about_one_axis_do_not_determine_the_lever_along_it() -> None:
    attitudes = [quat_exp((angle, 0.0, 0.0)) for angle in (0.0, 0.6, -0.6, 0.3, -0.3)]
    with pytest.raises(
        CalibrationError, match=r"lever along \(1, 0, 0\) in the sensor's axes is unknown: .* tilt the tool"
    ):
        fitted(pivoted(attitudes, np.array(TIP), np.zeros(3)))
    nearly = [quat_multiply(wxyz, quat_exp((0.0, 0.02 * (-1) ** k, 0.0))) for k, wxyz in enumerate(attitudes)]
    with pytest.raises(
        CalibrationError, match=r"lever along \(1, .* is uncertain by .* cm \(one sigma\): .* axes \(about 1 degree\)"
    ):
        fitted(pivoted(nearly, np.array(TIP), np.zeros(3)))


def test_the_lever_and_its_sigma_are_in_the_calibrations_scale() -> None:
    """A hand whose positions come out twice as large shows a lever twice as long."""
    rng = np.random.default_rng(0)
    keyframes = pivoted([quat_exp(rng.normal(scale=0.6, size=3)) for _ in range(8)], np.array(TIP), np.zeros(3))
    covariance = PoseCovariance.chained(np.array([keyframe.cov for keyframe in keyframes]))
    whole, half = (fit_pivot(keyframes, covariance, scale) for scale in (1.0, 0.5))
    assert_allclose(half.p_sensor_tip, 0.5 * whole.p_sensor_tip)
    assert_allclose(half.cov, 0.25 * whole.cov)
    assert_allclose(half.residuals, 0.5 * whole.residuals)


def test_a_tip_that_slipped_is_refused() -> None:
    rng = np.random.default_rng(0)
    keyframes = pivoted([quat_exp(rng.normal(scale=0.6, size=3)) for _ in range(8)], np.array(TIP), np.zeros(3))
    moved = keyframes[4]
    slipped = np.array((0.03, 0.0, 0.0)) + moved.T_nav_sensor.p
    keyframes[4] = Keyframe(4.0, 1.0, Pose(slipped, moved.T_nav_sensor.wxyz), moved.cov)
    with pytest.raises(
        CalibrationError, match=r"did not stay on one point: at stop 4 it seems to be .* cm off; keep the tip"
    ):
        fitted(keyframes)


def test_an_unsure_attitude_is_no_slip() -> None:
    """With a lever of 10 cm, two degrees move the tip by 3.5 mm."""
    rng = np.random.default_rng(0)
    attitudes = [quat_exp(rng.normal(scale=0.6, size=3)) for _ in range(8)]
    cov = np.diag([1e-8] * 3 + [np.radians(2.0) ** 2] * 3)
    keyframes = [
        replace(each, T_nav_sensor=Pose(each.T_nav_sensor.p, quat_multiply(quat_exp(off), wxyz)), cov=cov)
        for each, wxyz, off in zip(
            pivoted(attitudes, np.array(TIP), np.zeros(3)),
            attitudes,
            rng.normal(scale=np.radians(2.0), size=(8, 3)),
            strict=True,
        )
    ]
    fit = fit_pivot(keyframes, PoseCovariance(8, lambda columns: cov @ columns))
    assert 0.3 < fit.chi2 < 2.0


def test_two_stops_are_too_few() -> None:
    with pytest.raises(CalibrationError, match="only 2 stops found; rest with the tip on the point"):
        fitted(pivoted([quat_exp((0.0, 0.0, 0.0)), quat_exp((0.5, 0.0, 0.0))], np.array(TIP), np.zeros(3)))


# --- turns ------------------------------------------------------------------------------------------------------------

NAMED = ("x", "-x", "z", "y", "-y")


def turned(wxyz_sensor_tool: Array, named: tuple[str, ...], angle: float = 0.8) -> list[Keyframe]:
    wxyz = quat_exp((0.1, 0.2, 0.3))
    keyframes = [Keyframe(0.0, 1.0, Pose(np.zeros(3), wxyz), np.eye(6))]
    for k, name in enumerate(named):
        axis = quat_rotate(wxyz_sensor_tool, AXES[name])
        wxyz = quat_multiply(wxyz, quat_exp((angle + 0.1 * k) * axis))
        keyframes.append(Keyframe(k + 1.0, 1.0, Pose(np.zeros(3), wxyz), np.eye(6)))
    return keyframes


@settings(max_examples=20)
@given(vectors, st.permutations(NAMED))
def test_named_turns_determine_the_rotation_exactly(turn: Array, named: list[str]) -> None:
    wxyz_sensor_tool = quat_exp(3.0 * turn)
    fit = fit_turns(turned(wxyz_sensor_tool, tuple(named)), named)
    off = quat_log(quat_multiply(quat_inverse(fit.wxyz_sensor_tool), wxyz_sensor_tool))
    assert_allclose(off, 0.0, atol=1e-7)
    assert_allclose(fit.off, 0.0, atol=1e-7)


def test_errors_of_a_hand_are_within_their_sigmas() -> None:
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        true = quat_exp(rng.normal(size=3))
        keyframes = [Keyframe(0.0, 1.0, Pose.identity(), np.eye(6))]
        for k, name in enumerate(NAMED):
            axis = quat_rotate(quat_multiply(quat_exp(rng.normal(scale=np.radians(2.0), size=3)), true), AXES[name])
            wxyz = quat_multiply(keyframes[-1].T_nav_sensor.wxyz, quat_exp(axis))
            keyframes.append(Keyframe(k + 1.0, 1.0, Pose(np.zeros(3), wxyz), np.eye(6)))
        fit = fit_turns(keyframes, NAMED)
        off = quat_log(quat_multiply(true, quat_inverse(fit.wxyz_sensor_tool)))
        inside.append(np.abs(off) < 2.0 * np.sqrt(np.diagonal(fit.cov)))
    assert 0.88 < np.mean(inside) < 0.995


def test_small_rotations_between_turns_are_ignored() -> None:
    true = quat_exp((0.3, 0.2, 0.1))
    keyframes = turned(true, ("x", "z"))
    shaken = Pose(np.zeros(3), quat_multiply(keyframes[-1].T_nav_sensor.wxyz, quat_exp((0.1, 0.1, 0.0))))
    fit = fit_turns([*keyframes, Keyframe(9.0, 1.0, shaken, np.eye(6))], ("x", "z"))
    assert fit.moves == (0, 1)


def test_a_turn_in_the_wrong_direction_is_refused() -> None:
    with pytest.raises(
        CalibrationError, match=r"the turns contradict --turns: the one about x \(move .*off; correct its axis"
    ):
        fit_turns(turned(quat_exp((0.3, 0.2, 0.1)), ("x", "-x", "x", "y")), ("x", "x", "x", "y"))


def test_an_axis_both_turns_are_across_is_twice_as_well_known() -> None:
    """A turn says nothing of the rotation about its own axis."""
    fit = fit_turns(turned(quat_exp((0.0, 0.0, 0.0)), ("x", "y"), 0.8), ("x", "y"))
    assert_allclose(np.diagonal(fit.cov) / fit.cov[2, 2], (2.0, 2.0, 1.0), rtol=0.02)


@pytest.mark.parametrize(("degrees", "told"), [(15.0, False), (25.0, True)])
def test_a_turn_by_hand_may_be_askew_but_not_about_another_axis(degrees: float, told: bool) -> None:
    """A third turn of three, askew, turns the tool with it by half as much."""
    wxyz, keyframes = quat_exp((0.0, 0.0, 0.0)), turned(quat_exp((0.0, 0.0, 0.0)), ("x",) * 5 + ("y",) * 5)
    askew = quat_rotate(quat_exp(np.radians((0.0, 0.0, degrees))), (1.0, 0.0, 0.0))
    wxyz = quat_multiply(keyframes[-1].T_nav_sensor.wxyz, quat_exp(askew))
    keyframes.append(Keyframe(20.0, 1.0, Pose(np.zeros(3), wxyz), np.eye(6)))
    with pytest.raises(CalibrationError, match="the turns contradict --turns") if told else nullcontext():
        fit_turns(keyframes, ["x"] * 5 + ["y"] * 5 + ["x"])


def test_a_turn_of_about_half_a_turn_is_refused() -> None:
    """Of more than half a turn the tracker sees the rest, the other way: all signs would fit, and the tool be wrong."""
    fit_turns(turned(quat_exp((0.3, 0.2, 0.1)), ("x", "z"), np.radians(125.0)), ("x", "z"))
    with pytest.raises(CalibrationError, match=r"move 1 turns by 141 degrees"):
        fit_turns(turned(quat_exp((0.3, 0.2, 0.1)), ("x", "z"), np.radians(135.0)), ("x", "z"))
    with pytest.raises(CalibrationError, match=r"move 0 turns by 178 degrees, .* by 30 to 90 degrees each time"):
        fit_turns(turned(quat_exp((0.3, 0.2, 0.1)), ("x", "-x", "z", "-z"), np.radians(182.0)), ("x", "-x", "z", "-z"))


@pytest.mark.parametrize(
    ("named", "message"),
    [
        (
            ("x", "y", "z"),
            r"--turns names 3 turns, but 2 moves turn by 20 degrees or more \(46, 52\); name each in order",
        ),
        (("x", "-x"), "all turns are about -x, x, so the rotation about that axis stays unknown"),
    ],
)
def test_names_that_do_not_match_the_turns_are_refused(named: tuple[str, ...], message: str) -> None:
    with pytest.raises(CalibrationError, match=message):
        fit_turns(turned(quat_exp((0.0, 0.0, 0.0)), ("x", "y")), named)
