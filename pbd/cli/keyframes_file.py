"""Writes keyframes.toml, for `pbd keyframes` and `pbd touch`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from pbd.cli.console import say
from pbd.data import Demonstration, Keyframe
from pbd.data.keyframe import thing_carriers
from pbd.errors import RecordingError, UsageError, listed
from pbd.files.keyframes import KEYFRAMES_FILE, write_keyframes
from pbd.files.keyframes_edit import set_frames
from pbd.planning.object_frames import keyframes_of_things, refuse_unknown_things
from pbd.planning.options import PlanOptions, dwells


def assign_frames(
    args: argparse.Namespace, demo: Demonstration, keyframes: tuple[Keyframe, ...]
) -> tuple[Keyframe, ...]:
    """Assign keyframes to things as --frame says, in keyframes.toml; write that file first if it is missing, or --save.

    Raises:
        RecordingError: there is no keyframe of that number, or nothing can be saved there.
        UsageError: the thing is unknown, or a keyframe would belong to two things that do not carry each other.
    """
    known = {names[0] for names, *_ in args.frame}.union(keyframes_of_things(keyframes))
    refuse_unknown_things((name for names, *_ in args.frame for name in names), sorted(known))
    frames: dict[int, tuple[str, ...]] = {}
    for names, first, last in args.frame:
        if last >= len(keyframes):
            what = f"there is no keyframe {last} for '{names[0]}'; they are 0 to {len(keyframes) - 1}"
            raise RecordingError(what, value=last)
        for number in range(first, last + 1):
            inner, outer = sorted((names, frames.get(number, ())), key=len, reverse=True)
            if outer and inner[-len(outer) :] != outer:
                what = f"keyframe {number} can't belong to '{outer[0]}' and to '{inner[0]}'"
                raise UsageError(f"{what}; where one carries the other, say so: --frame lid=6..7@cup")
            frames[number] = inner
    marked = tuple(replace(each, frames=frames.get(k, each.frames)) for k, each in enumerate(keyframes))
    thing_carriers(marked)
    if args.save or demo.keyframes is None:
        save_keyframes(args, demo, keyframes)
    if frames and demo.folder is not None:
        file = demo.folder / KEYFRAMES_FILE
        set_frames(file, frames)
        say(f"{file} says which keyframes belong to {listed({names[0] for names, *_ in args.frame})}")
        for number, names in frames.items():
            for before in set(keyframes[number].frames) - set(names):
                say(f"keyframe {number} belonged to {before} and no longer does")
    return marked


def save_keyframes(
    args: argparse.Namespace, demo: Demonstration, keyframes: tuple[Keyframe, ...], for_touch: bool = False
) -> Path:
    """Write keyframes.toml for a person to edit, or `for_touch` (see `write_keyframes`), and return its path.

    Raises:
        RecordingError: the demonstration is bundled or no folder, or another command wrote the file meanwhile.
    """
    source = demo.folder or args.demo
    if demo.bundled:
        what = (
            f"{source} is bundled, so nothing is saved there; copy it, and remove 'bundled = true' from its demo.toml"
        )
        raise RecordingError(what, path=source)
    if demo.folder is None:
        what = f"{source} is no demonstration folder, so nothing is saved there; `pbd import` it first"
        raise RecordingError(what, path=source)
    file = demo.folder / KEYFRAMES_FILE
    if demo.keyframes is None and not args.force and file.exists():
        what = f"another command wrote {file} meanwhile, so nothing is saved; run this one again"
        raise RecordingError(what, path=file)
    # `dwells` gives the first and the last keyframe no stay. A person may insert others beyond them, so both get one.
    padded = (keyframes[0], *keyframes, keyframes[-1])
    stays = dwells(padded, PlanOptions(time=args.time, dwell_s=args.dwell_s))[1:-1]
    magnetic = demo.recording.mag is not None
    path = write_keyframes(demo.folder, keyframes, magnetic, args.force, stays, demo.touch_ups, for_touch)
    say(f"wrote {path}: edit it; from now on the arm follows this file")
    return path
