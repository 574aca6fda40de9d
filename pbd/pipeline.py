"""The two verbs: `track` turns a recording into a hand path, `plan` turns a hand path into a joint trajectory."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.frames import nav_in_base, tool_poses
from pbd.data import Attitude, Calibration, HandPath, JointTrajectory, Keyframe, Known, Recording, Robot, Stop
from pbd.errors import CalibrationError, PbdWarning, TrackingError
from pbd.pose import Array, Pose
from pbd.tracking.conditioning import condition, refuse_gaps
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import integrate_path
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.known import condition_on
from pbd.tracking.orientation import estimate_attitude, mean_quaternion
from pbd.tracking.paper import paper_acceleration, paper_attitude, paper_covariance, paper_path, paper_stops
from pbd.tracking.rest import Rest, find_rest, rest_within
from pbd.tracking.restoring import clip_covariance, restore, settle_velocities
from pbd.tracking.saturation import find_clips
from pbd.tracking.smoothing import smooth_motion
from pbd.tracking.stops import find_stops
from pbd.tracking.uncertainty import stop_covariance, unseen_covariance

if TYPE_CHECKING:
    from pbd.arm.audit import AuditReport
    from pbd.arm.model import ArmModel

OPEN_END_S = 0.2
"""Motion for longer than this at either end of a recording is told."""

UNSURE_M = 0.05
"""A keyframe that is less sure than this is told."""

SHORTEST_DWELL_S = 0.15
"""A keyframe is a stop: the arm stays at least this long."""


METHODS = ("default", "paper")
"""How to track: as well as we can, or as the paper does."""


def track(
    recording: Recording, method: str = "default", known: Known | None = None, calibration: Calibration | None = None
) -> HandPath:
    """Track a hand: attitude, motion acceleration, stops, path.

    Args:
        recording: what the sensor said.
        method: one of METHODS.
        known: what is known of the stops (a demonstration's `known`): places, heights.
        calibration: for what is known in the robot's base, and the lever from sensor to tool.

    Raises:
        RecordingError: the recording can't be one (units, clock, no data).
        TrackingError: no path follows from it (never still, data missing in a move), or what is known contradicts it.
    """
    recording, gaps = condition(recording)
    clips = find_clips(recording)
    if method == "default":
        recording, clips = restore(recording, clips)
    rest = find_rest(recording)
    if method == "paper":
        attitude = paper_attitude(recording)
        a_nav = paper_acceleration(recording, attitude, rest.gravity)
        stops = paper_stops(recording.t, a_nav)
    elif method == "default":
        rest, attitude, a_nav, stops = find_motion(recording, rest)
        a_nav, clips = settle_velocities(recording.t, a_nav, attitude.wxyz_nav_sensor, stops, clips)
    else:
        raise TrackingError(f"no method '{method}'; known are {', '.join(METHODS)}", value=method)
    if not stops:
        raise TrackingError("the hand never stands still; stop for half a second between the moves")
    refuse_gaps(gaps, recording.t, stops)
    _warn_of_open_ends(recording.t, stops)
    if method == "paper":
        p, v, closure = paper_path(recording.t, a_nav, stops)
        cov = paper_covariance(recording.t, stops, closure)
    else:
        p, v, closure = integrate_path(recording.t, a_nav, stops)
        cov = stop_covariance(recording, a_nav, p, stops, closure, rest)
        cov[:, :3, :3] += unseen_covariance(gaps, stops)
        cov += clip_covariance(recording.t, a_nav, attitude.wxyz_nav_sensor, p, stops, clips)
    path = HandPath(
        t=recording.t,
        p_nav_sensor=p,
        v_nav_sensor=v,
        wxyz_nav_sensor=attitude.wxyz_nav_sensor,
        stops=stops,
        closure=closure,
        cov=cov,
        grip=recording.grip,
    )
    return path if known is None else _condition(path, known, calibration)


def find_motion(recording: Recording, rest: Rest) -> tuple[Rest, Attitude, Array, tuple[Stop, ...]]:
    """Attitude, motion acceleration and stops of a conditioned recording; and the rest, which a stop must hold.

    Raises:
        TrackingError: no attitude, no rest.
    """
    for _ in range(3):
        attitude = estimate_attitude(recording, slice(rest.start, rest.stop))
        a_nav = motion_acceleration(recording, attitude, rest.gravity)
        stops = find_stops(recording, a_nav, attitude.wxyz_nav_sensor, rest)
        held = rest_within(recording, rest, stops) if stops else rest
        if held is rest:
            break
        rest = held  # what is taken for quiet follows from it: look again
    return rest, *smooth_motion(recording, attitude, a_nav, stops, rest), stops


def _condition(path: HandPath, known: Known, calibration: Calibration | None) -> HandPath:
    if calibration is None:
        return condition_on(path, known)
    first = slice(path.stops[0].start, path.stops[0].stop)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)  # of the dock's tilt: planning tells it
        T_base_nav = nav_in_base(calibration, mean_quaternion(path.wxyz_nav_sensor[first]))
    return condition_on(path, known, calibration, T_base_nav)


def _warn_of_open_ends(t: Array, stops: tuple[Stop, ...]) -> None:
    before, after = float(t[stops[0].start] - t[0]), float(t[-1] - t[stops[-1].stop - 1])
    if before > OPEN_END_S:
        warnings.warn(
            f"the hand moves when the recording starts; its first rest, at {before:.1f} s, is taken for the dock",
            PbdWarning,
            stacklevel=3,
        )
    if after > OPEN_END_S:
        warnings.warn(
            f"the hand moves when the recording ends: the last {after:.1f} s lead to no keyframe",
            PbdWarning,
            stacklevel=3,
        )


@dataclass(frozen=True)
class PlanOptions:
    """What a user may choose about the motion.

    Attributes:
        scale: multiplies the hand's positions.
        orientation: "demo", or "fixed": the tool's z straight down throughout.
        speed: above 0, at most 1: a factor on the velocity, acceleration and jerk limits.
        dwell_s: the longest stay at a keyframe.
        approach: start at the robot's home, rather than at keyframe 0.
    """

    scale: float = 1.0
    orientation: str = "demo"
    speed: float = 1.0
    dwell_s: float = 0.5
    approach: bool = True


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion that has passed the audit, and what it was made from."""

    keyframes: tuple[Keyframe, ...]
    calibration: Calibration
    T_base_nav: Pose
    T_base_tool: tuple[Pose, ...]
    trajectory: JointTrajectory
    report: AuditReport


def plan(
    hand_path: HandPath, calibration: Calibration, robot: Robot, options: PlanOptions | None = None
) -> JointTrajectory:
    """Plan the motion of a robot through the stops of a hand path, audited.

    Raises:
        TrackingError: fewer than two stops.
        CalibrationError: the calibration is for other robots.
        PlanError: a keyframe is out of reach, or the motion breaks a limit.
    """
    return plan_keyframes(find_keyframes(hand_path), calibration, robot, options).trajectory


def plan_keyframes(
    keyframes: Sequence[Keyframe], calibration: Calibration, robot: Robot, options: PlanOptions | None = None
) -> Plan:
    """Plan the motion of a robot through keyframes; raises as `plan` does."""
    from pbd.arm.audit import audit
    from pbd.arm.model import load_model
    from pbd.arm.timing import time_keyframes

    options = options or PlanOptions()
    if len(keyframes) < 2:
        raise TrackingError(
            f"the demonstration has {len(keyframes)} stop, a motion needs two; hold still, move, and hold still again",
            value=len(keyframes),
            bound=2,
        )
    scale = options.scale * calibration.scale
    sigma = scale * max(float(np.sqrt(np.linalg.eigvalsh(keyframe.cov[:3, :3]).max())) for keyframe in keyframes)
    if sigma > UNSURE_M:
        warnings.warn(
            f"the least sure keyframe has a sigma of {100.0 * sigma:.0f} cm; stop more often, for half a second each",
            PbdWarning,
            stacklevel=2,
        )
    arm = load_model(robot)
    T_base_nav, T_base_tool, q_keyframes = solve_keyframes(arm, keyframes, calibration, options)
    inner = [min(max(keyframe.dwell_s, SHORTEST_DWELL_S), options.dwell_s) for keyframe in keyframes[1:-1]]
    trajectory = time_keyframes(
        arm,
        q_keyframes,
        dwells=[0.0, *inner, 0.0],
        grips=[keyframe.grip for keyframe in keyframes],
        q_start=robot.home,
        speed=options.speed,
        approach=options.approach,
    )
    report = audit(trajectory, robot.limits, arm, T_base_tool)
    return Plan(tuple(keyframes), calibration, T_base_nav, T_base_tool, trajectory, report)


def solve_keyframes(
    arm: ArmModel, keyframes: Sequence[Keyframe], calibration: Calibration, options: PlanOptions
) -> tuple[Pose, tuple[Pose, ...], Array]:
    """Return T_base_nav, the tool's pose in base at each keyframe, and the joints (n, k) that reach them."""
    from pbd.arm.sequence import solve_sequence

    if calibration.robots and arm.robot.name not in calibration.robots:
        raise CalibrationError(
            f"the calibration '{calibration.name}' is for {', '.join(calibration.robots)}, not for {arm.robot.name}; "
            "choose another, or add the robot to it",
            value=arm.robot.name,
        )
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    T_base_tool = tool_poses(keyframes, T_base_nav, calibration, options.scale, options.orientation)
    return T_base_nav, T_base_tool, solve_sequence(arm, T_base_tool, arm.robot.home)
