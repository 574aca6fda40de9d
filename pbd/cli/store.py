"""A demonstration that a command has made finds its place."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from pbd.cli.options import print_json, say
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.data import Demonstration
    from pbd.files.points import Points


POINTS = "points.csv"
"""The file in a demonstration's folder that has the points which it touched."""


def store_demonstration(
    args: argparse.Namespace, demo: Demonstration, done: str, touched: Points | None = None
) -> None:
    """Write it under args.name, stamped with the time, and tell what was `done`; what it `touched` goes beside."""
    from pbd.files.demo import demo_folder, utc_now, write_demo
    from pbd.files.points import points_csv

    recording = replace(demo.recording, info=replace(demo.recording.info, created=utc_now()))
    folder = demo_folder(args.name)
    with working(f"writing {folder}"):
        remark = "simulated: touched with the sensor itself, in the robot's base"
        beside = {} if touched is None else {POINTS: points_csv(touched, remark)}
        write_demo(replace(demo, recording=recording), folder, args.force, beside)
    samples, duration_s, rate_hz = len(recording), float(recording.t[-1]), recording.rate_hz
    say(f"{done} {samples} samples, {duration_s:.1f} s at {rate_hz:.0f} Hz, into {folder}")
    if args.json:
        print_json(
            {
                "demo": folder.name,
                "folder": str(folder),
                "samples": samples,
                "duration_s": duration_s,
                "rate_hz": rate_hz,
            }
            | ({} if touched is None else {"points": str(folder / POINTS)})
        )
