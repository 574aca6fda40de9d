"""Motion sensors of a PlayStation or Switch gamepad, as Linux input events (struct input_event of linux/input.h).

The kernel has already applied the pad's own calibration. Sources: hid-playstation.c (DS_ACC_RES_PER_G,
DS_GYRO_RES_PER_DEG_S) and SDL_sensor.h for its axes; hid-nintendo.c (JC_IMU_ACCEL_RES_PER_G, JC_IMU_GYRO_RES_PER_DPS,
joycon_parse_imu_report). A sample's axes, for a pad that lies on a table: x right, y away from the player, z up.

The kernel sends only the axes that changed. Events have no checksum: an impossible one is skipped byte by byte.
"""

from struct import Struct
from typing import NamedTuple

from pbd.data.units import DEG, GRAVITY
from pbd.sensors.decoding import Sample, Tally, WrappingClock

EVENT = Struct("@qqHHi")
"""Seconds and microseconds of the host's clock, type, code, value: 24 bytes on 64-bit Linux."""

EV_SYN, EV_KEY, EV_ABS, EV_MSC = 0, 1, 3, 4
SYN_REPORT, SYN_DROPPED, MSC_TIMESTAMP = 0, 3, 5
AXES = (0, 1, 2, 3, 4, 5)
"""Codes of the accelerometer's ABS_X, ABS_Y, ABS_Z and the gyro's ABS_RX, ABS_RY, ABS_RZ (input-event-codes.h)."""

GRIP_KEYS = (*range(0x130, 0x13A), *range(0x220, 0x224))
"""Codes of the buttons that mark the grip: BTN_SOUTH to BTN_TR2 (face, shoulder) and BTN_DPAD_UP to BTN_DPAD_RIGHT."""

WRAP_US = 2**32
"""Value at which the pad's own time stamp wraps to zero, us."""


class Pad(NamedTuple):
    """How the kernel reports one family of gamepads.

    Attributes:
        gyro_per_deg_s: the gyro's counts for 1 deg/s.
        axes: for each axis of a sample, the index of the pad's axis and its sign.
        has_clock: whether the time stamps come from the pad's own clock.
    """

    gyro_per_deg_s: int
    axes: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
    has_clock: bool


PADS = {
    8192: Pad(1024, ((0, 1), (2, -1), (1, 1)), True),
    4096: Pad(14247, ((1, -1), (0, 1), (2, 1)), False),
}
"""Accelerometer's counts for 1 g -> the pad. First DualSense and DualShock 4: x right, y up, z toward the player.
Then Joy-Con and Pro Controller: x toward the triggers, y left, z up. Their stamps are unusable: hid-nintendo makes them
from the reports' arrival, and counts each report's time twice."""

MSC_RAW = 3
"""Code of an event that no motion sensor sends. `GamepadPort` adds it: its value, the counts for 1 g, names the pad."""

_CODES = {EV_SYN: 16, EV_KEY: 0x300, EV_ABS: 0x40, EV_MSC: 8}
"""Number of codes that each type of event has."""


class GamepadDecoder:
    """Keeps each axis until it changes; each report (EV_SYN) gives a sample."""

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
            seconds, micros, kind, code, value = EVENT.unpack_from(data, at)
            possible = code < _CODES.get(kind, 0) and 0 <= micros < 1_000_000 and 0 <= seconds < 2**33
            if possible:
                self._take(kind, code, value, samples)
            self.tally.bad_packets += not (possible or self._junk)
            self._junk = not possible
            at += EVENT.size if possible else 1
        self._rest = data[at:]
        return samples

    def _take(self, kind: int, code: int, value: int, samples: list[Sample]) -> None:
        if kind == EV_ABS:
            self._axes[code] = value
        elif kind == EV_MSC and code == MSC_TIMESTAMP:
            self._stamp = value % WRAP_US
        elif kind == EV_MSC and code == MSC_RAW and value in PADS:
            self._acc_per_g, self._pad = value, PADS[value]
        elif kind == EV_KEY:
            self.tally.grip_presses += value == 1 and code in GRIP_KEYS
        elif kind == EV_SYN:
            self._end_report(code, samples)

    def _end_report(self, code: int, samples: list[Sample]) -> None:
        """End a report. The first report after SYN_DROPPED is incomplete and gives no sample."""
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
            t_device=1e-6 * self._clock.unwrap(stamp) if self._pad.has_clock else None,
        )


def make_event(kind: int, code: int, value: int) -> bytes:
    """Encode an event with time zero."""
    return EVENT.pack(0, 0, kind, code, value)
