"""Compare several demonstrations of one task: align them, match their keyframes, compute the spread."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

from pbd.data import HandPath, Keyframe
from pbd.errors import in_degrees, listed
from pbd.fusion.matching import MATCH_M, Keyframes, align_takes, match_by_moves
from pbd.fusion.tables import ALIKE_RAD
from pbd.pose import Array, Pose, level_onto, matrix_log, quat_inverse, quat_log, quat_multiply, quat_to_matrix
from pbd.tracking.smoother.attitude import mean_quaternion
from pbd.view.terminal_tables import make_table
from pbd.view.units import Units

Tracked = tuple[str, HandPath, Sequence[Keyframe]]
"""A demonstration's name, its path and its keyframes."""


@dataclass(frozen=True, eq=False)
class AlignedDemo:
    """One of several demonstrations of a task, aligned with the first demonstration at the first stop.

    Attributes:
        p: (n, 3) m, its path from the first to the last stop, in the first demonstration's nav.
        progress: (n,) in keyframes of the task: 1.5 is half-way in time from keyframe 1 to keyframe 2.
    """

    name: str
    p: Array
    progress: Array


@dataclass(frozen=True, eq=False)
class SpreadKeyframe:
    """One keyframe of a task in several demonstrations.

    Attributes:
        poses: its pose in each demonstration, aligned; None where it is missing.
        own: its number in each demonstration; None where it is missing.
        p: (3,) m, mean position.
        spread: (3,) m, standard deviation of the position along nav's axes; NaN for a single demonstration.
        furthest, furthest_m: index of the demonstration that is furthest from the mean, and its distance, m.
        turn: rad, standard deviation of the attitude (rms angle from the mean); NaN for a single demonstration.
        sigma: (3,) m, rms of the trackers' sigmas relative to the first stop; NaN if a person typed all keyframes.
    """

    poses: tuple[Pose | None, ...]
    own: tuple[int | None, ...]
    p: Array
    spread: Array
    furthest: int
    furthest_m: float
    turn: float
    sigma: Array

    @property
    def count(self) -> int:
        """Number of demonstrations that have it."""
        return sum(pose is not None for pose in self.poses)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Several demonstrations of one task.

    Attributes:
        by_order: whether keyframes were matched by their order only; else by the moves between them and the grip.
        remarks: which keyframes are missing in a demonstration, or are only in one, and in which the sensor was turned
            in the hand, in words.
    """

    demos: tuple[AlignedDemo, ...]
    keyframes: tuple[SpreadKeyframe, ...]
    by_order: bool
    remarks: tuple[str, ...] = ()

    def positions(self, demo: int) -> Array:
        """Positions of a demonstration's keyframes, (k, 3) m; NaN where one is missing."""
        poses = (keyframe.poses[demo] for keyframe in self.keyframes)
        return np.array([np.full(3, np.nan) if pose is None else pose.p for pose in poses])


def compare(demos: Sequence[Tracked]) -> Comparison:
    """Align demonstrations at their first stop (position and heading, as the dock does it) and match their keyframes.

    The common nav is the first demonstration's. If all have the same number of keyframes, these are matched by order.
    Else they are matched by moves and grips, as in `pbd fuse`, with the first demonstration that has the most frequent
    number of keyframes.

    Args:
        demos: two or more, each with one keyframe at least.
    """
    first = demos[0][2][0].T_nav_sensor
    aligned = [level_onto(keyframes[0].T_nav_sensor, first) for _, _, keyframes in demos]
    poses, covs = [], []
    for T_first_nav, (_, _, keyframes) in zip(aligned, demos, strict=True):
        R = quat_to_matrix(T_first_nav.wxyz)
        poses.append([T_first_nav @ keyframe.T_nav_sensor for keyframe in keyframes])
        covs.append([R @ keyframe.cov[:3, :3] @ R.T for keyframe in keyframes])
    counts = [len(own) for own in poses]
    usual = Counter(counts)
    reference = counts.index(max(counts, key=lambda count: (usual[count], count)))
    comparable = [
        Keyframes(
            np.array([one.T_nav_sensor.p for one in keyframes]),
            quat_to_matrix(np.array([one.T_nav_sensor.wxyz for one in keyframes])),
            tuple(one.grip for one in keyframes),
            np.zeros(len(keyframes)),
        )
        for _, _, keyframes in demos
    ]
    partners = []
    for own in comparable:
        by_order = len(own) == counts[reference]
        pairs = enumerate(range(len(own))) if by_order else match_by_moves(comparable[reference], own)
        partners.append([*map(dict(pairs).get, range(counts[reference]))])
    shown = tuple(_aligned(*demo, T, partner) for demo, T, partner in zip(demos, aligned, partners, strict=True))
    spreads = [_spread([partner[k] for partner in partners], poses, covs) for k in range(counts[reference])]
    remarks = [*_remarks(demos, partners, reference), *_turned(demos, comparable)]
    return Comparison(shown, tuple(spreads), len(usual) == 1, tuple(remarks))


def _aligned(
    name: str, path: HandPath, keyframes: Sequence[Keyframe], T_first_nav: Pose, partner: Sequence[int | None]
) -> AlignedDemo:
    t, number = list[float](), list[int]()
    for k, own in enumerate(partner):
        if own is not None:
            t += path.rest_at(keyframes[own].t)
            number += [k, k]
    progress = np.interp(path.t[path.demonstrated], t, number, left=np.nan, right=np.nan)
    return AlignedDemo(name, T_first_nav.act(path.p_nav_sensor[path.demonstrated]), progress)


def _spread(
    own: Sequence[int | None], poses: Sequence[Sequence[Pose]], covs: Sequence[Sequence[Array]]
) -> SpreadKeyframe:
    present = [(demo, i) for demo, i in enumerate(own) if i is not None]
    p = np.array([poses[demo][i].p for demo, i in present])
    wxyz = np.array([poses[demo][i].wxyz for demo, i in present])
    away = np.linalg.norm(p - p.mean(axis=0), axis=1)
    angles = np.linalg.norm(quat_log(quat_multiply(quat_inverse(mean_quaternion(wxyz)), wxyz)), axis=1)
    several = len(present) > 1
    measured = [np.diagonal(covs[demo][i]) for demo, i in present if i == 0 or covs[demo][i].any()]
    return SpreadKeyframe(
        poses=tuple(None if i is None else poses[demo][i] for demo, i in enumerate(own)),
        own=tuple(own),
        p=p.mean(axis=0),
        spread=p.std(axis=0, ddof=1) if several else np.full(3, np.nan),
        furthest=present[int(np.argmax(away))][0],
        furthest_m=float(away.max()),
        turn=float(np.sqrt((angles**2).sum() / (len(present) - 1))) if several else float("nan"),
        sigma=np.sqrt(np.mean(measured, axis=0)) if measured else np.full(3, np.nan),
    )


def _remarks(demos: Sequence[Tracked], partners: Sequence[Sequence[int | None]], reference: int) -> list[str]:
    """Say which keyframes are missing in a demonstration, or are only in one."""
    usual, _, others = demos[reference]
    remarks = []
    for (name, _, keyframes), partner in zip(demos, partners, strict=True):
        missing = [f"{k} ({others[k].t:.1f} s in {usual})" for k, own in enumerate(partner) if own is None]
        more = [f"{i} ({keyframe.t:.1f} s)" for i, keyframe in enumerate(keyframes) if i not in partner]
        if missing:
            remarks.append(f"{name} has no keyframe{'s' * (len(missing) > 1)} {', '.join(missing)}")
        if more:
            many, s = ("one more stop", "") if len(more) == 1 else (f"{len(more)} more stops", "s")
            remarks.append(f"{name} has {many}, its keyframe{s} {', '.join(more)}: left out")
    return remarks


def _turned(demos: Sequence[Tracked], comparable: Sequence[Keyframes]) -> list[str]:
    """Say in which demonstrations the sensor was turned in the hand, where a move aside shows that."""
    turned = [
        f"{demos[k][0]} by {in_degrees(turn)}"
        for k, one in align_takes(comparable).registered.items()
        if (turn := float(np.linalg.norm(matrix_log(one.Q)))) > ALIKE_RAD
        and np.ptp(comparable[k].p[:, :2], axis=0).max() > MATCH_M
    ]
    compares = "each seems to go elsewhere; `pbd fuse --plot` compares such takes"
    return [f"the sensor was turned in the hand: {listed(turned)}; {compares}"] if turned else []


# --- for the terminal and for programs ---


def spread_table(comparison: Comparison, units: Units) -> Table:
    """At each keyframe: mean position, standard deviations, furthest demonstration. Unknown values are blank."""
    m, deg = units.length, units.angle_sign
    positions, spreads = ([f"{what}{axis} ({m})" for axis in "xyz"] for what in ("", "spread "))
    ends = (f"spread ({deg})", f"σ ({m})", f"furthest ({m})", "which")
    columns = ("#", f"in (of {len(comparison.demos)})", *positions, *spreads, *ends)
    rows = []
    for number, keyframe in enumerate(comparison.keyframes):
        off = keyframe.count > 1 and keyframe.furthest_m > 0.0
        near = *units.lengths(keyframe.p), *units.lengths(keyframe.spread, finer=1), *units.angles(keyframe.turn)
        sigma, furthest = units.lengths((keyframe.sigma.max(), keyframe.furthest_m), finer=1)
        far = (furthest, comparison.demos[keyframe.furthest].name) if off else ("", "")
        rows.append((str(number), str(keyframe.count), *near, sigma, *far))
    return make_table(*columns, left=("which",), rows=rows)


def spread_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """The same for `--json`; unknown values are NaN."""
    return [
        {
            "index": number,
            "keyframes": list(keyframe.own),
            "position_m": keyframe.p.tolist(),
            "spread_m": keyframe.spread.tolist(),
            "spread_deg": float(np.degrees(keyframe.turn)),
            "sigma_m": keyframe.sigma.tolist(),
            "furthest": comparison.demos[keyframe.furthest].name,
            "furthest_m": keyframe.furthest_m,
        }
        for number, keyframe in enumerate(comparison.keyframes)
    ]
