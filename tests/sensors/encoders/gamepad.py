"""Writes input events as Linux' hid-playstation does, from what its source says of codes, counts and their order."""

import struct
from collections.abc import Sequence

ABS_X, ABS_Y, ABS_Z, ABS_RX, ABS_RY, ABS_RZ = range(6)
BTN_SOUTH = 0x130


def event(kind: int, code: int, value: int, us: int = 0) -> bytes:
    """A struct input_event: the host's time, type, code, value."""
    return struct.pack("<qqHHi", us // 1_000_000, us % 1_000_000, kind, code, value)


def report(us: int, acc: Sequence[float], gyr: Sequence[float], late_us: int = 0) -> bytes:
    """Of specific force (g) and turn rate (deg/s) in axes x right, y away from the player, z up; a device's us."""
    counts = [round(1024.0 * x) for x in (gyr[0], gyr[2], -gyr[1])]
    forces = [round(8192.0 * x) for x in (acc[0], acc[2], -acc[1])]
    named = list(zip((ABS_RX, ABS_RY, ABS_RZ, ABS_X, ABS_Y, ABS_Z), counts + forces, strict=True))
    stamp = struct.unpack("<i", struct.pack("<I", us % 2**32))[0]
    at = us + late_us
    return b"".join(event(3, code, value, at) for code, value in named) + event(4, 5, stamp, at) + event(0, 0, 0, at)


def press(down: bool = True) -> bytes:
    """The cross, pressed or let go."""
    return event(1, BTN_SOUTH, int(down)) + event(0, 0, 0)
