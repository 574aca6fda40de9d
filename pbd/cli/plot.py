"""pbd plot [DEMO ...]."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.cli.options import (
    Commands,
    add_command,
    add_table,
    add_tracking,
    load_demonstration,
    named_calibration,
    print_json,
    say,
    track_demonstration,
)
from pbd.cli.parser import UsageError
from pbd.cli.progress import working

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pbd.data import Calibration, Demonstration, HandPath, Keyframe

FORMATS = ("png", "svg", "pdf")
LONGEST_NAME = 60
"""Characters of a folder's name that is put together from several."""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "plot",
        "draw a demonstration: the paper's figures and more; or compare several",
        "Draw a demonstration into files: the paper's figures 5 to 10, attitude, specific force, velocity with its\n"
        "residuals, sigma, magnetic field, sampling intervals, and a summary sheet. Several demonstrations of\n"
        "one task are overlaid at their first stop, with the spread at each keyframe, which is also printed as a\n"
        "table.",
        "  pbd plot pouring --save figures --format svg\n  pbd plot paper-test1 paper-test2 --csv > spread.csv",
    )
    parser.add_argument(
        "demos",
        nargs="*",
        metavar="DEMO",
        help="names (in ./demos, or bundled), folders, or recordings (.csv, .npz); two or more are compared; "
        "default: the newest in ./demos, else 'pouring'",
    )
    parser.add_argument("--save", type=Path, metavar="DIR", help="folder for the files (./plots/NAME)")
    parser.add_argument("--format", choices=FORMATS, default="png", help="format of the files (png)")
    add_table(parser, units="cm,deg")
    add_tracking(parser, calibration="none")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draw one, or compare several."""
    return _compare(args) if len(args.demos) > 1 else _plot(args)


def _plot(args: argparse.Namespace) -> int:
    if args.csv:
        raise UsageError(
            "--csv prints the spread of several demonstrations; name two or more, or use `pbd keyframes --csv`"
        )
    demo = load_demonstration(_named(args, args.demos[0] if args.demos else None))
    folder = _place(args.save, _word(demo))
    path, _ = _tracked(args, demo, named_calibration(args))
    with working("preparing the plots"):
        from pbd.plots.figures import draw, names
        from pbd.plots.values import demo_plot

        plot = demo_plot(path, args.warnings)
    for finding in plot.findings[len(args.warnings) :]:
        say(f"check: {finding.words}")
    files = _write(folder, args.format, names(plot), lambda name: draw(name, plot))
    if args.json:
        print_json(
            {
                "demo": demo.recording.info.name,
                "method": args.method,
                "files": [str(file) for file in files],
                "findings": [finding.words for finding in plot.findings],
            }
        )
    return 0


def _compare(args: argparse.Namespace) -> int:
    loaded = [load_demonstration(_named(args, name)) for name in args.demos]
    titles = _titles(loaded)
    together = "+".join(dict.fromkeys(map(_word, loaded)))
    if len(together) > LONGEST_NAME:
        together = f"{_word(loaded[0])[:LONGEST_NAME]}+{len(loaded) - 1}"
    folder = _place(args.save, together)
    calibration = named_calibration(args)
    tracked = [(title, *_track(args, title, demo, calibration)) for title, demo in zip(titles, loaded, strict=True)]
    with working("comparing"):
        from pbd.plots.compare import compare_plot, spread_rows, spread_table
        from pbd.plots.compare_figures import COMPARISONS, draw_comparison
        from pbd.view.tables import print_csv, print_table

        plot = compare_plot(tracked)
    for remark in plot.remarks:
        say(remark)
    files = _write(folder, args.format, COMPARISONS, lambda name: draw_comparison(name, plot))
    if args.json:
        print_json(
            {
                "demos": titles,
                "method": args.method,
                "matched_by": "order" if plot.by_order else "place",
                "remarks": list(plot.remarks),
                "keyframes": spread_rows(plot),
                "files": [str(file) for file in files],
            }
        )
        return 0
    table = spread_table(plot, args.units)
    if args.csv:
        print_csv(table)
    else:
        print_table(table)
    return 0


def _tracked(
    args: argparse.Namespace, demo: Demonstration, calibration: Calibration | None
) -> tuple[HandPath, tuple[Keyframe, ...]]:
    """Track it; where what is known of the stops can't be, without that: a plot shows why."""
    from pbd.errors import PbdWarning, TrackingError

    try:
        return track_demonstration(demo, args.method, calibration, args.accept_gap)
    except TrackingError as error:
        unaided = replace(demo, closed=False, places=(), contacts=())
        if unaided.known == demo.known:
            raise
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PbdWarning)  # they have been given
            tracked = track_demonstration(unaided, args.method, calibration, args.accept_gap)
        warnings.warn(f"{error.message}; drawn without it", PbdWarning, stacklevel=2)
        return tracked


def _named(args: argparse.Namespace, name: str | None) -> argparse.Namespace:
    """The same options for one of the demonstrations."""
    return argparse.Namespace(**{**vars(args), "demo": name})


def _track(
    args: argparse.Namespace, title: str, demo: Demonstration, calibration: Calibration | None
) -> tuple[HandPath, tuple[Keyframe, ...]]:
    """Track one of several: what goes wrong says with which."""
    from pbd.errors import PbdError

    say(f"tracking '{title}'")
    try:
        return _tracked(args, demo, calibration)
    except PbdError as error:
        raise type(error)(f"{title}: {error.message}", **error.fields) from None


def _titles(demos: list[Demonstration]) -> list[str]:
    """Their names, numbered where they repeat."""
    titles: list[str] = []
    for demo in demos:
        name, number = demo.recording.info.name, 2
        title = name
        while title in titles:
            title, number = f"{name} ({number})", number + 1
        titles.append(title)
    return titles


def _word(demo: Demonstration) -> str:
    """A demonstration's name as that of a folder."""
    if demo.folder is not None:
        return demo.folder.resolve().name
    word = "".join(c if c.isalnum() or c in "-_. " else "_" for c in demo.recording.info.name).strip(". ")
    return word or "recording"


def _place(save: Path | None, name: str) -> Path:
    """The folder for the files, tried before anything is drawn."""
    from pbd.files.whole import refuse_folder

    folder = save or Path("plots") / name
    refuse_folder(folder, other="--save")
    return folder


def _write(folder: Path, format_name: str, names: Collection[str], draw: Callable[[str], Figure]) -> list[Path]:
    """Draw figures into files, all of them or none, and say where they are."""
    from pbd.files.whole import written_together
    from pbd.plots.style import write

    files = [f"{name}.{format_name}" for name in names]
    with written_together(folder, files) as new:
        for number, (name, file) in enumerate(zip(names, files, strict=True), 1):
            with working(f"drawing {number} of {len(files)}: {name}"), (new / file).open("wb") as stream:
                write(draw(name), stream, format_name)
    say(f"wrote {len(files)} files into {folder}")
    return [folder / file for file in files]
