"""What a person is told while the hand moves, once and at the right moment."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.data import Keyframe, LinearErrors, Recording, SensorErrors
from pbd.pose import Pose
from pbd.record.person_messages import Feedback, describe_stop, in_cm
from pbd.record.session_types import Message
from pbd.sensors.decoding import Sample
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from pbd.tracking.online.tracker import DataFlaw, LiveEvent, StopBegan, StopEnded
from tests.not_none import not_none

LEVEL = Sample((0.0, 0.0, 9.8), (0.0, 0.0, 0.0))


def keyframe(x: float) -> Keyframe:
    return Keyframe(1.0, 0.5, Pose(np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])), 1e-6 * np.eye(6))


def begun(index: int, x: float) -> StopBegan:
    return StopBegan(index, 1.0, 1.2, keyframe(x))


class Scripted:
    """A tracker that says what it is told to."""

    def __init__(self) -> None:
        self.events: tuple[LiveEvent, ...] = ()
        self.moving, self.sigma_of_move, self.waiting = False, 0.0, ""

    def feed(self, *given: object) -> tuple[LiveEvent, ...]:
        return self.events


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> tuple[Feedback, Scripted]:
    feedback, tracker = Feedback(0.01), Scripted()
    monkeypatch.setattr(feedback, "tracker", tracker)
    return feedback, tracker


def said(scripted: tuple[Feedback, Scripted], t: float, *events: LiveEvent, **state: object) -> tuple[Message, ...]:
    feedback, tracker = scripted
    tracker.events = events
    for name, value in state.items():
        setattr(tracker, name, value)
    feedback.feed(t, LEVEL)
    return feedback.take_messages()


@pytest.mark.parametrize(("sigma_m", "advice"), [(0.045, "you may move on"), (0.055, "very uncertain: pause in long")])
def test_a_stop_that_is_very_uncertain_is_no_reason_to_move_on(
    scripted: tuple[Feedback, Scripted], sigma_m: float, advice: str
) -> None:
    stop = begun(1, 0.1)
    cov = np.diag((1e-6, sigma_m**2, 1e-6, 1e-6, 1e-6, 1e-6))
    (told,) = said(scripted, 0.1, replace(stop, keyframe=replace(stop.keyframe, cov=cov)))
    assert told.text.partition(" cm: ")[2].startswith(advice)


def test_only_a_stop_in_place_of_another_rings_a_second_bell(scripted: tuple[Feedback, Scripted]) -> None:
    (first,) = said(scripted, 0.1, begun(1, 0.1))
    assert first.bell
    assert first.text == "stop 1 at (10.0, 0.0, 0.0) cm, sigma 0.1 cm: you may move on"
    (again,) = said(scripted, 0.2, replace(begun(1, 0.12), continues=True))
    assert not again.bell
    assert again.text == "stop 1 at (12.0, 0.0, 0.0) cm, sigma 0.1 cm"
    (instead,) = said(scripted, 0.25, begun(1, 0.2))
    assert instead.bell
    (second,) = said(scripted, 0.3, begun(2, 0.3))
    assert second.bell
    assert scripted[0].stops == 3


def test_a_pause_is_asked_for_once_in_a_move(scripted: tuple[Feedback, Scripted]) -> None:
    assert said(scripted, 0.1, moving=True, sigma_of_move=0.009) == ()
    (asked,) = said(scripted, 0.2, sigma_of_move=0.02)
    assert (asked.text, asked.bell) == ("pause now: 2 cm", True)
    assert said(scripted, 0.3, sigma_of_move=0.03) == ()
    said(scripted, 0.4, begun(1, 0.1), moving=False, sigma_of_move=0.0)
    said(scripted, 0.5, begun(1, 0.1))
    (asked,) = said(scripted, 0.6, moving=True, sigma_of_move=0.011)
    assert asked.text == "pause now: 1 cm"


def test_a_flaw_of_the_data_is_told(scripted: tuple[Feedback, Scripted]) -> None:
    assert said(scripted, 0.1, DataFlaw(0.1, "80 ms of data are missing")) == (
        Message(0.1, "80 ms of data are missing"),
    )


def test_lengths_are_written_as_one_says_them() -> None:
    assert [in_cm(length) for length in (0.0004, 0.0099, 0.01, 0.024)] == ["0.0 cm", "1.0 cm", "1 cm", "2 cm"]
    assert describe_stop(keyframe(-0.1)) == "(-10.0, 0.0, 0.0) cm, sigma 0.1 cm"
    assert describe_stop(keyframe(-1e-4)) == "(0.0, 0.0, 0.0) cm, sigma 0.1 cm"  # without a minus


def test_what_can_not_be_tracked_is_told_once() -> None:
    feedback = Feedback(0.01)
    for k in range(20):
        feedback.feed(k / 100.0, Sample((0.0, 0.0, 9.8)))
    (only,) = feedback.take_messages()
    assert only.text.startswith("there is neither a gyro nor the device's own attitude")
    assert feedback.stops == 0


@pytest.mark.parametrize(
    ("up", "shakes", "told"),
    [
        (9.8, 2.0, "hold still for 1 s: the hand shakes with "),
        (1.0, 0.0, "the accelerometer's values are likely in g: end the recording, and give --unit acc=g"),
    ],
    ids=["a hand that moves from the start", "g taken for m/s2"],
)
def test_a_start_without_rest_is_told_soon(up: float, shakes: float, told: str) -> None:
    rng, feedback = np.random.default_rng(1), Feedback(0.01)
    lines = list[Message]()
    for k in range(400):
        x, y, z = rng.normal((shakes * np.sin(0.3 * k), 0.0, up), 0.01).tolist()
        feedback.feed(k / 100.0, Sample((x, y, z), (0.001 * (k % 7), 0.0, 0.0)))
        lines += feedback.take_messages()
    assert len(lines) == 1
    assert told in lines[0].text
    assert lines[0].bell
    assert lines[0].t < 1.6


@pytest.mark.parametrize("up", [9.8, -9.8])
def test_a_sensor_that_lies_upside_down_is_told_at_the_first_rest(up: float) -> None:
    rng, feedback = np.random.default_rng(1), Feedback(0.01)
    for k in range(150):
        x, y, z = rng.normal((0.0, 0.0, up), 0.01).tolist()
        feedback.feed(k / 100.0, Sample((x, y, z), (0.001 * (k % 7), 0.0, 0.0)))
    found, *more = feedback.take_messages()
    assert found.text == "the rest at the start is found: you may move"
    assert [each.text.partition(":")[0] for each in more] == ["the sensor lies upside down"] * (up < 0.0)


@pytest.mark.parametrize(("moved_m", "stops"), [(0.0, 1), (0.02, 2)])
def test_a_stop_that_taps_interrupt_counts_once(
    scripted: tuple[Feedback, Scripted], moved_m: float, stops: int
) -> None:
    feedback, _ = scripted
    said(scripted, 1.2, begun(0, 0.0))
    said(scripted, 3.1, StopEnded(0, 3.0, keyframe(0.0)))
    said(scripted, 3.6, StopBegan(1, 3.4, 3.6, keyframe(moved_m)))
    assert feedback.stops == 2
    feedback.mark_grip(3.1)
    assert feedback.stops == stops


@pytest.mark.parametrize(
    "after",
    [replace(begun(1, 0.0), t=4.2, continues=True), replace(begun(1, 0.0), t=5.0)],
    ids=["stop 1 goes on", "stop 2 was none, and stop 1 gives way"],
)
def test_a_grip_counts_in_the_moves_to_the_stops_that_there_are(
    scripted: tuple[Feedback, Scripted], after: StopBegan
) -> None:
    """Between stops 0 and 1 the taps are; a move of 3 s that comes later is none of theirs."""
    feedback, _ = scripted
    feedback.mark_grip(3.1)
    for index, t in ((0, 1.0), (1, 3.4)) if after.continues else ((0, 1.0), (1, 2.0), (2, 3.4)):
        said(scripted, t, replace(begun(index, 0.0), t=t))
        said(scripted, t + 0.1, StopEnded(index, 3.0 if t < 3.0 else 4.0, keyframe(0.0)))
    assert feedback.stops == (1 if after.continues else 2)
    said(scripted, 5.0, after)
    assert feedback.stops == (1 if after.continues else 2)


def heard(recording: Recording, errors: SensorErrors | None) -> tuple[Feedback, list[str]]:
    """What is told of a recording, without its figures."""
    feedback = Feedback(0.01, errors, "wt901")
    for t, acc, gyr in zip(recording.t.tolist(), recording.acc, not_none(recording.gyr), strict=True):
        feedback.feed(t, Sample(acc=tuple(acc), gyr=tuple(gyr)))
    return feedback, [message.text.partition(":")[0] for message in feedback.take_messages()]


def test_a_calibrated_sensor_may_move_for_longer() -> None:
    """Its errors are those that the calibration leaves, as in `pbd.track`: not those of its class."""
    task = Task("slow", (Waypoint(rest_s=2.0), Waypoint((0.3, 0.0, 0.0), move_s=4.5, rest_s=1.0)))
    recording = simulate(task, "modern").recording
    known = LinearErrors(np.zeros(3), np.eye(3), np.full(3, 0.01), 1e-3)
    told = [heard(recording, errors)[1] for errors in (None, SensorErrors("wt901", known, known))]
    assert [lines.count("pause now") for lines in told] == [1, 0]


def test_readings_show_clipping_and_steps_whatever_a_calibration_makes_of_them() -> None:
    """A matrix mixes the axes: corrected values neither repeat a largest one, nor have a step."""
    recording = simulate("pick-and-place-stops", "wt901").recording
    clipped = replace(recording, gyr=np.clip(not_none(recording.gyr), -10.0, 10.0))
    mixes = LinearErrors(np.zeros(3), np.eye(3) + 0.01, np.full(3, 0.01), 1e-3)
    plain, calibrated = (heard(clipped, errors) for errors in (None, SensorErrors("wt901", mixes, mixes)))
    assert "the gyro was at the end of its range; move slower, or set a larger range" in plain[1]
    assert "the gyro was at the end of its range; move slower, or set a larger range" in calibrated[1]
    assert calibrated[0].tracker._steps == plain[0].tracker._steps


def test_averages_of_fast_samples_are_evenly_spaced() -> None:
    """By rounding, some blocks had one sample more: the time stamps seemed to come in steps."""
    task = Task("still", (Waypoint(rest_s=2.0),))
    assert heard(simulate(task, rate_hz=250.0).recording, None)[1] == ["the rest at the start is found"]
