"""Programming by demonstration for robot arms, from an inertial sensor in the hand.

    import pbd

    path = pbd.track(pbd.load_demo("pouring"))
    robot = pbd.load_robot("panda")
    trajectory = pbd.plan(path, pbd.load_calibration("default"), robot)

That is what `pbd replay` and `pbd export` do: edited keyframes, known places and the grasped object count here too.

Nothing heavy is imported before it is used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # typing takes longer to load than all of this
if TYPE_CHECKING:
    from typing import Any

    from pbd.check_demos import check_all
    from pbd.files.calibration import load_calibration
    from pbd.files.demo import load_demo
    from pbd.files.robot import load_robot
    from pbd.pipeline import fuse, track
    from pbd.planning import PlanOptions, plan

__version__ = "0.1.0"

__all__ = ["PlanOptions", "check_all", "fuse", "load_calibration", "load_demo", "load_robot", "plan", "track"]

_HOMES = {
    "PlanOptions": "pbd.planning",
    "check_all": "pbd.check_demos",
    "fuse": "pbd.pipeline",
    "load_calibration": "pbd.files.calibration",
    "load_demo": "pbd.files.demo",
    "load_robot": "pbd.files.robot",
    "plan": "pbd.planning",
    "track": "pbd.pipeline",
}


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'pbd' has no attribute '{name}'")
