"""A thread that empties a port, so that a slow screen or disk loses nothing."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Protocol, Self

from pbd.errors import SensorError

READ_TIMEOUT_S = 0.02
"""Longest time, s, that a read of a port and `take` wait."""

MOST_BYTES = 32768
"""Most bytes that `take` returns, 0.1 s of the fastest sensor. So a slow consumer can still do its other work."""

CLOSE_S = 5.0
"""Longest time, s, that `close` waits for a read that hangs."""


class Source(Protocol):
    """What gives a sensor's bytes: a serial port (with its `baud`), a phone, a gamepad.

    Attributes:
        patience_s: s without a byte after which it counts as gone; None: as a serial port.
        trouble: why no bytes come just now, if it knows; else "".
    """

    device: str
    baud: int = 0
    patience_s: float | None = None
    trouble: str = ""

    def read(self) -> bytes:
        """Return what has come, soon. Raises SensorError once the device is gone."""

    def close(self) -> None:
        """Close it; closing twice is nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class Reader:
    """Reads bytes, with their time of arrival (host's monotonic clock, s)."""

    def __init__(self, open_port: Callable[[], Source]) -> None:
        self._open = open_port
        self._pieces: queue.SimpleQueue[tuple[bytes, float] | SensorError] = queue.SimpleQueue()
        self.bytes_seen = 0
        self._start()

    def take(self) -> tuple[list[tuple[bytes, float]], SensorError | None]:
        """Return what has come, and the error that ended the reading, if any. Waits READ_TIMEOUT_S at most."""
        pieces: list[tuple[bytes, float]] = []
        end = self.bytes_seen + MOST_BYTES
        while self.bytes_seen < end:
            try:
                piece = self._pieces.get_nowait() if pieces else self._pieces.get(timeout=READ_TIMEOUT_S)
            except queue.Empty:
                return pieces, None
            if isinstance(piece, SensorError):
                return pieces, piece
            pieces.append(piece)
            self.latest = piece[1]
            self.bytes_seen += len(piece[0])
        return pieces, None

    def reopened(self) -> bool:
        """Try to open the port again, once it was closed; False where it can't be."""
        try:
            self._start()
        except SensorError:
            return False
        return True

    def close(self) -> None:
        """Stop reading and close the port."""
        self._ending.set()
        self._thread.join(CLOSE_S)
        self.port.close()

    def _start(self) -> None:
        self.port = self._open()
        self.opened = self.latest = time.monotonic()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._read, name="port", daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            while not self._ending.is_set():
                if data := self.port.read():
                    self._pieces.put((data, time.monotonic()))
        except SensorError as error:
            self._pieces.put(error)
