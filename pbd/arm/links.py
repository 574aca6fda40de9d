"""Where an arm's links are, each in its parent: the tree of frames that ROS calls TF."""

from __future__ import annotations

import pinocchio as pin

from pbd.arm.model import ArmModel, from_se3
from pbd.pose import Array, Pose


def links_in_parents(arm: ArmModel, q: Array, opening: float) -> dict[str, tuple[str, Pose]]:
    """Return each link's parent and its pose there, at joints (k,) and an opening; the root has none."""
    model, data = arm.full, arm.full.createData()
    pin.framesForwardKinematics(model, data, arm.full_q(q, opening))
    found = {}
    for i, frame in enumerate(model.frames):
        if frame.type != pin.FrameType.BODY:
            continue
        above = frame.parentFrame
        while above > 0 and model.frames[above].type != pin.FrameType.BODY:
            above = model.frames[above].parentFrame
        if above > 0:
            found[frame.name] = (model.frames[above].name, from_se3(data.oMf[above].inverse() * data.oMf[i]))
    return found
