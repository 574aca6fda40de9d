"""The servos' bus: registers read and written over a serial port, with deadlines.

It replaces Feetech's SDK (PyPI feetech-servo-sdk 1.0.0), which waits in a busy loop and so disturbs the stream's
timing, waits at least 34 ms of wall-clock time for a silent servo, and drops the servos' error flags in its sync read.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Self

from pbd.driving.packets import Answer, sync_read, sync_write, take_answers
from pbd.errors import SensorError
from pbd.sensors.port import Port, open_port

BAUD = 1_000_000
"""Baud rate of the servos: the factory's, and LeRobot's."""

ANSWER_S = 0.008
"""Longest time for all servos to answer while the arm moves, s. With factory settings each waits 0.5 ms and sends 14
bytes (0.14 ms): 4 ms for six. A USB adapter adds 1 ms each way."""

ANSWER_AT_REST_S = 0.05
"""Longest time for all servos to answer while nothing moves, s. It is long enough to recognise a USB adapter with a
latency timer of 16 ms."""

TRIES = 2
"""Requests after which a servo counts as silent. Two tries and a period of 20 ms stop the arm within 50 ms."""


class NoAnswerError(SensorError):
    """Servos did not answer. Its fields are `ids`: which; `heard`: the last bytes that came."""


class Bus:
    """An open bus.

    Attributes:
        answer_s: longest time for the servos to answer, s.
        asked_again: number of repeated requests so far.
    """

    def __init__(self, port: Port, answer_s: float) -> None:
        self._port, self.answer_s = port, answer_s
        self.device = port.device
        self.asked_again = 0

    @classmethod
    @contextmanager
    def open(cls, device: str, answer_s: float | None = None) -> Iterator[Self]:
        """Open the port. `answer_s` is ANSWER_AT_REST_S by default. Raises SensorError as `open_port`.

        After it is closed, the servos hold their goals.
        """
        with open_port(device, BAUD, what="arm", wait_s=0.001) as port:
            yield cls(port, answer_s or ANSWER_AT_REST_S)

    def read(self, ids: Sequence[int], address: int, length: int) -> dict[int, Answer]:
        """Read `length` registers from `address` on of several servos.

        Raises:
            NoAnswerError: after TRIES requests a servo had not answered correctly.
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
                late = time.monotonic() >= until  # read once more: the answer may have come while this host was busy
                came = self._port.read()
                heard, buffer = (heard + came)[-200:], buffer + came
                found |= {a.id: a for a in take_answers(buffer) if a.id in missing and len(a.data) == length}
                missing = tuple(id_ for id_ in ids if id_ not in found)
            if not missing:
                return found
        silent = f"servo {missing[0]}" if len(missing) == 1 else f"servos {', '.join(map(str, missing))}"
        what = f"{silent} on {self.device} did not answer; check the cables and the arm's power supply"
        raise NoAnswerError(what, ids=missing, heard=heard)

    def write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Write registers of several servos at once. No servo answers; use `write_verified` where it matters."""
        self._port.write(sync_write(address, values))
