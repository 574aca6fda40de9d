"""Find an object that stood elsewhere in some takes: consecutive keyframes that moved with it, relative to the others.

Two hypotheses are compared by their likelihoods: all keyframes share one frame, or a run of them has a frame of its
own, which is rotated about the vertical and shifted in each take.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.matching import MATCH_M, TURN_LEVER_M, Keyframes, Registration, may_match, register
from pbd.fusion.outliers import LEAST_TAKES
from pbd.pose import Array, lengths, matrix_log
from pbd.tracking.stop_constraints import PLACE_SIGMA_M

Index = NDArray[np.intp]

LEAST_GAIN = 10.0
"""Log likelihood ratio above which an object has moved. With normal noise, chance exceeds it 1 in 20,000 times."""

LEVEL_M = 0.01
"""Largest difference in height, m, of an object with a single keyframe: a waypoint in the air varies more."""

LEAST_OTHERS = 3
"""Smallest number of keyframes that don't move with the object, including the dock."""


@dataclass(frozen=True, eq=False)
class MovedKeyframes:
    """Keyframes that moved with an object.

    Attributes:
        first, last: indices of the first and the last moved keyframe, in takes with the usual keyframes.
        gain: logarithm of the likelihood ratio.
        reference: number of the take that shows where the object belongs.
        rest: number of a take -> map of its nav to the reference's, by the keyframes that did not move.
        back: number of a take in which they moved -> map of the moved keyframes to where they are in the reference.
    """

    first: int
    last: int
    gain: float
    reference: int
    rest: dict[int, Registration]
    back: dict[int, Registration]

    def put_back(self, take: int, keyframes: Keyframes) -> Keyframes:
        """Return the keyframes of a take as if the object stood where it stands in the reference."""
        if take not in self.back:
            return keyframes
        moved = self.rest[take].inverse().after(self.back[take]).apply(keyframes)
        run, p, R = slice(self.first, self.last + 1), keyframes.p.copy(), keyframes.R.copy()
        p[run], R[run] = moved.p[run], moved.R[run]
        return replace(keyframes, p=p, R=R)


def find_moved_keyframes(takes: Sequence[Keyframes]) -> MovedKeyframes | None:
    """Return the keyframes that most likely moved with an object, or None.

    Only takes with the most frequent number of keyframes and pattern of grips are compared.
    """
    shown = [(len(take), take.grip) for take in takes]
    usual = Counter(shown).most_common(1)[0][0]
    reference, *others = [k for k, one in enumerate(shown) if one == usual]
    count, ref = usual[0], takes[reference]
    everything = np.arange(count)
    together = {k: _misfit_in_frames(ref, takes[k], everything, everything[:0])[0] for k in others}
    if sum(max(_gain(misfit, np.zeros(2), count), 0.0) for misfit in together.values()) < LEAST_GAIN:
        return None  # no run can gain enough, even if it left no misfit
    best: MovedKeyframes | None = None
    for first, end in combinations(range(1, count + 1), 2):
        run, rest = everything[first:end], np.r_[0:first, end:count]
        if len(rest) < LEAST_OTHERS:
            continue
        apart = {k: _misfit_in_frames(ref, takes[k], rest, run) for k in others}
        # A hand may scatter by more than it was taken to: as the takes show, but for the half that fits worst.
        scatter = np.quantile([misfit for misfit, _, _ in apart.values()], 0.5, axis=0, method="lower") / (3 * count)
        scatter = np.maximum(scatter, 1.0)
        gain, back, at = 0.0, dict[int, Registration](), run.tolist()
        for k, (misfit, _, second) in apart.items():
            gained = _gain(together[k] / scatter, misfit / scatter, count)
            # In a take of another task, or in another order, the keyframes are not the object's even if put back.
            if gained > 0.0 and may_match(ref[at], second.apply(takes[k])[at]).all():
                gain, back[k] = gain + gained, second
        registered = {k: first_frame for k, (_, first_frame, _) in apart.items()}
        found = MovedKeyframes(first, end - 1, gain, reference, registered, back)
        if gain >= (best.gain if best else LEAST_GAIN) and _stood_elsewhere(found, takes):
            best = found
    return best


def _stood_elsewhere(moved: MovedKeyframes, takes: Sequence[Keyframes]) -> bool:
    """Say whether keyframes are far from the reference's in the takes in which they moved; a single one also level."""
    run = slice(moved.first, moved.last + 1)
    p_ref = takes[moved.reference].p[run]
    places = {k: one.apply(takes[k]).p[run] for k, one in moved.rest.items()} | {moved.reference: p_ref}
    shifts, every = np.array([places[k] - p_ref for k in moved.back]), np.array(list(places.values()))
    far = lengths(shifts) > MATCH_M
    if moved.first < moved.last:
        return bool(far.any(axis=0).all())
    alike = (lengths(every[:, None] - every) <= MATCH_M).sum(axis=1)  # takes with it at the same place
    enough = len(moved.back) + 1 >= LEAST_TAKES and 2 * alike.max() <= len(every)
    return bool(far.all() and np.abs(shifts[..., 2]).max() < LEVEL_M and enough)


def another_thing(moved: MovedKeyframes, takes: Sequence[Keyframes]) -> str:
    """Say which keyframes move with a second object, which has no frame of its own; "" if there is none. The takes are
    those in which `moved` was found, after `put_back`."""
    also = find_moved_keyframes(takes)
    if also is None or (also.first <= moved.last and also.last >= moved.first):
        return ""
    where = f"keyframes {moved.first}..{moved.last}, and apart from them {also.first}..{also.last}"
    return (
        f"{where} seem to move with things that stood elsewhere, and only one such thing is estimated: do not trust "
        "these keyframes; show the takes again with all but one in place"
    )


def _gain(together: Array, apart: Array, count: int) -> float:
    """Return one take's log likelihood ratio minus the penalty for the additional frame, which has four unknowns.

    `together` and `apart` (2,) are misfits of `count` keyframes in position and attitude, in squared sigmas.

    Source: G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978).
    """
    rows = 6 * count
    return float(0.5 * rows * np.log(max(together.sum(), rows) / max(apart.sum(), rows)) - 2.0 * np.log(rows))


def _misfit_in_frames(
    ref: Keyframes, other: Keyframes, rest: Index, run: Index
) -> tuple[Array, Registration, Registration]:
    """Return the misfit (2,) in position and attitude, in squared sigmas, and the maps of the rest and of the run."""
    first = second = register(ref, other, [(i, i) for i in rest.tolist()])
    if len(run):
        second = register(ref, first.apply(other), [(i, i) for i in run.tolist()], in_hand=False).after(first)
    square = np.zeros(2)
    for one, at in ((first, rest), (second, run)):
        moved = one.apply(other)
        off = lengths(moved.p[at] - ref.p[at]) ** 2
        turn = lengths(matrix_log(moved.R[at] @ ref.R[at].transpose(0, 2, 1))) ** 2
        variance = PLACE_SIGMA_M**2 + ref.sigma[at] ** 2 + other.sigma[at] ** 2
        square += (np.array((off, TURN_LEVER_M**2 * turn)) / variance).sum(axis=1)
    return square, first, second
