"""pbd segments [DEMO]: when the hand moved and when it rested."""

import argparse

from pbd.cli.common import load_demonstration, named_calibration, print_result, track_demonstration
from pbd.tracking.keyframes import find_segments
from pbd.view.terminal_tables import segments_table


def run(args: argparse.Namespace) -> None:
    """Track the demonstration and print its segments."""
    demo = load_demonstration(args.demo)
    path, _ = track_demonstration(args, demo, named_calibration(args))
    segments = find_segments(path)
    rows = [vars(segment) | {"ms": round(segment.ms, 3)} for segment in segments]
    print_result(args, {"segments": rows}, segments_table(segments, args.units))
