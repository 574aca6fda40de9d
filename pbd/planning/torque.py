"""Check the torques of a planned motion: warn, or refuse and suggest a speed at which they are within the limits."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from pbd.data import JointLimits, Load, Robot
from pbd.errors import PlanError, listed, warn
from pbd.planning.choose_joints import PlanRefusal
from pbd.planning.options import PlanOptions

if TYPE_CHECKING:
    from pbd.audit.torque import Torque

HIGH_SHARE = 0.8
"""Share of a torque limit above which a warning is given: the model lacks friction and the motors' inertia."""

ASSUMED_FACTOR = 5.0
"""A motion above this multiple of an assumed torque limit is refused: no assumption is so wrong."""


def check_torque(
    torque: Torque | None, limits: JointLimits, load: Load, options: PlanOptions, share_at: Callable[[float], float]
) -> PlanRefusal | None:
    """Warn of torques near the limit, or above an assumed one; return the refusal of larger ones.

    `share_at`: returns the largest share of a torque limit at another speed; at speed 0, for the arm at rest.
    """
    if torque is None:
        if str(load):
            warn(f"torques are not checked despite {load}: add `effort` to the robot's [limits]")
        return None
    if torque.weightless:
        warn(f"torques are underestimated: the URDF gives no link mass on {', '.join(torque.weightless)}; add it")
    if torque.impossible:
        links = listed(torque.impossible)
        warn(f"torques may be wrong: no body has the inertia that the URDF gives {links}; correct the <inertia>")
    assumed = "effort" in limits.assumed
    bound = f"its {'assumed ' if assumed else ''}torque limit of {torque.bound:.3g} {torque.unit}"
    carrying = f", carrying {load}" if str(load) else ""
    shown = f"{torque.value:.3g}" if torque.value < 1000.0 else f"{torque.value:.0f}"
    needs = f"{torque.joint} needs {shown} {torque.unit} at {torque.t:.2f} s{carrying}"
    if torque.share > (ASSUMED_FACTOR if assumed else 1.0):
        slower = _fitting_speed(options.speed, share_at)
        as_it_is = "correct `effort` or the URDF's masses" if torque.unit == "N" else "move the dock nearer to the base"
        lighter = "carry less" if carrying else as_it_is
        share = f"{100.0 * torque.share:.1f} % of" if torque.share < 10.0 else f"{torque.share:.0f} times"
        what = f"{needs}: {share} {bound}; {'' if slower else 'a lower speed does not help: '}{lighter}"
        fields = {"joint": torque.joint, "t": torque.t, "value": torque.value, "bound": torque.bound}
        alternatives = ((f"use --speed {slower:g}", replace(options, speed=slower)),) if slower else ()
        return PlanRefusal(PlanError(what, **fields), alternatives)
    if torque.share > HIGH_SHARE:
        warn(f"{needs}: {100.0 * torque.share:.0f} % of {bound}")
    return None


def check_payload(robot: Robot, load: Load) -> None:
    """Warn of a load above the robot's rated payload."""
    if robot.payload_kg is not None and load.heaviest > robot.payload_kg:
        rated = f"the rated payload of {robot.name} is {robot.payload_kg:g} kg"
        warn(f"{rated}, and it would carry {load}: carry less, or ask its maker whether it may")


def _fitting_speed(speed: float, share_at: Callable[[float], float]) -> float | None:
    """Find the highest speed, in whole percent, at which torques are within the limits."""
    if share_at(0.0) > 1.0:
        return None
    slower = range(1, round(100.0 * speed))
    return bisect_left(slower, True, key=lambda percent: share_at(percent / 100) > 1.0) / 100 or None
