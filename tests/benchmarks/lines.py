"""How far the tool is off its lines: python tests/benchmarks/lines.py [ARM ...] [--lines N] [--json] [--quick].

Each line is planned alone, as `--path line` does, without collisions. One end of it is at random joints. The other is,
in half of the lines, at joints near them (sigma 0.5 rad), else up to half the arm's reach and 1.2 rad away. The
motion's 1 kHz samples are compared with the line by pinocchio and the whole URDF.

ARM: lines; planned; off_mm and off_mrad, [worst, 95th percentile]: the distance from the line, and the angle from the
even turn at the nearest place of both (none for five joints, which turn as they must); above_1_mm: lines farther off;
seconds: of all motions; process_s: of planning.
"""

import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin

from pbd.arm.ik.branches import find_branches
from pbd.arm.ik.partial_pose import is_partial
from pbd.arm.model import ArmModel
from pbd.data import Calibration, Keyframe, Robot
from pbd.errors import PlanError
from pbd.files.find_by_name import names
from pbd.files.robot import load_robot
from pbd.planning.options import PlanOptions
from pbd.planning.plan import plan_task
from pbd.planning.result import Plan
from pbd.planning.task import PlanningTask, arm_of
from pbd.pose import Array, Pose, matrix_log
from tests.benchmarks import report
from tests.benchmarks.ik import one_turn

LINES, QUICK_LINES = 150, 4
INSIDE_RAD, SIGMA_RAD, FARTHEST, TURNED_RAD = 0.05, 0.5, 0.5, 1.2
"""Ends: their joints' least distance from the limits; how the others differ; shares of the reach, and turns."""


def main() -> None:
    """Measure and print."""
    parser = report.arguments(str(__doc__))
    parser.add_argument("arms", nargs="*", metavar="ARM")
    parser.add_argument("--lines", type=int, default=LINES)
    args = parser.parse_args()
    count = QUICK_LINES if args.quick else args.lines
    warnings.simplefilter("ignore")
    report.finish({name: measure(load_robot(name), count) for name in args.arms or names("robots")}, args.json)


def measure(robot: Robot, count: int) -> dict[str, Any]:
    """Plan so many lines."""
    arm, off, seconds, took = arm_of(robot), list[tuple[float, float]](), 0.0, 0.0
    for seed in range(count):
        ends = random_ends(arm, np.random.default_rng(seed), near=seed % 2 == 0)
        keyframes = tuple(Keyframe(float(i), 0.5, pose, 1e-8 * np.eye(6)) for i, pose in enumerate(ends))
        calibration = Calibration("lines", T_base_nav=Pose.identity(), T_sensor_tool=Pose.identity())
        options = PlanOptions(path="line", approach=False, retreat=False, allow_collision=True)
        start = time.process_time()
        try:
            plan = plan_task(PlanningTask(keyframes, calibration, robot, None, None, options, no_free_motion=True))
        except PlanError:
            continue
        finally:
            took += time.process_time() - start
        if isinstance(plan, Plan):
            off.append(off_line(robot, plan.trajectory.q, *ends))
            seconds += plan.trajectory.duration
    away, turned = 1e3 * np.array(off).T
    return {
        "lines": count,
        "planned": len(off),
        "off_mm": worst_and_p95(away),
        "off_mrad": None if is_partial(arm) else worst_and_p95(turned),
        "above_1_mm": int((away > 1.0).sum()),
        "seconds": round(seconds, 3),
        "process_s": round(took, 2),
    }


def worst_and_p95(values: Array) -> list[float]:
    """Round both to two digits behind the point."""
    return [round(float(values.max()), 2), round(float(np.percentile(values, 95)), 2)]


def random_ends(arm: ArmModel, rng: np.random.Generator, *, near: bool) -> tuple[Pose, Pose]:
    """Draw both ends of a line, above the base's foot and within reach."""
    lower, upper = one_turn(arm)
    lower, upper = lower + INSIDE_RAD, upper - INSIDE_RAD
    reach = np.linalg.norm(arm.forward_many(rng.uniform(lower, upper, (300, len(lower))))[0], axis=1).max()
    while True:
        q = rng.uniform(lower, upper)
        start = arm.forward(q)
        if near or is_partial(arm):
            end = arm.forward(np.clip(q + rng.normal(0.0, SIGMA_RAD, len(q)), lower, upper))
        else:
            way, axis = rng.normal(size=(2, 3))
            shift = rng.uniform(0.0, FARTHEST * reach) * way / np.linalg.norm(way)
            turn = rng.uniform(0.0, TURNED_RAD) * axis / np.linalg.norm(axis)
            end = Pose(start.p + shift, (start @ Pose.exp(np.concatenate((np.zeros(3), turn)))).wxyz)
        if min(start.p[2], end.p[2]) > 0.0 and len(find_branches(arm, end, q[None], 12)):
            return start, end


def off_line(robot: Robot, q: Array, start: Pose, end: Pose) -> tuple[float, float]:
    """Return how far the tool is off a line, m, and off its even turn, rad, at joints q (n, k)."""
    p, R = tool(robot, q)
    along, turn = end.p - start.p, matrix_log(start.matrix()[:3, :3].T @ end.matrix()[:3, :3])
    turned = matrix_log(start.matrix()[:3, :3].T @ R)
    shares = [
        np.clip(way, 0.0, 1.0)[:, None]
        for way in (
            (p - start.p) @ along / (along @ along),
            ((p - start.p) @ along + turned @ turn) / (along @ along + turn @ turn),
        )
    ]
    away = np.linalg.norm(p - start.p - shares[0] * along, axis=1)
    wanted = np.array([pin.exp3(share * turn) for share in shares[1][:, 0]])
    angle = np.linalg.norm(matrix_log(wanted.swapaxes(1, 2) @ (start.matrix()[:3, :3].T @ R)), axis=1)
    return float(away.max()), float(angle.max())


def tool(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Return the tool's positions and rotations in base, by pinocchio and the whole URDF."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data, x = model.createData(), pin.neutral(model)
    joints = [model.joints[model.getJointId(name)] for name in robot.joints]
    base, body = (model.getFrameId(name, pin.FrameType.BODY) for name in (robot.base, robot.body))
    T_body_tool, places = pin.SE3(robot.T_body_tool.matrix()), list[pin.SE3]()
    for row in q:
        for joint, value in zip(joints, row, strict=True):
            x[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(value), np.sin(value)) if joint.nq == 2 else value
        pin.framesForwardKinematics(model, data, x)
        places.append(data.oMf[base].actInv(data.oMf[body]) * T_body_tool)
    return np.array([place.translation for place in places]), np.array([place.rotation for place in places])


if __name__ == "__main__":
    main()
