"""Empty, short and damaged recordings: a clear error or a right answer, never a traceback or NaN."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from pbd.data import Demonstration, Recording
from pbd.data.source_columns import Column, SourceColumns
from pbd.errors import PbdError, PbdWarning, RecordingError, TrackingError
from pbd.pipeline import track
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task
from pbd.simulation.tasks import Task
from pbd.tracking.first_rest import find_rest
from pbd.tracking.repair.repair_recording import repair_recording
from tests.not_none import not_none
from tests.scenarios import broken, keyframes_and_errors, pour, simulate, with_channel, with_rows
from tests.tracking.fault_matrix import Case, named, outcome
from tests.tracking.track_or_refuse import every_method, quietly

pytestmark = pytest.mark.usefixtures("cached_results")

every_channel = pytest.mark.parametrize("channel", ["acc", "gyr", "mag", "device_rpy"])

RIGHT_M = 0.05
"""A right answer is within this of the truth."""


@quietly
@pytest.mark.parametrize(
    ("sensor", "seed"), [("modern", 0), ("modern", 1), ("os5000", 0), ("os5000", 1), ("wt901", 7), ("os5000", 7)]
)
def test_under_half_a_second_of_rest_at_the_start_is_enough_if_a_later_one_is_longer(sensor: str, seed: int) -> None:
    demo = simulate(random_task(seed, moves=4, first_rest_s=0.4, rest_s=(1.1, 1.5)), sensor, seed)
    keyframes, errors = keyframes_and_errors(demo)
    assert len(keyframes) == 5
    assert errors.max() < RIGHT_M


@pytest.mark.parametrize("seed", [3, 10])
def test_a_perfect_sensor_is_tracked_to_a_millimetre_after_a_short_rest(seed: int) -> None:
    demo = simulate(random_task(seed, moves=4, first_rest_s=0.4, rest_s=(1.1, 1.5)), "ideal")
    keyframes, errors = keyframes_and_errors(demo)
    assert len(keyframes) == 5
    assert errors.max() < 1e-3


@quietly
def test_a_slow_turn_about_the_vertical_is_no_rest() -> None:
    """Three seconds at 3 degrees per second are as quiet as a rest, but the later rests have another rate."""
    recording = with_channel(pour("wt901", 1).recording, "mag", None)
    assert recording.gyr is not None
    second = round(recording.rate_hz)
    rows = np.random.default_rng(1).integers(0, second, 3 * second)  # of the rest
    up = recording.acc[rows].mean(axis=0) / np.linalg.norm(recording.acc[rows].mean(axis=0))
    begun = Recording(
        np.arange(len(rows) + len(recording)) / recording.rate_hz,
        np.vstack((recording.acc[rows], recording.acc)),
        np.vstack((recording.gyr[rows] + np.radians(3.0) * up, recording.gyr)),
        info=recording.info,
    )
    paths = [track(each) for each in (recording, begun)]
    places = [path.p_nav_sensor[[stop.start for stop in path.stops]] for path in paths]
    there, away = (np.linalg.norm(np.diff(each, axis=0), axis=1) for each in places)
    assert away == pytest.approx(there, abs=0.005)


def test_a_hole_of_seconds_leaves_the_first_rest_where_it_is() -> None:
    recording = pour().recording
    t = np.where(np.arange(len(recording)) < len(recording) // 2, recording.t, recording.t + 5.0)
    assert find_rest(replace(recording, t=t)).start == find_rest(recording).start == 0


def test_a_rest_that_the_stops_after_it_contradict_is_refused() -> None:
    """Without this rest there is no dock, and the whole path would be elsewhere."""
    case = Case(named("gyr scaled", "x x 1.1"), "random", "modern", 2)
    assert outcome(case).said.startswith("the sensor seems to rest from 0.0 to 1.0 s, but the stops beside it contra")


@quietly
@pytest.mark.parametrize("seed", [0, 6])
def test_where_no_rest_lasts_a_second_nothing_wrong_is_said(seed: int) -> None:
    assert refused_or_right(simulate(random_task(seed, moves=4, first_rest_s=0.45, rest_s=(0.5, 0.6)), "modern", seed))


def refused_or_right(demo: Demonstration) -> bool:
    try:
        _, errors = keyframes_and_errors(demo)
    except PbdError:
        return True
    return bool(errors.max() < RIGHT_M)


@every_method
@pytest.mark.parametrize("sensor", ["modern", "os5000"])
def test_a_hand_that_never_rests_is_refused(method: str, sensor: str) -> None:
    there, back = Waypoint((0.15, 0.1, 0.05), (0.3, 0.2, 0.0), 0.5), Waypoint((0.0, 0.0, 0.0), (-0.3, 0.0, 0.4), 0.5)
    task = Task("restless", (Waypoint(), *(5 * (there, back))))
    with pytest.raises(TrackingError, match="never stands still"):
        track(simulate(task, sensor).recording, method)


@every_method
def test_a_foot_that_runs_all_the_time_has_no_wrong_unit(method: str) -> None:
    """Its specific force is twice gravity, even in the calmest second."""
    task = Task("run", (Waypoint(), *(Waypoint((0.8 * (k % 2), 0.0, 0.0), (0.0, 0.5, 0.0), 0.3) for k in range(1, 40))))
    with pytest.raises(TrackingError, match="never stands still"):
        track(simulate(task, "modern").recording, method)


def test_a_hand_that_never_rests_shows_no_wrong_axis() -> None:
    """It turns even in its calmest second, whose mean rate is no bias. In each second it is calm for 0.4 s."""
    rng, t = np.random.default_rng(9), np.arange(0.0, 20.0, 0.02)
    swung = t % 1.0 > 0.4
    rate = np.repeat(rng.choice([-2.0, 2.0], 20) + 0.3 * rng.normal(size=20), 50) * swung
    angle = 0.02 * np.cumsum(rate)
    acc = np.column_stack((2.0 * rng.normal(size=1000) * swung, 9.8 * np.sin(angle), 9.8 * np.cos(angle)))
    gyr = np.column_stack((rate, 0.0 * t, 0.0 * t)) + 0.01 * rng.normal(size=(1000, 3))
    with pytest.raises(TrackingError, match="never stands still"):
        track(Recording(t, acc + 0.03 * rng.normal(size=(1000, 3)), gyr))


@pytest.mark.parametrize(("unit", "other"), [("rad/s", "deg/s"), ("deg/s", "...")])
def test_where_the_gyro_alone_never_rests_another_unit_is_named_than_it_was_read_in(unit: str, other: str) -> None:
    recording = simulate("pour", "modern").recording
    source = SourceColumns((Column("gx", "gx", 1.0, unit, "its name", "--unit"),))
    fast = replace(recording, gyr=1000.0 * not_none(recording.gyr), info=replace(recording.info, source=source))
    with pytest.raises(TrackingError, match=rf"still .* is not in {unit}, give its unit: --unit gyr={other}\)$"):
        track(fast)  # its quietest second is in a move


@every_method
@pytest.mark.parametrize("rows", [0, 1])
def test_no_or_one_sample_is_refused(method: str, rows: int) -> None:
    with pytest.raises(RecordingError, match=f"the recording has {rows} samples?; record at least a second"):
        track(with_rows(pour().recording, slice(0, rows)), method)


@every_method
@pytest.mark.parametrize("row", [0, 250, 299])
def test_ten_samples_are_refused_wherever_they_are_from(method: str, row: int) -> None:
    """In a tenth of a second any motion looks like a rest."""
    with pytest.raises(RecordingError, match=r"the recording lasts 0\.1 s \(10 samples\); record at least a second of"):
        track(with_rows(pour().recording, slice(row, row + 10)), method)


@pytest.mark.parametrize(
    ("value", "reads"),
    [
        (0.0, "always reads 0"),
        (30.0, r"always reads 51\.96"),
        ((20.0, -5.0, 40.0), r"always reads 45"),
        (np.nan, "has no number in any row"),
        (1e300, "has no number in any row"),
    ],
)
def test_a_magnetometer_that_tells_nothing_is_left_out(value: float | tuple[float, ...], reads: str) -> None:
    recording = pour().recording
    with pytest.warns(
        PbdWarning, match=f"the magnetometer {reads} and is left out: heading starts at the sensor's own x"
    ):
        path = track(replace(recording, mag=np.full_like(recording.acc, value)))
    without = track(replace(recording, mag=None))
    assert np.array_equal(path.p_nav_sensor, without.p_nav_sensor)
    assert np.array_equal(path.wxyz_nav_sensor, without.wxyz_nav_sensor)


@every_method
@pytest.mark.parametrize("channel", ["acc", "gyr", "device_rpy"])
@pytest.mark.parametrize(("value", "column"), [(np.nan, slice(None)), (-1e300, 0)])
def test_a_channel_without_a_number_is_named(method: str, channel: str, value: float, column: int | slice) -> None:
    recording = pour().recording
    values = np.array(getattr(recording, channel))
    values[:, column] = value
    with pytest.raises(RecordingError, match=f"'{channel}' has no number in any row; leave the column out"):
        track(with_channel(recording, channel, values), method)


def test_an_accelerometer_and_a_gyro_without_a_common_time_are_refused() -> None:
    """As two tables that were merged by time."""
    recording = pour().recording
    acc, gyr = np.array(recording.acc), np.array(recording.gyr)
    acc[::2], gyr[1::2] = np.nan, np.nan
    with pytest.raises(RecordingError, match="no row has a reading of both accelerometer and gyro; interpolate them"):
        track(replace(recording, acc=acc, gyr=gyr))


@pytest.mark.filterwarnings("ignore:--method paper finds:pbd.errors.PbdWarning")
@pytest.mark.parametrize(("method", "value"), [("default", np.nan), ("paper", -1e300)])
@every_channel
def test_rows_without_a_number_are_bridged(method: str, channel: str, value: float) -> None:
    """Three rows in a move, 40 ms between good ones."""
    recording = with_rows(pour().recording, slice(0, 780))
    rows = slice(300, 303)
    if channel in ("acc", "gyr"):
        with pytest.warns(PbdWarning, match=r"3 samples missing, in 1 gap; .* after row 299 \(t = 2\.99 s\)"):
            path = track(broken(recording, channel, rows, value), method)
    else:
        path = track(broken(recording, channel, rows, value), method)
    whole = track(recording, method)
    assert len(path.stops) == len(whole.stops)
    assert np.abs(path.p_nav_sensor - whole.p_nav_sensor).max() < 0.01


@quietly
@pytest.mark.parametrize(("channel", "length"), [("acc", 10), ("gyr", 40)])
def test_a_long_hole_in_a_move_is_refused_with_its_place(channel: str, length: int) -> None:
    with pytest.raises(TrackingError, match=r"are missing after row 279 \(t = 2\.79 s\), while the hand moves"):
        track(broken(pour().recording, channel, slice(280, 280 + length), np.nan))


@every_method
@pytest.mark.parametrize(("unit", "per_s"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_time_that_is_not_in_seconds_is_refused(method: str, unit: str, per_s: float) -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match=rf"likely in {unit}: import the file with --unit t={unit}$"):
        track(replace(recording, t=per_s * recording.t), method)


def test_a_time_that_may_count_the_rows_names_the_rate_too() -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match=r"--unit t=ms, or with its --rate HZ if it counts rows$"):
        track(replace(recording, t=np.arange(len(recording.t), dtype=np.float64)))


@pytest.mark.parametrize("interval", [1e-9, 1e-90, 1e-310])
def test_samples_closer_than_any_sensors_are_refused(interval: float) -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match="the samples come"):
        track(replace(recording, t=np.multiply(interval, np.arange(float(len(recording))))))


@every_method
@pytest.mark.parametrize("t", [0.0, 5.0, -1e9])
def test_a_time_that_stands_still_is_refused(method: str, t: float) -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match="most rows carry the same time; the column 't' must be seconds"):
        track(replace(recording, t=np.full(len(recording), t)), method)


@every_method
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 700, 1942])
def test_an_instant_that_is_no_number_is_named(method: str, value: float, row: int) -> None:
    recording = pour().recording
    t = recording.t.copy()
    t[row] = value
    with pytest.raises(RecordingError, match=f"the time of row {row} is not a number"):
        track(replace(recording, t=t), method)


def test_times_of_which_one_is_a_number_tell_no_rate() -> None:
    recording = with_rows(pour().recording, slice(0, 120))
    with pytest.raises(RecordingError, match="the time of row 1 is not a number"):
        track(replace(recording, t=np.append(0.0, np.full(119, np.nan))))


@pytest.mark.parametrize(
    ("usual", "refused"), [(1e-300, True), (0.008, True), (0.012, False), (9e4, False), (2e5, True)]
)
def test_a_field_in_another_unit_is_refused(usual: float, refused: bool) -> None:
    recording = with_rows(pour().recording, slice(0, 120))
    field = np.asarray(recording.mag)
    field = usual / float(np.median(np.linalg.norm(field, axis=1))) * field
    with pytest.raises(RecordingError, match="its unit is another") if refused else nullcontext():
        repair_recording(replace(recording, mag=field))


@pytest.mark.parametrize("gyro", [True, False])
@pytest.mark.parametrize(("factor", "turn", "refused"), [(1.0, 2.0 * np.pi, False), (180.0 / np.pi, 0.0, True)])
def test_an_attitude_in_degrees_is_refused(gyro: bool, factor: float, turn: float, refused: bool) -> None:
    """A heading that counts on after a turn is none."""
    recording = simulate("pour", "modern").recording
    rpy = factor * not_none(recording.device_rpy) + [0.0, 0.0, turn]
    recording = replace(recording, device_rpy=rpy, gyr=recording.gyr if gyro else None)
    with pytest.raises(RecordingError, match="--unit angle=deg") if refused else nullcontext():
        repair_recording(recording)


@quietly
def test_a_disturbed_field_in_a_recording_of_a_second_is_no_bug() -> None:
    recording = with_rows(pour().recording, slice(0, 120))
    field = np.where(recording.t[:, None] > 0.6, 2.0, 1.0) * np.asarray(recording.mag)
    assert len(track(replace(recording, mag=field)).stops) == 1


@quietly
def test_a_magnetometer_that_starts_late_is_no_bug() -> None:
    recording = pour().recording
    assert len(track(broken(recording, "mag", slice(0, 300), 0.0)).stops) == 11


@quietly
def test_an_accelerometer_that_reads_zero_throughout_a_stop_is_refused() -> None:
    recording = pour().recording
    stop = track(recording).stops[3]
    with pytest.raises(PbdError):
        track(broken(recording, "acc", slice(stop.start, stop.stop), 0.0))


@quietly
@pytest.mark.parametrize("row", [28, 31])
def test_a_row_repeated_ten_times_is_no_stop(row: int) -> None:
    """A row repeated as often as the window is long would be a stop without duration."""
    recording = simulate("pour", "modern", rate_hz=10.0).recording
    rows = np.sort(np.append(np.arange(len(recording), dtype=np.intp), 9 * [row]))
    assert len(track(with_rows(recording, rows)).stops) == len(track(recording).stops)
