"""Track each take alone, and make the observations and the initial state of the joint estimate from them."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from pbd.data import Calibration, Demonstration, HandPath, Keyframe
from pbd.errors import TrackingError, naming
from pbd.fusion.joint_estimate import Observations, TaskState
from pbd.fusion.marginals import DEVICE_ERRORS, Marginal, marginal_of
from pbd.fusion.matching import Alignment, Keyframes, align_takes
from pbd.fusion.moved_things import MovedKeyframes
from pbd.track_recording import track_recording
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.smoother.smooth import Solution

ANOTHER_DEVICE = 5.0 * DEVICE_ERRORS
"""Chi-square between the sensor errors of a take and of a device, above which the take is of another device. In
simulation (WT901, 64 takes) takes of one device gave at most 13, takes of two devices at least 700."""

LEAST_EIGENVALUE_SHARE = 1e-6
"""Smaller eigenvalues of the scaled information matrix, as a share of the largest, are taken as zero."""


@dataclass(frozen=True, eq=False)
class Take:
    """A take as tracked alone.

    Attributes:
        name: its demonstration's.
        path: the hand's.
        solution: the smoother's.
        knots: index of the smoother's knot in the middle of each stop.
        keyframes: one for each stop.
        marginal: of the keyframes and the device's errors.
    """

    name: str
    path: HandPath
    solution: Solution
    knots: tuple[int, ...]
    keyframes: tuple[Keyframe, ...]
    marginal: Marginal

    @property
    def device(self) -> tuple[str, float, float]:
        """Equal for takes of one device: the sensor's name, and the lag and scale corrected before smoothing."""
        assert self.path.tracking is not None
        return self.path.tracking.recording.info.sensor, self.solution.removed.lag, self.solution.removed.scale


def tracked_take(demo: Demonstration, calibration: Calibration | None, accept_gap: bool) -> Take:
    """Track a take alone; its name is put before warnings and errors."""
    name = demo.recording.info.name
    with naming(name):
        path, found = track_recording(demo, "default", calibration, accept_gap)
        keyframes = find_keyframes(path)
    assert found.solution is not None
    problem, knots = found.solution.problem, []
    for stop in found.stops:
        inside = np.flatnonzero((problem.rows >= stop.start) & (problem.rows < stop.stop) & (problem.stop_of >= 0))
        knots.append(int(inside[(len(inside) - 1) // 2]))
    return Take(name, path, found.solution, tuple(knots), keyframes, marginal_of(found.solution, knots))


def matched_keyframes(take: Take) -> Keyframes:
    """Return a take's keyframes for matching."""
    marginal, n = take.marginal, len(take.knots)
    cov = marginal.cov.reshape(n, 6, n, 6)[np.arange(n), :3, np.arange(n), :3]
    sigma = np.sqrt(np.trace(cov, axis1=1, axis2=2) / 3.0)
    return Keyframes(marginal.p, marginal.R, tuple(keyframe.grip for keyframe in take.keyframes), sigma)


def refuse_other_tasks(takes: Sequence[Take], alignment: Alignment) -> None:
    """Refuse takes unless most of them, and at least two, are of one task.

    Raises:
        TrackingError: names two takes of different tasks.
    """
    if 2 * len(alignment.registered) > len(takes):
        return
    one, other = takes[next(iter(alignment.registered))], takes[alignment.strangers[0]]
    if min(len(one.knots), len(other.knots)) > 2:
        away = [matched_keyframes(take)[list(range(1, len(take.knots)))] for take in (one, other)]
        if not align_takes(away).strangers:
            raise TrackingError(
                f"{one.name} and {other.name} match, but for the dock: the sensor lay in another place there, or was "
                "turned otherwise than in the hand; start in the same dock, and if you turn the sensor in the hand, "
                "turn it in the dock too"
            )
    raise TrackingError(
        f"{one.name} ({len(one.knots)} stops) and {other.name} ({len(other.knots)} stops) are of different tasks: "
        "fewer than half of their keyframes match; fuse takes of one task"
    )


def initial_estimate(
    takes: Sequence[Take], used: Sequence[int], alignment: Alignment, moved: MovedKeyframes | None
) -> tuple[Observations, TaskState]:
    """Return the observations and the initial state, both in the nav of the first take that is used."""
    keyframes, kept = alignment.kept()
    device = _devices_of([takes[k].marginal for k in used], [takes[k].device for k in used])
    observed = [(i, j, own[k]) for i, k in enumerate(used) for j, own in enumerate(kept) if k in own]
    take, at, own = np.array(observed, dtype=np.intp).T
    frames, frame = [alignment.registered], np.zeros(len(kept), dtype=np.intp)
    if moved is not None:
        frames.append(alignment.registered | moved.back)
        frame[[moved.first <= own.get(moved.reference, -1) <= moved.last for own in kept]] = 1
    observations = Observations(tuple(takes[k].marginal for k in used), take, at, own, device, frame)
    to_first = [registered[used[0]].inverse() for registered in frames]
    navs = [[one.after(registered[k]) for k in used] for one, registered in zip(to_first, frames, strict=True)]
    task, j = [one.apply(keyframes) for one in to_first], np.arange(len(kept))
    return observations, TaskState(
        np.array([one.p for one in task])[frame, j],
        np.array([one.R for one in task])[frame, j],
        np.array([[one.yaw for one in nav] for nav in navs]),
        np.array([[one.c for one in nav] for nav in navs]),
        np.array([one.Q for one in navs[0]]),
        np.tile(np.eye(3), (len(used), 1, 1)),
        np.zeros((len(used), 3)),
        np.array([takes[used[device.index(d)]].marginal.device for d in range(max(device) + 1)]),
    )


def _devices_of(marginals: Sequence[Marginal], names: Sequence[Hashable]) -> tuple[int, ...]:
    """Return each take's device as a number, from 0 on. Takes with different names are of different devices."""
    groups: list[list[int]] = []
    for k, (marginal, name) in enumerate(zip(marginals, names, strict=True)):
        same_name = [group for group in groups if names[group[0]] == name]
        misfits = [_misfit(marginal, [marginals[i] for i in group]) for group in same_name]
        if min(misfits, default=np.inf) < ANOTHER_DEVICE:
            same_name[int(np.argmin(misfits))].append(k)
        else:
            groups.append([k])
    return tuple(next(d for d, group in enumerate(groups) if k in group) for k in range(len(marginals)))


def _misfit(marginal: Marginal, others: Sequence[Marginal]) -> float:
    """Return chi-square of the sensor errors that a take shows, against the errors that other takes show."""
    prior = others[0].prior
    cov = np.linalg.inv(prior + sum(other.information for other in others))
    errors = cov @ (prior @ others[0].mean + sum(other.gradient for other in others))
    information = marginal.information
    off = marginal.gradient - information @ errors
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
    spread = (information + information @ cov @ information) * np.outer(scale, scale)
    return float((off * scale) @ np.linalg.pinv(spread, LEAST_EIGENVALUE_SHARE, hermitian=True) @ (off * scale))
