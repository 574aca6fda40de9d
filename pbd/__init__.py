"""Programming by demonstration for robot arms, from an inertial sensor in the hand.

    import pbd

    path = pbd.track(pbd.load_demo("pouring"))
    robot = pbd.load_robot("panda")
    trajectory = pbd.plan(path, pbd.load_calibration("default"), robot)

`pbd replay` and `pbd export` do the same. Edited keyframes, known places and the grasped object count here too.
The values are in `pbd.data` and `pbd.pose`, the errors in `pbd.errors`; docs/api.md has an example of each step.

A name or a module is imported when it is first used, so `import pbd` is fast.
"""

from __future__ import annotations

TYPE_CHECKING = False  # importing typing would take longer than the rest of this file
if TYPE_CHECKING:
    from typing import Any

    from pbd import data as data
    from pbd import errors as errors
    from pbd import planning as planning
    from pbd import pose as pose
    from pbd.check_demos import check_all
    from pbd.files.calibration import load_calibration
    from pbd.files.demo import load_demo
    from pbd.files.exporters import export
    from pbd.files.robot import load_robot
    from pbd.pipeline import fuse, track
    from pbd.planning import PlanOptions, plan

__version__ = "0.1.0"

__all__ = ["PlanOptions", "check_all", "export", "fuse", "load_calibration", "load_demo", "load_robot", "plan", "track"]

_MODULES = {
    "PlanOptions": "pbd.planning",
    "check_all": "pbd.check_demos",
    "export": "pbd.files.exporters",
    "fuse": "pbd.pipeline",
    "load_calibration": "pbd.files.calibration",
    "load_demo": "pbd.files.demo",
    "load_robot": "pbd.files.robot",
    "plan": "pbd.planning",
    "track": "pbd.pipeline",
}

_PACKAGES = ("data", "errors", "planning", "pose")
"""Modules that a program names after `import pbd` alone: `except pbd.errors.PbdError`."""


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULES, *_PACKAGES])


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    if name in _PACKAGES:
        return import_module(f"pbd.{name}")
    raise AttributeError(f"module 'pbd' has no attribute '{name}'")
