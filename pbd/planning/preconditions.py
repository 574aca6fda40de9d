"""Checks before a motion is planned: they refuse, or warn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.dock import TILT_WARNING_DEG
from pbd.data import HandPath, Keyframe
from pbd.data.tracking import UNSURE_SIGMA_M
from pbd.data.world import TABLE_HEIGHT
from pbd.errors import TrackingError, amount, warn
from pbd.planning.options import hand_durations
from pbd.pose import Pose

if TYPE_CHECKING:
    from pbd.arm.collision.scene import CollisionScene
    from pbd.arm.model import ArmModel
    from pbd.arm.motion_request import Motion

NEAR_M, NEAR_RAD = 1e-3, np.radians(1.0)
"""Keyframes that are all within this distance and rotation of the first make no motion."""

OFF_X_COS = float(np.cos(np.radians(45.0)))
"""Cosine of the largest angle, 45 degrees, between the tool's x and the way the jaws open. The bundled arms' swinging
jaws open up to 12 degrees off it."""


def check_count(keyframes: Sequence[Keyframe]) -> None:
    """Refuse fewer than two keyframes (TrackingError)."""
    if len(keyframes) < 2:
        raise TrackingError(
            f"the demonstration has {amount(len(keyframes), 'stop')}, but a motion needs two; hold still, move, and "
            "hold still again",
            value=len(keyframes),
            bound=2,
        )


def spread_error(T_base_tool: Sequence[Pose]) -> TrackingError | None:
    """Return the error if all keyframes lie in one place."""
    away = [T_base_tool[0].distance(pose) for pose in T_base_tool]
    if any(distance >= NEAR_M or angle >= NEAR_RAD for distance, angle in away):
        return None
    return TrackingError(
        f"all {len(T_base_tool)} keyframes lie within {1e3 * NEAR_M:g} mm of the first: nothing moves; "
        "demonstrate again, and move farther between the stops",
        value=max(distance for distance, _ in away),
        bound=NEAR_M,
    )


def check_certainty(keyframes: Sequence[Keyframe], scale: float, path: HandPath | None = None) -> None:
    """Warn of the least certain keyframe, and of the cause; `scale` multiplies positions.

    Raises:
        TrackingError: its standard deviation exceeds the extent of the path.
    """
    variances = [scale**2 * float(np.linalg.eigvalsh(keyframe.cov[:3, :3]).max()) for keyframe in keyframes]
    least_sure, added = int(np.argmax(variances)), np.diff(variances, prepend=0.0)
    if variances[least_sure] <= UNSURE_SIGMA_M**2:
        return
    worst = int(np.argmax(added))
    if worst > 0 and added[worst] > 0.5 * variances[least_sure]:
        duration = hand_durations(keyframes, path)[worst - 1]
        why = f"most of it from the {duration:.1f} s move to keyframe {worst}: pause half a second during that move"
    else:
        why = "from the drift of many moves: end where you began (pbd record --closed), or use known places"
    sigma = float(np.sqrt(variances[least_sure]))
    what = (
        f"keyframe {least_sure} at {keyframes[least_sure].t:.1f} s is uncertain by {100.0 * sigma:.0f} cm (one sigma)"
    )
    p = scale * np.array([keyframe.T_nav_sensor.p for keyframe in keyframes])
    apart = float(np.linalg.norm(p - p[0], axis=1).max())
    if sigma > apart:
        raise TrackingError(
            f"{what}, more than the whole path ({100.0 * apart:.0f} cm): not usable; {why}",
            value=sigma,
            bound=apart,
        )
    warn(f"{what}, {why}")


def warn_of_shapes(arm: ArmModel) -> None:
    """Warn of links without a collision shape, or with one far too small: their contacts may be missed."""
    from pbd.arm.collision.shape_coverage import doubtful_shapes

    if found := doubtful_shapes(arm):
        shapes = "; ".join(f"{link} {why}" for link, why in found.items())
        warn(f"contacts may be missed: {shapes}; correct the shapes in {arm.robot.urdf}")


def warn_of_frames(arm: ArmModel) -> None:
    """Warn if base's z is not that of the URDF's root link; if the jaws close, or don't open along the tool's x."""
    from pbd.arm.gripper import STILL_M, jaw_gap, opening_direction

    name, root = arm.robot.name, arm.full.frames[0].placement  # in base
    if root.rotation[2, 2] < np.cos(np.radians(TILT_WARNING_DEG)):
        off_deg = np.degrees(np.arccos(max(root.rotation[2, 2], -1.0)))
        warn(
            f"z of {name}'s base {arm.robot.base!r} is {off_deg:.0f} degrees off that of the URDF's root link "
            f"{arm.links[0]}, but table, dock and torques need it to point up; name {arm.links[0]}, or another upright "
            "link, as base in [model]"
        )
    if jaw_gap(arm, 0.0) > jaw_gap(arm, 1.0) + STILL_M:
        warn(f"the jaws of {name} are farther apart when closed than when open: exchange open and closed in [gripper]")
    along = opening_direction(arm)
    if along is not None and abs(along[0]) < OFF_X_COS:
        axis = "xyz"[int(np.abs(along).argmax())]
        warn(
            f"the jaws of {name} open along the tool's {axis}, not its x: correct T_body_tool, so that its z "
            "is the way the tool approaches, and its x the way the jaws open"
        )


def warn_of_table(scene: CollisionScene) -> None:
    """Warn if there is no table, and of links that nearly always touch it, so that they are not checked against it."""
    if scene.table_height is None:
        warn(f"no table is checked: write {TABLE_HEIGHT} (m in base; one far below if there is none)")
    if scene.sunk:
        warn(
            f"not checked against the table, since it nearly always touches it: {', '.join(scene.sunk)}; if that is "
            f"wrong, correct {TABLE_HEIGHT}"
        )


def warn_of_wide_moves(arm: ArmModel, motion: Motion) -> None:
    """Warn of wide moves: the tool turns, or leaves the straight line, much more than needed."""
    from pbd.arm.motion_request import STRAIGHT

    wide = [(i, move.wide) for i, move in enumerate(motion.segments) if move.wide is not None and move.kind == STRAIGHT]
    if wide:
        text = ", ".join(
            f"to keyframe {i} it will {deviation}{_turns_back(arm, motion, i)}" for i, deviation in wide[:3]
        )
        more = f", and {len(wide) - 3} more" if len(wide) > 3 else ""
        warn(
            f"the tool goes out of its way: {text}{more}; {arm.robot.name} found no line there, so look at it before it"
            " runs; demonstrate with smaller turns, or place the dock elsewhere"
        )


def _turns_back(arm: ArmModel, motion: Motion, i: int) -> str:
    """Name a joint that turns back by more than half a turn to keyframe i because its range is below a whole turn."""
    travel, ranges = np.abs(motion.q[i] - motion.q[i - 1]), arm.limits.upper - arm.limits.lower
    joint = int(travel.argmax())
    if not arm.turns[joint] or travel[joint] <= np.pi or ranges[joint] >= 2.0 * np.pi:
        return ""
    holds = f"its range of {np.degrees(ranges[joint]):.0f} degrees is no whole turn"
    return f" ({arm.robot.joints[joint]} turns back: {holds})"
