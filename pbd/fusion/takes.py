"""Takes as each was tracked alone, and where their joint estimate begins."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pbd.data import Calibration, Demonstration, HandPath, Keyframe
from pbd.errors import PbdError, TrackingError, warn
from pbd.fusion.devices import devices_of
from pbd.fusion.joint_estimate import Parts, State
from pbd.fusion.marginals import Marginal, marginal_of
from pbd.fusion.matching import Alignment, Candidate, Keyframes
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
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            path, found = track_alone(demo, "default", calibration, accept_gap)
        except PbdError as error:
            raise type(error)(f"{name}: {error.message}", **error.fields) from None
        keyframes = find_keyframes(path)
    for warning in told:
        warn(f"{name}: {warning.message}")
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
    kept, registered = found.kept(), found.registered
    of_thing = _of_thing(kept, thing)
    device = devices_of([takes[k].marginal for k in used], [takes[k].device for k in used])
    parts = Parts(
        tuple(takes[k].marginal for k in used),
        tuple(np.array([j for j, one in enumerate(kept) if k in one.own]) for k in used),
        tuple(np.array([one.own[k] for one in kept if k in one.own]) for k in used),
        device,
        of_thing,
    )
    back = registered[used[0]].inverse()
    here = [back.after(registered[k]) for k in used]
    frames = [[one.yaw for one in here]], [[one.c for one in here]]
    begun = back.of(_keyframes(kept))
    if thing is not None:
        back = thing.back.get(used[0], registered[used[0]]).inverse()
        there = [back.after(thing.back.get(k, registered[k])) for k in used]
        frames = ([*frames[0], [one.yaw for one in there]], [*frames[1], [one.c for one in there]])
        own = back.of(_keyframes(kept))
        begun = replace(
            begun,
            p=np.where(of_thing[:, None] > 0, own.p, begun.p),
            R=np.where(of_thing[:, None, None] > 0, own.R, begun.R),
        )
    errors = np.array([takes[used[device.index(d)]].marginal.device for d in range(max(device) + 1)])
    Q = np.array([one.Q for one in here])
    return parts, State(begun.p, begun.R, np.array(frames[0]), np.array(frames[1]), Q, np.zeros((len(used), 3)), errors)


def _keyframes(kept: Sequence[Candidate]) -> Keyframes:
    p, R = np.array([one.p for one in kept]), np.array([one.R for one in kept])
    return Keyframes(p, R, (None,) * len(kept), np.zeros(len(kept)))


def _of_thing(kept: Sequence[Candidate], thing: Moved | None) -> NDArray[np.intp]:
    """For each of the task's keyframes the frame it is in: 0, or 1 for the thing's."""
    at = [-1 if thing is None else one.own.get(thing.reference, -1) for one in kept]
    return np.array([int(thing is not None and thing.first <= i <= thing.last) for i in at], dtype=np.intp)
