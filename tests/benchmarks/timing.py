"""How fast the arm is, and how fast a motion is planned: python tests/benchmarks/timing.py [--json] [--quick].

keyframes_ratio: straight moves between random joints of panda, ur5 and xarm7, against the time that the slowest joint
takes alone (ruckig), in the mean; keyframes_ratio_max: at worst. demo_ratio_max: `--path demo` on panda, the moves of a
whole demonstration against the acceleration-only optimum of the same paths (toppra), the worst of the demonstrations.
demo_ratio.NAME: the same for each robot; where a robot's jerk is low (A / J = 0.1 s on most) no motion comes near an
optimum that knows no jerk. jerk_ratio.NAME: against ruckig, which knows it, along straight lines. plan_ms: nine
keyframes on panda with collision checks, everything loaded; stages_ms: its parts (audit:
the audit of the motion, audit_load: what it loads for that, caches on disk warm); demo_ms: the same as the hand went.
process_s: `pbd export pouring` as a whole process, caches warm.
"""

import subprocess
import sys
import tempfile
import time
import warnings
from itertools import pairwise
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from ruckig import InputParameter, Ruckig, Trajectory

import pbd
from pbd.arm.ik.partial_pose import is_partial
from pbd.arm.timing.path_smoothing import Curve, curved_move
from pbd.arm.timing.time_moves import ptp_move
from pbd.audit.arm import AuditArm
from pbd.audit.audit import audit
from pbd.audit.collision_pairs import AuditScene
from pbd.data import HandPath, JointLimits, Keyframe, Robot
from pbd.files.find_by_name import names
from pbd.planning import PlanOptions, arm_of, plan_keyframes, scene_of
from pbd.pose import Array
from pbd.tracking.keyframes import find_keyframes
from tests.arm.collision_oracles import first_hit
from tests.arm.straight_moves import solve_path, time_keyframes
from tests.arm.toppra_oracle import toppra_duration
from tests.benchmarks.report import arguments, finish, median_ms

DEMOS = ("pouring", "paper-test1", "paper-test2")
KEYFRAMES = 9


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore")
    chosen = ("panda", "ur5") if args.quick else names("robots")
    tracked = {name: track(name) for name in DEMOS}
    straight = np.concatenate([straight_ratios(name, 50 if args.quick else 500) for name in ("panda", "ur5", "xarm7")])
    demo = {name: demo_ratio(name, tracked) for name in chosen}
    finish(
        {
            "keyframes_ratio": float(straight.mean()),
            "keyframes_ratio_max": float(straight.max()),
            "demo_ratio_max": demo["panda"],
            "demo_ratio": demo,
            "jerk_ratio": {name: jerk_ratio(name, 10 if args.quick else 50) for name in chosen},
            **planning(tracked["pouring"], 5 if args.quick else 21),
            "process_s": process_s(3 if args.quick else 7),
        },
        args.json,
    )


def track(name: str) -> tuple[HandPath, tuple[Keyframe, ...]]:
    """Track a bundled demonstration."""
    demo = pbd.load_demo(name)
    path = pbd.track(demo.recording, "default", demo.known)
    return path, find_keyframes(path)


def moves(robot: Robot, count: int) -> list[tuple[Array, Array]]:
    """Random joints to go from and to, uniform between limits; a joint that turns further within half a turn."""
    rng = np.random.default_rng(0)
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    return list(pairwise(rng.uniform(lower, upper, (count + 1, len(lower)))))


def straight_ratios(name: str, count: int) -> Array:
    """How much longer a straight move takes than its slowest joint would alone."""
    robot = pbd.load_robot(name)
    return np.array(
        [ptp_move(a, b, robot.limits, 1.0).duration / shortest(a, b, robot.limits) for a, b in moves(robot, count)]
    )


def shortest(start: Array, end: Array, limits: JointLimits) -> float:
    """Seconds that the slowest joint takes."""
    wanted, found = InputParameter(len(start)), Trajectory(len(start))
    wanted.current_position, wanted.target_position = start, end
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = limits.velocity, limits.acceleration, limits.jerk
    Ruckig(len(start)).calculate(wanted, found)
    return float(max(found.independent_min_durations))


def demo_ratio(name: str, tracked: dict[str, tuple[HandPath, tuple[Keyframe, ...]]]) -> float:
    """The worst of the demonstrations that the robot can follow: the moves' time against toppra's."""
    robot = pbd.load_robot(name)
    assert robot.dock is not None
    ratios = []
    for path, keyframes in tracked.values():
        try:
            plan = plan_keyframes(keyframes, robot.dock, robot, PlanOptions(path="demo"), path)
        except pbd.errors.PlanError:
            if not is_partial(arm_of(robot)):
                raise
            continue  # five joints can't follow every turn of the hand without a leap
        took = optimum = 0.0
        for before, way in pairwise(plan.segments):
            waypoints = np.vstack((before.q[-1], way.q))
            curve = Curve.through(waypoints, robot.limits)
            assert curve is not None
            took += curved_move(waypoints, robot.limits, 1.0).duration
            optimum += toppra_duration(curve.s, curve.q(curve.s), robot.limits)
        ratios.append(took / optimum)
    return max(ratios)


def jerk_ratio(name: str, count: int) -> float:
    """A line taken as a curve, against ruckig's optimum, in the mean."""
    robot = pbd.load_robot(name)
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return float(
        np.mean(
            [
                curved_move(a + share * (b - a), robot.limits, 1.0).duration
                / ptp_move(a, b, robot.limits, 1.0).duration
                for a, b in moves(robot, count)
            ]
        )
    )


def planning(tracked: tuple[HandPath, tuple[Keyframe, ...]], runs: int) -> dict[str, object]:
    """How long planning nine keyframes takes, and its parts."""
    path, keyframes = tracked[0], tracked[1][:KEYFRAMES]
    robot, grasped = pbd.load_robot("panda"), pbd.load_demo("pouring").grasped
    dock = robot.dock
    assert dock is not None
    arm = arm_of(robot)
    scene = scene_of(arm, dock, grasped)
    plan = plan_keyframes(keyframes, dock, robot, None, path, grasped)
    demo = PlanOptions(path="demo")
    q, grips, dwells = plan.trajectory.keyframe_q, [keyframe.grip for keyframe in keyframes], [0.5] * len(keyframes)
    return {
        "plan_ms": median_ms(lambda: plan_keyframes(keyframes, dock, robot, None, path, grasped), runs),
        "demo_ms": median_ms(lambda: plan_keyframes(keyframes, dock, robot, demo, path, grasped), max(3, runs // 4)),
        "stages_ms": {
            "ik": median_ms(lambda: solve_path(arm, plan.T_base_tool, robot.home), runs),
            "timing": median_ms(lambda: time_keyframes(arm, q, dwells, grips, robot.home), runs),
            "collision": median_ms(lambda: first_hit(scene, plan.trajectory), runs),
            "audit": median_ms(lambda: audit(plan.trajectory, robot, plan.T_base_tool, (dock, grasped)), runs),
            "audit_load": median_ms(lambda: AuditScene(AuditArm(robot), dock, grasped), runs),
        },
    }


def process_s(runs: int) -> float:
    """`pbd export` from start to end, the median of several."""
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out.npz")
        command = [sys.executable, "-m", "pbd", "export", "pouring", "--robot", "panda", "--format", "npz", "-o", out]
        took = []
        for _ in range(runs + 1):
            start = time.perf_counter()
            subprocess.run(command, capture_output=True, check=True)
            took.append(time.perf_counter() - start)
    return sorted(took[1:])[runs // 2]


if __name__ == "__main__":
    main()
