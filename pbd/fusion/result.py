"""Convert the joint estimate to a hand path, with a summary of its takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from pbd.data import (
    Calibration,
    Demonstration,
    FusedTake,
    Fusion,
    GripEvent,
    HandPath,
    MovedThing,
    SensorEstimate,
    Tracking,
)
from pbd.data.covariance import PoseCovariance
from pbd.data.streams import interpolate
from pbd.fusion.grips import fused_grips
from pbd.fusion.joint_estimate import JointEstimate, Observations
from pbd.fusion.known_stops import points_in_base
from pbd.fusion.marginals import BIAS_PART
from pbd.fusion.matching import IndexByTake
from pbd.fusion.mean_path import MeanPath, TakePath, average_paths
from pbd.fusion.scatter import Scatter
from pbd.fusion.takes import Take
from pbd.lazy import cached_property
from pbd.pose import Array, Pose, matrix_log, quat_about_z, quat_from_matrix, quat_multiply, quat_rotate, quat_to_matrix
from pbd.tracking.estimate import relative_to_first
from pbd.tracking.smoother import state as smoother_state
from pbd.tracking.smoother.attitude import heading
from pbd.tracking.smoother.path import path_of
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, LAG
from pbd.tracking.smoother.state import lower_matrix


@dataclass(frozen=True, eq=False)
class Fused:
    """Takes and their joint estimate.

    Attributes:
        takes: all takes.
        used: indices of the takes in the estimate. The first of them defines the frame.
        left_out: index of each other take -> why it is not used.
        kept: the task's keyframes; for each, its index in the takes that have it.
        outliers: keyframes of takes that are not believed: (index in `used`, the task's keyframe).
        observations, joint: input and result of the joint estimate.
        scatter: the hand's scatter at each keyframe.
        states: the smoother's state of each take that is used, estimated again with the device's joint errors.
    """

    takes: Sequence[Take]
    used: Sequence[int]
    left_out: Mapping[int, str]
    kept: Sequence[IndexByTake]
    outliers: Sequence[tuple[int, int]]
    observations: Observations
    joint: JointEstimate
    scatter: Scatter
    states: Sequence[smoother_state.State]

    @property
    def first(self) -> Take:
        """The take that defines the frame."""
        return self.takes[self.used[0]]

    @cached_property
    def T_nav_first(self) -> Pose:
        """The first take's nav in the task's nav. Its origin is the first keyframe, where the sensor's heading is
        as in the first take."""
        R = self.joint.state.A[0]
        yaw = heading(self.first.keyframes[0].T_nav_sensor.wxyz[None]) - heading(quat_from_matrix(R)[None])
        wxyz = quat_about_z(yaw)
        return Pose(-quat_to_matrix(wxyz) @ self.joint.state.m[0], wxyz)


def _take_path(fused: Fused, i: int) -> TakePath:
    """Return a take's path in the first take's nav, with the sensor held as in the first take."""
    take, observations, x = fused.takes[fused.used[i]], fused.observations, fused.joint.state
    path = path_of(take.solution.problem, fused.states[i])
    wxyz = quat_multiply(quat_multiply(quat_about_z(float(x.yaw[0, i])), path.wxyz), quat_from_matrix(x.Q[i] @ x.H[i]))
    p = path.p @ x.Rz[0, i].T + x.c[0, i] - quat_rotate(wxyz, x.lever[i])
    t, stops, weight = take.path.t, np.full((len(x.m), 2), np.nan), np.zeros(len(x.m))
    of_take = observations.take == i
    for j, own in zip(observations.at[of_take].tolist(), observations.own[of_take].tolist(), strict=True):
        stop = take.path.stops[own]
        stops[j], weight[j] = (t[stop.start], t[stop.stop - 1]), stop.weight
    return TakePath(t, p, wxyz, stops, weight)


def _fusion(fused: Fused, mean: MeanPath) -> Fusion:
    """Summarise the takes and the hand's scatter."""
    x, observations, turn = fused.joint.state, fused.observations, quat_to_matrix(fused.T_nav_first.wxyz)
    summaries = []
    for k, take in enumerate(fused.takes):
        own = tuple(own.get(k) for own in fused.kept)
        off, off_rad = np.full((len(own), 3), np.nan), np.full(len(own), np.nan)
        if k in fused.left_out:
            summaries.append(FusedTake(take.name, own, off, off_rad, left_out=fused.left_out[k]))
            continue
        i, at, mine = fused.used.index(k), *np.array([(j, i) for j, i in enumerate(own) if i is not None]).T
        p, R = observations.marginals[i].poses_with_device(x.devices[observations.device[i]])
        frame = observations.frame[at]
        p = (x.Rz[frame, i] @ p[mine, :, None])[..., 0] + x.c[frame, i]
        off[at] = p - x.m[at] - x.A[at] @ x.lever[i]
        held = np.where((at == 0)[:, None, None], x.Q[i], x.Q[i] @ x.H[i])
        turns = matrix_log(x.Rz[frame, i] @ R[mine] @ held @ x.A[at].transpose(0, 2, 1))
        off_rad[at] = np.linalg.norm(turns, axis=1)
        summaries.append(
            FusedTake(
                take.name,
                own,
                off @ turn.T,
                off_rad,
                tuple(j for which, j in fused.outliers if which == i),
                tuple(sorted(set(range(len(take.knots))) - set(mine.tolist()))),
                float((x.yaw[0, i] + np.pi) % (2.0 * np.pi) - np.pi),
                Pose(x.lever[i], quat_from_matrix(x.Q[i] @ x.Q[0].T)),
                float(fused.joint.turn_sigma[i]),
                observations.device[i],
            )
        )
    scatter, common = fused.scatter, fused.joint.scatter
    return Fusion(
        tuple(summaries),
        np.sqrt(scatter.sigma[:, :3] ** 2 @ (turn**2).T),  # to nav's axes, which a small yaw rotates
        scatter.sigma[:, 3],
        scatter.log_sigma[scatter.group[:, :4]],
        (float(np.exp(common.log[2])), float(np.exp(common.log[3]))),
        (float(common.log_sigma[2]), float(common.log_sigma[3])),
        points_in_base(
            [fused.takes[k] for k in fused.used], [summaries[k].own for k in fused.used], mean.stops, mean.t
        ),
        _moved_thing(fused),
    )


def _moved_thing(fused: Fused) -> MovedThing | None:
    """Return the task's keyframes that moved with an object, if the takes that are used still have them."""
    moving, x = np.flatnonzero(fused.observations.frame), fused.joint.state
    if not len(moving):
        return None
    middle = x.m[moving].mean(axis=0)
    moved_m = {}
    for i, k in enumerate(fused.used):
        p_nav = x.Rz[1, i].T @ (middle - x.c[1, i])
        moved_m[fused.takes[k].name] = float(np.linalg.norm(x.Rz[0, i] @ p_nav + x.c[0, i] - middle))
    return MovedThing(int(moving[0]), int(moving[-1]), moved_m)


def fused_hand_path(demo: Demonstration, fused: Fused, calibration: Calibration | None, accept_gap: bool) -> HandPath:
    """Return the mean path through the fused keyframes."""
    tracking, joint, T_nav_first = fused.first.path.tracking, fused.joint, fused.T_nav_first
    assert tracking is not None
    recording = tracking.recording
    paths = [_take_path(fused, i) for i in range(len(fused.used))]
    mean = average_paths(paths, joint.state.m, joint.state.A, 1.0 / recording.rate_hz)
    turn = quat_to_matrix(T_nav_first.wxyz)
    p = T_nav_first.act(joint.state.m)
    rotation = np.asarray(np.kron(np.eye(2 * len(p)), turn), np.float64)
    relative = relative_to_first(rotation.reshape(len(p), 6, -1), p).reshape(rotation.shape)
    grip = tuple(
        GripEvent(stop.middle_s(mean.t), closed)
        for closed, stop in zip(fused_grips(fused.kept, fused.takes), mean.stops, strict=True)
        if closed is not None
    )
    channels: dict[str, Any] = {  # the first take's, at the pace of the mean path
        name: interpolate(mean.t_first, recording.t, values) for name, values in recording.channels.items()
    }
    info = replace(recording.info, name=demo.recording.info.name)
    return HandPath(
        t=mean.t,
        p_nav_sensor=T_nav_first.act(mean.p),
        v_nav_sensor=mean.v @ turn.T,
        wxyz_nav_sensor=quat_multiply(T_nav_first.wxyz, mean.wxyz),
        stops=mean.stops,
        closure=np.zeros((len(p) - 1, 3)),
        covariance=PoseCovariance(len(p), partial(_times, relative @ joint.cov @ relative.T)),
        grip=grip,
        tracking=Tracking(
            demo,
            "default",
            calibration,
            replace(recording, t=mean.t, grip=grip, info=info, **channels),
            mean.a @ turn.T,
            tracking.gravity,
            (mean.stops[0].start, mean.stops[0].stop),
            accept_gap,
        ),
        sensor=_sensor(fused.first, joint, fused.observations.device[0]),
        fusion=_fusion(fused, mean),
    )


def _times(cov: Array, columns: Array) -> Array:
    """Multiply a covariance (6n, 6n) by columns (n, 6, c)."""
    return np.asarray((cov @ columns.reshape(len(cov), -1)).reshape(columns.shape))


def _sensor(first: Take, joint: JointEstimate, device: int) -> SensorEstimate | None:
    """Return the errors of the first take's device, as all its takes show them."""
    alone, errors = first.path.sensor, joint.state.devices[device]
    if alone is None:
        return None
    sigma = np.sqrt(np.diagonal(joint.cov_devices[device]))
    gyr_matrix = errors[GYR_MATRIX].reshape(3, 3) - first.solution.removed.scale * np.eye(3)
    acc_sigma = lower_matrix(sigma[ACC_MATRIX], alone.acc_matrix.sigma)
    return SensorEstimate(
        alone.gyr_bias,
        replace(alone.gyr_matrix, value=gyr_matrix, sigma=sigma[GYR_MATRIX].reshape(3, 3)),
        replace(alone.acc_bias, value=errors[BIAS_PART], sigma=sigma[BIAS_PART]),
        replace(alone.acc_matrix, value=lower_matrix(errors[ACC_MATRIX]), sigma=acc_sigma),
        replace(alone.lag, value=first.solution.removed.lag + errors[LAG][0], sigma=sigma[LAG][0]),
    )
