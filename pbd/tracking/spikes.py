"""Wild samples: one row that no hand can have made, between neighbours that know nothing of it."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.errors import PbdWarning
from pbd.pose import Array

UNITS = {"acc": ("accelerometer", "m/s2"), "gyr": ("gyro", "rad/s")}

AWAY = {"acc": 30.0, "gyr": 5.0}
"""m/s2 and rad/s: a wild sample lies at least this far outside all its neighbours ..."""

ALONE = {"acc": 10.0, "gyr": 4.0}
"""... and so many times as far as they change from one to the next, on any axis: after a real impact they do.
The largest of the feet in the data folder are 5 and 2 times as far, at 68, 102 and 205 Hz."""

NEIGHBOURS = 3
"""On either hand; as many where the recording ends."""


def without_spikes(recording: Recording) -> Recording:
    """Put wild samples of accelerometer and gyro between their neighbours; warns where there are any."""
    mended: dict[str, Array] = {}
    found: list[tuple[int, str]] = []
    for name, (sensor, unit) in UNITS.items():
        values = getattr(recording, name)
        if values is None or len(values) <= 2 * NEIGHBOURS:
            continue
        wild = _wild(values, AWAY[name], ALONE[name])
        if len(wild):
            before, after = np.abs(wild - 1), np.where(wild + 1 < len(values), wild + 1, wild - 1)
            mended[name] = values.copy()
            mended[name][wild] = 0.5 * (values[before] + values[after])
            found += [(int(row), f"{sensor} {np.abs(values[row]).max():.4g} {unit}") for row in wild]
    if not found:
        return recording
    row, what = min(found)
    samples = "1 impossible sample" if len(found) == 1 else f"{len(found)} impossible samples"
    warnings.warn(
        f"{samples} left out (no hand moves like that); the first is row {row} (t = {recording.t[row]:.2f} s): {what}",
        PbdWarning,
        stacklevel=3,
    )
    return dataclasses.replace(recording, acc=mended.get("acc", recording.acc), gyr=mended.get("gyr", recording.gyr))


def _wild(values: Array, away: float, alone: float) -> NDArray[np.intp]:
    """Rows of (n, 3) at which an axis is far outside all its neighbours, which hardly change."""
    jumps = (np.abs(np.diff(values, axis=0)) > away).any(axis=1)
    candidates = np.flatnonzero(np.append(jumps, True) & np.append(True, jumps))
    first = np.clip(candidates - NEIGHBOURS, 0, len(values) - 2 * NEIGHBOURS - 1)
    place = np.arange(2 * NEIGHBOURS)[:, None]
    around = values[first + place + (first + place >= candidates)]  # all but the candidate itself
    outside = np.maximum(values[candidates] - around.max(axis=0), around.min(axis=0) - values[candidates]).max(axis=1)
    change = np.abs(np.diff(around, axis=0)).max(axis=(0, 2), initial=0.0)
    wild: NDArray[np.intp] = candidates[(outside > away) & (outside > alone * change)]
    return wild
