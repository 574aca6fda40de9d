"""Hands that work between two stops, simulated: python tests/benchmarks/work.py [--json] [--quick].

At each of three places the hand rests for a second, works (wipes, stirs, writes and so on) for about five, and rests
again. Thirty recordings of each work (three sensors, ten seeds), by the tracker and live: how many are silently wrong,
as in the fault matrix, or warned of; how many stops lie in the work, and how many of the 210 rests have none; the error
of all keyframes but the first, cm.
"""

import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from numpy.typing import ArrayLike

from pbd.data import Keyframe, Recording
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array, lengths, quat_exp, quat_inverse, quat_multiply, quat_rotate
from pbd.simulation.hand_motion import HandMotion, HandState, Waypoint
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.online.tracker import DataFlaw
from tests.benchmarks.report import arguments, finish
from tests.scenarios import truth_at
from tests.tracking.damage import truth_of
from tests.tracking.fault_matrix import SIGMAS, WRONG_M
from tests.tracking.fed_tracker import fed

X, Y, Z = np.eye(3)
Swing = tuple[Array, float, float]
"""A harmonic: its amplitude (3,), m or rad, frequency, Hz, and phase at the beginning, in turns."""

WORK: dict[str, tuple[tuple[Swing, ...], Swing | None]] = {
    "wipe": (((0.12 * X, 0.8, 0.0), (0.03 * Y, 0.1, 0.0)), None),
    "stir": (((0.04 * X, 1.5, 0.0), (0.04 * Y, 1.5, 0.25)), None),
    "saw": (((0.1 * X, 2.0, 0.0), (0.005 * Z, 2.0, 0.0)), None),
    "screw": (((0.005 * X, 1.0, 0.0), (0.01 * Z, 0.5, 0.0)), (np.radians(60.0) * X, 1.0, 0.0)),
    "hammer": (((0.05 * X + 0.08 * Z, 1.5, 0.0), (0.03 * Z, 3.0, 0.0)), (np.radians(25.0) * Y, 1.5, 0.0)),
    "shake": (((0.08 * Z, 4.0, 0.0), (0.03 * X, 1.0, 0.0)), (np.radians(20.0) * Y, 4.0, 0.0)),
    "write": (((0.012 * X, 3.0, 0.0), (0.008 * Y, 2.1, 0.0)), (np.radians(4.0) * Y, 3.0, 0.0)),
    "spray": (((0.15 * X, 0.2, 0.0), (0.05 * Z, 0.1, 0.0)), (np.radians(15.0) * Z, 0.2, 0.0)),
    "draw a slow circle": (((0.1 * X, 1.0 / 6.0, 0.0), (0.1 * Y, 1.0 / 6.0, 0.25)), None),
    "adjust": (((0.004 * X, 0.7, 0.0), (0.004 * Y, 0.45, 0.0)), (np.radians(1.0) * Y, 0.6, 0.0)),
    "adjust slowly": (((0.02 * X, 0.3, 0.0), (0.015 * Y, 0.2, 0.0)), (np.radians(5.0) * X, 0.25, 0.0)),
}

SENSORS = ("modern", "wt901", "os5000")


@dataclass(frozen=True)
class Worked(Task):
    """A task with work in some spans, s, in which its hand would rest."""

    work: str = ""
    spans: tuple[tuple[float, float], ...] = ()

    @property
    def motion(self) -> HandMotion:
        """Rests, moves and work."""
        return Working(self)

    @property
    def rests(self) -> list[tuple[float, float]]:
        """Begin and end of each rest, s."""
        ends = np.cumsum([w.move_s + w.rest_s for w in self.waypoints])
        return [(end - w.rest_s, end) for end, w in zip(ends, self.waypoints, strict=True)]


class Working(HandMotion):
    """The motion of a `Worked` task. The work's amplitude rises and falls as the square of a sine over its span."""

    def __init__(self, task: Worked) -> None:
        super().__init__(task.waypoints, task.start_rpy)
        self._shifts, self._turn_swing = WORK[task.work]
        self._spans = task.spans

    @property
    def knots(self) -> Array:
        return np.union1d(super().knots, np.ravel(self._spans))

    def at(self, t: ArrayLike) -> HandState:
        t = np.asarray(t, dtype=np.float64)
        hand = super().at(t)
        p, v, a = sum(self._swung(t, swing) for swing in self._shifts) + np.array((hand.p, hand.v, hand.a))
        if self._turn_swing is None:
            return HandState(p, v, a, hand.wxyz, hand.w)
        angle, rate, _ = self._swung(t, self._turn_swing)
        turn = quat_exp(angle)
        return HandState(p, v, a, quat_multiply(hand.wxyz, turn), quat_rotate(quat_inverse(turn), hand.w) + rate)

    def _swung(self, t: Array, swing: Swing) -> Array:
        """A swing at instants (n,) and its two derivatives, (3, n, 3)."""
        amplitude, hz, phase = swing
        found = np.zeros((3, len(t)))
        for begin, end in self._spans:
            inside, beat = (t > begin) & (t < end), 1.0 / (end - begin)
            for weight, omega in ((0.5, hz), (-0.25, hz + beat), (-0.25, hz - beat)):
                omega *= 2.0 * np.pi
                angle = omega * (t - begin) + 2.0 * np.pi * phase
                found += inside * weight * [omega**k * np.sin(angle + 0.5 * np.pi * k) for k in range(3)]
        return found[..., None] * amplitude


def task_of(work: str, seed: int) -> Worked:
    """Three times: a move, a rest, work at that place, a rest."""
    rng, p, end = np.random.default_rng(seed), np.zeros(3), 2.0
    waypoints, spans = [Waypoint(rest_s=end)], []
    for _ in range(3):
        p = p + rng.uniform(-0.25, 0.25, 3)
        x, y, z = p.tolist()
        turn, move_s, work_s = rng.normal(0.0, 0.25), rng.uniform(0.8, 1.4), rng.uniform(4.0, 6.0)
        waypoints += [
            Waypoint((x, y, z), (turn, turn, turn), move_s, rest_s=1.0),
            Waypoint((x, y, z), move_s=work_s, rest_s=1.0),
        ]
        spans.append((end + move_s + 1.0, end + move_s + 1.0 + work_s))
        end = spans[-1][1] + 1.0
    return Worked(work, tuple(waypoints), work=work, spans=tuple(spans))


def main() -> None:
    """Simulate, track, print."""
    args = arguments(str(__doc__)).parse_args()
    cases = [(seed, sensor) for seed in range(1 if args.quick else 10) for sensor in SENSORS]
    finish(
        {work: figures_of([(task_of(work, seed), sensor, seed) for seed, sensor in cases]) for work in WORK}, args.json
    )


def figures_of(cases: Sequence[tuple[Worked, str, int]]) -> dict[str, dict[str, float]]:
    """What comes of tasks, by the tracker and live."""
    demos = [simulate(*case) for case in cases]
    found: dict[str, dict[str, float]] = {}
    for name, keyframes_of in (("batch", batch), ("live", live)):
        counts, off = np.zeros(4, dtype=int), []
        for (task, *_), demo in zip(cases, demos, strict=True):
            keyframes, said = keyframes_of(demo.recording)
            p = [keyframe.T_nav_sensor.p - truth_at(truth_of(demo), keyframe.t) for keyframe in keyframes]
            error, sigma = lengths(np.array(p)), np.sqrt([np.trace(keyframe.cov[:3, :3]) for keyframe in keyframes])
            t, dwell_s = np.array([(keyframe.t, keyframe.dwell_s) for keyframe in keyframes]).T
            begin, end = np.array(task.rests).T[..., None]
            at_rest = (t + 0.5 * dwell_s > begin) & (t - 0.5 * dwell_s < end)  # (rests, keyframes)
            false, missed = (int((~at_rest.any(axis=axis)).sum()) for axis in (0, 1))
            wrong = bool(np.any((error > WRONG_M) & (error > SIGMAS * sigma)))
            counts += wrong and not said, bool(said), false, missed
            off += (100.0 * error[1:]).tolist()
        names = ("silently_wrong", "warned", "stops_in_work", "rests_missed")
        figures = dict(zip(names, counts.tolist(), strict=True))
        found[name] = figures | {"cm_median": float(np.median(off)), "cm_p95": float(np.percentile(off, 95))}
    return found


def batch(recording: Recording) -> tuple[Sequence[Keyframe], bool]:
    """The keyframes of the tracker, and whether it warned."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PbdWarning)
        return find_keyframes(track(recording)), bool(caught)


def live(recording: Recording) -> tuple[Sequence[Keyframe], bool]:
    """The keyframes of the live tracker, and whether it told of wrong data."""
    tracker, events = fed(recording)
    return tracker.keyframes, any(isinstance(event, DataFlaw) for event in events)


if __name__ == "__main__":
    main()
