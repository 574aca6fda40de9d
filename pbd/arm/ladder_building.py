"""Build the ladder graph through all keyframes, whose shortest path has the least joint travel.

Each keyframe gets about a dozen configurations: some descend from those of the keyframe before, others from new seeds.
A redundant arm's shortest path is then moved along the null space, toward its neighbours and away from limits.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from pbd.arm.ik.branches import MARGIN_RAD, SAME_RAD, configuration_cost, find_branches, turn_toward
from pbd.arm.ik.levenberg_marquardt import SOLVED, Residual, descend_each
from pbd.arm.ik.partial_pose import is_redundant
from pbd.arm.ik.starts import distinct
from pbd.arm.ik.unreachable import out_of_reach
from pbd.arm.ladder_graph import Barred, Ladder, Layer, joint_travel
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

STARTS, STARTS_WIDE = 12, 81
"""Descents for each keyframe: at first; after moves next to it were barred."""
CONTINUOUS_RAD, MEND_AFTER_STEPS = 0.5, 60
"""Largest joint motion between two layers along a path, rad; number of barred moves after which the link is mended."""
VARIANTS = 3
"""Number of variants of a configuration, by whole turns of joints, that are kept at each keyframe. With two, an arm
whose home is turned over would turn back during the task, not on the way to its start (tests/test_planning.py)."""
SWEEPS = 3
"""Passes over the path; in each, every configuration moves along its null space toward the mean of its neighbours."""

_RIDGE = 1e-9 * np.eye(6)  # keeps the null-space projection solvable where the arm is singular


class States(NamedTuple):
    """Configurations of one pose, sorted by travel: q (m, k) rad, cost (m,) rad, travel from the start (m,) rad."""

    q: Array
    cost: Array
    travel: Array


def build_ladder(
    arm: ArmModel,
    T_base_tool: Sequence[Pose],
    q_start: Array,
    q_end: Array | None,
    mend_after: int,
    wide_cost: float = 0.0,
) -> Ladder:
    """Build the ladder of n poses: layer 0 is `q_start`, layer i + 1 pose i, the last one `q_end`; both (k,).

    `wide_cost`: see `Layer`; it does not apply to keyframe 0.

    Raises:
        PlanError: a pose can't be reached; see `out_of_reach`.
    """
    at = States(q_start[None], np.zeros(1), np.zeros(1))
    layers = [Layer(at.q, at.cost, mend_after)]
    for keyframe, pose in enumerate(T_base_tool):
        following = states_at(arm, pose, at, STARTS)
        if not len(following.q):
            raise out_of_reach(arm, keyframe, pose, at.q[0])
        at = following
        layers.append(Layer(at.q, at.cost, mend_after, wide_cost=wide_cost if keyframe > 0 else 0.0))
    if q_end is not None:
        layers.append(Layer(q_end[None], np.zeros(1), mend_after))
    ladder = Ladder(layers, arm.travel_scale)
    if is_redundant(arm):
        _move_along_null_space(arm, T_base_tool, ladder)
    return ladder


def states_at(arm: ArmModel, pose: Pose, before: States, starts: int) -> States:
    """Find the configurations of a pose; whole turns are chosen for the least travel from the states before."""
    found = find_branches(arm, pose, before.q, starts)
    if not len(found):
        return States(found, np.empty(0), np.empty(0))
    nearest = turn_toward(arm, found, before.q[:, None])
    total = before.travel[:, None] + np.linalg.norm((nearest - before.q[:, None]) * arm.travel_scale, axis=2)
    kept = _nearest_variants(found, nearest, total)
    q, total = nearest[kept], total[kept]
    cost = configuration_cost(arm, q)
    travel = total + cost
    order = np.argsort(travel)
    return States(q[order], cost[order], travel[order])


def _nearest_variants(found: Array, nearest: Array, total: Array) -> tuple[Array, Array]:
    """Return the rows and columns, in nearest (b, m, k), of the different variants of found (m, k).

    Of each configuration up to VARIANTS are kept, those with the least `total` travel (b, m).
    """
    shift = (nearest - found).reshape(total.size, -1)
    order = np.argsort(total.ravel(), kind="stable")
    which = order % len(found)
    # Variants of a configuration differ by whole turns, so that a weighted sum of the shifts tells them apart.
    turns = np.round(shift[order] / (2.0 * np.pi)) @ 64.0 ** np.arange(shift.shape[1])
    _, first = np.unique(which + 1j * turns, return_index=True)
    different = np.sort(first)  # the least travel first
    different = different[np.argsort(which[different], kind="stable")]
    rank = np.arange(len(different)) - np.searchsorted(which[different], which[different])
    return np.divmod(order[different[rank < VARIANTS]], len(found))


def layers_along(arm: ArmModel, ladder: Ladder, place: int, T_base_tool: Sequence[Pose]) -> list[Layer] | None:
    """Make one layer for each pose on a path that continues from layer `place`; None if a pose has no solution."""
    before, travel = ladder.layers[place], ladder.travel(place)
    order = np.argsort(travel)[: np.isfinite(travel).sum()]
    at, layers = States(before.q[order], before.cost[order], travel[order]), []
    for pose in T_base_tool:
        at = states_at(arm, pose, at, STARTS) if len(at.q) else at
        if not len(at.q):
            return None
        layers.append(Layer(at.q, at.cost, MEND_AFTER_STEPS, CONTINUOUS_RAD, costly=True))
    return layers


def widen(arm: ArmModel, pose: Pose, ladder: Ladder, place: int, starts: int = STARTS_WIDE) -> None:
    """Search for more configurations of a layer, from the states of the layer before; add those that are new."""
    before = ladder.layers[place - 1].q
    found = states_at(arm, pose, States(before, np.zeros(len(before)), np.zeros(len(before))), starts)
    _add_new(arm, ladder, place, found.q)


def add_turns(arm: ArmModel, ladder: Ladder, place: int, joint: int) -> int:
    """Add a layer's states, with one joint rotated by a whole turn within its limits; return how many are new."""
    q = np.repeat(ladder.layers[place].q, 2, axis=0)
    q[::2, joint] += 2.0 * np.pi
    q[1::2, joint] -= 2.0 * np.pi
    q = q[(q[:, joint] >= arm.limits.lower[joint]) & (q[:, joint] <= arm.limits.upper[joint])]
    return _add_new(arm, ladder, place, q)


def _add_new(arm: ArmModel, ladder: Ladder, place: int, q: Array) -> int:
    """Add to a layer those of the states (m, k) that it does not have; return how many."""
    known, q = ladder.layers[place].q, distinct(q, len(q), SAME_RAD)
    new = q[np.array([np.abs(known - each).max(axis=1).min() > SAME_RAD for each in q], dtype=bool)]
    if len(new):
        ladder.add(place, new, configuration_cost(arm, new))
    return len(new)


def turn_variants(arm: ArmModel, q: Array, before: Array, most: int) -> Array:
    """Return each configuration of q (m, k) in up to `most` variants, by whole turns of joints within the limits.

    Those nearest to any of `before` (b, k) come first.
    """
    turns = 2.0 * np.pi * np.array([*product(*((-1.0, 0.0, 1.0) if turn else (0.0,) for turn in arm.turns))])
    found = []
    for each in q:
        other = each + turns
        other = other[((other >= arm.limits.lower) & (other <= arm.limits.upper)).all(axis=1)]
        far = np.linalg.norm(other[:, None] - before, axis=2).min(axis=1)
        found.append(other[np.argsort(far, kind="stable")[:most]])
    return np.vstack(found)


def joints_to_unwind(arm: ArmModel, T_base_tool: Pose, q_before: Array, q: Array) -> set[int]:
    """Return the joints for which a start one whole turn away may make the move shorter.

    Such a joint turns back by more than half a turn between q_before and q, or the direct move to the pose would, to
    first order, exceed its limits.
    """
    off, J = Residual(arm, to_se3(T_base_tool))(q_before)
    q_goal = q_before - np.linalg.lstsq(J, off, rcond=None)[0]
    over = (q_goal < arm.limits.lower) | (q_goal > arm.limits.upper)
    back = np.abs(q - q_before) > np.pi
    return set(np.flatnonzero((over | back) & (arm.turns > 0.0)).tolist())


def _move_along_null_space(arm: ArmModel, T_base_tool: Sequence[Pose], ladder: Ladder) -> None:
    """Move each configuration of the shortest path along its null space; add the result to the layers.

    The direction is toward the mean of the two neighbours, and away from limits nearer than MARGIN_RAD.
    """
    shortest = ladder.shortest()
    assert not isinstance(shortest, Barred)  # nothing has been checked yet
    path = ladder.joints(shortest)
    costs = configuration_cost(arm, path)
    goals = [to_se3(pose) for pose in T_base_tool]
    margin, mobility = MARGIN_RAD / arm.travel_scale, 1.0 / arm.travel_scale**2
    for _ in range(SWEEPS):
        for i, goal in enumerate(goals, start=1):
            q, before, after = path[i], path[i - 1], path[i + 1] if i + 1 < len(path) else path[i - 1]
            pull = 0.5 * (before + after) - q
            over, under = q - arm.limits.lower, arm.limits.upper - q
            pull += np.maximum(0.0, margin - over) - np.maximum(0.0, margin - under)
            J = arm.jacobian(q)
            pull -= mobility * (J.T @ np.linalg.solve((J * mobility) @ J.T + _RIDGE, J @ pull))
            ended, squares = descend_each(arm, goal, (q + pull)[None])
            # The new configuration is an improvement if its cost is below this.
            most = costs[i] + joint_travel(np.array((before, q, after)), arm.travel_scale)
            most -= joint_travel(np.array((before, ended[0], after)), arm.travel_scale)
            if squares[0] < SOLVED and most > 0.0 and (cost := float(configuration_cost(arm, ended)[0])) < most:
                path[i], costs[i] = ended[0], cost
    for i in range(1, len(goals) + 1):
        _add_new(arm, ladder, i, path[i : i + 1])
