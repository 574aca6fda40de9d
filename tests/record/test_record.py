"""Recording through a real pseudo-terminal and pyserial: what is lost, what is told, how it ends."""

import os
import re
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from pbd.data import Recording
from pbd.errors import RecordingError, SensorError
from pbd.files.demo import read_demo, write_demo
from pbd.record import Command, RecordOptions, Status, record, sensor_connection
from pbd.record.person_messages import Feedback
from pbd.record.session import Session
from pbd.sensors.port import Port, open_port
from pbd.sensors.protocols import protocol
from pbd.sensors.reader import Reader
from pbd.simulation.emulator import Emulator
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from tests.record.emulated_sensors import SPEAKERS, Device, random_hand
from tests.record.watched_recording import Watched, options, recorded
from tests.sensors.encoders import vectornav, witmotion, ximu3


def test_a_sensor_without_a_clock_that_slows_down_keeps_its_times_and_its_usual_rate(tmp_path: Path) -> None:
    """At its mean rate `pbd` would warn that the time stamps may be wrong."""
    steps = np.where(np.arange(1500) < 600, 0.01, 0.0125)
    true, rng = np.cumsum(steps), np.random.default_rng(1)
    session = Session(protocol("witmotion").decoder(), replace(options(tmp_path / "tea"), sensor="witmotion"))
    for at in true.tolist():
        words = rng.integers(-3, 3, 3).tolist(), rng.integers(-1, 2, 3).tolist()
        data = witmotion.packet(0x51, (*words[0][:2], 2048)) + witmotion.packet(0x52, words[1])
        session.take(data + witmotion.packet(0x53, (0, 0, 0)), at + rng.uniform(0.0, 0.002))
        session.flush()
    session.close()
    recording = read_demo(tmp_path / "tea").recording
    assert recording.info.rate_hz == pytest.approx(80.0, abs=0.5) == recording.rate_hz
    assert recording.t == pytest.approx(true[-len(recording) :] - true[-len(recording)], abs=0.03)


def test_one_long_burst_does_not_begin_a_recording(tmp_path: Path) -> None:
    """Its samples seemed to be taken at once."""
    session = Session(protocol("witmotion").decoder(), replace(options(tmp_path / "tea"), sensor="witmotion"))
    connection = sensor_connection.SensorConnection(session, cast(Reader, SimpleNamespace(port=None, opened=0.0)))
    session.take(100 * (witmotion.packet(0x51, (0, 0, 2048)) + witmotion.packet(0x52, (0, 0, 0))), 2.0)
    assert not connection.may_begin(None)
    assert connection.may_begin(SensorError("unplugged"))


@pytest.mark.parametrize("name", ["ximu3-binary", "witmotion"])  # with a clock, and without
def test_a_grip_has_the_time_of_the_key_however_late_the_samples_come(tmp_path: Path, name: str) -> None:
    """In bursts of 1 s. It had the time of the latest sample, which may be in the stop before."""
    hand, speaker = random_hand(800, seed=1), SPEAKERS[name]
    session = Session(speaker.decoder(), replace(options(tmp_path / "tea"), sensor=speaker.sensor))
    for row in range(len(hand)):
        session.take(speaker.encode(hand, row), row // 100 + 51.0)
        if row == 699:
            session.toggle_grip(57.8)
    session.close()
    assert [event.t for event in read_demo(tmp_path / "tea").recording.grip] == pytest.approx([7.8], abs=0.02)


def test_what_can_be_replayed_has_not_failed_whatever_was_seen_live(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Feedback, "stops", 0)
    hand, speaker = simulate("pick-and-place-direct").recording, SPEAKERS["ximu3-binary"]
    session = Session(speaker.decoder(), options(tmp_path / "tea"))
    for row, at in enumerate(hand.t.tolist()):
        session.take(speaker.encode(hand, row), at)
    session.close()
    assert session.outcome("").why_failed == ""


WHILE_IT_RECORDS = """
import sys, time
from pathlib import Path
from pbd.record import RecordOptions, record
from pbd.sensors.protocols import protocol
from tests.sensors.encoders.witmotion import packet

class Source:
    device, baud, patience_s, trouble, rows, loaded = "a sensor", 0, None, "", 0, set(sys.modules)

    def read(self):
        self.loaded = self.loaded if self.rows else set(sys.modules)
        self.rows += 1
        time.sleep(0.01)
        return packet(0x51, (0, self.rows % 3, 2048)) + packet(0x52, (0, 0, 0)) + packet(0x53, (0, 0, 0))

    def close(self):
        print(*sorted({name.split(".")[0] for name in sys.modules.keys() - self.loaded}))

options = RecordOptions(Path(sys.argv[1]), "witmotion", "2026-01-02T03:04:05Z", duration_s=2.4)
record(Source, protocol("witmotion").decoder(), options, lambda: None, lambda status: None)
"""


def test_no_package_is_loaded_while_samples_come(tmp_path: Path) -> None:
    """From a slow disk that takes seconds, and pbd took them for a suspended program."""
    command = [sys.executable, "-c", WHILE_IT_RECORDS, str(tmp_path / "demo")]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy", "matplotlib", "pinocchio", "rich"} & set(loaded)
    assert (tmp_path / "demo/demo.toml").exists()


@pytest.fixture(scope="module")
def pouring() -> Recording:
    return simulate("pour", "modern", 1).recording


@pytest.fixture(scope="module")
def hurried() -> Recording:
    """To one place and no further."""
    way = (Waypoint(rest_s=1.3), Waypoint((0.2, 0.0, 0.1), move_s=0.7, rest_s=6.0))
    return simulate(Task("hurried", way), "modern", 1).recording


def test_every_sample_arrives_as_it_was_sent(tmp_path: Path, hurried: Recording) -> None:
    person = Watched({1.3: Command.GRIP, 1.8: Command.GRIP})
    wanted = options(tmp_path / "tea", duration_s=2.8, raw=True, tolerance_m=0.0005)
    outcome = recorded(hurried, person, wanted)
    got = read_demo(tmp_path / "tea").recording
    assert outcome.ended_by == "2.8 s recorded"
    assert len(got) == outcome.samples >= 280
    assert outcome.lost == 0
    missed = next(
        k for k in range(len(hurried) - len(got)) if np.allclose(got.acc[:5], hurried.acc[k : k + 5], atol=1e-5)
    )  # before it opened
    sent = slice(missed, missed + len(got))
    assert got.t == pytest.approx(np.arange(len(got)) / hurried.rate_hz, abs=1e-5)
    assert got.acc == pytest.approx(hurried.acc[sent], abs=1e-5)
    assert got.gyr == pytest.approx(hurried.gyr[sent], abs=1e-6)  # type: ignore[index]
    assert got.mag == pytest.approx(hurried.mag[sent], abs=1e-3)  # type: ignore[index]
    assert [event.closed for event in got.grip] == [True, False]
    for event, shown in zip(got.grip, person.acted, strict=True):
        assert person.shown[shown - 1].t - 0.05 <= event.t <= person.shown[shown].t + 0.05
    assert got.info.clock == "device"
    assert person.said[0] == "the rest at the start is found: you may move"
    assert [status.ended for status in person.shown[-3:]] == [False, True, False]  # before the final tracking
    # a long move is told once, before it is over
    told = [text.partition(":")[0][:9] for text in person.said if text.startswith(("pause now: ", "stop 1 at ("))]
    assert told[:2] == ["pause now", "stop 1 at"]
    assert (tmp_path / "tea" / "raw.bin").stat().st_size > 270 * 40


def test_a_forced_recording_without_a_rest_does_not_take_the_old_ones_place(tmp_path: Path, pouring: Recording) -> None:
    """It ends before a second of rest has come; what came is not lost."""
    tea = tmp_path / "tea"
    recorded(pouring, Watched(), options(tea, duration_s=0.3))
    (tea / "notes.txt").write_text("the old one")
    (tmp_path / "tea.new").mkdir()
    outcome = recorded(pouring, Watched(), options(tea, duration_s=0.4, force=True))
    assert outcome.folder == tmp_path / "tea.new-2"
    assert outcome.backup_note == f"no rest was found in it, so it is kept in {outcome.folder}; the old {tea} is back"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tea", "tea.new", "tea.new-2"]
    assert (tea / "notes.txt").exists()
    assert len(read_demo(outcome.folder).recording) == outcome.samples


@pytest.mark.parametrize(
    ("duration_s", "freezes", "why"),
    [(1.2, False, "fewer than two stops"), (2.8, False, ""), (4.4, True, "ms of data are frozen")],
)
def test_a_forced_recording_that_cannot_be_replayed_does_not_cost_the_old_one(
    tmp_path: Path, hurried: Recording, duration_s: float, freezes: bool, why: str
) -> None:
    """It ends before the hand has moved; after it has stopped somewhere; or after its samples froze there."""
    tea, kept = tmp_path / "tea", bool(why)
    write_demo(simulate("pour"), tea)
    if freezes:
        row = int(np.searchsorted(hurried.t, 2.8))
        held = {name: getattr(hurried, name).copy() for name in ("acc", "gyr", "mag")}
        for values in held.values():
            values[row:] = values[row]
        hurried = replace(hurried, **held)
    outcome = recorded(hurried, Watched(), options(tea, duration_s=duration_s, force=True))
    assert (outcome.stops < 2) is (kept and not freezes)
    assert why in outcome.why_failed
    assert outcome.folder == tea
    assert len(read_demo(tea).recording) == outcome.samples
    assert (f"the old one is kept in {tea}.before" in outcome.backup_note) is kept
    assert read_demo(tea).failed is kept
    assert (tmp_path / "tea.before" / "truth.csv").exists() is kept


def test_a_forced_recording_that_never_begins_leaves_the_old_one(
    tmp_path: Path, silent: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packets come, but none with an acceleration."""
    monkeypatch.setattr(sensor_connection, "SILENT_S", 10.0)
    write_demo(simulate("pour"), tmp_path / "tea")
    wanted, decoder = replace(options(tmp_path / "tea", force=True), sensor="os5000"), SPEAKERS["os5000"].decoder()

    def poll() -> Command | None:
        os.write(silent[0], b"$C320.5P0.2R-18.3T19.0*3C\r\n")
        return Command.END if decoder.tally.packets else None

    with pytest.raises(SensorError, match="ended before the first sample came"):
        record(lambda: open_port(silent[1], 9600), decoder, wanted, poll, lambda status: None)
    assert [path.name for path in tmp_path.iterdir()] == ["tea"]


def test_a_sensor_that_comes_back_is_waited_for(tmp_path: Path, pouring: Recording) -> None:
    """As a new device under the old name: here a link that is turned to another pseudo-terminal."""
    port, person = tmp_path / "port", Watched({1.7: Command.END})
    with Emulator(pouring) as first, Emulator(pouring) as second:
        port.symlink_to(first.device)

        def change() -> None:
            while not person.shown or person.shown[-1].t < 0.7:
                time.sleep(0.01)
            first.unplug()
            port.unlink()
            time.sleep(0.3)
            port.symlink_to(second.device)

        threading.Thread(target=change, daemon=True).start()
        outcome = record(
            lambda: open_port(str(port), 115200),
            protocol("ximu3").decoder(),
            options(tmp_path / "tea", reconnect=True),
            person.poll,
            person.shown.append,
        )
    assert outcome.ended_by == "stopped by you"
    assert "the sensor is back" in person.said
    t = read_demo(tmp_path / "tea").recording.t
    assert (np.diff(t) > 0.0).all()
    assert np.diff(t).max() > 0.25  # the gap stays a gap


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, str]]:
    """A pseudo-terminal whose other end is ours; little patience."""
    monkeypatch.setattr(sensor_connection, "SILENT_S", 0.2)
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_silence_is_told(tmp_path: Path, silent: tuple[int, str]) -> None:
    person = Watched()
    with pytest.raises(
        SensorError, match=r"is silent at 9600 baud: nothing came in 0\.2 s; check that the sensor is on"
    ):
        record(
            lambda: open_port(silent[1], 9600),
            protocol("witmotion").decoder(),
            options(tmp_path / "tea"),
            person.poll,
            person.shown.append,
        )
    assert not (tmp_path / "tea").exists()


OS5000 = SPEAKERS["os5000"].encode(random_hand(1, seed=1), 0)
HEARD = [
    (
        "witmotion",
        b"\xf0\x0f garbage ",
        r"\d+ bytes came from .* at 9600 baud, but no whole packet of witmotion: 9600 baud is wrong, or it is another "
        r"kind of sensor: look with `pbd sensors --probe --port /dev/pts/\d+`$",
    ),
    (
        "witmotion",
        ximu3.text("I", 1_000_000, [0.0] * 5 + [1.0]),
        "of witmotion: they are ximu3's: give --sensor ximu3$",
    ),
    (
        "witmotion",
        b"0.01,0.02,0.98\r\n",
        r"they are lines such as '0.01,0.02,0.98' .3 numbers.: give --sensor lines --columns",
    ),
    (
        "os5000",
        vectornav.ymr([0.0] * 3, [0.0] * 3, [0.0, 0.0, -9.8], [0.0] * 3),
        "of os5000: they are vectornav's: give --sensor vectornav$",
    ),
    (
        "lines",
        b"0.01,0.02,0.98\r\n",
        "no whole packet of lines: a line is '0.01,0.02,0.98' .3 numbers.: it has 3 columns, not 7; correct ",
    ),
    (
        "lines",
        b"9,1\t2\t3\t4\t5\t6\r\n",
        r"'9,1.t2.t3.t4.t5.t6' .7 numbers.: it has 2 columns, not 7; correct --columns",
    ),
    (
        "os5000",
        OS5000 + 2 * OS5000.replace(b"*", b"0*"),  # a sample now and then comes by chance
        r"but \d+ whole packets of os5000: ",
    ),
    ("lines", b"9,x,2,3,4,5,6\r\n", "a column that --columns names is no number; correct --columns, --separator"),
    ("lines", b"9,0,0,81920000,4,5,6\r\n", "its acc is too large .raw counts..; give --unit acc=..., or correct"),
    ("lines", b"9,0,0,9.8,4,5,6\r\n9,0,0,9.8,4,5,7\r\n", "have all the same time: correct --columns, or the device's"),
    (
        "os5000",
        b"$C320.5P0.2R-18.3T19.0*3C\r\n",
        "whole packets of os5000 come from .*, but none with an acceleration: switch that output on",
    ),
]


@pytest.mark.parametrize(("sensor", "piece", "message"), HEARD)
def test_bytes_that_make_no_recording_are_told(
    tmp_path: Path, silent: tuple[int, str], sensor: str, piece: bytes, message: str
) -> None:
    master, name = silent
    decoder, wanted = SPEAKERS[sensor].decoder(), RecordOptions(tmp_path / "tea", sensor, "2026-01-02T03:04:05Z", 1.0)

    def speak() -> None:
        """As often as the person is asked."""
        os.write(master, piece)

    def opened() -> Port:
        port = open_port(name, 9600)
        for _ in range(4):
            speak()
        return port

    with pytest.raises(SensorError, match=message):
        record(opened, decoder, wanted, speak, lambda status: None)
    assert not (tmp_path / "tea").exists()


def test_broken_packets_and_times_that_leap_count_as_bad_packets(tmp_path: Path) -> None:
    session = Session(protocol("ximu3").decoder(), options(tmp_path / "tea"))
    for k in range(100):
        session.take(ximu3.text("I", 10_000 * k + 5_000_000 * (k == 50), [0.0] * 5 + [1.0]), 0.01 * k)
    session.take(b"I,broken\r\n", 1.0)
    session.discard()
    session.close()
    assert session.bad_packets == 2


def test_a_sensor_that_sends_once_in_a_while_is_too_slow(tmp_path: Path, silent: tuple[int, str]) -> None:
    wanted = RecordOptions(tmp_path / "tea", "lines", "2026-01-02T03:04:05Z")

    def opened() -> Port:
        port = open_port(silent[1], 9600)
        os.write(silent[0], b"\n9,0,0,9.8,4,5,6\n")
        return port

    with pytest.raises(SensorError, match=r"sends too slowly \(1 in 0\.2 s\): raise the rate of the device"):
        record(opened, SPEAKERS["lines"].decoder(), wanted, lambda: None, lambda status: None)


def test_what_is_discarded_before_the_first_sample_leaves_nothing(tmp_path: Path, silent: tuple[int, str]) -> None:
    commands = iter((Command.GRIP, Command.DISCARD))
    wanted, shown = options(tmp_path / "tea"), list[Status]()
    outcome = record(
        lambda: open_port(silent[1], 9600),
        protocol("witmotion").decoder(),
        wanted,
        lambda: next(commands, None),
        shown.append,
    )
    assert (outcome.folder, outcome.samples, shown) == (None, 0, [])
    assert not (tmp_path / "tea").exists()


@pytest.mark.parametrize("command", [Command.END, Command.DISCARD])
def test_a_person_is_heard_while_an_unplugged_sensor_is_waited_for(
    tmp_path: Path, pouring: Recording, command: Command
) -> None:
    person, commands = Watched(), iter((Command.GRIP, command))
    with Emulator(pouring) as sensor:
        threading.Timer(0.6, sensor.unplug).start()

        def poll() -> Command | None:
            return next(commands) if f"sensor unplugged; waiting for {sensor.device}" in person.said else None

        outcome = record(
            lambda: open_port(sensor.device, 115200),
            protocol("ximu3").decoder(),
            options(tmp_path / "tea", reconnect=True),
            poll,
            person.shown.append,
        )
    assert outcome.ended_by == "stopped by you"
    assert outcome.folder == (tmp_path / "tea" if command is Command.END else None)
    assert (tmp_path / "tea").exists() == (command is Command.END)
    assert "grip closed" in person.said


def test_a_sensor_that_stays_away_ends_the_recording_and_meanwhile_is_not_said_to_move(
    tmp_path: Path, pouring: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a longer gap nothing could be tracked, and the page said "moving" for as long as it lasted."""
    monkeypatch.setattr(sensor_connection, "CLOCK_JUMP_S", 0.5)
    person = Watched()
    with Emulator(pouring) as sensor:
        threading.Timer(0.6, sensor.unplug).start()
        outcome = record(
            lambda: open_port(sensor.device, 115200),
            protocol("ximu3").decoder(),
            options(tmp_path / "tea", reconnect=True),
            person.poll,
            person.shown.append,
        )
    assert outcome.ended_by == "no sample for 0.5 s"
    assert f"waiting for {sensor.device}" in [status.waiting for status in person.shown]


def test_a_moment_is_recorded_too(tmp_path: Path, pouring: Recording) -> None:
    outcome = recorded(pouring, Watched(), options(tmp_path / "tea", duration_s=0.1))
    got = read_demo(tmp_path / "tea").recording
    assert len(got) == outcome.samples
    assert 0.1 <= got.t[-1] < 0.25


def test_a_plug_pulled_at_once_keeps_what_came(tmp_path: Path) -> None:
    hand = random_hand(60, seed=1)
    with Device([SPEAKERS["xsens"].encode(hand, row) for row in range(20)], 200.0) as device:

        def opened() -> Port:
            port = open_port(device.device, 115200)
            device.go()
            return port

        wanted, decoder = RecordOptions(tmp_path / "tea", "xsens", "2026-01-02T03:04:05Z"), SPEAKERS["xsens"].decoder()
        outcome = record(opened, decoder, wanted, device.pull_once_heard, lambda status: None)
    assert outcome.ended_by == "sensor unplugged"
    assert read_demo(tmp_path / "tea").recording.acc == pytest.approx(hand.acc[:20], abs=1e-5)


@pytest.mark.parametrize("force", [False, True])
def test_a_full_disk_ends_it_and_leaves_what_was_written(
    tmp_path: Path, pouring: Recording, monkeypatch: pytest.MonkeyPatch, force: bool
) -> None:
    """From 8 kB on nothing can be written any more, neither rows nor what is written at the end."""
    written = [0]

    def full(handle: int, data: bytes) -> int:
        if written[0] > 8_000:
            raise OSError(28, "No space left on device")
        written[0] += len(data)
        return os.write(handle, data)

    def no_file(path: Path, *given: object, **named: object) -> int:
        raise OSError(28, "No space left on device")

    def show(status: Status) -> None:
        monkeypatch.setattr("pbd.files.recording_writer.os", SimpleNamespace(**{**vars(os), "write": full}))
        monkeypatch.setattr(Path, "write_text", no_file)

    if force:
        write_demo(simulate("pour"), tmp_path / "tea")
    wanted, decoder = options(tmp_path / "tea", force=force), protocol("ximu3").decoder()
    where = f"; the demonstration before it is in {tmp_path / 'tea.before'}" if force else ""
    told = rf"No space left .*; give another place; intact so far: \d+ samples{re.escape(where)}$"
    with Emulator(pouring) as sensor, pytest.raises(RecordingError, match=told):
        record(lambda: open_port(sensor.device, 115200), decoder, wanted, lambda: None, show)
    monkeypatch.undo()
    assert not force or read_demo(tmp_path / "tea.before").truth is not None
    got = read_demo(tmp_path / "tea").recording
    assert len(got) > 50
    assert got.t == pytest.approx(np.arange(len(got)) / 100.0, abs=1e-5)
