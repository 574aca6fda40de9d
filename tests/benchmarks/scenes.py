"""How much of what can be reached is: python tests/benchmarks/scenes.py [--json] [--quick] [--seeds N] [--search S].

Random scenes (shelf, bin, portal, gap, clutter) for panda, ur5 and xarm7: from home to a first keyframe, to a second
among the obstacles, and back. Where the planner finds no way, a long search of S seconds (60) looks for one on the
original meshes; it shares nothing with the planner (long_search.py). `--sample N` (8) of the scenes that are solved,
taken at random, are searched too, five times, for `--short S` seconds each (10). `--first N` takes other seeds.
`--resume FILE` keeps what was found there, and goes on from it. Everything is planned first, then come the long
searches, then the sample.

scenes; solved: by the planner; pending: not solved, and not searched yet; feasible: solved by the planner or a search;
solved_pct: by the planner, of the feasible ones, once none is pending; detours: those with a move of OMPL's; median_s,
p95_s, max_s: process time of planning; compared, travel_median, travel_p95: solved scenes that were searched with
success, and joint travel over the least of the searches there; wrong: accepted, and yet original meshes overlap at one
of the instants that are 5 ms apart. kinds.KIND, arms.ARM: the same for each.
"""

import json
import sys
import time
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm.choose_motion import choose_motion
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import DETOUR, Motion, MotionRequest, Segment
from pbd.arm.timing.time_moves import Move, time_moves
from pbd.data import Obstacle
from pbd.pose import Pose
from tests.arm.bundled import arm_of
from tests.benchmarks.long_search import DenseScene, search
from tests.benchmarks.report import arguments, finish

ARMS = "panda", "ur5", "xarm7"
KINDS = "shelf", "bin", "portal", "gap", "clutter"
SEEDS, QUICK_SEEDS = 16, 1
"""Scenes of each kind for each arm."""
SEARCH_S, QUICK_SEARCH_S = 60.0, 1.0
"""How long the search takes where the planner found no way, s."""
SAMPLE, QUICK_SAMPLE, SEARCHES, SHORT_S = 8, 1, 5, 10.0
"""Solved scenes that are searched too, how often, and for how long each time, s; `--quick` takes QUICK_SEARCH_S."""


@dataclass
class Told:
    """What is known of a scene: process time, s, joint travel, rad (None: no way), whether OMPL helped, and if wrong.

    `least` is the least joint travel of the searches, once those were made.
    """

    arm: str
    kind: str
    seed: int
    took_s: float
    travel: float | None
    detour: bool
    wrong: bool
    searched: bool = False
    least: float | None = None

    def __str__(self) -> str:
        """Say how a scene went, in a line."""
        ways = [f"{name} {way:.2f} rad" for name, way in (("planned", self.travel), ("search", self.least)) if way]
        said = ", ".join(ways) or "no way"
        return f"{self.arm} {self.kind} {self.seed}: {self.took_s:.2f} s, {said}{', WRONG' if self.wrong else ''}"


def main() -> None:
    """Measure and print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--seeds", type=int, metavar="N", help=f"scenes of each kind for each arm ({SEEDS})")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="the first of these seeds (0)")
    parser.add_argument(
        "--search", type=float, metavar="S", help=f"s of the search for what is unsolved ({SEARCH_S:g})"
    )
    parser.add_argument("--sample", type=int, metavar="N", help=f"solved scenes that are searched too ({SAMPLE})")
    parser.add_argument("--short", type=float, metavar="S", help=f"s of each of their five searches ({SHORT_S:g})")
    parser.add_argument("--resume", type=Path, metavar="FILE", help="keep what was found here, and go on from it")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    seeds = args.seeds or (QUICK_SEEDS if args.quick else SEEDS)
    search_s = (QUICK_SEARCH_S if args.quick else SEARCH_S) if args.search is None else args.search
    sample = (QUICK_SAMPLE if args.quick else SAMPLE) if args.sample is None else args.sample
    short_s = (QUICK_SEARCH_S if args.quick else SHORT_S) if args.short is None else args.short
    asked = [(name, kind, seed) for seed in range(args.first, args.first + seeds) for name in ARMS for kind in KINDS]
    known = read(args.resume)
    for key in asked:
        if key not in known:
            note(known, tell(*key), args.resume)
    missed = [key for key in asked if known[key].travel is None] if search_s else []
    solved = [key for key in asked if known[key].travel is not None]
    chosen = np.random.default_rng(1).permutation(len(solved))[:sample]
    for key in [*missed, *(solved[i] for i in chosen)]:
        if not known[key].searched:
            note(known, look_longer(known[key], search_s, short_s), args.resume)
    tried = [known[key] for key in asked]
    kinds = {kind: figures([told for told in tried if told.kind == kind]) for kind in KINDS}
    arms = {name: figures([told for told in tried if told.arm == name]) for name in ARMS}
    finish({**figures(tried), "kinds": kinds, "arms": arms}, args.json)


def read(path: Path | None) -> dict[tuple[str, str, int], Told]:
    """What an earlier run found: the last line of each scene counts."""
    if path is None or not path.exists():
        return {}
    found = [Told(**json.loads(line)) for line in path.read_text().splitlines()]
    return {(told.arm, told.kind, told.seed): told for told in found}


def note(known: dict[tuple[str, str, int], Told], told: Told, path: Path | None) -> None:
    """Keep what was found of a scene."""
    known[told.arm, told.kind, told.seed] = told
    print(told, file=sys.stderr, flush=True)
    if path is not None:
        with path.open("a") as file:
            file.write(json.dumps(asdict(told)) + "\n")


def figures(tried: list[Told]) -> dict[str, float]:
    """All figures of some scenes."""
    took = [each.took_s for each in tried]
    pending = sum(each.travel is None and not each.searched for each in tried)
    solved = [each for each in tried if each.travel is not None]
    feasible = [each for each in tried if each.travel is not None or each.least is not None]
    ratios = [each.travel / each.least for each in solved if each.travel is not None and each.least is not None]
    return {
        "scenes": len(tried),
        "solved": len(solved),
        "pending": pending,
        "feasible": len(feasible),
        "solved_pct": float("nan") if pending else 100.0 * len(solved) / max(1, len(feasible)),
        "detours": sum(each.detour for each in solved),
        "median_s": float(np.median(took)),
        "p95_s": float(np.percentile(took, 95)),
        "max_s": max(took),
        "compared": len(ratios),
        "travel_median": float(np.median(ratios)) if ratios else float("nan"),
        "travel_p95": float(np.percentile(ratios, 95)) if ratios else float("nan"),
        "wrong": sum(each.wrong for each in tried),
    }


def made(name: str, kind: str, seed: int) -> tuple[ArmModel, list[Obstacle], list[Pose]]:
    """A scene in which the arm may stand at home: where it can't, the scene of another seed."""
    arm, rng = arm_of(name), np.random.default_rng([seed, KINDS.index(kind), ARMS.index(name)])
    obstacles, poses = scene_of(arm, kind, rng)
    if CollisionScene(arm, None, obstacles).hit(arm.robot.home) is not None:
        return made(name, kind, seed + 1000)
    return arm, obstacles, poses


def tell(name: str, kind: str, seed: int) -> Told:
    """Plan one scene, and check what was found."""
    arm, obstacles, poses = made(name, kind, seed)
    scene = CollisionScene(arm, None, obstacles)
    start = time.process_time()
    found = choose_motion(arm, MotionRequest(poses, arm.robot.home, q_retreat=arm.robot.home), scene)
    took = time.process_time() - start
    if not isinstance(found, Motion):
        return Told(name, kind, seed, took, None, False, False)
    detour = DETOUR in [way.kind for way in ways(found)]
    return Told(name, kind, seed, took, travel(found), detour, wrong(arm, found, DenseScene(arm, obstacles)))


def look_longer(told: Told, search_s: float, short_s: float) -> Told:
    """Search a scene: once and long where it isn't solved, else a few times."""
    arm, obstacles, poses = made(told.arm, told.kind, told.seed)
    dense, (count, each_s) = DenseScene(arm, obstacles), (1, search_s) if told.travel is None else (SEARCHES, short_s)
    travels = [search(dense, poses, each_s, seed) for seed in range(count)]
    return replace(told, searched=True, least=min((each for each in travels if each is not None), default=None))


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
    back = None if motion.retreat is None else Move(motion.retreat.q, motion.retreat.curved)
    trajectory, _ = time_moves(arm, arm.robot.home, moves, [0.2] * len(moves), [None] * len(moves), retreat=back)
    return dense.touches(trajectory)


def travel(motion: Motion) -> float:
    """Joint travel, rad, from home to home."""
    parts = np.vstack([way.q for way in ways(motion)])
    home = parts[-1] if motion.retreat else motion.q[0]
    return float(np.linalg.norm(np.diff(np.vstack((home, parts)), axis=0), axis=1).sum())


def ways(motion: Motion) -> list[Segment]:
    """All moves of a motion."""
    return [*motion.segments, *([motion.retreat] if motion.retreat else [])]


if __name__ == "__main__":
    main()
