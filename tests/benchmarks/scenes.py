"""How much of what can be reached is: python tests/benchmarks/scenes.py [--json] [--quick] [--seeds N] [--search S].

Random scenes (shelf, bin, portal, gap, clutter) for panda, ur5 and xarm7: from home to a first keyframe, to a second
among the obstacles, and back. Beside the planner five long searches of S seconds each (60) look for a way on the
original meshes; they share nothing with it (long_search.py). scenes; feasible: solved by the planner or a search;
searched: by a search; solved, solved_pct: by the planner, of the feasible ones; detours: those with a move of OMPL's;
median_s, p95_s, max_s: process time of all scenes; travel_median, travel_p95: joint travel over the least of the
searches, where both found a way; wrong: accepted, and yet original meshes overlap at one of the instants that are 5 ms
apart. kinds.KIND: the same for each kind of scene.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm.collision.queries import CollisionQueries
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.model import ArmModel
from pbd.arm.motion import choose_motion
from pbd.arm.motion_request import DETOUR, Motion, MotionRequest, Segment
from pbd.arm.timing.moves import Move, time_moves
from pbd.data import Obstacle
from pbd.pose import Pose
from tests.arm.bundled import arm_of
from tests.benchmarks.long_search import DenseScene, search
from tests.benchmarks.report import arguments, finish

ARMS = "panda", "ur5", "xarm7"
KINDS = "shelf", "bin", "portal", "gap", "clutter"
SEEDS, QUICK_SEEDS = 16, 1
"""Scenes of each kind for each arm."""
SEARCHES, SEARCH_S, QUICK_SEARCH_S = 5, 60.0, 1.0
"""Long searches of each scene, and how long each takes, s."""


class Told(NamedTuple):
    """What was found of a scene: the motion, process time in s, the least joint travel of the searches, if wrong."""

    motion: Motion | None
    took_s: float
    least: float | None
    wrong: bool


def main() -> None:
    """Measure and print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--seeds", type=int, metavar="N", help=f"scenes of each kind for each arm ({SEEDS})")
    parser.add_argument("--search", type=float, metavar="S", help=f"s that each long search takes ({SEARCH_S:g})")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    seeds = args.seeds or (QUICK_SEEDS if args.quick else SEEDS)
    search_s = (QUICK_SEARCH_S if args.quick else SEARCH_S) if args.search is None else args.search
    tried = [(kind, tell(name, kind, seed, search_s)) for seed in range(seeds) for name in ARMS for kind in KINDS]
    kinds = {kind: figures([told for each, told in tried if each == kind]) for kind in KINDS}
    finish({**figures([told for _, told in tried]), "kinds": kinds}, args.json)


def figures(tried: list[Told]) -> dict[str, float]:
    """All figures of some scenes."""
    took = [each.took_s for each in tried]
    solved, feasible = [each for each in tried if each.motion], [each for each in tried if each.motion or each.least]
    ratios = [travel(each.motion) / each.least for each in solved if each.motion and each.least] or [float("nan")]
    return {
        "scenes": len(tried),
        "feasible": len(feasible),
        "searched": sum(each.least is not None for each in tried),
        "solved": len(solved),
        "solved_pct": 100.0 * len(solved) / max(1, len(feasible)),
        "detours": sum(DETOUR in [way.kind for way in ways(each.motion)] for each in solved),
        "median_s": float(np.median(took)),
        "p95_s": float(np.percentile(took, 95)),
        "max_s": max(took),
        "travel_median": float(np.median(ratios)),
        "travel_p95": float(np.percentile(ratios, 95)),
        "wrong": sum(each.wrong for each in tried),
    }


def tell(name: str, kind: str, seed: int, search_s: float) -> Told:
    """Plan and search one scene."""
    arm, rng = arm_of(name), np.random.default_rng([seed, KINDS.index(kind), ARMS.index(name)])
    obstacles, poses = scene_of(arm, kind, rng)
    scene = CollisionScene(arm, None, obstacles)
    queries = CollisionQueries(arm, scene, poses, [None] * len(poses))
    if scene.hit(arm.robot.home) is not None:
        return tell(name, kind, seed + 1000, search_s)
    start = time.process_time()
    found = choose_motion(arm, MotionRequest(poses, arm.robot.home, q_back=arm.robot.home), queries)
    took = time.process_time() - start
    motion, dense = found if isinstance(found, Motion) else None, DenseScene(arm, obstacles)
    travels = [search(dense, poses, search_s, seed) for seed in range(SEARCHES)]
    least = min((each for each in travels if each is not None), default=None)
    told = Told(motion, took, least, motion is not None and wrong(arm, motion, dense))
    print(f"{name} {kind} {seed}: {took:.2f} s, {told_ratio(told)}", file=sys.stderr, flush=True)
    return told


def told_ratio(told: Told) -> str:
    """Say how a scene went, in a word or two."""
    if told.motion is None:
        return "no way" if told.least is None else "missed"
    said = "alone" if told.least is None else f"travel {travel(told.motion) / told.least:.2f}"
    return f"WRONG, {said}" if told.wrong else said


def scene_of(arm: ArmModel, kind: str, rng: np.random.Generator) -> tuple[list[Obstacle], list[Pose]]:
    """Obstacles, and two keyframes, the second among them, with the tool as at home but for a turn about z."""
    home = arm.forward(arm.robot.home)
    reach, ahead = float(np.hypot(*home.p[:2])), float(np.arctan2(home.p[1], home.p[0]))

    def at(far: float, aside: float, z: float, turn: float = 0.0) -> Pose:
        p = np.array([far * np.cos(ahead) - aside * np.sin(ahead), far * np.sin(ahead) + aside * np.cos(ahead), z])
        return Pose.from_rpy(p, (0.0, 0.0, ahead + turn))

    def keyframe(far: float, aside: float, z: float) -> Pose:
        return Pose(at(far, aside, z).p, (Pose.from_rpy(np.zeros(3), (0, 0, rng.uniform(-0.6, 0.6))) @ home).wxyz)

    def box(name: str, size: tuple[float, ...], far: float, aside: float, z: float) -> Obstacle:
        return Obstacle(name, "box", size, at(far, aside, z))

    side, far, z = float(rng.choice([-1.0, 1.0])), rng.uniform(0.85, 1.15) * reach, rng.uniform(0.05, 0.25)
    aside, wide = side * rng.uniform(0.2, 0.4), rng.uniform(0.2, 0.35)
    first = keyframe(rng.uniform(0.8, 1.1) * reach, -side * rng.uniform(0.2, 0.35), rng.uniform(0.15, 0.4))
    second = keyframe(far, aside, z)
    if kind == "shelf":
        boards = [
            box(f"board {i}", (0.3, 2.0 * wide, 0.02), far + 0.1, aside, z + up) for i, up in ((0, -0.1), (1, 0.35))
        ]
        return [*boards, box("the back", (0.02, 2.0 * wide, 0.5), far + 0.26, aside, z + 0.1)], [first, second]
    if kind == "bin":
        high = rng.uniform(0.1, 0.25)
        walls = [
            box(f"side {i}", (0.02, 2.0 * wide, high) if along else (2.0 * wide, 0.02, high), far + u, aside + v, z)
            for i, (along, u, v) in enumerate(((1, wide, 0), (1, -wide, 0), (0, 0, wide), (0, 0, -wide)))
        ]
        return walls, [first, second]
    if kind == "portal":
        posts = [
            box(f"post {i}", (0.05, 0.05, 1.0), far - 0.1, 0.5 * aside + v, 0.5) for i, v in ((0, -wide), (1, wide))
        ]
        return [*posts, box("the beam", (0.05, 2.0 * wide, 0.05), far - 0.1, 0.5 * aside, z + 0.4)], [first, second]
    if kind == "gap":
        middle, open_m = z + rng.uniform(0.05, 0.15), rng.uniform(0.3, 0.45)
        low = box("the sill", (0.6, 0.02, 0.4), far, 0.3 * aside, middle - 0.5 * open_m - 0.2)
        return [low, box("the lintel", (0.6, 0.02, 0.4), far, 0.3 * aside, middle + 0.5 * open_m + 0.2)], [
            first,
            second,
        ]
    spots = [at(rng.uniform(0.5, 1.3) * reach, rng.uniform(-0.5, 0.5), rng.uniform(0.0, 0.7)) for _ in range(10)]
    return [Obstacle(f"ball {i}", "sphere", (rng.uniform(0.08, 0.2),), spot) for i, spot in enumerate(spots)], [
        first,
        second,
    ]


def wrong(arm: ArmModel, motion: Motion, dense: DenseScene) -> bool:
    """Whether original meshes overlap anywhere on the timed motion."""
    moves = [Move(way.q, way.curved) for way in motion.segments]
    back = None if motion.back is None else Move(motion.back.q, motion.back.curved)
    timed = time_moves(arm, arm.robot.home, moves, [0.2] * len(moves), [None] * len(moves), retreat=back)
    return dense.touches(timed.trajectory)


def travel(motion: Motion) -> float:
    """Joint travel, rad, from home to home."""
    parts = np.vstack([way.q for way in ways(motion)])
    home = parts[-1] if motion.back else motion.q[0]
    return float(np.linalg.norm(np.diff(np.vstack((home, parts)), axis=0), axis=1).sum())


def ways(motion: Motion | None) -> list[Segment]:
    """All moves of a motion."""
    return [] if motion is None else [*motion.segments, *([motion.back] if motion.back else [])]


if __name__ == "__main__":
    main()
