"""How well nav's heading repeats, as `pbd calibrate points` tells it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pbd.cli.options import say
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.data import Calibration, Keyframe, Recording
    from pbd.pose import Array


def magnetometer(recording: Recording) -> Array | None:
    """What it read, without holes; None where there is none, or a dead one."""
    from pbd.errors import PbdWarning
    from pbd.tracking.conditioning import condition

    if recording.mag is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)  # tracking tells it
        return condition(recording)[0].mag


def tell_heading(
    again: Sequence[str],
    recording: Recording,
    keyframes: tuple[Keyframe, ...],
    calibration: Calibration | None,
    part: str,
    accept_gap: bool = False,
) -> float | None:
    """How well nav's heading repeats, rad, one sigma; None without a magnetometer. Tell it, and what to do."""
    import numpy as np

    from pbd.calibration.field_uniformity import field_spread, heading_changes
    from pbd.calibration.sensor import corrected
    from pbd.errors import PbdWarning
    from pbd.files.demo import load_demo
    from pbd.pipeline import track
    from pbd.tracking.keyframes import find_keyframes

    if recording.mag is None:
        if part == "nav":
            warnings.warn(
                "without a magnetometer the heading is measured from the first rest, so [nav] holds only for "
                "demonstrations that start with the same heading; use --as dock instead",
                PbdWarning,
                stacklevel=2,
            )
        return None
    mag = corrected(recording, None if calibration is None else calibration.sensor).mag
    assert mag is not None
    at_stops = [mag[np.abs(recording.t - keyframe.t) <= 0.5 * keyframe.dwell_s] for keyframe in keyframes]
    means = np.array([each.mean(axis=0) for each in at_stops])
    spread = field_spread(means, np.array([keyframe.T_nav_sensor.wxyz for keyframe in keyframes]))
    heading = spread.heading
    say(
        f"the magnetic heading differs by {np.degrees(spread.heading):.1f} degrees from stop to stop (rms), the "
        f"field's strength by {100.0 * spread.strength:.0f} %"
    )
    if again:
        first = []
        for name in again:
            with working(f"tracking {name}"):
                path = track(load_demo(name).recording, calibration=calibration, accept_gap=accept_gap)
                first.append(find_keyframes(path)[0])
        changes = heading_changes(keyframes[0].T_nav_sensor.wxyz, [each.T_nav_sensor.wxyz for each in first])
        heading = float(np.sqrt(np.mean(changes**2)))
        say(
            f"nav's heading repeats to {np.degrees(heading):.1f} degrees (rms over {len(changes)} demonstrations; at "
            f"most {np.degrees(np.abs(changes).max()):.1f})"
        )
    if part == "nav" and spread.disturbed:
        warnings.warn(
            "the magnetic field is disturbed here, or the magnetometer is not calibrated: start every demonstration "
            "from a dock (--as dock), whose heading does not depend on it",
            PbdWarning,
            stacklevel=2,
        )
    return heading
