"""Inverse kinematics and joint paths through keyframes: python tests/benchmarks/ik.py [--json] [--quick].

Poses are those of 10,000 configurations uniform within the limits (of an endless joint, within one turn). Success is
1e-5 m, 1e-5 rad and every joint within its limits, checked by pinocchio's model of the whole URDF. Times are the
processor's, on one core, with the seeds loaded.

robots.NAME: pbd, and pink (pin-pink with daqp, from the middle of the limits and then up to 20 random places, where it
is installed: pip install --group bench) on the first 1,000 of them: it is slow on arms of five joints, which pbd brings
to whole poses here too. All of it ends within five minutes.
sequence.NAME: 100 tasks of nine keyframes, smooth random joint paths of about a rad a move; failures, and travel as a
share of the path that made the task. unreachable_p95_ms: to decide that a pose is out of reach, and why.
branches.py has how many of a pose's branches are found.
"""

import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin

from pbd.arm.ik.solver import solve
from pbd.arm.ik.starts import reach
from pbd.arm.ik.unreachable import find_reason
from pbd.arm.model import ArmModel, from_se3, load_model, to_se3
from pbd.errors import PlanError
from pbd.files.find_by_name import names
from pbd.files.robot import load_robot
from pbd.pose import Array, Pose
from tests.arm.straight_moves import solve_path
from tests.benchmarks.report import arguments, finish

TOLERANCE = 1e-5
PINK_POSES = 1_000
PINK_RESTARTS, PINK_STEPS, PINK_DAMPING = 20, 25, 1e-2
"""Of those tried (25 and 50 steps, damping 0 to 0.1) pink is fastest with these."""
SEQUENCES = ("panda", "ur5", "xarm7")
KEYFRAMES = 9


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    poses, tasks, unreachable = (200, 20, 20) if args.quick else (10_000, 100, 100)
    arms = {name: load_model(load_robot(name)) for name in names("robots")}
    figures: dict[str, Any] = {"robots": {}}
    late = list[float]()
    for name, arm in arms.items():
        q = random_joints(arm, poses)
        wanted = [arm.forward(each) for each in q]
        solvers = {"pbd": solver(arm), "pink": pink_solver(arm)}
        counts = {"pbd": poses, "pink": min(poses, PINK_POSES)}
        figures["robots"][name] = {k: measure(arm, wanted[: counts[k]], each) for k, each in solvers.items() if each}
        late += unreachable_ms(arm, unreachable)
    figures["sequence"] = {name: sequences(arms[name], tasks) for name in SEQUENCES}
    figures["unreachable_p95_ms"] = float(np.percentile(late, 95))
    finish(figures, args.json)


def random_joints(arm: ArmModel, count: int) -> Array:
    """(count, k) rad, uniform within limits."""
    lower, upper = one_turn(arm)
    return np.random.default_rng(0).uniform(lower, upper, (count, len(lower)))


def one_turn(arm: ArmModel) -> tuple[Array, Array]:
    """The limits, an endless joint's being one turn."""
    endless = np.isinf(arm.limits.upper)
    return np.where(endless, -np.pi, arm.limits.lower), np.where(endless, np.pi, arm.limits.upper)


def measure(arm: ArmModel, wanted: Sequence[Pose], solve_one: Callable[[Pose], Array]) -> dict[str, float]:
    """Success and times of one solver."""
    solve_one(wanted[0])
    found, times = [], []
    for pose in wanted:
        start = time.process_time()
        found.append(solve_one(pose))
        times.append(1e3 * (time.process_time() - start))
    whole = whole_urdf(arm)
    off = [max(pose.distance(whole(q))) for pose, q in zip(wanted, found, strict=True)]
    within = [bool(((q >= arm.limits.lower) & (q <= arm.limits.upper)).all()) for q in found]
    reached = (np.array(off) <= TOLERANCE) & within
    p95, p99 = np.percentile(times, (95, 99))
    return {
        "n": len(wanted),
        "success_pct": 100.0 * float(reached.mean()),
        "mean_ms": float(np.mean(times)),
        "median_ms": float(np.median(times)),
        "p95_ms": float(p95),
        "p99_ms": float(p99),
        "max_ms": max(times),
    }


def solver(arm: ArmModel) -> Callable[[Pose], Array]:
    """Ours."""

    def solve_one(pose: Pose) -> Array:
        return solve(arm, pose).q

    return solve_one


def pink_solver(arm: ArmModel) -> Callable[[Pose], Array] | None:
    """pink's differential inverse kinematics with daqp, in steps as long as the limits let them be."""
    try:
        import pink
    except ImportError:
        print("pink isn't installed (pip install --group bench): left out", file=sys.stderr)
        return None
    model, data, rng = arm.model, arm.data.copy(), np.random.default_rng(1)
    lower, upper = one_turn(arm)
    frame = model.frames[arm.tool_id].name
    task = pink.FrameTask(frame, position_cost=1.0, orientation_cost=1.0, lm_damping=PINK_DAMPING)
    limits = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.0)]

    def angles(q: Array) -> Array:
        joints = list(model.joints)[1:]
        found = [q[j.idx_q] if j.nq == 1 else np.arctan2(q[j.idx_q + 1], q[j.idx_q]) for j in joints]
        # Rounding may lead a hair beyond the limits.
        clipped: Array = np.clip(found, arm.limits.lower, arm.limits.upper)
        return clipped

    def solve_one(pose: Pose) -> Array:
        target = to_se3(pose)
        task.set_target(target)
        q_start = 0.5 * (lower + upper)
        for _ in range(PINK_RESTARTS + 1):
            at = pink.Configuration(model, data, arm.configuration(q_start), copy_data=False)
            for _ in range(PINK_STEPS):
                try:
                    velocity = pink.solve_ik(at, [task], 1.0, solver="daqp", limits=limits)
                except pink.exceptions.NoSolutionFound:
                    break
                at.integrate_inplace(velocity, 1.0)
                off = target.actInv(data.oMf[arm.tool_id])
                if np.linalg.norm(off.translation) < TOLERANCE and np.linalg.norm(pin.log3(off.rotation)) < TOLERANCE:
                    return angles(at.q)
            q_start = rng.uniform(lower, upper)
        return angles(at.q)

    return solve_one


def whole_urdf(arm: ArmModel) -> Callable[[Array], Pose]:
    """T_base_tool by pinocchio's model of the whole URDF, which the solvers don't use."""
    robot, model = arm.robot, arm.full
    data = model.createData()
    base, body = (model.getFrameId(name, pin.FrameType.BODY) for name in (robot.base, robot.body))

    def tool(q: Array) -> Pose:
        pin.framesForwardKinematics(model, data, arm.configurations(np.append(q, 1.0)))
        return from_se3(data.oMf[base].actInv(data.oMf[body])) @ robot.T_body_tool

    return tool


def smooth_path(arm: ArmModel, seed: int) -> Array:
    """(KEYFRAMES + 1, k) rad: each move is like the one before, and about a rad long in all."""
    rng = np.random.default_rng(seed)
    lower, upper = one_turn(arm)
    width = upper - lower
    path = [rng.uniform(lower + 0.1 * width, upper - 0.1 * width)]
    move = rng.normal(size=len(lower))
    while len(path) <= KEYFRAMES:
        move = 0.6 * move + 0.8 * rng.normal(size=len(lower))
        q = path[-1] + move / np.sqrt(len(lower))
        if ((q > lower) & (q < upper)).all():
            path.append(q)
        else:
            move = rng.normal(size=len(lower))
    return np.array(path)


def sequences(arm: ArmModel, count: int) -> dict[str, float]:
    """Failures, travel and times of paths through keyframes."""
    whole, times, ratios, failures = whole_urdf(arm), [], [], 0
    for seed in range(count):
        truth = smooth_path(arm, seed)
        wanted = [arm.forward(q) for q in truth[1:]]
        start = time.process_time()
        try:
            path = solve_path(arm, wanted, truth[0])
        except PlanError:
            failures += 1
            continue
        times.append(1e3 * (time.process_time() - start))
        off = [max(pose.distance(whole(q))) for pose, q in zip(wanted, path, strict=True)]
        failures += max(off) > TOLERANCE or bool(((path < arm.limits.lower) | (path > arm.limits.upper)).any())
        ratios.append(travel(np.vstack((truth[0], path))) / travel(truth))
    return {
        "failures": failures,
        "travel_ratio_p95": float(np.percentile(ratios, 95)),
        "mean_ms": float(np.mean(times)),
        "p95_ms": float(np.percentile(times, 95)),
    }


def travel(path: Array) -> float:
    """Sum of |dq|, rad."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def unreachable_ms(arm: ArmModel, count: int) -> list[float]:
    """Times to decide and to explain, of poses all about, to half as far again as the arm reaches, turned anyhow."""
    rng, far, times = np.random.default_rng(2), reach(arm), list[float]()
    while len(times) < count:
        direction, wxyz = rng.normal(size=3), rng.normal(size=4)
        p = rng.uniform(0.05, 1.5) * far * direction / np.linalg.norm(direction)
        pose = Pose(p, wxyz / np.linalg.norm(wxyz))
        start = time.process_time()
        result = solve(arm, pose)
        if not result.reached:
            find_reason(arm, pose, result)
            times.append(1e3 * (time.process_time() - start))
    return times


if __name__ == "__main__":
    main()
