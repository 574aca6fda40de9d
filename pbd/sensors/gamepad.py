"""Motion sensors of a PlayStation's or Switch's pad, as Linux' input events: struct input_event of linux/input.h.

The kernel scales them by the pad's own calibration. Sources: hid-playstation.c (DS_ACC_RES_PER_G,
DS_GYRO_RES_PER_DEG_S) and SDL_sensor.h for its axes; hid-nintendo.c (JC_IMU_ACCEL_RES_PER_G, JC_IMU_GYRO_RES_PER_DPS,
joycon_parse_imu_report). Ours are, of a pad on the table: x to the right, y away from the player, z up.

An axis that didn't change is not sent. Events carry no checksum: an impossible one is skipped byte by byte.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

from pbd.data.units import DEG, GRAVITY
from pbd.sensors.decoding import Sample, Tally, WrappingClock

EVENT = Struct("@qqHHi")
"""Seconds and microseconds of the host's clock, type, code, value: 24 bytes on every 64-bit Linux."""

EV_SYN, EV_KEY, EV_ABS, EV_MSC = 0, 1, 3, 4
SYN_REPORT, SYN_DROPPED, MSC_TIMESTAMP = 0, 3, 5
AXES = (0, 1, 2, 3, 4, 5)
"""ABS_X, ABS_Y, ABS_Z, of the accelerometer; ABS_RX, ABS_RY, ABS_RZ, of the gyro (linux/input-event-codes.h)."""

GRIP_KEYS = (*range(0x130, 0x13A), *range(0x220, 0x224))
"""BTN_SOUTH to BTN_TR2, BTN_DPAD_UP to BTN_DPAD_RIGHT: a pad's face and shoulder buttons."""

WRAP_US = 2**32


class Pad(NamedTuple):
    """How the kernel shows a maker's pads.

    Attributes:
        axes: of each of our axes, the pad's and its sign.
        has_clock: whether its stamps are in us of the pad's own time.
    """

    gyro_per_deg_s: int
    axes: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
    has_clock: bool


PADS = {
    8192: Pad(1024, ((0, 1), (2, -1), (1, 1)), True),
    4096: Pad(14247, ((1, -1), (0, 1), (2, 1)), False),
}
"""Counts for 1 g -> DualSense, DualShock 4: x right, y up, z toward the player; Joy-Con, Pro Controller: x toward the
triggers, y left, z up. hid-nintendo makes its stamps of the reports' arrival, and counts each report's time twice."""

MSC_RAW = 3
"""An event that no motion sensor sends: `GamepadPort` adds it to say which pad it is, by its counts for 1 g."""

_KNOWN = {EV_SYN: 16, EV_KEY: 0x300, EV_ABS: 0x40, EV_MSC: 8}
"""Types of events, and the number of codes that each has."""

_LATEST_S = 2**33
"""Bound on a host's clock."""


class GamepadDecoder:
    """Axes are kept until they change; a report gives a sample."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""
        self._axes: dict[int, int] = {}
        self._stamp: int | None = None
        self._clock = WrappingClock(WRAP_US)
        self._dropped = self._junk = False
        self._acc_per_g, self._pad = next(iter(PADS.items()))

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        data, at, samples = self._rest + data, 0, list[Sample]()
        while at + EVENT.size <= len(data):
            end = len(data) - (len(data) - at) % EVENT.size
            for seconds, micros, kind, code, value in EVENT.iter_unpack(memoryview(data)[at:end]):
                if code >= _KNOWN.get(kind, 0) or not (0 <= micros < 1_000_000 and 0 <= seconds < _LATEST_S):
                    self.tally.bad_packets += not self._junk
                    self._junk = True
                    at += 1
                    break
                self._junk = False
                at += EVENT.size
                if kind == EV_ABS:
                    self._axes[code] = value
                elif kind == EV_MSC and code == MSC_TIMESTAMP:
                    self._stamp = value % WRAP_US
                elif kind == EV_MSC and code == MSC_RAW and value in PADS:
                    self._acc_per_g, self._pad = value, PADS[value]
                elif kind == EV_KEY:
                    self.tally.presses += value == 1 and code in GRIP_KEYS
                elif kind == EV_SYN:
                    self._end(code, samples)
        self._rest = data[at:]
        return samples

    def _end(self, code: int, samples: list[Sample]) -> None:
        """End a report; one after a loss is half a report."""
        if code == SYN_DROPPED:
            self._dropped = True
            self.tally.bad_packets += 1
        elif code == SYN_REPORT and self._stamp is not None:
            if not self._dropped and len(self._axes) >= len(AXES):
                self.tally.packets += 1
                samples.append(self._sample(self._stamp))
            self._dropped, self._stamp = False, None

    def _sample(self, stamp: int) -> Sample:
        counts = [self._axes.get(axis, 0) for axis in AXES]
        g, turn = GRAVITY / self._acc_per_g, DEG / self._pad.gyro_per_deg_s
        (x, sx), (y, sy), (z, sz) = self._pad.axes
        return Sample(
            acc=(sx * counts[x] * g, sy * counts[y] * g, sz * counts[z] * g),
            gyr=(sx * counts[3 + x] * turn, sy * counts[3 + y] * turn, sz * counts[3 + z] * turn),
            t_device=1e-6 * self._clock.straight(stamp) if self._pad.has_clock else None,
        )


def event(kind: int, code: int, value: int) -> bytes:
    """Make an event, at no time."""
    return EVENT.pack(0, 0, kind, code, value)
