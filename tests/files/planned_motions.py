"""Plans of the bundled demonstrations, each made once, and their export."""

import warnings
from functools import cache
from pathlib import Path

from pbd.data import Robot
from pbd.files.exporters import export
from pbd.files.exporters.export_request import Source
from pbd.planning import Plan, PlanOptions, plan_path, source_of
from tests.arm.bundled import arm_of, path_of


@cache
def planned(name: str, demo: str = "paper-test1", path: str = "keyframes") -> tuple[Plan, Robot, Source]:
    robot, hand = arm_of(name).robot, path_of(demo)
    assert robot.dock is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plan = plan_path(hand, robot.dock, robot, PlanOptions(path=path))
    return plan, robot, source_of(plan)


def written(name: str, format_name: str, path: Path, rate_hz: float | None = None, demo: str = "paper-test1") -> Plan:
    plan, robot, source = planned(name, demo)
    export(plan.trajectory, robot, format_name, path, rate_hz, source=source)
    return plan
