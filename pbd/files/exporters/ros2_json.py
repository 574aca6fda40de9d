"""ROS 2 goals as JSON: trajectory_msgs/msg/JointTrajectory of the arm, and another of the gripper's fingers.

The points are the knots of the trajectory's cubics, so joint_trajectory_controller reproduces the motion exactly,
whether it interpolates by cubics or by quintics. A rate adds points between them.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Gripper, JointTrajectory, Samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array

LEAST_GAP_S = 2e-5
"""Smallest gap between points, s. The controller divides by the cube of the gap: at this gap, rounded positions cause a
jerk of 3 rad/s3, and rounding to whole nanoseconds changes the jerk by 0.05 %."""

DERIVATIVES = ("positions", "velocities", "accelerations")
"""Fields of a JointTrajectoryPoint: rad, rad/s, rad/s2."""


def samples(request: ExportRequest) -> Samples:
    """Sample at the knots, and between them at the rate, if given. Times are whole nanoseconds, as in the message."""
    trajectory, rate_hz = request.trajectory, request.rate_hz
    t = _apart(trajectory.knots)
    if rate_hz is not None:
        grid = np.arange(1, int(trajectory.duration * rate_hz) + 1) / rate_hz
        after = np.searchsorted(t, grid).clip(1, len(t) - 1)
        off = np.minimum(np.abs(grid - t[after - 1]), np.abs(t[after] - grid))
        # A sample within a quarter of the interval of a knot is left out.
        t = np.sort(np.append(t, grid[off >= max(0.25 / rate_hz, LEAST_GAP_S)]))
    exact, rounded = trajectory.at(t), np.round(1e9 * t) / 1e9
    # Velocities at rest must be exactly zero: the controller refuses any other final one, and small ones would add up.
    rest = ~(exact.qd.any(axis=1) | exact.qdd.any(axis=1))
    points = trajectory.at(np.where(rest, t, rounded))
    return Samples(rounded, points.q, points.qd, points.qdd, points.gripper)


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the two goals, one point a line, and the gripper's commands."""
    trajectory, gripper = request.trajectory, request.robot.gripper
    arm = goal_message(trajectory.joint_names, points.t, (points.q, points.qd, points.qdd))
    fingers = finger_message(trajectory, gripper) if gripper is not None and gripper.joints else None
    t, opening = trajectory.gripper_t.tolist(), trajectory.gripper_opening.tolist()
    commands = [  # when the gripper starts to move, and to which opening (1 open, 0 closed)
        {"time_from_start": _duration(since), "opening": wanted}
        for since, before, wanted in zip(t, opening, opening[1:], strict=False)
        if wanted != before
    ]
    parts = [
        *_body(arm),
        f'"gripper": {"null" if fingers is None else "{" + ", ".join(_body(fingers)) + "}"}',
        f'"gripper_commands": {json.dumps(commands)}',
    ]
    path.write_text(f"{{{', '.join(parts)}}}\n", encoding="utf-8")


def read(path: Path) -> Samples:
    """Read the arm's goal from a file of `write`; the gripper's opening is NaN: it has its own goal."""
    points = json.loads(path.read_text(encoding="utf-8"))["points"]
    t = np.array([point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in points])
    q, qd, qdd = (np.array([point[name] for point in points]) for name in DERIVATIVES)
    return Samples(t, q, qd, qdd, np.full(len(t), np.nan))


def finger_message(trajectory: JointTrajectory, gripper: Gripper) -> dict[str, Any]:
    """Make the goal of the finger joints. It has only positions, which the controller joins linearly, as planned."""
    t = np.concatenate(([0.0], trajectory.gripper_t, [trajectory.duration]))
    _, first = np.unique(np.round(1e9 * t), return_index=True)
    opening = np.interp(t[first], trajectory.gripper_t, trajectory.gripper_opening)
    own = [i for i, joint in enumerate(gripper.joints) if joint not in gripper.mimics]  # ros2_control takes no other
    return goal_message(tuple(gripper.joints[i] for i in own), t[first], (gripper.positions(opening)[:, own],))


def _apart(t: Array) -> Array:
    """Leave out instants too close to the previous one, but keep the first and the last."""
    kept = [float(t[0])]
    for instant in t[1:].tolist():
        if instant - kept[-1] >= LEAST_GAP_S:
            kept.append(instant)
    if kept[-1] != t[-1]:
        kept = [*kept[: max(1, len(kept) - 1)], float(t[-1])]
    return np.array(kept)


def goal_message(joint_names: tuple[str, ...], t: Array, derivatives: tuple[Array, ...]) -> dict[str, Any]:
    """Make a JointTrajectory with stamp 0 ("now") and no effort.

    Args:
        joint_names: k names.
        t: (n,) s.
        derivatives: positions (n, k) and, if known, velocities and accelerations.
    """
    columns = [(x + 0.0).tolist() for x in derivatives]  # no -0.0
    columns += [[[]] * len(t)] * (3 - len(columns))
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(joint_names),
        "points": [
            dict(zip(DERIVATIVES, each, strict=True)) | {"effort": [], "time_from_start": _duration(since)}
            for since, *each in zip(t.tolist(), *columns, strict=True)
        ],
    }


def _body(message: dict[str, Any]) -> list[str]:
    """Return each key of a JointTrajectory with its value as JSON, one point a line."""
    points = ",\n".join(json.dumps(point) for point in message["points"])
    return [*(f'"{key}": {json.dumps(message[key])}' for key in ("header", "joint_names")), f'"points": [\n{points}\n]']


def _duration(t: float) -> Mapping[str, int]:
    sec, nanosec = divmod(round(t * 1e9), 10**9)
    return {"sec": sec, "nanosec": nanosec}
