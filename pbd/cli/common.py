"""Steps that several commands share: load, track, plan, choose a decoder, store and print."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pbd.cli.console import print_json, say, working
from pbd.data import Calibration, Demonstration, HandPath, Keyframe, Robot
from pbd.errors import RecordingError, SensorError, UsageError, amount, listed, warn
from pbd.files.calibration import load_calibration
from pbd.files.demo import demo_folder, load_demo, newest_demo, write_demo
from pbd.files.find_by_name import hides_bundled
from pbd.files.keyframes import KEYFRAMES_FILE, write_keyframes
from pbd.files.set_aside_demos import is_set_aside
from pbd.io.atomic import atomic_file, is_file, refuse_file
from pbd.io.made_by_pbd import refuse_others_file
from pbd.io.read_file import read_text
from pbd.io.toml import utc_now
from pbd.pose import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from pbd.planning import Plan, PlanOptions
    from pbd.sensors.decoding import Decoder


def load_demonstration(name: str | None, edited: bool = True) -> Demonstration:
    """Load the demonstration of this name, with keyframes.toml if `edited`.

    Without a name load the newest, and say which it is, with a person's notes.
    """
    wanted = newest_demo() if name is None else name
    with working(f"reading {wanted}"):
        demo = load_demo(wanted, edited)
    if name is None:
        latest, notes = newest_demo(failed=True), f" ({demo.notes})" if demo.notes and not demo.bundled else ""
        newer = "" if latest == wanted else f"; the newer '{latest}' can't be replayed"
        say(f"no demonstration named: using '{wanted}'{notes}{newer}")
    return demo


def without_aside(names: Sequence[str]) -> list[str]:
    """Leave out demonstrations that were set aside, if named by a path (as `demos/*` does); keep them if all are."""
    aside = [name for name in names if len(Path(name).parts) > 1 and is_set_aside(Path(name))]
    others = [name for name in names if name not in aside]
    if others and aside:
        say(f"left out, because they were set aside: {listed(aside)}; a name alone, without its folder, is used")
    return others or aside


def say_if_hiding_bundled(folder: Path) -> None:
    """Say so if the demonstration in this folder hides a bundled one of its name."""
    if hides_bundled("demos", folder):
        say(f"{folder} hides the bundled demonstration of that name")


def track_with(args: argparse.Namespace, demo: Demonstration, calibration: Calibration | None) -> HandPath:
    """Track a demonstration by args.method, and as --accept-gap says."""
    from pbd.pipeline import track

    with working("tracking"):
        return track(demo, args.method, calibration=calibration, accept_gap=args.accept_gap)


def track_demonstration(
    args: argparse.Namespace, demo: Demonstration, calibration: Calibration | None
) -> tuple[HandPath, tuple[Keyframe, ...]]:
    """Track a demonstration to use it; return the hand's path and its keyframes, the edited ones if there are any."""
    from pbd.tracking.keyframes import keyframes_of

    path = track_with(args, demo, calibration)
    keyframes = keyframes_of(path)
    if demo.keyframes is not None:
        say(f"keyframes as edited in {demo.folder}/keyframes.toml; dwell is how long the arm stays there")
    return path, keyframes


def named_calibration(args: argparse.Namespace) -> Calibration | None:
    """Load the calibration of --calibration, or None: a command without a robot tracks with no other."""
    return load_calibration(args.calibration) if args.calibration else None


def sigma_json(sigma: Array) -> dict[str, Any]:
    """Return one sigma (6,) of a pose along each axis, m and rad, for JSON."""
    return {"sigma_m": sigma[:3], "sigma_deg": np.degrees(sigma[3:])}


def plan_options(args: argparse.Namespace, robot: Robot, measured: tuple[float, ...] | None = None) -> PlanOptions:
    """Make the options of a plan from those of `add_planning`; `measured` joints (rad, m) are the start, not --from."""
    from pbd.planning import PlanOptions
    from pbd.planning.object_frames import ThingPlace

    mass, *p_tool = args.payload
    if mass < 0.0 or len(p_tool) not in (0, 3):
        raise UsageError("--payload takes KG, zero or above, or KG X Y Z, the centre of mass in m")
    converted: dict[str, Any] = {
        "margin": args.margin / 100.0,
        "payload": mass,
        "p_tool_payload": tuple(p_tool) or (0.0, 0.0, 0.0),
        "start": measured or (None if args.start is None else _start_joints(args, robot)),
        "at": tuple(ThingPlace(name, (x, y, z), math.radians(sum(deg))) for name, (x, y, z, *deg) in args.at),
    }
    as_given = {each.name: getattr(args, each.name) for each in fields(PlanOptions) if each.name not in converted}
    return PlanOptions(**as_given, **converted)


def _start_joints(args: argparse.Namespace, robot: Robot) -> tuple[float, ...]:
    """Read the joints of --from, in rad (and m) unless --units says otherwise; return them in rad (and m)."""
    from pbd.files.joint_state import read_joints
    from pbd.planning import arm_of
    from pbd.view.units import ANGLES, LENGTHS

    angle = args.units.angle if "angle" in args.units.asked else "rad"
    length = args.units.length if "length" in args.units.asked else "m"
    turns = arm_of(robot).turns
    per_si = [ANGLES[angle][0] if turn else LENGTHS[length][0] for turn in turns]
    unit = angle if all(turns) else f"{angle} (joints that slide: {length})"
    return read_joints(args.start, robot.joints, unit, per_si)


def plan_demonstration(args: argparse.Namespace, measured: tuple[float, ...] | None = None) -> Plan:
    """Load, track and plan args.demo; the motion is audited. `measured`: see `plan_options`."""
    from pbd.planning import PlanOptions, load_robot_and_calibration, plan_path
    from pbd.planning.options import dwells

    if measured is None and args.start is None and args.units.asked:
        raise UsageError("--units is for --from alone, as motions are always in rad and m: leave it out")
    demo = load_demonstration(args.demo)
    robot, calibration = load_robot_and_calibration(args.robot, args.calibration)
    path, _ = track_demonstration(args, demo, calibration)
    options = plan_options(args, robot, measured)
    longest = options.dwell_s
    if longest is None:
        hand = [round(stop.dwell_s, 3) for stop in path.stops[1:-1]]  # as keyframes.toml rounds
        longest = max(hand, default=0.0) if options.time == "demo" else 0.0
    if demo.keyframes is not None and longest > max(dwells(demo.keyframes, PlanOptions(dwell_s=math.inf))):
        asked = "--time demo" if options.dwell_s is None else "--dwell"
        warn(f"{asked} changes no stay: {demo.folder}/{KEYFRAMES_FILE} says how long each is; edit its dwell_s")
    with working(f"planning for {robot.name}"):
        return plan_path(path, calibration, robot, options)


def store_demonstration(
    args: argparse.Namespace,
    demo: Demonstration,
    done: str,
    more: Mapping[str, object],
    extra_files: Mapping[str, str] | None = None,
) -> None:
    """Write a demonstration to args.name with the present time, and say what was `done`: "imported", "simulated".

    `more` are further keys of the JSON, and `extra_files` as `write_demo` takes them.
    """
    recording = replace(demo.recording, info=replace(demo.recording.info, created=utc_now()))
    folder = demo_folder(args.name)
    with working(f"writing {folder}"):
        write_demo(replace(demo, recording=recording), folder, args.force, extra_files)
    samples, duration_s, rate_hz = len(recording), float(recording.t[-1]), recording.info.rate_hz or recording.rate_hz
    say(f"{done} {samples} samples, {duration_s:.1f} s at {rate_hz:.0f} Hz, into {folder}")
    say_if_hiding_bundled(folder)
    if args.json:
        stored = {"demo": folder.name, "folder": str(folder), "samples": samples}
        print_json(stored | {"duration_s": duration_s, "rate_hz": rate_hz} | dict(more))


def print_result(args: argparse.Namespace, result: dict[str, Any], *parts: Table | str) -> bool:
    """Print JSON, the tables as CSV, or tables and text for a person; return whether it was for a person."""
    from pbd.view.terminal_tables import print_csv, print_table

    if args.json:
        print_json(result)
    elif args.csv:
        print_csv(*(part for part in parts if not isinstance(part, str)))
    else:
        for part in parts:
            print(part) if isinstance(part, str) else print_table(part)
    return not (args.json or args.csv)


def write_figures(folder: Path, format_name: str, names: Collection[str], draw: Callable[[str], Figure]) -> list[str]:
    """Draw figures into files, all of them or none; say where they are, and return their paths.

    Raises:
        PbdError: a file of such a name is there that pbd did not make, or it can't be written.
    """
    from pbd.plots.style import style, write

    files = {name: folder / f"{name}.{format_name}" for name in names}
    for file in files.values():
        refuse_file(file)
        if is_file(file):
            refuse_others_file(file)
    replaced = sum(map(is_file, files.values()))
    with ExitStack() as all_or_none:
        for number, (name, file) in enumerate(files.items(), 1):
            new = all_or_none.enter_context(atomic_file(file, parents=True))
            with working(f"drawing {number} of {len(files)}: {name}"), new.open("wb") as stream, style():
                write(draw(name), stream, format_name)
    over = f", {replaced} of them over older ones" if replaced else ""
    say(f"wrote {amount(len(files), 'file')} into {folder}{over}")
    return list(map(str, files.values()))


def refuse_columns(args: argparse.Namespace, sensor: str) -> None:
    """Refuse (UsageError) the options of `add_line_options` for any sensor but "lines"."""
    given = args.columns or args.separator != "," or args.prefix or args.wrap is not None
    if given and sensor != "lines":
        what = f"--columns, --separator, --prefix and --wrap are for --sensor lines; leave them out for {sensor}"
        raise UsageError(what, value=sensor)


def decoder_maker(args: argparse.Namespace, sensor: str, also: Iterable[str] = ()) -> Callable[[], Decoder]:
    """Return a function that makes the sensor's decoder, from the options of `add_line_options` and --unit.

    The message about an unknown sensor also lists the names `also`, which only the command knows.

    Raises:
        UsageError: the sensor is unknown or has fixed units, or --columns is missing or wrong.
        SensorError: the TOML file of --columns is wrong.
    """
    from pbd.sensors.line_layout import layout_from_options, layout_from_toml
    from pbd.sensors.lines import LineDecoder
    from pbd.sensors.protocols import protocol
    from pbd.sensors.razor import razor_layout

    refuse_columns(args, sensor)
    if sensor not in ("lines", "razor"):
        decoder = protocol(sensor, also).decoder
        if args.unit:
            raise UsageError(f"--unit is for --sensor lines and razor; {sensor} has fixed units: leave it out")
        return decoder
    if sensor == "razor":
        layout = razor_layout(dict(args.unit))
    elif not args.columns:
        raise UsageError('name the numbers of a line: --columns "t,ax,ay,az,gx,gy,gz", or a .toml file')
    elif args.columns.endswith(".toml"):
        layout = layout_from_toml(read_text(Path(args.columns), SensorError, "give a TOML file"), args.columns)
    else:
        layout = layout_from_options(args.columns, dict(args.unit), args.separator, args.prefix, args.wrap)
    return lambda: LineDecoder(layout)


def save_keyframes(
    args: argparse.Namespace, demo: Demonstration, keyframes: tuple[Keyframe, ...], for_touch: bool = False
) -> Path:
    """Write keyframes.toml for a person to edit, or `for_touch` (see `write_keyframes`), and return its path.

    Raises:
        RecordingError: the demonstration is bundled or no folder, or another command wrote the file meanwhile.
    """
    from pbd.planning.options import PlanOptions, dwells

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
    # `dwells` gives 0 s to both ends. A person may insert keyframes beyond them, so here both ends get their own stay.
    padded = (keyframes[0], *keyframes, keyframes[-1])
    stays = dwells(padded, PlanOptions(time=args.time, dwell_s=args.dwell_s))[1:-1]
    magnetic = demo.recording.mag is not None
    path = write_keyframes(demo.folder, keyframes, magnetic, args.force, stays, demo.touch_ups, for_touch)
    say(f"wrote {path}: edit it; from now on the arm follows this file")
    return path
