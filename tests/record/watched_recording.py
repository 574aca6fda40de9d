"""A recording of an emulated sensor, and a person who watches it."""

from pathlib import Path

from pbd.data import Recording
from pbd.record import Command, Outcome, RecordOptions, Status, record
from pbd.sensors.port import open_port
from pbd.sensors.protocols import protocol
from pbd.simulation.emulator import Emulator


class Watched:
    """A person who acts at given times, and a screen that keeps what it was shown."""

    def __init__(self, acts: dict[float, Command] | None = None) -> None:
        self.acts = sorted((acts or {}).items())
        self.shown: list[Status] = []
        self.acted: list[int] = []  # how much had been shown at each act

    def poll(self) -> Command | None:
        if self.acts and self.shown and self.shown[-1].t >= self.acts[0][0]:
            self.acted.append(len(self.shown))
            return self.acts.pop(0)[1]
        return None

    @property
    def said(self) -> list[str]:
        return [say.text for status in self.shown for say in status.messages]


def options(folder: Path, **given: object) -> RecordOptions:
    return RecordOptions(folder, "ximu3", "2026-01-02T03:04:05Z", **given)  # type: ignore[arg-type]


def recorded(recording: Recording, person: Watched, wanted: RecordOptions) -> Outcome:
    with Emulator(recording) as sensor:
        decoder = protocol("ximu3").decoder()
        return record(lambda: open_port(sensor.device, 115200), decoder, wanted, person.poll, person.shown.append)
