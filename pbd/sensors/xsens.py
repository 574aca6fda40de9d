"""Xsens MTi: MTData2 messages.

Source: MT Low Level Communication Protocol, "MTData2" (MT0101P). FA FF 36, length (255: two more bytes of it), items
(xsens_items.py), and a byte that makes the sum of all after FA zero modulo 256.

Acceleration is a specific force and the axes are right-handed with z up already; the field keeps its own unit (1 is
about the earth's). Velocity and turn since the last sample serve where acceleration or rate of turn are not sent,
divided by the interval that they were summed over: the sample time's step, shared out over the packets that the counter
says were lost. The first packet gives none. Field and attitude may come more rarely than the rest: each sample has the
last ones, if not older than 0.2 s. The sample time's wrap-around (every five days) is taken out.
"""

from __future__ import annotations

import re
from math import atan2, hypot

from pbd.sensors.decoding import PacketDecoder, Sample, Triple, scaled
from pbd.sensors.xsens_items import Items, read_items

MAX_PAYLOAD = 2048
HZ = 10_000  # of the sample time
JOIN = HZ // 5  # 0.2 s


class XsensDecoder(PacketDecoder):
    """Bytes of an MTi to samples: m/s2, rad/s, the device's own unit of the field, rad, s of its sample time."""

    BEGIN = re.compile(rb"\xfa(?:\xff(?:\x36|\Z)|\Z)")

    def __init__(self) -> None:
        super().__init__()
        self._ticks: int | None = None  # sample time of the last packet, wrap-around taken out
        self._counter: int | None = None
        self._interval: float | None = None  # s
        self._last: dict[str, tuple[int, Triple]] = {}  # field and attitude with their time
        self._moves = False  # whether packets with acceleration or rate have come

    def _packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        head = data[at : at + 6]
        if len(head) < 4 or (head[3] == 255 and len(head) < 6):
            return 0
        length, first = (head[3], at + 4) if head[3] < 255 else (int.from_bytes(head[4:6]), at + 6)
        end = first + length + 1
        if length > MAX_PAYLOAD:
            return -1
        if end > len(data):
            return 0
        if sum(data[at + 1 : end]) & 0xFF:
            return -1
        sample = self._sample(data[first : end - 1])
        if sample is not None:
            samples.append(sample)
        return end - at

    def _sample(self, payload: bytes) -> Sample | None:
        """What a whole packet gives; None where that is nothing, or only field or attitude for the next samples."""
        found = read_items(payload)
        if found is None:
            self.tally.bad_packets += 1
            return None
        self._take_time(found)
        acc, gyr, mag, rpy = found.get("acc"), found.get("gyr"), found.get("mag"), found.get("rpy")
        if self._interval is not None:
            acc = scaled(found["dv"], 1.0 / self._interval) if acc is None and "dv" in found else acc
            gyr = _rate_of_turn(found["dq"], self._interval) if gyr is None and "dq" in found else gyr
        mag, rpy = self._held("mag", mag), self._held("rpy", rpy)
        if acc is not None or gyr is not None:
            self._moves = True
        elif self._moves or found.keys() & {"dv", "dq"} or not found.keys() & {"mag", "rpy"}:
            return None
        return Sample(acc, gyr, mag, rpy, self._ticks / HZ if "ticks" in found and self._ticks is not None else None)

    def _take_time(self, found: Items) -> None:
        """Follow the sample time through its wrap-around, and the interval between samples."""
        if "ticks" not in found:
            return
        ticks, counter = found["ticks"][0], found["counter"][0] if "counter" in found else None
        if self._ticks is not None:
            step = (ticks - self._ticks + 2**31) % 2**32 - 2**31  # a device that begins anew steps back
            ticks = self._ticks + step
            packets = 1 if counter is None or self._counter is None else (counter - self._counter) % 2**16
            if step > 0 and packets > 0:
                self._interval = step / HZ / packets
        self._ticks, self._counter = ticks, counter

    def _held(self, what: str, value: Triple | None) -> Triple | None:
        """The value, or where there is none the last one of up to 0.2 s before."""
        if self._ticks is None:
            return value
        if value is not None:
            self._last[what] = (self._ticks, value)
        elif what in self._last:
            at, last = self._last[what]
            return last if 0 <= self._ticks - at <= JOIN else None
        return value


def _rate_of_turn(dq: tuple[float, float, float, float], interval: float) -> Triple:
    w, x, y, z = dq
    sine = hypot(x, y, z)
    # the shorter way round: w < 0 is the same turn as -w, -x, -y, -z
    scale = 2.0 * (atan2(sine, w) if w >= 0.0 else -atan2(sine, -w)) / sine / interval if sine else 0.0
    return x * scale, y * scale, z * scale
