"""Advise to undo touch-ups, if these are what brings a keyframe out of reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pbd.errors import PbdError
from pbd.files.demo import shell_word
from pbd.planning.options import PlanOptions
from pbd.planning.task import Task, place_keyframes


def undo_advice(task: Task, options: PlanOptions, error: PbdError, works: Callable[[Task], bool]) -> list[str]:
    """Return the command that undoes the touch-ups, if the keyframe of the error was moved by them; else nothing.

    `works`: whether a task can be done; it is called with the task without its touch-ups.
    """
    path, number = task.hand_path, error.fields.get("keyframe")
    if path is None or path.tracking is None or not isinstance(number, int):
        return []
    demo = path.tracking.demo
    count = sum(not each.undone for each in demo.touch_ups)
    if not count or demo.folder is None:
        return []
    untouched = replace(path, tracking=replace(path.tracking, demo=replace(demo, touch_ups=())))
    without = task._replace(hand_path=untouched)
    if not works(without):
        return []
    moved_m, _ = place_keyframes(task, options)[1][number].distance(place_keyframes(without, options)[1][number])
    which, repeat = ("touch-up", "") if count == 1 else (f"{count} touch-ups", ", once for each")
    command = f"`pbd touch {shell_word(demo.folder)} --robot {task.robot.name} --undo`{repeat}"
    return [f"undo the {which} that moved keyframe {number} by {100.0 * moved_m:.1f} cm ({command})"]
