"""Match the keyframes of several takes: by order, by what the moves are like, by pose and by the grip.

First by what no other nav frame and no other way of holding the sensor changes: how far and how high a move goes, how
much it turns. Then, once a take is registered about the vertical, by pose.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pbd.pose import Array, matrix_log, quat_about_z, quat_to_matrix

HAND_M, HAND_RAD, HAND_SHARE = 0.03, np.radians(10.0), 0.1
"""Repeatability of a hand, for matching only: m, rad, and a share of the move."""

SKIP, GRIP = 8.0, 12.0
"""Cost of a keyframe without a match, and of a grip that differs, in squared sigmas. Two keyframes match up to twice
SKIP: four sigmas."""

MAX_SKIPS = 4
"""Most keyframes in a row without a match, while moves are compared."""

TURN_LEVER_M = 0.1
"""Lever, m, that makes a rotation error comparable with a position error: a hand's width."""

YAWS, RESTATED = 72, 3
"""Number of headings tried over a full turn; number of rounds of registration and matching."""

LEAST_SHARE = 0.5
"""Share of keyframes with a match below which two takes are of different tasks."""


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Of one take: p (n, 3) m, R (n, 3, 3), in its own nav; grip closes, opens or neither; sigma (n,) m, its own."""

    p: Array
    R: Array
    grip: tuple[bool | None, ...]
    sigma: Array

    @classmethod
    def of_candidates(cls, candidates: Sequence[Candidate]) -> Keyframes:
        """The task's, as the first take that has each shows it."""
        p, R, grip, sigma = zip(*((one.p, one.R, one.grip, one.sigma) for one in candidates), strict=True)
        return cls(np.array(p), np.array(R), grip, np.array(sigma))

    def __len__(self) -> int:
        return len(self.p)


@dataclass(frozen=True, eq=False)
class Registration:
    """A take in the frame of another: p -> Rz p + c, and R -> Rz R Q."""

    yaw: float
    c: Array
    Q: Array

    def of(self, keyframes: Keyframes) -> Keyframes:
        """The keyframes in that frame."""
        turn = quat_to_matrix(quat_about_z(self.yaw))
        return Keyframes(keyframes.p @ turn.T + self.c, turn @ keyframes.R @ self.Q, keyframes.grip, keyframes.sigma)

    def after(self, first: Registration) -> Registration:
        """This one after another."""
        c = quat_to_matrix(quat_about_z(self.yaw)) @ first.c + self.c
        return Registration(first.yaw + self.yaw, c, first.Q @ self.Q)

    def inverse(self) -> Registration:
        """The way back."""
        return Registration(-self.yaw, -quat_to_matrix(quat_about_z(-self.yaw)) @ self.c, self.Q.T)


@dataclass(eq=False)
class Candidate:
    """A keyframe that some takes have: p, R, grip and sigma of the first of them; its number in each, by take."""

    p: Array
    R: Array
    grip: bool | None
    sigma: float
    own: dict[int, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Takes of one task.

    Attributes:
        candidates: in order, those that few takes have too.
        registered: by take, in the frame of the reference.
        strangers: takes that do another task.
    """

    candidates: tuple[Candidate, ...]
    registered: dict[int, Registration]
    strangers: tuple[int, ...]

    def kept(self) -> tuple[Candidate, ...]:
        """Those that most takes have; the first is the dock."""
        most = 0.5 * len(self.registered)
        return tuple(one for k, one in enumerate(self.candidates) if k == 0 or len(one.own) > most)

    def without(self, takes: Sequence[int]) -> Alignment:
        """The same without some takes."""
        registered = {k: one for k, one in self.registered.items() if k not in takes}
        left = (replace(one, own={k: i for k, i in one.own.items() if k not in takes}) for one in self.candidates)
        return Alignment(tuple(one for one in left if one.own), registered, self.strangers)


def align(takes: Sequence[Keyframes]) -> Alignment:
    """Match the keyframes of all takes.

    The reference is a take with the most usual number of keyframes that most of the others agree with.
    """
    usual = Counter(map(len, takes))
    order = sorted(range(len(takes)), key=lambda k: (-usual[len(takes[k])], k))
    found = [_around(takes, reference) for reference in order[:1]]
    for reference in order[1:]:
        if 2 * len(found[-1].strangers) < len(takes):
            break
        found.append(_around(takes, reference))
    return min(found, key=lambda alignment: len(alignment.strangers))


def _around(takes: Sequence[Keyframes], reference: int) -> Alignment:
    here = takes[reference]
    registered = {reference: Registration(0.0, np.zeros(3), np.eye(3))}
    candidates = [
        Candidate(p, R, grip, sigma, {reference: i})
        for i, (p, R, grip, sigma) in enumerate(zip(here.p, here.R, here.grip, here.sigma.tolist(), strict=True))
    ]
    strangers = []
    for k, take in enumerate(takes):
        if k == reference:
            continue
        found = _registered(here, take)
        if found is None:
            strangers.append(k)
            continue
        registered[k], there = found, found.of(take)
        _add(candidates, k, there)
    return Alignment(tuple(candidates), registered, tuple(strangers))


def _registered(here: Keyframes, there: Keyframes) -> Registration | None:
    """Register a take; None where too few keyframes have a partner, or it begins elsewhere: chance pairs some."""
    pairs = by_moves(here, there)
    least = LEAST_SHARE * max(min(len(here), len(there)), 1)
    for _ in range(RESTATED):
        if len(pairs) < max(least, min(2, len(here), len(there))):
            return None
        found = register(here, there, pairs)
        before, pairs = pairs, by_pose(here, found.of(there))
        if pairs == before:
            break
    return found if len(pairs) >= least and by_pose(_dock(here), _dock(found.of(there))) else None


def _dock(one: Keyframes) -> Keyframes:
    """The first keyframe."""
    return Keyframes(one.p[:1], one.R[:1], one.grip[:1], one.sigma[:1])


def _add(candidates: list[Candidate], take: int, there: Keyframes) -> None:
    """Give each keyframe of a registered take to its candidate, or make it a new one in its place."""
    partner = {j: i for i, j in by_pose(Keyframes.of_candidates(candidates), there)}
    merged, done = list[Candidate](), 0
    for j in range(len(there)):
        if j in partner:
            merged += candidates[done : partner[j] + 1]
            merged[-1].own[take] = j
            done = partner[j] + 1
        else:
            merged.append(Candidate(there.p[j], there.R[j], there.grip[j], float(there.sigma[j]), {take: j}))
    candidates[:] = [*merged, *candidates[done:]]


def register(here: Keyframes, there: Keyframes, pairs: Sequence[tuple[int, int]], in_hand: bool = True) -> Registration:
    """Turn about the vertical, shift and, `in_hand`, turn of the sensor in the hand that bring keyframes together."""
    i, j = np.transpose(pairs)
    p, q, R, S = here.p[i], there.p[j], here.R[i], there.R[j]
    mean = p.mean(axis=0), q.mean(axis=0)

    def tried(yaws: Array) -> tuple[Array, Array]:
        """What each heading leaves over, (n,), and its turn of the sensor, (n, 3, 3)."""
        turns = quat_to_matrix(quat_about_z(yaws))
        turned = turns[:, None] @ S
        Q = _mean(turned.swapaxes(-1, -2) @ R) if in_hand else np.tile(np.eye(3), (len(yaws), 1, 1))
        off = p - mean[0] - (q - mean[1]) @ turns.swapaxes(-1, -2)
        angles = matrix_log(turned @ Q[:, None] @ R.swapaxes(-1, -2))
        return (off**2).sum(axis=(1, 2)) + TURN_LEVER_M**2 * (angles**2).sum(axis=(1, 2)), Q

    yaws, step = np.linspace(-np.pi, np.pi, YAWS, endpoint=False), 2.0 * np.pi / YAWS
    best = float(yaws[np.argmin(tried(yaws)[0])])
    for _ in range(3):  # a parabola through three headings
        left, middle, right = tried(best + step * np.array((-1.0, 0.0, 1.0)))[0].tolist()
        bent = left - 2.0 * middle + right
        if bent > 0.0:
            best += float(np.clip(0.5 * (left - right) / bent, -1.0, 1.0)) * step
        step *= 0.1
    turn = quat_to_matrix(quat_about_z(best))
    return Registration(best, mean[0] - turn @ mean[1], tried(np.array([best]))[1][0])


def _mean(rotations: Array) -> Array:
    """The rotation nearest to several, (..., n, 3, 3) -> (..., 3, 3)."""
    U, _, V = np.linalg.svd(rotations.sum(axis=-3))
    V[..., 2, :] *= np.linalg.det(U @ V)[..., None]
    return np.asarray(U @ V)


def by_moves(here: Keyframes, there: Keyframes) -> list[tuple[int, int]]:
    """Match by what the moves between matched keyframes are like. Dynamic programming; moves may span MAX_SKIPS."""
    n, m = len(here), len(there)
    node = _grips(here, there)
    cost = node + SKIP * (np.arange(n)[:, None] + np.arange(m))
    back = np.zeros((n, m, 2), dtype=np.intp)
    ours, theirs = _shapes(here), _shapes(there)
    for i in range(1, n):
        for a in range(1, min(i, MAX_SKIPS + 1) + 1):
            for b in range(1, min(m - 1, MAX_SKIPS + 1) + 1):
                move = _differ(ours[a - 1][i - a], theirs[b - 1]) + SKIP * (a + b - 2)
                total = cost[i - a, : m - b] + move + node[i, b:]
                better = total < cost[i, b:]
                cost[i, b:][better] = total[better]
                back[i, b:][better] = (a, b)
    end = cost + SKIP * (n - 1 - np.arange(n)[:, None] + m - 1 - np.arange(m))
    i, j = divmod(int(np.argmin(end)), m)
    pairs = [(i, j)]
    while back[i, j].any():
        i, j = i - int(back[i, j][0]), j - int(back[i, j][1])
        pairs.append((i, j))
    return pairs[::-1]


def _shapes(keyframes: Keyframes) -> list[Array]:
    """Of the moves over 1, 2, ... keyframes: how far level, how far up, how much turned, (n - a, 3)."""
    shapes = []
    for a in range(1, MAX_SKIPS + 2):
        way = keyframes.p[a:] - keyframes.p[:-a]
        turn = matrix_log(keyframes.R[:-a].transpose(0, 2, 1) @ keyframes.R[a:])
        shapes.append(
            np.column_stack((np.hypot(way[:, 0], way[:, 1]), way[:, 2], np.linalg.norm(turn, axis=1))).reshape(-1, 3)
        )
    return shapes


def _differ(one: Array, others: Array) -> Array:
    """Squared sigmas by which moves differ, (3,) and (k, 3) -> (k,)."""
    sigma = np.array((HAND_M, HAND_M, HAND_RAD)) + HAND_SHARE * np.abs(one)
    return np.asarray((((others - one) / sigma) ** 2).sum(axis=1))


def _grips(here: Keyframes, there: Keyframes) -> Array:
    return np.array([[0.0 if a == b else GRIP for b in there.grip] for a in here.grip]).reshape(len(here), len(there))


def by_pose(here: Keyframes, there: Keyframes) -> list[tuple[int, int]]:
    """Match keyframes in one frame, in order, by pose and grip. Dynamic programming."""
    n, m = len(here), len(there)
    turn = matrix_log(here.R[:, None] @ there.R[None].transpose(0, 1, 3, 2))
    square = ((here.p[:, None] - there.p) ** 2).sum(axis=2)
    variance = HAND_M**2 + here.sigma[:, None] ** 2 + there.sigma**2
    match = square / variance + (turn**2).sum(axis=2) / HAND_RAD**2 + _grips(here, there)
    cost = SKIP * (np.arange(n + 1)[:, None] + np.arange(m + 1.0))
    for i in range(n):
        for j in range(m):
            cost[i + 1, j + 1] = min(cost[i, j] + match[i, j], cost[i, j + 1] + SKIP, cost[i + 1, j] + SKIP)
    pairs, i, j = [], n, m
    while i and j:
        if cost[i, j] == cost[i - 1, j - 1] + match[i - 1, j - 1]:
            i, j = i - 1, j - 1
            pairs.append((i, j))
        elif cost[i, j] == cost[i - 1, j] + SKIP:
            i -= 1
        else:
            j -= 1
    return pairs[::-1]
