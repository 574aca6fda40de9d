"""The simulated hand: its own commands, and those of the person beside it."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from pbd.cli.recording.simulated import SimulatedHand, simulated_hand
from pbd.data import GRAVITY, Demonstration, GripEvent, Recording
from pbd.errors import SensorError, UsageError
from pbd.record import Command, Status
from pbd.sensors.decoding import Sample
from pbd.sensors.port import open_port
from pbd.sensors.protocols import protocol
from pbd.simulation.emulator import Emulator
from pbd.tracking.repair.splices import refuse_doubled
from tests.cli.test_recording_screen import STILL
from tests.record.emulated_sensors import random_hand

OPEN = replace(STILL, closed=False, messages=())
HAND = random_hand(400, seed=1)


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    """An emulator that never plays: the test sets how many samples it has sent."""
    sensor = Emulator(HAND)
    yield sensor
    sensor.unplug()


def nobody() -> Command | None:
    return None


def test_it_grips_when_the_task_does_and_not_before_anything_is_on_disk(emulator: Emulator) -> None:
    hand = SimulatedHand(emulator, (GripEvent(1.0, True), GripEvent(2.0, False)))
    poll, show = hand.combine(nobody, lambda status: None, True, None)
    emulator.sent = 120
    assert poll() is None
    show(OPEN)
    assert poll() is Command.GRIP
    assert poll() is None
    show(replace(OPEN, closed=True))
    emulator.sent = 199
    assert poll() is None
    emulator.sent = 200
    assert poll() is Command.GRIP


def test_a_person_who_gripped_already_is_not_undone(emulator: Emulator) -> None:
    hand = SimulatedHand(emulator, (GripEvent(1.0, True),))
    poll, show = hand.combine(nobody, lambda status: None, True, None)
    show(replace(OPEN, closed=True))
    emulator.sent = 120
    assert poll() is None
    show(OPEN)
    assert poll() is None


def test_a_person_comes_first(emulator: Emulator) -> None:
    hand = SimulatedHand(emulator, (GripEvent(1.0, True),))
    poll, show = hand.combine(lambda: Command.DISCARD, lambda status: None, True, None)
    show(OPEN)
    emulator.sent = 400
    assert poll() is Command.DISCARD


@pytest.mark.parametrize(
    ("terminal", "duration_s", "then"),
    [
        (True, None, "Enter ends the recording"),
        (True, 9.0, "Enter ends the recording"),
        (False, None, "it ends here"),
        (False, 9.0, "it goes on to 9 s"),
    ],
)
def test_the_end_of_the_task_is_told_once_and_ends_it_where_nobody_could(
    emulator: Emulator, terminal: bool, duration_s: float | None, then: str
) -> None:
    shown: list[Status] = []
    hand = SimulatedHand(emulator, ())
    poll, show = hand.combine(nobody, shown.append, terminal, duration_s)
    emulator.sent = 399
    show(OPEN)
    assert poll() is None
    emulator.sent = 400
    show(OPEN)
    show(OPEN)
    said = [[say.text for say in status.messages] for status in shown]
    assert said == [[], [f"the simulated task is finished: {then}"], []]
    ends = then == "it ends here"
    assert poll() is (Command.FINISH if ends else None)


def test_it_begins_when_its_port_is_opened_and_is_unplugged_at_the_end() -> None:
    with ExitStack() as stack:
        hand = simulated_hand("", stack)
        decoder, samples = hand.decoder(), 0
        with hand.open() as port:
            while not samples:
                samples += len(decoder.feed(port.read()))
    with pytest.raises(SensorError):
        hand.open()


def test_it_is_the_same_device_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int | None] = []

    def simulate(task: str, sensor: str, seed: int, device: int | None = None) -> Demonstration:
        made.append(device)
        return Demonstration(HAND)

    monkeypatch.setattr("pbd.cli.recording.simulated.simulate", simulate)
    for task in ("pour", "sides"):
        with ExitStack() as stack:
            simulated_hand(task, stack)
    assert made == [0, 0]


def test_a_task_of_no_name() -> None:
    with ExitStack() as stack, pytest.raises(UsageError, match="no task is called 'juggle'"):
        simulated_hand("juggle", stack)


@pytest.mark.parametrize(("sent", "over"), [(0, False), (2, False), (3, True), (4, True)])
def test_it_is_over_with_its_last_sample(sent: int, over: bool) -> None:
    emulator = Emulator(Recording(HAND.t[:3], HAND.acc[:3]))
    emulator.sent = sent
    emulator.unplug()
    assert emulator.over == over


def test_what_was_unplugged_does_not_play(emulator: Emulator) -> None:
    emulator.unplug()
    emulator.play()
    emulator.unplug()
    assert emulator.sent == 0


def test_it_plays_once_and_is_unplugged_where_its_block_ends() -> None:
    with Emulator(HAND) as sensor:
        sensor.play()
    assert "emulated sensor" not in {thread.name for thread in threading.enumerate()}


def test_its_rest_after_the_task_can_be_tracked() -> None:
    """Samples repeated in the same order would be refused as a duplicated block."""
    rng = np.random.default_rng(0)
    noise = rng.normal((0.0, 0.0, GRAVITY), 0.02, (60, 3)), rng.normal(0.0, 0.001, (60, 3))
    decoder, samples = protocol("ximu3").decoder(), list[Sample]()
    sensor = Emulator(Recording(HAND.t[:60], *noise))
    with sensor, open_port(sensor.device, 115200) as port:
        while len(samples) < 180:
            samples += decoder.feed(port.read())
    acc, gyr = (np.array([getattr(sample, name) for sample in samples]) for name in ("acc", "gyr"))
    refuse_doubled(Recording(np.arange(len(acc)) / HAND.rate_hz, acc, gyr))
