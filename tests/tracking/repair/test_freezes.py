"""A device that repeats one sample for a while: in a move an error, with any noise; at rest allowed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pbd.data import GRAVITY, Demonstration, Recording
from pbd.errors import PbdError, TrackingError
from pbd.pipeline import track
from pbd.simulation.sensor_model import SensorModel
from pbd.simulation.simulate import SENSOR_MODELS, TASKS, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.repair.channel_faults import frozen_rows
from pbd.tracking.repair.gaps import Gap
from pbd.tracking.repair.repair_recording import _longest_unbroken
from tests.scenarios import broken, keyframes_and_errors, pour, simulate, with_rows
from tests.tracking.track_or_refuse import quietly

pytestmark = pytest.mark.usefixtures("cached_results")


def coarse(acc_mg: float, gyr_deg_s: float) -> SensorModel:
    """The paper's sensor with a resolution so coarse that it repeats itself at rest."""
    model = SENSOR_MODELS["os5000"]
    assert model.gyr is not None
    acc = replace(model.acc, step=1e-3 * GRAVITY * acc_mg)
    return replace(model, acc=acc, gyr=replace(model.gyr, step=np.radians(gyr_deg_s)))


SENSORS: dict[str, str | SensorModel] = {
    **{name: name for name in SENSOR_MODELS},
    "steps of 16 mg": coarse(16.0, 0.25),
    "steps of 30 mg": coarse(30.0, 1.0),
}
MOVES: dict[str, str | Task] = {"turning": random_task(1, moves=3), "straight": "pick-and-place-stops"}


def held(recording: Recording, start: int, stop: int) -> Recording:
    rows = np.arange(len(recording), dtype=np.intp)
    rows[start:stop] = start
    return replace(with_rows(recording, rows), t=recording.t)


def fastest(demo: Demonstration) -> list[int]:
    """The row of each move with the highest speed."""
    assert demo.truth is not None
    speed = np.linalg.norm(np.gradient(demo.truth.p_nav_sensor, demo.truth.t, axis=0), axis=1)
    edges = np.flatnonzero(np.diff((speed > 0.02).astype(int)))
    return [int(a + np.argmax(speed[a:b])) for a, b in zip(edges[::2], edges[1::2], strict=False)]


@quietly
@pytest.mark.parametrize(
    ("sensor", "rate_hz", "move"),
    [
        ("os5000-nogyro", 40.0, "straight"),
        ("steps of 16 mg", 40.0, "straight"),  # with steps of 30 mg, a freeze looks like a slow move
        ("ideal", 286.0, "straight"),
        ("modern", 100.0, "turning"),
    ],
)
def test_a_freeze_in_a_move_is_refused_or_makes_unsure(sensor: str, rate_hz: float, move: str) -> None:
    """At the highest speed of a straight move the sensor reads what it reads at rest: it seems to stop dead."""
    demo = simulate(MOVES[move], SENSORS[sensor], 1, rate_hz=rate_hz)
    for row in fastest(demo):
        for seconds in (0.3, 2.0):
            assert refused_or_unsure(demo, row, row + round(seconds * rate_hz))


def refused_or_unsure(demo: Demonstration, start: int, stop: int) -> bool:
    """Track with held rows: refused, or with a wider sigma."""
    try:
        keyframes, errors = keyframes_and_errors(replace(demo, recording=held(demo.recording, start, stop)))
    except PbdError:
        return True
    sigmas = np.sqrt([np.trace(keyframe.cov[:3, :3]) for keyframe in keyframes])
    return len(keyframes) == 1 or bool((errors < np.maximum(3.0 * sigmas, 0.02)).all())  # one is no motion


@quietly
def test_half_a_swift_move_is_no_jolt() -> None:
    """Half of a move of 0.2 s is recorded: before a freeze, or after one that began in the rest before."""
    task, rate_hz = random_task(3, moves=2, reach_m=0.15, max_turn=0.0, move_s=(0.17, 0.22), rest_s=(0.6, 1.0)), 100.0
    demo = simulate(task, SENSORS["steps of 16 mg"], 1, rate_hz=rate_hz)
    for row in fastest(demo):
        for start, stop in ((-0.3, 0.0), (0.0, 0.3), (0.0, 0.5)):
            for late in (0, 1):
                assert refused_or_unsure(demo, row + round(start * rate_hz) + late, row + round(stop * rate_hz) + late)


@quietly
@pytest.mark.parametrize(("sensor", "rate_hz"), [("steps of 16 mg", 100.0), ("steps of 30 mg", 40.0)])
def test_a_knock_at_rest_is_no_freeze(sensor: str, rate_hz: float) -> None:
    """A knock gives the sensor a speed and takes it back within two samples."""
    recording = simulate("pour", SENSORS[sensor], rate_hz=rate_hz).recording
    row, acc = round(1.5 * rate_hz), recording.acc.copy()
    acc[row], acc[row + 1] = acc[row] + 17.65, acc[row + 1] - 17.65  # of either coarse sensor's steps, a whole number
    assert len(track(replace(recording, acc=acc)).stops) == len(track(recording).stops)


@quietly
@pytest.mark.parametrize(("sensor", "rate_hz"), [("ideal", 100.0), ("steps of 16 mg", 40.0)])
def test_a_freeze_where_the_sensor_reads_what_it_reads_at_rest_is_told_as_such(sensor: str, rate_hz: float) -> None:
    """The freeze lasts from the middle of a straight move into the next rest."""
    demo = simulate("pour", SENSORS[sensor], rate_hz=rate_hz)
    row = fastest(demo)[1]
    with pytest.raises(TrackingError, match=r"the hand was moving .*: the sensor froze during a move"):
        track(held(demo.recording, row, row + round(0.8 * rate_hz)))


@quietly
def test_a_coarse_sensor_is_tracked() -> None:
    tasks: tuple[str | Task, ...] = ("pick-and-place-stops", random_task(5))
    for task in tasks:
        track(simulate(task, SENSORS["steps of 16 mg"], 1, rate_hz=40.0).recording)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_a_rest_is_no_freeze_however_coarse_the_sensor(sensor: str, rate_hz: float) -> None:
    short = random_task(2, moves=6, first_rest_s=0.5, rest_s=(0.3, 0.6))
    tasks: tuple[str | Task, ...] = (*TASKS, random_task(5), short)
    for task in tasks:
        assert not frozen_rows(simulate(task, SENSORS[sensor], 1, rate_hz=rate_hz).recording).any()


@quietly
def test_a_hole_between_two_attitudes_is_no_rest() -> None:
    """The bottle is rolled in the hole, from one rest to another. Interpolation joins the two smoothly."""
    demo = pour()
    assert demo.truth is not None
    stops = track(demo.recording).stops
    up = [np.mean(demo.recording.acc[stop.start : stop.stop], axis=0) for stop in stops]
    k = int(np.argmax([np.linalg.norm(b - a) for a, b in pairwise(up)]))
    hole = slice(stops[k].stop - 5, stops[k + 1].start + 5)
    recording = broken(broken(demo.recording, "acc", hole, np.nan), "gyr", hole, np.nan)
    with pytest.raises(TrackingError, match="while the hand moves"):
        track(recording)


def test_what_froze_was_measured_once_and_what_is_clipped_did_not_freeze() -> None:
    recording = simulate("pour", "modern").recording
    still = held(recording, 300, 310)
    assert np.flatnonzero(frozen_rows(still)).tolist() == list(range(301, 310))
    ends = recording.acc.copy()
    ends[300:310] = 40.0
    assert not frozen_rows(replace(recording, acc=ends)).any()


def test_rows_that_were_written_twice_hide_no_freeze() -> None:
    """With their time they are the same sample; they don't make the sensor a coarse one, which repeats itself."""
    recording = held(simulate("pour", "modern").recording, 300, 310)
    rows = np.sort(np.concatenate((np.arange(len(recording)), np.arange(0, len(recording), 20))))
    twice = with_rows(recording, rows)
    assert set(rows[frozen_rows(twice)]) == set(range(301, 310))


@pytest.mark.parametrize(("every", "frozen"), [(200, True), (40, False)])
def test_a_sensor_that_repeats_more_than_one_row_in_a_hundred_is_coarse(every: int, frozen: bool) -> None:
    recording = held(simulate("pour", "modern").recording, 300, 310)
    rows = np.arange(len(recording))
    rows[every::every] -= 1
    assert frozen_rows(replace(with_rows(recording, rows), t=recording.t)).any() == frozen


@pytest.mark.parametrize(("again", "frozen"), [(2, False), (3, True)])
def test_a_slow_sensor_is_frozen_after_three_equal_samples(again: int, frozen: bool) -> None:
    recording = simulate("pour", "modern", rate_hz=25.0).recording
    assert frozen_rows(held(recording, 60, 61 + again)).any() == frozen


def test_the_gyro_is_compared_with_gravity_in_the_longest_unbroken_part() -> None:
    recording = simulate("pour", "modern").recording
    part = _longest_unbroken(recording, (Gap(200, 230, 0.29), Gap(1800, 1830, 0.29)))
    assert part is not None
    assert part.t.tolist() == recording.t[230:1801].tolist()
    assert part.acc.tolist() == recording.acc[230:1801].tolist()
