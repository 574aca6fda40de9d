"""A reimplementation of ROS 2's joint_trajectory_controller: what it accepts, and how it interpolates.

https://control.ros.org/master/doc/ros2_controllers/joint_trajectory_controller/doc/trajectory.html
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pbd.pose import Array


def seconds(duration: Mapping[str, int]) -> float:
    return duration["sec"] + 1e-9 * duration["nanosec"]


def refuse(goal: Mapping[str, Any], joints: Sequence[str]) -> None:
    """Fail if the controller would reject a trajectory_msgs/msg/JointTrajectory."""
    assert {"header", "joint_names", "points"} <= set(goal)
    assert goal["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "it begins now"
    assert len(goal["joint_names"]) == len(joints), "it commands all joints"
    assert set(goal["joint_names"]) == set(joints), "it commands its own joints"
    assert goal["points"], "it isn't empty"
    before = -1.0
    for point in goal["points"]:
        assert set(point) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
        time = point["time_from_start"]
        assert all(isinstance(part, int) for part in time.values())
        assert 0 <= time["nanosec"] < 10**9
        assert seconds(time) > before, "time goes on"
        before = seconds(time)
        assert len(point["positions"]) == len(joints)
        assert len(point["velocities"]) in (0, len(joints))
        assert len(point["accelerations"]) in (0, len(joints))
        assert point["effort"] == [], "there is no effort interface"
        assert np.isfinite([*point["positions"], *point["velocities"], *point["accelerations"]]).all()
    assert not any(goal["points"][-1]["velocities"]), "it ends at rest"


class Controller:
    """A goal as the controller interpolates it: by quintics, or cubics (no accelerations), or lines (no velocities)."""

    def __init__(self, goal: Mapping[str, Any], *, accelerations: bool = True) -> None:
        points = goal["points"]
        self.t = np.array([seconds(point["time_from_start"]) for point in points])
        q, qd, qdd = (
            np.array([point[key] for point in points]) for key in ("positions", "velocities", "accelerations")
        )
        T = np.diff(self.t)[:, None]
        zero = np.zeros_like(q[1:])
        if not qd.size:
            self.c = [q[:-1], (q[1:] - q[:-1]) / T, zero, zero, zero, zero]
            return
        p0, p1, v0, v1 = q[:-1], q[1:], qd[:-1], qd[1:]
        if not accelerations:
            square = (-3.0 * p0 + 3.0 * p1 - 2.0 * v0 * T - v1 * T) / T**2
            self.c = [p0, v0, square, (2.0 * p0 - 2.0 * p1 + v0 * T + v1 * T) / T**3, zero, zero]
            return
        a0, a1 = qdd[:-1], qdd[1:]
        self.c = [
            p0,
            v0,
            0.5 * a0,
            (-20.0 * p0 + 20.0 * p1 - 3.0 * a0 * T**2 + a1 * T**2 - 12.0 * v0 * T - 8.0 * v1 * T) / (2.0 * T**3),
            (30.0 * p0 - 30.0 * p1 + 3.0 * a0 * T**2 - 2.0 * a1 * T**2 + 16.0 * v0 * T + 14.0 * v1 * T) / (2.0 * T**4),
            (-12.0 * p0 + 12.0 * p1 - a0 * T**2 + a1 * T**2 - 6.0 * v0 * T - 6.0 * v1 * T) / (2.0 * T**5),
        ]

    def at(self, t: Array, order: int = 0) -> Array:
        """Return a derivative (n, k) of the joints at instants (n,); after the last point the joints stay."""
        t = np.minimum(t, self.t[-1])
        point = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        s = (t - self.t[point])[:, None]
        value = np.zeros((len(t), self.c[0].shape[1]))
        for power in range(order, 6):
            value += np.prod(np.arange(power - order + 1, power + 1)) * self.c[power][point] * s ** (power - order)
        return value

    def peaks(self, order: int, steps: int = 12) -> Array:
        """Return each joint's largest absolute derivative (k,), sampled `steps` times between two points."""
        shares = np.linspace(0.0, 1.0 - 1e-9, steps)
        t = (self.t[:-1, None] + shares * np.diff(self.t)[:, None]).ravel()
        return np.asarray(np.abs(self.at(t, order)).max(axis=0))
