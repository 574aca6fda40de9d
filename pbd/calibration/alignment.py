"""Closed-form alignment of two sets of points."""

from __future__ import annotations

import numpy as np

from pbd.pose import Array, Pose, quat_about_z, quat_from_xyzw, quat_rotate


def align(p_from: Array, p_to: Array, free: bool = False) -> Pose:
    """The pose T_to_from that brings points (m, 3) closest to others, in the sum of squares.

    `free` finds any rotation (Kabsch 1976, by scipy). Otherwise both frames have z up, and the yaw is the angle of the
    horizontal cross-covariance.
    """
    from scipy.spatial.transform import Rotation

    middle_from, middle_to = p_from.mean(axis=0), p_to.mean(axis=0)
    if free:
        wxyz = quat_from_xyzw(Rotation.align_vectors(p_to - middle_to, p_from - middle_from)[0].as_quat())
    else:
        cross = (p_to - middle_to).T @ (p_from - middle_from)
        wxyz = quat_about_z(float(np.arctan2(cross[1, 0] - cross[0, 1], cross[0, 0] + cross[1, 1])))
    return Pose(middle_to - quat_rotate(wxyz, middle_from), wxyz)
