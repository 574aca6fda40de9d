"""GLB: the animated scene of the replay, for Blender and other 3D viewers."""

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.export_request import ExportRequest


def samples(request: ExportRequest) -> Samples:
    """Sample at the rate and at each keyframe."""
    t, keyframe_t = request.sampled().t, request.trajectory.keyframe_t
    apart = np.abs(t[:, None] - keyframe_t).min(axis=1) >= 1e-4  # s: the resolution of float32 after 20 minutes
    return request.trajectory.at(np.union1d(t[apart], keyframe_t))


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the scene at these instants."""
    request.source.draw(points.t, path)
