"""The servos' bus: registers read and written over a serial port, each with a deadline.

Our own hundred lines, not Feetech's SDK (PyPI feetech-servo-sdk 1.0.0): that waits in a busy loop, so it takes a whole
core and the steadiness of the stream with it; waits at least 34 ms for a servo that is silent, by the wall clock; and
its sync read drops the servos' error flags. LeRobot replaces its timeout at run time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Self

from pbd.driving.packets import Answer, sync_read, sync_write, take_answers
from pbd.errors import SensorError
from pbd.sensors.port import Port, open_port

BAUD = 1_000_000
"""Baud rate of the servos as LeRobot sets them up (and as they leave the factory)."""

ANSWER_S = 0.008
"""Longest time, s, for all servos to answer while the arm moves. As they leave the factory they wait 0.5 ms and send
14 bytes (0.14 ms) each, 4 ms in all; a USB adapter adds 1 ms each way."""

PATIENT_S = 0.05
"""The same while nothing moves: an adapter with a latency timer of 16 ms is recognised so."""

TRIES = 2
"""How often a servo is asked before it counts as silent. Two tries and a period of 20 ms stop the arm within 50 ms."""

WAIT_S = 0.001
"""How long one read of the port waits, s."""


class NoAnswerError(SensorError):
    """Servos are silent, or what comes isn't theirs."""

    def __init__(self, message: str, ids: tuple[int, ...], heard: bytes) -> None:
        super().__init__(message, ids=ids)
        self.ids, self.heard = ids, heard


class Bus:
    """An open bus.

    Attributes:
        answer_s: how long servos may take to answer, s.
        asked_again: how many requests had to be repeated.
    """

    def __init__(self, port: Port, answer_s: float) -> None:
        self._port, self.answer_s = port, answer_s
        self.device = port.device
        self.asked_again = 0

    @classmethod
    @contextmanager
    def open(cls, device: str, answer_s: float | None = None) -> Iterator[Self]:
        """Open the port, with PATIENT_S to answer unless said else; raises SensorError as `open_port` does.

        When it is closed again, the servos hold.
        """
        with open_port(device, BAUD, what="arm", wait_s=WAIT_S) as port:
            yield cls(port, answer_s or PATIENT_S)

    def read(self, ids: Sequence[int], address: int, length: int) -> dict[int, Answer]:
        """Read registers of all these servos.

        Raises:
            NoAnswerError: one was silent, or its answer broken, each time it was asked.
            SensorError: the port is gone.
        """
        found: dict[int, Answer] = {}
        missing, heard = tuple(ids), b""
        for attempt in range(TRIES):
            self.asked_again += attempt > 0
            self._port.clear()
            self._port.write(sync_read(missing, address, length))
            until, buffer = time.monotonic() + self.answer_s, bytearray()
            late = False
            while missing and not late:
                late = time.monotonic() >= until  # read once more: it may have come while this computer was busy
                came = self._port.read()
                heard, buffer = (heard + came)[-200:], buffer + came
                found |= {a.id: a for a in take_answers(buffer) if a.id in missing and len(a.data) == length}
                missing = tuple(id_ for id_ in ids if id_ not in found)
            if not missing:
                return found
        silent = f"servo {missing[0]}" if len(missing) == 1 else f"servos {', '.join(map(str, missing))}"
        what = f"{silent} on {self.device} did not answer; check the cables and the arm's power supply"
        raise NoAnswerError(what, missing, heard)

    def write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Write registers of several servos at once; nothing answers, so read what matters again."""
        self._port.write(sync_write(address, values))
