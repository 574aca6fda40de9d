"""Takes, and single keyframes of takes, that don't fit the others by their own covariance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.joint import Joint, Parts, estimate_jointly, without
from pbd.pose import Array

FALSE_RATE = 0.01
"""Share of sound fusions in which a keyframe of a take is taken for an outlier, by chance."""

LEAST_TAKES = 3
"""Fewest takes of a keyframe of which one can be told to be wrong."""

LARGEST_SHARE = 0.5
"""Share of a take's keyframes that may be outliers before all of the take is one."""


class Disbelieved(NamedTuple):
    """Outliers: takes, and keyframes of takes (take, keyframe), by their place in Parts."""

    takes: tuple[int, ...]
    keyframes: tuple[tuple[int, int], ...]


def believed(parts: Parts, joint: Joint) -> tuple[Joint, Parts, Disbelieved]:
    """Leave out the worst keyframe of a take, estimate again, as long as one is an outlier.

    A take of which half the keyframes are outliers is one, and then nothing more is sought.
    """
    out: list[tuple[int, int]] = []
    begun = [len(at) for at in parts.at]
    while True:
        squares, which = _against_others(parts, joint)
        counts = Counter(j for _, j in which)
        tested = [i for i, (_, j) in enumerate(which) if counts[j] >= LEAST_TAKES]
        worst = max(tested, key=lambda i: float(squares[i]), default=None)
        if worst is None or squares[worst] <= _bound(len(tested)):
            return joint, parts, Disbelieved((), tuple(out))
        out.append(which[worst])
        of_takes = Counter(k for k, _ in out)
        bad = tuple(k for k, count in of_takes.items() if count > LARGEST_SHARE * begun[k])
        if bad:
            return joint, parts, Disbelieved(bad, tuple(out))
        parts = without(parts, *which[worst])
        joint = estimate_jointly(parts, joint.state, joint.scatter)


def disagreement(parts: Parts, joint: Joint, names: Sequence[str]) -> list[str]:
    """Where two takes differ too much, and nobody can tell which is right."""
    squares, which = _against_others(parts, joint)
    counts = Counter(j for _, j in which)
    told: dict[int, str] = {}
    for square, (k, j) in zip(squares.tolist(), which, strict=True):
        if counts[j] == 2 and square > _bound(len(which)):
            told[j] = f"at keyframe {j} {names[k]} and the other take differ; a third take would show which is wrong"
    return list(told.values())


def _against_others(parts: Parts, joint: Joint) -> tuple[Array, list[tuple[int, int]]]:
    """Chi-square (6 degrees of freedom) of each keyframe of each take against all the others."""
    rows: list[NDArray[np.intp]] = []
    which = []
    for k, (at, own) in enumerate(zip(parts.at, parts.rows, strict=True)):
        rows += [own.start + 6 * i + np.arange(6) for i in range(len(at))]
        which += [(k, int(j)) for j in at]
    return joint.squares(rows), which


def _bound(tests: int) -> float:
    from scipy.special import chdtri

    return float(chdtri(6, FALSE_RATE / max(tests, 1)))
