"""The state of a recording under way: samples in, rows on disk, what to show."""

from __future__ import annotations

from collections import deque

import numpy as np

from pbd.data import GripEvent, RecordingInfo
from pbd.files.columns import compass_angles
from pbd.files.growing import GrowingDemo
from pbd.record.coach import Coach
from pbd.record.told import Outcome, RecordOptions, Status
from pbd.sensors.decoding import Decoder, Sample
from pbd.sensors.stamps import Stamper, straighten

LOOK_S = 0.3
"""The first samples are looked at for this long to see which channels there are."""

DEVICE_CLOCK, HOST_CLOCK = "device", "host: arrival times, straightened by a line"


class Session:
    """Decodes, stamps and keeps. Nothing is on disk before the first samples are there."""

    def __init__(self, decoder: Decoder, options: RecordOptions) -> None:
        self.decoder, self.options = decoder, options
        self.coach = Coach(options.tolerance_m)
        self.demo: GrowingDemo | None = None
        self.t = 0.0
        self.samples = 0
        self.lost = 0
        self.closed = False
        self.discarded = False
        self._raw = bytearray()
        self._first: list[tuple[float, Sample]] = []
        self._channels: tuple[str, ...] = ()
        self._rows: list[tuple[float, tuple[float, ...]]] = []
        self._recent: deque[tuple[float, float]] = deque()
        self._stamper = Stamper()
        self._device_zero: float | None = None

    def take(self, data: bytes, arrival: float) -> None:
        """Decode bytes that arrived at `arrival` s; stamp and keep their samples."""
        for sample in self.decoder.feed(data):
            if sample.acc is None:
                continue
            self.t = self._time(sample, arrival)
            self.samples += 1
            if self.demo is None:
                self._first.append((self.t, sample))
            else:
                self._keep(self.t, sample)
        if self.demo is None and self._first and self.t >= LOOK_S:
            self._begin()
        if self.options.raw:
            self._raw += data

    def flush(self) -> None:
        """Write what has come."""
        if self.demo is not None and self._raw:
            self.demo.add_raw(bytes(self._raw))
            self._raw.clear()
        if self.demo is not None and self._rows:
            self.demo.add([t for t, _ in self._rows], [values for _, values in self._rows])
            self._rows.clear()

    def grip(self) -> None:
        """Change the grip, now."""
        if self.demo is not None:
            self.closed = not self.closed
            self.demo.mark(GripEvent(self.t, self.closed))
            self.coach.say(self.t, "grip closed" if self.closed else "grip open")

    def discard(self) -> None:
        """Remove everything."""
        self.discarded = True
        if self.demo is not None:
            self.demo.discard()

    def close(self) -> None:
        """Write what is left, and what is known at the end only: the rate, and times straightened over the whole."""
        if self.demo is None or self.discarded:
            return
        try:
            self.flush()
        finally:
            times = None
            if self._device_zero is None and self.demo.rows == len(self._stamper.arrivals):
                times, self.lost = straighten(np.array(self._stamper.arrivals))
            duration = self.t if times is None else float(times[-1])
            rows = self.demo.rows + self.lost
            self.demo.finish(float(f"{(rows - 1) / duration:.5g}") if duration > 0.0 else None, self._clock, times)

    def status(self) -> Status:
        """Take a picture; what was said is told once."""
        while self._recent and self._recent[0][0] < self.t - 1.0:
            self._recent.popleft()
        span = self.t - self._recent[0][0] if self._recent else 0.0
        norms = [norm for t, norm in self._recent if t > self.t - 0.5]
        tracker = self.coach.tracker
        return Status(
            t=self.t,
            rate_hz=(len(self._recent) - 1) / span if span > 0.0 else 0.0,
            samples=self.samples,
            lost=tracker.lost,
            bad_packets=self.decoder.tally.bad_packets,
            waiting=tracker.waiting,
            moving=tracker.moving,
            stops=self.coach.stops,
            keyframes=tracker.keyframes,
            p_nav_sensor=tracker.p_nav_sensor,
            v_nav_sensor=tracker.v_nav_sensor,
            wxyz_nav_sensor=tracker.wxyz_nav_sensor,
            sigma_m=tracker.sigma_now,
            sigma_of_move_m=tracker.sigma_of_move,
            tremble=float(np.std(norms)) if norms else 0.0,
            closed=self.closed,
            said=self.coach.said(),
        )

    def outcome(self, ended_by: str) -> Outcome:
        """How it ended."""
        folder = None if self.discarded or self.demo is None else self.options.folder
        lost = self.lost or self.coach.tracker.lost
        return Outcome(folder, self.samples, self.t, lost, self.coach.stops, ended_by)

    @property
    def _clock(self) -> str:
        return HOST_CLOCK if self._device_zero is None else DEVICE_CLOCK

    def _time(self, sample: Sample, arrival: float) -> float:
        stamped = self._stamper.stamp(arrival)
        if sample.t_device is None:
            return stamped
        if self._device_zero is None:
            self._device_zero = sample.t_device
        t = sample.t_device - self._device_zero
        if t < self.t:  # the device has begun anew: go on by the host's clock
            self._device_zero = sample.t_device - max(stamped, self.t)
            t = sample.t_device - self._device_zero
        return t

    def _begin(self) -> None:
        seen = [sample for _, sample in self._first]
        given = {"gyr": any(s.gyr for s in seen), "acc": True, "mag": any(s.mag for s in seen)}
        given["device"] = any(s.rpy for s in seen)
        self._channels = tuple(name for name, there in given.items() if there)
        options = self.options
        info = RecordingInfo(sensor=options.sensor, created=options.created, clock=self._clock)
        self.demo = GrowingDemo(options.folder, info, self._channels, options.closed, options.force)
        for t, sample in self._first:
            self._keep(t, sample)
        self._first.clear()
        self.flush()

    def _keep(self, t: float, sample: Sample) -> None:
        assert sample.acc is not None
        device = None if sample.rpy is None else compass_angles(np.array([sample.rpy]))[0]
        of = {"gyr": sample.gyr, "acc": sample.acc, "mag": sample.mag, "device": device}
        nothing = (np.nan, np.nan, np.nan)
        given = [nothing if of[name] is None else of[name] for name in self._channels]
        self._rows.append((t, tuple(float(value) for triple in given for value in triple)))  # type: ignore[union-attr]
        self._recent.append((t, float(np.linalg.norm(sample.acc))))
        self.coach.feed(t, sample)
