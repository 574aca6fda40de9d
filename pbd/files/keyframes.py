"""keyframes.toml in a demonstration's folder: keyframes as a person left them, which win over those that are found."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pbd.data import Keyframe
from pbd.errors import PbdWarning, RecordingError
from pbd.files.toml import Section, read_toml
from pbd.files.whole import written_whole
from pbd.pose import Pose, quat_from_rpy, quat_to_rpy

FORMAT = 1
NAME = "keyframes.toml"
GRIPS = {"closes": True, "opens": False}
ORIGIN_M = 1e-3
"""The first keyframe is the origin of nav, to this."""

LARGEST_DEG = 360.0
"""An angle beyond it is a slip of the pen."""

LARGEST_M = 5.0
"""A keyframe further from the dock (m) is a slip of the pen, likely centimetres: twice the reach of a large arm."""

LONG_DWELL_S = 60.0
"""An arm that is to stay longer is asked about: somebody may have meant milliseconds."""

HEAD = """\
# The keyframes of '{name}': where the hand stopped. While this file is here, it replaces what tracking finds.
# Edit it as you like; `pbd keyframes {name}` shows the result, and the line of a mistake.
#   drop      remove a [[keyframe]] and its lines; the first one is the dock, it stays as it is
#   insert    copy a [[keyframe]], with a time between its neighbours'
#   nudge     position_m is the sensor's, in metres from the dock: {axes}, z up;
#             rpy_deg is its roll, pitch and yaw in degrees. `pbd keyframes {name} --robot R` tells where the tool is
#   dwell_s   how long the arm stays, not at the first and the last; beside it, how long the hand stood
#   grip      "closes" or "opens", by turns; without it nothing changes. It is open at the start
#   label     a word for people
#   sigma_m, sigma_deg  one sigma along each axis; without them the keyframe is taken as exact
# Every keyframe needs t_s, dwell_s, position_m and rpy_deg; the rest may be left out.
# `pbd keyframes {name} --save --force` finds them again; without the file they are found each time.
format = {format}
"""


def keyframes_toml(
    name: str, keyframes: Sequence[Keyframe], magnetic: bool, arm_dwell_s: Sequence[float] | None = None
) -> str:
    """Write the file's text.

    Args:
        name: the demonstration's.
        keyframes: what is written.
        magnetic: a magnetometer turned nav to the north.
        arm_dwell_s: (n,) s, how long the arm is to stay at each; None: as long as the hand did.
    """
    axes = (
        "x magnetic east, y magnetic north"
        if magnetic
        else "x along the sensor's own as it lies at the dock, y left of it"
    )
    parts = [HEAD.format(name=name, format=FORMAT, axes=axes)]
    dwell_s = [keyframe.dwell_s for keyframe in keyframes] if arm_dwell_s is None else arm_dwell_s
    for index, (keyframe, dwell) in enumerate(zip(keyframes, dwell_s, strict=True)):
        sigma = np.sqrt(np.diagonal(keyframe.cov))
        lines = [
            "",
            f"[[keyframe]] # {index}{', the dock' if index == 0 else ''}",
            f"t_s = {keyframe.t:.3f}",
            f"dwell_s = {dwell:.3f} # the hand stood for {keyframe.dwell_s:.2f} s",
            f"position_m = {_numbers(keyframe.T_nav_sensor.p, 4)}",
            f"rpy_deg = {_numbers(np.degrees(quat_to_rpy(keyframe.T_nav_sensor.wxyz)), 3)}",
            f"sigma_m = {_numbers(sigma[:3], 4)}",
            f"sigma_deg = {_numbers(np.degrees(sigma[3:]), 2)}",
        ]
        if keyframe.grip is not None:
            lines.append(f'grip = "{"closes" if keyframe.grip else "opens"}"')
        if keyframe.label:
            lines.append(f"label = {_quoted(keyframe.label)}")
        parts.append("\n".join(lines) + "\n")
    return "".join(parts)


def write_keyframes(
    folder: Path,
    name: str,
    keyframes: Sequence[Keyframe],
    magnetic: bool,
    force: bool = False,
    arm_dwell_s: Sequence[float] | None = None,
) -> Path:
    """Write keyframes.toml (of `keyframes_toml`) into a demonstration's folder, and return its path.

    Raises:
        RecordingError: it is there already (unless `force`): somebody may have worked on it. Or a keyframe is too far
            away to be read again.
    """
    for index, keyframe in enumerate(keyframes):
        if (away := float(np.abs(keyframe.T_nav_sensor.p).max())) > LARGEST_M:
            raise RecordingError(
                f"keyframe {index} (t = {keyframe.t:.2f} s) is {away:.1f} m from the dock, where no arm reaches; "
                "nothing is saved: record again",
                keyframe=index,
                value=away,
                bound=LARGEST_M,
            )
    path = folder / NAME
    if path.exists() and not force:
        raise RecordingError(f"{path} exists and may have been edited; --force replaces it", path=path)
    with written_whole(path) as unfinished:
        unfinished.write_text(keyframes_toml(name, keyframes, magnetic, arm_dwell_s), encoding="utf-8")
    return path


def read_keyframes(path: Path) -> tuple[Keyframe, ...]:
    """Read keyframes.toml.

    Raises:
        RecordingError: with the file, the line and the key.
    """
    top = read_toml(path, RecordingError)
    if top.number("format") != FORMAT:
        top.fail("format", f"must be {FORMAT}, the only format that this version reads")
    tables = top.tables("keyframe")
    keyframes = tuple(map(_read, tables))
    top.done()
    if not keyframes:
        raise RecordingError(
            f"{path}: it has no [[keyframe]]; add some, or remove the file to find them again", path=path
        )
    for before, after, table in zip(keyframes, keyframes[1:], tables[1:], strict=False):
        if after.t <= before.t:
            table.fail("t_s", f"must be later than the keyframe before ({before.t:g} s), got {after.t:g}")
    if float(np.abs(keyframes[0].T_nav_sensor.p).max()) > ORIGIN_M:
        tables[0].fail("position_m", "must be [0, 0, 0]: the first keyframe is the dock", "put it back")
    _check_grips(path, keyframes, tables)
    _warn_of_long_dwells(path, keyframes, tables)
    return keyframes


def _warn_of_long_dwells(path: Path, keyframes: Sequence[Keyframe], tables: Sequence[Section]) -> None:
    """Not at the first and the last: the arm doesn't stay there."""
    for index, (keyframe, table) in list(enumerate(zip(keyframes, tables, strict=True)))[1:-1]:
        if keyframe.dwell_s > LONG_DWELL_S:
            warnings.warn(
                f"{path}:{table.line('dwell_s')}: the arm stays {keyframe.dwell_s:g} s at keyframe {index}; if that is "
                "too long, correct dwell_s (in seconds)",
                PbdWarning,
                stacklevel=3,
            )


def _check_grips(path: Path, keyframes: Sequence[Keyframe], tables: Sequence[Section]) -> None:
    """Refuse two grips in a row that do the same: one between them is lost. Warn of a first one that opens."""
    since: int | None = None
    for index, (keyframe, table) in enumerate(zip(keyframes, tables, strict=True)):
        if keyframe.grip is None:
            continue
        if since is not None and keyframe.grip == keyframes[since].grip:
            word, state, other = ("closes", "closed", "opens") if keyframe.grip else ("opens", "open", "closes")
            table.fail(
                "grip",
                f'"{word}" at keyframe {index} changes nothing, it is {state} since keyframe {since}',
                f'remove one of the two, or add grip = "{other}" between them',
            )
        if since is None and not keyframe.grip:
            warnings.warn(
                f"{path}:{table.line('grip')}: the grip opens at keyframe {index}, but it is open from the start: "
                "nothing changes there; remove the line, or add what is missing before it",
                PbdWarning,
                stacklevel=3,
            )
        since = index


def _read(section: Section) -> Keyframe:
    grip = None
    if "grip" in section:
        word = section.text("grip")
        if word not in GRIPS:
            section.fail("grip", f'must be "closes" or "opens", got "{word}"')
        grip = GRIPS[word]
    dwell = section.number("dwell_s")
    if dwell < 0.0:
        section.fail("dwell_s", f"must not be below zero, got {dwell:g}")
    position, rpy = section.numbers("position_m", 3), section.numbers("rpy_deg", 3)
    if max(map(abs, position)) > LARGEST_M:
        section.fail(
            "position_m",
            f"must lie within {LARGEST_M:g} m of the dock on each axis, got {list(position)}",
            "correct it, it is in metres",
        )
    if max(map(abs, rpy)) > LARGEST_DEG:
        section.fail("rpy_deg", f"must lie within -{LARGEST_DEG:g} and {LARGEST_DEG:g} degrees, got {list(rpy)}")
    sigma = np.zeros(6)
    for key, part, unit in (("sigma_m", slice(0, 3), 1.0), ("sigma_deg", slice(3, 6), np.pi / 180.0)):
        if key in section:
            values = np.array(section.numbers(key, 3))
            if (values < 0.0).any():
                section.fail(key, "must not be below zero")
            sigma[part] = unit * values
    return Keyframe(
        t=section.number("t_s"),
        dwell_s=dwell,
        T_nav_sensor=Pose(np.array(position), quat_from_rpy(np.radians(rpy))),
        cov=np.diag(sigma**2),
        grip=grip,
        label=section.text("label") if "label" in section else "",
    )


def _numbers(values: ArrayLike, decimals: int) -> str:
    rounded = np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0
    return f"[{', '.join(f'{value:.{decimals}f}' for value in rounded)}]"


def _quoted(text: str) -> str:
    import tomlkit

    return tomlkit.item(text).as_string()
