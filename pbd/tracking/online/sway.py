"""How a hand moves that means to stand still: its tremor and its sway."""

import numpy as np

from pbd.pose import Array


def deviation_from_line(t: Array, values: Array) -> Array:
    """Residual (3,) of the last of values (n, 3) from the line fitted to all of them over t (n,)."""
    about = t - t.mean()
    mean = values.mean(axis=0)
    slope = about @ values / max(float(about @ about), np.finfo(float).tiny)
    off: Array = values[-1] - mean - about[-1] * slope
    return off


def sway_of(t: Array, angle: Array) -> float:
    """How a swaying hand turns, as a random walk of its angle, rad/sqrt(s), by angles (n, 3) rad at times t (n,) s.

    It is twice the largest excursion from a steady turn, as in the smoother (`knots`). A steady turn is left out,
    because the gyro's bias looks the same. A slow sway looks like a steady turn unless it is seen for long.
    """
    lasts, turned = max(float(t[-1] - t[0]), np.finfo(float).tiny), angle - angle[0]
    steady = ((t - t[0]) / lasts)[:, None] * turned[-1]
    return 2.0 * float(np.abs(turned - steady).max() / np.sqrt(lasts))
