"""Nav into base: the dock, or a registration."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.data import Calibration, Keyframe, Robot
from pbd.errors import CalibrationError, PbdWarning
from pbd.pose import Array, Pose, quat_about_z, quat_inverse, quat_multiply, quat_rotate, yaw_toward

TILT_WARNING_DEG, UPSIDE_DOWN_DEG = 5.0, 150.0


def with_table(calibration: Calibration, robot: Robot) -> Calibration:
    """A calibration that names no table has the one that the robot stands on: its own dock's."""
    if calibration.table_height is not None or robot.dock is None:
        return calibration
    return replace(calibration, table_height=robot.dock.table_height)


def nav_in_base(calibration: Calibration, wxyz_nav_sensor: Array) -> Pose:
    """T_base_nav, from the sensor's attitude (4,) in nav at its first rest.

    With a dock, nav's origin is the dock's position and nav's heading the yaw that brings the measured attitude closest
    to the declared one. Both frames have z up, so the tilt between the two is an error of the dock's declaration or
    of how the sensor was put down: it is warned of, never "corrected".
    """
    if calibration.T_base_nav is not None:
        return calibration.T_base_nav
    dock = calibration.T_base_dock
    if dock is None:
        raise CalibrationError(
            f"the calibration '{calibration.name}' does not say where the hand starts in the robot's base; add a dock: "
            f"pbd calibrate dock {calibration.name} --position X Y Z --rpy R P Y"
        )
    if not calibration.any_attitude:
        tilt_deg = np.degrees(dock_tilt(dock, wxyz_nav_sensor))
        if tilt_deg > UPSIDE_DOWN_DEG:
            raise CalibrationError(
                f"at its first rest the sensor lies upside down compared with the dock of '{calibration.name}'; if the "
                "accelerometer reads -g along the axis that points up, import with --unit acc=-g, else correct rpy_deg "
                "of the dock",
                value=float(tilt_deg),
                bound=UPSIDE_DOWN_DEG,
            )
        if tilt_deg > TILT_WARNING_DEG:
            warnings.warn(
                f"at its first rest the sensor is tilted by {tilt_deg:.0f} degrees from the dock of "
                f"'{calibration.name}'; put it down as the dock says, or set any_attitude = true there",
                PbdWarning,
                stacklevel=2,
            )
    return Pose(dock.p, quat_about_z(yaw_toward(wxyz_nav_sensor, dock.wxyz)))


def dock_tilt(T_base_dock: Pose, wxyz_nav_sensor: Array) -> float:
    """Angle in rad between the vertical as the dock declares it and as the sensor measured it, in sensor axes."""
    z = np.array([0.0, 0.0, 1.0])
    declared = quat_rotate(quat_inverse(T_base_dock.wxyz), z)
    measured = quat_rotate(quat_inverse(wxyz_nav_sensor), z)
    return float(np.arctan2(np.linalg.norm(np.cross(declared, measured)), declared @ measured))


def tool_poses(
    keyframes: Sequence[Keyframe],
    T_base_nav: Pose,
    calibration: Calibration,
    scale: float = 1.0,
    orientation: str = "demo",
) -> tuple[Pose, ...]:
    """T_base_tool at each keyframe: T_base_nav @ T_nav_sensor @ T_sensor_tool.

    Args:
        keyframes: the first one is the first rest, at the dock.
        T_base_nav: of `nav_in_base`.
        calibration: its own scale multiplies `scale`.
        scale: multiplies p_nav_sensor and nothing else.
        orientation: "demo", or "fixed": the tool keeps keyframe 0's heading, its z straight down.
    """
    scale *= calibration.scale
    poses = []
    for keyframe in keyframes:
        T_nav_sensor = keyframe.T_nav_sensor
        scaled = Pose(scale * T_nav_sensor.p, T_nav_sensor.wxyz)
        poses.append(T_base_nav @ scaled @ calibration.T_sensor_tool)
    if orientation == "fixed":
        fixed = pointing_down(poses[0].wxyz)
        # The hand's path is kept, not the tool's: without its turns the tool is carried along rigidly.
        lever = poses[0].p - (T_base_nav @ Pose(scale * keyframes[0].T_nav_sensor.p, fixed)).p
        poses = [Pose(T_base_nav.act(scale * keyframe.T_nav_sensor.p) + lever, fixed) for keyframe in keyframes]
    return tuple(poses)


def pointing_down(wxyz_base_tool: Array) -> Array:
    """Return the rotation with z straight down that is nearest to a tool's."""
    down = np.array([0.0, 1.0, 0.0, 0.0])
    return quat_multiply(quat_about_z(yaw_toward(down, wxyz_base_tool)), down)
