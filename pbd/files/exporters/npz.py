"""npz: what the clients of real arms take as arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Samples


def write(joint_names: tuple[str, ...], samples: Samples, path: Path) -> None:
    """Write arrays joints (k,) names, t (n,) s, q, dq, ddq (n, k) rad, rad/s, rad/s2, gripper (n,) 1 open, 0 closed."""
    with path.open("wb") as file:
        np.savez(
            file,
            joints=np.array(joint_names),
            t=samples.t,
            q=samples.q,
            dq=samples.qd,
            ddq=samples.qdd,
            gripper=samples.gripper,
        )
