"""How long collision checks take, for every robot: python tests/benchmarks/collision.py [--json] [--quick].

robots.NAME: pairs that are watched, with the table and three obstacles; dropped_pairs of links; check_us: one
configuration; move_ms: a straight move in joint space; motion_ms: a whole motion through nine keyframes with a grasped
ball (mean and p95 over motions that are free, the dearest kind), of motion_s seconds, and how many distances it asks
for (looks); false_pct: free configurations (by the raw meshes) that are called self-collisions; build_ms: the scene,
with the caches on disk warm.
"""

import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.arm.collision.allowed_collisions import link_pairs, sample_coordinates
from pbd.arm.collision.clearance import Clearance
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.model import ArmModel, load_model
from pbd.data import GraspedObject, JointTrajectory, Obstacle
from pbd.files.find_by_name import names
from pbd.files.robot import load_robot
from pbd.pose import Array, Pose
from tests.arm.collision_oracles import first_hit, links_touching, links_watched, raw_meshes
from tests.arm.straight_moves import time_keyframes
from tests.benchmarks.report import arguments, finish, median_ms

BALL = GraspedObject("sphere", (0.03,))
SPREAD_RAD = 0.35


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore")
    motions = 4 if args.quick else 20
    finish({"robots": {name: measure(name, motions) for name in names("robots")}}, args.json)


def measure(name: str, motions: int) -> dict[str, float]:
    """All figures of one robot."""
    robot = load_robot(name)
    arm = load_model(robot)
    scene = build(arm)
    free = [x[:-1] for x in sample_coordinates(arm, 400) if scene.hit(x[:-1]) is None]
    moves = [(a, a + 0.3 * (b - a)) for a, b in zip(free[:20], free[20:40], strict=False)]
    chosen = free_motions(scene, motions)
    times = np.array([timed_ms(partial(first_hit, scene, trajectory)) for trajectory in chosen])
    return {
        "pairs": float(len(scene.always.pairs)),
        "dropped_pairs": float(len(link_pairs(arm)[1])),
        "build_ms": median_ms(lambda: build(load_model(robot)), 5),
        "check_us": 1e3 * median_ms(lambda: [scene.hit(q) for q in free], 5) / len(free),
        "move_ms": median_ms(lambda: [scene.check_path(np.stack(move)) for move in moves], 5) / len(moves),
        "motion_ms": float(times.mean()),
        "motion_p95_ms": float(np.percentile(times, 95)),
        "motion_s": float(np.mean([trajectory.duration for trajectory in chosen])),
        "looks": float(np.mean([looks(scene, trajectory) for trajectory in chosen])),
        "false_pct": false_pct(name, 50 if motions < 10 else 400),
    }


def build(arm: ArmModel) -> CollisionScene:
    """The robot over its table, with a box, a cylinder and a sphere on either side and behind, sized to its reach."""
    x, y, _ = arm.forward(arm.robot.home).p
    reach, ahead = float(np.hypot(x, y)), float(np.arctan2(y, x))
    table = arm.robot.dock.table_height if arm.robot.dock else None
    around = [("box", (0.4, 0.2, 0.4), 1.2), ("cylinder", (0.2, 0.6), 2.5), ("sphere", (0.4,), -1.2)]
    obstacles = [
        Obstacle(
            shape,
            shape,
            tuple(reach * side for side in size),
            Pose.from_rpy(1.2 * reach * np.array([np.cos(ahead + angle), np.sin(ahead + angle), 0.3]), (0, 0, 0)),
        )
        for shape, size, angle in around
    ]
    return CollisionScene(arm, table, obstacles, BALL)


def free_motions(scene: CollisionScene, count: int) -> list[JointTrajectory]:
    """Motions through nine random keyframes around home, the third of which grips and the seventh lets go."""
    arm, rng = scene.arm, np.random.default_rng(0)
    found: list[JointTrajectory] = []
    grips = [None, None, True, None, None, None, False, None, None]
    for _ in range(50 * count):
        spread = rng.uniform(-SPREAD_RAD, SPREAD_RAD, (9, len(arm.robot.joints)))
        q: Array = np.clip(arm.robot.home + spread, arm.limits.lower, arm.limits.upper)
        trajectory = time_keyframes(arm, q, [0.2] * 9, grips, arm.robot.home)
        if first_hit(scene, trajectory) is None:
            found.append(trajectory)
        if len(found) == count:
            break
    return found


def looks(scene: CollisionScene, trajectory: JointTrajectory) -> int:
    """How many distances a check asks for."""
    count, asked = 0, Clearance._distance

    def counted(self: Clearance, pair: int) -> float:
        nonlocal count
        count += 1
        return asked(self, pair)

    Clearance._distance = counted  # type: ignore[method-assign]
    first_hit(scene, trajectory)
    Clearance._distance = asked  # type: ignore[method-assign]
    return count


def false_pct(name: str, count: int) -> float:
    """The share of free configurations (by the raw meshes) that the convex parts call touching."""
    raw = raw_meshes(name)
    scene = CollisionScene(raw.arm)
    raw.watch(links_watched(scene.always))
    free = [x for x in sample_coordinates(raw.arm, count) if not raw.touching(x)]
    known = set(raw.links)  # of a link that can only be seen there is no raw collision mesh to compare with
    called = [any(pair <= known for pair in links_touching(scene.always, x)) for x in free]
    return 100.0 * float(np.mean(called))


def timed_ms(call: Callable[[], object]) -> float:
    """The best of three."""
    best = np.inf
    for _ in range(3):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return 1e3 * best


if __name__ == "__main__":
    main()
