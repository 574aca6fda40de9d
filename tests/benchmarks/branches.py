"""All branches of a pose: python tests/benchmarks/branches.py [ARM ...] [--poses N] [--json] [--quick].

Poses are those of configurations uniform within the limits. A branch is a way to hold the arm that no continuous motion
with the tool at rest, within the limits, makes another: of six joints a single solution, of seven a curve along the
null space, traced from each solution in small steps to where a limit ends it. An arm of five joints has those ways that
hold the tool as near to the pose as any, and its poses are turned at random by up to 0.3 rad, so that it can't hold
them exactly. Whole turns count as nothing.

ARM: poses; branches, of all poses, that a search a hundred times as long as planning's finds (random descents, which
share nothing with a closed form); found_pct, those that planning finds too; complete_pct, poses of which it finds all;
complete_wide_pct, the same where planning searches wider since something is in the way; mean_ms, planning's time for a
pose; solutions, that it finds, of a pose.
"""

import os
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm.ik.branches import find_branches
from pbd.arm.ik.levenberg_marquardt import SOLVED, Residual, descend_each
from pbd.arm.ik.partial_pose import SLACK_RAD, is_partial, refine_partial
from pbd.arm.ik.starts import starts_of
from pbd.arm.ladder_building import STARTS, STARTS_WIDE
from pbd.arm.model import ArmModel, load_model, to_se3
from pbd.files.find_by_name import names
from pbd.files.robot import load_robot
from pbd.pose import Array, Pose
from tests.benchmarks import report
from tests.benchmarks.ik import one_turn, random_joints

LONGER = 100
STEP_RAD, LAST_STEP_RAD, MOST_STEPS = 0.04, 1e-3, 2000
"""Along the null space, and where a limit is near."""
SAME_RAD, SINGULAR = 0.03, 1e-3
TURNED_RAD = 0.3


def main() -> None:
    """Measure and print."""
    parser = report.arguments(str(__doc__))
    parser.add_argument("arms", nargs="*", metavar="ARM")
    parser.add_argument("--poses", type=int, default=1000)
    args = parser.parse_args()
    arms = args.arms or names("robots")
    figures = {name: measure(load_model(load_robot(name)), 10 if args.quick else args.poses) for name in arms}
    report.finish(figures, args.json)


def measure(arm: ArmModel, count: int) -> dict[str, Any]:
    """Look for the branches of so many poses."""
    rng, per_pose, took = np.random.default_rng(1), list[tuple[int, int, int, int]](), 0.0
    for q in random_joints(arm, count):
        pose = arm.forward(q)
        if is_partial(arm):
            axis = rng.normal(size=3)
            turn = rng.uniform(0.0, TURNED_RAD) * axis / np.linalg.norm(axis)
            pose = pose @ Pose.exp(np.concatenate((np.zeros(3), turn)))
        start = time.process_time()
        ours = find_branches(arm, pose, arm.robot.home[None], STARTS)
        took += time.process_time() - start
        wide = find_branches(arm, pose, arm.robot.home[None], STARTS_WIDE)
        known = branches(arm, to_se3(pose), q)
        first, second = (
            sum(bool(_near(arm, branch, some).any()) for branch in known) for some in (ours, np.vstack((ours, wide)))
        )
        per_pose.append((len(known), first, second, len(ours)))
    all_of, met, met_wide, solutions = np.array(per_pose).T
    return {
        "poses": count,
        "branches": int(all_of.sum()),
        "found_pct": 100.0 * float(met.sum() / all_of.sum()),
        "complete_pct": 100.0 * float((met == all_of).mean()),
        "complete_wide_pct": 100.0 * float((met_wide == all_of).mean()),
        "mean_ms": 1e3 * took / count,
        "solutions": float(solutions.mean()),
    }


def branches(arm: ArmModel, goal: Any, q: Array) -> list[Array]:
    """The branches, each as joints (m, k) along it, that a long search finds from all over, and from joints (k,)."""
    samples, half = starts_of(arm), LONGER * STARTS // 2
    seeds = np.vstack((q, samples.nearest(goal, half), samples.q[:half]))
    found, known = _partly(arm, goal, seeds) if is_partial(arm) else _all(arm, goal, seeds), list[Array]()
    for each in found:
        if not any(_near(arm, branch, each[None]).any() for branch in known):
            known.append(traced(arm, goal, each) if arm.model.nv > 6 else each[None])
    return known


def _all(arm: ArmModel, goal: Any, seeds: Array) -> Iterable[Array]:
    ended, squares = descend_each(arm, goal, seeds, all_seeds=True)
    for each in ended[squares < SOLVED]:
        # Where the arm is singular there are any number of ways.
        if np.linalg.svd(arm.jacobian(each), compute_uv=False)[-1] > SINGULAR:
            yield each


def _partly(arm: ArmModel, goal: Any, seeds: Array) -> Iterable[Array]:
    ways = [way for seed in seeds if (way := refine_partial(arm, goal, seed)).reached]
    least = min(way.weighted_rad for way in ways)
    return [way.q for way in ways if way.weighted_rad <= least + SLACK_RAD]


def traced(arm: ArmModel, goal: Any, q: Array) -> Array:
    """Go along the null space from joints (k,), both ways, until a limit or the place where it began: (m, k)."""
    residual, parts = Residual(arm, goal), list[Array]()
    for sign in (-1.0, 1.0):
        path, step, been_away = [q], STEP_RAD, False
        along = sign * _null(residual(q)[1])
        while len(path) < MOST_STEPS and step > LAST_STEP_RAD:
            after = path[-1] + step * along
            for _ in range(3):
                e, J = residual(after)
                after = after - np.linalg.lstsq(J, e, rcond=None)[0]
            if _inside(arm, after) and np.abs(after - path[-1]).max() < 2.0 * step:
                path.append(after)
                null = _null(residual(after)[1])
                along = null if null @ along > 0.0 else -null
                back = _apart(arm, after, q[None])[0]
                been_away = been_away or back > 4.0 * STEP_RAD
                if been_away and back < STEP_RAD:
                    return np.array(path)
            else:
                step *= 0.5
        parts.append(np.array(path[::-1] if sign < 0.0 else path))
    return np.vstack(parts)


def _null(J: Array) -> Array:
    null: Array = np.linalg.svd(J)[2][-1]
    return null


def _inside(arm: ArmModel, q: Array) -> bool:
    lower, upper = one_turn(arm)
    middle = 0.5 * (lower + upper)
    q = q - 2.0 * np.pi * arm.turns * np.round((q - middle) / (2.0 * np.pi))
    return bool(((q >= lower) & (q <= upper)).all())


def _near(arm: ArmModel, branch: Array, q: Array) -> Array:
    """Which of joints (n, k) lie on a branch (m, k)."""
    return np.array([_apart(arm, each, branch).min() < SAME_RAD for each in q], dtype=bool)


def _apart(arm: ArmModel, q: Array, others: Array) -> Array:
    way = q - others
    apart: Array = np.abs(way - 2.0 * np.pi * arm.turns * np.round(way / (2.0 * np.pi))).max(axis=1)
    return apart


if __name__ == "__main__":
    main()
