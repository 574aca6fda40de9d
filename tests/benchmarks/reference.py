"""How much of the windows' error is the reference's own: python tests/benchmarks/reference.py [--data DIR] [--json].

A window is tracked from one velocity of the optics to another, and that is the slope of a polynomial through their
positions: an error of it, e at the one and f at the other end of T seconds, moves even a perfect tracker by T (e + f) /
2. How large it is, a better velocity tells: the accelerometer's, integrated, with the slope of what the optics say
beyond it over FUSED_S (the hand moves much in that time, the tracker's error little). At the sensor, 40 Hz, cm, median
/ 95th percentile:

- `scored`: as tracking.py does;
- `perfect`: what a tracker without any error would score;
- `fused`: our tracker, from and to the better velocity.

And `velocity_cm_s`: the root mean square, along each axis and over all samples in motion, of what the two differ by.
"""

import sys
import warnings
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from scipy.signal import savgol_filter

from pbd.errors import PbdError, PbdWarning
from pbd.pose import Array, quat_about_z, quat_rotate
from pbd.tracking.smoother.preintegration import integral_of_means, integral_of_values
from tests.benchmarks.report import add_data, arguments, finish
from tests.benchmarks.tracking import spread
from tests.benchmarks.trials import RATES, Trial, at_sensor, filled, fit_lever, kind_of, read_broad
from tests.benchmarks.windows import Motion, heading_off, motion_of, window_errors

RATE = "40"

FUSED_S = 0.6
"""From 0.4 to 0.8 s the figures change by a tenth."""


def main() -> None:
    """Score and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    errors: dict[tuple[str, int, str], list[float]] = defaultdict(list)
    found: dict[str, Any] = {"velocity_cm_s": {}}
    for file in sorted((args.data / "broad").glob("*.npz")):
        try:
            scores, off = of_trial(read_broad(file))
        except PbdError as why:
            found.setdefault("refused", {})[file.stem] = why.message
            continue
        for length, name, error in scores:
            errors[kind_of(file.stem), length, name].append(100.0 * float(np.linalg.norm(error)))
        found["velocity_cm_s"][file.stem] = 100.0 * off
    for (kind, length, name), values in sorted(errors.items()):
        found.setdefault(kind, {}).setdefault(str(length), {})[name] = spread(values, "")
    finish(found, args.json)


def of_trial(trials: dict[str, Trial]) -> tuple[list[tuple[int, str, Array]], float]:
    """Each window's length in s, the score's name and the displacement's error (3,) m; and the velocity's, m/s."""
    finest = motion_of(trials["286"])
    lever = fit_lever(trials["286"], [w for w in window_errors(trials["286"], finest) if w.length == 1])
    trial = at_sensor(trials[RATE], lever)
    every = RATES[RATE]
    fused = fused_velocity(at_sensor(trials["286"], lever), finest)[every // 2 :: every][: len(trial.recording)]
    motion = motion_of(trials[RATE])
    found = []
    for window in window_errors(trial, motion):
        ends = (trial.v_true - fused)[[window.start, window.end]]
        found.append((int(window.length), "scored", window.error))
        if np.isfinite(ends).all():
            found.append((int(window.length), "perfect", 0.5 * window.length * ends.sum(axis=0)))
    fused_windows = window_errors(replace(trial, v_true=fused), motion)
    found.extend((int(window.length), "fused", window.error) for window in fused_windows)
    return found, float(np.sqrt(np.nanmean((trial.v_true - fused)[trial.moving] ** 2)))


def fused_velocity(trial: Trial, motion: Motion) -> Array:
    """Velocity (n, 3) m/s by accelerometer and optics together, in the optics' frame; NaN where they see nothing."""
    t = trial.recording.t
    a = quat_rotate(quat_about_z(-heading_off(trial, motion.path.wxyz)[0]), motion.path.a)
    v = integral_of_means(t, a)
    beyond = filled(trial.p_true - integral_of_values(t, v, a))
    samples = round(0.5 * FUSED_S * trial.recording.rate_hz) * 2 + 1
    fused: Array = v + savgol_filter(beyond, samples, 3, deriv=1, delta=1.0 / trial.recording.rate_hz, axis=0)
    fused[~np.isfinite(trial.p_true).all(axis=1)] = np.nan
    return fused


if __name__ == "__main__":
    main()
