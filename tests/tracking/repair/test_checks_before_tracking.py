"""Checks before tracking: holes that may hide a move, and a sensor that is off at rest."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.calibration.sensor_changed import disagreements
from pbd.data import Calibration, LinearErrors, Recording, SensorErrors, Stop
from pbd.errors import PbdWarning, TrackingError
from pbd.pipeline import track
from pbd.simulation.simulate import EARTH, TASKS
from pbd.tracking.first_rest import STILL_ACC
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.repair.gaps import Gap, find_gaps, refuse_gaps
from tests.not_none import not_none
from tests.scenarios import pour, simulate, truth_at, with_hole, with_rows
from tests.simulation.sway import with_sway
from tests.tracking.track_or_refuse import quietly

pytestmark = pytest.mark.usefixtures("cached_results")

EXACT = LinearErrors(np.zeros(3), np.eye(3), np.zeros(3))


@quietly
@pytest.mark.parametrize(
    ("start_s", "stop_s", "where"),
    [
        (0.8, 1.8, r"1000 ms .* in a rest, after row 79 \(t = 0\.79 s\)"),
        (0.8, 0.935, r"140 ms .* in a rest, after row 79 "),
        (21.8, np.inf, r"1010 ms .* in a rest, from row 2179 \(t = 21\.79 s\) to the end"),
        (0.0, 0.5, r"500 ms .* in a rest, up to row 50 \(t = 0\.50 s\)"),
    ],
)
def test_a_hole_in_a_rest_that_may_hide_a_move_is_refused(start_s: float, stop_s: float, where: str) -> None:
    said = f"^{where}.*: a move may be hidden in it; record again, or give --accept-gap to each command if the hand"
    with pytest.raises(TrackingError, match=said):
        track(with_hole(pour().recording, start_s, stop_s))


@quietly
def test_two_holes_in_a_rest_are_told_as_one_and_one_other() -> None:
    twice = with_hole(with_hole(pour().recording, 0.8, 1.2), 0.4, 0.6)
    with pytest.raises(TrackingError, match=r"^400 ms .*a move may be hidden in it, and in 1 other gap; record again"):
        track(twice)


def test_a_hole_in_a_rest_that_a_person_vouches_for_is_a_warning() -> None:
    whole = track(pour().recording)
    with (
        pytest.warns(PbdWarning, match="100 samples missing, in 1 gap"),
        pytest.warns(
            PbdWarning, match=r"1000 ms .* in a rest, after row 79 .*: a move may be hidden in it; it is taken"
        ),
    ):
        path = track(with_hole(pour().recording, 0.8, 1.8), accept_gap=True)
    assert len(path.stops) == 11
    assert np.sqrt(path.cov[1, 2, 2]) == pytest.approx(np.sqrt(whole.cov[1, 2, 2]), abs=0.005)  # m


@quietly
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lost_s", [5.0, 20.0])
def test_a_hand_stands_still_for_as_long_as_a_person_says(lost_s: float, seed: int) -> None:
    """If the motion in the hole were unknown, the next keyframes would be off by metres."""
    waypoints = list(TASKS["pour"].waypoints)
    waypoints[4] = replace(waypoints[4], rest_s=waypoints[4].rest_s + lost_s)
    demo = simulate(replace(TASKS["pour"], waypoints=tuple(waypoints)), "wt901", seed)
    end = sum(each.move_s + each.rest_s for each in waypoints[:5]) - 0.4
    for keyframe in find_keyframes(track(with_hole(demo.recording, end - lost_s, end), accept_gap=True)):
        assert np.linalg.norm(keyframe.T_nav_sensor.p - truth_at(not_none(demo.truth), keyframe.t)) < 0.03
        assert np.sqrt(np.diagonal(keyframe.cov)[:3]).max() < 0.02


@quietly
def test_a_person_vouches_for_a_hole_beside_which_the_hand_sways() -> None:
    """The row before the hole seemed to move, so the rest ended there: "while the hand moves", whatever was said."""
    start_s, rests = 9.53, tuple(replace(each, rest_s=3.0) for each in TASKS["pour"].waypoints)
    task = with_sway(replace(TASKS["pour"], waypoints=rests), 0.006, 1, turn=np.radians(1.0))
    recording = with_hole(simulate(task, "os5000", 1).recording, start_s, start_s + 1.0)
    with pytest.raises(TrackingError, match=r"in a rest, .*: a move may be hidden in it; .* --accept-gap"):
        track(recording)
    path = track(recording, accept_gap=True)
    assert path.stop_at(start_s - 0.3) == path.stop_at(start_s + 1.3) is not None


@quietly
def test_no_person_can_vouch_for_a_hole_in_a_move() -> None:
    with pytest.raises(TrackingError, match="while the hand moves"):
        track(with_hole(pour().recording, 2.6, 3.6), accept_gap=True)


@quietly
def test_a_short_hole_in_a_rest_is_a_warning() -> None:
    """A hand can move a centimetre in it. The keyframes' sigma grows by as much."""
    whole = track(pour().recording)
    path = track(with_hole(pour().recording, 0.8, 0.9))
    assert np.sqrt(path.cov[1, 2, 2] - whole.cov[1, 2, 2]) == pytest.approx(0.01, rel=0.2)


@quietly
def test_rows_that_were_lost_with_a_whole_move_are_refused() -> None:
    """Nothing moves before or after the hole. (A path once lost 14 cm like this.)"""
    recording = pour().recording
    before, after = track(recording).stops[1:3]
    rows = np.arange(len(recording), dtype=np.intp)
    kept = (rows < before.stop - 15) | (rows >= after.start + 15)
    with pytest.raises(TrackingError, match=r"a move may be hidden in it|while the hand moves"):
        track(with_rows(recording, rows[kept]))


@quietly
def test_a_hand_rests_beside_a_hole_where_a_tenth_of_a_second_on_either_hand_says_so() -> None:
    """At 100 Hz these are ten samples in one attitude. Nine are too few, and so are ten of which one is far off."""
    hole, acc = Gap(39, 45, 0.05), np.tile((0.0, 0.0, 9.81), (100, 1))

    def refused(stop: Stop, *tilted: int) -> bool:
        shown = acc.copy()
        shown[list(tilted), 0] += 10.2 * STILL_ACC
        try:
            refuse_gaps((hole,), Recording(t=np.arange(100) / 100.0, acc=shown), (stop,), accept=False)
        except TrackingError:
            return True
        return False

    enough = Stop(30, 55, 0.25)
    assert not refused(enough)
    assert refused(replace(enough, start=31))
    assert refused(replace(enough, stop=54))
    assert refused(Stop(60, 90, 0.3))
    assert [row for row in range(100) if refused(enough, row)] == [*range(30, 40), *range(45, 55)]


def test_a_short_hole_at_the_end_of_a_rest_hides_nothing() -> None:
    recording = Recording(np.arange(100) / 100.0, np.tile((0.0, 0.0, 9.81), (100, 1)))
    refuse_gaps((Gap(89, 99, 0.1),), recording, (Stop(40, 100, 0.59),), accept=False)


@quietly
def test_a_hole_before_the_first_stop_is_in_none() -> None:
    recording = Recording(np.arange(100) / 100.0, np.tile((0.0, 0.0, 9.81), (100, 1)))
    with pytest.raises(TrackingError, match=r"after row 0 .* while the hand moves"):
        refuse_gaps((Gap(0, 30, 0.29),), recording, (Stop(40, 90, 0.49),), accept=False)


@pytest.mark.parametrize(("row", "before", "after"), [(0, 0, 1), (5, 4, 6), (9, 8, 9)])
def test_one_sample_without_data_is_a_gap_at_an_end_too(row: int, before: int, after: int) -> None:
    (gap,) = find_gaps(np.arange(10) / 10.0, np.arange(10) == row, 0.1)
    assert (gap.before, gap.after) == (before, after)
    assert gap.missing_s == pytest.approx(0.1)


@quietly
def test_of_a_slow_sensor_two_samples_on_either_hand_of_a_hole_show_a_rest() -> None:
    recording = Recording(np.arange(100) / 10.0, np.tile((0.0, 0.0, 9.81), (100, 1)))
    hole, enough = Gap(39, 40, 0.09), Stop(38, 42, 0.3)
    refuse_gaps((hole,), recording, (enough,), accept=False)
    for short in (replace(enough, start=39), replace(enough, stop=41)):
        with pytest.raises(TrackingError, match="while the hand moves"):
            refuse_gaps((hole,), recording, (short,), accept=False)


@quietly
@pytest.mark.parametrize("channel", ["acc", "gyr"])
def test_a_column_that_ends_is_refused(channel: str) -> None:
    """Filled with its last value it would be at rest to the end."""
    recording = pour().recording
    values = getattr(recording, channel).copy()
    values[100:, 1] = np.nan
    with pytest.raises(TrackingError, match=r"missing in a rest, from row 99 \(t = 0\.99 s\) to the end"):
        track(replace(recording, **{channel: values}))


@pytest.mark.parametrize(("method", "scale"), [("default", 0.955), ("default", 1.1), ("paper", 1.1)])
def test_gravity_that_is_far_off_is_told_and_widens_sigma(method: str, scale: float) -> None:
    """A scale error of the accelerometer stretches the path by as much, except where gravity shows it: vertically."""
    demo = pour("os5000")
    plain, wrong = track(demo.recording, method), replace(demo.recording, acc=scale * demo.recording.acc)
    with pytest.warns(PbdWarning, match=r"m/s2, but gravity is 9\.81 m/s2, \d+ mg off: calibrate this sensor$"):
        path = track(wrong, method)
    if method == "default":
        sigma = np.sqrt(np.diagonal(path.cov, axis1=1, axis2=2)[:, :3])
        off = np.array([k.T_nav_sensor.p - truth_at(not_none(demo.truth), k.t) for k in find_keyframes(path)])
        assert np.abs(off[1:] / sigma[1:]).max() < 3.0
        far = int(np.argmax(np.linalg.norm([k.T_nav_sensor.p for k in find_keyframes(path)], axis=1)))
        assert sigma[far].max() > 1.5 * np.sqrt(np.diagonal(plain.cov[far])[:3].max())


@pytest.mark.parametrize(("read", "told"), [(0.98, True), (0.99, False)])
def test_another_unit_of_the_same_model_does_not_pass_for_the_calibrated_one(read: float, told: bool) -> None:
    """It is 20 mg off, which without a calibration is normal for this sensor."""
    recording = pour("ideal").recording
    info = replace(recording.info, sensor="anything")
    recording = replace(recording, acc=read * recording.acc, info=info)
    errors = SensorErrors(recording.info.sensor, acc=EXACT, gravity=EARTH.gravity)
    calibration = Calibration("bench", sensor=errors)
    track(recording)
    if told:
        with pytest.warns(PbdWarning, match=r"the calibrated acc.* reads 9\.61 m/s2, .* 20 mg off: calibrate this"):
            track(recording, calibration=calibration)
    else:
        track(recording, calibration=calibration)


@pytest.mark.parametrize("name", ["gyr", "mag"])
def test_all_of_a_sensor_is_compared_with_its_calibration(name: str) -> None:
    recording = pour("ideal").recording
    assert recording.mag is not None
    errors = SensorErrors(recording.info.sensor, gyr=EXACT, mag=EXACT, field=60.0, dip=1.1)
    recording = replace(recording, gyr=not_none(recording.gyr) + 0.05) if name == "gyr" else recording
    errors = replace(errors, mag=None) if name == "gyr" else errors
    told = "the gyro is .* degrees/s off its" if name == "gyr" else "the magnetic field is .* uT, but was 60"
    with pytest.warns(PbdWarning, match=f"{told} .*calibrat.*: calibrate this sensor$"):
        track(recording, calibration=Calibration("bench", sensor=errors))


def test_gravity_differs_by_less_on_earth_than_is_told() -> None:
    for gravity in (9.764, 9.834):  # at the equator's highest peak, at the pole
        assert disagreements(None, np.array((0.0, 0.0, gravity))) == ()
