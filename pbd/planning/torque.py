"""What follows from the torques of a finished motion: a warning, or a refusal with the speed at which it fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from pbd.data import JointLimits, Load
from pbd.errors import PlanError, warn
from pbd.planning.choose_joints import Refused
from pbd.planning.options import PlanOptions

if TYPE_CHECKING:
    from pbd.audit.torque import Torque

HIGH = 0.8
"""Share of a torque limit above which it is warned: friction and the motors' own inertia are not in the model."""

FAR_OFF = 5.0
"""No assumed limit is wrong by such a factor: what is above that is refused all the same."""


def check_torque(
    torque: Torque | None, limits: JointLimits, load: Load, options: PlanOptions, share_at: Callable[[float], float]
) -> Refused | None:
    """Warn of torques near the limit, or above one that is assumed; return the refusal of others.

    `share_at`: the largest share of a torque limit at another speed; at 0 standing still.
    """
    if torque is None:
        if str(load):
            warn(f"torques are not checked, {load} or not: add `effort` to the robot's [limits]")
        return None
    if torque.weightless:
        warn(f"torques are too low: the URDF gives no mass to what moves with {', '.join(torque.weightless)}; add it")
    assumed = "effort" in limits.assumed
    bound = f"its {'assumed ' if assumed else ''}torque limit of {torque.bound:.3g} {torque.unit}"
    carrying = f", carrying {load}" if str(load) else ""
    needs = f"{torque.joint} needs {_shown(torque.value)} {torque.unit} at {torque.t:.2f} s{carrying}"
    if torque.share > (FAR_OFF if assumed else 1.0):
        slower = _fitting_speed(options.speed, share_at)
        lighter = "carry less" if carrying else "move the dock nearer to the base"
        share = f"{100.0 * torque.share:.1f} % of" if torque.share < 10.0 else f"{torque.share:.0f} times"
        what = f"{needs}: {share} {bound}; {'' if slower else 'slower is no help: '}{lighter}"
        fields = {"joint": torque.joint, "t": torque.t, "value": torque.value, "bound": torque.bound}
        instead = ((f"use --speed {slower:g}", replace(options, speed=slower)),) if slower else ()
        return Refused(PlanError(what, **fields), instead)
    if torque.share > HIGH:
        warn(f"{needs}: {100.0 * torque.share:.0f} % of {bound}")
    return None


def _fitting_speed(speed: float, share_at: Callable[[float], float]) -> float | None:
    """Find the highest speed, in whole percent, at which torques are within the limits."""
    if share_at(0.0) > 1.0:
        return None
    fits, too_fast = 0, max(1, round(100.0 * speed))
    while too_fast - fits > 1:
        middle = (fits + too_fast) // 2
        fits, too_fast = (middle, too_fast) if share_at(middle / 100) <= 1.0 else (fits, middle)
    return fits / 100 or None


def _shown(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:.0f}"
