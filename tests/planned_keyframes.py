"""Keyframes, docks and plans for tests of planning."""

from dataclasses import replace

import numpy as np

import pbd
from pbd.data import Calibration, Demonstration, HandPath, Keyframe, Robot
from pbd.files.demo import load_demo
from pbd.planning import Plan, PlanOptions
from pbd.pose import Pose, quat_exp
from tests.arm.bundled import keyframes_of, path_of
from tests.not_none import not_none
from tests.result_cache import remembering

PANDA, UR5 = pbd.load_robot("panda"), pbd.load_robot("ur5")


plan_once = remembering("pbd.planning.plan", "plan_keyframes")


TURN = np.array([1.0, 0.0, 0.0, 0.0])


def dock() -> Calibration:
    return not_none(PANDA.dock)


def tracked(name: str) -> tuple[Demonstration, HandPath, tuple[Keyframe, ...]]:
    return load_demo(name), path_of(name), keyframes_of(name)


def planned(
    name: str = "paper-test1", robot: Robot = PANDA, calibration: Calibration | None = None, **options: object
) -> Plan:
    demo, path, keyframes = tracked(name)
    asked = PlanOptions(**options)  # type: ignore[arg-type]
    plan: Plan = plan_once(keyframes, calibration or robot.dock or dock(), robot, asked, path, demo.grasped)
    return plan


def keyframe(
    t: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, dwell_s: float = 0.5, roll: float = 0.0
) -> Keyframe:
    return Keyframe(t, dwell_s, Pose(np.array([x, y, z]), quat_exp((roll, 0.0, 0.0))), 1e-6 * np.eye(6))


def low() -> tuple[list[Keyframe], Calibration]:
    """Return three keyframes, the second below the table's top, and a dock for them."""
    bench = replace(dock(), T_base_dock=Pose(np.array([0.45, -0.15, 0.1]), TURN))
    return [keyframe(0.0), keyframe(1.0, x=0.1, z=-0.12), keyframe(2.0, x=0.1)], bench
