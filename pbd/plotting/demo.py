"""What the plots of one demonstration show."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pbd.data import HandPath, Recording, Truth
from pbd.plotting.findings import at_stop, find, length, stop_names
from pbd.pose import Array, quat_about_z, quat_multiply, quat_rotate, quat_to_rpy, yaw_toward
from pbd.tracking.alarm import DISTURBED
from pbd.tracking.keyframes import keyframes_of
from pbd.tracking.knots import FIELD_S
from pbd.tracking.paper import LAMBDA_V, paper_stops, resulting_variance
from pbd.view.plot_values import DemoPlot, FieldPlot, TruthPlot

TRUTH_NEAR_S = 0.5
"""The truth must say where the first stop is: at its middle, or so near to it."""

TRUTH_SPEED_S = 0.02
"""The true velocity is a difference over this long on either hand: from one optical sample to the next it is noise."""

LATE = 1.5
"""An interval of so many median ones is a sample that is late, or lost."""


def demo_plot(path: HandPath, remarks: Sequence[str] = ()) -> DemoPlot:
    """Collect what the plots of a demonstration show.

    Args:
        path: as tracked: what led to it, and the demonstration with its truth and edited keyframes, come with it.
        remarks: the warnings that were given on the way.

    Raises:
        ValueError: the path was not tracked.
    """
    tracking = path.tracking
    if tracking is None:
        raise ValueError("the path was not tracked, so there is no recording to plot; give what pbd.track returns")
    demo, recording, a_nav = tracking.demo, tracking.recording, tracking.a_nav
    keyframes = keyframes_of(path)
    truth = None if demo.truth is None else _truth(demo.truth, path)
    field = None if recording.mag is None else _field(recording.mag, path, slice(*tracking.rest))
    sigma_p, sigma_turn = _sigma_along(path)
    names = stop_names(path, keyframes)
    return DemoPlot(
        name=demo.recording.info.name,
        method=tracking.method,
        sensor=recording.info.sensor,
        path=path,
        keyframes=keyframes,
        acc_sensor=recording.acc,
        a_nav=a_nav,
        gravity=tracking.gravity,
        resulting=np.linalg.norm(a_nav, axis=1),  # (7)
        variance=resulting_variance(a_nav),
        threshold=LAMBDA_V,
        paper_stops=path.stops if tracking.method == "paper" else paper_stops(recording.t, a_nav),
        rpy_nav_sensor=np.unwrap(quat_to_rpy(path.wxyz_nav_sensor), axis=0),
        sigma_p=sigma_p,
        sigma_turn=sigma_turn,
        interval_t=demo.recording.t[1:],
        interval_s=np.diff(demo.recording.t),
        field=field,
        truth=truth,
        facts=tuple(_facts(demo.recording, path, names, truth, field)),
        findings=find(path, names, a_nav, truth, remarks),
    )


def _sigma_along(path: HandPath) -> tuple[Array, Array]:
    """Sigma of position (n, 3) m and rotation (n, 3) rad: that of each stop, its square interpolated in between."""
    ends = path.t[[row for stop in path.stops for row in (stop.start, stop.stop - 1)]]
    variances = np.repeat(np.diagonal(path.cov, axis1=1, axis2=2), 2, axis=0)
    # A one-sample stop has both its ends at one instant, which np.interp takes.
    along = np.column_stack([np.interp(path.t, ends, v, left=np.nan, right=np.nan) for v in variances.T])
    sigma = np.sqrt(along)
    return sigma[:, :3], sigma[:, 3:]


def _truth(truth: Truth, path: HandPath) -> TruthPlot | None:
    """The truth, laid on the first stop; None where it doesn't say where that is."""
    rows = np.concatenate(([True], np.diff(truth.t) > 0.0))
    t, p, wxyz = truth.t[rows], truth.p_nav_sensor[rows], truth.wxyz_nav_sensor[rows]
    seen = np.isfinite(p).all(axis=1) & np.isfinite(wxyz).all(axis=1)
    first = (path.stops[0].start + path.stops[0].stop - 1) // 2
    away = np.where(seen, np.abs(t - path.t[first]), np.inf)
    if len(t) < 2 or away.min() > TRUTH_NEAR_S:
        return None
    row = int(np.argmin(away))
    turn = quat_about_z(yaw_toward(wxyz[row], path.wxyz_nav_sensor[first]))
    p = path.p_nav_sensor[first] + quat_rotate(turn, p - p[row])
    rpy = np.full_like(p, np.nan)
    rpy[seen] = np.unwrap(quat_to_rpy(quat_multiply(turn, wxyz[seen])), axis=0)
    ours = np.unwrap(quat_to_rpy(path.wxyz_nav_sensor), axis=0)[first]
    rpy += 2.0 * np.pi * np.round((ours - rpy[row]) / (2.0 * np.pi))
    at = np.column_stack([np.interp(path.t, t, axis, left=np.nan, right=np.nan) for axis in p.T])
    return TruthPlot(t, p, _slope(t, p), rpy, path.p_nav_sensor - at)


def _slope(t: Array, p: Array) -> Array:
    """Velocity (m, 3) m/s of positions (m, 3) m; NaN where the truth has a gap."""
    before, after = np.maximum(t - TRUTH_SPEED_S, t[0]), np.minimum(t + TRUTH_SPEED_S, t[-1])
    moved = [np.interp(after, t, axis) - np.interp(before, t, axis) for axis in p.T]
    slope: Array = np.column_stack(moved) / (after - before)[:, None]
    slope[~np.isfinite(p).all(axis=1)] = np.nan
    return slope


def _field(mag: Array, path: HandPath, first_rest: slice) -> FieldPlot:
    """Strength and dip, the latter with the path's attitude, and the tracker's own bounds."""
    field_nav = quat_rotate(path.wxyz_nav_sensor, mag)
    rest = field_nav[first_rest].mean(axis=0)
    strength = float(np.linalg.norm(rest))
    return FieldPlot(
        strength=np.linalg.norm(mag, axis=1),
        dip=_dip(field_nav),
        rest_strength=strength,
        rest_dip=float(_dip(rest[None])[0]),
        strength_bound=DISTURBED * strength,
        dip_bound=DISTURBED,
        block_s=2.0 * FIELD_S,
    )


def _dip(field_nav: Array) -> Array:
    x, y, z = field_nav.T
    dip: Array = np.arctan2(-z, np.hypot(x, y))
    return dip


def _facts(
    recording: Recording, path: HandPath, names: Sequence[str], truth: TruthPlot | None, field: FieldPlot | None
) -> list[tuple[str, str]]:
    """What a person asks first, in words."""
    t, stops = recording.t, path.stops
    inside = slice(stops[0].start, stops[-1].stop)
    travelled = float(np.linalg.norm(np.diff(path.p_nav_sensor[inside], axis=0), axis=1).sum())
    sigma = np.sqrt(path.cov[:, range(3), range(3)].max(axis=1))
    interval = np.diff(t)
    late = int((interval > LATE * np.median(interval)).sum())
    facts = [
        ("sensor", recording.info.sensor),
        ("recorded", f"{t[-1] - t[0]:.1f} s at {recording.rate_hz:.4g} Hz, {len(t)} samples"),
        ("late or lost samples", f"{late}, longest gap {1e3 * interval.max():.0f} ms" if late else "none"),
    ]
    dwells = [stop.dwell_s for stop in stops]
    shortest = int(np.argmin(dwells))
    facts.append(("stops", f"{len(stops)}, the shortest {dwells[shortest]:.2f} s, {at_stop(names[shortest])}"))
    if len(stops) > 1:
        moves = [path.t[b.start] - path.t[a.stop - 1] for a, b in pairwise(stops)]
        longest, drift = int(np.argmax(moves)), np.linalg.norm(path.closure, axis=1)
        worst = int(np.argmax(drift))
        facts += [
            ("longest move", f"{moves[longest]:.2f} s, {names[longest]} to {names[longest + 1]}"),
            ("length of the path", length(travelled)),
            ("largest closure", f"{length(float(drift[worst]))}/s, at {at_stop(names[worst + 1])}"),
            ("largest sigma", f"{length(float(sigma.max()))}, at {at_stop(names[int(np.argmax(sigma))])}"),
        ]
    if truth is not None:
        off = np.linalg.norm(truth.error[[(stop.start + stop.stop - 1) // 2 for stop in stops]], axis=1)
        if np.isfinite(off).any():
            worst = int(np.nanargmax(off))
            facts.append(("largest error", f"{length(float(off[worst]))}, at {at_stop(names[worst])}"))
    if field is not None:
        change = np.abs(field.strength / field.rest_strength - 1.0).max() if field.rest_strength > 0.0 else np.nan
        turned = np.degrees(np.abs(field.dip - field.rest_dip).max())
        facts.append(("magnetic field", f"{field.rest_strength:.0f} µT ± {100.0 * change:.0f} %, dip ± {turned:.1f}°"))
    if path.claims:
        facts.append(("known places", _counted(len(path.claims), "claim") + " used"))
    return facts


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
