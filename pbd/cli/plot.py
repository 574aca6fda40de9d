"""pbd plot [DEMO ...]: figures of one demonstration, or of several compared."""

import argparse
from dataclasses import replace
from pathlib import Path

from pbd.cli.common import (
    load_demonstration,
    named_calibration,
    print_result,
    track_demonstration,
    without_aside,
    write_figures,
)
from pbd.cli.console import print_json, say, working
from pbd.data import Calibration, Demonstration, HandPath, Keyframe
from pbd.errors import TrackingError, UsageError, collected_warnings, naming, warn
from pbd.io.atomic import refuse_folder

LONGEST_NAME = 60
"""Longest folder name that is joined from several demonstrations' names, characters."""


def run(args: argparse.Namespace) -> None:
    """Draw one demonstration, or compare several."""
    args.demos = without_aside(args.demos)
    if len(args.demos) > 1:
        return _compare(args)
    if args.csv or args.units.asked:
        wanted = "name two or more, or use `pbd keyframes DEMO`"
        raise UsageError(f"--csv and --units are for the spread of several demonstrations; {wanted}")
    demo = load_demonstration(args.demos[0] if args.demos else None)
    folder = _figures_folder(args.save, _folder_name(demo))
    path, _ = _tracked(args, demo, named_calibration(args))
    with working("preparing the plots"):
        from pbd.plots.demo_values import demo_values
        from pbd.plots.figures import draw, names

        plot = demo_values(path, args.warnings)
    for finding in plot.findings:
        if finding.words not in args.warnings:
            say(f"check: {finding.words}")
    files = write_figures(folder, args.format, names(plot), lambda name: draw(name, plot))
    if args.json:
        findings = [finding.words for finding in plot.findings]
        print_json({"demo": demo.recording.info.name, "method": args.method, "files": files, "findings": findings})
    return None


def _compare(args: argparse.Namespace) -> None:
    loaded = [load_demonstration(name) for name in args.demos]
    titles = _titles(loaded)
    together = "+".join(dict.fromkeys(map(_folder_name, loaded)))
    if len(together) > LONGEST_NAME:
        together = f"{_folder_name(loaded[0])[:LONGEST_NAME]}+{len(loaded) - 1}"
    folder = _figures_folder(args.save, together)
    calibration = named_calibration(args)
    tracked = []
    for title, demo in zip(titles, loaded, strict=True):
        say(f"tracking '{title}'")
        with naming(title):
            tracked.append((title, *_tracked(args, demo, calibration)))
    with working("comparing"):
        from pbd.plots.compare import compare, spread_rows, spread_table
        from pbd.plots.compare_figures import COMPARISONS

        plot = compare(tracked)
    for remark in plot.remarks:
        say(remark)
    files = write_figures(folder, args.format, COMPARISONS, lambda name: COMPARISONS[name](plot))
    result = {
        "demos": titles,
        "method": args.method,
        "matched_by": "order" if plot.by_order else "place",
        "remarks": list(plot.remarks),
        "keyframes": spread_rows(plot),
        "files": files,
    }
    print_result(args, result, spread_table(plot, args.units))


def _tracked(
    args: argparse.Namespace, demo: Demonstration, calibration: Calibration | None
) -> tuple[HandPath, tuple[Keyframe, ...]]:
    """Track a demonstration; without its known places if they contradict the samples, so that a plot shows why."""
    try:
        return track_demonstration(args, demo, calibration)
    except TrackingError as error:
        unaided = replace(demo, closed=False, places=(), contacts=())
        if unaided.known == demo.known:
            raise
        with collected_warnings():  # the first attempt has issued them
            tracked = track_demonstration(args, unaided, calibration)
        warn(f"{error.message}; drawn without it")
        return tracked


def _titles(demos: list[Demonstration]) -> list[str]:
    """Return the demonstrations' names; a repeated name gets a number from the second on."""
    titles: list[str] = []
    for demo in demos:
        name = demo.recording.info.name
        numbered = (f"{name} ({number})" for number in range(2, len(demos) + 1))
        titles.append(next(title for title in (name, *numbered) if title not in titles))
    return titles


def _folder_name(demo: Demonstration) -> str:
    """Return a demonstration's name, without characters that a folder's name can't have."""
    if demo.folder is not None:
        return demo.folder.resolve().name
    word = "".join(c if c.isalnum() or c in "-_. " else "_" for c in demo.recording.info.name).strip(". ")
    return word or "recording"


def _figures_folder(save: Path | None, name: str) -> Path:
    """Return the folder for the figures; refuse it before anything is drawn if it can't be written."""
    folder = save or Path("plots") / name
    refuse_folder(folder, other="--save")
    return folder
