"""How much of what can be reached is: python tests/benchmarks/scenes.py [--json] [--quick] [--search S].

Random scenes (shelf, bin, portal, gap, clutter) for panda, ur5 and xarm7: from home to a first keyframe, to a second
among the obstacles, and back. scenes; feasible: solved, or solved by a search of S seconds (60) over the same checks,
keyframe by keyframe; solved, solved_pct: of the feasible ones; detours: those with a planner's move; median_s, p95_s,
max_s: of all scenes; wrong: accepted, and yet a link's original mesh overlaps an obstacle at one of the instants that
are 5 ms apart (dense.py, which shares nothing with the planner). kinds.KIND: the same for each kind of scene.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm.collision.queries import CollisionQueries
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.detour import find_detour
from pbd.arm.ik.branches import find_branches
from pbd.arm.model import ArmModel
from pbd.arm.motion import choose_motion
from pbd.arm.motion_request import DETOUR, Motion, MotionRequest, Segment
from pbd.arm.timing.moves import Move, time_moves
from pbd.data import Obstacle
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of
from tests.arm.dense import Dense
from tests.benchmarks.report import arguments, finish

ARMS = "panda", "ur5", "xarm7"
KINDS = "shelf", "bin", "portal", "gap", "clutter"
SEEDS, QUICK_SEEDS = 16, 1
"""Scenes of each kind for each arm."""
PAIRS = 8
"""Ways to hold the arm at each end between which the long search looks."""
CHECKS = 2000
"""Checks of one of its rounds."""


def main() -> None:
    """Measure and print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--search", type=float, default=60.0, metavar="S", help="s that the long search may take (60)")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    seeds = QUICK_SEEDS if args.quick else SEEDS
    tried = [
        (kind, *tell(name, kind, seed, 2.0 if args.quick else args.search))
        for name in ARMS
        for kind in KINDS
        for seed in range(seeds)
    ]
    kinds = {kind: figures([each[1:] for each in tried if each[0] == kind]) for kind in KINDS}
    finish({**figures([each[1:] for each in tried]), "kinds": kinds}, args.json)


def figures(tried: list[tuple[Motion | None, float, bool, bool]]) -> dict[str, float]:
    """All figures of some scenes."""
    took = [each[1] for each in tried]
    solved, feasible = sum(each[0] is not None for each in tried), sum(each[2] for each in tried)
    return {
        "scenes": len(tried),
        "feasible": feasible,
        "solved": solved,
        "solved_pct": 100.0 * solved / max(1, feasible),
        "detours": sum(DETOUR in [way.kind for way in ways(each[0])] for each in tried if each[0]),
        "median_s": float(np.median(took)),
        "p95_s": float(np.percentile(took, 95)),
        "max_s": max(took),
        "wrong": sum(each[3] for each in tried),
    }


def tell(name: str, kind: str, seed: int, search_s: float) -> tuple[Motion | None, float, bool, bool]:
    """One scene: the motion, process time in s, whether there is one, whether it is wrong."""
    arm, rng = arm_of(name), np.random.default_rng([seed, KINDS.index(kind), ARMS.index(name)])
    obstacles, poses = scene_of(arm, kind, rng)
    scene = CollisionScene(arm, None, obstacles)
    queries = CollisionQueries(arm, scene, poses, [None] * len(poses))
    if scene.hit(arm.robot.home) is not None:
        return tell(name, kind, seed + 1000, search_s)
    start = time.process_time()
    found = choose_motion(arm, MotionRequest(poses, arm.robot.home, q_back=arm.robot.home), queries)
    took = time.process_time() - start
    if isinstance(found, Motion):
        return found, took, True, wrong(arm, found, obstacles)
    return None, took, feasible(arm, queries, poses, search_s), False


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


def feasible(arm: ArmModel, queries: CollisionQueries, poses: list[Pose], search_s: float) -> bool:
    """Whether a long search comes from home to the first keyframe and on to the second, however the arm is held."""
    end = time.process_time() + search_s
    at = [arm.robot.home]
    for leg, pose in enumerate(poses):
        found = [q for q in find_branches(arm, pose, np.array(at), 200) if queries.standing(leg, q) is None][:PAIRS]
        reached: list[Array] = []
        checks = CHECKS
        while not reached and found and time.process_time() < end:
            reached = [
                q for q in found if any(find_detour(queries, leg, before, q, checks) is not None for before in at)
            ]
            checks *= 4
        if not reached:
            return False
        at = reached
    return True


def wrong(arm: ArmModel, motion: Motion, obstacles: list[Obstacle]) -> bool:
    """Whether an original mesh overlaps an obstacle anywhere on the timed motion."""
    moves = [Move(way.q, way.curved) for way in motion.segments]
    back = None if motion.back is None else Move(motion.back.q, motion.back.curved)
    timed = time_moves(arm, arm.robot.home, moves, [0.2] * len(moves), [None] * len(moves), retreat=back)
    dense = Dense(arm.robot, obstacles, every_s=5e-3)
    shapes = zip(dense.names, dense.geometry.geometryObjects, strict=True)
    moving = [name for name, shape in shapes if shape.parentJoint > 0]  # the base may stand in an obstacle
    pairs = {frozenset((link, obstacle.name)) for link in moving for obstacle in obstacles}
    return dense.touch(timed.trajectory, pairs, 0.0)


def ways(motion: Motion | None) -> list[Segment]:
    """All moves of a motion."""
    return [] if motion is None else [*motion.segments, *([motion.back] if motion.back else [])]


if __name__ == "__main__":
    main()
