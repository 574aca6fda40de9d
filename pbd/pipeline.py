"""The first of the two main functions: `track` turns a recording into a hand path. `plan` is in pbd/planning."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.calibration.dock import nav_in_base, with_heading_sigma
from pbd.data import Calibration, Demonstration, HandPath, Known, Recording
from pbd.errors import RecordingError, TrackingError, collected_warnings, listed, require_kind, require_type, warn
from pbd.files.keyframes import ROUNDING_M
from pbd.fusion.fuse import fused_path
from pbd.lapack import one_blas_thread
from pbd.pose import quat_inverse, quat_log, quat_multiply
from pbd.track_recording import track_recording
from pbd.tracking.apply_constraints import apply_constraints
from pbd.tracking.smoother.attitude import mean_quaternion

SAME_DOCK_RAD = np.radians(1.0)
"""Largest rotation from the tracked to the edited first keyframe, rad: the first keyframe must stay the dock."""

MILLISECOND_S = 1e-3
"""Rounding of a time in keyframes.toml, s."""


def fuse(takes: Sequence[Demonstration], calibration: Calibration | None = None, accept_gap: bool = False) -> HandPath:
    """Estimate one hand path from several takes of a task, as `track` does for a demonstration that lists its takes.

    All takes are estimated together: they share the sensor's errors, and the hand scatters from take to take. Between
    keyframes the path is the mean of the takes. `HandPath.fusion` says which keyframes were matched, which were left
    out, and how the hand scatters.

    Args:
        takes: two or more demonstrations of one task, by one device or by several. The first take defines nav and how
            the sensor is held.
        calibration, accept_gap: as `track` takes them.

    Raises:
        RecordingError: fewer than two takes, or the same take twice.
        WrongTypeError: a take is not a Demonstration, for example a name.
        TrackingError: the takes are of different tasks, or one of them can't be tracked.
    """
    return track(fused_demo(takes), calibration=calibration, accept_gap=accept_gap)


def fused_demo(takes: Sequence[Demonstration]) -> Demonstration:
    """Make the demonstration that lists these takes; a fused one adds its own takes. Raises as `fuse` does."""
    require_kind("takes", takes, "a list of demonstrations", isinstance(takes, Sequence) and not isinstance(takes, str))
    for take in takes:
        require_type("fuse", take, "pbd.load_demo", Demonstration)
    takes = [one for take in takes for one in (take.takes or (take,))]
    if len(takes) < 2:
        raise RecordingError(
            f"fusing needs two takes of a task or more, got {len(takes)}; record another, or use it as it is"
        )
    first = takes[0]
    info = replace(first.recording.info, name="+".join(take.recording.info.name for take in takes))
    return Demonstration(
        replace(first.recording, info=info),
        grasped=next((take.grasped for take in takes if take.grasped), None),
        takes=tuple(takes),
    )


@one_blas_thread
def track(
    source: Recording | Demonstration,
    method: str = "default",
    known: Known | None = None,
    calibration: Calibration | None = None,
    accept_gap: bool = False,
) -> HandPath:
    """Estimate the hand's motion: attitude, acceleration, stops and path.

    A demonstration includes demo.toml and keyframes.toml. Known places and heights are used here; edited keyframes and
    the grasped object stay with the path, for `plan`. A recording has none of them.

    Args:
        source: the samples, or a demonstration with them.
        method: "default", or "paper". The paper's method does not use known places.
        known: known places and heights of the stops; None: as the demonstration says.
        calibration: the sensor's errors, which either method removes; places known in the robot's base; the lever
            from sensor to tool. Without it, `plan` tracks again if its own calibration has any of these.
        accept_gap: the user says that the hand stood still wherever data are missing in a rest. A gap that is long
            enough to hide a move is then a warning, not an error.

    Raises:
        CalibrationError: the calibration belongs to another sensor.
        RecordingError: the samples are not valid (units, clock, no data), or the edited first keyframe was rotated.
        TrackingError: no path can be estimated (the hand is never still, data are missing where it may have moved), or
            a known place contradicts the samples.
        UsageError: there is no such method.
        WrongTypeError: the source is neither, for example a name.
    """
    require_type("track", source, "pbd.load_demo", Recording, Demonstration)
    require_type("track", known, "pbd.data.Known", Known, optional=True)
    require_type("track", calibration, "pbd.load_calibration", Calibration, optional=True)
    demo = source if isinstance(source, Demonstration) else Demonstration(source)
    if known is not None:
        demo = replace(demo, closed=known.closed, places=known.places, contacts=known.contacts)
    if demo.takes:
        path = fused_path(demo, method, calibration, accept_gap)
        demo = replace(demo, places=(*demo.places, *(path.fusion.places if path.fusion else ())))
    else:
        path = track_recording(demo, method, calibration, accept_gap)[0]
    _refuse_turned_dock(demo, path, method)
    _warn_of_edited_times(demo, path)
    if method == "paper":
        return path
    try:
        path = _condition_on_known(path, demo.known, calibration)
    except TrackingError as reason:
        if demo.folder is None or not reason.message.startswith("demo.toml "):
            raise
        raise TrackingError(f"{demo.folder}/{reason.message}", **reason.fields) from None
    _warn_of_edited_places(demo, path)
    return path


def _refuse_turned_dock(demo: Demonstration, path: HandPath, method: str) -> None:
    """Refuse an edited first keyframe whose attitude changed: it orients nav in base, so all keyframes would rotate."""
    if demo.keyframes is None:
        return
    found = mean_quaternion(path.wxyz_nav_sensor[path.stops[0].start : path.stops[0].stop])
    turned = float(np.linalg.norm(quat_log(quat_multiply(quat_inverse(found), demo.keyframes[0].T_nav_sensor.wxyz))))
    if turned > SAME_DOCK_RAD:
        where = "" if demo.folder is None else f"{demo.folder}/keyframes.toml: "
        raise RecordingError(
            f"{where}the first keyframe is turned by {np.degrees(turned):.1f} degrees, but it is the dock, to which "
            "all others refer; restore it, insert a keyframe after it, or name the --method and "
            f"--calibration that found it (the method here is {method})",
            path=demo.folder,
        )


def _warn_of_edited_times(demo: Demonstration, path: HandPath) -> None:
    """Warn of edited keyframes before or after the recording: the hand's way and time to them are unknown.

    Of a fused demonstration, warn too if they have the times of other takes: --path demo would follow the wrong part of
    the path.
    """
    first, last = float(path.t[0]), float(path.t[-1])
    times = enumerate(each.t for each in demo.keyframes or ())
    outside = [k for k, t in times if not first - MILLISECOND_S <= t <= last + MILLISECOND_S]
    if outside:
        which = f"keyframe{'s' * (len(outside) > 1)} {listed(map(str, outside))}"
        warn(
            f"{which} of keyframes.toml: t_s is not between {first:.1f} and {last:.1f} s, when the hand was recorded; "
            "--time demo takes such a time as it is, and --path demo goes straight there"
        )
    at = [path.stop_at(each.t) for each in demo.keyframes or ()]
    if demo.takes and None in at and not set(range(len(path.stops))) <= set(at):
        moving = f"keyframe {at.index(None)} of keyframes.toml is in a move of the fused takes"
        again = "find them again (pbd keyframes DEMO --save --force), and edit those"
        warn(f"{moving}; if takes were added or changed since it was saved, its times no longer hold: {again}")


def _warn_of_edited_places(demo: Demonstration, path: HandPath) -> None:
    """Warn of edited keyframes that are elsewhere than what is known of their stops moves these to."""
    known = {fit.stop for fit in path.claims}
    at = [(path.stop_at(each.t), each.T_nav_sensor.p) for each in demo.keyframes or ()]
    off = [p - path.p_nav_sensor[path.stops[k].start] for k, p in at if k is not None and k in known]
    if (away := float(np.abs(off).max(initial=0.0))) > ROUNDING_M:
        warn(
            f"what demo.toml says of places and heights does not move the keyframes of keyframes.toml, up to "
            f"{1e3 * away:.1f} mm: they were edited, or saved before, or with another calibration; `pbd keyframes DEMO "
            "--save --force`, with this --calibration or --robot, finds them anew"
        )


def _condition_on_known(path: HandPath, known: Known, calibration: Calibration | None) -> HandPath:
    """Condition the path on known places; those in base need T_base_nav, by the attitude at the first stop."""
    T_base_nav = None
    if calibration is not None and calibration.knows_start:
        first = slice(path.stops[0].start, path.stops[0].stop)
        with collected_warnings():  # planning warns of the dock's tilt
            if known.places or known.contacts:
                calibration = with_heading_sigma(path, calibration)
            T_base_nav = nav_in_base(calibration, mean_quaternion(path.wxyz_nav_sensor[first]))
    return apply_constraints(path, known, calibration, T_base_nav)
