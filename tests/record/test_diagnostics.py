"""Flaws of a sensor are told while it records; a sound one is never blamed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pbd.data import GRAVITY, Recording
from pbd.record.diagnostics import CHECK_EVERY_S, REPEAT_WARNING_S, STUCK_S, Diagnostics
from pbd.sensors.decoding import Sample, Triple
from pbd.simulation.simulate import simulate
from pbd.tracking.repair.saturation import clips_of
from tests.not_none import not_none


def triple(values: np.ndarray | None, row: int) -> Triple | None:
    if values is None or np.isnan(values[row]).any():
        return None
    x, y, z = values[row].tolist()
    return x, y, z


def told(recording: Recording) -> list[tuple[float, str]]:
    """What is told, and when."""
    health, out = Diagnostics(), []
    for row, t in enumerate(recording.t.tolist()):
        mag = triple(recording.mag, row)
        sample = Sample(triple(recording.acc, row), triple(recording.gyr, row), mag, triple(recording.device_rpy, row))
        out += [(t, line) for line in health.feed(t, sample)]
    return out


@pytest.fixture(scope="module")
def pouring() -> Recording:
    return simulate("pour", "modern", 1).recording


def stuck(recording: Recording, name: str, axes: slice | int, since: float) -> Recording:
    values = np.array(getattr(recording, name))
    row = int(np.searchsorted(recording.t, since))
    values[row:, axes] = values[row, axes]
    return with_channel(recording, name, values)


def with_channel(recording: Recording, name: str, values: np.ndarray) -> Recording:
    given: dict[str, Any] = {name: values}
    return replace(recording, **given)


@pytest.mark.parametrize("model", ["os5000", "os5000-nogyro", "wt901", "modern"])
@pytest.mark.parametrize("task", ["pick-and-place-stops", "pick-and-place-direct"])
def test_a_sound_sensor_is_never_blamed(task: str, model: str) -> None:
    recording = simulate(task, model, seed=5).recording
    axes = {f"the {'xyz'[clip.axis]} axis" for clip in clips_of(recording)}  # the fast ones do go beyond 500 deg/s
    assert {line.partition(" of the")[0] for _, line in told(recording)} == axes


@pytest.mark.parametrize(("name", "limit", "said"), [("acc", 1.3 * GRAVITY, "1.3 g"), ("gyr", 1.1, "63 deg/s")])
def test_a_saturated_axis_is_told_at_once(pouring: Recording, name: str, limit: float, said: str) -> None:
    values = np.array(getattr(pouring, name))
    if name == "acc":
        values[600:640, 2] += 0.5 * GRAVITY * np.sin(np.linspace(0.0, np.pi, 40))
    clipped = with_channel(pouring, name, np.clip(values, -limit, limit))
    first = clips_of(clipped)[0]
    at, line = told(clipped)[0]
    sensor = {"acc": "accelerometer", "gyr": "gyro"}[name]
    axis = "xyz"[first.axis]
    assert (
        line == f"the {axis} axis of the {sensor} is at the end of its range ({said}): move slower and without knocks, "
        "or set a larger one"
    )
    assert at - pouring.t[first.stop - 1] <= CHECK_EVERY_S + 0.011


def test_a_flat_top_below_an_earlier_peak_is_not_the_end_of_the_range(pouring: Recording) -> None:
    values = np.clip(not_none(pouring.gyr), -1.1, 1.1)
    assert clips_of(with_channel(pouring, "gyr", values))
    values[100:180] += 2.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 80))[:, None]
    assert not any("end of its range" in line for _, line in told(with_channel(pouring, "gyr", values)))


@pytest.mark.parametrize(
    ("name", "axis", "sensor", "since"), [("acc", 0, "accelerometer", 0.0), ("gyr", 2, "gyro", 3.0)]
)
def test_a_dead_axis_is_told_soon(pouring: Recording, name: str, axis: int, sensor: str, since: float) -> None:
    lines = told(stuck(pouring, name, axis, since))
    at, line = lines[0]
    assert line.startswith(f"the {'xyz'[axis]} axis of the {sensor} is stuck at ")
    assert at <= since + STUCK_S + 2.0 * CHECK_EVERY_S
    assert {other.partition(" at")[0] for _, other in lines} == {line.partition(" at")[0]}
    assert np.diff([t for t, _ in lines]).min() >= REPEAT_WARNING_S  # not more often than a person can hear


def test_a_dead_gyro_is_told_when_the_hand_moves(pouring: Recording) -> None:
    dead = replace(pouring, gyr=np.zeros_like(pouring.acc))
    at, line = told(dead)[0]
    assert line == "the gyro reads the same while the hand moves, so it is dead: repair or replace the sensor"
    moves = float(pouring.t[np.flatnonzero(np.abs(np.linalg.norm(pouring.acc, axis=1) - GRAVITY) > 1.0)[0]])
    assert moves - 1.0 < at < moves + 1.0


def test_a_dead_magnetometer_is_told(pouring: Recording) -> None:
    lines = told(stuck(pouring, "mag", slice(0, 3), 0.0))
    assert {line for _, line in lines} == {"the magnetometer reads the same while the hand moves: it will be left out"}


def test_a_sensor_that_freezes_is_told(pouring: Recording) -> None:
    frozen = stuck(stuck(pouring, "acc", slice(0, 3), 6.0), "gyr", slice(0, 3), 6.0)
    at, line = told(frozen)[0]
    assert line == "for 2 s all samples are the same: the sensor is stuck; plug it in again"
    assert 8.0 <= at <= 8.0 + 2.0 * CHECK_EVERY_S


def test_an_accelerometer_that_freezes_alone_is_told(pouring: Recording) -> None:
    at, line = told(stuck(pouring, "acc", slice(0, 3), 6.0))[0]
    assert line == "the accelerometer repeats itself while the gyro goes on: plug the sensor in again"
    assert 6.5 <= at <= 6.5 + 2.0 * CHECK_EVERY_S


def test_a_coarse_sensor_at_rest_is_not_called_stuck() -> None:
    """An Arduino that prints two decimals says the same for as long as it rests."""
    still = Recording(np.arange(600) / 100.0, np.tile((0.0, 0.0, 9.8), (600, 1)), np.zeros((600, 3)))
    lines = told(still)
    assert {line for _, line in lines} == {
        "all samples are the same so far: if that stays so while you move, the sensor is stuck"
    }


def test_a_field_that_comes_seldom_changes_nothing(pouring: Recording) -> None:
    seldom = np.where((np.arange(len(pouring)) % 10 == 0)[:, None], not_none(pouring.mag), np.nan)
    assert told(replace(pouring, mag=seldom)) == []


def test_a_few_samples_a_second_are_not_judged() -> None:
    assert told(Recording(np.arange(60) / 2.5, np.tile((0.0, 0.0, 9.8), (60, 1)), np.zeros((60, 3)))) == []
