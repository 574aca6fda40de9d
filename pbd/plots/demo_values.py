"""Values for the plots of one demonstration."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.data import HandPath, Keyframe, Recording, Truth
from pbd.data.tracking import DOUBTED_WEIGHT, Tracking
from pbd.lazy import cached_property
from pbd.plots.findings import Finding, find_problems, length_text, stop_names, stop_phrase
from pbd.pose import Array, Pose, level_onto, quat_multiply, quat_rotate, quat_to_rpy
from pbd.tracking.keyframes import keyframes_of

TRUTH_SPEED_S = 0.02
"""Half the interval, s, of the differences that give the true velocity. Adjacent optical samples differ by noise."""


@dataclass(frozen=True, eq=False)
class TruthValues:
    """The true motion, aligned with the path at the first stop (position and heading, as the dock does it).

    Attributes:
        t: (m,) s.
        p_nav_sensor: (m, 3) m; NaN in a gap of the truth, as are velocity and attitude.
        v_nav_sensor: (m, 3) m/s, finite differences of the position.
        rpy_nav_sensor: (m, 3) rad, unwrapped.
        error: (n, 3) m, path minus truth at the path's instants; NaN where there is no truth.
    """

    t: Array
    p_nav_sensor: Array
    v_nav_sensor: Array
    rpy_nav_sensor: Array
    error: Array


@dataclass(frozen=True, eq=False)
class FieldValues:
    """The magnetic field.

    Attributes:
        strength: (n,) uT.
        dip: (n,) rad, positive downwards.
        rest_strength, rest_dip: strength and dip of the mean field in the first rest.
    """

    strength: Array
    dip: Array
    rest_strength: float
    rest_dip: float


@dataclass(frozen=True, eq=False)
class DemoValues:
    """Values that the figures of one tracked demonstration show; `facts`: names and values, in words."""

    path: HandPath
    tracking: Tracking
    keyframes: tuple[Keyframe, ...]
    truth: TruthValues | None
    field: FieldValues | None
    facts: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]

    @property
    def name(self) -> str:
        """The demonstration's name."""
        return self.tracking.demo.recording.info.name

    @cached_property
    def resulting(self) -> Array:
        """(n,) m/s2, the resulting acceleration: norm of the motion acceleration (the paper's equation 7)."""
        return np.asarray(np.linalg.norm(self.tracking.a_nav, axis=1))

    @cached_property
    def rpy_nav_sensor(self) -> Array:
        """(n, 3) rad, unwrapped."""
        return np.unwrap(quat_to_rpy(self.path.wxyz_nav_sensor), axis=0)

    @cached_property
    def sigma(self) -> Array:
        """(n, 6) m and rad, sigma along and about nav's axes, interpolated between stops; NaN outside."""
        ends = np.ravel(self.path.rests)
        variances = np.repeat(np.diagonal(self.path.cov, axis1=1, axis2=2), 2, axis=0)
        along = [np.interp(self.path.t, ends, v, left=np.nan, right=np.nan) for v in variances.T]
        return np.asarray(np.sqrt(np.column_stack(along)))

    def is_known(self, keyframe: Keyframe) -> bool:
        """Whether its stop had a known place or height (a claim)."""
        return self.path.stop_at(keyframe.t) in {claim.stop for claim in self.path.claims}

    def is_doubted(self, keyframe: Keyframe) -> bool:
        """Whether the tracker doubts that the hand stood still."""
        k = self.path.stop_at(keyframe.t)
        return k is not None and self.path.stops[k].weight < DOUBTED_WEIGHT


def demo_values(path: HandPath, remarks: Sequence[str] = ()) -> DemoValues:
    """Collect the values that the figures of a demonstration show.

    Args:
        path: with its `tracking`, which has the demonstration, its truth and its edited keyframes.
        remarks: warnings given while it was tracked; they become findings.

    Raises:
        ValueError: the path was not tracked.
    """
    tracking = path.tracking
    if tracking is None:
        raise ValueError("the path was not tracked, so there is no recording to plot; give what pbd.track returns")
    demo, mag, keyframes = tracking.demo, tracking.recording.mag, keyframes_of(path)
    truth = None if demo.truth is None else _truth(demo.truth, path)
    field = None if mag is None else _field(mag, path, slice(*tracking.rest))
    names = stop_names(path, keyframes)
    error = None if truth is None else truth.error
    facts = tuple(_facts(demo.recording, path, names, error, field))
    return DemoValues(
        path, tracking, keyframes, truth, field, facts, find_problems(path, names, tracking.a_nav, error, remarks)
    )


def _truth(truth: Truth, path: HandPath) -> TruthValues | None:
    """Align the truth with the path at the first stop; None if the truth has no sample near it."""
    rows = np.concatenate(([True], np.diff(truth.t) > 0.0))
    t, p, wxyz = truth.t[rows], truth.p_nav_sensor[rows], truth.wxyz_nav_sensor[rows]
    known = np.isfinite(p).all(axis=1) & np.isfinite(wxyz).all(axis=1)
    first = path.stops[0].middle
    away = np.where(known, np.abs(t - path.t[first]), np.inf)
    if len(t) < 2 or away.min() > 0.5:  # s
        return None
    row = int(np.argmin(away))
    T = level_onto(Pose(p[row], wxyz[row]), Pose(path.p_nav_sensor[first], path.wxyz_nav_sensor[first]))
    p = T.act(p)
    rpy = np.full_like(p, np.nan)
    rpy[known] = np.unwrap(quat_to_rpy(quat_multiply(T.wxyz, wxyz[known])), axis=0)
    ours = np.unwrap(quat_to_rpy(path.wxyz_nav_sensor), axis=0)[first]
    rpy += 2.0 * np.pi * np.round((ours - rpy[row]) / (2.0 * np.pi))
    at = np.column_stack([np.interp(path.t, t, axis, left=np.nan, right=np.nan) for axis in p.T])
    return TruthValues(t, p, _velocity(t, p), rpy, path.p_nav_sensor - at)


def _velocity(t: Array, p: Array) -> Array:
    """Velocity (m, 3) m/s of positions (m, 3) m; NaN in a gap of the truth."""
    before, after = np.maximum(t - TRUTH_SPEED_S, t[0]), np.minimum(t + TRUTH_SPEED_S, t[-1])
    moved = [np.interp(after, t, axis) - np.interp(before, t, axis) for axis in p.T]
    v: Array = np.column_stack(moved) / (after - before)[:, None]
    v[~np.isfinite(p).all(axis=1)] = np.nan
    return v


def _field(mag: Array, path: HandPath, first_rest: slice) -> FieldValues:
    field_nav = quat_rotate(path.wxyz_nav_sensor, mag)
    rest = field_nav[first_rest].mean(axis=0)
    return FieldValues(
        np.linalg.norm(mag, axis=1), _dip(field_nav), float(np.linalg.norm(rest)), float(_dip(rest[None])[0])
    )


def _dip(field_nav: Array) -> Array:
    """Angle (n,) rad of the field (n, 3) below the horizontal."""
    x, y, z = field_nav.T
    return np.asarray(np.arctan2(-z, np.hypot(x, y)))


def _facts(
    recording: Recording, path: HandPath, names: Sequence[str], error: Array | None, field: FieldValues | None
) -> list[tuple[str, str]]:
    """Names and values for the summary, in words."""
    t, stops = recording.t, path.stops
    interval = np.diff(t)
    late = int((interval > 1.5 * np.median(interval)).sum())
    shortest, dwell = _largest([-stop.dwell_s for stop in stops])
    facts = [
        ("sensor", recording.info.sensor),
        ("recorded", f"{t[-1] - t[0]:.1f} s at {recording.rate_hz:.4g} Hz, {len(t)} samples"),
        ("late or lost samples", f"in {late} intervals, up to {1e3 * interval.max():.0f} ms" if late else "none"),
        ("stops", f"{len(stops)}, the shortest {-dwell:.2f} s, {stop_phrase(names[shortest])}"),
    ]
    if len(stops) > 1:
        inside = path.p_nav_sensor[path.demonstrated]
        longest, duration = _largest([begin - end for (_, end), (begin, _) in pairwise(path.rests)])
        worst, residual = _largest(np.linalg.norm(path.closure, axis=1))
        unsure, variance = _largest(path.cov[:, range(3), range(3)].max(axis=1))
        facts += [
            ("longest move", f"{duration:.2f} s, {names[longest]} to {names[longest + 1]}"),
            ("length of the path", length_text(float(np.linalg.norm(np.diff(inside, axis=0), axis=1).sum()))),
            ("largest closure", f"{length_text(residual)}/s, at {stop_phrase(names[worst + 1])}"),
            ("largest sigma", f"{length_text(variance**0.5)}, at {stop_phrase(names[unsure])}"),
        ]
    if error is not None and len(stops) > 1:  # the first stop is where the error is zero
        off = np.linalg.norm(error[[stop.middle for stop in stops]], axis=1)
        if np.isfinite(off).any():
            worst, largest = _largest(off)
            facts.append(("largest error", f"{length_text(largest)}, at {stop_phrase(names[worst])}"))
    if field is not None:
        change = np.abs(field.strength / field.rest_strength - 1.0).max() if field.rest_strength > 0.0 else np.nan
        dip = np.degrees(np.abs(field.dip - field.rest_dip).max())
        facts.append(("magnetic field", f"{field.rest_strength:.0f} µT ± {100.0 * change:.0f} %, dip ± {dip:.1f}°"))
    if count := len(path.claims):
        facts.append(("known places", f"{count} claim{'' if count == 1 else 's'} used"))
    return facts


def _largest(values: Sequence[float] | Array) -> tuple[int, float]:
    """Index and value of the largest, NaN ignored."""
    index = int(np.nanargmax(values))
    return index, float(values[index])
