"""Repeatability of a magnetic heading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.calibration.dock import sensor_heading, with_heading_sigma
from pbd.calibration.field_uniformity import field_at_start, field_spread
from pbd.data import Calibration, HandPath
from pbd.pipeline import track
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_inverse, quat_rotate, yaw_toward
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from tests.not_none import not_none
from tests.tracking.hand_paths import hand_path

FIELD = np.array([0.0, 19.5, -44.0])


def read(fields: Array, wxyz: Array) -> Array:
    return quat_rotate(quat_inverse(wxyz), fields)


@given(st.integers(0, 1000), st.floats(-np.pi, np.pi))
def test_an_even_field_has_no_spread_however_the_sensor_lies(seed: int, heading: float) -> None:
    wxyz = quat_exp(np.random.default_rng(seed).normal(size=(5, 3)))
    spread = field_spread(read(quat_rotate(quat_about_z(heading), np.tile(FIELD, (5, 1))), wxyz), wxyz)
    assert (spread.heading, spread.strength) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert spread.tan_dip == pytest.approx(44.0 / 19.5)
    assert not spread.disturbed


def test_the_spread_is_the_rms_of_the_differences_between_places() -> None:
    wxyz = quat_exp(np.random.default_rng(0).normal(size=(4, 3)))
    turns = np.radians([5.0, -5.0, 5.0, -5.0])
    fields = np.array([quat_rotate(quat_about_z(turn), FIELD) for turn in turns])
    spread = field_spread(read(fields, wxyz), wxyz)
    assert np.degrees(spread.heading) == pytest.approx(5.0)
    assert spread.disturbed
    stronger = np.array([1.2, 0.8, 1.2, 0.8])[:, None] * FIELD
    spread = field_spread(read(stronger, wxyz), wxyz)
    assert (spread.heading, spread.strength) == pytest.approx((0.0, 0.2), abs=1e-9)
    assert spread.disturbed


def test_the_field_at_the_start_is_that_of_the_first_stop() -> None:
    path = hand_path(np.zeros((2, 3)), np.zeros((1, 3, 3)), quat_exp(np.random.default_rng(0).normal(size=(2, 3))))
    fields = FIELD * np.where(np.arange(len(path.t)) < path.stops[0].stop, 1.0, 2.0)[:, None]
    assert field_at_start(path, read(fields, path.wxyz_nav_sensor)) == pytest.approx((19.5, -44.0))


def test_a_start_with_another_heading_turns_nav_by_as_much_as_its_sigma_says() -> None:
    """The accelerometer's bias tilts nav, and with it magnetic north, another way where the sensor is turned."""
    off = []
    for device in range(12):
        first, second = (_started(heading, device) for heading in (0.3, 0.3 + np.pi))
        level, up = field_at_start(first[0], not_none(not_none(first[0].tracking).recording.mag))
        fit = {"chi2": 1.0, "heading_deg": 0.0, "field_level": level, "field_up": up}
        fit["sensor_heading_deg"] = np.degrees(sensor_heading(first[0].wxyz_nav_sensor[0]))
        calibration = Calibration(
            "bench",
            T_base_nav=Pose.identity(),
            cov_base=np.zeros((6, 6)),
            residuals={f"nav.{name}": figure for name, figure in fit.items()},
        )
        sigma = np.sqrt(with_heading_sigma(second[0], calibration).cov_start[5, 5])
        off.append((second[1] - first[1]) / sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.4


def _started(heading: float, device: int) -> tuple[HandPath, float]:
    """Return a path that starts with this heading of the sensor, rad, and nav's true heading there, rad."""
    waypoints = (Waypoint(rest_s=2.0), Waypoint((0.2, 0.0, 0.0), move_s=1.0, rest_s=1.0))
    demo = simulate(Task("start", waypoints, start_rpy=(0.0, 0.0, heading)), "modern", round(heading), device=device)
    path = track(demo.recording)
    return path, yaw_toward(path.wxyz_nav_sensor[0], not_none(demo.truth).wxyz_nav_sensor[0])
