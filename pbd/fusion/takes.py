"""Takes as each was tracked alone, and where their joint estimate begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.data import Calibration, Demonstration, HandPath, Keyframe
from pbd.errors import PbdError, TrackingError, collected_warnings, warn
from pbd.fusion.devices import devices_of
from pbd.fusion.joint_estimate import Parts, State
from pbd.fusion.marginals import Marginal, marginal_of
from pbd.fusion.matching import Alignment, Keyframes
from pbd.fusion.moved_things import Moved
from pbd.pipeline import track_alone
from pbd.tracking.estimate import Estimate
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.smoother.smooth import Solution


@dataclass(frozen=True, eq=False)
class Take:
    """A take as tracked alone."""

    name: str
    path: HandPath
    solution: Solution
    knots: tuple[int, ...]
    keyframes: tuple[Keyframe, ...]
    marginal: Marginal

    @property
    def device(self) -> tuple[str, float, float]:
        """What the takes of one device have in common: its name; the lag and scale that were taken out before."""
        assert self.path.tracking is not None
        return self.path.tracking.recording.info.sensor, self.solution.lag, self.solution.scale


def tracked_take(demo: Demonstration, calibration: Calibration | None, accept_gap: bool) -> Take:
    """Track a take alone; warnings and errors begin with its name."""
    name = demo.recording.info.name
    with collected_warnings() as told:
        try:
            path, found = track_alone(demo, "default", calibration, accept_gap)
        except PbdError as error:
            raise type(error)(f"{name}: {error.message}", **error.fields) from None
        keyframes = find_keyframes(path)
    for line in told:
        warn(f"{name}: {line}")
    assert found.solution is not None
    knots = _middles(found)
    return Take(name, path, found.solution, knots, keyframes, marginal_of(found.solution, knots))


def _middles(found: Estimate) -> tuple[int, ...]:
    """The knot in the middle of each stop."""
    assert found.solution is not None
    problem, knots = found.solution.problem, []
    for stop in found.stops:
        inside = np.flatnonzero((problem.rows >= stop.start) & (problem.rows < stop.stop) & (problem.stop_of >= 0))
        knots.append(int(inside[(len(inside) - 1) // 2]))
    return tuple(knots)


def keyframes_of_take(take: Take) -> Keyframes:
    """What is matched of a take."""
    marginal, n = take.marginal, len(take.knots)
    cov = marginal.cov.reshape(n, 6, n, 6)[np.arange(n), :3, np.arange(n), :3]
    sigma = np.sqrt(np.trace(cov, axis1=1, axis2=2) / 3.0)
    return Keyframes(marginal.p, marginal.R, tuple(one.grip for one in take.keyframes), sigma)


def refuse_strangers(takes: Sequence[Take], found: Alignment) -> None:
    """Refuse takes of which most do nothing in common.

    Raises:
        TrackingError: names two of them.
    """
    if 2 * len(found.registered) > len(takes) and len(found.registered) > 1:
        return
    reference = next(iter(found.registered))
    other = takes[found.strangers[0]]
    raise TrackingError(
        f"{takes[reference].name} ({len(takes[reference].knots)} stops) and {other.name} ({len(other.knots)} stops) "
        "are of different tasks: fewer than half of their keyframes match, or not the dock; fuse takes of one task"
    )


def start(takes: Sequence[Take], used: Sequence[int], found: Alignment, thing: Moved | None) -> tuple[Parts, State]:
    """What belongs together, and where to begin: all in the nav of the first take that is used."""
    kept, device = found.kept(), devices_of([takes[k].marginal for k in used], [takes[k].device for k in used])
    shown = [(i, j, one.own[k]) for i, k in enumerate(used) for j, one in enumerate(kept) if k in one.own]
    take, at, own = np.array(shown, dtype=np.intp).T
    frames, of_thing = [found.registered], np.zeros(len(kept), dtype=np.intp)
    if thing is not None:
        frames.append(found.registered | thing.back)
        of_thing[[thing.first <= one.own.get(thing.reference, -1) <= thing.last for one in kept]] = 1
    parts = Parts(tuple(takes[k].marginal for k in used), take, at, own, device, of_thing)
    back = [frame[used[0]].inverse() for frame in frames]
    here = [[one.after(frame[k]) for k in used] for one, frame in zip(back, frames, strict=True)]
    begun, j = [one.of(Keyframes.of_candidates(kept)) for one in back], np.arange(len(kept))
    return parts, State(
        np.array([one.p for one in begun])[of_thing, j],
        np.array([one.R for one in begun])[of_thing, j],
        np.array([[one.yaw for one in frame] for frame in here]),
        np.array([[one.c for one in frame] for frame in here]),
        np.array([one.Q for one in here[0]]),
        np.zeros((len(used), 3)),
        np.array([takes[used[device.index(d)]].marginal.device for d in range(max(device) + 1)]),
    )
