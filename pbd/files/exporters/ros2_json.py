"""ROS 2 goals as JSON: trajectory_msgs/msg/JointTrajectory of the arm, and of the gripper's fingers beside it.

The points are where the trajectory's cubic pieces join, so that joint_trajectory_controller gets the motion back
exactly, whether it fills the gaps by cubics or by quintics. Samples at a rate only add points to these.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Gripper, JointTrajectory, Samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array

LEAST_GAP_S = 2e-5
"""Knots closer in time than this are left out, s. The controller divides by the cube of the gap: the positions' last
digits would become jerk (3 rad/s3 at this gap), and whole nanoseconds 0.05 % of the arm's own."""

DERIVATIVES = ("positions", "velocities", "accelerations")
_OFF_KNOTS = 0.25
"""Samples closer to a knot than this share of their spacing add nothing, and are left out."""


def samples(request: ExportRequest) -> Samples:
    """Evaluate at the trajectory's knots, and at a rate in between, at whole nanoseconds as the message has them."""
    trajectory, rate_hz = request.trajectory, request.rate_hz
    t = _apart(trajectory.knots)
    if rate_hz is not None:
        grid = np.arange(1, int(trajectory.duration * rate_hz) + 1) / rate_hz
        after = np.searchsorted(t, grid).clip(1, len(t) - 1)
        off = np.minimum(np.abs(grid - t[after - 1]), np.abs(t[after] - grid))
        t = np.sort(np.append(t, grid[off >= max(_OFF_KNOTS / rate_hz, LEAST_GAP_S)]))
    exact, rounded = trajectory.at(t), np.round(1e9 * t) / 1e9
    # At rest exactly: the controller refuses a final velocity, and none may add up while the arm stands.
    rest = ~(exact.qd.any(axis=1) | exact.qdd.any(axis=1))
    points = trajectory.at(np.where(rest, t, rounded))
    return Samples(rounded, points.q, points.qd, points.qdd, points.gripper)


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the goals, one point a line."""
    trajectory, gripper = request.trajectory, request.robot.gripper
    arm = goal_message(trajectory.joint_names, points.t, (points.q, points.qd, points.qdd))
    fingers = finger_message(trajectory, gripper) if gripper is not None and gripper.joints else None
    t, opening = trajectory.gripper_t.tolist(), trajectory.gripper_opening.tolist()
    commands = [  # when the gripper sets out for which opening (1 open, 0 closed)
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
    """Read the arm's goal of what `write` wrote; the gripper has its own, and is not told."""
    points = json.loads(path.read_text(encoding="utf-8"))["points"]
    t = np.array([point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in points])
    q, qd, qdd = (np.array([point[name] for point in points]) for name in DERIVATIVES)
    return Samples(t, q, qd, qdd, np.full(len(t), np.nan))


def finger_message(trajectory: JointTrajectory, gripper: Gripper) -> dict[str, Any]:
    """Make the goal of the finger joints: positions alone, between which the controller goes evenly, as planned."""
    t = np.concatenate(([0.0], trajectory.gripper_t, [trajectory.duration]))
    _, first = np.unique(np.round(1e9 * t), return_index=True)
    opening = np.interp(t[first], trajectory.gripper_t, trajectory.gripper_opening)
    fingers = gripper.closed + opening[:, None] * (gripper.open - gripper.closed)
    return goal_message(gripper.joints, t[first], (fingers,))


def _apart(t: Array) -> Array:
    """Leave out instants too close to the one before; the first and the last stay."""
    kept = [float(t[0])]
    for instant in t[1:].tolist():
        if instant - kept[-1] >= LEAST_GAP_S:
            kept.append(instant)
    if kept[-1] != t[-1]:
        kept = [*kept[: max(1, len(kept) - 1)], float(t[-1])]
    return np.array(kept)


def goal_message(joint_names: tuple[str, ...], t: Array, derivatives: tuple[Array, ...]) -> dict[str, Any]:
    """Make a JointTrajectory: stamp 0 ("now"), positions (n, k) and what else there is, no effort."""
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
    """Return the message's keys with their values as JSON, one point a line."""
    points = ",\n".join(json.dumps(point) for point in message["points"])
    return [*(f'"{key}": {json.dumps(message[key])}' for key in ("header", "joint_names")), f'"points": [\n{points}\n]']


def _duration(t: float) -> Mapping[str, int]:
    sec, nanosec = divmod(round(t * 1e9), 10**9)
    return {"sec": sec, "nanosec": nanosec}
