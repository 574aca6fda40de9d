"""From several takes of one task to one path: track each, align them, estimate them together, follow their mean."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pbd.data import (
    Calibration,
    Demonstration,
    Found,
    FusedTake,
    Fusion,
    GripEvent,
    HandPath,
    Keyframe,
    Recording,
    SensorFound,
    Tracking,
)
from pbd.data.covariance import PoseCovariance
from pbd.errors import PbdError, PbdWarning, TrackingError
from pbd.fusion.alignment import Alignment, Candidate, Keyframes, Registration, align
from pbd.fusion.joint import Joint, Parts, State, estimate_jointly, placed
from pbd.fusion.messages import BIAS, SHARED, Message, message_of, pinned
from pbd.fusion.outliers import believed, disagreement
from pbd.fusion.path import MeanWay, Way, mean_way
from pbd.fusion.scatter import alike, each
from pbd.pipeline import track_alone
from pbd.pose import Array, Pose, quat_about_z, quat_from_matrix, quat_multiply, quat_to_matrix
from pbd.tracking.estimate import Estimate, relative_to_first
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.smoother import state as smoother_state
from pbd.tracking.smoother.attitude import heading
from pbd.tracking.smoother.path import path_of
from pbd.tracking.smoother.preintegration import LOWER
from pbd.tracking.smoother.smooth import Solution
from pbd.tracking.smoother.state import ACC_MATRIX, GYR_MATRIX, LAG


@dataclass(frozen=True, eq=False)
class _Take:
    """A take as tracked alone."""

    name: str
    path: HandPath
    solution: Solution
    knots: tuple[int, ...]
    keyframes: tuple[Keyframe, ...]
    message: Message

    @property
    def device(self) -> tuple[str, float, float]:
        """What the takes of one device have in common: its name; the lag and scale that were taken out before."""
        assert self.path.tracking is not None
        return self.path.tracking.recording.info.sensor, self.solution.lag, self.solution.scale


def fused_path(demo: Demonstration, method: str, calibration: Calibration | None, accept_gap: bool) -> HandPath:
    """The path of a demonstration that lists its takes; see `pbd.pipeline.fuse`.

    Raises:
        TrackingError: the takes are of different tasks, or one of them can't be tracked.
    """
    if method != "default":
        raise TrackingError(f"takes are fused by the default method only; track one of them with --method {method}")
    takes = [_tracked(take, calibration, accept_gap) for take in demo.takes]
    found = align([_keyframes(take) for take in takes])
    strangers = {k: "another task" for k in found.strangers}
    _refuse_strangers(takes, found)
    kept = found.kept()
    used = [k for k in range(len(takes)) if k not in strangers]
    parts, x = _start(takes, used, kept, found.registered)
    joint, parts, disbelieved = believed(parts, estimate_jointly(parts, x, alike(len(kept))))
    left = {used[k]: "an outlier" for k in disbelieved.takes}
    if left:
        used = [k for k in used if k not in left]
        kept = tuple(_without(one, left) for one in kept)
        parts, x = _start(takes, used, kept, found.registered)
        joint, parts, disbelieved = believed(parts, estimate_jointly(parts, x, alike(len(kept))))
    for k, why in (strangers | left).items():
        warnings.warn(f"{takes[k].name} is left out: {why}", PbdWarning, stacklevel=3)
    if disbelieved.takes:
        raise TrackingError("the takes don't agree: more than one is an outlier; record the task again")
    states = [pinned(takes[k].solution, joint.state.devices[d]) for k, d in zip(used, parts.device, strict=True)]
    messages = tuple(message_of(takes[k].solution, takes[k].knots, s) for k, s in zip(used, states, strict=True))
    parts = replace(parts, messages=messages)
    joint = estimate_jointly(parts, joint.state, joint.scatter)
    for words in disagreement(parts, joint, [takes[k].name for k in used]):
        warnings.warn(words, PbdWarning, stacklevel=3)
    own = estimate_jointly(parts, joint.state, each(joint.scatter))
    ways = [_way(takes[k], i, state, parts, joint) for i, (k, state) in enumerate(zip(used, states, strict=True))]
    pose = _onto_nav(takes[used[0]], joint)
    fusion = _fusion(takes, used, kept, found, strangers | left, disbelieved.keyframes, parts, joint, own, pose)
    return _hand_path(demo, takes[used[0]], kept, ways, joint, pose, fusion, parts, calibration, accept_gap)


def _tracked(demo: Demonstration, calibration: Calibration | None, accept_gap: bool) -> _Take:
    name = demo.recording.info.name
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            path, found = track_alone(demo, "default", calibration, accept_gap)
        except PbdError as error:
            raise type(error)(f"{name}: {error.message}", **error.fields) from None
        keyframes = find_keyframes(path)
    for warning in told:
        warnings.warn(f"{name}: {warning.message}", PbdWarning, stacklevel=4)
    assert found.fitted is not None
    knots = _middles(found)
    return _Take(name, path, found.fitted, knots, keyframes, message_of(found.fitted, knots))


def _middles(found: Estimate) -> tuple[int, ...]:
    """The knot in the middle of each stop."""
    assert found.fitted is not None
    problem, knots = found.fitted.problem, []
    for stop in found.stops:
        inside = np.flatnonzero((problem.rows >= stop.start) & (problem.rows < stop.stop) & (problem.stop_of >= 0))
        knots.append(int(inside[(len(inside) - 1) // 2]))
    return tuple(knots)


def _keyframes(take: _Take) -> Keyframes:
    message, n = take.message, len(take.knots)
    cov = message.cov.reshape(n, 6, n, 6)[np.arange(n), :3, np.arange(n), :3]
    sigma = np.sqrt(np.trace(cov, axis1=1, axis2=2) / 3.0)
    return Keyframes(message.p, message.R, tuple(one.grip for one in take.keyframes), sigma)


def _refuse_strangers(takes: Sequence[_Take], found: Alignment) -> None:
    if 2 * len(found.registered) > len(takes) and len(found.registered) > 1:
        return
    reference = next(iter(found.registered))
    other = takes[found.strangers[0]]
    raise TrackingError(
        f"{takes[reference].name} ({len(takes[reference].knots)} stops) and {other.name} ({len(other.knots)} stops) are "
        "of different tasks: fewer than half of their keyframes match; fuse takes of one task"
    )


def _without(one: Candidate, takes: dict[int, str]) -> Candidate:
    return Candidate(one.p, one.R, one.grip, one.sigma, {k: i for k, i in one.own.items() if k not in takes})


def _start(
    takes: Sequence[_Take], used: Sequence[int], kept: Sequence[Candidate], registered: dict[int, Registration]
) -> tuple[Parts, State]:
    """What belongs together, and where to begin: all in the nav of the first take that is used."""
    kinds = list(dict.fromkeys(takes[k].device for k in used))
    device = tuple(kinds.index(takes[k].device) for k in used)
    parts = Parts(
        tuple(takes[k].message for k in used),
        tuple(np.array([j for j, one in enumerate(kept) if k in one.own]) for k in used),
        tuple(np.array([one.own[k] for one in kept if k in one.own]) for k in used),
        device,
    )
    base = registered[used[0]]
    back = quat_to_matrix(quat_about_z(-base.yaw))
    here = [registered[k] for k in used]
    errors = np.array([[takes[k].message.device for k in used if takes[k].device == kind][0] for kind in kinds])
    return parts, State(
        (np.array([one.p for one in kept]) - base.c) @ back.T,
        back @ np.array([one.R for one in kept]) @ base.Q.T,
        np.array([one.yaw - base.yaw for one in here]),
        np.array([back @ (one.c - base.c) for one in here]),
        np.array([one.Q @ base.Q.T for one in here]),
        np.zeros((len(used), 3)),
        errors,
    )


def _way(take: _Take, i: int, state: smoother_state.State, parts: Parts, joint: Joint) -> Way:
    """A take's path in the first take's nav, of the sensor as it sat there."""
    x, path = joint.state, path_of(take.solution.problem, state)
    yaw = quat_about_z(float(x.yaw[i]))
    wxyz = quat_multiply(quat_multiply(yaw, path.wxyz), quat_from_matrix(x.Q[i]))
    p = path.p @ x.turn[i].T + x.c[i] - quat_to_matrix(wxyz) @ x.lever[i]
    t, stops, weight = take.path.t, np.full((len(x.m), 2), np.nan), np.zeros(len(x.m))
    for j, own in zip(parts.at[i].tolist(), parts.own[i].tolist(), strict=True):
        stop = take.path.stops[own]
        stops[j], weight[j] = (t[stop.start], t[stop.stop - 1]), stop.weight
    return Way(t, p, wxyz, stops, weight)


def _onto_nav(first: _Take, joint: Joint) -> Pose:
    """nav's origin is the first keyframe, its heading as the first take's there."""
    R = joint.state.A[0]
    yaw = heading(first.keyframes[0].T_nav_sensor.wxyz[None]) - heading(quat_from_matrix(R)[None])
    turn = quat_about_z(yaw)
    return Pose(-quat_to_matrix(turn) @ joint.state.m[0], turn)


def _fusion(
    takes: Sequence[_Take],
    used: Sequence[int],
    kept: Sequence[Candidate],
    found: Alignment,
    left_out: dict[int, str],
    disbelieved: Sequence[tuple[int, int]],
    parts: Parts,
    joint: Joint,
    each_own: Joint,
    onto: Pose,
) -> Fusion:
    x, none = joint.state, np.full((len(kept), 3), np.nan)
    told = []
    for k, take in enumerate(takes):
        if k in left_out:
            told.append(FusedTake(take.name, (None,) * len(kept), none, left_out=left_out[k]))
            continue
        i = used.index(k)
        at = [j for j, one in enumerate(kept) if k in one.own]
        mine = [one.own[k] for one in kept if k in one.own]
        p, _ = placed(parts.messages[i], x.devices[parts.device[i]])
        off = none.copy()
        off[at] = p[mine] @ x.turn[i].T + x.c[i] - x.m[at] - x.A[at] @ x.lever[i]
        told.append(
            FusedTake(
                take.name,
                tuple(one.own.get(k) for one in kept),
                off @ quat_to_matrix(onto.wxyz).T,
                tuple(j for take_of, j in disbelieved if take_of == i),
                tuple(sorted(set(range(len(take.knots))) - set(mine))),
                float((x.yaw[i] + np.pi) % (2.0 * np.pi) - np.pi),
                Pose(x.lever[i], quat_from_matrix(x.Q[i])),
            )
        )
    sigma, unsure = each_own.scatter.sigma, each_own.scatter.sigma_log
    log, spread = joint.scatter.log[2:], joint.scatter.unsure[2:]
    return Fusion(
        tuple(told),
        _turned_sigmas(sigma[:, :3], onto),
        sigma[:, 3],
        unsure[:, :4],
        (float(np.exp(log[0])), float(np.exp(log[1]))),
        (float(spread[0]), float(spread[1])),
    )


def _turned_sigmas(sigma: Array, onto: Pose) -> Array:
    """Standard deviations along axes that are turned a little."""
    return np.asarray(np.sqrt(sigma**2 @ (quat_to_matrix(onto.wxyz) ** 2).T))


def _hand_path(
    demo: Demonstration,
    first: _Take,
    kept: Sequence[Candidate],
    ways: Sequence[Way],
    joint: Joint,
    onto: Pose,
    fusion: Fusion,
    parts: Parts,
    calibration: Calibration | None,
    accept_gap: bool,
) -> HandPath:
    assert first.path.tracking is not None
    recording, tracking = first.path.tracking.recording, first.path.tracking
    mean = mean_way(ways, joint.state.m, joint.state.A, 1.0 / recording.rate_hz)
    turn = quat_to_matrix(onto.wxyz)
    p = onto.act(joint.state.m)
    spread = np.kron(np.eye(2 * len(p)), turn)
    cov = spread @ joint.cov @ spread.T
    grip = tuple(
        GripEvent(0.5 * float(mean.t[stop.start] + mean.t[stop.stop - 1]), one.grip)
        for one, stop in zip(kept, mean.stops, strict=True)
        if one.grip is not None
    )
    return HandPath(
        t=mean.t,
        p_nav_sensor=onto.act(mean.p),
        v_nav_sensor=mean.v @ turn.T,
        wxyz_nav_sensor=quat_multiply(onto.wxyz, mean.wxyz),
        stops=mean.stops,
        closure=np.zeros((len(p) - 1, 3)),
        covariance=PoseCovariance(len(p), partial(_times, cov, p)),
        grip=grip,
        tracking=Tracking(
            demo,
            "default",
            calibration,
            _felt(recording, mean, demo.recording.info.name, grip),
            mean.a @ turn.T,
            tracking.gravity,
            (mean.stops[0].start, mean.stops[0].stop),
            accept_gap,
        ),
        sensor=_sensor(first, joint, parts.device[0]),
        fusion=fusion,
    )


def _times(cov: Array, p: Array, columns: Array) -> Array:
    """Covariance relative to the first keyframe's place and heading, times columns (n, 6, c)."""
    right = relative_to_first(columns, p, transposed=True)
    left = (cov @ right.reshape(len(cov), -1)).reshape(columns.shape)
    return relative_to_first(left, p)


def _felt(recording: Recording, mean: MeanWay, name: str, grip: tuple[GripEvent, ...]) -> Recording:
    """What the first take's sensor read on the way, at the mean way's pace."""

    def at(values: Array | None) -> Array | None:
        if values is None:
            return None
        return np.column_stack([np.interp(mean.at_first, recording.t, axis) for axis in values.T])

    acc = at(recording.acc)
    assert acc is not None
    return replace(
        recording,
        t=mean.t,
        acc=acc,
        gyr=at(recording.gyr),
        mag=at(recording.mag),
        device_rpy=at(recording.device_rpy),
        grip=grip,
        info=replace(recording.info, name=name),
    )


def _sensor(first: _Take, joint: Joint, device: int) -> SensorFound | None:
    """The first take's device, as all its takes show it."""
    alone, errors = first.path.sensor, joint.state.devices[device]
    if alone is None:
        return None
    sigma = np.sqrt(np.diagonal(joint.of_devices[device]))
    shared, of_shared = errors[SHARED], sigma[SHARED]

    def lower(values: Array, elsewhere: Array) -> Array:
        matrix = np.array(elsewhere)
        matrix[tuple(np.transpose(LOWER))] = values
        return matrix

    M = shared[GYR_MATRIX].reshape(3, 3) - first.solution.scale * np.eye(3)

    def found(before: Found, value: Array, spread: Array) -> Found:
        return Found(value, spread, before.expected, before.prior)

    return SensorFound(
        alone.gyr_bias,
        found(alone.gyr_matrix, M, of_shared[GYR_MATRIX].reshape(3, 3)),
        found(alone.acc_bias, errors[BIAS], sigma[BIAS]),
        found(
            alone.acc_matrix,
            lower(shared[ACC_MATRIX], np.zeros((3, 3))),
            lower(of_shared[ACC_MATRIX], alone.acc_matrix.sigma),
        ),
        found(alone.lag, first.solution.lag + shared[LAG][0], of_shared[LAG][0]),
    )
