"""What the plots of several demonstrations of one task show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from pbd.data import HandPath, Keyframe
from pbd.pose import (
    Array,
    Pose,
    quat_about_z,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    yaw_toward,
)
from pbd.tracking.attitude import mean_quaternion
from pbd.view.plot_values import ComparePlot, RunPlot, SpreadKeyframe

TURN_M = 0.1
"""m per rad: in matching keyframes a turn counts as what it moves at the tool's tip, some 0.1 m from the sensor."""

Tracked = tuple[str, HandPath, Sequence[Keyframe]]
"""A demonstration's name, its path and its keyframes."""


def compare_plot(demos: Sequence[Tracked]) -> ComparePlot:
    """Lay demonstrations over each other at their first stop, and match their keyframes.

    Position and heading are taken from the first stop, as the dock does it; nav is the first
    demonstration's.
    Where all have as many keyframes they are matched by order, else each with the nearest ones in order
    (`match_in_order`), against the first demonstration of those with the most usual number.

    Args:
        demos: two or more, each with one keyframe at least.
    """
    first = demos[0][2][0].T_nav_sensor
    aligned = [_onto(first, keyframes[0].T_nav_sensor) for _, _, keyframes in demos]
    poses = [
        [T_first_nav @ keyframe.T_nav_sensor for keyframe in keyframes]
        for T_first_nav, (_, _, keyframes) in zip(aligned, demos, strict=True)
    ]
    reference = _reference([len(own) for own in poses])
    partners = [match_in_order(poses[reference], own) for own in poses]
    runs = tuple(
        _run(name, path, keyframes, T_first_nav, partner)
        for (name, path, keyframes), T_first_nav, partner in zip(demos, aligned, partners, strict=True)
    )
    covs = [
        [_turned(T_first_nav, keyframe.cov[:3, :3]) for keyframe in keyframes]
        for T_first_nav, (_, _, keyframes) in zip(aligned, demos, strict=True)
    ]
    spreads = tuple(_spread([partner[k] for partner in partners], poses, covs) for k in range(len(poses[reference])))
    by_order = len({len(own) for own in poses}) == 1
    return ComparePlot(runs, spreads, by_order, tuple(_remarks(demos, partners, reference)))


def match_in_order(reference: Sequence[Pose], other: Sequence[Pose]) -> tuple[int | None, ...]:
    """For each keyframe of the reference its partner's index in the other demonstration, or None.

    Each keyframe of the one with fewer gets a partner, in order, such that the sum of squared distances is least
    (TURN_M says what a turn counts). With equal numbers that is the order itself. Dynamic programming, k x m steps.
    """
    if len(other) > len(reference):
        back = match_in_order(other, reference)
        return tuple(back.index(i) for i in range(len(reference)))
    k, m = len(reference), len(other)
    square = np.array([[_distance(a, b) ** 2 for b in other] for a in reference]).reshape(k, m)
    cost = np.full((k + 1, m + 1), np.inf)  # of the first i and j, all of the j having a partner
    cost[:, 0] = 0.0
    for i in range(k):
        cost[i + 1, 1:] = np.minimum(cost[i, 1:], cost[i, :-1] + square[i])
    partners: list[int | None] = [None] * k
    j = m
    for i in range(k, 0, -1):
        if j and cost[i, j] < cost[i - 1, j]:
            j -= 1
            partners[i - 1] = j
    return tuple(partners)


def _distance(a: Pose, b: Pose) -> float:
    shift, turn = a.distance(b)
    return float(np.hypot(shift, TURN_M * turn))


def _onto(first: Pose, own: Pose) -> Pose:
    """T_first_nav: turned about z and shifted so that `own` comes to lie on `first`, as far as that goes."""
    turn = quat_about_z(yaw_toward(own.wxyz, first.wxyz))
    return Pose(first.p - quat_rotate(turn, own.p), turn)


def _turned(pose: Pose, cov: Array) -> Array:
    R = quat_to_matrix(pose.wxyz)
    turned: Array = R @ cov @ R.T
    return turned


def _reference(counts: Sequence[int]) -> int:
    """The first demonstration of those with the most usual number of keyframes; of two such numbers the larger."""
    usual = Counter(counts)
    return counts.index(max(counts, key=lambda count: (usual[count], count)))


def _run(
    name: str, path: HandPath, keyframes: Sequence[Keyframe], T_first_nav: Pose, partner: Sequence[int | None]
) -> RunPlot:
    rows = slice(path.stops[0].start, path.stops[-1].stop)
    t, number = [], []
    for k, own in enumerate(partner):
        if own is not None:
            half = 0.5 * keyframes[own].dwell_s
            t += [keyframes[own].t - half, keyframes[own].t + half]
            number += [k, k]
    progress = np.interp(path.t[rows], t, number, left=np.nan, right=np.nan)
    return RunPlot(name, T_first_nav.act(path.p_nav_sensor[rows]), progress)


def _spread(
    own: Sequence[int | None], poses: Sequence[Sequence[Pose]], covs: Sequence[Sequence[Array]]
) -> SpreadKeyframe:
    there = [(run, i) for run, i in enumerate(own) if i is not None]
    p = np.array([poses[run][i].p for run, i in there])
    wxyz = np.array([poses[run][i].wxyz for run, i in there])
    away = np.linalg.norm(p - p.mean(axis=0), axis=1)
    angles = np.linalg.norm(quat_log(quat_multiply(quat_inverse(mean_quaternion(wxyz)), wxyz)), axis=1)
    several = len(there) > 1
    return SpreadKeyframe(
        poses=tuple(None if i is None else poses[run][i] for run, i in enumerate(own)),
        own=tuple(own),
        p=p.mean(axis=0),
        spread=p.std(axis=0, ddof=1) if several else np.full(3, np.nan),
        furthest=there[int(np.argmax(away))][0],
        furthest_m=float(away.max()),
        turn=float(np.sqrt((angles**2).sum() / (len(there) - 1))) if several else float("nan"),
        sigma=_usual([np.diagonal(covs[run][i]) for run, i in there if i == 0 or covs[run][i].any()]),
    )


def _usual(variances: Sequence[Array]) -> Array:
    """Root mean square (3,) m of what the trackers are unsure by; NaN where all keyframes were typed by a person."""
    usual: Array = np.sqrt(np.mean(variances, axis=0)) if variances else np.full(3, np.nan)
    return usual


def _remarks(demos: Sequence[Tracked], partners: Sequence[Sequence[int | None]], reference: int) -> list[str]:
    """Which keyframes are missing where, or are there in one demonstration alone."""
    usual, _, others = demos[reference]
    said = []
    for (name, _, keyframes), partner in zip(demos, partners, strict=True):
        missing = [f"{k} ({others[k].t:.1f} s in {usual})" for k, own in enumerate(partner) if own is None]
        more = [f"{i} ({keyframe.t:.1f} s)" for i, keyframe in enumerate(keyframes) if i not in partner]
        if missing:
            said.append(f"{name} has no keyframe{_s(missing)} {', '.join(missing)}")
        if more:
            many = "one more stop" if len(more) == 1 else f"{len(more)} more stops"
            said.append(f"{name} has {many}, its keyframe{_s(more)} {', '.join(more)}: left out")
    return said


def _s(several: Sequence[str]) -> str:
    return "" if len(several) == 1 else "s"
