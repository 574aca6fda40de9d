"""A sensor emulator: it sends x-IMU3's binary protocol through a pseudo-terminal in real time."""

import os
import struct
import threading
import time
import tty
from contextlib import suppress
from typing import Self

import numpy as np

from pbd.data import GRAVITY, Recording

INERTIAL, MAGNETOMETER = 0x80 | ord("I"), 0x80 | ord("M")


class Emulator:
    """Plays a recording into a pseudo-terminal. After its end the hand rests: the last samples come in random order.

    In their own order they would be a repeated block, which tracking refuses (`refuse_doubled`).

    Attributes:
        device: the pseudo-terminal's name.
        sent: number of samples sent so far.
    """

    def __init__(self, recording: Recording) -> None:
        """Open the pseudo-terminal; nothing is sent yet."""
        self._recording = recording
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self.sent = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send, name="emulated sensor", daemon=True)

    def __enter__(self) -> Self:
        self.play()
        return self

    def __exit__(self, *error: object) -> None:
        self.unplug()

    @property
    def t(self) -> float:
        """Time sent so far, s. It exceeds the recording's duration once the hand only rests."""
        return self.sent / self._recording.rate_hz

    @property
    def over(self) -> bool:
        """Whether the whole recording has been sent, after which the hand rests."""
        return self.sent >= len(self._recording)

    def play(self) -> None:
        """Begin to send. It has no effect if it plays already or was unplugged."""
        if self._thread.ident is None and not self._ended.is_set():
            self._thread.start()

    def unplug(self) -> None:
        """Close the pseudo-terminal, as if the plug were pulled. A second call has no effect."""
        if not self._ended.is_set():
            self._ended.set()
            if self._thread.is_alive():
                self._thread.join()
            for handle in (self._master, self._slave):
                with suppress(OSError):
                    os.close(handle)

    def _send(self) -> None:
        recording, interval = self._recording, 1.0 / self._recording.rate_hz
        rest = max(1, min(len(recording), round(0.5 / interval)))
        rng, last = np.random.default_rng(0), rest - 1
        begun = time.monotonic()
        while not self._ended.wait(0.01):  # s between two writes, as in a USB device
            due = int((time.monotonic() - begun) / interval)
            messages = []
            for k in range(self.sent, due):
                if k >= len(recording):  # never the same sample twice in a row
                    last = (last + int(rng.integers(1, max(2, rest)))) % rest
                row = min(k, len(recording) - rest + last)
                messages.append(encode(recording, row, round(1e6 * k * interval)))
            with suppress(OSError):  # no reader: like a real sensor, it keeps sending
                os.write(self._master, b"".join(messages))
            self.sent = due


def encode(recording: Recording, row: int, microseconds: int) -> bytes:
    """Encode one sample as x-IMU3 messages: `M` if there is a magnetometer, then `I`.

    Source: x-IMU3 user manual, binary messages: id | 0x80, uint64 microseconds, float32 values, 0x0A; 0x0A and 0xDB
    inside are stuffed as 0xDB 0xDC and 0xDB 0xDD. Units: degrees/s, g, arbitrary (here uT).
    """
    gyr = np.zeros(3) if recording.gyr is None else np.degrees(recording.gyr[row])
    values = (*gyr, *(recording.acc[row] / GRAVITY))
    inertial = _message(INERTIAL, struct.pack("<Q6f", microseconds, *values))
    if recording.mag is None:
        return inertial
    return _message(MAGNETOMETER, struct.pack("<Q3f", microseconds, *recording.mag[row])) + inertial


def _message(kind: int, payload: bytes) -> bytes:
    stuffed = payload.replace(b"\xdb", b"\xdb\xdd").replace(b"\x0a", b"\xdb\xdc")
    return bytes([kind]) + stuffed + b"\n"
