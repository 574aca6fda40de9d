"""Where an arm's links are, each in its parent: the tree of frames that ROS calls TF."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel, from_se3
from pbd.pose import Array, Pose


def links_in_parents(arm: ArmModel, q: Array, opening: float) -> dict[str, tuple[str, Pose]]:
    """Return each link's parent and its pose there, at joints (k,) and an opening; the root has none."""
    data = arm.full.createData()
    pin.framesForwardKinematics(arm.full, data, arm.configurations(np.append(q, opening)))
    return {link: (parent, from_se3(data.oMf[above].inverse() * data.oMf[i])) for link, i, parent, above in _tree(arm)}


@lru_cache(maxsize=4)
def _tree(arm: ArmModel) -> tuple[tuple[str, int, str, int], ...]:
    """Each link and its parent, by name and by frame."""
    found, frames = [], arm.full.frames
    for i, frame in enumerate(frames):
        if frame.type != pin.FrameType.BODY:
            continue
        above = frame.parentFrame
        while above > 0 and frames[above].type != pin.FrameType.BODY:
            above = frames[above].parentFrame
        if above > 0:
            found.append((frame.name, i, frames[above].name, above))
    return tuple(found)
