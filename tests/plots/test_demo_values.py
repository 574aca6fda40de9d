"""The values that plots show: the tracker's, calibrated, and the truth."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pbd.data import Calibration, LinearErrors, Recording, SensorErrors, Truth
from pbd.pipeline import track
from pbd.plots.demo_values import DemoValues, TruthValues, demo_values
from pbd.pose import quat_about_z, quat_multiply, quat_rotate
from pbd.simulation.simulate import simulate
from pbd.tracking.paper import paper_path, paper_stops, resulting_variance
from pbd.tracking.smoother.preintegration import integral_of_means
from tests.near import assert_near
from tests.not_none import not_none
from tests.scenarios import pour


@pytest.fixture(scope="module")
def pouring() -> DemoValues:
    return demo_values(track(pour()))


@pytest.fixture(scope="module")
def truth() -> Truth:
    return not_none(pour().truth)


def against(plot: DemoValues, truth: Truth) -> TruthValues | None:
    """The same path, with another truth to compare it with."""
    demo = replace(plot.tracking.demo, truth=truth)
    return demo_values(replace(plot.path, tracking=replace(plot.tracking, demo=demo))).truth


def test_drawn_values_are_calibrated(pouring: DemoValues) -> None:
    demo = pour()
    light = replace(demo, recording=replace(demo.recording, acc=0.96 * demo.recording.acc))
    acc = LinearErrors(np.zeros(3), np.eye(3) / 0.96, np.zeros(3))
    path = track(light, calibration=Calibration("bench", sensor=SensorErrors("unknown", acc=acc)))
    tracking = demo_values(path).tracking
    assert_near(tracking.recording.acc, pouring.tracking.recording.acc, 1e-9)
    assert_near(tracking.a_nav, pouring.tracking.a_nav, 0.02)  # m/s2


def test_the_acceleration_is_the_integrated_one(pouring: DemoValues) -> None:
    path = pouring.path
    v = integral_of_means(path.t, pouring.tracking.a_nav)
    closure = [v[after.start] - v[before.stop - 1] for before, after in pairwise(path.stops)]
    assert np.array(closure) == pytest.approx(path.closure, abs=1e-12)


@pytest.mark.filterwarnings("ignore:.*at the end of the range")  # the hand rolls faster than this gyro's range
def test_equations_7_to_9() -> None:
    plot = demo_values(track(simulate("pick-and-place-stops", "os5000"), "paper"))
    a_nav, path = plot.tracking.a_nav, plot.path
    resulting = [float(np.sqrt(a @ a)) for a in a_nav]
    assert plot.resulting == pytest.approx(resulting)
    pairs = [np.var([before, own]) for before, own in zip([resulting[0], *resulting], resulting, strict=False)]
    assert resulting_variance(a_nav) == pytest.approx(pairs)
    assert paper_stops(plot.tracking.recording.t, a_nav) == path.stops
    assert paper_path(path.t, a_nav, path.stops)[1] == pytest.approx(path.v_nav_sensor, abs=1e-12)


def test_sigma_is_that_of_each_stop_and_grows_in_between(pouring: DemoValues) -> None:
    path = pouring.path
    for k, stop in enumerate(path.stops):
        expected = np.sqrt(np.diagonal(path.cov[k]))
        assert pouring.sigma[[stop.start, stop.stop - 1]] == pytest.approx(np.tile(expected, (2, 1)), abs=1e-12)
    assert (np.diff(pouring.sigma[path.stops[0].stop : path.stops[1].start, 0]) > 0.0).all()


@pytest.mark.parametrize("yaw", [0.0, -3.0])
def test_the_truth_is_aligned_at_the_first_stop_wherever_it_was_measured(
    pouring: DemoValues, truth: Truth, yaw: float
) -> None:
    turn, shift = quat_about_z(yaw), np.array([3.0, -2.0, 1.0])
    elsewhere = Truth(
        truth.t, quat_rotate(turn, truth.p_nav_sensor) + shift, quat_multiply(turn, truth.wxyz_nav_sensor)
    )
    moved = not_none(against(pouring, elsewhere))
    for field in ("p_nav_sensor", "v_nav_sensor", "rpy_nav_sensor", "error"):
        assert getattr(moved, field) == pytest.approx(getattr(not_none(pouring.truth), field), abs=1e-9)
    assert np.linalg.norm(moved.error, axis=1).max() < 0.01
    assert np.degrees(np.abs(moved.rpy_nav_sensor - pouring.rpy_nav_sensor)).max() < 2.0


def test_a_truth_with_holes_leaves_holes(pouring: DemoValues, truth: Truth) -> None:
    hole = (truth.t > 6.0) & (truth.t < 7.0)
    p, wxyz = truth.p_nav_sensor.copy(), truth.wxyz_nav_sensor.copy()
    p[hole], wxyz[hole] = np.nan, np.nan
    found = against(pouring, replace(truth, p_nav_sensor=p, wxyz_nav_sensor=wxyz))
    assert found is not None
    assert np.isnan(found.error[hole]).all()
    known = np.isfinite(found.error).all(axis=1)
    assert np.mean(known) > 0.9
    assert found.error[known] == pytest.approx(not_none(pouring.truth).error[known])


def test_a_truth_that_ends_within_the_first_stop_has_no_largest_error(pouring: DemoValues, truth: Truth) -> None:
    path, early = pouring.path, truth.t < pouring.path.t[pouring.path.stops[0].middle] - 0.1
    found = Truth(truth.t[early], truth.p_nav_sensor[early], truth.wxyz_nav_sensor[early])
    assert path.tracking is not None
    tracking = replace(path.tracking, demo=replace(path.tracking.demo, truth=found))
    values = demo_values(replace(path, tracking=tracking))
    assert values.truth is not None
    assert "largest error" not in dict(values.facts)


def test_one_stop_has_no_largest_error(pouring: DemoValues) -> None:
    """There the truth is aligned with it."""
    demo, rest = pour(), slice(pouring.path.stops[0].stop)
    whole = demo.recording
    recording = Recording(whole.t[rest], whole.acc[rest], not_none(whole.gyr)[rest], info=whole.info)
    alone = demo_values(track(replace(demo, recording=recording)))
    assert len(alone.path.stops) == 1
    assert alone.truth is not None
    assert "largest error" not in dict(alone.facts)


def test_a_path_that_was_not_tracked_has_no_values(pouring: DemoValues) -> None:
    with pytest.raises(ValueError, match=r"the path was not tracked, .*; give what pbd\.track returns"):
        demo_values(replace(pouring.path, tracking=None))


def test_a_truth_without_the_first_stop_is_left_out(pouring: DemoValues, truth: Truth) -> None:
    late = truth.t > 5.0
    assert against(pouring, Truth(truth.t[late], truth.p_nav_sensor[late], truth.wxyz_nav_sensor[late])) is None


@pytest.mark.parametrize("rate_hz", [40.0, 286.0])
def test_the_true_velocity_suppresses_optical_noise(pouring: DemoValues, rate_hz: float) -> None:
    """Noise of 0.5 mm at 286 Hz gives differences of 10 cm/s between samples."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 20.0, 1.0 / rate_hz) + 1e-3 * rng.uniform(size=round(20.0 * rate_hz))
    straight = np.outer(t, (0.3, -0.2, 0.1))
    for noise, bound in ((0.0, 1e-9), (0.0005, 0.03)):
        p = straight + noise * rng.normal(size=straight.shape)
        found = not_none(against(pouring, Truth(t, p, np.tile((1.0, 0.0, 0.0, 0.0), (len(t), 1)))))
        speed = np.linalg.norm(found.v_nav_sensor, axis=1)
        assert np.sqrt(np.mean((speed - np.linalg.norm((0.3, -0.2, 0.1))) ** 2)) < bound


def test_a_magnet_near_the_hand_shows_in_the_field() -> None:
    demo = pour("ideal")
    near = (demo.recording.t > 12.0) & (demo.recording.t < 12.5)
    mag = not_none(demo.recording.mag) * np.where(near, 1.1, 1.0)[:, None]
    plot = demo_values(track(replace(demo, recording=replace(demo.recording, mag=mag))))
    assert plot.field is not None
    assert plot.field.strength == pytest.approx(np.where(near, 1.1, 1.0) * plot.field.rest_strength, rel=1e-3)
    assert np.degrees(plot.field.rest_dip) == pytest.approx(66.1, abs=0.1)  # of the simulated world: atan(44 / 19.5)
    assert dict(plot.facts)["magnetic field"].startswith("48 µT ± 10 %, dip")
