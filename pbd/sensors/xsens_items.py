"""The items of an MTData2 message: which identifier is what, and in which precision it comes.

Source: MT Low Level Communication Protocol, "Data identifiers" (MT0101P). An item is a 16-bit identifier, a byte of
size and the data, big-endian. Identifiers end in a digit whose lower two bits tell the precision (float32, fixed 12.20,
fixed 16.32, float64) and, for attitude, whose upper two tell the frame (east-north-up, north-east-down, north-west-up):

    1020 packet counter                        2010 quaternion w, x, y, z
    1060 sample time, 10 kHz                   2030 roll, pitch, yaw, deg
    4010 velocity since the last sample, m/s   8020 rate of turn, rad/s
    4020 acceleration, m/s2                    8030 turn since the last sample, quaternion
                                               C020 magnetic field

Any other item is stepped over.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite, nan, pi, radians
from struct import Struct
from typing import TypedDict

from pbd.sensors.attitude import from_north_east_down, from_north_west_up, rpy_from_quaternion, wrapped
from pbd.sensors.decoding import Triple

ENU, NED, NWU = 0x0, 0x4, 0x8
_HEAD = Struct(">HB").unpack_from
Read = Callable[[bytes, int], tuple[float, ...]]


class Items(TypedDict, total=False):
    """Content of a message, as sent; but `rpy` is in rad, east-north-up."""

    counter: tuple[int]
    ticks: tuple[int]
    dv: Triple
    acc: Triple
    gyr: Triple
    dq: tuple[float, float, float, float]
    mag: Triple
    rpy: Triple


def _floating(code: str, count: int) -> Read:
    return Struct(f">{count}{code}").unpack_from


def _fixed_12_20(count: int) -> Read:
    layout = Struct(f">{count}i")
    return lambda data, at: tuple(raw * 2.0**-20 for raw in layout.unpack_from(data, at))


def _fixed_16_32(count: int) -> Read:
    """The fraction comes first: uint32 of 2^-32, then the int16 of whole ones."""
    layout = Struct(">" + "Ih" * count)

    def read(data: bytes, at: int) -> tuple[float, ...]:
        raw = layout.unpack_from(data, at)
        return tuple(whole + fraction * 2.0**-32 for fraction, whole in zip(raw[::2], raw[1::2], strict=True))

    return read


def _attitude(read: Read, count: int, frame: int) -> Read:
    """Roll, pitch and yaw in east-north-up of a quaternion or of angles in deg, in any of the three frames."""

    def read_attitude(data: bytes, at: int) -> tuple[float, ...]:
        numbers = read(data, at)
        if count == 3:
            rpy = radians(numbers[0]), radians(numbers[1]), radians(numbers[2])
        elif any(numbers):
            w, x, y, z = numbers
            rpy = rpy_from_quaternion(w, x, y, z)
        else:
            return (nan,)  # no rotation
        if frame == NED:  # the earth's axes are turned over, the sensor's are not: turn them back
            roll, pitch, yaw = from_north_east_down(rpy)
            return wrapped(roll + pi), pitch, yaw
        return from_north_west_up(rpy) if frame == NWU else rpy

    return read_attitude


def _items() -> dict[int, tuple[str, int, Read]]:
    """By identifier: what it is, how many bytes of data, and how to read them."""
    items: dict[int, tuple[str, int, Read]] = {
        0x1020: ("counter", 2, Struct(">H").unpack_from),
        0x1060: ("ticks", 4, Struct(">I").unpack_from),
    }
    vectors = {0x4010: ("dv", 3), 0x4020: ("acc", 3), 0x8020: ("gyr", 3), 0x8030: ("dq", 4), 0xC020: ("mag", 3)}
    for precision, size, reader in (
        (0, 4, partial(_floating, "f")),
        (1, 4, _fixed_12_20),
        (2, 6, _fixed_16_32),
        (3, 8, partial(_floating, "d")),
    ):
        for identifier, (what, count) in vectors.items():
            items[identifier | precision] = (what, size * count, reader(count))
        for identifier, count in ((0x2010, 4), (0x2030, 3)):
            for frame in (ENU, NED, NWU):
                read = _attitude(reader(count), count, frame)
                items[identifier | precision | frame] = ("rpy", size * count, read)
    return items


ITEMS = _items()


def read_items(payload: bytes) -> Items | None:
    """The payload's items; None where its sizes or its numbers are impossible."""
    found: dict[str, tuple[float, ...]] = {}
    at, end, total = 0, len(payload), 0.0
    while at + 3 <= end:
        identifier, size = _HEAD(payload, at)
        at += 3
        if identifier in ITEMS:
            what, expected, read = ITEMS[identifier]
            if size != expected or at + size > end:
                return None
            found[what] = numbers = read(payload, at)
            total += sum(numbers)
        at += size
    return found if at == end and isfinite(total) else None  # type: ignore[return-value]
