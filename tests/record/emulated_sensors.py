"""Emulated devices that send each protocol into a pseudo-terminal, to test recording without hardware."""

import itertools
import os
import random
import struct
import sys
import threading
import time
import tty
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fcntl import ioctl
from termios import FIONREAD
from typing import Self

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.pose import quat_from_rpy
from pbd.sensors.decoding import Decoder
from pbd.sensors.line_layout import layout_from_options
from pbd.sensors.lines import LineDecoder
from pbd.sensors.protocols import PROTOCOLS
from tests.sensors.encoders import os5000, razor, vectornav, witmotion, ximu3, xsens

Encode = Callable[[Recording, int], bytes]
ROUNDS = 8
"""Number of reads of the port, 20 ms each, after which all bytes have certainly been read."""

HALF_TURN = np.array([1.0, -1.0, -1.0])  # from forward-left-up to a VectorNav's forward-right-down


@dataclass(frozen=True)
class Speaker:
    """A protocol, or one of its variants.

    Attributes:
        encode: encodes one row of a recording.
        acc, gyr: rounding error, m/s2 and rad/s.
        checked: whether packets have a checksum.
        clocked: whether packets have a time.
        decoder: makes the decoder.
    """

    sensor: str
    encode: Encode
    acc: float
    gyr: float
    checked: bool
    clocked: bool
    decoder: Callable[[], Decoder]


def random_hand(rows: int, seed: int, rate_hz: float = 100.0) -> Recording:
    """A recording of random rows, all different and within every device's range."""
    rng = np.random.default_rng(seed)
    return Recording(
        np.arange(rows) / rate_hz,
        rng.normal((0.0, 0.0, GRAVITY), 4.0, (rows, 3)),
        rng.normal(0.0, 1.5, (rows, 3)),
        rng.normal(0.0, 30.0, (rows, 3)),
        rng.uniform(-1.0, 1.0, (rows, 3)),
    )


def _of(values: np.ndarray | None, row: int) -> np.ndarray:
    assert values is not None
    return np.asarray(values[row])


def _os5000(hand: Recording, row: int) -> bytes:
    angles = os5000.compass_from_rpy(quat_from_rpy(_of(hand.device_rpy, row)))
    return os5000.tagged(angles, list(hand.acc[row] / GRAVITY), list(10.0 * _of(hand.mag, row)), "T28.4")


def _witmotion(hand: Recording, row: int) -> bytes:
    def words(values: np.ndarray, full_scale: float) -> list[int]:
        return [round(value) for value in 32768.0 * values / full_scale]

    return witmotion.group(
        {
            witmotion.ACC: words(hand.acc[row], 16.0 * GRAVITY),
            witmotion.GYR: words(_of(hand.gyr, row), np.radians(2000.0)),
            witmotion.ANGLE: words(_of(hand.device_rpy, row), np.pi),
            witmotion.MAG: words(_of(hand.mag, row), 32768.0),
        }
    )


def _ximu3(write: Callable[[str, int, Sequence[float]], bytes]) -> Encode:
    def encode(hand: Recording, row: int) -> bytes:
        us = 1_000_000 + round(1e6 * hand.t[row])
        field = write("M", us, list(_of(hand.mag, row) / 50.0))
        return field + write("I", us, [*np.degrees(_of(hand.gyr, row)), *(hand.acc[row] / GRAVITY)])

    return encode


def _vectornav_text(hand: Recording, row: int) -> bytes:
    mag, acc, gyr = (HALF_TURN * values for values in (_of(hand.mag, row) / 100.0, hand.acc[row], _of(hand.gyr, row)))
    return vectornav.ymr([10.0, 20.0, 30.0], list(mag), list(acc), list(gyr))


def _vectornav_binary(hand: Recording, row: int) -> bytes:
    mag, acc, gyr = (HALF_TURN * values for values in (_of(hand.mag, row) / 100.0, hand.acc[row], _of(hand.gyr, row)))
    inertial = {8: vectornav.floats(*mag), 9: vectornav.floats(*acc), 10: vectornav.floats(*gyr)}
    attitude = {1: vectornav.floats(10.0, 20.0, 30.0)}
    return vectornav.binary({0: {0: struct.pack("<Q", round(1e9 * (1.0 + hand.t[row])))}, 2: inertial, 4: attitude})


def _xsens(hand: Recording, row: int) -> bytes:
    ticks = 2**32 - 500 + round(1e4 * hand.t[row])  # it wraps around on the way
    named = ((xsens.ACC, hand.acc), (xsens.GYR, hand.gyr), (xsens.MAG, hand.mag))
    return xsens.message(xsens.clock(row, ticks), *(xsens.item(what, list(_of(values, row))) for what, values in named))


def _lines(hand: Recording, row: int) -> bytes:
    us = (2**32 - 50_000 + round(1e6 * hand.t[row])) % 2**32  # as above
    values = [*(hand.acc[row] / GRAVITY), *np.degrees(_of(hand.gyr, row))]
    return ",".join([str(us), *(f"{value:.4f}" for value in values)]).encode() + b"\r\n"


def _razor(hand: Recording, row: int) -> bytes:
    return razor.frame(list(hand.acc[row] / GRAVITY), list(np.degrees(_of(hand.gyr, row))), list(_of(hand.mag, row)))


def _lines_decoder() -> Decoder:
    return LineDecoder(layout_from_options("t,ax,ay,az,gx,gy,gz", {"t": "us", "acc": "g", "gyr": "deg/s"}))


def _speaker(sensor: str, encode: Encode, acc: float, gyr: float, checked: bool, clocked: bool) -> Speaker:
    return Speaker(sensor, encode, acc, gyr, checked, clocked, PROTOCOLS[sensor].decoder)


SPEAKERS = {
    "os5000": _speaker("os5000", _os5000, 0.005, 0.0, True, False),
    "witmotion": _speaker("witmotion", _witmotion, 0.0025, 0.0006, True, False),
    "ximu3-ascii": _speaker("ximu3", _ximu3(ximu3.text), 0.0006, 2e-6, False, True),
    "ximu3-binary": _speaker("ximu3", _ximu3(ximu3.binary), 1e-5, 1e-6, False, True),
    "vectornav-ascii": _speaker("vectornav", _vectornav_text, 0.0006, 1e-6, True, False),
    "vectornav-binary": _speaker("vectornav", _vectornav_binary, 1e-5, 1e-6, True, True),
    "xsens": _speaker("xsens", _xsens, 1e-5, 1e-6, True, True),
    "lines": Speaker("lines", _lines, 0.0006, 2e-6, False, True, _lines_decoder),
    "razor": _speaker("razor", _razor, 0.0003, 1e-5, False, False),
}


@dataclass(frozen=True)
class Wire:
    """Packets after a bad cable, and which of them are undamaged."""

    packets: tuple[bytes, ...]
    whole: tuple[bool, ...]


def bad_cable(packets: Sequence[bytes], flipped: float, dropped: float, seed: int) -> Wire:
    """Flip a bit in, or drop, a share of the bytes."""
    rng, out = random.Random(seed), []
    for packet in packets:
        kept = bytearray()
        for byte in packet:
            fate = rng.random()
            if fate >= dropped:
                kept.append(byte ^ (1 << rng.randrange(8)) if fate < dropped + flipped else byte)
        out.append(bytes(kept))
    return Wire(tuple(out), tuple(a == b for a, b in zip(out, packets, strict=True)))


class Device:
    """Sends packets through the pseudo-terminal `device` at a constant rate, from `go` until `pull`."""

    def __init__(self, packets: Sequence[bytes], hz: float, again: bool = False) -> None:
        """With `again` it repeats the packets without end."""
        self._packets, self._hz, self._again = packets, hz, again
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.device = os.ttyname(self._slave)
        self._go, self._sent, self._pulled = threading.Event(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._speak, daemon=True)
        self._asked = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.pull()

    def go(self) -> None:
        """Begin to send."""
        self._go.set()

    def pull(self) -> None:
        """Pull the plug. A second call has no effect."""
        if not self._pulled.is_set():
            self._pulled.set()
            self._go.set()
            self._thread.join()
            os.close(self._slave)
            os.close(self.master)

    def pull_once_heard(self) -> None:
        """Pull the plug once all bytes have been read. Serves as the recording's `poll`."""
        if self._pulled.is_set():
            return
        if self._sent.is_set() and not int.from_bytes(ioctl(self._slave, FIONREAD, bytes(4)), sys.byteorder):
            self._asked += 1
        if self._asked > ROUNDS:
            self.pull()

    def _speak(self) -> None:
        self._go.wait()
        begun = time.monotonic()
        for k, packet in enumerate(itertools.cycle(self._packets) if self._again else self._packets):
            if self._pulled.wait(max(begun + k / self._hz - time.monotonic(), 0.0)):
                return
            self._write(packet)
        self._sent.set()

    def _write(self, packet: bytes) -> None:
        """Write the whole packet, or as much as is read until the plug is pulled."""
        while packet:
            try:
                packet = packet[os.write(self.master, packet) :]
            except BlockingIOError:
                if self._pulled.wait(0.005):
                    return
