"""Estimated sensor errors against those that the simulated device was drawn with."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import chdtrc

from pbd.calibration.accelerometer import NAMES, fit_accelerometer, up_sigma
from pbd.calibration.gyro import fit_gyro
from pbd.calibration.magnetometer import fit_ellipsoid, fit_magnetometer
from pbd.calibration.rests import Rests, count_orientations, find_rests
from pbd.calibration.sensor import TRUSTED_ACC, WARNED_MISFIT, SensorFit, calibrate_sensor, corrected
from pbd.calibration.sensor_changed import disagreements, gravity_at
from pbd.data import GRAVITY, Recording, RecordingInfo, SensorErrors
from pbd.errors import CalibrationError
from pbd.pose import Array, quat_from_rpy, quat_inverse, quat_rotate
from pbd.simulation.calibration_tasks import SIDES, sides
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import EARTH, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.noise import CALIBRATED
from tests.calibration.device_errors import BAD, device, symmetric
from tests.not_none import not_none

MG = 1e-3 * GRAVITY
SEED = 5


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(sides(SEED), BAD, SEED).recording


@pytest.fixture(scope="module")
def rests(recording: Recording) -> Rests:
    return find_rests(recording)


@pytest.fixture(scope="module")
def calibrated(recording: Recording) -> SensorFit:
    return calibrate_sensor(recording, gravity=EARTH.gravity, temperature_c=21.0)


def accelerometer_rests(acc: Array, noise: float = 0.0) -> Rests:
    """Return rests of a sensor that has only an accelerometer."""
    k = len(acc)
    start = np.arange(k) * 200
    return Rests(start, start + 100, acc, None, None, noise, 0.0, 0.0)


# --- rests ------------------------------------------------------------------------------------------------------------


def test_the_rests_are_those_of_the_task(recording: Recording, rests: Rests) -> None:
    assert len(rests) == len(SIDES)
    task, end = sides(SEED), 0.0
    true = []
    for waypoint in task.waypoints:
        end += waypoint.move_s + waypoint.rest_s
        if waypoint.rest_s > 1.0:
            true.append((end - waypoint.rest_s, end))
    for (begin, end), start, stop in zip(true, rests.start, rests.stop, strict=True):
        assert begin <= recording.t[start] < begin + 0.6
        assert end - 0.6 < recording.t[stop - 1] <= end


def test_sensors_that_are_quiet_in_turn_show_no_rest() -> None:
    noise, first = np.random.default_rng(0).normal(size=(800, 3)), (np.arange(800) < 400)[:, None]
    acc, gyr = (0.0, 0.0, 9.81) + np.where(first, 0.005, 2.0) * noise, np.where(first, 1.0, 0.0005) * noise
    with pytest.raises(CalibrationError, match="the sensor was never still for 1 s"):
        find_rests(Recording(np.arange(800) / 100.0, acc, gyr))


@pytest.mark.parametrize(("degrees_s", "until"), [(2.0, 600), (0.6, 610)])
def test_a_slow_turn_at_constant_rate_is_no_rest(degrees_s: float, until: int) -> None:
    """It shakes as little as a rest does; only the mean rate differs."""
    n, rate = 1000, 100.0
    rng = np.random.default_rng(0)
    gyr = 1e-3 * rng.normal(size=(n, 3)) + np.array([0.001, 0.002, 0.003])
    gyr[600:, 2] += np.radians(degrees_s)
    acc = 0.01 * rng.normal(size=(n, 3)) + (0.0, 0.0, 9.81)
    found = find_rests(Recording(np.arange(n) / rate, acc, gyr))
    assert len(found) == 1
    assert found.stop[0] <= until


@pytest.mark.parametrize(("shake", "most", "sensor"), [("acc", 0.1, "accelerometer"), ("gyr", np.radians(1.0), "gyro")])
def test_a_table_may_shake_by_a_tenth_of_a_metre_per_second_squared_or_a_degree_per_second(
    shake: str, most: float, sensor: str
) -> None:
    told = f"the sensor was never still: at its quietest .* the {sensor} shakes by .*; put it down for two seconds"
    for rms, still in ((0.9 * most, True), (1.1 * most, False)):
        read = {"acc": np.tile((0.0, 0.0, GRAVITY), (300, 1)), "gyr": np.zeros((300, 3))}
        read[shake] = read[shake] + rms * np.sqrt(2.0 / 3.0) * np.sin(0.2 * np.pi * np.arange(300))[:, None]
        with nullcontext() if still else pytest.raises(CalibrationError, match=told):
            assert len(find_rests(Recording(np.arange(300) / 100.0, read["acc"], read["gyr"]))) == 1


@pytest.mark.parametrize(("shake", "most"), [("acc", 0.02), ("gyr", np.radians(0.1))])
def test_a_very_quiet_sensor_may_shake_a_little_on_its_table_after_a_rest_without_any(shake: str, most: float) -> None:
    """By a fiftieth of a metre per second squared or a tenth of a degree per second, as when someone walks by."""
    for rms, still in ((0.9 * most, True), (1.1 * most, False)):
        read = {"acc": np.tile((0.0, 0.0, GRAVITY), (1000, 1)), "gyr": np.zeros((1000, 3))}
        read[shake][500:] += rms * np.sqrt(2.0 / 3.0) * np.sin(0.2 * np.pi * np.arange(500))[:, None]
        (stop,) = find_rests(Recording(np.arange(1000) / 100.0, read["acc"], read["gyr"])).stop
        assert (stop > 900) == still


@pytest.mark.parametrize("step", [0.04, 0.08])  # m/s2: 4 and 8 mg, of ten bits and of eight over 2 g
def test_rests_in_which_coarse_readings_alternate_are_found(rests: Rests, step: float) -> None:
    quiet = replace(BAD, acc=replace(BAD.acc, noise=0.001, step=step))
    assert len(find_rests(simulate(sides(SEED), quiet, SEED).recording)) == len(rests)


@pytest.mark.parametrize(("ratio", "still"), [(2.8, True), (3.2, False)])
def test_what_shakes_three_times_as_much_as_the_quietest_half_second_is_no_rest(ratio: float, still: bool) -> None:
    acc = np.tile((0.0, 0.0, GRAVITY), (1000, 1))
    shake = 0.025 * np.sqrt(2.0) * np.sin(0.63 * np.arange(1000))
    acc[:, 0] += np.where(np.arange(1000) < 500, shake, ratio * shake)
    (stop,) = find_rests(Recording(np.arange(1000) / 100.0, acc)).stop
    assert (stop > 900) == still


def test_what_shakes_more_than_its_rounding_is_no_rest() -> None:
    """Rounded to 0.01 m/s2, which makes three times that of a variance of a twelfth; it shakes by 0.04 m/s2."""
    acc = np.tile((0.0, 0.0, GRAVITY), (1000, 1))
    acc[500:, 0] += 0.04 * np.sqrt(2.0) * np.sin(0.5 * np.arange(500))
    (stop,) = find_rests(Recording(np.arange(1000) / 100.0, 0.01 * np.round(acc / 0.01))).stop
    assert 450 < stop <= 500


def test_rests_that_are_too_short() -> None:
    waypoints = [Waypoint(rest_s=0.7), *(Waypoint((0.1 * (k % 2), 0, 0), (0.5, 0, 0), 0.5, 0.7) for k in range(6))]
    with pytest.raises(CalibrationError, match="never still for 1 s; put it down for two seconds in each orientation"):
        find_rests(simulate(Task("hasty", tuple(waypoints)), "modern", 0).recording)
    with pytest.raises(CalibrationError, match=r"the recording lasts only 0\.1 s; put the sensor down"):
        find_rests(Recording(np.arange(11) / 100.0, np.zeros((11, 3))))


def test_orientations_are_counted_once() -> None:
    assert count_orientations(SIDES) == 12
    assert count_orientations(np.vstack((SIDES[:3], SIDES[:3] + 0.01))) == 3
    leaning = np.radians([0.0, 14.0, 16.0])
    up = np.column_stack((np.sin(leaning), np.zeros(3), np.cos(leaning)))
    assert [count_orientations(up[:2]), count_orientations(up[::2])] == [1, 2]


def test_a_gyro_that_shows_one_turn_much_too_large_is_refused(recording: Recording, rests: Rests) -> None:
    """Otherwise the fit would attribute it to scale and axes."""
    gyr, up = not_none(recording.gyr).copy(), rests.acc / np.linalg.norm(rests.acc, axis=1, keepdims=True)
    gyr[rests.stop[3] : rests.start[4]] *= 1.6
    with pytest.raises(CalibrationError, match=r"does not turn as gravity does \(by 11 degrees, rms\)"):
        fit_gyro(replace(recording, gyr=gyr), rests, up)


# --- accelerometer ----------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_without_noise_the_errors_are_found_exactly(seed: int) -> None:
    """The priors leave only a negligible error."""
    rng = np.random.default_rng(seed)
    gain = np.eye(3) + 0.02 * rng.normal(size=(3, 3))
    bias = 0.5 * rng.normal(size=3)
    fit = fit_accelerometer(accelerometer_rests(9.81 * SIDES @ gain.T + bias), 9.81)
    assert_allclose(fit.linear.bias, bias, atol=2e-3)
    assert_allclose(fit.linear.matrix, symmetric(gain), atol=3e-4)
    assert fit.determined == NAMES
    assert fit.rms_after < 1e-3


def test_a_bad_accelerometer_is_found(rests: Rests) -> None:
    gain, bias = device(BAD, SEED)["acc"]
    fit = fit_accelerometer(rests, EARTH.gravity)
    assert_allclose(fit.linear.bias, bias, atol=1.0 * MG)
    off = fit.linear.matrix - symmetric(gain)
    assert np.abs(np.diagonal(off)).max() < 0.001
    assert np.abs(off - np.diag(np.diagonal(off))).max() < np.radians(0.1)
    assert np.all(np.abs(fit.linear.bias - bias) < 4.0 * fit.linear.bias_sigma)
    assert fit.rms_after < 0.02 * fit.rms_before


def test_six_sides_determine_bias_and_scale_but_no_misalignment() -> None:
    fit = fit_accelerometer(accelerometer_rests(9.81 * SIDES[:6]), 9.81)
    assert fit.undetermined == ("misalignment yz", "misalignment xz", "misalignment xy")


@pytest.mark.parametrize("axes", ["yz", "xz", "xy"])
def test_an_edge_between_two_axes_determines_their_misalignment(axes: str) -> None:
    edge = np.isin(["x", "y", "z"], list(axes)) / np.sqrt(2.0)
    fit = fit_accelerometer(accelerometer_rests(9.81 * np.vstack((SIDES[:6], edge))), 9.81)
    assert {f"misalignment {axes}"} == {"misalignment yz", "misalignment xz", "misalignment xy"} - set(fit.undetermined)


def test_an_axis_that_only_points_up_has_undetermined_bias_and_scale() -> None:
    """x never points down, so its bias and its scale have the same effect."""
    up = SIDES[[0, 1, 2, 4, 5]]
    fit = fit_accelerometer(accelerometer_rests(9.81 * up + (0.2, 0.1, 0.0)), 9.81)
    assert {"bias x", "scale x"} <= set(fit.undetermined)
    assert {"bias y", "scale y", "bias z", "scale z"} <= set(fit.determined)
    assert fit.linear.bias[1] == pytest.approx(0.1, abs=2e-3)
    assert 0.0 < fit.linear.bias[0] < 0.2  # shared between bias and scale


@pytest.mark.parametrize("count", [1, 3])
def test_orientations_that_are_too_few_or_alike_are_refused(count: int) -> None:
    with pytest.raises(
        CalibrationError, match=r"(3 rests show only 3 orientations|was put down once).* needs 4 orientations, best 12"
    ):
        fit_accelerometer(accelerometer_rests(9.81 * SIDES[:count]))
    alike = SIDES[[0] * 6] + 0.05 * np.random.default_rng(0).normal(size=(6, 3))
    with pytest.raises(CalibrationError, match="6 rests show only 1 orientation 15 degrees"):
        fit_accelerometer(accelerometer_rests(9.81 * alike))
    held = replace(accelerometer_rests(9.81 * SIDES[:1]), turning=11)
    with pytest.raises(CalibrationError, match=r"put down once, and in 11 other rests it turned slowly \(lay it down"):
        fit_accelerometer(held)


def test_another_gravity_gives_another_scale(rests: Rests) -> None:
    first, second = (np.diagonal(fit_accelerometer(rests, gravity).linear.matrix) for gravity in (9.81, 9.80))
    assert_allclose(second / first, 9.80 / 9.81, atol=1e-4)


def test_gravity_follows_latitude() -> None:
    """WGS 84's own figures at the equator and the pole, and Paris' 9.809 at 48.8 degrees (its geoid aside)."""
    assert gravity_at(0.0) == pytest.approx(9.7803253359, abs=1e-9)
    assert gravity_at(90.0) == pytest.approx(9.8321849379, abs=1e-7)
    assert gravity_at(-90.0) == gravity_at(90.0)
    assert gravity_at(48.8) == pytest.approx(9.809, abs=1e-3)


# --- gyro -------------------------------------------------------------------------------------------------------------


def test_a_gyro_is_found_in_the_accelerometers_axes(recording: Recording, rests: Rests) -> None:
    (gain_acc, _), (gain, bias) = (device(BAD, SEED)[kind] for kind in ("acc", "gyr"))
    acc = fit_accelerometer(rests, EARTH.gravity)
    force = acc.linear.correct(rests.acc)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    fit = fit_gyro(recording, rests, up, up_sigma(acc.linear))
    assert_allclose(fit.bias, bias, atol=np.radians(0.02))
    turned = symmetric(gain_acc) @ gain_acc  # the accelerometer's axes against the housing's
    assert np.abs(fit.matrix @ gain - turned).max() < 0.003
    assert np.abs(gain - turned).max() > 0.01
    assert_allclose(fit_gyro(recording, rests).matrix, np.eye(3))  # without the vertical the bias alone


@pytest.mark.parametrize("wrong", [np.pi / 180.0, -1.0])
def test_a_gyro_in_another_unit_or_other_axes_is_refused(recording: Recording, rests: Rests, wrong: float) -> None:
    few = replace(
        rests,
        start=rests.start[:4],
        stop=rests.stop[:4],
        acc=rests.acc[:4],
        gyr=None if rests.gyr is None else rests.gyr[:4],
        mag=None,
    )
    with pytest.raises(CalibrationError, match=r"does not turn as gravity does .*; is its unit rad/s"):
        fit_gyro(replace(recording, gyr=wrong * not_none(recording.gyr)), few, rests.up_sensor[:4])


def test_five_seconds_of_rest_determine_the_bias() -> None:
    for seed in range(10):
        still = simulate(Task("still", (Waypoint(rest_s=5.0),)), "wt901", seed).recording
        _, bias = device(replace(BAD, gyr=BAD.gyr), seed)["gyr"]
        assert np.abs(fit_gyro(still, find_rests(still)).bias - bias).max() < np.radians(0.04)


# --- magnetometer -----------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_an_ellipsoid_is_found_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    gain, centre = np.eye(3) + 0.15 * rng.normal(size=(3, 3)), 30.0 * rng.normal(size=3)
    found, matrix = fit_ellipsoid(50.0 * directions @ gain.T + centre)
    assert_allclose(found, centre, atol=1e-6)
    assert_allclose(matrix, symmetric(gain) / 50.0, atol=1e-8)


def test_hard_and_soft_iron_are_found(recording: Recording, rests: Rests) -> None:
    """The heading in random attitudes, by the corrected field and the corrected vertical, is right."""
    gains = device(BAD, SEED)
    acc = fit_accelerometer(rests, EARTH.gravity)
    force = acc.linear.correct(rests.acc)
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    fit = fit_magnetometer(not_none(recording.mag), rests, up, up_sigma(acc.linear))
    turned = symmetric(gains["acc"][0]) @ gains["acc"][0]
    gain, bias = gains["mag"]
    rng = np.random.default_rng(0)
    for _ in range(50):
        wxyz = quat_inverse(quat_from_rpy(rng.uniform((-1.0, -1.0, -np.pi), (1.0, 1.0, np.pi))))
        field, up = quat_rotate(wxyz, EARTH.field), quat_rotate(wxyz, (0.0, 0.0, 1.0))
        as_read = gain @ field + bias
        assert abs(_heading(fit.linear.correct(as_read), turned @ up, turned) - _heading(field, up, np.eye(3))) % (
            2.0 * np.pi
        ) < np.radians(0.5)
    assert fit.dip == pytest.approx(np.arctan2(44.0, 19.5), abs=np.radians(0.3))
    assert fit.uneven < 0.05 * fit.uneven_before


def test_a_magnetometer_in_other_axes_is_remarked_on(recording: Recording) -> None:
    """Strength alone does not show it, the dip does."""
    swapped = replace(recording, mag=not_none(recording.mag) * (1.0, -1.0, 1.0))
    fit = calibrate_sensor(swapped, gravity=EARTH.gravity)
    assert not_none(fit.mag).uneven < 0.01
    assert "% in strength and by" in "".join(fit.remarks)
    assert "signs of mx, my, mz" in "".join(fit.remarks)


@pytest.mark.parametrize("axes", [(1.0, 1.0, -1.0), (1.0, -1.0, -1.0)])  # mirrored; half a turn
def test_a_magnetometer_whose_signs_are_wrong_is_corrected_with_a_remark(recording: Recording, axes: Array) -> None:
    right, fit = (calibrate_sensor(replace(recording, mag=not_none(recording.mag) * each)) for each in (1.0, axes))
    assert right.remarks == ()
    (remark,) = fit.remarks
    assert "the magnetometer's axes are turned by 17" in remark
    assert not_none(fit.errors.dip) == pytest.approx(np.prod(axes) * not_none(right.errors.dip), abs=1e-3)


def _heading(field: Array, up: Array, axes: Array) -> float:
    """Return the heading of the sensor's x axis, rad from east."""
    east = np.cross(field, up)
    return float(np.arctan2(axes[:, 0] @ np.cross(up, east), axes[:, 0] @ east))


def test_a_magnetometer_that_was_tilted_a_little_is_refused() -> None:
    """An ellipsoid fits a cap of the sphere exactly, but by a hair's breadth; no ellipsoid fits a saddle."""
    turn, tilt = np.meshgrid(np.linspace(0.0, 6.0, 40), np.arccos(np.linspace(1.0, np.cos(np.radians(23.0)), 20)))
    cap = np.column_stack([part.ravel() for part in _spherical(60.0, turn, tilt)])
    once = replace(accelerometer_rests(9.81 * SIDES[:1]), mag=cap[:1], mag_noise=0.0)
    with pytest.raises(CalibrationError, match=r"\(its directions cover 11 % of what they could along one axis\)"):
        fit_magnetometer(cap, once, SIDES[:1])
    x, y, _ = _spherical(1.0, turn, 0.5 * np.pi * np.ones_like(turn))
    rim = np.hypot(1.0, tilt - tilt.mean())
    saddle = np.column_stack([part.ravel() for part in (rim * x, rim * y, tilt - tilt.mean())])
    with pytest.raises(CalibrationError, match="its readings fit no ellipsoid"):
        fit_ellipsoid(saddle)


def test_four_rests_tell_how_sure_a_magnetic_heading_is() -> None:
    """They determine the dip and the rotation of the axes exactly, so what is left of the dips tells nothing."""
    up = SIDES[:4]
    directions = np.random.default_rng(0).normal(size=(500, 3))
    sphere = 48.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    at_rest = 19.5 * np.roll(up, 1, axis=1) - 44.0 * up
    fit = fit_magnetometer(sphere, replace(accelerometer_rests(9.81 * up), mag=at_rest, mag_noise=0.1), up)
    assert fit.heading < 0.01


def test_three_rests_that_lean_five_degrees_do_not_turn_a_magnetometers_axes() -> None:
    """Dips that are off by half a degree would turn them by 30 degrees."""
    lean = np.radians(5.0)
    up = np.array([[0.0, 0.0, 1.0], [np.sin(lean), 0.0, np.cos(lean)], [0.0, np.sin(lean), np.cos(lean)]])
    directions = np.random.default_rng(0).normal(size=(500, 3))
    sphere = 48.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    north = np.cross(up, (1.0, 1.0, 0.0))
    north /= np.linalg.norm(north, axis=1, keepdims=True)
    at_rest = 19.5 * north + (-44.0 + 0.3 * np.array([[0.0], [1.0], [-1.0]])) * up  # uT
    fit = fit_magnetometer(sphere, replace(accelerometer_rests(9.81 * up), mag=at_rest, mag_noise=0.1), up)
    assert fit.axes_turn < np.radians(3.0)


def _spherical(radius: float, turn: Array, tilt: Array) -> tuple[Array, Array, Array]:
    return radius * np.sin(tilt) * np.cos(turn), radius * np.sin(tilt) * np.sin(turn), radius * np.cos(tilt)


def test_a_magnet_beside_three_of_twelve_rests_is_said(recording: Recording, rests: Rests) -> None:
    """One of a tenth of the field. The fit hides most of it in strength and dip; headings are off by 3.5 degrees."""
    mag = not_none(recording.mag).copy()
    for k, towards in zip((6, 7, 8), np.eye(3), strict=True):
        mag[rests.start[k] - 50 : rests.stop[k] + 50] += 5.0 * towards
    fit = calibrate_sensor(replace(recording, mag=mag), gravity=EARTH.gravity)
    assert fit.mag is not None
    assert max(fit.mag.uneven, fit.mag.dip_uneven) < 0.05
    assert [line for line in fit.remarks if "headings will be wrong" in line]


@pytest.mark.parametrize(("seed", "any_ut", "north_ut"), [(0, 1.2, 0.0), (4, 0.0, 4.0)], ids=["dip", "strength"])
def test_a_field_that_differs_from_rest_to_rest_is_said(
    recording: Recording, rests: Rests, calibrated: SensorFit, seed: int, any_ut: float, north_ut: float
) -> None:
    """The fit takes a part of twelve dips, and a stronger north hardly shows in them."""
    mag, rng = not_none(recording.mag).copy(), np.random.default_rng(seed)
    north, up = (
        not_none(calibrated.errors.mag).correct(not_none(rests.mag)),
        not_none(calibrated.errors.acc).correct(rests.acc),
    )
    north -= (north * up).sum(axis=1, keepdims=True) / (up**2).sum(axis=1, keepdims=True) * up
    for start, stop, towards in zip(rests.start, rests.stop, north, strict=True):
        along_north = towards / np.linalg.norm(towards)
        mag[start - 50 : stop + 50] += any_ut * rng.normal(size=3) if any_ut else north_ut * rng.normal() * along_north
    fit = calibrate_sensor(replace(recording, mag=mag), gravity=EARTH.gravity)
    assert [line for line in fit.remarks if "headings will be wrong" in line]


def test_the_sigma_of_hard_iron_is_that_of_its_error_where_the_field_differs_from_rest_to_rest(
    rests: Rests, calibrated: SensorFit
) -> None:
    """The room's field changes gradually as the sensor goes from rest to rest; the loss is robust."""
    demo, clean, off = simulate(sides(SEED), BAD, SEED), not_none(calibrated.errors.mag), []
    ends, wxyz = np.column_stack((rests.start, rests.stop)).ravel(), quat_inverse(not_none(demo.truth).wxyz_nav_sensor)
    for seed in range(30):
        at_rest = np.repeat(4.0 * np.random.default_rng(seed).normal(size=(len(rests), 3)), 2, axis=0)
        uneven = np.transpose([np.interp(np.arange(len(wxyz)), ends, axis) for axis in at_rest.T])
        moved = replace(demo.recording, mag=not_none(demo.recording.mag) + quat_rotate(wxyz, uneven))
        fit = not_none(calibrate_sensor(moved, only=("mag",), known=calibrated.errors).errors.mag)
        off.append((fit.bias - clean.bias) / fit.bias_sigma)
    assert 0.85 < np.sqrt(np.mean(np.square(off))) < 1.15


def test_an_unknown_gravity_makes_the_accelerometers_scale_as_uncertain(recording: Recording) -> None:
    """A reading of 1 g at 9.78 or 9.82 m/s2 looks the same; the vertical has the same direction in both."""
    known_g, unknown_g = (calibrate_sensor(recording, gravity=gravity).errors for gravity in (GRAVITY, None))
    at = not_none(known_g.acc).matrix_sigma, not_none(unknown_g.acc).matrix_sigma
    assert at[1] == pytest.approx(np.hypot(at[0], (9.82 - 9.78) / 2.0 / GRAVITY), rel=1e-3)
    assert not_none(unknown_g.gyr).matrix_sigma == not_none(known_g.gyr).matrix_sigma


def test_a_magnet_that_the_sensor_is_turned_beside_leaves_the_magnetometer_out(
    recording: Recording, rests: Rests
) -> None:
    """Where the field differs by most of itself, a matrix near zero, or a mirror, fits: it is no calibration."""
    mag, rng = not_none(recording.mag).copy(), np.random.default_rng(1)
    for start, stop in zip(rests.start, rests.stop, strict=True):
        mag[start - 50 : stop + 50] += 25.0 * rng.normal(size=3)
    fit = calibrate_sensor(replace(recording, mag=mag), gravity=EARTH.gravity)
    assert fit.errors.mag is None
    left_out = "the magnetometer is left out: the field differs too much from rest to rest; move away from iron and"
    assert [remark[: len(left_out)] for remark in fit.remarks] == [left_out]


# --- all together -----------------------------------------------------------------------------------------------------


def test_an_accelerometer_that_no_correction_fits_is_remarked_on(recording: Recording) -> None:
    """Its bias drifts by 30 mg from start to end, the gyro's by 0.3 degrees/s: the sigmas contain that."""
    assert CALIBRATED.acc_bias == TRUSTED_ACC
    drift = np.linspace(-1.0, 1.0, len(recording))[:, None] * (1.0, -1.0, 1.0)
    assert recording.gyr is not None
    drifted = replace(recording, acc=recording.acc + 15.0 * MG * drift, gyr=recording.gyr + np.radians(0.15) * drift)
    fit = calibrate_sensor(drifted, gravity=EARTH.gravity)
    assert "mg (rms): the sensor was not still in a rest" in fit.remarks[0]
    for found, at_end in ((fit.errors.acc, 15.0 * MG), (fit.errors.gyr, np.radians(0.15))):
        assert np.all(not_none(found).bias_sigma > 0.25 * at_end)


def test_rests_that_a_drifting_gyro_takes_for_turns_are_told(recording: Recording) -> None:
    drift = np.radians(np.linspace(-0.5, 0.5, len(recording)))[:, None] * (0.0, 0.0, 1.0)
    fit = calibrate_sensor(replace(recording, gyr=not_none(recording.gyr) + drift), gravity=EARTH.gravity)
    assert len(fit.rests) < 12
    left_out = f"{12 - len(fit.rests)} rests of 12 left out: the gyro's reading differs by more than 0.3"
    assert fit.remarks[0].startswith(left_out)


def test_one_bad_rest_is_named_and_widens_the_sigmas(recording: Recording, rests: Rests) -> None:
    """The rest with the opposite side up contradicts the others just so, and three of twelve are redundant."""
    acc = GRAVITY * SIDES
    acc[7] += (0.0, 15.0 * MG, 0.0)
    fit = fit_accelerometer(accelerometer_rests(acc))
    assert fit.suspects.tolist() == [7, 10]
    assert np.abs(fit.linear.bias).max() > 1.5 * MG
    assert np.all(np.abs(fit.linear.bias) < 1.5 * fit.linear.bias_sigma)
    touched = recording.acc.copy()
    touched[rests.start[7] - 20 : rests.stop[7] + 20] *= 1.012  # the fit hides all but 2 mg (rms) of these 12
    assert (
        calibrate_sensor(replace(recording, acc=touched))
        .remarks[0]
        .startswith(
            "the rests contradict each other by 4 mg (rms): the sensor was not still in a rest (that at "
            f"{recording.t[rests.start[7]]:.1f} s or {recording.t[rests.start[10]]:.1f} s alone would explain it)"
        )
    )


def test_a_corrected_recording_reads_gravity_no_rate_and_one_field(recording: Recording, calibrated: SensorFit) -> None:
    fit = calibrated
    assert fit.remarks == ()
    assert fit.errors.temperature_c == 21.0
    true = find_rests(corrected(recording, fit.errors))
    assert_allclose(np.linalg.norm(true.acc, axis=1), EARTH.gravity, atol=1.0 * MG)
    assert_allclose(not_none(true.gyr), 0.0, atol=np.radians(0.05))
    assert_allclose(np.linalg.norm(not_none(true.mag), axis=1), not_none(fit.errors.field), rtol=0.01)
    assert corrected(recording, None) is recording


def test_errors_that_are_not_fitted_are_kept(recording: Recording, calibrated: SensorFit) -> None:
    """A matrix too, if it is surer than the new one."""
    before = not_none(calibrated.errors.gyr)
    known = replace(calibrated.errors, gyr=replace(before, matrix=np.eye(3), matrix_sigma=1e-6))
    again = calibrate_sensor(recording, only=("gyr",), known=known).errors
    assert again.acc is known.acc
    assert again.mag is known.mag
    assert again.gravity == known.gravity
    assert_allclose(not_none(again.gyr).matrix, np.eye(3))
    assert_allclose(not_none(again.gyr).bias, before.bias)


def test_a_magnetometer_beside_an_uncalibrated_accelerometer_has_a_sigma(recording: Recording) -> None:
    assert np.isfinite(not_none(calibrate_sensor(recording, only=("mag",)).errors.mag).bias_sigma).all()


def test_a_missing_sensor_is_left_out_or_refused(recording: Recording) -> None:
    bare = replace(recording, gyr=None, mag=None)
    errors = calibrate_sensor(bare).errors
    assert (errors.gyr, errors.mag) == (None, None)
    assert errors.acc is not None
    for kind, what in (("gyr", "no gyro"), ("mag", "no magnetometer")):
        with pytest.raises(CalibrationError, match=f"the recording has {what}"):
            calibrate_sensor(bare, only=(kind,))


def test_a_gyro_that_was_not_turned_between_rests_has_no_known_scale() -> None:
    n = 400
    noise = np.random.default_rng(0).normal(size=(n, 3))
    recording = Recording(np.arange(n) / 100.0, (0.0, 0.0, 9.81) + 0.01 * noise, 0.02 + 0.001 * noise)
    each = slice(0, 100), slice(200, 400)
    means = np.array([recording.gyr[rows].mean(axis=0) for rows in each])  # type: ignore[index]
    start, stop = (np.array([getattr(rows, end) for rows in each]) for end in ("start", "stop"))
    rests = Rests(start, stop, np.zeros((2, 3)), means, None, 0.01, 0.001, 0.0)
    linear = fit_gyro(recording, rests, np.tile((0.0, 0.0, 1.0), (2, 1)))
    assert_allclose(linear.bias, 0.02, atol=0.001)
    assert_allclose(linear.matrix, np.eye(3))
    assert np.isnan(linear.matrix_sigma)


def test_a_magnetometer_that_was_not_turned_far_enough_is_left_out(recording: Recording, calibrated: SensorFit) -> None:
    """What is known of it is kept, and the rest is calibrated; named with `only`, it must succeed."""
    flat = replace(recording, mag=not_none(recording.mag) * (1.0, 1.0, 0.001))
    fit = calibrate_sensor(flat, gravity=EARTH.gravity, known=calibrated.errors)
    assert [remark[:75] for remark in fit.remarks] == [
        "the magnetometer is left out: the magnetometer was not turned far enough: a"
    ]
    assert fit.mag is None
    assert fit.errors.mag is calibrated.errors.mag
    assert fit.errors.acc is not calibrated.errors.acc
    said = r"not turned far enough: along one axis its readings vary by only 0\.\d uT"
    with pytest.raises(CalibrationError, match=said):
        calibrate_sensor(flat, only=("mag",))


def test_another_sensors_errors_are_refused(recording: Recording) -> None:
    errors = SensorErrors("vn100")
    with pytest.raises(CalibrationError, match=r"is of the sensor 'simulated bad wt901', but .* of 'vn100'; name a"):
        corrected(recording, errors)
    with pytest.raises(CalibrationError, match="of 'vn100'"):
        calibrate_sensor(recording, known=errors)
    unnamed = replace(recording, info=RecordingInfo(sensor="unknown"))
    assert len(corrected(unnamed, errors)) == len(recording)
    assert calibrate_sensor(unnamed, known=errors, only=["gyr"]).errors.sensor == "vn100"


def test_a_rest_that_contradicts_its_calibration_is_reported(calibrated: SensorFit, rests: Rests) -> None:
    errors = calibrated.errors
    assert errors.acc is not None
    assert errors.gyr is not None
    assert errors.mag is not None
    assert rests.gyr is not None
    assert rests.mag is not None
    acc, gyr, mag = errors.acc.correct(rests.acc[3]), errors.gyr.correct(rests.gyr[3]), errors.mag.correct(rests.mag[3])
    assert disagreements(errors, acc, gyr, mag) == ()
    assert disagreements(errors, acc) == ()
    (line,) = disagreements(errors, 1.02 * acc, gyr, mag)
    assert "calibrated accelerometer reads 10.01 m/s2" in line
    (line,) = disagreements(errors, acc, gyr + np.radians(1.0), mag)
    assert "the gyro is 1.7 degrees/s off its calibrated bias" in line
    (line,) = disagreements(errors, acc, gyr, 1.2 * mag)
    assert "the magnetic field is " in line
    (line,) = disagreements(errors, acc, gyr, _dipped(mag, acc))
    assert "the magnetic field dips by " in line


def _dipped(mag: Array, acc: Array) -> Array:
    """Return a field of the same strength, 10 degrees steeper."""
    up = acc / np.linalg.norm(acc)
    level = mag - (mag @ up) * up
    size = np.linalg.norm(mag)
    dip = np.arcsin(-(mag @ up) / size) + np.radians(10.0)
    return np.asarray(size * (np.cos(dip) * level / np.linalg.norm(level) - np.sin(dip) * up))


def test_a_good_sensor_is_warned_of_once_in_twelve_times() -> None:
    """Twelve rests and nine unknowns leave three degrees of freedom."""
    assert chdtrc(3, 3 * WARNED_MISFIT**2) == pytest.approx(1 / 12, rel=0.1)
