"""The page's description of a motion: times, keyframes, joints, as a plain value for msgpack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.pose import Array
from pbd.view.meshcat_encoding import typed
from pbd.view.replay_scene import ReplayKeyframe, ReplayScene

PLOT_RATE_HZ = 25.0
SPAN_RATE_HZ = 100.0
MOVING_RAD_S = 1e-6
OPEN_SHARE = 0.98
"""Share of the gripper's widest opening in the motion above which it counts as open."""


def describe(scene: ReplayScene, bounds: Array, rate_hz: float) -> Mapping[str, Any]:
    """Describe a replay to the page.

    Args:
        bounds: (k, 3) m in base, points that the camera should show.
        rate_hz: of the motion's frames.
    """
    trajectory, limits = scene.trajectory, scene.robot.limits
    samples = trajectory.sample(PLOT_RATE_HZ)
    often = trajectory.sample(SPAN_RATE_HZ)
    moves = _spans(often.t, np.abs(often.qd).max(axis=1) > MOVING_RAD_S)
    around = [(max(start, first), min(end, last)) for start, end in moves for first, last in scene.detours]
    messages = [each.message for each in scene.touching]
    return {
        "title": scene.title,
        "robot": scene.robot.description or scene.robot.name,
        "license": scene.robot.license,
        "duration": trajectory.duration,
        "rate": rate_hz,
        "keyframes": [_keyframe(keyframe, scene.detours) for keyframe in scene.keyframes],
        "moves": moves,
        "detours": [(start, end) for start, end in around if start < end],
        "closed": _spans(often.t, often.gripper < OPEN_SHARE * often.gripper.max()),
        "joints": {
            "names": list(trajectory.joint_names),
            "t": typed(samples.t, "Float32Array"),
            "q": typed(samples.q.T, "Float32Array"),
            "lower": limits.lower.tolist(),
            "upper": limits.upper.tolist(),
        },
        "speed": None if scene.hand_speed is None else float(scene.hand_speed.max()),
        "torque": scene.torque,
        "table": scene.table_height,
        "obstacles": [obstacle.name for obstacle in scene.obstacles],
        "bounds": bounds.tolist(),
        "notes": [note for note in scene.notes if not any(message in note for message in messages)],
        "touching": [asdict(each) for each in scene.touching],
    }


def _spans(t: Array, wanted: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """From when to when something is wanted, s."""
    edges = np.diff(np.concatenate(([False], wanted, [False])).astype(int))
    first, after = (np.flatnonzero(edges > 0) - 1).clip(0), np.flatnonzero(edges < 0).clip(max=len(t) - 1)
    return list(zip(t[first].tolist(), t[after].tolist(), strict=True))


def _keyframe(keyframe: ReplayKeyframe, around: Sequence[tuple[float, float]]) -> dict[str, Any]:
    return {
        "label": keyframe.label,
        "t": float(keyframe.t),
        "p": keyframe.T_base_tool.p.tolist(),
        "sigma": None if keyframe.cov is None else [_largest(keyframe.cov[:3, :3]), _largest(keyframe.cov[3:, 3:])],
        "grip": keyframe.grip,
        "detour": any(end == keyframe.t for _, end in around),
        "inside": keyframe.inside,
        "sure": None if keyframe.weight >= DOUBTED_WEIGHT else keyframe.weight,
    }


def _largest(cov: Array) -> float:
    """One sigma along the least certain direction."""
    return float(np.sqrt(np.linalg.eigvalsh(cov).max().clip(0.0)))
