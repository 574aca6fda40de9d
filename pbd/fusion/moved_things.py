"""Things that stood elsewhere in some takes: keyframes that move with one, against the others.

Which they are is a comparison of what is left over in both frames, as likelihoods: all keyframes in one frame, or some
that follow each other in another one, which is turned about the vertical and shifted in each take.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.matching import HAND_M, TURN_LEVER_M, Keyframes, Registration, register
from pbd.pose import Array, lengths, matrix_log

Index = NDArray[np.intp]

AGAIN_M = 0.003
"""Least sigma, m, of how a hand meets a place again. If the residuals are larger, they set it."""

LEAST_GAIN = 10.0
"""Log likelihood ratio above which a thing has moved: 1 in 20,000 if the noise is normal."""

LEAST_TAKES, LEVEL_M = 3, 0.01
"""Conditions for a thing of a single keyframe: fewest takes, in each of which it stands elsewhere (else it may be a
mistake); largest difference in height, m (a waypoint in the air varies more)."""

LEAST_LEFT = 3
"""Fewest keyframes that are not the thing's, with the dock."""


@dataclass(frozen=True, eq=False)
class Moved:
    """A thing: its first and last keyframe in the takes that show it, and the likelihood's gain in nats.

    `rest` brings a take's nav to the reference's, `back` its keyframes of the thing to where they are there.
    """

    first: int
    last: int
    gain: float
    reference: int
    rest: dict[int, Registration]
    back: dict[int, Registration]

    def put_back(self, take: int, keyframes: Keyframes) -> Keyframes:
        """The keyframes of a take, as if the thing stood in it as in the reference."""
        if take not in self.back:
            return keyframes
        there = self.rest[take].inverse().after(self.back[take]).of(keyframes)
        own = np.arange(len(keyframes))
        inside = (own >= self.first) & (own <= self.last)
        p = np.where(inside[:, None], there.p, keyframes.p)
        R = np.where(inside[:, None, None], there.R, keyframes.R)
        return Keyframes(p, R, keyframes.grip, keyframes.sigma)


def moved_thing(takes: Sequence[Keyframes]) -> Moved | None:
    """The thing that most likely moved, if one did.

    Sought among the takes with the usual number of keyframes and the same grips.
    """
    usual = Counter((len(take), take.grip) for take in takes).most_common(1)[0][0]
    members = [k for k, take in enumerate(takes) if (len(take), take.grip) == usual]
    count, reference = usual[0], members[0]
    here, others = takes[reference], members[1:]
    if not others:
        return None
    everything = np.arange(count)
    rows = 6 * count * len(others)
    together = sum(_left_over(here, takes[k], everything, everything[:0])[0] for k in others)
    if _gain(together, 0.0, rows, len(others)) < LEAST_GAIN:
        return None  # whichever keyframes had a frame of their own
    best: Moved | None = None
    for first, end in combinations(range(1, count + 1), 2):
        run, rest = everything[first:end], np.r_[0:first, end:count]
        alone = len(run) == 1
        if len(rest) < LEAST_LEFT or (alone and len(members) < LEAST_TAKES):
            continue
        found = {k: _left_over(here, takes[k], rest, run) for k in others}
        apart = sum(left for left, _, _ in found.values())
        gain = _gain(together, apart, rows, len(others))
        if gain < (LEAST_GAIN if best is None else best.gain):
            continue
        registered = {k: one for k, (_, one, _) in found.items()}
        back = {k: one for k, (_, _, one) in found.items()}
        shifts = _shifts(here, takes, run, registered)
        far = lengths(shifts) > HAND_M
        if (far.all() and np.abs(shifts[:, 2]).max() < LEVEL_M) if alone else far.any():
            best = Moved(first, end - 1, gain, reference, registered, back)
    return best


def _gain(together: float, apart: float, rows: int, frames: int) -> float:
    """Logarithm of the likelihoods' ratio, less that of as many more frames with four unknowns each.

    Source: G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
    """
    return float(0.5 * rows * np.log(max(together, rows) / max(apart, rows)) - 2.0 * frames * np.log(rows))


def _shifts(here: Keyframes, takes: Sequence[Keyframes], run: Index, registered: dict[int, Registration]) -> Array:
    """By how much the middle of some keyframes is elsewhere in each take, (n, 3) m."""
    middle = here.p[run].mean(axis=0)
    return np.array([one.of(takes[k]).p[run].mean(axis=0) - middle for k, one in registered.items()])


def _left_over(here: Keyframes, there: Keyframes, rest: Index, run: Index) -> tuple[float, Registration, Registration]:
    """Squared sigmas that are left over, and the two frames of a take: of the rest, and of a run of keyframes."""
    first = second = register(here, there, [(i, i) for i in rest.tolist()])
    if len(run):
        second = register(here, first.of(there), [(i, i) for i in run.tolist()], in_hand=False).after(first)
    square = 0.0
    for one, at in ((first, rest), (second, run)):
        moved = one.of(there)
        off = lengths(moved.p[at] - here.p[at]) ** 2
        turn = lengths(matrix_log(moved.R[at] @ here.R[at].transpose(0, 2, 1))) ** 2
        variance = AGAIN_M**2 + here.sigma[at] ** 2 + there.sigma[at] ** 2
        square += float(((off + TURN_LEVER_M**2 * turn) / variance).sum())
    return square, first, second
