"""keyframes.toml in a demonstration's folder: keyframes to edit, which replace the tracked ones."""

import shlex
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pbd.data import Keyframe, TouchUp
from pbd.data.keyframe import thing_carriers
from pbd.errors import RecordingError, warn
from pbd.files.calibration import FULL_TURN_DEG, read_pose
from pbd.io.atomic import write_text
from pbd.io.made_by_pbd import sealed
from pbd.io.numbers import LARGEST_NUDGE_M
from pbd.io.toml import FORMAT, Section, read_toml
from pbd.pose import quat_to_rpy

KEYFRAMES_FILE = "keyframes.toml"
GRIPS = {"closes": True, "opens": False}
"""Words for `Keyframe.grip`."""

ROUNDING_M = 1e-4
"""Unit of the last decimal of a keyframe's position, m."""

FARTHEST_M = 5.0
"""Largest coordinate of a keyframe in nav, whose origin is the dock, m: twice the reach of a large arm."""

HEAD = """\
# The keyframes of '{name}': where the hand stopped. While this file exists, it replaces what tracking finds.
# Edit it as you like; `pbd keyframes {word}` shows the result, and the line of a mistake.
#   drop      remove a [[keyframe]] and its lines; the first one is the dock and must stay as it is
#   insert    copy a [[keyframe]], with a time between its neighbours'; its copied sigmas count as the hand path's there
#   nudge     position_m is the sensor's position, in metres from the dock: {axes}, z up;
#             rpy_deg is its roll, pitch and yaw in degrees. `pbd keyframes {word} --robot R` shows the tool's pose
#   dwell_s   how long the arm stays, except at the first and the last; less counts as 0.15 s; a comment has the hand's
#   grip      "closes" or "opens", in turn; without it nothing changes. The grip is open at the start
#   label     a word for people
#   tolerance_m, tolerance_deg  largest error along each axis, and of the rotation; learned from fused takes
#   frames    the things that it belongs to, each carried by the next: `pbd replay --at cup=X,Y,Z,DEG` moves one
#   nudge_base_m, nudge_tool_m  a shift of the tool, along the axes of the robot's base or of the tool
#   sigma_m, sigma_deg  one sigma along each axis; without them the keyframe is taken as exact
# Every keyframe needs t_s, dwell_s, position_m and rpy_deg; the rest is optional.
# `pbd keyframes {word} --save --force` finds them again; without the file they are found each time.
format = {format}
"""
NORTH_AXES, DOCK_AXES = "x magnetic east, y magnetic north", "x along the sensor's x axis at the dock, y to its left"


def keyframes_toml(
    name: str,
    keyframes: Sequence[Keyframe],
    magnetic: bool,
    arm_dwell_s: Sequence[float] | None = None,
    touch_ups: Sequence[TouchUp] = (),
) -> str:
    """Return the text of keyframes.toml.

    Args:
        magnetic: whether a magnetometer aligns nav with north.
        arm_dwell_s: (n,) s, how long the arm stays at each keyframe; None: as long as the hand.
    """
    lines = [HEAD.format(name=name, word=shlex.quote(name), format=FORMAT, axes=NORTH_AXES if magnetic else DOCK_AXES)]
    dwell_s = [keyframe.dwell_s for keyframe in keyframes] if arm_dwell_s is None else arm_dwell_s
    for index, (keyframe, dwell) in enumerate(zip(keyframes, dwell_s, strict=True)):
        sigma = np.sqrt(np.diagonal(keyframe.cov))
        lines += [
            f"[[keyframe]] # {index}{', the dock' if index == 0 else ''}",
            f"t_s = {keyframe.t:.3f}",
            f"dwell_s = {dwell:.3f} # the hand stood for {keyframe.dwell_s:.2f} s",
            f"position_m = {_numbers(keyframe.T_nav_sensor.p, 4)}",
            f"rpy_deg = {_numbers(np.degrees(quat_to_rpy(keyframe.T_nav_sensor.wxyz)), 3)}",
            f"sigma_m = {_numbers(sigma[:3], 4)}",
            f"sigma_deg = {_numbers(np.degrees(sigma[3:]), 2)}",
        ]
        tolerance_m, tolerance_rad = keyframe.tolerance_m, keyframe.tolerance_rad
        optional = {  # a tolerance that would be rounded to zero becomes the smallest that is not
            "tolerance_m": tolerance_m is not None and _numbers(np.clip(tolerance_m, 1e-4, LARGEST_NUDGE_M), 4),
            "tolerance_deg": tolerance_rad is not None and f"{max(float(np.degrees(tolerance_rad)), 0.01):.2f}",
            "grip": {True: '"closes"', False: '"opens"', None: ""}[keyframe.grip],
            "label": keyframe.label and _quoted(keyframe.label),
            "nudge_base_m": keyframe.nudge_base_m.any() and _numbers(keyframe.nudge_base_m, 4),
            "nudge_tool_m": keyframe.nudge_tool_m.any() and _numbers(keyframe.nudge_tool_m, 4),
            "frames": keyframe.frames and f"[{', '.join(map(_quoted, keyframe.frames))}]",
        }
        lines += [*(f"{key} = {text}" for key, text in optional.items() if text), ""]
    return "\n".join((*lines, *map(touch_up_toml, touch_ups)))


def touch_up_toml(touch_up: TouchUp) -> str:
    """Return a [[touch_up]] of keyframes.toml."""
    lines = [
        "[[touch_up]] # of `pbd touch`, which can undo it",
        f"t_s = {touch_up.t:.3f}",
        f"by_nav_m = {_numbers(touch_up.by_nav_m, 5)}",
    ]
    lines += [f"{key} = true" for key in ("only", "undone") if getattr(touch_up, key)]
    if touch_up.from_base_m is not None:
        lines.append(f"from_base_m = {_numbers(touch_up.from_base_m, 4)}")
    return "\n".join((*lines, ""))


def write_keyframes(
    folder: Path,
    keyframes: Sequence[Keyframe],
    magnetic: bool,
    force: bool = False,
    arm_dwell_s: Sequence[float] | None = None,
    touch_ups: Sequence[TouchUp] = (),
    for_touch: bool = False,
) -> Path:
    """Write keyframes.toml (`keyframes_toml`) into a demonstration's folder, and return its path.

    An old file that differs is kept in keyframes.toml.before. A file that is written only `for_touch` is removed when
    all touch-ups are undone, unless it was edited.

    Raises:
        RecordingError: the file exists (without `force`), and may have been edited; or a keyframe is too far away.
    """
    for index, keyframe in enumerate(keyframes):
        if (away := float(np.abs(keyframe.T_nav_sensor.p).max())) > FARTHEST_M:
            what = f"keyframe {index} (t = {keyframe.t:.2f} s) is {away:.1f} m from the dock, where no arm reaches"
            what = f"{what}; nothing is saved: record again"
            raise RecordingError(what, keyframe=index, value=away, bound=FARTHEST_M)
    path = folder / KEYFRAMES_FILE
    if path.exists() and not force:
        raise RecordingError(f"{path} exists and may have been edited; --force replaces it", path=path)
    text = keyframes_toml(folder.name, keyframes, magnetic, arm_dwell_s, touch_ups)
    text = sealed(text) if for_touch else text
    edited = path.exists() and path.read_bytes() != text.encode()
    write_text(path, text, why_kept="which was edited" if edited else "")
    return path


def read_touch_ups(path: Path) -> tuple[TouchUp, ...]:
    """Read the touch-ups from keyframes.toml; raises as `read_keyframes`."""
    return tuple(map(_read_touch_up, read_toml(path, RecordingError).tables("touch_up")))


def read_keyframes(path: Path) -> tuple[Keyframe, ...]:
    """Read keyframes.toml; a RecordingError tells file, line and key."""
    return parse_keyframes(read_toml(path, RecordingError))


def parse_keyframes(top: Section) -> tuple[Keyframe, ...]:
    """Make keyframes of a file's top level; raises as `read_keyframes`."""
    top.require_format()
    tables = top.tables("keyframe")
    keyframes = tuple(map(_read_keyframe, tables))
    touch_ups = [(table, _read_touch_up(table)) for table in top.tables("touch_up")]
    top.refuse_unread()
    if not keyframes:
        raise RecordingError.at(top.path, "it has no [[keyframe]]; add some, or remove the file to find them again")
    for table, touch_up in touch_ups:
        if not touch_up.undone and touch_up.index_in(keyframes) is None:
            what = f"the touch-up at {touch_up.t:g} s is not used, as no [[keyframe]] has this t_s"
            _warn(table, "t_s", f"{what}; put that keyframe back with its t_s, or remove the [[touch_up]]")
    for before, after, table in zip(keyframes, keyframes[1:], tables[1:], strict=False):
        if after.t <= before.t:
            table.fail("t_s", f"must be later than the keyframe before ({before.t:g} s), got {after.t:g}")
    if np.abs(keyframes[0].T_nav_sensor.p).max() > 1e-3:  # the origin of nav, rounded
        tables[0].fail("position_m", "must be [0, 0, 0]: the first keyframe is the dock", "put it back")
    for index, keyframe in enumerate(keyframes[1:-1], start=1):  # the arm doesn't stay at the first and the last
        if keyframe.dwell_s > 60.0:  # probably meant in milliseconds
            what = f"the arm stays {keyframe.dwell_s:g} s at keyframe {index}; if that is too long, correct dwell_s"
            _warn(tables[index], "dwell_s", f"{what} (in seconds)")
    _check_grips(keyframes, tables)
    firsts: dict[tuple[str, ...], Keyframe] = {}
    for keyframe, table in zip(keyframes, tables, strict=True):
        if firsts.setdefault(keyframe.frames, keyframe) is keyframe:
            try:
                thing_carriers(list(firsts.values()))
            except RecordingError as loop:
                table.fail("frames", loop.message)
    return keyframes


def _check_grips(keyframes: Sequence[Keyframe], tables: Sequence[Section]) -> None:
    """Refuse two grips in a row that do the same: one between them is missing. Warn if the first grip opens."""
    grips = [index for index, keyframe in enumerate(keyframes) if keyframe.grip is not None]
    for before, index in pairwise(grips):
        if keyframes[index].grip == keyframes[before].grip:
            word, state, other = ("closes", "closed", "opens") if keyframes[index].grip else ("opens", "open", "closes")
            what = f'"{word}" at keyframe {index} changes nothing, it is {state} since keyframe {before}'
            tables[index].fail("grip", what, f'remove one of the two, or add grip = "{other}" between them')
    if grips and not keyframes[grips[0]].grip:
        what = f"the grip opens at keyframe {grips[0]}, but it is open from the start: nothing changes there; remove"
        _warn(tables[grips[0]], "grip", f"{what} the line, or add what is missing before it")


def _warn(table: Section, key: str, what: str) -> None:
    warn(f"{table.path}:{table.line(key)}: {what}")


def _read_keyframe(section: Section) -> Keyframe:
    grip, dwell = section.choice("grip", GRIPS, None), section.number("dwell_s")
    if dwell < 0.0:
        section.fail("dwell_s", f"must not be below zero, got {dwell:g}")
    T_nav_sensor = read_pose(section, "position_m", FARTHEST_M)
    sigma_m, sigma_deg = (section.sigmas(key, (0.0, 0.0, 0.0)) for key in ("sigma_m", "sigma_deg"))
    tolerance = section.numbers("tolerance_m", 3, None, positive=True, within=LARGEST_NUDGE_M)
    tolerance_deg = section.number("tolerance_deg", None, positive=True, within=FULL_TURN_DEG)
    return Keyframe(
        t=section.number("t_s"),
        dwell_s=dwell,
        T_nav_sensor=T_nav_sensor,
        cov=np.diag(np.square([*sigma_m, *np.radians(sigma_deg)])),
        grip=grip,
        label=section.text("label", ""),
        tolerance_m=None if tolerance is None else np.array(tolerance),
        tolerance_rad=None if tolerance_deg is None else float(np.radians(tolerance_deg)),
        nudge_base_m=np.array(section.numbers("nudge_base_m", 3, (0.0, 0.0, 0.0), within=LARGEST_NUDGE_M)),
        nudge_tool_m=np.array(section.numbers("nudge_tool_m", 3, (0.0, 0.0, 0.0), within=LARGEST_NUDGE_M)),
        frames=section.texts("frames", ()),
    )


def _read_touch_up(section: Section) -> TouchUp:
    by_nav_m = np.array(section.numbers("by_nav_m", 3, within=LARGEST_NUDGE_M))
    from_base_m = section.numbers("from_base_m", 3, None, within=FARTHEST_M)
    return TouchUp(
        section.number("t_s"),
        by_nav_m,
        section.flag("only", False),
        section.flag("undone", False),
        None if from_base_m is None else np.array(from_base_m),
    )


def _numbers(values: ArrayLike, decimals: int) -> str:
    rounded = np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0
    return f"[{', '.join(f'{value:.{decimals}f}' for value in rounded)}]"


def _quoted(text: str) -> str:
    import tomlkit

    return tomlkit.item(text).as_string()
