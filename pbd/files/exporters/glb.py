"""GLB: the replay's scene, animated, for Blender and whatever else shows 3D models."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.export_request import ExportRequest

LEAST_GAP_S = 1e-4
"""Smallest gap between frames, s: the file's times are float32, which after 20 minutes are as coarse as that."""


def samples(request: ExportRequest) -> Samples:
    """Evaluate at the rate, and when the arm is at each keyframe."""
    t, keyframe_t = request.sampled().t, request.trajectory.keyframe_t
    alone = np.abs(t[:, None] - keyframe_t).min(axis=1) >= LEAST_GAP_S
    return request.trajectory.at(np.union1d(t[alone], keyframe_t))


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the scene at these instants."""
    request.source.draw(points.t, path)
