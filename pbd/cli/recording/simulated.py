"""A simulated hand instead of a sensor: `pbd record --sensor sim`."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

from pbd.data import GripEvent
from pbd.record.loop import Poll
from pbd.record.session_types import Command, Message, Status
from pbd.sensors.decoding import Decoder
from pbd.sensors.port import Port, open_port
from pbd.sensors.protocols import protocol
from pbd.simulation.emulator import Emulator
from pbd.simulation.simulate import simulate

Show = Callable[[Status], None]


class SimulatedHand:
    """Does a task, and sends its samples through a pseudo-terminal from when that is first opened.

    It closes and opens the grip as the task does, and says when the task is finished.

    Attributes:
        name: the sensor's name, by which a calibration knows it: the same for all tasks.
    """

    name = "sim (x-IMU3)"

    def __init__(self, emulator: Emulator, grip: tuple[GripEvent, ...]) -> None:
        self._emulator = emulator
        self._grips_ahead = list(grip)
        self._closed: bool | None = None  # the grip as last shown; None before the first sample is on disk
        self._announced = False

    def open(self) -> Port:
        """Open the port and start the task."""
        port = open_port(self._emulator.device, 115200)  # a baud rate, which a pseudo-terminal ignores
        self._emulator.play()
        return port

    def decoder(self) -> Decoder:
        """Make the decoder of its samples."""
        return protocol("ximu3").decoder()

    def combine(self, poll: Poll, show: Show, terminal: bool, duration_s: float | None) -> tuple[Poll, Show]:
        """Add the hand's commands to those of a person, and its message to the screen.

        After the task the recording continues if there is a terminal or a duration. Otherwise only a signal could end
        it, so the hand ends it.
        """
        ends = not terminal and duration_s is None
        then = "Enter ends the recording" if terminal else "it ends here" if ends else f"it goes on to {duration_s:g} s"

        def poll_both() -> Command | None:
            return poll() or self._command(ends)

        def show_too(status: Status) -> None:
            self._closed = status.closed
            if self._emulator.over and not self._announced:
                self._announced = True
                over = Message(status.t, f"the simulated task is finished: {then}", bell=True)
                status = replace(status, messages=(*status.messages, over))
            show(status)

        return poll_both, show_too

    def _command(self, ends: bool) -> Command | None:
        if self._closed is not None and self._grips_ahead and self._emulator.t >= self._grips_ahead[0].t:
            return Command.GRIP if self._grips_ahead.pop(0).closed != self._closed else None
        return Command.FINISH if ends and self._announced else None


def simulated_hand(task: str, stack: ExitStack) -> SimulatedHand:
    """Make a hand that does a task of pbd.simulation, or "pour". The sensor is always device 0; its noise differs.

    Raises:
        UsageError: no task has this name.
    """
    recording = simulate(task or "pour", "modern", seed=int(time.time()), device=0).recording
    emulator = Emulator(recording)
    stack.callback(emulator.unplug)
    return SimulatedHand(emulator, recording.grip)
