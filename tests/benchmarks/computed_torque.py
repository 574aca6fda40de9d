"""The exported pouring in MuJoCo under computed torque: python tests/benchmarks/computed_torque.py [--json] [--quick].

Each arm's `pbd export pouring` (npz, 1 kHz) is read back, and what it commands is simulated: MuJoCo's own inverse
dynamics of the commanded acceleration, corrected by the error of position and velocity. The arm starts at the file's
first sample, turned by 2 mrad in every joint. The simulation takes two steps a sample; fingers and other joints that
the file doesn't drive are held as if welded.

ARM: duration_s; at each keyframe how far the tool is from where the plan has it (worst_mm, of all keyframes);
end_mm; torque_pct, the largest share of the limits that the simulated motors gave.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.cli import main as pbd
from pbd.data import Load
from pbd.planning import plan_keyframes
from pbd.pose import Array
from tests.arm.bundled import NAMES, arm_of, keyframes_of
from tests.audit.mujoco_arm import MujocoArm
from tests.benchmarks import report

STIFFNESS, DAMPING = 400.0, 40.0
"""Of the errors, per s^2 and s: critically damped, 20 rad/s."""
STEPS = 2
OFF_RAD = 2e-3


def main() -> None:
    """Simulate and print."""
    args = report.arguments(str(__doc__)).parse_args()
    report.finish({name: simulate(name) for name in (NAMES[:1] if args.quick else NAMES)}, args.json)


def simulate(name: str) -> dict[str, Any]:
    """Run one arm's export."""
    import mujoco

    arm = arm_of(name)
    dock = arm.robot.dock
    if dock is None:
        raise ValueError(f"{name} has no dock")
    plan = plan_keyframes(keyframes_of("pouring"), dock, arm.robot)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pouring.npz"
        if pbd(["export", "pouring", "--robot", name, "-o", str(path)]):
            raise RuntimeError(f"{name}: export failed")
        file = dict(np.load(path))
    t, q, dq, ddq, opening = (file[key] for key in ("t", "q", "dq", "ddq", "gripper"))
    sim, reached, most = MujocoArm(arm.robot, Load()), list[float](), 0.0
    model, data = sim.model, sim.data
    model.opt.timestep = (t[1] - t[0]) / STEPS
    held = np.setdiff1d(np.arange(model.nv), sim.driven)
    data.qpos[sim.at] = q[0] + OFF_RAD
    marks = {
        int(np.searchsorted(t, time)): pose
        for time, pose in zip(plan.trajectory.keyframe_t, plan.T_base_tool, strict=True)
    }
    for i in range(len(t)):
        if i in marks:
            held_pose = marks[i] if len(arm.robot.joints) > 5 else arm.forward(plan.trajectory.at(t[i : i + 1]).q[0])
            reached.append(held_pose.distance(arm.forward(data.qpos[sim.at]))[0])
        for step in range(STEPS if i + 1 < len(t) else 0):
            share = step / STEPS
            wanted = [(1.0 - share) * each[i] + share * each[i + 1] for each in (q, dq, ddq)]
            sim.open_gripper(float(opening[i]))
            data.qacc[:] = 0.0
            data.qacc[sim.driven] = (
                wanted[2] + DAMPING * (wanted[1] - data.qvel[sim.driven]) + STIFFNESS * (wanted[0] - data.qpos[sim.at])
            )
            torque: Array = inverse(model, data)
            most = max(most, share_of(arm.limits.effort, torque[sim.driven]))
            data.qfrc_applied[:] = torque
            mujoco.mj_step(model, data)
            data.qvel[held] = 0.0
    end = arm.forward(q[-1]).distance(arm.forward(data.qpos[sim.at]))[0]
    return {
        "duration_s": float(t[-1]),
        "keyframes": len(reached),
        "worst_mm": 1e3 * max(reached),
        "end_mm": 1e3 * end,
        "torque_pct": 100.0 * most,
    }


def inverse(model: Any, data: Any) -> Array:
    """Torques for the accelerations that stand in the data."""
    import mujoco

    mujoco.mj_inverse(model, data)
    torque: Array = data.qfrc_inverse.copy()
    return torque


def share_of(effort: Array | None, torque: Array) -> float:
    """The largest share of the limits."""
    return 0.0 if effort is None else float((np.abs(torque) / effort).max())


if __name__ == "__main__":
    main()
