"""Rows as a port delivers them, made into the regular samples that a filter with one interval can take."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbd.pose import Array
from pbd.tracking.conditioning import BRIDGED_S, CLOCK_JUMP_S, LARGEST


@dataclass(frozen=True, eq=False)
class Sample:
    """One sample, all of it known.

    Attributes:
        row: which of the rows fed it is, from 0; of a sample put back, the row after it.
        t: s.
        acc: (3,) m/s2, specific force.
        gyr: (3,) rad/s; zeros where there is no gyro.
        mag: (3,) uT, or None where this row has none.
        device_rpy: (3,) rad, or None.
        unseen: put back into a gap that is too long to be bridged: a guess.
    """

    row: int
    t: float
    acc: Array
    gyr: Array
    mag: Array | None = None
    device_rpy: Array | None = None
    unseen: bool = False


class Conditioner:
    """Leaves out what can't be a sample and puts lost samples back, as `condition` does with a whole recording.

    A row without a number counts as lost. Up to 50 ms are bridged; what is put back into a longer gap is marked.

    Attributes:
        interval: s, what a regular sensor's samples are apart; set it once it is known, gaps are filled from then on.
        lost: how many samples were put back.
    """

    def __init__(self) -> None:
        self.interval: float | None = None
        self.lost = 0
        self._row = -1
        self._last: Sample | None = None
        self._clock_wrong = False

    def take(
        self, t: float, acc: Array | None, gyr: Array | None, mag: Array | None, device_rpy: Array | None
    ) -> tuple[list[Sample], str]:
        """Take the next row; return the samples that it completes, and what is wrong with it (or "")."""
        self._row += 1
        if not np.isfinite(t):
            return [], f"the time of row {self._row} is not a number; the row is left out"
        last = self._last
        if last is not None and (t < last.t or t - last.t > CLOCK_JUMP_S):
            told, self._clock_wrong = self._clock_wrong, True
            what = "runs backwards" if t < last.t else "jumps"
            message = (
                f"time {what} from {last.t:.3f} s to {t:.3f} s (row {self._row}); rows are left out until it goes on "
                "from there; if it doesn't, start again"
            )
            return [], "" if told else message
        self._clock_wrong = False
        motion = (acc, device_rpy if gyr is None else gyr)
        if (last is not None and t == last.t) or not all(_known(values) for values in motion):
            return [], ""
        sample = Sample(
            self._row,
            t,
            np.array(acc, dtype=np.float64),
            np.zeros(3) if gyr is None else np.array(gyr),
            np.array(mag) if mag is not None and _known(mag) and mag.any() else None,  # all zero: none there
            None if device_rpy is None else np.array(device_rpy),
        )
        self._last = sample
        if last is None or self.interval is None:
            return [sample], ""
        return self._bridged(last, sample, self.interval)

    def _bridged(self, last: Sample, sample: Sample, interval: float) -> tuple[list[Sample], str]:
        steps = max(round((sample.t - last.t) / interval), 1)
        missing_s = sample.t - last.t - interval
        unseen = missing_s > BRIDGED_S + 1e-6
        self.lost += steps - 1
        put_back = [
            replace(
                sample,
                t=last.t + k / steps * (sample.t - last.t),
                acc=_between(last.acc, sample.acc, k / steps),
                gyr=_between(last.gyr, sample.gyr, k / steps),
                mag=None,
                device_rpy=last.device_rpy,
                unseen=unseen,
            )
            for k in range(1, steps)
        ]
        wrong = f"{1e3 * missing_s:.0f} ms of data are missing before row {sample.row} (t = {sample.t:.2f} s)"
        return [*put_back, sample], wrong if unseen else ""


def _known(values: Array | None) -> bool:
    """Whether these are numbers that a sensor can read (NaN compares false)."""
    return values is not None and bool((np.abs(values) < LARGEST).all())


def _between(before: Array, after: Array, share: float) -> Array:
    values: Array = before + share * (after - before)
    return values
