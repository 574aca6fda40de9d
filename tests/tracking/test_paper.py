"""The paper's method, each step against its equation."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from pbd.errors import PbdWarning, TrackingError, UsageError
from pbd.pipeline import track
from pbd.tracking.keyframes import find_keyframes, find_segments
from pbd.tracking.paper import LAMBDA_M, filter_yaw, paper_path, paper_stops, resulting_variance
from tests.scenarios import simulate


def test_variance_is_that_of_equations_7_to_9() -> None:
    a_nav = np.random.default_rng(0).normal(size=(30, 3))
    resulting = [np.sqrt(x * x + y * y + z * z) for x, y, z in a_nav]
    expected = [np.var(resulting[i - 1 : i + 1]) for i in range(1, 30)]
    assert resulting_variance(a_nav)[1:] == pytest.approx(expected)


def test_algorithm_1_holds_a_motion_for_lambda_m_samples() -> None:
    a_nav = np.zeros((60, 3))
    a_nav[20], a_nav[20 + LAMBDA_M - 1] = 1.0, 1.0
    (before, after) = paper_stops(np.arange(60) / 40.0, a_nav)
    assert (before.start, before.stop) == (0, 20)
    assert (after.start, after.stop) == (20 + LAMBDA_M + 1, 60)


def test_rectangular_sums_are_equations_5_and_6() -> None:
    t = np.arange(40) / 40.0
    a_nav = np.zeros((40, 3))
    a_nav[10:13, 0] = (1.0, 0.0, -1.0)
    stops = paper_stops(t, a_nav)
    p, v, closure = paper_path(t, a_nav, stops)
    assert v[10:13, 0] == pytest.approx([0.025, 0.025, 0.0])
    assert p[-1] == pytest.approx([0.025**2 * 2, 0.0, 0.0])
    assert closure == pytest.approx(np.zeros((1, 3)))


def test_yaw_filter_finds_the_gyros_bias_across_the_wrap() -> None:
    t = np.arange(4000) / 40.0
    rng = np.random.default_rng(1)
    true = 3.0 + 0.02 * t  # crosses pi
    compass = np.arctan2(np.sin(true), np.cos(true)) + np.radians(1.0) * rng.normal(size=len(t))
    yaw, bias = filter_yaw(t, np.full(len(t), 0.02 + 0.01), compass, with_gyro=True)
    off = np.arctan2(np.sin(yaw - true), np.cos(yaw - true))
    assert np.abs(off[1000:]).max() < np.radians(1.0)
    assert bias[-1] == pytest.approx(0.01, abs=2e-3)


@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
def test_the_papers_method_finds_the_translations_of_test_1() -> None:
    segments = find_segments(track(simulate("pick-and-place-stops", "os5000", 0).recording, "paper"))
    moves = [s for s in segments if s.kind == "move"]
    assert [s.description[:10] for s in moves[:3]] == ["Vertical m", "Horizontal", "Horizontal"]
    assert np.abs(np.array([s.start for s in moves]) - [87, 115, 141, 186]).max() <= 2


def test_without_a_gyro_the_yaw_filter_has_no_bias_to_find() -> None:
    t = np.arange(400) / 40.0
    assert not filter_yaw(t, np.zeros(400), 0.3 * t, with_gyro=False)[1].any()


def test_without_a_gyro_it_follows_the_compass() -> None:
    assert len(track(simulate("pick-and-place-stops", "os5000-nogyro", 0).recording, "paper").stops) >= 4


def test_where_its_threshold_sees_no_motion_it_is_not_the_hands_fault() -> None:
    """Pouring at 100 Hz: between two samples acceleration changes too little for a variance over two samples."""
    recording = simulate("pour", "modern", 0).recording
    assert len(recording.grip) == 2
    with pytest.warns(PbdWarning) as told:
        assert len(find_keyframes(track(recording, method="paper"))) == 1
    (only,) = (str(each.message) for each in told)  # nothing of the grip's two events at the one stop
    assert re.match(r"--method paper finds no motion in this sensor's data: .* lambda_v = 0\.01 ", only)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(track(recording).stops) > 1
        assert len(track(simulate("pick-and-place-stops").recording, method="paper").stops) > 1


def test_without_a_compass_it_says_so() -> None:
    recording = replace(simulate("pour", "modern").recording, mag=None, device_rpy=None)
    with pytest.raises(TrackingError, match="needs a compass"):
        track(recording, "paper")


@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
def test_without_the_devices_attitude_tilt_is_low_passed() -> None:
    recording = replace(simulate("pick-and-place-stops", "os5000").recording, device_rpy=None)
    assert len(track(recording, "paper").stops) >= 2


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(UsageError, match="no method 'best'; known are default, paper"):
        track(simulate("pour").recording, "best")
