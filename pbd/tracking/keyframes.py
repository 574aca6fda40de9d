"""The poses at the stops, and the intervals between them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from pbd.data import GripEvent, HandPath, HandSegment, Keyframe, Stop
from pbd.errors import require_type, warn
from pbd.pose import Array, Pose, quat_inverse, quat_log, quat_multiply
from pbd.tracking.smoother.attitude import mean_quaternion

NEAR_STOP_S = 0.5
"""s: largest distance of a time from its stop. Beyond it a grip event gets a warning, and a claim is refused."""


def keyframes_of(path: HandPath) -> tuple[Keyframe, ...]:
    """The keyframes to use: those that a person edited, else those found.

    A keyframe that was copied into a move has the path's covariance there, if it still has another's.
    """
    require_type("keyframes_of", path, "pbd.track", HandPath)
    edited = None if path.tracking is None else path.tracking.demo.keyframes
    if edited is None:
        return find_keyframes(path)
    keyframes = list(edited)
    for k, (keyframe, number) in enumerate(zip(edited, path.stop_numbers([each.t for each in edited]), strict=True)):
        in_move = keyframe.cov.any() and number % 1.0
        if in_move and sum(np.array_equal(keyframe.cov, other.cov) for other in edited) > 1:
            keyframes[k] = replace(keyframe, cov=path.covariance.joint_at(np.array([number])))
    return tuple(keyframes)


def find_keyframes(path: HandPath) -> tuple[Keyframe, ...]:
    """One keyframe per stop, at the stop's middle, with its position and mean attitude.

    The first one, the dock, has no learned tolerance: where it is, the calibration says, and not the takes.
    """
    events = path.grip if len(path.stops) > 1 else ()  # without a move all events are at the one stop
    grips, fusion = _without_repeats(_grip_at_stops(events, path.t, path.stops)), path.fusion
    return tuple(
        Keyframe(
            t=stop.middle_s(path.t),
            dwell_s=stop.dwell_s,
            T_nav_sensor=Pose(
                path.p_nav_sensor[stop.start], mean_quaternion(path.wxyz_nav_sensor[stop.start : stop.stop])
            ),
            cov=path.cov[k],
            grip=grips.get(k),
            tolerance_m=None if fusion is None or k == 0 else fusion.tolerance_m[k],
            tolerance_rad=None if fusion is None or k == 0 else float(fusion.tolerance_rad[k]),
            weight=stop.weight,
        )
        for k, stop in enumerate(path.stops)
    )


def find_segments(path: HandPath) -> tuple[HandSegment, ...]:
    """Cut a recording into rests and moves, and name the kind of each motion (the paper's Table I)."""
    bounds = sorted({0, len(path.t), *(i for stop in path.stops for i in (stop.start, stop.stop))})
    rests = {stop.start for stop in path.stops}
    return tuple(
        HandSegment(
            start=start,
            stop=stop,
            kind="rest" if start in rests else "move",
            ms=1e3 * float(path.t[stop - 1] - path.t[start]),
            description="No hand motion occurs" if start in rests else _describe(path, start, stop),
        )
        for start, stop in pairwise(bounds)
    )


def _describe(path: HandPath, start: int, stop: int) -> str:
    span = slice(max(start - 1, 0), stop + 1)
    extent = np.ptp(path.p_nav_sensor[span], axis=0)
    wxyz = path.wxyz_nav_sensor[span]
    turns = np.linalg.norm(quat_log(quat_multiply(quat_inverse(wxyz[0]), wxyz)), axis=1)
    if extent.max() < 0.03 and turns.max() > np.radians(10.0):  # m along each axis, rad
        return "Hand rotation"
    axis = "xyz"[int(np.argmax(extent))]
    kind = "Vertical" if axis == "z" else "Horizontal"
    return f"{kind} motion (mainly along {axis} axis)"


def nearest_stop(t: Array, stops: tuple[Stop, ...], at: float) -> tuple[int, float]:
    """Index of the stop that is nearest to a time, and their distance, s (0 in the stop)."""
    begins, ends = t[[stop.start for stop in stops]], t[[stop.stop - 1 for stop in stops]]
    away = np.maximum(np.maximum(begins - at, at - ends), 0.0)
    nearest = int(np.argmin(away))
    return nearest, float(away[nearest])


def _grip_at_stops(events: tuple[GripEvent, ...], t: Array, stops: tuple[Stop, ...]) -> dict[int, bool]:
    """Stop index -> whether the grip closes, for each stop with a grip event. An event belongs to the nearest stop."""
    at: dict[int, bool] = {}
    for event in events if stops else ():
        nearest, away = nearest_stop(t, stops, event.t)
        if away > NEAR_STOP_S:
            warn(
                f"the grip {'closed' if event.closed else 'opened'} at {event.t:.2f} s, {away:.1f} s from the "
                f"nearest stop; it is taken to belong to stop {nearest}"
            )
        at[nearest] = event.closed
    return at


def _without_repeats(grips: dict[int, bool]) -> dict[int, bool]:
    """Leave out grip events that repeat the one before. The grip is open at the start."""
    changing: dict[int, bool] = {}
    for stop in sorted(grips):
        closed = grips[stop]
        if closed == (bool(changing) and changing[max(changing)]):
            does, state = ("closes", "closed") if closed else ("opens", "open")
            since = f"since stop {max(changing)}" if changing else "from the start"
            warn(
                f"the grip {does} at stop {stop}, but it is {state} {since}: left out; "
                "see [[grip]] in demo.toml, where one may be missing, or two be at one stop"
            )
            continue
        changing[stop] = closed
    return changing
