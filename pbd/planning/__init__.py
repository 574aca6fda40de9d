"""Plan a motion through keyframes, and audit it."""

from pbd.planning.choose_joints import solve_keyframes
from pbd.planning.export_source import source_of
from pbd.planning.object_frames import ThingPlace
from pbd.planning.options import PlanOptions
from pbd.planning.plan import can_plan, plan, plan_keyframes, plan_path
from pbd.planning.result import Plan
from pbd.planning.task import arm_of, load_robot_and_calibration, scene_of

__all__ = [
    "Plan",
    "PlanOptions",
    "ThingPlace",
    "arm_of",
    "can_plan",
    "load_robot_and_calibration",
    "plan",
    "plan_keyframes",
    "plan_path",
    "scene_of",
    "solve_keyframes",
    "source_of",
]
