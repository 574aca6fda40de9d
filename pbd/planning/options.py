"""What a user may choose about a motion, and what follows from it for the time it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.data import Keyframe
from pbd.errors import UsageError
from pbd.planning.object_frames import ThingPlace

PATHS = ("keyframes", "line", "demo")
"""How to go from keyframe to keyframe: straight in joint space, the tool on a straight line, or as the hand went."""

TIMES = ("limits", "demo")
"""How fast: as the limits allow, or as the hand went where they do."""

ORIENTATIONS = ("demo", "fixed")

BOUNDS = {
    "speed": (0.01, 1.0),
    "margin": (0.0, 0.5),
    "scale": (1e-3, 1e3),
    "tolerance_m": (1e-6, 1e3),
    "dwell_s": (0.0, np.inf),
}
"""Smallest and largest value of each option that is a number."""

SHORTEST_DWELL_S, LONGEST_DWELL_S = 0.15, 0.5
"""A keyframe is a stop: the arm stays at least so long, and, unless it is to take the hand's time, at most so long."""


@dataclass(frozen=True)
class PlanOptions:
    """What a user may choose about the motion.

    Attributes:
        path: one of PATHS.
        tolerance_m: with path "keyframes", a move whose tool leaves the straight line by more is made as a line.
        time: one of TIMES.
        scale: multiplies the hand's positions.
        orientation: "demo", or "fixed": the tool's z straight down throughout.
        speed: 0.01 to 1: a factor on the velocity, acceleration and jerk limits.
        margin: 0 to 0.5: the share of those limits that is left for the controller.
        dwell_s: the longest stay at a keyframe; None: LONGEST_DWELL_S, or with time "demo" as long as the hand's.
        approach: start at home or `start`, rather than at keyframe 0.
        start: the arm's present joints, rad; None: home.
        retreat: go back home at the end.
        detour: where all else touches something, go around it.
        allow_collision: where nothing is free plan all the same; the plan says what touches.
        payload: kg that the tool carries all the time: a gripper that the model lacks, or what it always holds.
        p_tool_payload: m, where that has its centre of mass, in tool axes.
        at: where things stand now to which keyframes belong; the others stand where they were shown.
    """

    path: str = "keyframes"
    tolerance_m: float | None = None
    time: str = "limits"
    scale: float = 1.0
    orientation: str = "demo"
    speed: float = 1.0
    margin: float = 0.05
    dwell_s: float | None = None
    approach: bool = True
    start: tuple[float, ...] | None = None
    retreat: bool = True
    detour: bool = True
    allow_collision: bool = False
    payload: float = 0.0
    p_tool_payload: tuple[float, float, float] = (0.0, 0.0, 0.0)
    at: tuple[ThingPlace, ...] = ()

    def __post_init__(self) -> None:
        for value, known in ((self.path, PATHS), (self.time, TIMES), (self.orientation, ORIENTATIONS)):
            if value not in known:
                raise UsageError(f"unknown value '{value}'; choose one of {', '.join(known)}", value=value)
        for name, (least, most) in BOUNDS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise UsageError(f"{name} must be from {least:g} to {most:g}, got {value:g}", value=value, bound=most)
        if not (0.0 <= self.payload < np.inf and np.isfinite(self.p_tool_payload).all()):
            raise UsageError(f"the payload is {self.payload} kg; give a number, zero or above", value=self.payload)
        if not np.isfinite([(*place.p_base, place.turn_rad) for place in self.at]).all():
            raise UsageError("the place of a thing must have finite numbers", value=self.at)


def dwells(keyframes: Sequence[Keyframe], options: PlanOptions) -> list[float]:
    """How long to stay at each keyframe, s; not at the first and the last."""
    longest = options.dwell_s
    if longest is None:
        longest = LONGEST_DWELL_S if options.time == "limits" else np.inf
    return [0.0, *(min(max(keyframe.dwell_s, SHORTEST_DWELL_S), longest) for keyframe in keyframes[1:-1]), 0.0]


def demonstrated(keyframes: Sequence[Keyframe]) -> list[float]:
    """How long the hand took from each keyframe to the next, s."""
    return [
        max(0.0, after.t - 0.5 * after.dwell_s - before.t - 0.5 * before.dwell_s)
        for before, after in pairwise(keyframes)
    ]
