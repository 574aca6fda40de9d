"""A simulated hand instead of a sensor: `pbd record --sensor sim`."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

from pbd.data import GripEvent
from pbd.record.loop import Poll
from pbd.record.session_types import Command, Outcome, Say, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.port import Port, open_port
from pbd.sensors.protocols import protocol
from pbd.simulation.emulator import Emulator
from pbd.simulation.simulate import simulate

BAUD = 115200
FIRST_TASK = "pour"
ENDED_BY = "simulated task finished"

Show = Callable[[Status], None]


class SimulatedHand:
    """Does a task at a pseudo-terminal, from when that is opened first: grips as the task does, says when it is over.

    Attributes:
        name: as a calibration knows the sensor: the same whatever the task.
    """

    name = "sim (x-IMU3)"

    def __init__(self, emulator: Emulator, grip: tuple[GripEvent, ...]) -> None:
        self._emulator = emulator
        self._to_come = list(grip)
        self._closed: bool | None = None  # as shown last; None before anything is on disk
        self._announced = self._has_ended = False

    def open(self) -> Port:
        """Open its port."""
        port = open_port(self._emulator.device, BAUD)
        self._emulator.play()
        return port

    def decoder(self) -> Decoder:
        """What reads it."""
        return protocol("ximu3").decoder()

    def beside(self, poll: Poll, show: Show, terminal: bool, duration_s: float | None) -> tuple[Poll, Show]:
        """Put it beside a person's commands and a screen.

        At a terminal, and where a duration was given, the recording goes on when the task is over; else nobody could
        end it but by a signal, so it ends by itself.
        """
        ends = not terminal and duration_s is None
        then = "Enter ends the recording" if terminal else "it ends here" if ends else f"it goes on to {duration_s:g} s"

        def poll_both() -> Command | None:
            return poll() or self._command(ends)

        def show_too(status: Status) -> None:
            self._closed = status.closed
            if self._emulator.over and not self._announced:
                self._announced = True
                over = Say(status.t, f"the simulated task is finished: {then}", bell=True)
                status = replace(status, said=(*status.said, over))
            show(status)

        return poll_both, show_too

    def outcome(self, outcome: Outcome) -> Outcome:
        """Say by what it was ended."""
        return replace(outcome, ended_by=ENDED_BY) if self._has_ended else outcome

    def _command(self, ends: bool) -> Command | None:
        if self._closed is not None and self._to_come and self._emulator.t >= self._to_come[0].t:
            return Command.GRIP if self._to_come.pop(0).closed != self._closed else None
        if ends and self._announced:
            self._has_ended = True
            return Command.END
        return None


def simulated_hand(task: str, stack: ExitStack) -> SimulatedHand:
    """Make one that does a task of pbd.simulation, with a sensor whose errors are new each time.

    Raises:
        UsageError: no task has this name.
    """
    recording = simulate(task or FIRST_TASK, "modern", seed=int(time.time())).recording
    emulator = Emulator(recording)
    stack.callback(emulator.unplug)
    return SimulatedHand(emulator, recording.grip)
