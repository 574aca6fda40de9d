"""npz: arrays for the clients of real arms."""

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.export_request import ExportRequest


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write joints (k,) names, t (n,) s, q, dq, ddq (n, k) rad, rad/s, rad/s2, gripper (n,) 1 open, 0 closed."""
    with path.open("wb") as file:
        np.savez(
            file,
            joints=np.array(request.trajectory.joint_names),
            t=points.t,
            q=points.q,
            dq=points.qd,
            ddq=points.qdd,
            gripper=points.gripper,
        )


def read(path: Path) -> Samples:
    """Read what `write` wrote."""
    with np.load(path, allow_pickle=False) as file:
        return Samples(*(file[name] for name in ("t", "q", "dq", "ddq", "gripper")))
