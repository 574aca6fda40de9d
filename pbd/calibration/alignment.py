"""Closed forms that lay one set of points on another."""

from __future__ import annotations

import numpy as np

from pbd.pose import Array, Pose, quat_about_z, quat_from_matrix


def align(p_from: Array, p_to: Array, free: bool = False) -> Pose:
    """The pose T_to_from that brings points (m, 3) closest to others, in the sum of squares.

    `free` finds any rotation, by singular values (Kabsch 1976; the sign after Umeyama, Least-squares estimation of
    transformation parameters between two point patterns, PAMI 13, 1991). Otherwise both frames have z up, and the yaw
    is the angle of the horizontal cross-covariance.
    """
    middle_from, middle_to = p_from.mean(axis=0), p_to.mean(axis=0)
    cross = (p_to - middle_to).T @ (p_from - middle_from)
    if free:
        U, _, Vt = np.linalg.svd(cross)
        turn = U @ np.diag((1.0, 1.0, np.sign(np.linalg.det(U @ Vt)))) @ Vt
        rotation = Pose(np.zeros(3), quat_from_matrix(turn))
    else:
        yaw = np.arctan2(cross[1, 0] - cross[0, 1], cross[0, 0] + cross[1, 1])
        rotation = Pose(np.zeros(3), quat_about_z(float(yaw)))
    return Pose(middle_to - rotation.act(middle_from), rotation.wxyz)
