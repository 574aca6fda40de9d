"""Find where a slow move really begins and ends: its ends are too slow to be noticed, and look like rest.

A hand moves smoothly: at the fraction u of a move, its speed is 16 u^2 (1 - u)^2 of the largest (minimum jerk: T.
Flash, N. Hogan, J Neurosci 5:1688, 1985).
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array
from pbd.tracking.moving_windows import Spans


def without_slow_ends(t: Array, spans: Spans, speed: Array, sharp: NDArray[np.bool_] | None = None) -> Spans:
    """Cut from each span the slow ends of the moves beside it. At least the middle of each span is left.

    Args:
        t, speed: (n,) s; (n,) speed or rate, in any unit.
        spans: in which the hand seems to rest.
        sharp: (n,) rows at which a move is noticed at once; by default none.
    """
    found, sharp = list(spans), np.zeros(len(t), dtype=np.bool_) if sharp is None else sharp
    for k, ((start, first), (last, stop)) in enumerate(pairwise(spans)):
        move, end, begin = slice(first, last), first, last
        if not sharp[first]:
            end = int(np.searchsorted(t, t[first] - _unnoticed_s(t[move], speed[move])))
        if not sharp[last - 1]:
            back = slice(last - 1, first - 1, -1)
            begin = int(np.searchsorted(t, t[last - 1] + _unnoticed_s(t[back], speed[back]), side="right"))
        found[k] = found[k][0], max(end, (start + first) // 2 + 1)
        found[k + 1] = min(begin, (last + stop) // 2), stop
    return found


def _unnoticed_s(t: Array, speed: Array) -> float:
    """How long a hand had moved before it was noticed, s, by t and speed of its move from there.

    The middle is the first peak that is the highest for as long again as it took. A peak before 0.1 s is noise: a
    hand's shortest moves take 0.2 s.
    """
    since = np.abs(t - t[0])
    peaks = np.flatnonzero((speed == np.maximum.accumulate(speed)) & (speed > speed[0]) & (since >= 0.1))
    if not len(peaks):
        return 0.0
    higher = np.append(since[peaks[1:]], np.inf)
    middle = peaks[np.argmax(higher > 2.0 * since[peaks])]
    noticed = np.sqrt(1.0 - np.sqrt(speed[0] / speed[middle]))  # the share of the move's first half
    return float(since[middle] / noticed - since[middle])
