"""The tool's poses in the robot's base frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pbd.data import Calibration, HandPath, Keyframe, Robot
from pbd.data.calibration import TOOL_DOWN
from pbd.data.constraints import CalibrationUpdate
from pbd.pose import Array, Pose, quat_about_z, quat_multiply, quat_rotate, yaw_toward


@dataclass(frozen=True, eq=False)
class KeyframesInBase:
    """Keyframes, with the pose of nav in the robot's base.

    Attributes:
        keyframes: k of them. The first is the first rest, at the dock.
        T_base_nav: nav's pose in base.
        calibration: its own scale multiplies `scale`.
        scale: multiplies p_nav_sensor and nothing else.
        orientation: "demo", or "fixed": the tool keeps the heading of keyframe 0, with its z straight down.
        path: their path, with joint covariance and touch-ups; None: the keyframes' errors are independent.
        update: by which the calibration is corrected; None: it is not.
    """

    keyframes: Sequence[Keyframe]
    T_base_nav: Pose
    calibration: Calibration
    scale: float = 1.0
    path: HandPath | None = None
    orientation: str = "demo"
    update: CalibrationUpdate | None = None


def with_table(calibration: Calibration, robot: Robot) -> Calibration:
    """Return the calibration; if it has no table, with that of the robot's own dock, on which the robot stands."""
    if calibration.table_height is not None or robot.dock in (None, calibration):
        return calibration
    return replace(calibration, table_height=robot.dock.table_height)


def tool_poses(placed: KeyframesInBase) -> tuple[Pose, ...]:
    """Return T_base_tool at each keyframe: T_base_nav @ T_nav_sensor @ T_sensor_tool, with the keyframe's own nudges.

    The path's touch-ups are not applied; see `touched_poses`.
    """
    scale, shown = placed.scale * placed.calibration.scale, [keyframe.T_nav_sensor for keyframe in placed.keyframes]
    sensors = [placed.T_base_nav @ Pose(scale * T_nav_sensor.p, T_nav_sensor.wxyz) for T_nav_sensor in shown]
    tools = [T_base_sensor @ placed.calibration.T_sensor_tool for T_base_sensor in sensors]
    if placed.orientation == "fixed":
        # The tool follows the hand's path at a constant offset, that of keyframe 0.
        lever, wxyz = tools[0].p - sensors[0].p, pointing_down(tools[0].wxyz)
        tools = [Pose(T_base_sensor.p + lever, wxyz) for T_base_sensor in sensors]
    return tuple(
        Pose(tool.p + keyframe.nudge_base_m + quat_rotate(tool.wxyz, keyframe.nudge_tool_m), tool.wxyz)
        for tool, keyframe in zip(tools, placed.keyframes, strict=True)
    )


def pointing_down(wxyz_base_tool: Array) -> Array:
    """Return the rotation with z straight down that is nearest to a tool's."""
    return quat_multiply(quat_about_z(yaw_toward(TOOL_DOWN.wxyz, wxyz_base_tool)), TOOL_DOWN.wxyz)
