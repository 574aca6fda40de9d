"""Keyframes, and the touch-ups that correct them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from graphlib import CycleError, TopologicalSorter

import numpy as np

from pbd.data.freeze import freeze
from pbd.data.one_line_repr import brief
from pbd.errors import RecordingError
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A pose at which the hand stood still.

    Attributes:
        t: s, the middle of the stop.
        dwell_s: how long the hand stood.
        T_nav_sensor: the sensor's pose.
        cov: (6, 6) m and rad: position, then rotation vector, in nav.
        grip: True where the grip closes at this stop, False where it opens, None where nothing changes.
        label: a word for people.
        tolerance_m: (3,) how far it may be off along nav's axes; tolerance_rad: how far turned. Learned from several
            takes, or as a person said; None: nobody knows.
        weight: how sure the tracker is that the hand stood still, 0 to 1.
        nudge_base_m: (3,) how far the tool goes elsewhere, in base axes.
        nudge_tool_m: (3,) likewise, in the tool's axes.
        frames: the things that it belongs to, by name, each carried by the next: ("lid", "cup").
    """

    t: float
    dwell_s: float
    T_nav_sensor: Pose
    cov: Array
    grip: bool | None = None
    label: str = ""
    tolerance_m: Array | None = None
    tolerance_rad: float | None = None
    weight: float = 1.0
    nudge_base_m: Array = field(default_factory=partial(np.zeros, 3))
    nudge_tool_m: Array = field(default_factory=partial(np.zeros, 3))
    frames: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, cov=(6, 6), tolerance_m=(3,), nudge_base_m=(3,), nudge_tool_m=(3,))

    def __repr__(self) -> str:
        x, y, z = self.T_nav_sensor.p + 0.0
        sigma_mm = 1e3 * float(np.sqrt(np.diagonal(self.cov)[:3].max()))
        sigma = f"sigma {sigma_mm:.1f} mm" if self.cov.any() else ""
        grip = {True: "grip closes", False: "grip opens", None: ""}[self.grip]
        where = f"at {self.t:.2f} s for {self.dwell_s:.2f} s"
        return brief(self, where, f"({x:.3f}, {y:.3f}, {z:.3f}) m", sigma, grip, name=self.label)


def thing_carriers(keyframes: Sequence[Keyframe]) -> dict[str, set[str]]:
    """All that carry each thing, near or far; what carries others comes first.

    Raises:
        RecordingError: a thing would carry itself.
    """
    nearest: dict[str, set[str]] = {}
    for keyframe in keyframes:
        for name, *carriers in (keyframe.frames[k : k + 2] for k in reversed(range(len(keyframe.frames)))):
            nearest.setdefault(name, set()).update(carriers)
    try:
        order = list(TopologicalSorter(nearest).static_order())
    except CycleError as loop:
        raise RecordingError(f"'{loop.args[1][0]}' can't carry itself: {' carries '.join(loop.args[1])}") from None
    above: dict[str, set[str]] = {}
    for name in order:
        above[name] = nearest[name].union(*(above[carrier] for carrier in nearest[name]))
    return above


@dataclass(frozen=True, eq=False)
class TouchUp:
    """A measurement that a person made with the arm: the tool at a keyframe belongs elsewhere.

    Attributes:
        t: s, of the keyframe.
        by_nav_m: (3,) how far from where it was then, in nav's axes.
        only: the other keyframes stay, whatever their errors have in common with this one's.
        undone: it counts no more.
    """

    t: float
    by_nav_m: Array
    only: bool = False
    undone: bool = False

    def __post_init__(self) -> None:
        freeze(self, by_nav_m=(3,))
