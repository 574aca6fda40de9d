"""The first verb: `track` turns a recording into a hand path; the second, `plan`, is in pbd/planning."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from pbd.calibration.check import disagreements, gravity_off
from pbd.calibration.frames import nav_in_base
from pbd.calibration.sensor import corrected
from pbd.data import Attitude, Calibration, Demonstration, HandPath, Known, Recording, SensorErrors, Stop, Tracking
from pbd.errors import PbdWarning, RecordingError, TrackingError
from pbd.pose import Array, quat_inverse, quat_log, quat_multiply
from pbd.tracking.conditioning import condition, refuse_gaps
from pbd.tracking.frozen import refuse_freezes
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import integrate_path
from pbd.tracking.known import condition_on
from pbd.tracking.orientation import estimate_attitude, mean_quaternion
from pbd.tracking.paper import paper_acceleration, paper_attitude, paper_covariance, paper_path, paper_stops
from pbd.tracking.rest import Rest, find_rest, rest_within
from pbd.tracking.restoring import clip_covariance, restore, settle_velocities
from pbd.tracking.saturation import find_clips
from pbd.tracking.smoothing import smooth_motion
from pbd.tracking.stops import find_stops
from pbd.tracking.uncertainty import (
    LEVEL_DOUBT,
    accelerometer_level,
    stop_covariance,
    stretch_covariance,
    unseen_covariance,
)

SAME_DOCK_RAD = np.radians(1.0)
"""An edited first keyframe is still the dock if it is turned by no more."""

OPEN_END_S = 0.2
"""Motion for longer than this at either end of a recording is told."""

METHODS = ("default", "paper")
"""How to track: as well as we can, or as the paper does."""


def track(
    source: Recording | Demonstration,
    method: str = "default",
    known: Known | None = None,
    calibration: Calibration | None = None,
    accept_gap: bool = False,
) -> HandPath:
    """Track a hand: attitude, motion acceleration, stops, path.

    A demonstration brings along what demo.toml and keyframes.toml say: places and heights are used here, the edited
    keyframes and the grasped object go with the path to `plan`. A recording alone knows nothing of that.

    Args:
        source: what the sensor said.
        method: one of METHODS; the paper's knows of no places.
        known: what is known of the stops: places, heights; None: what the demonstration says.
        calibration: the sensor's errors are taken out, by either method; it also tells what is known in the robot's
            base, and the lever from sensor to tool. `plan` tracks again where its own tells more than none.
        accept_gap: the hand is known to have stood still wherever data are missing in a rest: warn of such a gap that
            is long enough to hide a move, instead of refusing it.

    Raises:
        CalibrationError: the calibration is of another sensor.
        RecordingError: the recording can't be one (units, clock, no data); the edited keyframes start elsewhere.
        TrackingError: no path follows from it (never still, data missing where the hand may have moved), or what is
            known contradicts it.
    """
    demo = source if isinstance(source, Demonstration) else Demonstration(source)
    if known is not None:
        demo = replace(demo, closed=known.closed, places=known.places, contacts=known.contacts)
    path = _track(demo, method, calibration, accept_gap)
    _refuse_another_dock(demo, path)
    if method == "paper":
        return path
    try:
        return _condition(path, demo.known, calibration)
    except TrackingError as reason:
        if demo.folder is None or not reason.message.startswith("demo.toml "):
            raise
        raise TrackingError(f"{demo.folder}/{reason.message}", **reason.fields) from None


def _track(demo: Demonstration, method: str, calibration: Calibration | None, accept_gap: bool) -> HandPath:
    """From the recording alone."""
    recording, gaps = condition(demo.recording)
    clips = find_clips(recording)
    if method == "default":
        recording, clips = restore(recording, clips)
    if calibration is not None:
        recording = corrected(recording, calibration.sensor)  # after what is about the sensor's raw range
    rest = find_rest(recording)
    if method == "paper":
        attitude = paper_attitude(recording)
        a_nav = paper_acceleration(recording, attitude, rest.gravity)
        stops = paper_stops(recording.t, a_nav)
    elif method == "default":
        rest, attitude, a_nav, stops = find_motion(recording, rest)
        a_nav, clips = settle_velocities(recording.t, a_nav, attitude.wxyz_nav_sensor, stops, clips)
    else:
        raise TrackingError(f"no method '{method}'; known are {', '.join(METHODS)}", value=method)
    if not stops:
        raise TrackingError("the hand never stands still; stop for half a second between the moves")
    refuse_gaps(gaps, recording, stops, accept_gap)
    refuse_freezes(recording, a_nav, stops)
    off = _off_at_rest(recording, rest, None if calibration is None else calibration.sensor)
    _warn_of_open_ends(recording.t, stops)
    if method == "paper":
        p, v, closure = paper_path(recording.t, a_nav, stops)
        cov, stretch = paper_covariance(recording.t, stops, closure), 0.0
    else:
        p, v, closure = integrate_path(recording.t, a_nav, stops)
        cov = stop_covariance(recording, a_nav, p, stops, closure, rest)
        stretch = LEVEL_DOUBT * accelerometer_level(recording, stops, rest) / rest.gravity
        cov[:, :3, :3] += unseen_covariance(gaps, stops)
        cov += clip_covariance(recording.t, a_nav, attitude.wxyz_nav_sensor, p, stops, clips)
    cov[:, :3, :3] += stretch_covariance(p, stops, off)
    return HandPath(
        t=recording.t,
        p_nav_sensor=p,
        v_nav_sensor=v,
        wxyz_nav_sensor=attitude.wxyz_nav_sensor,
        stops=stops,
        closure=closure,
        cov=cov,
        grip=recording.grip,
        stretch=float(np.hypot(stretch, off)),
        tracking=Tracking(
            demo, method, calibration, recording, a_nav, rest.gravity, (rest.start, rest.stop), accept_gap
        ),
    )


def find_motion(recording: Recording, rest: Rest) -> tuple[Rest, Attitude, Array, tuple[Stop, ...]]:
    """Attitude, motion acceleration and stops of a conditioned recording; and the rest, which a stop must hold.

    Raises:
        TrackingError: no attitude, no rest.
    """
    for _ in range(3):
        attitude = estimate_attitude(recording, slice(rest.start, rest.stop))
        a_nav = motion_acceleration(recording, attitude, rest.gravity)
        stops = find_stops(recording, a_nav, attitude.wxyz_nav_sensor, rest)
        held = rest_within(recording, rest, stops) if stops else rest
        if held is rest:
            break
        rest = held  # what is taken for quiet follows from it: look again
    return rest, *smooth_motion(recording, attitude, a_nav, stops, rest), stops


def _refuse_another_dock(demo: Demonstration, path: HandPath) -> None:
    """The attitude at the dock says how nav lies in base: an edited one would turn all the others."""
    if demo.keyframes is None:
        return
    found = mean_quaternion(path.wxyz_nav_sensor[path.stops[0].start : path.stops[0].stop])
    turned = float(np.linalg.norm(quat_log(quat_multiply(quat_inverse(found), demo.keyframes[0].T_nav_sensor.wxyz))))
    if turned > SAME_DOCK_RAD:
        where = "" if demo.folder is None else f"{demo.folder}/keyframes.toml: "
        raise RecordingError(
            f"{where}the first keyframe is turned by {np.degrees(turned):.1f} degrees, but it is the dock, to which "
            "all others refer; restore it, or insert a keyframe after it",
            path=demo.folder,
        )


def _condition(path: HandPath, known: Known, calibration: Calibration | None) -> HandPath:
    if calibration is None or (calibration.T_base_dock is None and calibration.T_base_nav is None):
        return condition_on(path, known, calibration)
    first = slice(path.stops[0].start, path.stops[0].stop)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)  # of the dock's tilt: planning tells it
        T_base_nav = nav_in_base(calibration, mean_quaternion(path.wxyz_nav_sensor[first]))
    return condition_on(path, known, calibration, T_base_nav)


def _off_at_rest(recording: Recording, rest: Rest, errors: SensorErrors | None) -> float:
    """Share of gravity by which the sensor is off at rest, 0 where that is usual; warns of what it reads wrongly."""
    rows, acc = slice(rest.start, rest.stop), rest.gravity * rest.up_sensor
    gyr = None if recording.gyr is None else rest.gyro_bias
    mag = None if recording.mag is None else recording.mag[rows].mean(axis=0)
    for line in disagreements(errors, acc, gyr, mag):
        warnings.warn(line, PbdWarning, stacklevel=3)
    return gravity_off(errors, acc)


def _warn_of_open_ends(t: Array, stops: tuple[Stop, ...]) -> None:
    before, after = float(t[stops[0].start] - t[0]), float(t[-1] - t[stops[-1].stop - 1])
    if before > OPEN_END_S:
        warnings.warn(
            f"the hand moves when the recording starts; its first rest, at {before:.1f} s, is taken as the dock",
            PbdWarning,
            stacklevel=3,
        )
    if after > OPEN_END_S:
        warnings.warn(
            f"the hand moves when the recording ends: the last {after:.1f} s are not used; stop before you end the "
            "recording",
            PbdWarning,
            stacklevel=3,
        )
