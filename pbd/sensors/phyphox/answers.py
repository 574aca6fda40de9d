"""phyphox on a phone: its answers over HTTP as samples. A line is what was asked and the answer: `/get {...}`.

Source: phyphox' documentation of its remote interface (github.com/phyphox/phyphox-docs, docs/remote-interface) and the
app's own RemoteServer.java. `/get` answers with buffers of numbers of 8 digits, `null` where one is not finite;
`/time` with the moments at which the measurement was started and paused. Experiment time stands still in a pause and
begins anew when the data are cleared, so those moments say how long that took.

The phone's axes: x to the right, y to the top of the screen, z out of it; +g up at rest on both systems.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from pbd.data.streams import Moment, Moments, Stream
from pbd.pose import Array
from pbd.sensors.decoding import Sample, Tally

BUFFERS = {
    "gyr": ("gyr_time", "gyrX", "gyrY", "gyrZ"),
    "acc": ("acc_time", "accX", "accY", "accZ"),
    "mag": ("mag_time", "magX", "magY", "magZ"),
}
"""Our experiment's buffers: the time of each sensor, and its axes."""

LARGEST = {"gyr": 200.0, "acc": 2000.0, "mag": 1e5}
"""rad/s, m/s2 and uT: nothing that a phone can measure exceeds these."""

LONGEST_RUN_S = 1e5
"""Latest experiment time, s: from then on the 8 digits of an answer tell no millisecond."""

NO_GYRO_S = 1.0
"""s of acceleration without a sample of the gyro after which the phone counts as one without a gyro."""

LATE_S = 0.5
"""Longest time, s, that samples wait for the field, which may come late or stop."""

LEAP_S = 0.5
"""Longest step, s, of a sensor's time that is believed at once: the slowest magnetometers give 5 samples a second."""

STEPS = 99
"""Latest intervals of a sensor whose median is its usual one."""

_ASKED = re.compile(rb"/get |/time ")
LONGEST_ANSWER = 16_000_000
"""Largest answer, bytes: all buffers of our experiment, full, are 10 MB."""


def read_answer(text: bytes) -> dict[str, Any] | list[Any]:
    """Read an answer as JSON; ValueError: it is cut off, nested without end, or neither buffers nor moments."""
    import orjson

    try:
        answer = orjson.loads(text)  # three times as fast
    except ValueError:
        try:
            answer = json.loads(text, parse_constant=lambda _: None)  # NaN is no JSON, but some write it
        except RecursionError:
            raise ValueError("nested too deeply") from None
    if not isinstance(answer, dict | list):
        raise ValueError("neither buffers nor moments")
    return answer


def read_moments(answer: object) -> tuple[Moment, ...]:
    """Read the answer to `/time`, oldest first; ValueError: it is another answer."""
    try:
        moments = tuple(Moment(each["event"] == "START", each["experimentTime"], each["systemTime"]) for each in answer)  # type: ignore[attr-defined]
        plain = all(0.0 <= each.t < inf and abs(each.system) < 1e12 for each in moments)
    except (TypeError, KeyError) as reason:
        raise ValueError("no moments") from reason
    if not plain:
        raise ValueError("a moment without a time")
    return moments


def read_buffers(answer: object) -> dict[str, Array]:
    """Read the answer to `/get`: of each sensor rows of time and three axes, (n, 4); ValueError: it is another."""
    try:
        buffers = answer["buffer"]  # type: ignore[index]
        there = {kind: names for kind, names in BUFFERS.items() if names[0] in buffers}
        columns = {kind: [buffers[name]["buffer"] for name in names] for kind, names in there.items()}
        n = {kind: min(map(len, axes)) for kind, axes in columns.items()}  # in one answer all begin at the same row
        return {kind: np.array([_numbers(axis, n[kind]) for axis in axes]).T for kind, axes in columns.items()}
    except (TypeError, KeyError, OverflowError) as reason:
        raise ValueError("no buffers") from reason


def in_order(t: Array, last: float) -> list[int]:
    """Which of a sensor's times (n,) s go on from its `last`: later ones, and one that leaps only if the next agrees.

    A leap that nothing confirms yet is not taken. The phone keeps it, and is asked for it again.
    """
    taken: list[int] = []
    for k, at in enumerate(times := t.tolist()):
        follows = at - last <= LEAP_S or (k + 1 < len(times) and 0.0 < times[k + 1] - at <= LEAP_S)
        if at > last and follows:
            taken.append(k)
            last = at
    return taken


def _numbers(axis: list[Any], n: int) -> list[float]:
    numbers = axis[:n]
    if not set(map(type, numbers)) <= {float, int, type(None)}:
        raise ValueError("a buffer holds something else than numbers")
    return [np.nan if number is None else float(number) for number in numbers]


@dataclass
class _Sensor:
    """Rows of one sensor that may still be needed, (n, 4), and its usual interval, s."""

    rows: Array
    steps: Array
    last: float = -inf

    @property
    def usual(self) -> float:
        return float(np.median(self.steps)) if len(self.steps) else inf

    def add(self, rows: Array) -> None:
        self.steps = np.append(self.steps, np.diff(rows[:, 0], prepend=self.last))[-STEPS:]
        self.steps = self.steps[np.isfinite(self.steps)]
        self.rows, self.last = np.concatenate((self.rows, rows)), float(rows[-1, 0])

    def stream(self) -> Stream:
        return Stream(self.rows[:, 0], self.rows[:, 1:])

    def forget(self, t: float) -> None:
        """Keep what lies after `t`, and the last row before it."""
        self.rows = self.rows[max(int(np.searchsorted(self.rows[:, 0], t)) - 1, 0) :]


class PhyphoxDecoder:
    """Lines of answers to samples on the gyro's clock (the accelerometer's without a gyro), s since the first start."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""
        self._moments = Moments()
        self._latest = -inf
        self._begin()

    def _begin(self) -> None:
        self._sensors = {kind: _Sensor(np.empty((0, 4)), np.empty(0)) for kind in BUFFERS}
        self._first, self._told = inf, -inf

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        longer = len(self._rest) + len(data)
        if self._rest[:1] == b"/" and longer <= LONGEST_ANSWER and b"\n" not in data and b"/" not in data:
            self._rest += data  # nothing ends or begins here
            return []
        *lines, rest = (self._rest + data).split(b"\n")
        samples: list[Sample] = []
        for line in lines:
            if asked := _last_asked(line):
                self._take(asked, samples)
        self._rest = _last_asked(rest)[:LONGEST_ANSWER] or rest[-len(b"/time") :]
        return samples

    def _take(self, line: bytes, samples: list[Sample]) -> None:
        asked, _, text = line.partition(b" ")
        try:
            answer = read_answer(text)
            if asked == b"/get":
                self._add(read_buffers(answer))
            elif self._moments.take(read_moments(answer)):
                self._begin()
        except ValueError:
            self.tally.bad_packets += 1
            return
        self.tally.packets += 1
        samples += self._samples()

    def _add(self, buffers: dict[str, Array]) -> None:
        for kind, rows in buffers.items():
            sensor = self._sensors[kind]
            known = np.isfinite(rows).all(axis=1) & (rows[:, 0] >= 0.0) & (rows[:, 0] < LONGEST_RUN_S)
            with np.errstate(invalid="ignore"):
                known &= (np.abs(rows[:, 1:]) <= LARGEST[kind]).all(axis=1)
            new = rows[known]
            new = new[in_order(new[:, 0], sensor.last)]
            self.tally.bad_packets += len(rows) - len(new)
            if len(new):
                sensor.add(new)

    def _samples(self) -> list[Sample]:
        gyr, acc, mag = (self._sensors[kind] for kind in BUFFERS)
        if not len(acc.rows):
            return []
        self._first = min(self._first, float(acc.rows[0, 0]))
        has_gyr = gyr.last > -inf
        if not has_gyr and acc.last - self._first < NO_GYRO_S:
            return []
        clock = gyr if has_gyr else acc
        until = min(acc.last, self._moments.paused_at)
        if mag.last > -inf:
            until = min(until, max(mag.last, acc.last - LATE_S))
        rows = clock.rows[(clock.rows[:, 0] > self._told) & (clock.rows[:, 0] <= until)]
        if not len(rows):
            return []
        t = rows[:, 0]
        self._told = float(t[-1])
        at_acc, at_mag = acc.stream().at(t, acc.usual), mag.stream().at(t, mag.usual)
        straight = self._moments.straight(t)
        # Beside a pause the phone's moments are exact to milliseconds: no sample comes before an earlier one.
        later = straight > np.maximum.accumulate(np.append(self._latest, straight[:-1]))
        self._latest = max(self._latest, float(straight.max()))
        for sensor in (gyr, acc, mag):
            sensor.forget(self._told)
        return [
            Sample(
                (ax, ay, az),
                (gx, gy, gz) if has_gyr else None,
                (mx, my, mz) if mx == mx else None,  # nor is NaN equal to itself
                None,
                at,
            )
            for at, (_, gx, gy, gz), (ax, ay, az), (mx, my, mz), is_later in zip(
                straight.tolist(), rows.tolist(), at_acc.tolist(), at_mag.tolist(), later.tolist(), strict=True
            )
            if ax == ax and is_later
        ]


def _last_asked(line: bytes) -> bytes:
    """The line from its last question on: what stands before it has lost its end. Empty where there is none."""
    marks = list(_ASKED.finditer(line))
    return line[marks[-1].start() :] if marks else b""
