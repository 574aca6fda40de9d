"""Recordings that fail: nothing is lost, and what became of it is said."""

import os
import re
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from pbd.data import Recording
from pbd.errors import PbdError
from pbd.files.demo import read_demo, write_demo
from pbd.record import Command, RecordOptions, Status, record, sensor_connection
from pbd.record.sensor_connection import SensorConnection
from pbd.record.session import Session
from pbd.sensors.decoding import Decoder, Sample
from pbd.sensors.port import Port, open_port
from pbd.sensors.protocols import protocol
from pbd.sensors.reader import Reader
from pbd.simulation.emulator import Emulator
from pbd.simulation.simulate import simulate
from tests.record.emulated_sensors import ROUNDS, SPEAKERS, Device, random_hand
from tests.record.watched_recording import Watched, options, recorded
from tests.system_failures import no_space
from tests.test_timestamps import arrivals


@pytest.fixture(scope="module")
def pouring() -> Recording:
    return simulate("pour", "modern", 1).recording


def opened(device: Device) -> Port:
    """Its port; it begins to send."""
    port = open_port(device.device, 115200)
    device.go()
    return port


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("what", ["demo.toml", "the first rows"])
def test_a_disk_that_is_full_from_the_start_costs_nothing(
    tmp_path: Path, pouring: Recording, monkeypatch: pytest.MonkeyPatch, force: bool, what: str
) -> None:
    tea = tmp_path / "tea"
    if force:
        write_demo(simulate("pour"), tea)
    kept = sorted(path.name for path in tmp_path.rglob("*"))

    monkeypatch.setattr("pbd.files.recording_writer.os", SimpleNamespace(**{**vars(os), "write": no_space}))
    if what == "demo.toml":
        monkeypatch.setattr(Path, "write_text", no_space)
    told = r"tea.* can't be written \(No space left on device\); give another place"
    with pytest.raises(PbdError, match=told) as caught:
        recorded(pouring, Watched(), options(tea, force=force))
    monkeypatch.undo()
    assert caught.value.message.endswith(f"; the old {tea} is back") is force
    assert sorted(path.name for path in tmp_path.rglob("*")) == kept
    assert not force or read_demo(tea).truth is not None


def test_a_full_disk_at_a_grip_tells_where_the_old_one_is(
    tmp_path: Path, pouring: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_demo(simulate("pour"), tmp_path / "tea")

    def show(status: Status) -> None:
        person.shown.append(status)
        monkeypatch.setattr(Path, "write_text", no_space)

    person = Watched({0.3: Command.GRIP})
    decoder, wanted = protocol("ximu3").decoder(), options(tmp_path / "tea", force=True, duration_s=2.0)
    where = f"; the demonstration before it is in {tmp_path / 'tea.before'}"

    with Emulator(pouring) as sensor, pytest.raises(PbdError, match=re.escape(where)):
        record(lambda: open_port(sensor.device, 115200), decoder, wanted, person.poll, show)
    monkeypatch.undo()
    assert read_demo(tmp_path / "tea.before").truth is not None
    assert len(read_demo(tmp_path / "tea").recording) > 20


def test_what_came_before_a_silence_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of a second of it: too short to have begun."""
    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.8)
    hand, speaker = random_hand(60, seed=1), SPEAKERS["xsens"]
    with Device([speaker.encode(hand, row) for row in range(10)], 100.0) as device:
        wanted = RecordOptions(tmp_path / "tea", "xsens", "2026-01-02T03:04:05Z")
        outcome = record(lambda: opened(device), speaker.decoder(), wanted, lambda: None, lambda status: None)
    assert outcome.ended_by == "sensor silent for 0.8 s"
    assert read_demo(tmp_path / "tea").recording.acc == pytest.approx(hand.acc[:10], abs=1e-5)


def test_bytes_that_are_no_samples_any_more_end_the_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They went on for ever, as of a sensor whose baud rate changed, and nobody was told."""
    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.8)
    hand, speaker = random_hand(100, seed=1), SPEAKERS["xsens"]
    packets = [speaker.encode(hand, row) for row in range(100)]
    with Device([*packets, *[b"\xf0\x0f"] * 1000], 100.0) as device:
        wanted = RecordOptions(tmp_path / "tea", "xsens", "2026-01-02T03:04:05Z")
        outcome = record(lambda: opened(device), speaker.decoder(), wanted, lambda: None, lambda status: None)
    assert outcome.ended_by.startswith("no sample of xsens in the bytes of 0.8 s")
    assert outcome.samples == len(read_demo(tmp_path / "tea").recording) == 100


def test_what_came_before_a_bug_is_kept(tmp_path: Path) -> None:
    hand, speaker = random_hand(60, seed=1), SPEAKERS["xsens"]
    with Device([speaker.encode(hand, row) for row in range(10)], 100.0) as device:
        asked = iter(range(ROUNDS))

        def poll() -> Command | None:
            if next(asked) == ROUNDS - 1:
                raise ZeroDivisionError
            return None

        wanted = RecordOptions(tmp_path / "tea", "xsens", "2026-01-02T03:04:05Z")
        with pytest.raises(ZeroDivisionError):
            record(lambda: opened(device), speaker.decoder(), wanted, poll, lambda status: None)
    got = read_demo(tmp_path / "tea").recording
    assert len(got) > 2
    assert got.acc == pytest.approx(hand.acc[: len(got)], abs=1e-5)


def test_flaws_of_the_sensor_are_told_while_it_records(tmp_path: Path) -> None:
    hand, speaker = random_hand(1, seed=1), SPEAKERS["razor"]
    session = Session(speaker.decoder(), RecordOptions(tmp_path / "tea", "razor", "2026-01-02T03:04:05Z"))
    for k in range(300):
        session.take(speaker.encode(hand, 0), 0.01 * k)
        session.flush()
    session.close()
    (told,) = (say for say in session.status().messages if "all samples are the same so far" in say.text)
    assert told.bell


class Slow:
    """A decoder on a machine that is too slow for its sensor, but for a moment only."""

    def __init__(self, decoder: Decoder) -> None:
        self._decoder, self.tally, self._slow = decoder, decoder.tally, 4

    def feed(self, data: bytes) -> list[Sample]:
        if not self._slow:
            return self._decoder.feed(data)
        self._slow -= 1
        time.sleep(0.3)
        return self._decoder.feed(data[:200])


def test_the_time_that_the_machine_slept_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Linux' monotonic clock stands still in that time: samples of it were lost, and none of it was seen."""
    session = Session(SPEAKERS["razor"].decoder(), RecordOptions(tmp_path / "tea", "razor", "2026-01-02T03:04:05Z"))
    port = SimpleNamespace(device="", trouble="")
    connection = SensorConnection(session, cast(Reader, SimpleNamespace(port=port, latest=0.0, opened=0.0)))
    slept = time.clock_gettime(time.CLOCK_BOOTTIME) + 60.0
    monkeypatch.setattr(time, "clock_gettime", lambda clock: slept if clock == time.CLOCK_BOOTTIME else 0.0)
    connection.check([])
    (said,) = session.status().messages
    assert said.text.startswith("this program did not run for 60.")


def test_a_sensor_that_sends_faster_than_the_machine_takes_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """20 kHz: a tenth of a second of samples takes longer than patience lasts."""
    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.8)
    monkeypatch.setattr(sensor_connection, "MAX_BACKLOG_S", 0.25)
    monkeypatch.setattr(sensor_connection, "SUSPENDED_S", 60.0)  # the decoder sleeps instead of working
    hand, speaker = random_hand(400, seed=1, rate_hz=20_000.0), SPEAKERS["xsens"]
    with Device([b"".join(speaker.encode(hand, row) for row in range(400))], 100.0, again=True) as device:
        person = Watched()

        def poll() -> Command | None:
            return Command.END if len(person.shown) > 2 else None

        wanted = RecordOptions(tmp_path / "tea", "xsens", "2026-01-02T03:04:05Z")
        outcome = record(lambda: opened(device), Slow(speaker.decoder()), wanted, poll, person.shown.append)
    assert outcome.ended_by == "stopped by you"
    assert len(read_demo(tmp_path / "tea").recording) == outcome.samples > 10
    assert person.said.count("samples come faster than this machine takes them: lower the sensor's rate") == 1


@pytest.mark.parametrize("rate_hz", [40.0, 100.0, 400.0])
def test_what_is_shown_as_lost_on_the_way_is_what_is_told_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rate_hz: float
) -> None:
    """A sensor without a clock on a host that is busy now and then: late is not lost."""
    monkeypatch.setattr("pbd.timestamps.sample_clock.COUNT_EVERY_S", 0.0)
    monkeypatch.setattr("pbd.timestamps.sample_clock.COUNT_TIME_SHARE", np.inf)
    _, arrival, missing = arrivals(rate_hz, "bursts", seed=1, seconds=12.0)
    hand, speaker = random_hand(len(arrival), seed=1, rate_hz=rate_hz), SPEAKERS["razor"]
    session = Session(speaker.decoder(), RecordOptions(tmp_path / "tea", "razor", "2026-01-02T03:04:05Z"))
    shown = []
    for row, at in enumerate(arrival.tolist()):
        session.take(speaker.encode(hand, row), at)
        if row % round(0.1 * rate_hz) == 0:
            shown.append(session.status().lost)
    session.close()
    assert session.outcome("stopped by you").lost == missing == 0
    assert set(shown) == {0}


def test_samples_that_come_together_get_even_times_at_once(tmp_path: Path) -> None:
    """A wireless link delivers five samples every 50 ms. Their live times are on disk before the recording ends."""
    hand, speaker = random_hand(300, seed=1, rate_hz=100.0), SPEAKERS["razor"]
    session = Session(speaker.decoder(), RecordOptions(tmp_path / "tea", "razor", "2026-01-02T03:04:05Z"))
    for row in range(0, 300, 5):
        session.take(b"".join(speaker.encode(hand, row + k) for k in range(5)), 700.0 + 0.01 * row)
        session.flush()
    t = np.loadtxt(tmp_path / "tea" / "imu.csv", delimiter=",", skiprows=1, usecols=0)
    assert np.diff(t)[10:] == pytest.approx(0.01, rel=0.01)
    session.close()
