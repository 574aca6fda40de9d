"""pbd touch DEMO KEYFRAME: correct a keyframe where the arm was off; keyframes with correlated errors move along."""

import argparse
import shlex

import numpy as np

from pbd.calibration.dock import place_in_base
from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.touch_up import TouchedUp, demonstrated_places, touched_poses, touched_up
from pbd.cli.common import load_demonstration, print_result, save_keyframes, track_demonstration
from pbd.cli.console import say
from pbd.data import TouchUp
from pbd.data.world import beyond_reach
from pbd.errors import RecordingError, UsageError, warn
from pbd.files.keyframes import FARTHEST_M, KEYFRAMES_FILE
from pbd.files.keyframes_edit import add_touch_up, undo_touch_up
from pbd.io.numbers import LARGEST_NUDGE_M
from pbd.planning import load_robot_and_calibration
from pbd.planning.result import place_remark, robot_remark
from pbd.plots.findings import OFF_SIGMAS
from pbd.pose import quat_inverse, quat_rotate
from pbd.view.terminal_tables import make_table


def run(args: argparse.Namespace) -> None:
    """Add a touch-up to keyframes.toml, or undo the last one, and print what it moves."""
    if args.undo == (args.keyframe is not None) or (args.undo and (args.by or args.at or args.only or args.tool)):
        raise UsageError("name the keyframe, and how far its tool is off (--by, --at); or --undo alone")
    if not args.undo and (args.by is None) == (args.at is None):
        raise UsageError("say where the tool belongs: --by X Y Z from where it is, or --at X Y Z in base")
    if args.at and args.tool:
        raise UsageError("--tool is for --by: --at is a place in base; leave --tool out")
    demo = load_demonstration(args.demo)
    robot, calibration = load_robot_and_calibration(args.robot, args.calibration)
    path, keyframes = track_demonstration(args, demo, calibration)
    placed = place_in_base(keyframes, calibration, args.scale, path, args.orientation)
    before = touched_up(placed)
    if args.undo and all(each.undone for each in demo.touch_ups):
        raise RecordingError("there is no touch-up to undo; `pbd touch DEMO KEYFRAME --robot R --by X Y Z` makes one")
    added = None if args.undo else _touch_up(args, placed)
    if demo.keyframes is None or demo.folder is None:
        file = save_keyframes(args, demo, keyframes, for_touch=True)
    else:
        file = demo.folder / KEYFRAMES_FILE
    if added is None:
        touch_ups = undo_touch_up(file)
    else:
        add_touch_up(file, added)
        touch_ups = (*demo.touch_ups, added)
    for remark in filter(None, (robot_remark(robot), place_remark(robot, calibration, args.calibration))):
        say(remark)  # base's axes are those of --by
    _report(args, placed, before, touched_up(placed, touch_ups))
    if not touch_ups:
        say(f"undone, and {file}, which nobody had edited, is removed")
        return
    back = "" if args.undo else f"; {_undo_command(args)} takes it back"
    say(f"{'undone' if args.undo else 'added'} in {file}, which the arm follows from now on{back}")


def _touch_up(args: argparse.Namespace, placed: KeyframesInBase) -> TouchUp:
    """Make the touch-up that --by or --at asks for."""
    count = len(placed.keyframes)
    if not 0 <= args.keyframe < count:
        raise RecordingError(f"there is no keyframe {args.keyframe}; they are 0 to {count - 1}", value=args.keyframe)
    pose = touched_poses(placed)[args.keyframe]  # warns of touch-ups that were made with another calibration
    if args.at is not None:
        by_base = np.array(args.at) - pose.p
    else:
        by_base = quat_rotate(pose.wxyz, args.by) if args.tool else np.array(args.by)
    by_nav = quat_rotate(quat_inverse(placed.T_base_nav.wxyz), by_base)
    if not np.abs(by_nav).max() <= LARGEST_NUDGE_M:  # keyframes.toml with it could not be read again
        raise RecordingError(
            f"that is {np.linalg.norm(by_base):.2f} m away, and a touch-up may be at most {LARGEST_NUDGE_M} m "
            "along each of nav's axes; --by and --at are in metres: correct them"
        )
    t, place = placed.keyframes[args.keyframe].t, demonstrated_places(placed)[args.keyframe]
    if far := beyond_reach(place, FARTHEST_M):
        raise RecordingError(f"keyframe {args.keyframe} is at {far}; correct --scale, or the dock", value=args.scale)
    return TouchUp(t, by_nav, args.only, from_base_m=place)


def _undo_command(args: argparse.Namespace) -> str:
    """Return the command that undoes this touch-up."""
    by = f" --calibration {shlex.quote(args.calibration)}" if args.calibration else ""
    by += " --accept-gap" if args.accept_gap else ""
    return f"`pbd touch {shlex.quote(args.demo)} --robot {shlex.quote(args.robot)}{by} --undo`"


def _report(args: argparse.Namespace, placed: KeyframesInBase, before: TouchedUp, after: TouchedUp) -> None:
    """Print where each keyframe was and is now; warn if the touch-up is larger than the keyframe's sigma explains."""
    p = np.array([pose.p for pose in tool_poses(placed)])
    start, end = p + before.shift, p + after.shift
    old, new = (np.sqrt(np.diagonal(each.cov).reshape(-1, 6)[:, :3].max(axis=1)) for each in (before, after))
    moved_m = np.linalg.norm(end - start, axis=1)
    names = ("index", "from_m", "to_m", "sigma_before_m", "sigma_m")
    rows = [dict(zip(names, row, strict=True)) for row in zip(range(len(p)), start, end, old, new, strict=True)]
    result = {"demo": args.demo, "keyframe": args.keyframe, "undo": args.undo, "keyframes": rows}
    units, fine = args.units, args.units.finer
    columns = [f"{what} {axis} ({units.length})" for what in ("from", "to") for axis in "xyz"]
    table = make_table("#", *columns, *(f"{what} ({fine.length})" for what in ("moves", "σ before", "σ")))
    for k, figures in enumerate(zip(moved_m, old, new, strict=True)):
        table.add_row(str(k), *units.lengths(start[k]), *units.lengths(end[k]), *fine.lengths(figures, finer=1))
    print_result(args, result, table)
    if args.only or args.undo:
        return
    if moved_m[args.keyframe] > OFF_SIGMAS * old[args.keyframe]:
        off = f"{100.0 * moved_m[args.keyframe]:.1f} cm, {moved_m[args.keyframe] / old[args.keyframe]:.0f} sigma"
        meant = f"if it alone belongs elsewhere, {_undo_command(args)}, and again with --only"
        warn(f"keyframe {args.keyframe} was off by {off}, and the others go along; {meant}")
    others = np.delete(moved_m, args.keyframe)
    if others.max(initial=0.0) < 0.0005 < moved_m[args.keyframe]:
        say(f"the others hardly move: their errors have little in common with those of keyframe {args.keyframe}")
