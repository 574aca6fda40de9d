"""Exchanged blocks are put back and wild gyro rows left out; a hand's own motion is neither."""

import warnings
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.data import GRAVITY, Recording
from pbd.data.recording import DEVICE_CLOCK
from pbd.errors import PbdWarning, RecordingError
from pbd.pose import Array
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task
from pbd.simulation.tasks import Task
from pbd.tracking.repair import splices
from pbd.tracking.repair.splices import _extrapolate, _unmet, in_order, refuse_doubled, without_wild
from tests.benchmarks.trials import read_broad
from tests.not_none import not_none
from tests.scenarios import pour, simulate, with_rows
from tests.tracking.repair.real_recordings import real_recordings


@pytest.mark.parametrize(
    ("sensor", "seconds"), [("modern", 0.1), ("modern", 1.0), ("os5000-nogyro", 0.3), ("wt901", 0.3)]
)
def test_exchanged_blocks_are_put_back(sensor: str, seconds: float) -> None:
    recording = simulate("pick-and-place-direct", sensor, 1).recording
    size, first = round(seconds * recording.rate_hz), int(np.searchsorted(recording.t, 2.3))
    rows = np.arange(len(recording))
    rows[first : first + 2 * size] = np.roll(rows[first : first + 2 * size], size)
    mixed = replace(with_rows(recording, rows), t=recording.t)
    with pytest.warns(PbdWarning, match=rf"rows {first} to {first + size - 1} .* put behind them"):
        mended = in_order(mixed)
    np.testing.assert_array_equal(mended.acc, recording.acc)
    np.testing.assert_array_equal(not_none(mended.mag), recording.mag)
    by_device = replace(mixed, info=replace(mixed.info, clock=DEVICE_CLOCK))  # its times can't be exchanged
    assert in_order(by_device) is by_device


def test_blocks_longer_than_any_packet_are_not_exchanged() -> None:
    recording = simulate("pour", "modern", 1).recording
    rows = np.arange(len(recording))
    rows[230:830] = np.roll(rows[230:830], 300)
    mixed = replace(with_rows(recording, rows), t=recording.t)
    assert in_order(mixed) is mixed


@pytest.mark.parametrize("rows", [0, 1, 3])
def test_on_a_straight_line_both_sides_of_an_edge_say_the_same_half_way(rows: int) -> None:
    x = np.arange(20.0)[:, None] * (1.0, -2.0)
    for lines in _extrapolate(x, np.array([4, 10]), rows):
        np.testing.assert_allclose(lines, (np.array([4, 10]) + 0.5 * (rows - 1))[:, None] * (1.0, -2.0))


@pytest.mark.parametrize("bent_at", [8.1, 8.5, 8.9])
@pytest.mark.parametrize("step", [0.0, 0.7])
def test_the_lines_on_both_sides_of_a_bend_meet_between_the_rows_unless_the_values_jump(
    bent_at: float, step: float
) -> None:
    row = np.arange(20.0)
    x = np.column_stack((0.5 * row, 3.0 * np.maximum(row - bent_at, 0.0), step * (row > bent_at)))
    assert _unmet(x, np.array([9])) == pytest.approx(step)


def test_nothing_is_put_in_another_order_in_sound_recordings(data_folder: Path) -> None:
    for recording in real_recordings(data_folder).values():
        assert in_order(recording) is recording
    for sensor in ("os5000", "modern", "ideal"):
        fast = simulate(random_task(1, move_s=(0.15, 0.3)), sensor, 1).recording
        assert in_order(fast) is fast


@pytest.mark.parametrize("rest_s", [0.503, 0.507])
def test_a_rest_as_long_as_the_quick_move_after_it_is_not_exchanged_with_it(rest_s: float) -> None:
    """The acceleration bends where a quick move begins and ends. Exchanged, two bends would meet."""
    there, back = (0.6, 0.0, 0.0), (0.0, 0.0, 0.0)
    ways = [Waypoint(p, move_s=rest_s, rest_s=rest_s) for p in (there, back, there, back)]
    for seed in range(4):
        recording = simulate(Task("shuttle", (Waypoint(rest_s=2.0), *ways)), "modern", seed).recording
        assert in_order(recording) is recording


@pytest.mark.parametrize("harder", [1.05, 1.15])
def test_rests_between_two_impacts_that_are_nearly_alike_are_not_exchanged(harder: float) -> None:
    """A put-down jerks the sensor for a sample. Exchanged, one impact would nearly take the other's place."""
    recording = simulate(Task("still", (Waypoint(rest_s=6.0),)), "modern", 1).recording
    acc = recording.acc.copy()
    acc[200, 2] += 14.0
    acc[300, 2] += 14.0 * harder
    knocked = replace(recording, acc=acc)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert in_order(knocked) is knocked


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_wild_gyro_rows_are_left_out_however_small(rows: int) -> None:
    """1 rad/s over three samples is a turn of two degrees."""
    recording = pour("wt901", 1).recording
    assert recording.gyr is not None
    gyr = recording.gyr.copy()
    gyr[500 : 500 + rows, 1] += 1.0
    with pytest.warns(PbdWarning, match=f"^{rows} impossible samples? left out"):
        mended = without_wild(replace(recording, gyr=gyr))
    assert np.abs(not_none(mended.gyr) - recording.gyr).max() < 0.1


@pytest.mark.parametrize(
    ("channel", "off", "rows", "is_wild"),
    [("acc", 40.0, 1, True), ("acc", 20.0, 1, False), ("acc", 60.0, 2, False), ("gyr", 0.5, 1, True)],
)
def test_a_wild_row_is_farther_away_than_a_hand_moves_in_a_row(
    channel: str, off: float, rows: int, is_wild: bool
) -> None:
    """A tap may push that much, or for two rows."""
    recording = pour().recording
    values = getattr(recording, channel).copy()
    values[100 : 100 + rows, 0] += off
    spoilt = replace(recording, **{channel: values})
    told = r"^1 impossible sample left out .* row 100 \(t = 1\.00 s\): "
    with pytest.warns(PbdWarning, match=told) if is_wild else nullcontext():
        mended = without_wild(spoilt)
    assert (mended is spoilt) != is_wild


def test_without_a_gyro_no_wild_row_is_a_knock() -> None:
    recording = pour("os5000-nogyro", 1).recording
    acc = recording.acc.copy()
    acc[100, 0] += 40.0
    with pytest.warns(PbdWarning, match="^1 impossible sample left out"):
        mended = without_wild(replace(recording, acc=acc))
    np.testing.assert_allclose(mended.acc, recording.acc, atol=0.5)


@pytest.mark.parametrize(
    ("push", "late", "shake", "is_knock"),
    [
        (2.7, 0, 0.0, False),
        (5.0, 0, 0.0, True),
        (5.0, 2, 0.0, True),
        (5.0, -2, 0.0, True),
        (5.0, 3, 0.0, False),
        (5.0, -3, 0.0, False),
        (5.0, 0, 3.0, False),
    ],
)
def test_a_turn_is_real_if_a_knock_pushed_the_sensor_as_much(
    push: float, late: int, shake: float, is_knock: bool
) -> None:
    """2 rad/s within 10 ms, about a point 2 cm away or further: 4 m/s2 or more, and more than the hand shakes."""
    recording = pour("wt901", 1).recording
    acc, gyr = recording.acc.copy(), not_none(recording.gyr).copy()
    acc[:, 0] += np.resize((shake, -shake), len(acc))
    acc[500 + late, 0] += push
    gyr[500, 1] += 2.0
    knocked = replace(recording, acc=acc, gyr=gyr)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)
        assert (without_wild(knocked) is knocked) == is_knock


def test_a_hand_that_meets_a_table_is_no_wild_sample() -> None:
    """The hand stops from 8 cm/s within a sample, and may rock."""
    recording = pour("os5000", 1).recording
    acc, gyr = recording.acc.copy(), not_none(recording.gyr).copy()
    acc[200, 2] += 3.0
    gyr[200:204, 0] += (0.4, -0.3, 0.2, -0.1)
    met = replace(recording, acc=acc, gyr=gyr)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert in_order(without_wild(met)) is met


@pytest.mark.parametrize(("rows", "told"), [(5, False), (6, True)])
def test_six_rows_that_come_again_are_a_block_that_came_twice(rows: int, told: bool) -> None:
    recording = pour().recording
    again = np.concatenate((np.arange(500), np.arange(500 - rows, len(recording) - rows)))
    with (
        pytest.raises(RecordingError, match=f"rows 500 to {499 + rows} .* repeat rows {500 - rows} to 499")
        if told
        else nullcontext()
    ):
        refuse_doubled(replace(with_rows(recording, again), t=recording.t))


def test_of_several_blocks_that_came_twice_the_first_is_named() -> None:
    rows = np.concatenate([np.arange(start, start + 100) for start in range(0, 1000, 100) for _ in range(2)])
    recording = with_rows(pour().recording, rows)
    with pytest.raises(RecordingError, match=r"rows 100 to 199 .* repeat rows 0 to 99:"):
        refuse_doubled(replace(recording, t=np.arange(len(rows)) / 100.0))


@pytest.mark.parametrize("rows", range(2, 7))
def test_in_a_few_rows_no_block_came_twice_or_in_the_wrong_order(rows: int) -> None:
    few = with_rows(pour().recording, slice(0, rows))
    refuse_doubled(few)
    assert in_order(few) is few


def test_in_a_motion_without_noise_that_recurs_no_block_came_twice() -> None:
    """A program that makes its samples makes the same ones each second."""
    phase = 2.0 * np.pi * (np.arange(500) % 100) / 100.0
    gyr = np.column_stack((np.sin(phase), np.cos(phase), np.sin(2.0 * phase)))
    refuse_doubled(Recording(np.arange(500) / 100.0, gyr + np.array((0.0, 0.0, GRAVITY)), gyr))


def test_a_sum_that_is_equal_by_chance_is_no_block_that_came_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in ten million rows. With equal weights, exchanged axes have equal sums."""
    monkeypatch.setattr(splices, "IRRATIONAL", np.ones(6))
    recording = pour().recording
    acc = recording.acc.copy()
    acc[500:520] = acc[480:500, [1, 2, 0]]
    gyr = None if recording.gyr is None else recording.gyr.copy()
    assert gyr is not None
    gyr[500:520] = gyr[480:500]
    refuse_doubled(replace(recording, acc=acc, gyr=gyr))


def test_the_readings_of_a_coarse_sensor_recur_but_no_block_came_twice(data_folder: Path) -> None:
    """With 8 bits over 2 g and 250 degrees/s, a hand that rests shows the same six rows again."""
    (file,) = (data_folder / "broad").glob("05_*.npz")
    fine = read_broad(file)["286"].recording
    acc, gyr = coarsely(fine.acc, 4.0 * GRAVITY / 256.0), coarsely(not_none(fine.gyr), np.radians(500.0) / 256.0)
    coarse = replace(fine, acc=acc, gyr=gyr)
    refuse_doubled(coarse)
    fastest = int(np.argmax(np.abs(gyr).max(axis=1)))
    rows = np.insert(np.arange(len(acc)), fastest + 30, np.arange(fastest, fastest + 30))
    again = replace(with_rows(coarse, rows), t=np.arange(len(rows)) / 286.0)
    with pytest.raises(RecordingError, match="a block came twice"):
        refuse_doubled(again)


def coarsely(values: Array, step: float) -> Array:
    return np.asarray(step * np.round(values / step))
