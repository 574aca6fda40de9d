"""What plots show: frozen values, made by pbd.plotting, drawn by the other plot_*.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.data import HandPath, Keyframe, Stop
from pbd.data.freeze import freeze
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class TruthPlot:
    """The true motion, laid on the path's first stop (position and heading), as the dock does it.

    Attributes:
        t: (m,) s.
        p_nav_sensor: (m, 3) m; NaN where the truth has a gap, as in the two below.
        v_nav_sensor: (m, 3) m/s, differences of the position.
        rpy_nav_sensor: (m, 3) rad, without jumps of a whole turn.
        error: (n, 3) m, path less truth at the path's instants; NaN outside the truth.
    """

    t: Array
    p_nav_sensor: Array
    v_nav_sensor: Array
    rpy_nav_sensor: Array
    error: Array

    def __post_init__(self) -> None:
        m = len(self.t)
        freeze(self, t=(m,), p_nav_sensor=(m, 3), v_nav_sensor=(m, 3), rpy_nav_sensor=(m, 3), error=(None, 3))


@dataclass(frozen=True, eq=False)
class FieldPlot:
    """The magnetic field.

    Attributes:
        strength: (n,) uT.
        dip: (n,) rad, downwards.
        rest_strength, rest_dip: the same at the first rest.
        strength_bound, dip_bound: by how much it may differ, uT and rad; beyond, the tracker takes it for disturbed.
        block_s: s, over which the tracker averages it for that.
    """

    strength: Array
    dip: Array
    rest_strength: float
    rest_dip: float
    strength_bound: float
    dip_bound: float
    block_s: float

    def __post_init__(self) -> None:
        n = len(self.strength)
        freeze(self, strength=(n,), dip=(n,))


Span = tuple[float, float]
"""From when to when, s."""


@dataclass(frozen=True)
class Finding:
    """What a person should look at: in words, and when, where it has a place in time."""

    words: str
    spans: tuple[Span, ...] = ()


@dataclass(frozen=True, eq=False)
class DemoPlot:
    """One demonstration, tracked.

    Attributes:
        name: the demonstration's.
        method: how it was tracked.
        sensor: what recorded it.
        path: the tracker's.
        keyframes: with their covariances.
        acc_sensor: (n, 3) m/s2, specific force in sensor axes.
        a_nav: (n, 3) m/s2, motion acceleration: specific force in nav less gravity.
        gravity: m/s2, the norm of specific force at rest.
        resulting: (n,) m/s2, the paper's equation 7: the norm of `a_nav`.
        variance: (n,) (m/s2)^2, the paper's equations 8 and 9.
        threshold: (m/s2)^2, the paper's lambda_v.
        paper_stops: where the paper's Algorithm 1 sees the hand stand still.
        rpy_nav_sensor: (n, 3) rad, without jumps of a whole turn.
        sigma_p: (n, 3) m along nav's axes, its square interpolated between the stops; NaN before the first and after
            the last one.
        sigma_turn: (n, 3) rad about nav's axes, likewise.
        interval_t, interval_s: (n - 1,) s, when a sample came and how long after the one before it, as recorded.
        field: with a magnetometer.
        truth: where it is known.
        facts: (what, how much) in words, for the summary.
        findings: what a person should look at.
    """

    name: str
    method: str
    sensor: str
    path: HandPath
    keyframes: tuple[Keyframe, ...]
    acc_sensor: Array
    a_nav: Array
    gravity: float
    resulting: Array
    variance: Array
    threshold: float
    paper_stops: tuple[Stop, ...]
    rpy_nav_sensor: Array
    sigma_p: Array
    sigma_turn: Array
    interval_t: Array
    interval_s: Array
    field: FieldPlot | None = None
    truth: TruthPlot | None = None
    facts: tuple[tuple[str, str], ...] = ()
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.path.t)
        freeze(self, acc_sensor=(n, 3), a_nav=(n, 3), resulting=(n,), variance=(n,), rpy_nav_sensor=(n, 3))
        freeze(self, sigma_p=(n, 3), sigma_turn=(n, 3), interval_t=(n - 1,), interval_s=(n - 1,))

    @property
    def tracked(self) -> slice:
        """The samples from the first stop to the last one: what is before and after has one known end only."""
        return slice(self.path.stops[0].start, self.path.stops[-1].stop)

    def is_known(self, t: float) -> bool:
        """Whether something was known of the stop at t s, and used."""
        stops = (self.path.stops[claim.stop] for claim in self.path.claims)
        return any(self.path.t[stop.start] <= t <= self.path.t[stop.stop - 1] for stop in stops)


@dataclass(frozen=True, eq=False)
class RunPlot:
    """One of several demonstrations of a task, turned and shifted so that its first stop lies on that of the others.

    Attributes:
        name: the demonstration's.
        p: (n, 3) m, its path from the first to the last stop, in the first demonstration's nav.
        progress: (n,) keyframes of the task: 1.5 is half-way in time from keyframe 1 to keyframe 2.
    """

    name: str
    p: Array
    progress: Array

    def __post_init__(self) -> None:
        n = len(self.p)
        freeze(self, p=(n, 3), progress=(n,))


@dataclass(frozen=True, eq=False)
class SpreadKeyframe:
    """One keyframe of a task, as several demonstrations have it.

    Attributes:
        poses: of each demonstration, aligned; None where it has none.
        own: its number in each demonstration; None likewise.
        p: (3,) m, the mean.
        spread: (3,) m, standard deviation over the demonstrations along nav's axes; NaN for a single one.
        furthest: index of the demonstration that is furthest from the mean.
        furthest_m: how far.
        turn: rad, standard deviation of the attitude (root mean square angle from the mean one); NaN for a single one.
        sigma: (3,) m, what the trackers' own sigmas make expect, relative to the first stop (root mean square).
    """

    poses: tuple[Pose | None, ...]
    own: tuple[int | None, ...]
    p: Array
    spread: Array
    furthest: int
    furthest_m: float
    turn: float
    sigma: Array

    def __post_init__(self) -> None:
        freeze(self, p=(3,), spread=(3,), sigma=(3,))

    @property
    def count(self) -> int:
        """How many demonstrations have it."""
        return sum(pose is not None for pose in self.poses)


@dataclass(frozen=True, eq=False)
class ComparePlot:
    """Several demonstrations of one task.

    Attributes:
        runs: in the order in which they were named.
        keyframes: of the task.
        by_order: whether keyframes were matched by their order alone; else by place, in order.
        remarks: which keyframes are missing where, or are there in one alone, in words.
    """

    runs: tuple[RunPlot, ...]
    keyframes: tuple[SpreadKeyframe, ...]
    by_order: bool
    remarks: tuple[str, ...] = ()

    def positions(self, run: int) -> Array:
        """Where a run has the task's keyframes, (k, 3) m; NaN where it has none."""
        poses = (keyframe.poses[run] for keyframe in self.keyframes)
        return np.array([np.full(3, np.nan) if pose is None else pose.p for pose in poses])
