"""Advise to undo a person's corrections, if these are what brings a keyframe out of reach."""

import shlex
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data import Demonstration
from pbd.errors import PbdError
from pbd.files.demo import shell_word
from pbd.files.keyframes import KEYFRAMES_FILE
from pbd.planning.task import PlanningTask


def undo_advice(task: PlanningTask, error: PbdError, works: Callable[[PlanningTask], bool]) -> list[str]:
    """Return how to undo the touch-ups, or else the nudges, that moved the keyframe of the error, if that helps.

    `works`: whether a task can be done; it is called with the task without its touch-ups, or its nudges.
    """
    path, number = task.hand_path, error.fields.get("keyframe")
    demo = None if path is None or path.tracking is None else path.tracking.demo
    if demo is None or demo.folder is None or not isinstance(number, int):
        return []
    placed = task.T_base_tool[number]
    for without, undo, how in _uncorrected(task, demo, demo.folder):
        moved_m, _ = placed.distance(without.T_base_tool[number])
        if moved_m > 0.0 and works(without):
            return [f"{undo} that moved keyframe {number} by {100.0 * moved_m:.1f} cm ({how})"]
    return []


def _uncorrected(task: PlanningTask, demo: Demonstration, folder: Path) -> Iterator[tuple[PlanningTask, str, str]]:
    """Yield the task without its touch-ups, and without its nudges; each with what is to be undone, and how."""
    path = task.hand_path
    count = sum(not each.undone for each in demo.touch_ups)
    if count and path is not None and path.tracking is not None:
        untouched = replace(path, tracking=replace(path.tracking, demo=replace(demo, touch_ups=())))
        which, repeat = ("touch-up", "") if count == 1 else (f"{count} touch-ups", ", once for each")
        own = task.calibration is task.robot.dock
        by = "" if own else f" --calibration {shlex.quote(task.calibration.name)}"
        command = f"`pbd touch {shell_word(folder)} --robot {shlex.quote(task.robot.name)}{by} --undo`{repeat}"
        yield replace(task, hand_path=untouched), f"undo the {which}", command
    nudged = sum(each.nudge_base_m.any() or each.nudge_tool_m.any() for each in task.keyframes)
    if nudged:
        none = np.zeros(3)
        keyframes = tuple(replace(each, nudge_base_m=none, nudge_tool_m=none) for each in task.keyframes)
        which = "nudge" if nudged == 1 else "nudges"
        yield replace(task, keyframes=keyframes), f"remove the {which}", f"in {folder / KEYFRAMES_FILE}"
