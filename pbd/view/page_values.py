"""The page's description of a motion: times, keyframes, joints, as a plain value for msgpack."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data.tracking import DOUBTED_WEIGHT
from pbd.pose import Array
from pbd.view.meshcat_encoding import typed
from pbd.view.replay_scene import ReplayScene
from pbd.view.robot_motion import FRAME_RATE_HZ


def describe(scene: ReplayScene, bounds: Array) -> Mapping[str, Any]:
    """Describe a replay to the page, whose camera should show the points `bounds` (k, 3) m in base."""
    trajectory, limits, calibration = scene.trajectory, scene.robot.limits, scene.calibration
    curves = trajectory.sample(25.0)
    sample_s = 0.01  # the move before a detour may seem to end that much late
    samples = trajectory.sample(1.0 / sample_s)
    moves = _spans(samples.t, np.abs(samples.qd).max(axis=1) > 1e-6)
    detours = [(max(start, first), min(end, last)) for start, end in moves for first, last in scene.detours]
    messages = [contact.message for contact in scene.contacts]
    return {
        "title": scene.title,
        "robot": scene.robot.description or scene.robot.name,
        "license": scene.robot.license,
        "duration": trajectory.duration,
        "rate": FRAME_RATE_HZ,
        "keyframes": [_keyframe(scene, k) for k in range(len(scene.keyframes))],
        "moves": moves,
        "detours": [(start, end) for start, end in detours if start + sample_s < end],
        "closed": _spans(samples.t, samples.gripper < 0.98 * samples.gripper.max()),
        "joints": {
            "names": list(trajectory.joint_names),
            "slides": list(scene.slides),
            "t": typed(curves.t, "Float32Array"),
            "q": typed(curves.q.T, "Float32Array"),
            "lower": limits.lower.tolist(),
            "upper": limits.upper.tolist(),
        },
        "speed": float(scene.hand_speed.max()),
        "torque": scene.torque,
        "table": calibration.table_height,
        "obstacles": [obstacle.name for obstacle in calibration.obstacles],
        "bounds": bounds.tolist(),
        "notes": list(scene.notes),
        "warnings": [warning for warning in scene.warnings if not any(message in warning for message in messages)],
        "touching": [contact._asdict() for contact in scene.contacts],
    }


def _spans(t: Array, wanted: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Start and end, s, of each run of samples that are wanted."""
    edges = np.diff(np.concatenate(([False], wanted, [False])).astype(int))
    first, after = (np.flatnonzero(edges > 0) - 1).clip(0), np.flatnonzero(edges < 0).clip(max=len(t) - 1)
    return list(zip(t[first].tolist(), t[after].tolist(), strict=True))


def _keyframe(scene: ReplayScene, k: int) -> dict[str, Any]:
    keyframe, t, cov = scene.keyframes[k], float(scene.trajectory.keyframe_t[k]), scene.cov[k]
    typed_by_hand = not keyframe.cov.any()
    return {
        "label": keyframe.label,
        "t": t,
        "p": scene.T_base_tool[k].p.tolist(),
        "sigma": None if typed_by_hand else [_largest_sigma(cov[:3, :3]), _largest_sigma(cov[3:, 3:])],
        "grip": keyframe.grip,
        "detour": any(end == t for _, end in scene.detours),
        "off": scene.off_rad[k].tolist() if scene.off_rad.any() else None,
        "inside": None if keyframe.tolerance_m is None else float(scene.inside[k]),
        "sure": None if keyframe.weight >= DOUBTED_WEIGHT else keyframe.weight,
    }


def _largest_sigma(cov: Array) -> float:
    """One sigma along the least certain direction."""
    return float(np.sqrt(np.linalg.eigvalsh(cov).max().clip(0.0)))
