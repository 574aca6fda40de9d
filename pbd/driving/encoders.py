"""Converts joint positions to the servos' encoder counts and back, as LeRobot's calibration defines them."""

from collections.abc import Mapping

import numpy as np

from pbd.data import Robot
from pbd.errors import CalibrationError, PlanError, RobotError, amount
from pbd.files.servo_calibration import COUNTS, ServoCalibration
from pbd.pose import Array

SHORTEST_SHARE, LONGEST_SHARE = 0.6, 1.4
"""Smallest and largest calibrated range of a joint, as a share of the model's range (of published calibrations: 0.9 to
1.1, the gripper's up to 1.3). With less, the joint was not moved to both ends; with more, it did not begin in its
middle, and its encoder passed from 4095 to 0. Both make its zero, the middle of the range, wrong."""


class Encoders:
    """The calibrated encoders of an arm's k joints and, last, of its gripper.

    Attributes:
        names: names of the servos, base to gripper.
        servos, ids: their calibration by name, and their ids on the bus, in the order of `names`.
        stroke_s: duration of the gripper's full stroke, s.
        lower, upper: (k + 1,) ends of the calibrated range, counts.
    """

    def __init__(self, robot: Robot, servos: Mapping[str, ServoCalibration]) -> None:
        """Check the calibration.

        Raises:
            RobotError: LeRobot does not know this arm.
            CalibrationError: a range is too short or too long, or a joint's direction is reversed.
        """
        if robot.servos is None or robot.gripper is None:
            raise RobotError(f"{robot.name} has no [servos]: LeRobot does not know this arm; use `pbd export`")
        self._conversion, self._gripper = robot.servos, robot.gripper
        self.names, self.stroke_s = servo_names(robot), robot.gripper.stroke_s
        self.servos = {name: servos[name] for name in self.names}
        self.ids = tuple(servo.id for servo in self.servos.values())
        self.lower = np.array([servo.range_min for servo in self.servos.values()])
        self.upper = np.array([servo.range_max for servo in self.servos.values()])
        self._middle = 0.5 * (self.lower + self.upper)[:-1]
        widths = np.degrees([*(robot.limits.upper - robot.limits.lower), abs(np.subtract(*robot.servos.gripper))])
        for name, full, counts in zip(self.names, widths, self.upper - self.lower, strict=True):
            if self.servos[name].drive_mode and name in robot.joints:
                what = f"drive_mode of {name} is 1, which LeRobot ignores, so it is uncertain which way the joint turns"
                raise CalibrationError(f"{what}; calibrate anew with `pbd run --calibrate --robot R`", joint=name)
            found = 360.0 * counts / COUNTS
            if not SHORTEST_SHARE * full <= found <= LONGEST_SHARE * full:
                degrees = amount(found, "degree", ".0f")
                what = f"the calibration found a range of {degrees} for {name}; the model has {full:.0f}"
                advice = "begin in its middle, and move it from stop to stop"
                raise CalibrationError(f"{what}: calibrate anew, {advice}", joint=name)

    def from_joints(self, q: Array, opening: Array) -> Array:
        """Convert joint positions (n, k) rad and gripper openings (n,), 0 closed to 1 open, to counts (n, k + 1)."""
        arm = self._middle + self._conversion.to_degrees(q) * COUNTS / 360.0
        percent = np.clip(self._conversion.to_percent(self._gripper.positions(opening)[:, 0]), 0.0, 100.0)
        if self.servos[self.names[-1]].drive_mode:
            percent = 100.0 - percent
        fingers = self.lower[-1] + percent / 100.0 * (self.upper[-1] - self.lower[-1])
        return np.column_stack([arm, fingers])

    def to_joints(self, counts: Array) -> Array:
        """Convert counts (..., k + 1) to joint positions (..., k) rad."""
        return self._conversion.to_radians((counts[..., :-1] - self._middle) * 360.0 / COUNTS)

    def gripper_percent(self, counts: Array) -> Array:
        """Convert counts (..., k + 1) to the gripper's opening (...), 0 closed to 100 open."""
        share: Array = 100.0 * (counts[..., -1] - self.lower[-1]) / (self.upper[-1] - self.lower[-1])
        return 100.0 - share if self.servos[self.names[-1]].drive_mode else share

    def check_range(self, t: Array, counts: Array) -> None:
        """Refuse a motion (n, k + 1) that leaves the calibrated range, where the servo would stop.

        Raises:
            PlanError: names the first joint that leaves it, and when.
        """
        beyond = np.maximum(counts - self.upper, self.lower - counts) - 1.0  # rounding may exceed it by one count
        if not (beyond > 0.0).any():
            return
        row, joint = np.argwhere(beyond > 0.0)[0]
        by = 360.0 * (beyond[:, joint].max() + 1.0) / COUNTS
        raise PlanError(
            f"{self.names[joint]} would go {by:.1f} degrees beyond the range that its calibration found, first after "
            f"{t[row]:.2f} s; calibrate it from stop to stop, or move the dock nearer",
            joint=self.names[joint],
            value=float(counts[row, joint]),
        )


def servo_names(robot: Robot) -> tuple[str, ...]:
    """Names of the servos: the arm's joints, then the gripper's."""
    return robot.joints + (robot.gripper.joints[:1] if robot.gripper else ())
