"""The user's options for a motion, and the dwells and durations that follow from them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from pbd.data import HandPath, Keyframe
from pbd.data.world import IN_METRES, beyond_reach
from pbd.errors import UsageError, is_number, nearest, require_kind
from pbd.io.numbers import LARGEST_NUDGE_M
from pbd.planning.object_frames import ThingPlace

CHOICES = {"path": ("keyframes", "line", "demo"), "time": ("limits", "demo"), "orientation": ("demo", "fixed")}
"""Values of each option that is a word; `PlanOptions` says what they mean."""

BOUNDS = {
    "speed": (0.01, 1.0),
    "margin": (0.0, 0.5),
    "scale": (1e-3, 1e3),
    "tolerance_m": (1e-6, LARGEST_NUDGE_M),
    "dwell_s": (0.0, np.inf),
}
"""Smallest and largest value of each option that is a number."""

SHORTEST_DWELL_S, LONGEST_DWELL_S = 0.15, 0.5
"""Bounds of the stay at a keyframe, s; the longest does not apply with time "demo" or if `dwell_s` is given."""


@dataclass(frozen=True)
class PlanOptions:
    """The user's options for the motion. A value out of range is a UsageError.

    Attributes:
        path: "keyframes" (straight in joint space), "line" (a straight line of the tool) or "demo" (the hand's path).
        tolerance_m: m; with path "keyframes", a move on which the tool leaves the straight line by more becomes a line.
        time: "limits" (as short as they allow), or "demo" (the hand's own time where the limits allow it).
        scale: factor on the hand's positions; it multiplies the calibration's own.
        orientation: "demo", or "fixed", which keeps the tool's z straight down.
        speed: 0.01 to 1, share of the velocity, acceleration and jerk limits.
        margin: 0 to 0.5, share of those limits that is reserved for the controller.
        dwell_s: longest stay at a keyframe, s; None: 0.5, or with time "demo" the hand's own.
        approach: start at home or `start`, not at keyframe 0.
        start: the arm's present joints, rad; None: home.
        retreat: return home at the end.
        detour: go around obstacles if nothing else is free, or only a move that is wider and longer.
        allow_collision: if nothing is free, plan without collision checks; the plan says what touches.
        payload: kg that the tool always carries, such as a gripper that the model lacks.
        p_tool_payload: its centre of mass in the tool frame, m.
        at: where things stand now, `pbd.planning.ThingPlace`; what is not listed stands where it was shown.
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
        self._refuse_wrong_types()
        for name in ("start", "p_tool_payload", "at"):  # of an array or a list, which may change later
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, tuple(values.tolist() if isinstance(values, np.ndarray) else values))
        for name, known in CHOICES.items():
            if (word := getattr(self, name)) not in known:
                what = f"{name} must be one of {', '.join(known)}, got '{word}'{nearest(str(word), known)}"
                raise UsageError(what, value=word, valid=known)
        for name, (least, most) in BOUNDS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise UsageError(f"{name} must be from {least:g} to {most:g}, got {value:g}", value=value, bound=most)
        if self.tolerance_m is not None and self.path != "keyframes":
            raise UsageError("--path-tolerance is for --path keyframes: leave one of them out", value=self.path)
        if not 0.0 <= self.payload < np.inf:
            raise UsageError(f"the payload is {self.payload} kg; give a number, zero or above", value=self.payload)
        things = [(f"the place of '{place.name}'", place.p_base, place.turn_rad) for place in self.at]
        for what, p, turn_rad in (("the payload's centre of mass", self.p_tool_payload, 0.0), *things):
            if not np.isfinite([*p, turn_rad]).all():
                raise UsageError(f"{what} must have finite numbers", value=p)
            if far := beyond_reach(p):
                raise UsageError(f"{what} is at {far}; {IN_METRES}", value=p)

    def _refuse_wrong_types(self) -> None:
        for option in fields(self):
            name, value, usual = option.name, getattr(self, option.name), option.default
            if isinstance(usual, bool):
                require_kind(name, value, "True or False", isinstance(value, bool | np.bool_))
            elif isinstance(usual, float) or name in BOUNDS:
                require_kind(name, value, "a number", is_number(value) or (value is usual is None))
        require_kind("start", self.start, "the joints' numbers", self.start is None or _are_numbers(self.start))
        centre = self.p_tool_payload
        require_kind("p_tool_payload", centre, "three numbers", _are_numbers(centre) and len(centre) == 3)
        kind = "a tuple of ThingPlace(name, (x, y, z), turn_rad)"
        require_kind("at", self.at, kind, isinstance(self.at, tuple | list) and all(map(_is_place, self.at)))


def _are_numbers(values: object) -> bool:
    return isinstance(values, tuple | list | np.ndarray) and all(map(is_number, values))


def _is_place(value: object) -> bool:
    if not isinstance(value, ThingPlace):
        return False
    return _are_numbers(value.p_base) and len(value.p_base) == 3 and is_number(value.turn_rad)


def dwells(keyframes: Sequence[Keyframe], options: PlanOptions) -> list[float]:
    """Return the stay at each keyframe, s; zero at the first and the last."""
    longest = options.dwell_s
    if longest is None:
        longest = LONGEST_DWELL_S if options.time == "limits" else np.inf
    return [0.0, *(min(max(keyframe.dwell_s, SHORTEST_DWELL_S), longest) for keyframe in keyframes[1:-1]), 0.0]


def hand_durations(keyframes: Sequence[Keyframe], path: HandPath | None) -> list[float]:
    """Return the time that the hand took from each keyframe to the next, without its rests, s.

    The rests are taken from the path, since an edited keyframe's dwell is the arm's; without a path, from the dwells.
    """
    rests = [
        (each.t - 0.5 * each.dwell_s, each.t + 0.5 * each.dwell_s) if path is None else path.rest_at(each.t)
        for each in keyframes
    ]
    return [max(0.0, start - end) for (_, end), (start, _) in pairwise(rests)]
