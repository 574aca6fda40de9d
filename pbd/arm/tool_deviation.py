"""How far the path of a tool, or of a hand, deviates from the direct one: by rotation and by distance."""

import math
from dataclasses import dataclass

import numpy as np

from pbd.arm.model import ArmModel, FloatArray
from pbd.pose import Array

WIDE_TURN_RAD = math.radians(30.0)
"""A move is wide if it rotates the tool by this much more than the direct rotation, rad."""
WIDE_STRAY_M, WIDE_STRAY_SHARE = 0.1, 0.25
"""A move is wide if the tool leaves the straight line by more than this distance, m, plus this share of the line."""

SAMPLES = 33
"""Number of poses along a move that are measured, both ends included."""


@dataclass(frozen=True)
class ToolDeviation:
    """A motion from one keyframe to the next.

    Attributes:
        turn_rad: total rotation along the move.
        direct_rad: angle of the direct rotation.
        off_line_m: largest distance from the straight line.
        line_m: length of that line.
    """

    turn_rad: float
    direct_rad: float
    off_line_m: float
    line_m: float

    @property
    def turns(self) -> bool:
        """Whether the tool rotates much more than needed."""
        return self.turn_rad > self.direct_rad + WIDE_TURN_RAD

    @property
    def wide(self) -> bool:
        """Whether the tool rotates, or leaves the line, much more than needed."""
        return self.turns or self.off_line_m > WIDE_STRAY_M + WIDE_STRAY_SHARE * self.line_m

    def __str__(self) -> str:
        if self.turns:
            return f"turn {np.degrees(self.turn_rad):.0f} degrees instead of {np.degrees(self.direct_rad):.0f}"
        return f"stray {100.0 * self.off_line_m:.0f} cm from a line of {100.0 * self.line_m:.0f} cm"


def tool_deviations(arm: ArmModel, q_before: Array, q: Array) -> list[ToolDeviation]:
    """Measure the straight moves from rows of joints (n, k) to rows (n, k)."""
    along = q_before[:, None] + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (q - q_before)[:, None]
    p, R = arm.forward_many(along.reshape(-1, q.shape[1]))
    return path_deviations(p.reshape(len(q), SAMPLES, 3), R.reshape(len(q), SAMPLES, 3, 3))


def path_deviations(p: FloatArray, R: FloatArray) -> list[ToolDeviation]:
    """Measure n paths: positions (n, m, 3), rotations (n, m, 3, 3)."""
    turns, direct = _angles(R[:, :-1], R[:, 1:]).sum(axis=1), _angles(R[:, 0], R[:, -1])
    lines = np.linalg.norm(p[:, -1] - p[:, 0], axis=1)
    return [
        ToolDeviation(*each) for each in zip(*(a.tolist() for a in (turns, direct, off_line(p), lines)), strict=True)
    ]


def off_line(p: FloatArray) -> FloatArray:
    """Return the largest distance (...) m of points (..., n, 3) from the line segment from the first to the last."""
    away, line = p - p[..., :1, :], p[..., -1:, :] - p[..., :1, :]
    share = np.clip((away * line).sum(axis=-1) / np.maximum((line * line).sum(axis=-1), 1e-18), 0.0, 1.0)
    farthest: FloatArray = np.linalg.norm(away - share[..., None] * line, axis=-1).max(axis=-1)
    return farthest


def _angles(R_before: FloatArray, R: FloatArray) -> FloatArray:
    """Return the angles (...) between rotations (..., 3, 3); the arcsine is accurate for small angles."""
    apart = np.linalg.norm(R - R_before, axis=(-2, -1)) / np.sqrt(8.0)
    angles: FloatArray = 2.0 * np.arcsin(np.minimum(1.0, apart))
    return angles
