"""Rows that came twice: a program that lost its place in a buffer sends a block again."""

from __future__ import annotations

import numpy as np

from pbd.data import Recording
from pbd.errors import RecordingError
from pbd.tracking.channels import noisy
from pbd.tracking.zero_velocity import runs

LEAST_ROWS = 6
"""So many different rows that say to the last digit what so many others said are no chance: noise changes each one."""


def refuse_doubled(recording: Recording) -> None:
    """Refuse a recording in which a block of rows comes again.

    Raises:
        RecordingError: which rows.
    """
    given = [values for values in (recording.acc, recording.gyr) if values is not None]
    rows = np.hstack(given)
    # Equal rows have equal sums, whatever the weights; of irrational ones no others do.
    sums = rows @ np.sqrt(np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])[: rows.shape[1]])
    order = np.argsort(sums)
    equal = np.diff(sums[order]) == 0.0
    doubles = np.sort(order[np.append(equal, False) | np.append(False, equal)])
    if len(doubles) < LEAST_ROWS:
        return
    order = doubles[np.argsort(sums[doubles], kind="stable")]
    same = np.flatnonzero(np.diff(sums[order]) == 0.0)
    first, again = order[same], order[same + 1]
    apart = np.zeros(len(rows), dtype=np.intp)
    changed = np.concatenate(([True], np.diff(rows, axis=0).any(axis=1)))
    apart[first] = np.where(changed[first], again - first, 0)
    # Of a block that comes again, each row has its double equally far away.
    goes_on = (np.diff(apart) == 0) & (apart[1:] > 1)
    for start, stop in runs(goes_on):
        far = int(apart[start])
        if far < LEAST_ROWS or len(np.unique(sums[start : stop + 1])) < LEAST_ROWS:
            continue
        if noisy(recording.acc):
            raise RecordingError(
                f"rows {start + far} to {stop + far} (from t = {recording.t[start + far]:.2f} s) say what rows {start} "
                f"to {stop} said: a block came twice, so the times after it are wrong; record again",
                row=start + far,
                t=float(recording.t[start + far]),
            )
