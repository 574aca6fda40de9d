"""pbd segments [DEMO]."""

from __future__ import annotations

import argparse

from pbd.cli.options import (
    Commands,
    add_command,
    add_demo,
    add_table,
    add_tracking,
    load_demonstration,
    named_calibration,
    print_json,
    track_demonstration,
)


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "segments",
        "when the hand moved, when it rested, and what kind of motion it was",
        "Print the paper's Table I for a demonstration: the intervals of samples, what happens in each, and how long.",
        "  pbd segments paper-test1",
    )
    add_demo(parser)
    add_table(parser, units="ms")
    add_tracking(parser, calibration="none")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track and print."""
    from pbd.tracking.keyframes import find_segments
    from pbd.view.tables import print_csv, print_table, segments_table

    demo = load_demonstration(args)
    path, _ = track_demonstration(demo, args.method, named_calibration(args), args.accept_gap)
    segments = find_segments(path)
    if args.json:
        rows = [
            {"start": s.start, "stop": s.stop, "kind": s.kind, "ms": round(s.ms, 3), "description": s.description}
            for s in segments
        ]
        print_json({"segments": rows})
    elif args.csv:
        print_csv(segments_table(segments, args.units))
    else:
        print_table(segments_table(segments, args.units))
    return 0
