"""Observations of points: the tip's positions when it touched them, with their joint covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Keyframe
from pbd.data.covariance import PoseCovariance
from pbd.pose import Array, quat_to_matrix, skew


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Where a demonstration's tip stood when it touched points.

    Attributes:
        p_nav_sensor: (m, 3) m.
        lever: (m, 3) m, from the sensor to the tip, in nav.
        cov: (3 m, 3 m) m2, of the tips' positions together.
        stops: (m,) indices.
    """

    p_nav_sensor: Array
    lever: Array
    cov: Array
    stops: tuple[int, ...]

    def only(self, keep: Sequence[int]) -> PointObservations:
        """Some of them."""
        rows = rows_of(keep)
        return PointObservations(
            self.p_nav_sensor[list(keep)],
            self.lever[list(keep)],
            self.cov[np.ix_(rows, rows)],
            tuple(self.stops[k] for k in keep),
        )


def rows_of(keep: Sequence[int]) -> NDArray[np.intp]:
    """The rows of some touches in a matrix that has three for each."""
    return (3 * np.asarray(keep)[:, None] + np.arange(3)).ravel()


def observe_points(
    keyframes: Sequence[Keyframe], covariance: PoseCovariance, p_sensor_tip: Array, cov_tip: Array | None = None
) -> PointObservations:
    """Where the tip stood at all stops: p + R l. An error of the attitude turns R l, one of l turns with it.

    Args:
        keyframes: all of a path that is not conditioned on known places.
        covariance: the path's, of all of them together.
        p_sensor_tip: (3,) m, the tip l in sensor axes.
        cov_tip: (3, 3) m2, how well the tip is known; None: exactly.
    """
    m, poses = len(keyframes), [keyframe.T_nav_sensor for keyframe in keyframes]
    R = quat_to_matrix(np.array([pose.wxyz for pose in poses]))
    lever = R @ p_sensor_tip
    by_pose = np.concatenate((np.tile(np.eye(3), (m, 1, 1)), -skew(lever)), axis=2)
    joint = covariance.joint(range(m)).reshape(m, 6, m, 6)
    cov = np.einsum("jab,jbkc,kdc->jakd", by_pose, joint, by_pose).reshape(3 * m, 3 * m)
    if cov_tip is not None:
        by_tip = R.reshape(-1, 3)
        cov += by_tip @ cov_tip @ by_tip.T
    return PointObservations(np.array([pose.p for pose in poses]), lever, cov, tuple(range(m)))
