"""Repeatability of a magnetic heading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.calibration.field_uniformity import field_at_start, field_spread, heading_changes
from pbd.pose import Array, quat_about_z, quat_exp, quat_inverse, quat_multiply, quat_rotate
from tests.tracking.stops_at import hand_path

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


def test_headings_are_compared_across_180_degrees() -> None:
    first = quat_multiply(quat_about_z(np.radians(179.0)), quat_exp((0.1, 0.2, 0.0)))
    again = [quat_multiply(quat_about_z(np.radians(turn)), first) for turn in (2.0, -3.0, 0.0)]
    assert np.degrees(heading_changes(first, again)) == pytest.approx([2.0, -3.0, 0.0])
