"""Tell from each sample on its own, with what came before it, whether the hand stands still."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from pbd.pose import Array
from pbd.tracking.live_samples import Sample
from pbd.tracking.rest import REST_S, Rest
from pbd.tracking.stops import ACC_FLOOR, GYR_FLOOR, MERGE_S, MISCALIBRATION, REST_FACTOR, STEADY_ACC, WINDOW_S

CONFIRM_S = 0.2
"""The hand is taken to stand still once it has been quiet and steady for this long."""


class Run:
    """Samples in a row over which every window is quiet, and its mean specific force steady.

    Attributes:
        start_t, last_t: s, of its first and its latest sample.
        start_row, last_row: the same as rows.
        mean_nav, mean_sensor: (3,) m/s2, what its windows are held against: motion acceleration and specific force.
        latest_nav, latest_sensor: (3,) m/s2, of its latest window.
        weight: of the latest window in the mean.
    """

    def __init__(self, first: Sample, last: Sample, mean_nav: Array, mean_sensor: Array) -> None:
        self.start_t, self.start_row = first.t, first.row
        self.last_t, self.last_row = last.t, last.row
        self.mean_nav, self.mean_sensor = mean_nav, mean_sensor
        self.latest_nav, self.latest_sensor = mean_nav, mean_sensor
        self.weight = 0.0

    @property
    def age_s(self) -> float:
        """How long it has lasted."""
        return self.last_t - self.start_t

    @property
    def up_sensor(self) -> Array:
        """The vertical in sensor axes (3,)."""
        up: Array = self.mean_sensor / np.sqrt((self.mean_sensor**2).sum())
        return up

    def unsteadiness(self, mean_nav: Array, mean_sensor: Array) -> float:
        """How far a window is from this run's mean, m/s2, in the axes in which it is nearer (see stops.py)."""
        nav, sensor = mean_nav - self.mean_nav, mean_sensor - self.mean_sensor
        return float(np.sqrt(min((nav**2).sum(), (sensor**2).sum())))


class StopDetector:
    """The energy detector of `find_stops` with the same thresholds, on the window that ends with the latest sample.

    A window is quiet when the spread of acceleration and the energy of angular rate in it are small. Quiet windows
    in a row whose means agree are a run; one that lasts for CONFIRM_S is a candidate for a stop.

    Attributes:
        stop: the run over which the hand is known to stand still, or None. `begin_stop` and `end_stop` set it.
        candidate: a run that is not known to be one, or None.
        still: whether the hand stood still at the latest sample, as part of the stop.
    """

    def __init__(self, rate_hz: float, rest: Rest, has_gyro: bool) -> None:
        self._n = max(2, round(WINDOW_S * rate_hz))
        self._forget = 1.0 / (REST_S * rate_hz)
        self._has_gyro = has_gyro
        self._window = np.zeros((self._n, 9))
        self._samples: deque[Sample] = deque(maxlen=self._n)
        self._count = 0
        self._left_t = -np.inf
        self.stop: Run | None = None
        self.candidate: Run | None = None
        self.still = False
        self.learn(rest)

    def learn(self, rest: Rest) -> None:
        """Take the thresholds from a rest."""
        self._acc_bound = max(REST_FACTOR * rest.acc_rms**2, ACC_FLOOR**2)
        self._gyr_bound = max(REST_FACTOR * rest.gyr_rms**2, GYR_FLOOR**2)
        self._gyro_bias = rest.gyro_bias
        self.tolerance = STEADY_ACC + 3.0 * rest.acc_rms / np.sqrt(self._n)

    def begin(self, samples: Sequence[Sample], a_nav: Array) -> Run:
        """Begin in a stop, with the samples of a rest and their motion acceleration (n, 3)."""
        mean_sensor = np.mean([sample.acc for sample in samples], axis=0)
        for sample, a in zip(samples, a_nav, strict=True):
            self.push(sample, a)
        return self.begin_stop(Run(samples[0], samples[-1], a_nav.mean(axis=0), mean_sensor))

    def push(self, sample: Sample, a_nav: Array) -> None:
        """Take the next sample and its motion acceleration (3,) m/s2."""
        self._samples.append(sample)
        values = self._window[self._count % self._n]
        values[0:3], values[3:6], values[6:9] = a_nav, sample.acc, sample.gyr
        self._count += 1
        if self._count < self._n:
            return
        # Summed anew each time: a running sum would carry its rounding along.
        mean = self._window.sum(axis=0) / self._n
        variance = ((self._window - mean) ** 2).sum(axis=0) / self._n
        quiet = variance[0:3].sum() < self._acc_bound
        if self._has_gyro and quiet:
            quiet = variance[6:9].sum() + ((mean[6:9] - self._gyro_bias) ** 2).sum() < self._gyr_bound
        mean_nav, mean_sensor = mean[0:3], mean[3:6]
        self.still = bool(quiet) and self.stop is not None and self._goes_on(self.stop, sample, mean_nav, mean_sensor)
        if self.still or not quiet or any(seen.unseen for seen in self._samples):
            self.candidate = None
        elif self.candidate is None or not self._goes_on(self.candidate, sample, mean_nav, mean_sensor):
            first = self._samples[0]
            after_stop = first.t > (self._left_t if self.stop is None else self.stop.last_t)
            self.candidate = Run(first, sample, mean_nav, mean_sensor) if after_stop else None

    def _goes_on(self, run: Run, sample: Sample, mean_nav: Array, mean_sensor: Array) -> bool:
        if run.unsteadiness(mean_nav, mean_sensor) >= self.tolerance:
            return False
        run.last_t, run.last_row = sample.t, sample.row
        run.latest_nav, run.latest_sensor = mean_nav, mean_sensor
        # A stop's mean is that of its last second. A candidate is held against its first window, which tells a slow
        # change best, and weighs what comes after nothing.
        run.weight = max(run.weight / (1.0 + run.weight), self._forget) if run.weight > 0.0 else 0.0
        run.mean_nav = run.mean_nav + run.weight * (mean_nav - run.mean_nav)
        run.mean_sensor = run.mean_sensor + run.weight * (mean_sensor - run.mean_sensor)
        return True

    @property
    def confirmed(self) -> bool:
        """Whether the candidate has lasted long enough."""
        return self.candidate is not None and self.candidate.age_s >= CONFIRM_S - 1e-6

    @property
    def only_jolted(self) -> bool:
        """Whether the candidate is the stop itself after a jolt: soon after it, and as it was."""
        if self.stop is None or self.candidate is None or self.candidate.start_t - self.stop.last_t >= MERGE_S:
            return False
        off = self.candidate.unsteadiness(self.stop.mean_nav, self.stop.mean_sensor)
        tilted = self.candidate.up_sensor - self.stop.up_sensor
        return off < float(self.tolerance + MISCALIBRATION * np.sqrt((tilted**2).sum()))

    def left(self, t: float) -> bool:
        """Whether the stop is over at `t`: for longer than a jolt and the window that tells its end."""
        return self.stop is not None and t - self.stop.last_t > MERGE_S + WINDOW_S and not self.only_jolted

    def begin_stop(self, candidate: Run) -> Run:
        """The candidate is a stop, or goes on with the one before it."""
        if self.stop is not None:
            candidate.start_t, candidate.start_row = self.stop.start_t, self.stop.start_row
        # Its first window may hold the end of the move.
        candidate.mean_nav, candidate.mean_sensor = candidate.latest_nav, candidate.latest_sensor
        candidate.weight = 1.0 / self._n
        self.stop, self.candidate, self.still = candidate, None, True
        return candidate

    def end_stop(self) -> None:
        """The hand has left the stop."""
        if self.stop is not None:
            self._left_t = self.stop.last_t
        self.stop = None
