"""The two verbs: `track` turns a recording into a hand path, `plan` turns a hand path into a joint trajectory."""

from __future__ import annotations

from pbd.data import HandPath, Recording
from pbd.errors import TrackingError
from pbd.tracking.conditioning import condition, refuse_gaps, refuse_wrong_units
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import integrate_path
from pbd.tracking.orientation import estimate_attitude
from pbd.tracking.rest import find_rest
from pbd.tracking.stops import find_stops
from pbd.tracking.uncertainty import stop_covariance


def track(recording: Recording) -> HandPath:
    """Track a hand: attitude, motion acceleration, stops, path.

    Raises:
        RecordingError: the recording can't be one (units, clock, no data).
        TrackingError: no path follows from it (never still, data missing in a move).
    """
    recording, gaps = condition(recording)
    rest = find_rest(recording)
    refuse_wrong_units(rest.gravity)
    attitude = estimate_attitude(recording, slice(rest.start, rest.stop))
    a_nav = motion_acceleration(recording, attitude, rest.gravity)
    stops = find_stops(recording, a_nav, attitude.wxyz_nav_sensor, rest)
    if not stops:
        raise TrackingError("the hand never stands still; stop for half a second between the moves")
    refuse_gaps(gaps, recording.t, stops)
    p, v, closure = integrate_path(recording.t, a_nav, stops)
    return HandPath(
        t=recording.t,
        p_nav_sensor=p,
        v_nav_sensor=v,
        wxyz_nav_sensor=attitude.wxyz_nav_sensor,
        stops=stops,
        closure=closure,
        cov=stop_covariance(recording, stops, closure, rest),
        grip=recording.grip,
    )
