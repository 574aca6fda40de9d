"""Match the keyframes of several takes, in order, by their moves, poses and grips.

First a take is matched by features of its moves that depend neither on its nav frame nor on how the sensor is held:
horizontal distance, height and angle. Then it is registered about the vertical, and matched again by poses.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, matrix_log, quat_about_z, quat_to_matrix

MATCH_M, MATCH_RAD, MATCH_SHARE = 0.03, np.radians(10.0), 0.1
"""Repeatability of a hand, for matching only: m, rad, and a share of the move. Above MATCH_M there is a warning."""

SKIP_COST, GRIP_COST = 8.0, 12.0
"""Cost of a keyframe without a match, and of a different grip, in squared sigmas. Two keyframes match up to a cost of
twice SKIP_COST, which is four sigmas."""

MAX_SKIPS = 4
"""Largest number of keyframes in a row without a match, while moves are compared."""

TURN_LEVER_M = 0.1
"""Lever, m, that makes a rotation error comparable with a position error: a hand's width."""

YAWS, ROUNDS = 72, 3
"""Number of headings tried over a full turn; number of rounds of registration and matching."""

LEAST_SHARE = 0.5
"""Share of matched keyframes, in the take with more keyframes, below which two takes are of different tasks."""


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Keyframes of one take, in its own nav.

    Attributes:
        p, R: (n, 3) m and (n, 3, 3), nav <- sensor.
        grip: True where the grip closes, False where it opens, None elsewhere.
        sigma: (n,) m, sigma of the position, from the take alone.
    """

    p: Array
    R: Array
    grip: tuple[bool | None, ...]
    sigma: Array

    def __len__(self) -> int:
        return len(self.p)

    def __getitem__(self, index: list[int]) -> Keyframes:
        return Keyframes(self.p[index], self.R[index], tuple(self.grip[i] for i in index), self.sigma[index])

    def __add__(self, other: Keyframes) -> Keyframes:
        p, R, sigma = (np.concatenate((getattr(self, x), getattr(other, x))) for x in ("p", "R", "sigma"))
        return Keyframes(p, R, self.grip + other.grip, sigma)


@dataclass(frozen=True, eq=False)
class Registration:
    """A map from one take's frame to another's: p -> Rz p + c, and R -> Rz R Q, with Rz a yaw (rad) about the vertical.

    Q is the sensor's rotation in the hand.
    """

    yaw: float
    c: Array
    Q: Array

    def apply(self, keyframes: Keyframes) -> Keyframes:
        """Map keyframes to the other frame."""
        Rz = quat_to_matrix(quat_about_z(self.yaw))
        return Keyframes(keyframes.p @ Rz.T + self.c, Rz @ keyframes.R @ self.Q, keyframes.grip, keyframes.sigma)

    def after(self, first: Registration) -> Registration:
        """Return the composition: `first`, then this one."""
        c = quat_to_matrix(quat_about_z(self.yaw)) @ first.c + self.c
        return Registration(first.yaw + self.yaw, c, first.Q @ self.Q)

    def inverse(self) -> Registration:
        """Return the inverse map."""
        return Registration(-self.yaw, -quat_to_matrix(quat_about_z(-self.yaw)) @ self.c, self.Q.T)


IndexByTake = dict[int, int]
"""A keyframe of the task: number of a take -> index of this keyframe in that take, for each take that has it."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """Takes of one task, matched.

    Attributes:
        keyframes: all in order, also those that few takes have, each as in the first take that has it, in the
            reference's nav.
        own: for each of `keyframes`, its index in the takes that have it.
        registered: number of a take -> map to the reference's frame.
        strangers: numbers of the takes of another task.
    """

    keyframes: Keyframes
    own: tuple[IndexByTake, ...]
    registered: dict[int, Registration]
    strangers: tuple[int, ...]

    def kept(self) -> tuple[Keyframes, tuple[IndexByTake, ...]]:
        """Return the keyframes that most takes have, and the first one, which is the dock."""
        kept = [k for k, own in enumerate(self.own) if k == 0 or 2 * len(own) > len(self.registered)]
        return self.keyframes[kept], tuple(self.own[k] for k in kept)

    def without(self, take: int) -> Alignment:
        """Return the alignment without a take, and without the keyframes that only this take had."""
        registered = {k: one for k, one in self.registered.items() if k != take}
        own = [{k: i for k, i in each.items() if k != take} for each in self.own]
        left = [k for k, each in enumerate(own) if each]
        return Alignment(self.keyframes[left], tuple(own[k] for k in left), registered, self.strangers)


def align_takes(takes: Sequence[Keyframes]) -> Alignment:
    """Match the keyframes of all takes.

    The reference is a take with the most frequent number of keyframes; if half of the takes or more don't match it,
    another one.
    """
    usual = Counter(map(len, takes))
    order = sorted(range(len(takes)), key=lambda k: (-usual[len(takes[k])], k))
    found: list[Alignment] = []
    while order and (not found or 2 * len(found[-1].strangers) >= len(takes)):
        found.append(_align_to(takes, order.pop(0)))
    return min(found, key=lambda alignment: len(alignment.strangers))


def _align_to(takes: Sequence[Keyframes], reference: int) -> Alignment:
    ref = keyframes = takes[reference]
    registered = {reference: Registration(0.0, np.zeros(3), np.eye(3))}
    own, strangers = [{reference: i} for i in range(len(ref))], []
    for k, take in enumerate(takes):
        if k == reference:
            continue
        if (registration := _try_register(ref, take)) is None:
            strangers.append(k)
        else:
            registered[k] = registration
            keyframes, own = _merged(keyframes, own, k, registration.apply(take))
    return Alignment(keyframes, tuple(own), registered, tuple(strangers))


def _try_register(ref: Keyframes, other: Keyframes) -> Registration | None:
    """Register a take; None if too few keyframes match, or not the first one: some match by chance in any two tasks."""
    pairs = match_by_moves(ref, other)
    least = LEAST_SHARE * max(len(ref), len(other))
    for _ in range(ROUNDS):
        if len(pairs) < max(least, min(2, len(ref), len(other))):
            return None
        found = register(ref, other, pairs)
        before, pairs = pairs, match_by_pose(ref, found.apply(other))
        if pairs == before:
            break
    return found if len(pairs) >= least and may_match(ref[[0]], found.apply(other)[[0]]).all() else None


def _merged(
    keyframes: Keyframes, own: list[IndexByTake], take: int, other: Keyframes
) -> tuple[Keyframes, list[IndexByTake]]:
    """Add the keyframes of a registered take: to their partners, or as new ones in their order."""
    partner = {j: i for i, j in match_by_pose(keyframes, other)}
    index, merged, done = list[int](), list[IndexByTake](), 0  # index: those known first, then those of the take
    for j in range(len(other)):
        if j in partner:
            index += range(done, partner[j] + 1)
            merged += own[done : partner[j] + 1]
            merged[-1] = merged[-1] | {take: j}
            done = partner[j] + 1
        else:
            index.append(len(keyframes) + j)
            merged.append({take: j})
    return (keyframes + other)[[*index, *range(done, len(own))]], [*merged, *own[done:]]


def register(ref: Keyframes, other: Keyframes, pairs: Sequence[tuple[int, int]], in_hand: bool = True) -> Registration:
    """Find the map that brings matched keyframes of `other` closest to those of `ref`, in the sum of squares.

    The yaw is searched on a grid and refined by parabolas. Shift and, with `in_hand`, the sensor's rotation in the hand
    (else the identity) follow from each yaw.
    """
    i, j = np.transpose(pairs)
    p, q, R, S = ref.p[i], other.p[j], ref.R[i], other.R[j]
    mean = p.mean(axis=0), q.mean(axis=0)

    def tried(yaws: Array) -> tuple[Array, Array]:
        """Return the sum of squares (n,), m2, and the rotation in the hand (n, 3, 3) for each yaw."""
        Rz = quat_to_matrix(quat_about_z(yaws))
        rotated = Rz[:, None] @ S
        Q = _mean_rotation(rotated.swapaxes(-1, -2) @ R) if in_hand else np.tile(np.eye(3), (len(yaws), 1, 1))
        off = p - mean[0] - (q - mean[1]) @ Rz.swapaxes(-1, -2)
        angles = matrix_log(rotated @ Q[:, None] @ R.swapaxes(-1, -2))
        return (off**2).sum(axis=(1, 2)) + TURN_LEVER_M**2 * (angles**2).sum(axis=(1, 2)), Q

    yaws, step = np.linspace(-np.pi, np.pi, YAWS, endpoint=False), 2.0 * np.pi / YAWS
    best = float(yaws[np.argmin(tried(yaws)[0])])
    for _ in range(3):  # minimum of a parabola through three headings
        left, middle, right = tried(best + step * np.array((-1.0, 0.0, 1.0)))[0].tolist()
        curvature = left - 2.0 * middle + right
        if curvature > 0.0:
            best += float(np.clip(0.5 * (left - right) / curvature, -1.0, 1.0)) * step
        step *= 0.1
    c = mean[0] - quat_to_matrix(quat_about_z(best)) @ mean[1]
    return Registration(best, c, tried(np.array([best]))[1][0])


def _mean_rotation(rotations: Array) -> Array:
    """Return the rotation nearest to several: (..., n, 3, 3) -> (..., 3, 3)."""
    U, _, V = np.linalg.svd(rotations.sum(axis=-3))
    V[..., 2, :] *= np.linalg.det(U @ V)[..., None]
    return np.asarray(U @ V)


def match_by_moves(ref: Keyframes, other: Keyframes) -> list[tuple[int, int]]:
    """Match in order, by the moves between matched keyframes, over up to MAX_SKIPS others. Dynamic programming."""
    n, m = len(ref), len(other)
    grip = _grip_cost(ref, other)
    before = SKIP_COST * (np.arange(n)[:, None] + np.arange(m))  # cost of all keyframes before a first match
    cost = grip + before
    back = np.zeros((n, m, 2), dtype=np.intp)
    ours, theirs = _move_features(ref), _move_features(other)
    for i in range(1, n):
        for a in range(1, min(i, MAX_SKIPS + 1) + 1):
            for b in range(1, min(m - 1, MAX_SKIPS + 1) + 1):
                move = _move_misfit(ours[a - 1][i - a], theirs[b - 1]) + SKIP_COST * (a + b - 2)
                total = cost[i - a, : m - b] + move + grip[i, b:]
                better = total < cost[i, b:]
                cost[i, b:][better] = total[better]
                back[i, b:][better] = (a, b)
    i, j = divmod(int(np.argmin(cost - before)), m)  # the fewer come after a last match, the better
    pairs = [(i, j)]
    while back[i, j].any():
        i, j = i - int(back[i, j][0]), j - int(back[i, j][1])
        pairs.append((i, j))
    return pairs[::-1]


def _move_features(keyframes: Keyframes) -> list[Array]:
    """Return horizontal distance (m), height (m) and angle (rad), (n - a, 3), of moves over a = 1, 2, ... keyframes."""
    features = []
    for a in range(1, MAX_SKIPS + 2):
        move = keyframes.p[a:] - keyframes.p[:-a]
        turn = matrix_log(keyframes.R[:-a].transpose(0, 2, 1) @ keyframes.R[a:])
        columns = np.hypot(move[:, 0], move[:, 1]), move[:, 2], np.linalg.norm(turn, axis=1)
        features.append(np.column_stack(columns).reshape(-1, 3))
    return features


def _move_misfit(one: Array, others: Array) -> Array:
    """Return the difference of moves in squared sigmas: (3,) and (k, 3) -> (k,)."""
    sigma = np.array((MATCH_M, MATCH_M, MATCH_RAD)) + MATCH_SHARE * np.abs(one)
    return np.asarray((((others - one) / sigma) ** 2).sum(axis=1))


def _grip_cost(ref: Keyframes, other: Keyframes) -> Array:
    differs = [[a != b for b in other.grip] for a in ref.grip]
    return GRIP_COST * np.array(differs, dtype=np.float64).reshape(len(ref), len(other))


def match_by_pose(ref: Keyframes, other: Keyframes) -> list[tuple[int, int]]:
    """Match keyframes of one frame, in order, by pose and grip. Dynamic programming."""
    n, m = len(ref), len(other)
    match = _pose_costs(ref, other)
    cost = SKIP_COST * (np.arange(n + 1)[:, None] + np.arange(m + 1.0))
    for i in range(n):
        for j in range(m):
            cost[i + 1, j + 1] = min(cost[i, j] + match[i, j], cost[i, j + 1] + SKIP_COST, cost[i + 1, j] + SKIP_COST)
    pairs, i, j = [], n, m
    while i and j:
        if cost[i, j] == cost[i - 1, j - 1] + match[i - 1, j - 1]:
            i, j = i - 1, j - 1
            pairs.append((i, j))
        elif cost[i, j] == cost[i - 1, j] + SKIP_COST:
            i -= 1
        else:
            j -= 1
    return pairs[::-1]


def may_match(ref: Keyframes, other: Keyframes) -> NDArray[np.bool_]:
    """Say of each keyframe (n,) whether it may match the one with the same index, by pose and grip."""
    return np.asarray(np.diagonal(_pose_costs(ref, other)) <= 2.0 * SKIP_COST)


def _pose_costs(ref: Keyframes, other: Keyframes) -> Array:
    """Return the cost of matching each keyframe with each, by pose and grip, in squared sigmas: (n, m)."""
    turn = matrix_log(ref.R[:, None] @ other.R[None].transpose(0, 1, 3, 2))
    square = ((ref.p[:, None] - other.p) ** 2).sum(axis=2)
    variance = MATCH_M**2 + ref.sigma[:, None] ** 2 + other.sigma**2
    return np.asarray(square / variance + (turn**2).sum(axis=2) / MATCH_RAD**2 + _grip_cost(ref, other))
