"""What a motion is planned for: keyframes, a robot, its surroundings and options, and what follows from these alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pbd.cache import cached_by_thread
from pbd.calibration.demonstrated_path import DemonstratedMove, demonstrated_moves
from pbd.calibration.dock import place_in_base
from pbd.calibration.tool_poses import KeyframesInBase, with_table
from pbd.calibration.touch_up import touched_poses
from pbd.data import Calibration, GraspedObject, HandPath, Keyframe, Robot
from pbd.errors import CalibrationError, PlanError
from pbd.lazy import cached_property
from pbd.planning.object_frames import place_things
from pbd.planning.options import PlanOptions
from pbd.pose import Array, Pose

if TYPE_CHECKING:
    from pbd.arm.collision.scene import CollisionScene
    from pbd.arm.model import ArmModel
    from pbd.arm.motion_request import MotionRequest


@dataclass(frozen=True, eq=False)
class PlanningTask:
    """The arguments of `plan_keyframes`, and what follows from them, each computed when it is first needed.

    `no_free_motion`: it is known that there is none, so with `allow_collision` it is not searched for again.
    """

    keyframes: tuple[Keyframe, ...]
    calibration: Calibration
    robot: Robot
    hand_path: HandPath | None
    grasped: GraspedObject | None
    options: PlanOptions
    no_free_motion: bool = False

    @property
    def arm(self) -> ArmModel:
        """The robot's model."""
        return arm_of(self.robot)

    @property
    def scene(self) -> CollisionScene:
        """The bodies that can touch."""
        return scene_of(self.arm, self.calibration, self.grasped)

    @cached_property
    def q_start(self) -> Array:
        """The joints (k,) at which the arm starts, rad; PlanError if they are not within its limits."""
        start, names, limits = self.options.start, self.robot.joints, self.robot.limits
        if start is None:
            return self.robot.home
        q = np.array(start)
        if len(q) != len(names) or not np.isfinite(q).all():
            what = f"the start must give {len(names)} numbers, in rad (m where a joint slides), for {', '.join(names)}"
            raise PlanError(what, value=start)
        for i, (name, value, lower, upper) in enumerate(zip(names, q, limits.lower, limits.upper, strict=True)):
            if not lower <= value <= upper:
                unit, other = ("rad", "in degrees with --units deg") if self.arm.turns[i] else ("m", "with --units mm")
                raise PlanError(
                    f"the start has {name} at {value:.4g} {unit}, outside its limits of {lower:.4g} to {upper:.4g}; "
                    f"give the arm's present joints in {unit}, or {other}",
                    joint=name,
                    value=float(value),
                    bound=float(lower if value < lower else upper),
                )
        return q

    @cached_property
    def placed(self) -> KeyframesInBase:
        """The keyframes in base.

        Raises:
            CalibrationError: the calibration is for other robots, or as `place_in_base`.
        """
        calibration, robot = self.calibration, self.robot
        if calibration.robots and robot.name not in calibration.robots:
            raise CalibrationError(
                f"the calibration '{calibration.name}' is for {', '.join(calibration.robots)}, not for {robot.name}; "
                "choose another, or add the robot to it",
                value=robot.name,
            )
        return place_in_base(self.keyframes, calibration, self.options.scale, self.hand_path, self.options.orientation)

    @cached_property
    def T_base_tool(self) -> tuple[Pose, ...]:
        """The tool's pose in base at each keyframe, with nudges, touch-ups and places of things."""
        return place_things(touched_poses(self.placed), self.keyframes, self.options.at)

    @cached_property
    def hand_moves(self) -> tuple[DemonstratedMove, ...]:
        """The demonstrated move to each keyframe but the first; there must be a path."""
        assert self.hand_path is not None
        at, how = (self.placed.T_base_nav, self.T_base_tool), (self.options.scale, self.options.orientation == "fixed")
        return demonstrated_moves(self.hand_path, self.keyframes, *at, self.placed.calibration, *how)

    @cached_property
    def request(self) -> MotionRequest:
        """The request for a motion."""
        from pbd.arm.motion_request import DEMO, LINE, STRAIGHT, MotionRequest

        return MotionRequest(
            self.T_base_tool,
            self.q_start,
            self.options.approach,
            self.robot.home if self.options.retreat else None,
            {"keyframes": STRAIGHT, "line": LINE, "demo": DEMO}[self.options.path],
            None if self.hand_path is None else lambda: [move.T_base_tool for move in self.hand_moves],
            self.options.tolerance_m,
            self.options.detour,
            [keyframe.grip for keyframe in self.keyframes],
        )


def load_robot_and_calibration(robot: str, calibration: str | None = None) -> tuple[Robot, Calibration]:
    """Load a robot, and its calibration: the one named, else the robot's own dock, else the default.

    Raises:
        RobotError, CalibrationError: one can't be loaded.
    """
    from pbd.files.calibration import load_calibration
    from pbd.files.robot import load_robot

    loaded = load_robot(robot)
    if calibration is None and loaded.dock is not None:
        return loaded, loaded.dock
    return loaded, with_table(load_calibration(calibration or "default"), loaded)


@cached_by_thread
def arm_of(robot: Robot) -> ArmModel:
    """Load a robot's model; cached."""
    from pbd.arm.model import load_model

    return load_model(robot)


@cached_by_thread
def scene_of(arm: ArmModel, calibration: Calibration, grasped: GraspedObject | None) -> CollisionScene:
    """Build a collision scene; cached."""
    from pbd.arm.collision.scene import CollisionScene

    return CollisionScene(arm, calibration.table_height, calibration.obstacles, grasped)
