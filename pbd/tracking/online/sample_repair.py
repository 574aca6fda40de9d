"""Make regular samples of the rows that a port delivers: leave out bad rows, fill gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from pbd.data import SensorErrors
from pbd.pose import Array
from pbd.timestamps.even_times import even_times
from pbd.timestamps.stamper import Stamper
from pbd.tracking.first_rest import REST_S
from pbd.tracking.repair.clock import CLOCK_JUMP_S, replaced_stamps_message
from pbd.tracking.repair.gaps import BRIDGED_S
from pbd.tracking.repair.units import LARGEST_READING

GAP_ACC, GAP_RATE = 2.0, 1.0
"""One sigma of the motion in a long gap, m/s2 and rad/s. (`pbd.track` refuses such a gap in a move.)"""

INCOMPLETE_S = 2.0
"""Rows that lack numbers for longer than this, s, are reported: the hand is not tracked meanwhile. A choice."""

JUDGED_ROWS = 128
"""After this many rows it is judged anew whether their times jitter. It is above FEW_DELAYS of `even_times`, so that
samples taken at uneven times are told from jitter."""


@dataclass(frozen=True, eq=False)
class RepairedSample:
    """One sample without missing numbers.

    Attributes:
        row: index of the row that was fed, from 0; if the sample fills a gap, the row after it.
        t: s.
        acc: (3,) m/s2, specific force.
        gyr: (3,) rad/s; zeros without a gyro.
        mag: (3,) uT, or None if this row has none.
        device_rpy: (3,) rad, or None.
        unseen: it fills a gap that is too long to be interpolated.
        gap_noise: rad2/s and m2/s3, noise densities that stand for the unknown motion in a gap.
        read: `gyr` and `acc` as they were read, if a calibration has corrected them since.
    """

    row: int
    t: float
    acc: Array
    gyr: Array
    mag: Array | None = None
    device_rpy: Array | None = None
    unseen: bool = False
    gap_noise: tuple[float, float] = (0.0, 0.0)
    read: tuple[Array, Array] | None = None

    @property
    def readings(self) -> tuple[Array, Array]:
        """`gyr` and `acc` as they were read: clipping and rounding show there."""
        return self.read or (self.gyr, self.acc)

    def corrected(self, errors: SensorErrors | None) -> RepairedSample:
        """The sample without the sensor's errors."""
        if errors is None:
            return self
        gyr, acc, mag = errors.gyr, errors.acc, errors.mag
        return replace(
            self,
            gyr=self.gyr if gyr is None else gyr.correct(self.gyr),
            acc=self.acc if acc is None else acc.correct(self.acc),
            mag=self.mag if mag is None or self.mag is None else mag.correct(self.mag),
            read=self.readings,
        )


class _Row(NamedTuple):
    """A row as fed: its number and what it has, (3,) each, or None."""

    number: int
    acc: Array | None
    gyr: Array | None
    mag: Array | None
    device_rpy: Array | None


class SampleRepair:
    """Leaves out bad rows and fills gaps, as `repair_recording` does in a whole recording.

    A row with a missing number counts as lost. Gaps of up to 50 ms are interpolated. Samples that fill a longer gap are
    marked as unseen. Rows are held back until those of a second show whether their times jitter. If they do, or begin
    to, `Stamper` gives the times from then on.
    """

    def __init__(self, *, straightened: bool = False) -> None:
        """Begin; `straightened` as for `LiveTracker`. Gaps are filled once the sampling interval is set."""
        self._straightened = straightened
        self._stamper: Stamper[_Row] | None = None
        self._times: list[float] = []  # of the latest rows, s, by which it is judged whether times jitter
        self._held: list[_Row] = []  # until it is judged for the first time
        self.interval: float | None = None  # s
        self._count = 0
        self._row = _Row(-1, None, None, None, None)  # the latest
        self._t = self._given_t = np.nan  # s, of the latest row: as fed, and as it was given to `_sample`
        self._late = 0.0  # s, largest lateness of the times before they were straightened
        self._last: RepairedSample | None = None
        self._clock_wrong = False
        self._incomplete = False

    def take(
        self, t: float, acc: Array | None, gyr: Array | None, mag: Array | None, device_rpy: Array | None
    ) -> tuple[list[RepairedSample], list[str]]:
        """Take the next row; return the samples that are known now, and what is wrong, in words."""
        number, self._count = self._count, self._count + 1
        if not np.isfinite(t):
            return [], [f"the time of row {number} is not a number; the row is left out"]
        if t < self._t or t - self._t > CLOCK_JUMP_S:
            was_wrong, self._clock_wrong = self._clock_wrong, True
            what = "runs backwards" if t < self._t else "jumps"
            message = (
                f"time {what} from {self._t:.3f} s to {t:.3f} s (row {number}); rows are left out until it is at "
                f"{self._t:.3f} s again; if it never is, start again"
            )
            return [], [] if was_wrong else [message]
        self._clock_wrong = False
        before, self._row = self._row, _Row(number, acc, gyr, mag, device_rpy)
        if t == self._t and _repeats(before, self._row):
            return [], []
        self._t = t
        samples: list[RepairedSample] = []
        stamped, faults = self._stamp(t, self._row)
        for at, row in stamped:
            more, wrong = self._sample(at, row)
            samples += more
            faults += wrong
        return samples, faults

    def _stamp(self, t: float, row: _Row) -> tuple[list[tuple[float, _Row]], list[str]]:
        """Take the next row, of t s; return (time in s, row) of those whose time is known now, and what is wrong."""
        stamped: list[tuple[float, _Row]] = []
        faults: list[str] = []
        if not self._straightened:
            is_first = np.isnan(self._given_t)
            if self._times and (t - self._times[0] >= REST_S if is_first else len(self._times) == JUDGED_ROWS):
                stamped, faults = self._judge()
                is_first = False
            if not self._straightened:
                self._times.append(t)
            if is_first:
                self._held.append(row)
                return [], []
        stamped += [(t, row)] if self._stamper is None else self._stamper.stamp(row, t)
        return stamped, faults

    def _judge(self) -> tuple[list[tuple[float, _Row]], list[str]]:
        """If the latest rows' times jitter, straighten these and all that follow."""
        even, fault = even_times(np.array(self._times))
        times, self._times = self._times, []
        held, self._held = self._held, []
        if not fault:
            return list(zip(times, held, strict=False)), []
        self._straightened, self._stamper = True, Stamper()
        stamped = [each for t, row in zip_longest(times, held) for each in self._stamper.stamp(row, t)]
        if not held:  # each has its time already, and was late by up to so much
            stamped += self._stamper.release()
            self._late = max(t - at for t, (at, _) in zip(times, stamped, strict=True))
        return stamped if held else [], [replaced_stamps_message(fault, even)]

    def _sample(self, t: float, row: _Row) -> tuple[list[RepairedSample], list[str]]:
        """The samples that a row gives at t s, and what is wrong."""
        if t <= self._given_t:  # two samples can't have the same time; straightened times may begin earlier
            return [], []
        self._given_t = t
        last, (number, acc, gyr, mag, device_rpy) = self._last, row
        motion = {"acc": acc, **({"device_rpy": device_rpy} if gyr is None else {"gyr": gyr})}
        if lost := [name for name, values in motion.items() if not _known(values)]:
            if self._incomplete or last is None or t - last.t < INCOMPLETE_S:
                return [], []
            self._incomplete = True
            what = f"the rows since {last.t:.3f} s lack numbers in {' and '.join(lost)}"
            return [], [f"{what}; the hand is not tracked until they come again"]
        self._incomplete = False
        sample = RepairedSample(
            number,
            t,
            np.array(acc, dtype=np.float64),
            np.zeros(3) if gyr is None else np.array(gyr),
            np.array(mag) if mag is not None and _known(mag) and mag.any() else None,  # all zero: no reading
            None if device_rpy is None else np.array(device_rpy),
        )
        self._last = sample
        if last is None or self.interval is None:
            return [sample], []
        return self._bridged(last, sample, self.interval)

    def _bridged(
        self, last: RepairedSample, sample: RepairedSample, interval: float
    ) -> tuple[list[RepairedSample], list[str]]:
        lasts = sample.t - last.t
        steps = max(round(lasts / interval), 1)
        late, self._late = self._late, 0.0
        if steps == 1 and not late:
            return [sample], []
        missing_s = lasts - interval
        unseen = missing_s > BRIDGED_S + 1e-6
        # In a short gap the motion is between its neighbours'; in a long gap a hand may do anything. Among straightened
        # times the place of a short gap is not known well, so the motion in it is as unknown.
        turn, push = (float(((b - a) ** 2).sum()) / 12.0 for a, b in ((last.gyr, sample.gyr), (last.acc, sample.acc)))
        if unseen or self._straightened:
            turn, push = GAP_RATE**2, GAP_ACC**2
        sample = replace(sample, gap_noise=(turn * (lasts + late), push * (lasts + late)))
        put_back = [
            replace(
                sample,
                t=last.t + k / steps * lasts,
                acc=last.acc + k / steps * (sample.acc - last.acc),
                gyr=last.gyr + k / steps * (sample.gyr - last.gyr),
                mag=None,
                device_rpy=last.device_rpy,
                unseen=unseen,
            )
            for k in range(1, steps)
        ]
        wrong = (
            f"{1e3 * missing_s:.0f} ms of data are missing before row {sample.row} (t = {sample.t:.2f} s): if the hand "
            "moved, record again"
        )
        return [*put_back, sample], [wrong] if unseen else []


def _repeats(before: _Row, row: _Row) -> bool:
    return np.array_equal(before.acc, row.acc) and np.array_equal(before.gyr, row.gyr)  # type: ignore[arg-type]


def _known(values: Array | None) -> bool:
    """Whether these are readings (3,) that a sensor can give (False for NaN). With numpy it takes ten times as long."""
    return values is not None and all(-LARGEST_READING < value < LARGEST_READING for value in values.tolist())
