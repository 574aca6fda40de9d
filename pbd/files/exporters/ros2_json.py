"""ROS 2 trajectory_msgs/msg/JointTrajectory, as joint_trajectory_controller takes it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pbd.data import Samples


def joint_trajectory_message(joint_names: tuple[str, ...], samples: Samples) -> dict[str, Any]:
    """Make the message: stamp 0 ("now"), no effort, the final velocity exactly zero (the controller refuses others)."""
    rows = zip(samples.t.tolist(), *((x + 0.0).tolist() for x in (samples.q, samples.qd, samples.qdd)), strict=True)
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(joint_names),
        "points": [
            {
                "positions": q,
                "velocities": qd,
                "accelerations": qdd,
                "effort": [],
                "time_from_start": _duration(t),
            }
            for t, q, qd, qdd in rows
        ],
    }


def write(joint_names: tuple[str, ...], samples: Samples, path: Path) -> None:
    """Write the message as JSON, one point a line."""
    message = joint_trajectory_message(joint_names, samples)
    points = ",\n".join(json.dumps(point) for point in message.pop("points"))
    path.write_text(f'{json.dumps(message)[:-1]}, "points": [\n{points}\n]}}\n', encoding="utf-8")


def _duration(t: float) -> Mapping[str, int]:
    sec, nanosec = divmod(round(t * 1e9), 10**9)
    return {"sec": sec, "nanosec": nanosec}
