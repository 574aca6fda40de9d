"""Reports how well the magnetic heading repeats, for `pbd calibrate points`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from pbd.calibration.field_uniformity import field_spread, heading_changes
from pbd.calibration.rests import rms
from pbd.calibration.sensor import corrected
from pbd.cli.console import say, working
from pbd.data import Calibration, Keyframe, Recording
from pbd.errors import warn
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.tracking.keyframes import find_keyframes


def report_heading(
    args: argparse.Namespace, recording: Recording, keyframes: Sequence[Keyframe], calibration: Calibration, part: str
) -> float | None:
    """Say how well nav's heading repeats; return its sigma, rad, or None without a magnetometer."""
    if recording.mag is None:
        if part == "nav":
            warn(
                "without a magnetometer the heading is measured from the first rest, so [nav] holds only for "
                "demonstrations that start with the same heading; use --as dock instead"
            )
        return None
    mag = corrected(recording, calibration.sensor).mag
    assert mag is not None
    at_stops = [mag[np.abs(recording.t - keyframe.t) <= 0.5 * keyframe.dwell_s] for keyframe in keyframes]
    means = np.array([each.mean(axis=0) for each in at_stops])
    spread = field_spread(means, np.array([keyframe.T_nav_sensor.wxyz for keyframe in keyframes]))
    heading = spread.heading
    say(
        f"the magnetic heading differs by {np.degrees(spread.heading):.1f} degrees from stop to stop (rms), the "
        f"field's strength by {100.0 * spread.strength:.0f} %"
    )
    if args.again:
        first = []
        for name in args.again:
            with working(f"tracking {name}"):
                path = track(load_demo(name).recording, calibration=calibration, accept_gap=args.accept_gap)
                first.append(find_keyframes(path)[0].T_nav_sensor.wxyz)
        changes = heading_changes(keyframes[0].T_nav_sensor.wxyz, first)
        heading = rms(changes)
        say(
            f"nav's heading repeats to {np.degrees(heading):.1f} degrees (rms over {len(changes)} demonstrations; at "
            f"most {np.degrees(np.abs(changes).max()):.1f})"
        )
    if part == "nav" and spread.disturbed:
        warn(
            "the magnetic field is disturbed here, or the magnetometer is not calibrated: start every demonstration "
            "from a dock (--as dock), whose heading does not depend on it"
        )
    return heading
