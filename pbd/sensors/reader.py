"""A thread that reads a port, so that no bytes are lost while the screen or the disk is slow."""

import queue
import threading
import time
from collections.abc import Callable
from typing import Protocol, Self

from pbd.errors import SensorError

READ_TIMEOUT_S = 0.02
"""Longest time that a read of a port, or `Reader.take`, waits for bytes, s."""


def host_clock() -> float:
    """The host's clock, s, which nobody sets. Unlike `time.monotonic` it also counts while the machine sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class ByteSource(Protocol):
    """A source of a sensor's bytes: a serial port, a phone, a gamepad.

    Attributes:
        device: the device file, or the phone's address.
        patience_s: time without a byte after which the device counts as gone, s; None: as for a serial port.
        trouble: why no bytes come now, if the source knows; else "".
    """

    device: str
    baud: int = 0
    patience_s: float | None = None
    trouble: str = ""

    def read(self) -> bytes:
        """Return the bytes that have come, without a long wait. Raises SensorError once the device is gone."""

    def close(self) -> None:
        """Close it. A second call has no effect."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class Reader:
    """Reads a source in a thread and notes each piece's time of arrival (`host_clock`, s).

    Attributes:
        opened: when the source was opened, s.
        latest: arrival of the latest piece taken, or `opened`, s.
    """

    def __init__(self, open_port: Callable[[], ByteSource]) -> None:
        self._open = open_port
        self._pieces: queue.SimpleQueue[tuple[bytes, float] | SensorError] = queue.SimpleQueue()
        self.bytes_seen = 0
        self._start()

    def take(self) -> tuple[list[tuple[bytes, float]], SensorError | None]:
        """Return the new pieces with their arrival times, and the error that ended reading, if any."""
        pieces: list[tuple[bytes, float]] = []
        end = self.bytes_seen + 32768  # 0.1 s of the fastest sensor: then the caller has other work to do
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

    def reopen(self) -> bool:
        """Try to open the source again after `close`; return whether it is open."""
        try:
            self._start()
        except SensorError:
            return False
        return True

    def close(self) -> None:
        """Stop reading and close the port."""
        self._ending.set()
        self._thread.join(timeout=5.0)  # a read may hang
        self.port.close()

    def _start(self) -> None:
        self.port = self._open()
        self.opened = self.latest = host_clock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._read, name="port", daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            while not self._ending.is_set():
                if data := self.port.read():
                    self._pieces.put((data, host_clock()))
        except SensorError as error:
            self._pieces.put(error)
