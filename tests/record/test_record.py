"""Recording through a real pseudo-terminal and pyserial: what is lost, what is told, how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pbd.data import Recording
from pbd.errors import SensorError
from pbd.files.demo import read_demo
from pbd.record import Command, Outcome, RecordOptions, Status, loop, record
from pbd.sensors.emulator import Emulator
from pbd.sensors.port import open_port
from pbd.sensors.protocols import protocol
from pbd.sensors.simulate import simulate

PBD = [sys.executable, "-m", "pbd"]


class Watched:
    """A person who acts at given times, and a screen that keeps what it was shown."""

    def __init__(self, acts: dict[float, Command] | None = None) -> None:
        self.acts = sorted((acts or {}).items())
        self.shown: list[Status] = []

    def poll(self) -> Command | None:
        if self.acts and self.shown and self.shown[-1].t >= self.acts[0][0]:
            return self.acts.pop(0)[1]
        return None

    @property
    def said(self) -> list[str]:
        return [say.text for status in self.shown for say in status.said]


def options(folder: Path, **given: object) -> RecordOptions:
    return RecordOptions(folder, "ximu3", "2026-01-02T03:04:05Z", **given)  # type: ignore[arg-type]


def recorded(recording: Recording, person: Watched, wanted: RecordOptions) -> Outcome:
    with Emulator(recording) as sensor:
        decoder = protocol("ximu3").decoder()
        return record(lambda: open_port(sensor.device, 115200), decoder, wanted, person.poll, person.shown.append)


@pytest.fixture(scope="module")
def pouring() -> Recording:
    return simulate("pour", "modern", 1).recording


def test_every_sample_arrives_as_it_was_sent(tmp_path: Path, pouring: Recording) -> None:
    person = Watched({1.5: Command.GRIP, 2.0: Command.GRIP})
    outcome = recorded(pouring, person, options(tmp_path / "tea", duration_s=4.2, raw=True))
    got = read_demo(tmp_path / "tea").recording
    assert outcome.ended_by == "the time of 4.2 s"
    assert len(got) == outcome.samples >= 420
    assert outcome.lost == 0
    missed = next(
        k for k in range(20) if np.allclose(got.acc[:5], pouring.acc[k : k + 5], atol=1e-5)
    )  # before it opened
    sent = slice(missed, missed + len(got))
    assert got.t == pytest.approx(np.arange(len(got)) / pouring.rate_hz, abs=1e-5)
    assert got.acc == pytest.approx(pouring.acc[sent], abs=1e-5)
    assert got.gyr == pytest.approx(pouring.gyr[sent], abs=1e-6)  # type: ignore[index]
    assert got.mag == pytest.approx(pouring.mag[sent], abs=1e-3)  # type: ignore[index]
    assert [event.closed for event in got.grip] == [True, False]
    assert got.grip[0].t == pytest.approx(1.5, abs=0.3)
    assert got.info.clock == "device"
    assert person.said[0] == "the rest at the start is found: you may move"
    assert any(text.startswith("stop 1 at (") for text in person.said)
    assert (tmp_path / "tea" / "raw.bin").stat().st_size > 400 * 40


def test_a_long_move_is_told_before_it_is_over(tmp_path: Path, pouring: Recording) -> None:
    person = Watched()
    recorded(pouring, person, options(tmp_path / "tea", duration_s=4.0, tolerance_m=0.0005))
    assert sum(text.startswith("pause now: ") for text in person.said) == 1


def test_discarding_leaves_nothing(tmp_path: Path, pouring: Recording) -> None:
    outcome = recorded(pouring, Watched({1.0: Command.DISCARD}), options(tmp_path / "tea"))
    assert outcome.folder is None
    assert not (tmp_path / "tea").exists()


def test_a_pulled_plug_ends_it_in_good_order(tmp_path: Path, pouring: Recording) -> None:
    person = Watched()
    with Emulator(pouring) as sensor:
        threading.Timer(2.0, sensor.unplug).start()
        outcome = record(
            lambda: open_port(sensor.device, 115200),
            protocol("ximu3").decoder(),
            options(tmp_path / "tea"),
            person.poll,
            person.shown.append,
        )
    assert outcome.ended_by == "the sensor was unplugged"
    assert len(read_demo(tmp_path / "tea").recording) == outcome.samples > 150


def test_a_sensor_that_comes_back_is_waited_for(tmp_path: Path, pouring: Recording) -> None:
    """As a new device under the old name: here a link that is turned to another pseudo-terminal."""
    port, person = tmp_path / "port", Watched({2.5: Command.END})
    with Emulator(pouring) as first, Emulator(pouring) as second:
        port.symlink_to(first.device)

        def change() -> None:
            first.unplug()
            port.unlink()
            time.sleep(0.3)
            port.symlink_to(second.device)

        threading.Timer(1.5, change).start()
        outcome = record(
            lambda: open_port(str(port), 115200),
            protocol("ximu3").decoder(),
            options(tmp_path / "tea", reconnect=True),
            person.poll,
            person.shown.append,
        )
    assert outcome.ended_by == "you"
    assert "the sensor is back" in person.said
    t = read_demo(tmp_path / "tea").recording.t
    assert (np.diff(t) > 0.0).all()
    assert np.diff(t).max() > 0.25  # the gap stays a gap


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, str]]:
    """A pseudo-terminal whose other end is ours; little patience."""
    monkeypatch.setattr(loop, "SILENT_S", 0.3)
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_silence_is_told(tmp_path: Path, silent: tuple[int, str]) -> None:
    person = Watched()
    with pytest.raises(
        SensorError, match=r"is silent at 9600 baud: nothing came in 0\.3 s; check that the sensor is on"
    ):
        record(
            lambda: open_port(silent[1], 9600),
            protocol("witmotion").decoder(),
            options(tmp_path / "tea"),
            person.poll,
            person.shown.append,
        )
    assert not (tmp_path / "tea").exists()


def test_bytes_that_are_no_packets_are_told(tmp_path: Path, silent: tuple[int, str]) -> None:
    master, name = silent

    def chatter() -> None:
        for _ in range(40):
            os.write(master, b"\xf0\x0f garbage ")
            time.sleep(0.02)

    writer = threading.Thread(target=chatter)
    writer.start()
    with pytest.raises(
        SensorError, match=r"bytes came from .* but no whole packet of ximu3: the baud rate or the kind"
    ):
        record(
            lambda: open_port(name, 9600),
            protocol("witmotion").decoder(),
            options(tmp_path / "tea"),
            Watched().poll,
            lambda status: None,
        )
    writer.join()


def run_pbd(*words: str, cwd: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*PBD, *words], cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_without_a_terminal_it_prints_lines_and_a_signal_ends_it(tmp_path: Path) -> None:
    process = run_pbd("record", "tea", "--sensor", "sim", "--json", cwd=tmp_path)
    assert process.stderr is not None
    for line in process.stderr:
        if "you may move" in line:
            break
    process.send_signal(signal.SIGTERM)
    out, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    told = json.loads(out)
    assert told["demo"] == "demos/tea"
    assert told["ended_by"] == "you"
    assert len(read_demo(tmp_path / "demos" / "tea").recording) == told["samples"]


def test_a_killed_recording_has_all_but_the_last_quarter_second(tmp_path: Path) -> None:
    process = run_pbd("record", "tea", "--sensor", "sim", cwd=tmp_path)
    imu = tmp_path / "demos" / "tea" / "imu.csv"
    while not imu.exists():
        time.sleep(0.01)
    begun = time.monotonic()
    time.sleep(1.0)
    process.kill()
    killed = time.monotonic()
    process.communicate(timeout=20)
    assert imu.read_text().endswith("\n")
    recording = read_demo(imu.parent).recording
    assert recording.t[-1] >= loop_time(killed - begun)


def loop_time(elapsed: float) -> float:
    """What must be on disk that long after the folder appeared (which holds LOOK_S already)."""
    return elapsed - 0.25


def test_what_exists_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    (tmp_path / "demos" / "tea").mkdir(parents=True)
    process = run_pbd("record", "tea", "--sensor", "sim", cwd=tmp_path)
    _, error = process.communicate(timeout=20)
    assert process.returncode == 1
    assert error == "pbd: demos/tea exists; give another name, or --force to replace it\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--sensor", "nunchuk"), "sensor 'nunchuk' is unknown"),
        (("--sensor", "witmotion", "--port", "/dev/nothing"), "there is no port /dev/nothing"),
        (("--sensor", "witmotion", "--port", "/dev/null", "--baud", "9600"), "/dev/null is no serial port"),
        (("--sensor", "lines", "--port", "/dev/null"), "tell what the numbers of a line are"),
    ],
)
def test_what_can_not_be_opened_is_told(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    process = run_pbd("record", "tea", *words, cwd=tmp_path)
    _, error = process.communicate(timeout=20)
    assert process.returncode == 1
    assert message in error
    assert error.count("\n") == 1
