"""Takes, and single keyframes of takes, that don't fit the others by their own covariance.

An outlier makes the hand seem to scatter. So the scatter that it is tested by is that of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.joint_estimate import Joint, Parts, estimate_jointly
from pbd.fusion.scatter import Scatter, alike
from pbd.pose import Array, lengths

FALSE_RATE = 0.01
"""Chance that a fusion without outliers reports one."""

LEAST_TAKES = 3
"""Fewest takes among which an outlier can be located."""

UNSURE_SIGMAS = 2.0
"""How far the scatter of the rest is raised for the test, in sigmas of its logarithm: few takes show it badly."""

SUSPECT = 2.0
"""A take is tested if its median residual is this many times the median take's."""

KNOWN_SPREAD = 1e-3
"""Prior sigma of a logarithm of scatter that is held fixed."""


class Disbelieved(NamedTuple):
    """An outlier among the takes, or None; and keyframes of takes (take, keyframe); by their place in Parts."""

    take: int | None
    keyframes: tuple[tuple[int, int], ...]


def believed(parts: Parts, joint: Joint) -> tuple[Joint, Parts, Disbelieved]:
    """Leave out the worst keyframe of a take, estimate again, as long as one is an outlier.

    Where a whole take is one, nothing more is sought.
    """
    take = _outlier_take(parts, joint)
    if take is not None:
        return joint, parts, Disbelieved(take, ())
    out: list[tuple[int, int]] = []
    while (worst := _outlier(parts, joint, LEAST_TAKES)) is not None:
        out.append(worst)
        parts = parts.only(~_is(parts, *worst))
        joint = estimate_jointly(parts, joint.state, alike(len(joint.state.m)))
    return joint, parts, Disbelieved(None, tuple(out))


def disagreement(parts: Parts, joint: Joint, names: Sequence[str]) -> str:
    """Say where two takes differ too much, without telling which is right; "" if none do."""
    worst = _outlier(parts, joint, 2)
    if worst is None:
        return ""
    both = " and ".join(names[k] for k in parts.take[parts.at == worst[1]])
    return f"{both} differ at keyframe {worst[1]}; a third take would show which is wrong"


def _outlier(parts: Parts, joint: Joint, takes: int) -> tuple[int, int] | None:
    """The worst keyframe of a take, if it is an outlier; of those that so many takes have (or more, from three on)."""
    counts = np.bincount(parts.at)[parts.at]
    tested = np.flatnonzero((counts == takes) | ((counts > takes) & (takes >= LEAST_TAKES)))
    if not len(tested):
        return None
    rows = 6 * tested[:, None] + np.arange(6)
    worst = int(np.argmax(joint.squares(list(rows))))
    which = int(parts.take[tested[worst]]), int(parts.at[tested[worst]])
    found = _stands_out(parts, joint, parts.only(~_is(parts, *which)), rows[worst], len(tested))
    return which if found else None


def _is(parts: Parts, take: int, keyframe: int) -> NDArray[np.bool_]:
    return np.asarray((parts.take == take) & (parts.at == keyframe))


def _outlier_take(parts: Parts, joint: Joint) -> int | None:
    """The take that is farthest off, if it is an outlier."""
    if len(parts.marginals) < LEAST_TAKES:
        return None
    off = np.array([np.median(lengths(joint.residuals[rows].reshape(-1, 6)[:, :3])) for rows in parts.rows])
    worst = int(np.argmax(off))
    if off[worst] < SUSPECT * np.median(off):
        return None
    rows = np.arange(parts.rows[worst].start, parts.rows[worst].stop)
    rest = parts.only(parts.take != worst)
    return worst if _stands_out(parts, joint, rest, rows, len(parts.rows)) else None


def _stands_out(parts: Parts, joint: Joint, rest: Parts, rows: NDArray[np.intp], tests: int) -> bool:
    """Whether some residuals don't fit, by the scatter that the rest shows."""
    count = len(joint.state.m)
    alone = estimate_jointly(rest, joint.state, replace(alike(count), log=joint.scatter.log))
    again = estimate_jointly(parts, joint.state, _held(alone.scatter))
    return bool(again.squares([rows])[0] > _bound(len(rows), tests))


def _held(scatter: Scatter) -> Scatter:
    log: Array = scatter.log + UNSURE_SIGMAS * scatter.unsure
    return replace(scatter, log=log, mean=log, spread=np.full(len(log), KNOWN_SPREAD))


def _bound(freedom: int, tests: int) -> float:
    from scipy.special import chdtri

    return float(chdtri(freedom, FALSE_RATE / tests))
