"""The joint estimate as a hand path, and what is told of its takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pbd.data import (
    Calibration,
    Demonstration,
    ErrorEstimate,
    FusedTake,
    Fusion,
    GripEvent,
    HandPath,
    MovedThing,
    Recording,
    SensorEstimate,
    Tracking,
)
from pbd.data.covariance import PoseCovariance
from pbd.fusion.joint_estimate import Joint, Parts
from pbd.fusion.known_stops import points_of_base
from pbd.fusion.marginals import BIAS, SHARED
from pbd.fusion.matching import Candidate
from pbd.fusion.mean_path import MeanWay, Way, mean_way
from pbd.fusion.moved_things import Moved
from pbd.fusion.scatter import Scatter
from pbd.fusion.takes import Take
from pbd.pose import Array, Pose, quat_about_z, quat_from_matrix, quat_multiply, quat_rotate, quat_to_matrix
from pbd.tracking.estimate import relative_to_first
from pbd.tracking.smoother import state as smoother_state
from pbd.tracking.smoother.attitude import heading
from pbd.tracking.smoother.path import path_of
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, LAG
from pbd.tracking.smoother.state import lower_matrix


@dataclass(frozen=True, eq=False)
class Fused:
    """Takes, and what they make together.

    Attributes:
        takes: all; used: those of the estimate, the first of them defines the frame; left_out: why others are not.
        kept: the task's keyframes.
        disbelieved: keyframes of takes (their place in `used`, keyframe).
        parts, joint: the estimate.
        scatter: of each keyframe by itself.
        states: of the smoother, of each take that is used.
        thing: that stood elsewhere in some takes.
    """

    takes: Sequence[Take]
    used: Sequence[int]
    left_out: Mapping[int, str]
    kept: Sequence[Candidate]
    disbelieved: Sequence[tuple[int, int]]
    parts: Parts
    joint: Joint
    scatter: Scatter
    states: Sequence[smoother_state.State]
    thing: Moved | None

    @property
    def first(self) -> Take:
        """The take that defines the frame."""
        return self.takes[self.used[0]]

    @cached_property
    def onto_nav(self) -> Pose:
        """From the first take's nav to the task's: the origin is the first keyframe, the heading that of the first take
        there."""
        R = self.joint.state.A[0]
        yaw = heading(self.first.keyframes[0].T_nav_sensor.wxyz[None]) - heading(quat_from_matrix(R)[None])
        turn = quat_about_z(yaw)
        return Pose(-quat_to_matrix(turn) @ self.joint.state.m[0], turn)


def _way(fused: Fused, i: int) -> Way:
    """A take's path in the first take's nav, of the sensor as it sat there."""
    take, parts, x = fused.takes[fused.used[i]], fused.parts, fused.joint.state
    path = path_of(take.solution.problem, fused.states[i])
    wxyz = quat_multiply(quat_multiply(quat_about_z(float(x.yaw[0, i])), path.wxyz), quat_from_matrix(x.Q[i]))
    p = path.p @ x.turn[0, i].T + x.c[0, i] - quat_rotate(wxyz, x.lever[i])
    t, stops, weight = take.path.t, np.full((len(x.m), 2), np.nan), np.zeros(len(x.m))
    for j, own in zip(parts.at[parts.take == i].tolist(), parts.own[parts.take == i].tolist(), strict=True):
        stop = take.path.stops[own]
        stops[j], weight[j] = (t[stop.start], t[stop.stop - 1]), stop.weight
    return Way(t, p, wxyz, stops, weight)


def _fusion(fused: Fused, mean: MeanWay) -> Fusion:
    """What is told of the takes, and the hand's scatter."""
    x, parts, turn = fused.joint.state, fused.parts, quat_to_matrix(fused.onto_nav.wxyz)
    told = []
    for k, take in enumerate(fused.takes):
        own, off = tuple(one.own.get(k) for one in fused.kept), np.full((len(fused.kept), 3), np.nan)
        if k in fused.left_out:
            told.append(FusedTake(take.name, own, off, left_out=fused.left_out[k]))
            continue
        i, at, mine = fused.used.index(k), *np.array([(j, i) for j, i in enumerate(own) if i is not None]).T
        p, _ = parts.marginals[i].placed(x.devices[parts.device[i]])
        turned = (x.turn[parts.frame[at], i] @ p[mine, :, None])[..., 0] + x.c[parts.frame[at], i]
        off[at] = turned - x.m[at] - x.A[at] @ x.lever[i]
        told.append(
            FusedTake(
                take.name,
                own,
                off @ turn.T,
                tuple(j for which, j in fused.disbelieved if which == i),
                tuple(sorted(set(range(len(take.knots))) - set(mine.tolist()))),
                float((x.yaw[0, i] + np.pi) % (2.0 * np.pi) - np.pi),
                Pose(x.lever[i], quat_from_matrix(x.Q[i] @ x.Q[0].T)),
                float(fused.joint.turn_sigma[i]),
                parts.device[i],
            )
        )
    sigma, of_all = fused.scatter.sigma, fused.joint.scatter
    return Fusion(
        tuple(told),
        np.sqrt(sigma[:, :3] ** 2 @ (turn**2).T),  # along axes that are turned a little
        sigma[:, 3],
        fused.scatter.sigma_log[:, :4],
        (float(np.exp(of_all.log[2])), float(np.exp(of_all.log[3]))),
        (float(of_all.unsure[2]), float(of_all.unsure[3])),
        points_of_base([fused.takes[k] for k in fused.used], [told[k].own for k in fused.used], mean.stops, mean.t),
        _thing(fused),
    )


def _thing(fused: Fused) -> MovedThing | None:
    """The task's keyframes that move together, where the takes still show them."""
    own, x = np.flatnonzero(fused.parts.frame), fused.joint.state
    if fused.thing is None or not len(own):
        return None
    middle = x.m[own].mean(axis=0)
    moved = {}
    for i, k in enumerate(fused.used):
        nav = x.turn[1, i].T @ (middle - x.c[1, i])
        moved[fused.takes[k].name] = float(np.linalg.norm(x.turn[0, i] @ nav + x.c[0, i] - middle))
    return MovedThing(int(own[0]), int(own[-1]), moved)


def hand_path(demo: Demonstration, fused: Fused, calibration: Calibration | None, accept_gap: bool) -> HandPath:
    """The mean way through the fused keyframes."""
    tracking, joint, onto = fused.first.path.tracking, fused.joint, fused.onto_nav
    assert tracking is not None
    recording = tracking.recording
    ways = [_way(fused, i) for i in range(len(fused.used))]
    mean = mean_way(ways, joint.state.m, joint.state.A, 1.0 / recording.rate_hz)
    turn = quat_to_matrix(onto.wxyz)
    p = onto.act(joint.state.m)
    spread = np.kron(np.eye(2 * len(p)), turn)
    cov = spread @ joint.cov @ spread.T
    grip = tuple(
        GripEvent(0.5 * float(mean.t[stop.start] + mean.t[stop.stop - 1]), one.grip)
        for one, stop in zip(fused.kept, mean.stops, strict=True)
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
        sensor=_sensor(fused.first, joint, fused.parts.device[0]),
        fusion=_fusion(fused, mean),
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


def _sensor(first: Take, joint: Joint, device: int) -> SensorEstimate | None:
    """The first take's device, as all its takes show it."""
    alone, errors = first.path.sensor, joint.state.devices[device]
    if alone is None:
        return None
    sigma = np.sqrt(np.diagonal(joint.of_devices[device]))
    shared, of_shared = errors[SHARED], sigma[SHARED]

    M = shared[GYR_MATRIX].reshape(3, 3) - first.solution.scale * np.eye(3)

    def found(before: ErrorEstimate, value: Array, spread: Array) -> ErrorEstimate:
        return ErrorEstimate(value, spread, before.expected, before.prior)

    return SensorEstimate(
        alone.gyr_bias,
        found(alone.gyr_matrix, M, of_shared[GYR_MATRIX].reshape(3, 3)),
        found(alone.acc_bias, errors[BIAS], sigma[BIAS]),
        found(
            alone.acc_matrix,
            lower_matrix(shared[ACC_MATRIX]),
            lower_matrix(of_shared[ACC_MATRIX], alone.acc_matrix.sigma),
        ),
        found(alone.lag, first.solution.lag + shared[LAG][0], of_shared[LAG][0]),
    )
