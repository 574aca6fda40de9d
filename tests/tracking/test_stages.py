"""Each stage alone: in sequence they give the result of `track`, and each agrees with an oracle of its own."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from pbd.data import GRAVITY, Recording
from pbd.data.recording import resolution_of
from pbd.errors import TrackingError
from pbd.pipeline import track
from pbd.pose import Array, quat_cumulative, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import random_task
from pbd.tracking.estimate import estimate
from pbd.tracking.first_rest import STILL_ACC, STILL_GYR, Rest, find_rest, restlessness
from pbd.tracking.keyframes import find_keyframes, find_segments
from pbd.tracking.moving_windows import rows_of_mean, white_noise_variance
from pbd.tracking.noise import FACTORY, Noise, _bends, noise_of
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.tracking.smoother.preintegration import integral_of_means, integral_of_values, turns_between_middles
from pbd.tracking.white_noise import _rounding
from pbd.tracking.zero_velocity import energies, find_candidates, lasts
from tests.scenarios import pour
from tests.tracking.hand_paths import hand_path
from tests.tracking.perfect_sensor import largest_angle

DOCS = Path(__file__).parents[2] / "docs" / "tracking.md"

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def test_the_stages_one_by_one_give_what_track_gives() -> None:
    demo = pour("os5000")
    path = track(demo.recording)
    recording, gaps = repair_recording(demo.recording)
    rest = find_rest(recording)
    found = estimate(recording, rest, noise_of(recording, rest))
    assert not gaps
    assert found.stops == path.stops
    assert np.array_equal(found.path.p, path.p_nav_sensor)
    assert np.array_equal(found.path.v, path.v_nav_sensor)
    assert np.array_equal(found.path.wxyz, path.wxyz_nav_sensor)
    assert np.array_equal(found.closure, path.closure)
    assert np.array_equal(found.covariance.of_each, path.cov)


def test_the_example_in_the_docs_gives_what_track_gives() -> None:
    examples = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec("\n".join(examples), names)
    assert np.array_equal(names["p_nav_sensor"], names["path"].p_nav_sensor)
    assert names["stops"] == names["path"].stops


def test_keyframes_and_segments_are_those_of_the_stops() -> None:
    path = track(pour().recording)
    keyframes, segments = find_keyframes(path), find_segments(path)
    assert [keyframe.dwell_s for keyframe in keyframes] == [stop.dwell_s for stop in path.stops]
    for keyframe, stop in zip(keyframes, path.stops, strict=True):
        assert np.array_equal(keyframe.T_nav_sensor.p, path.p_nav_sensor[stop.start])
        assert keyframe.t == 0.5 * (path.t[stop.start] + path.t[stop.stop - 1])
    rests = [(segment.start, segment.stop) for segment in segments if segment.kind == "rest"]
    assert rests == [(stop.start, stop.stop) for stop in path.stops]
    assert [segment.stop for segment in segments[:-1]] == [segment.start for segment in segments[1:]]
    assert (segments[0].start, segments[-1].stop) == (0, len(path.t))


@pytest.mark.parametrize(
    ("shift_m", "turn_deg", "described"), [(0.029, 11.0, True), (0.031, 11.0, False), (0.029, 9.0, False)]
)
def test_a_hand_rotation_turns_more_than_10_degrees_and_shifts_less_than_3_cm(
    shift_m: float, turn_deg: float, described: bool
) -> None:
    turned = quat_exp(np.radians([(0.0, 0.0, 0.0), (turn_deg, 0.0, 0.0)]))
    path = hand_path(np.array([(0.0, 0.0, 0.0), (shift_m, 0.0, 0.0)]), 1e-6 * np.eye(3)[None], turned)
    assert (find_segments(path)[1].description == "Hand rotation") == described


def test_interpolated_rows_belong_to_no_stop_of_a_hand_that_has_set_out() -> None:
    """Between the last row at rest and the first that moves, 20 rows are missing and interpolated."""
    t, window = 0.01 * np.arange(200.0), 10
    force = np.array((0.0, 0.0, GRAVITY)) + 1e-3 * np.random.default_rng(0).normal(size=(200, 3))
    force[120:] += np.sin(0.3 * np.arange(80))[:, None]
    force[100:120] = force[99]
    rest = find_rest(Recording(t[:100], force[:100], np.zeros((100, 3))))
    energy = energies(force, np.zeros((200, 3)), window)
    assert find_candidates(t, 0.01, energy, rest, [(99, 120)]) == [(0, 100)]


def interval_means(signal: Callable[[Array], Array], middles: Array, dt: float) -> Array:
    """Means (n, k) of a signal (m,) -> (m, k) over intervals around (n,) instants."""
    values = signal((middles[:, None] + 0.5 * dt * NODES).ravel())
    means: Array = np.einsum("q,nqk->nk", 0.5 * WEIGHTS, values.reshape(len(middles), len(NODES), -1))
    return means


def columns(*signals: Array) -> Array:
    return np.stack(signals, axis=-1)


coefficients = st.lists(st.floats(-5.0, 5.0), min_size=9, max_size=9)


@settings(max_examples=40)
@given(coefficients, st.floats(0.002, 0.1), st.integers(4, 40))
def test_means_of_quadratics_are_integrated_exactly(numbers: list[float], dt: float, n: int) -> None:
    """Except the first and the last step, beyond which there are no samples."""
    polynomials = [np.polynomial.Polynomial(numbers[i : i + 3]) for i in (0, 3, 6)]
    t = dt * np.arange(n, dtype=np.float64)
    found = integral_of_means(t, interval_means(lambda at: columns(*(p(at) for p in polynomials)), t, dt))
    exact = columns(*(p.integ()(t) for p in polynomials))
    assert not found[0].any()
    assert found[1:-1] - found[1] == pytest.approx(exact[1:-1] - exact[1], abs=1e-11)


@settings(max_examples=40)
@given(st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3), st.integers(1, 30))
def test_a_constant_is_integrated_exactly_from_end_to_end(level: list[float], n: int) -> None:
    t = 0.01 * np.arange(n, dtype=np.float64)
    assert integral_of_means(t, np.tile(level, (n, 1))) == pytest.approx(np.outer(t, level), abs=1e-12)


def test_means_of_sines_are_integrated_to_fourth_order() -> None:
    omega, phase = np.array([3.0, 5.0, 7.0]), np.array([0.3, 1.0, 2.0])
    errors = []
    for dt in (0.04, 0.02, 0.01, 0.005):
        t = dt * np.arange(round(2.0 / dt), dtype=np.float64)
        # The mean of a sine is the sine at the middle times sinc.
        means = np.sin(np.outer(t, omega) + phase) * np.sinc(0.5 * dt * omega / np.pi)
        exact = -np.cos(np.outer(t, omega) + phase) / omega
        found = integral_of_means(t, means)
        errors.append(np.abs((found[1:-1] - found[1]) - (exact[1:-1] - exact[1])).max())
    assert all(coarser / finer > 0.9 * 2.0**4 for coarser, finer in pairwise(errors))


@settings(max_examples=40)
@given(st.lists(st.floats(1e-3, 0.1), min_size=1, max_size=30), st.integers(0, 2**32 - 1))
def test_values_with_slopes_are_integrated_as_hermites_cubic(steps: list[float], seed: int) -> None:
    t = np.concatenate(([0.0], np.cumsum(steps)))
    values, slopes = np.random.default_rng(seed).normal(size=(2, len(t), 3))
    spline = CubicHermiteSpline(t, values, slopes)
    exact = [spline.integrate(t[0], end) for end in t]
    assert integral_of_values(t, values, slopes) == pytest.approx(np.array(exact), abs=1e-12)


def test_values_with_slopes_are_integrated_to_fourth_order() -> None:
    omega = np.array([3.0, 5.0, 7.0])
    errors = []
    for n in (50, 100, 200, 400):
        t = np.linspace(0.0, 2.0, n + 1)
        angle = np.outer(t, omega)
        found = integral_of_values(t, np.cos(angle), -omega * np.sin(angle))
        errors.append(np.abs(found - np.sin(angle) / omega).max())
    assert all(coarser / finer > 0.9 * 2.0**4 for coarser, finer in pairwise(errors))


def attitude_at(t: Array) -> Array:
    """A rotation whose axis rotates too: products of sines about the three axes, (m,) s -> (m, 4)."""
    turns = columns(0.8 * np.sin(2.1 * t), 0.6 * np.sin(3.3 * t + 0.5), 0.9 * np.sin(1.7 * t + 1.0))
    wxyz: Array = quat_exp(np.zeros((len(t), 3)))
    for axis in np.eye(3):
        wxyz = quat_multiply(wxyz, quat_exp(turns * axis))
    return wxyz


def rate_at(t: Array) -> Array:
    """Its angular rate in sensor axes, (m, 3) rad/s, by central differences of fourth order."""

    def turn(h: float) -> Array:
        return quat_log(quat_multiply(quat_inverse(attitude_at(t - h)), attitude_at(t + h))) / (2.0 * h)

    h = 1e-4
    return (4.0 * turn(h) - turn(2.0 * h)) / 3.0


def force_at(t: Array) -> Array:
    """Specific force in nav, (m, 3) m/s2."""
    return columns(2.0 * np.sin(2.0 * t), np.cos(3.0 * t), 9.81 + np.sin(1.5 * t + 0.4))


def test_turns_between_middles_are_those_of_a_fine_integration_to_fourth_order() -> None:
    errors = []
    for dt in (0.04, 0.02, 0.01):
        t = dt * np.arange(round(2.0 / dt), dtype=np.float64)
        turns = turns_between_middles(t, interval_means(rate_at, t, dt), dt)
        exact = attitude_at(t)
        inner = slice(2, -1)  # beyond the ends the hand is taken to turn on evenly
        carried = quat_multiply(exact[1], quat_cumulative(quat_exp(turns[inner])))
        errors.append(largest_angle(exact[inner], carried))
    assert errors[-1] < np.radians(1e-4)
    assert all(coarser / finer > 0.9 * 2.0**4 for coarser, finer in pairwise(errors))


def test_what_turning_does_to_a_mean_is_of_second_order() -> None:
    """Specific force f is averaged in axes that turn with rate w, and rotated by the attitude at the middle. To second
    order in time, the mean is off by dt^2 / 12 (w x f' + w' x f / 2 + w x (w x f) / 2)."""
    errors = []
    for dt in (0.025, 0.0125, 0.00625):
        t = dt * np.arange(round(2.0 / dt), dtype=np.float64)
        acc = interval_means(lambda at: quat_rotate(quat_inverse(attitude_at(at)), force_at(at)), t, dt)
        rate = interval_means(rate_at, t, dt)
        wxyz, exact = attitude_at(t), interval_means(force_at, t, dt)
        off = (quat_rotate(wxyz, acc) - exact)[1:-1]
        f, w = acc[1:-1], rate[1:-1]
        f_change, w_change = ((values[2:] - values[:-2]) / (2.0 * dt) for values in (acc, rate))
        sculling = np.cross(w, f_change) + 0.5 * np.cross(w_change, f) + 0.5 * np.cross(w, np.cross(w, f))
        expected = quat_rotate(wxyz[1:-1], -(dt**2) / 12.0 * sculling)
        assert np.abs(off - expected).max() < 0.02 * np.abs(off).max()
        errors.append(np.abs(off).max())
    assert all(coarser / finer == pytest.approx(2.0**2, rel=0.02) for coarser, finer in pairwise(errors))


@settings(max_examples=40)
@given(st.integers(0, 70), st.integers(0, 2**32 - 1))
def test_cumulative_products_are_those_of_a_loop(n: int, seed: int) -> None:
    turns = quat_exp(np.random.default_rng(seed).normal(size=(n, 3)))
    before, products = np.array([1.0, 0.0, 0.0, 0.0]), []
    for turn in turns:
        before = quat_multiply(before, turn)
        products.append(before)
    assert quat_cumulative(turns) == pytest.approx(np.array(products).reshape(n, 4), abs=1e-12)


@pytest.mark.parametrize(("louder", "first"), [(3.0, True), (5.0, False)])
def test_the_first_second_is_the_rest_if_its_variance_is_at_most_four_times_the_least(
    louder: float, first: bool
) -> None:
    acc = np.tile((0.0, 0.0, 9.81), (400, 1))
    acc[:, 0] = 0.02 * (-1.0) ** np.arange(400) * np.where(np.arange(400) < 150, np.sqrt(louder), 1.0)
    assert (find_rest(Recording(np.arange(400) / 100.0, acc)).start == 0) == first


def swinging_foot(stands: float) -> Recording:
    """Four seconds at 100 Hz of a foot that swings, but stands still from 1 to 1.5 s with `stands` m/s2 rms."""
    n = np.arange(400)
    swing = np.sqrt(2.0) * np.where((n >= 100) & (n < 150), stands, 2.0) * np.sin(0.5 * n)
    return Recording(n / 100.0, np.column_stack((swing, np.zeros(400), np.full(400, 9.81))))


def test_half_a_second_of_rest_serves_where_none_is_longer() -> None:
    rest = find_rest(swinging_foot(0.07))
    assert rest.stop - rest.start == 50
    assert abs(rest.start - 100) <= 2


@pytest.mark.parametrize(("stands", "shortest_s"), [(0.09, 0.5), (0.07, 1.0)])
def test_half_a_second_that_is_not_quiet_is_no_rest(stands: float, shortest_s: float) -> None:
    with pytest.raises(TrackingError, match="never stands still"):
        find_rest(swinging_foot(stands), shortest_s)


@pytest.mark.parametrize("n", [1, 2])
def test_a_bend_is_what_fourth_differences_show_beyond_white_noise(n: int) -> None:
    """Those of k^4 are 24 n^4; those of a steadily changing jerk are none."""
    k, silent, dt = np.arange(30.0)[:, None], Noise(0.0, 0.0, FACTORY), 0.01
    bend = 6.0 / 70.0 * (24.0 * n**4) ** 2
    np.testing.assert_allclose(_bends(k**3, n, silent, dt), 0.0, atol=1e-12)
    np.testing.assert_allclose(_bends(k**4, n, silent, dt), bend, rtol=1e-6)
    noisy = replace(silent, acc_density=np.sqrt(dt / 3.0))  # a variance of 1/3 an axis, 1 in all three
    white = 6.0 * white_noise_variance(n, 2)
    np.testing.assert_allclose(_bends(k**4, n, noisy, dt), bend - white, rtol=1e-6)


@pytest.mark.parametrize(("rate_hz", "rows"), [(40.0, 1), (100.0, 1), (200.0, 2), (400.0, 5)])
def test_motion_is_averaged_over_an_eightieth_of_a_second(rate_hz: float, rows: int) -> None:
    assert rows_of_mean(rate_hz) == rows


def test_a_gyro_that_warms_up_does_not_seem_to_turn() -> None:
    recording = simulate(random_task(1, moves=40), "os5000", 1).recording
    assert recording.gyr is not None
    warm = np.radians(0.03) * recording.t[:, None] * (0.6, 0.0, 0.8)  # 2.3 degrees per second in the end
    path, as_it_was = track(replace(recording, gyr=recording.gyr + warm)), track(recording)
    assert len(path.stops) == len(as_it_was.stops) == 41
    assert np.abs(path.p_nav_sensor - as_it_was.p_nav_sensor).max() < 0.02


def test_each_row_of_a_span_lasts_until_the_next() -> None:
    t = 0.05 * np.arange(4.0)
    assert [lasts(t, (0, rows), 0.1) for rows in (1, 2, 3)] == [False, True, True]
    assert [lasts(t, (0, rows), 0.15) for rows in (1, 2, 3)] == [False, False, True]


def test_an_axis_that_always_reads_the_same_says_nothing_of_the_step() -> None:
    """Nor does an axis with a coarser step. Rounding adds step / sqrt(12), which is constant at rest."""
    values = 0.01 * np.random.default_rng(0).integers(-3, 4, (200, 3)) * np.array((1.0, 5.0, 0.0))
    assert _rounding(resolution_of(values), 0.0) == pytest.approx((0.01 / np.sqrt(12.0), 0.01 / np.sqrt(12.0)))


def test_a_hand_at_the_limit_of_either_sensor_is_as_restless() -> None:
    assert restlessness(STILL_ACC**2, 0.0) == pytest.approx(1.0)
    assert restlessness(0.0, STILL_GYR**2) == pytest.approx(1.0)
    for acc, gyr in ((STILL_ACC, 0.0), (0.0, STILL_GYR)):
        assert Rest(0, 1, GRAVITY, acc**2, gyr**2, np.zeros(3), np.array([0.0, 0.0, 1.0])).restless == pytest.approx(
            1.0
        )
