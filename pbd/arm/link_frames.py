"""The pose of each of an arm's links in its parent link: the tree of frames that ROS calls TF."""

from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel, from_se3
from pbd.pose import Array, Pose


def links_in_parents(arm: ArmModel, q: Array, opening: float) -> dict[str, tuple[str, Pose]]:
    """Return the parent of each link and T_parent_link, at joints (k,) and a gripper opening; the root is left out."""
    data = arm.full.createData()
    pin.framesForwardKinematics(arm.full, data, arm.configurations(np.append(q, opening)))
    return {
        link: (parent, from_se3(data.oMf[above].inverse() * data.oMf[i])) for link, i, parent, above in link_tree(arm)
    }


@lru_cache(maxsize=16)
def link_tree(arm: ArmModel) -> tuple[tuple[str, int, str, int], ...]:
    """Return each link's name and frame index, and those of its parent link; the root is left out."""
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
