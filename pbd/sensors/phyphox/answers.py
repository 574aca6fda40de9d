"""Decoder of phyphox' answers over HTTP. The stream is lines of a request and its JSON answer: `/get {...}`.

Source: phyphox' documentation of its remote interface (github.com/phyphox/phyphox-docs, docs/remote-interface) and the
app's own RemoteServer.java. `/get` returns buffers of numbers with 8 digits, `null` for one that is not finite. `/time`
returns the events at which the measurement was started and paused. Experiment time stops in a pause, and restarts from
zero when the data are cleared; the events tell how long that took.

The phone's axes: x right, y to the top of the screen, z out of it. Android and iOS both give +g up at rest.
"""

import json
import re
from math import inf
from typing import Any

import numpy as np

from pbd.data.paused_clock import ClockEvent, PausedClock
from pbd.data.streams import Stream
from pbd.pose import Array
from pbd.sensors.decoding import Sample, Tally

BUFFERS = {
    "gyr": ("gyr_time", "gyrX", "gyrY", "gyrZ"),
    "acc": ("acc_time", "accX", "accY", "accZ"),
    "mag": ("mag_time", "magX", "magY", "magZ"),
}
"""Names of the experiment's buffers: each sensor's time, then its three axes."""

LARGEST_READING = {"gyr": 200.0, "acc": 2000.0, "mag": 1e5}
"""Largest plausible reading, rad/s, m/s2 and uT. No phone measures more."""

MAX_RUN_S = 1e5
"""Largest experiment time, s. Above it, the 8 digits of an answer no longer resolve a millisecond."""

MAX_STEP_S = 0.5
"""Longest step of a sensor's time that needs no confirmation, s. The slowest magnetometers give 5 samples a second."""

_REQUEST = re.compile(rb"/get |/time ")
LONGEST_ANSWER = 16_000_000
"""Largest answer, bytes. All buffers of the experiment together are 10 MB when full."""


def read_answer(text: bytes) -> dict[str, Any] | list[Any]:
    """Parse an answer's JSON; ValueError: it is incomplete, nested too deeply, or neither an object nor a list."""
    import orjson

    try:
        answer = orjson.loads(text)  # three times as fast as json
    except ValueError:
        try:
            answer = json.loads(text, parse_constant=lambda _: None)  # NaN is not valid JSON, but may come
        except RecursionError:
            raise ValueError("nested too deeply") from None
    if not isinstance(answer, dict | list):
        raise ValueError("neither buffers nor clock events")
    return answer


def read_clock_events(answer: object) -> tuple[ClockEvent, ...]:
    """Read the answer to `/time`, oldest event first; ValueError: it is not such an answer."""
    try:
        events = tuple(
            ClockEvent(each["event"] == "START", each["experimentTime"], each["systemTime"])
            for each in answer  # type: ignore[attr-defined]
        )
        plain = all(0.0 <= each.t < inf and abs(each.system) < 1e12 for each in events)
    except (TypeError, KeyError) as reason:
        raise ValueError("no clock events") from reason
    if not plain:
        raise ValueError("a clock event without a time")
    return events


def read_buffers(answer: object) -> dict[str, Array]:
    """Read the answer to `/get`: for each sensor (n, 4) of time and axes; ValueError: another answer."""
    try:
        buffers = answer["buffer"]  # type: ignore[index]
        sent = {kind: names for kind, names in BUFFERS.items() if names[0] in buffers}
        columns = {kind: [buffers[name]["buffer"] for name in names] for kind, names in sent.items()}
        n = {kind: min(map(len, axes)) for kind, axes in columns.items()}  # an answer's buffers start at the same row
        return {kind: np.array([_floats(axis, n[kind]) for axis in axes]).T for kind, axes in columns.items()}
    except (TypeError, KeyError, OverflowError) as reason:
        raise ValueError("no buffers") from reason


def trusted_rows(t: Array, last: float) -> list[int]:
    """Indices of a sensor's times (n,) s that plausibly follow its `last` time.

    Each must be later than the one before. A step above MAX_STEP_S counts only if the next time confirms it. Otherwise
    it is left out here; the phone keeps the row and sends it again with the next request.
    """
    rows: list[int] = []
    for k, time in enumerate(times := t.tolist()):
        confirmed = time - last <= MAX_STEP_S or (k + 1 < len(times) and 0.0 < times[k + 1] - time <= MAX_STEP_S)
        if time > last and confirmed:
            rows.append(k)
            last = time
    return rows


def _floats(axis: list[Any], n: int) -> list[float]:
    numbers = axis[:n]
    if not set(map(type, numbers)) <= {float, int, type(None)}:
        raise ValueError("a buffer holds something else than numbers")
    return [np.nan if number is None else float(number) for number in numbers]


class PhyphoxDecoder:
    """Makes a sample at each gyro sample (without a gyro: at each accelerometer sample); times in s since the start."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""
        self._clock = PausedClock()
        self._latest = -inf
        self._begin()

    def _begin(self) -> None:
        self._rows = dict.fromkeys(BUFFERS, np.empty((0, 4)))  # of each sensor those that may still be needed
        self._last = dict.fromkeys(BUFFERS, -inf)
        self._first, self._last_t = inf, -inf

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        longer = len(self._rest) + len(data)
        if self._rest[:1] == b"/" and longer <= LONGEST_ANSWER and b"\n" not in data and b"/" not in data:
            self._rest += data  # the middle of an answer: no line ends or begins here
            return []
        *lines, rest = (self._rest + data).split(b"\n")
        samples: list[Sample] = []
        for line in lines:
            if line := _from_last_request(line):
                self._read_line(line, samples)
        self._rest = _from_last_request(rest)[:LONGEST_ANSWER] or rest[-len(b"/time") :]
        return samples

    def _read_line(self, line: bytes, samples: list[Sample]) -> None:
        request, _, text = line.partition(b" ")
        try:
            answer = read_answer(text)
            if request == b"/get":
                self._add(read_buffers(answer))
            elif self._clock.take(read_clock_events(answer)):
                self._begin()
        except ValueError:
            self.tally.bad_packets += 1
            return
        self.tally.packets += 1
        samples += self._samples()

    def _add(self, buffers: dict[str, Array]) -> None:
        for kind, rows in buffers.items():
            plausible = np.isfinite(rows).all(axis=1) & (rows[:, 0] >= 0.0) & (rows[:, 0] < MAX_RUN_S)
            with np.errstate(invalid="ignore"):
                plausible &= (np.abs(rows[:, 1:]) <= LARGEST_READING[kind]).all(axis=1)
            new = rows[plausible]
            new = new[trusted_rows(new[:, 0], self._last[kind])]
            self.tally.bad_packets += len(rows) - len(new)
            if len(new):
                self._rows[kind], self._last[kind] = np.concatenate((self._rows[kind], new)), float(new[-1, 0])

    def _samples(self) -> list[Sample]:
        gyr, acc, mag = (self._rows[kind] for kind in BUFFERS)
        last_gyr, last_acc, last_mag = (self._last[kind] for kind in BUFFERS)
        if not len(acc):
            return []
        self._first = min(self._first, float(acc[0, 0]))
        has_gyr = last_gyr > -inf
        if not has_gyr and last_acc - self._first < 1.0:  # s, after which the phone counts as one without a gyro
            return []
        clock = gyr if has_gyr else acc
        until = min(last_acc, self._clock.paused_at)
        if last_mag > -inf:
            until = min(until, max(last_mag, last_acc - 0.5))  # s at most: the field may come late or stop
        rows = clock[(clock[:, 0] > self._last_t) & (clock[:, 0] <= until)]
        if not len(rows):
            return []
        t = rows[:, 0]
        self._last_t = float(t[-1])
        at_acc, at_mag = (Stream(each[:, 0], each[:, 1:]).at(t) for each in (acc, mag))
        elapsed = self._clock.to_elapsed(t)
        # Clock events are exact to milliseconds only, so around a pause times may step back: drop those samples.
        later = elapsed > np.maximum.accumulate(np.append(self._latest, elapsed[:-1]))
        self._latest = max(self._latest, float(elapsed.max()))
        for kind, each in self._rows.items():
            after = int(np.searchsorted(each[:, 0], self._last_t))
            # Interpolation needs the latest row before, and the median of its intervals is the usual one.
            self._rows[kind] = each[max(after - 100, 0) :]
        return [
            Sample(
                (ax, ay, az),
                (gx, gy, gz) if has_gyr else None,
                (mx, my, mz) if mx == mx else None,  # NaN differs from itself
                None,
                at,
            )
            for at, (_, gx, gy, gz), (ax, ay, az), (mx, my, mz), is_later in zip(
                elapsed.tolist(), rows.tolist(), at_acc.tolist(), at_mag.tolist(), later.tolist(), strict=True
            )
            if ax == ax and is_later
        ]


def _from_last_request(line: bytes) -> bytes:
    """Return the line from its last request on, or nothing without a request. Text before it is incomplete."""
    requests = list(_REQUEST.finditer(line))
    return line[requests[-1].start() :] if requests else b""
