"""Make regular samples of the rows that a port delivers: leave out bad rows, fill gaps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.pose import Array
from pbd.timestamps.sample_clock import Stamper
from pbd.tracking.repair.clock import CLOCK_JUMP_S
from pbd.tracking.repair.gaps import BRIDGED_S
from pbd.tracking.repair.units import LARGEST_READING

GAP_ACC, GAP_RATE = 2.0, 1.0
"""One sigma of the motion in a long gap, m/s2 and rad/s. (`pbd.track` refuses such a gap in a move.)"""

INCOMPLETE_S = 2.0
"""Rows that lack numbers for longer than this, s, are reported: the hand is not tracked meanwhile. A choice."""


@dataclass(frozen=True, eq=False)
class Sample:
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
    """

    row: int
    t: float
    acc: Array
    gyr: Array
    mag: Array | None = None
    device_rpy: Array | None = None
    unseen: bool = False
    gap_noise: tuple[float, float] = (0.0, 0.0)


class SampleRepair:
    """Leaves out bad rows and fills gaps, as `repair_recording` does in a whole recording.

    A row with a missing number counts as lost. Gaps of up to 50 ms are interpolated. Samples that fill a longer gap are
    marked as unseen. Times are those of the rows until `begin` knows whether they jitter.
    """

    def __init__(self) -> None:
        self._interval: float | None = None
        self._row = -1
        self._t = -np.inf  # s, of the last row, as fed
        self._stamper: Stamper | None = None
        self._first_t = 0.0  # s, of the stamper's first sample
        self._last: Sample | None = None
        self._clock_wrong = False
        self._incomplete = False

    def begin(self, samples: Sequence[Sample], *, jitter: bool) -> None:
        """From now on fill gaps, with the interval of these samples; if the rows' times jitter, continue theirs."""
        self._interval = float(np.median(np.diff([sample.t for sample in samples])))
        if jitter:
            self._stamper = Stamper([sample.t for sample in samples])
            self._first_t, self._last = samples[0].t, samples[-1]

    def take(
        self, t: float, acc: Array | None, gyr: Array | None, mag: Array | None, device_rpy: Array | None
    ) -> tuple[list[Sample], str]:
        """Take the next row; return the samples that it gives, and its fault in words (or "")."""
        self._row += 1
        if not np.isfinite(t):
            return [], f"the time of row {self._row} is not a number; the row is left out"
        last = self._last
        if last is not None and (t < self._t or t - self._t > CLOCK_JUMP_S):
            was_wrong, self._clock_wrong = self._clock_wrong, True
            what = "runs backwards" if t < self._t else "jumps"
            message = (
                f"time {what} from {self._t:.3f} s to {t:.3f} s (row {self._row}); rows are left out until it is at "
                f"{self._t:.3f} s again; if it never is, start again"
            )
            return [], "" if was_wrong else message
        self._clock_wrong = False
        if last is not None and t == self._t and (self._is_timed or _repeats(last, acc, gyr)):
            return [], ""
        self._t = t
        if self._stamper is not None:
            t = self._first_t + self._stamper.stamp(t)
        motion = {"acc": acc, **({"device_rpy": device_rpy} if gyr is None else {"gyr": gyr})}
        if lost := [name for name, values in motion.items() if not _known(values)]:
            if self._incomplete or last is None or t - last.t < INCOMPLETE_S:
                return [], ""
            self._incomplete = True
            what = f"the rows since {last.t:.3f} s lack numbers in {' and '.join(lost)}"
            return [], f"{what}; the hand is not tracked until they come again"
        self._incomplete = False
        sample = Sample(
            self._row,
            t,
            np.array(acc, dtype=np.float64),
            np.zeros(3) if gyr is None else np.array(gyr),
            np.array(mag) if mag is not None and _known(mag) and mag.any() else None,  # all zero: no reading
            None if device_rpy is None else np.array(device_rpy),
        )
        self._last = sample
        if last is None or self._interval is None:
            return [sample], ""
        return self._bridged(last, sample, self._interval)

    @property
    def _is_timed(self) -> bool:
        """Whether each row's own time is its sample's, so that rows of one time can't be two samples."""
        return self._interval is not None and self._stamper is None

    def _bridged(self, last: Sample, sample: Sample, interval: float) -> tuple[list[Sample], str]:
        lasts = sample.t - last.t
        steps = max(round(lasts / interval), 1)
        if steps == 1:
            return [sample], ""
        missing_s = lasts - interval
        unseen = missing_s > BRIDGED_S + 1e-6
        # In a short gap the motion is between its neighbours'; in a long gap a hand may do anything. In straightened
        # times a gap is noticed late, so the motion in it is as unknown.
        turn, push = (float(((b - a) ** 2).sum()) / 12.0 for a, b in ((last.gyr, sample.gyr), (last.acc, sample.acc)))
        if unseen or self._stamper is not None:
            turn, push = GAP_RATE**2, GAP_ACC**2
        sample = replace(sample, gap_noise=(turn * lasts, push * lasts))
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
        return [*put_back, sample], wrong if unseen else ""


def _repeats(last: Sample, acc: Array | None, gyr: Array | None) -> bool:
    return np.array_equal(last.acc, acc) and (gyr is None or np.array_equal(last.gyr, gyr))  # type: ignore[arg-type]


def _known(values: Array | None) -> bool:
    """Whether these are readings (3,) that a sensor can give (False for NaN). With numpy it takes ten times as long."""
    return values is not None and all(-LARGEST_READING < value < LARGEST_READING for value in values.tolist())
