"""Estimate the sensor's mount on the tool: the lever by pivoting the tip on a point, the rotation by named turns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.calibration.gyro import LEAST_TURN
from pbd.calibration.points import TIP_SIGMA_M
from pbd.calibration.registration import observe_points, widened
from pbd.data import Keyframe
from pbd.data.covariance import PoseCovariance
from pbd.data.keyframe import require_keyframes
from pbd.errors import CalibrationError, UsageError, amount, in_degrees
from pbd.pose import Array, quat_from_xyzw, quat_inverse, quat_log, quat_multiply, quat_rotate, quat_to_matrix

LARGEST_SIGMA_M = 0.01
"""Largest accepted sigma of the lever along any axis, m. Turning about one axis only exceeds it."""

LARGEST_TURN = np.radians(135.0)
"""Largest turn, rad, whose direction is certain: one beyond half a turn looks like a smaller one the other way."""

TURN_BY_HAND_SIGMA = np.radians(2.0)
"""One sigma, rad, of the axis when a hand turns a tool about one of the tool's axes. Tracking is more accurate."""

MISNAMED_RAD = np.radians(20.0)
"""Largest angle, rad, between a turn's axis and the axis that the user named."""

AXES = dict(zip(("x", "y", "z", "-x", "-y", "-z"), (*np.eye(3), *-np.eye(3)), strict=True))


@dataclass(frozen=True, eq=False)
class PivotFit:
    """The lever from the sensor to the tip.

    Attributes:
        p_sensor_tip: (3,) m in sensor axes.
        cov: (3, 3) m2.
        residuals: (k, 3) m in nav, point minus tip at each stop.
        chi2: chi-square per degree of freedom; 1 is expected if the tracker's sigmas are right.
    """

    p_sensor_tip: Array
    cov: Array
    residuals: Array
    chi2: float


@dataclass(frozen=True, eq=False)
class TurnsFit:
    """The rotation from tool to sensor.

    Attributes:
        wxyz_sensor_tool: (4,).
        cov: (3, 3) rad2, covariance of the rotation vector in sensor axes.
        off: (m,) rad, angle between each turn's measured axis and its named axis.
        turned: (m,) rad, the angle of each turn.
        moves: (m,) index of the move of each turn.
    """

    wxyz_sensor_tool: Array
    cov: Array
    off: Array
    turned: Array
    moves: tuple[int, ...]


def fit_pivot(keyframes: Sequence[Keyframe], covariance: PoseCovariance, scale: float = 1.0) -> PivotFit:
    """Estimate the lever l: while the tip stands on a point c of nav, p_k + R_k l = c at every stop k.

    Linear least squares in l and c, with the joint covariance of all stops. Errors of bias or scale turn with
    the sensor and look like a lever; through the joint covariance, the lever's sigma includes them. The covariance of
    R_k l needs the lever, so there is a second pass.

    Source: Z. Yaniv, Which pivot calibration?, Proc. SPIE 9415, 2015 ("algebraic one step").

    Args:
        keyframes: a path's keyframes, not conditioned on known places. At all of them the tip stood on the point.
        covariance: the path's joint covariance of the poses at its stops.
        scale: the calibration's factor on the hand's positions, and so on the lever that they show.

    Raises:
        CalibrationError: too few stops, turns about one axis only, or the tip slipped.
    """
    require_keyframes(keyframes)
    if len(keyframes) < 3:
        raise CalibrationError(
            f"only {amount(len(keyframes), 'stop')} found; rest with the tip on the point, tilt the tool, rest, "
            "tilt it another way, rest: six to ten times",
            value=len(keyframes),
            bound=3,
        )
    R = quat_to_matrix(np.array([keyframe.T_nav_sensor.wxyz for keyframe in keyframes]))
    design = np.hstack((-R.reshape(-1, 3), np.tile(np.eye(3), (len(keyframes), 1))))  # p = -R l + c
    lever = np.zeros(3)
    for _ in range(2):
        touched = observe_points(keyframes, covariance, lever)
        root = np.linalg.cholesky(touched.cov + TIP_SIGMA_M**2 * np.eye(3 * len(keyframes)))
        whitened = np.linalg.solve(root, design)
        information = whitened.T @ whitened
        if np.linalg.eigvalsh(information)[0] < 1.0:  # 1/m2: a sigma of more than a metre
            raise _undetermined_lever(R)
        right = np.linalg.solve(root, touched.p_nav_sensor.ravel())
        found = np.linalg.solve(information, whitened.T @ right)
        lever = found[:3]
    chi2 = float(((right - whitened @ found) ** 2).sum())
    freedom = 3 * len(keyframes) - 6
    cov = widened(np.linalg.inv(information)[:3, :3], chi2, freedom)
    if (sigma_m := float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))) > LARGEST_SIGMA_M:
        raise _undetermined_lever(R, sigma_m)
    residuals = (design @ found).reshape(-1, 3) - touched.p_nav_sensor
    if chi2 / freedom > 10.0:  # it moved about three times as far as the tracker's sigmas allow
        off = np.linalg.norm(residuals, axis=1)
        raise CalibrationError(
            f"the tip did not stay on one point: at stop {int(off.argmax())} it seems to be "
            f"{100.0 * off.max():.1f} cm off; keep the tip on the point from beginning to end, and pivot again",
            stop=int(off.argmax()),
            value=float(off.max()),
        )
    return PivotFit(scale * lever, scale**2 * cov, scale * residuals, chi2 / freedom)


def _undetermined_lever(R: Array, sigma_m: float = np.inf) -> CalibrationError:
    """Return the error that says along which axis the lever is not determined, because all turns were about it."""
    change = (R - R[0]).reshape(-1, 3)
    _, size, axes = np.linalg.svd(change)
    turned = float(size[2] / np.sqrt(len(R)))
    x, y, z = np.round(axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))]), 1) + 0.0
    known = "is unknown" if sigma_m == np.inf else f"is uncertain by {100.0 * sigma_m:.1f} cm (one sigma)"
    return CalibrationError(
        f"the tool's lever along ({x:g}, {y:g}, {z:g}) in the sensor's axes {known}: the hand turned too little about "
        f"the other axes (about {in_degrees(turned)}); tilt the tool by 30 degrees and more to all sides, and turn it, "
        "with its tip on the point",
        value=sigma_m,
        bound=LARGEST_SIGMA_M,
    )


def fit_turns(keyframes: Sequence[Keyframe], named: Sequence[str]) -> TurnsFit:
    """Estimate the rotation of the sensor on the tool, from turns about known axes of the tool.

    The axis of each turn in sensor axes is R_sensor_tool times the named axis of the tool. That is Wahba's problem,
    solved in closed form (Kabsch 1976, by scipy).

    Args:
        keyframes: the stops between the turns.
        named: for each move that turns by 20 degrees or more, in order, the tool's axis of the turn, x, y, z, -x, -y
            or -z, by the right-hand rule.

    Raises:
        CalibrationError: the numbers of turns and names differ, all turns are about one axis, or they contradict their
            names.
        UsageError: a name is none of these axes.
    """
    require_keyframes(keyframes)
    if unknown := [name for name in named if name not in AXES]:
        raise UsageError(f"a turn is about one of {', '.join(AXES)}, got {unknown[0]!r}", value=unknown[0])
    from scipy.spatial.transform import Rotation

    wxyz = np.array([keyframe.T_nav_sensor.wxyz for keyframe in keyframes])
    vectors = quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:]))
    angles = np.linalg.norm(vectors, axis=1)
    moves = tuple(int(k) for k in np.flatnonzero(angles > LEAST_TURN))
    if len(moves) != len(named):
        found = ", ".join(f"{np.degrees(angles[k]):.0f}" for k in moves) or "none"
        turn = "turns" if len(moves) == 1 else "turn"
        raise CalibrationError(
            f"--turns names {amount(len(named), 'turn')}, but {amount(len(moves), 'move')} {turn} by 20 degrees or "
            f"more ({found}); name each in order, such as --turns x,-x,y",
            value=len(moves),
            bound=len(named),
        )
    if angles[largest := int(angles.argmax())] > LARGEST_TURN:
        raise CalibrationError(
            f"move {largest} turns by {np.degrees(angles[largest]):.0f} degrees, so its direction is uncertain; turn "
            "the tool by 30 to 90 degrees each time",
            move=largest,
            value=float(angles[largest]),
            bound=LARGEST_TURN,
        )
    if len({name.strip("-") for name in named}) < 2:
        raise CalibrationError(
            f"all turns are about {', '.join(sorted(set(named)))}, so the rotation about that axis stays unknown; add "
            "a turn about a second axis"
        )
    angles = angles[list(moves)]
    measured, axes = vectors[list(moves)] / angles[:, None], np.array([AXES[name] for name in named])
    rotation, _ = Rotation.align_vectors(measured, axes)
    wxyz_sensor_tool = quat_from_xyzw(rotation.as_quat())
    expected = quat_rotate(wxyz_sensor_tool, axes)
    off = np.arctan2(np.linalg.norm(np.cross(measured, expected), axis=1), np.einsum("mi,mi->m", measured, expected))
    worst = int(off.argmax())
    if off[worst] > MISNAMED_RAD:
        raise CalibrationError(
            f"the turns contradict --turns: the one about {named[worst]} (move {moves[worst]}) is "
            f"{np.degrees(off[worst]):.0f} degrees off; correct its axis or sign in --turns, or record the turns again",
            move=moves[worst],
            value=float(off[worst]),
            bound=MISNAMED_RAD,
        )
    chi2, freedom = float(((off / TURN_BY_HAND_SIGMA) ** 2).sum()), 2 * len(moves) - 3
    across = (np.eye(3) - np.einsum("mi,mj->mij", expected, expected)).sum(axis=0)
    cov = widened(TURN_BY_HAND_SIGMA**2 * np.linalg.inv(across), chi2, freedom)
    return TurnsFit(wxyz_sensor_tool, cov, off, angles, moves)
