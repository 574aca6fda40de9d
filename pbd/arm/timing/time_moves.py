"""Time the moves from keyframe to keyframe, each from rest to rest, as fast as the limits allow.

A move is straight in joint space, point to point (PTP), or follows a curve (path_smoothing.py). The arm stops at each
keyframe.

For a straight move ruckig plans one degree of freedom, the distance along the line, so that all joints keep their
limits. With one degree of freedom per joint, the move would often not be straight. A joint's cubic pieces are ruckig's,
times a factor. Ruckig's waypoints are not used, since they call a web service.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from ruckig import InputParameter, Ruckig, Trajectory

from pbd.arm.model import ArmModel
from pbd.arm.timing.piecewise_cubic import WITHIN, PiecewiseCubic
from pbd.data import JointLimits, JointTrajectory
from pbd.errors import PlanError, warn
from pbd.pose import Array

APPROACH_SPEED = 0.5
"""Share of the limits for the approach to the first keyframe and for the retreat."""

LEAST_S = 1e-3
"""Shortest duration of a move, s: one period of a fast controller. A move of 1e-9 rad would otherwise take
microseconds, and in a receiver's interpolation the rounding errors of positions would become jerk."""

LEAST_CURVE_RAD = 3e-6
"""Curves on which no joint goes farther than this, rad, are made straight: rounding errors of their positions would
become jumps of the acceleration. It moves the tool of a large arm by 3 um."""

LONGEST_S = 3600.0
"""Longest motion that is planned, s: at 1 kHz it needs about 1 GB."""


@dataclass(frozen=True, eq=False)
class Move:
    """A move from the arm's present joints.

    Attributes:
        q: (n, k) rad, the waypoints; the arm comes to rest at the last.
        curved: follow a smooth curve through the waypoints; else move straight to each, and stop there.
        t: (n + 1,) s, when the demonstration passed the start and each waypoint; a curve is nowhere faster.
        least_s: shortest duration of the move, s.
        share: share of the velocity, acceleration and jerk limits.
    """

    q: Array
    curved: bool = False
    t: Array | None = None
    least_s: float = 0.0
    share: float = 1.0

    def pieces(self, q_start: Array, limits: JointLimits, speed: float, deviation_share: float) -> PiecewiseCubic:
        """Time the move from joints (k,); `speed` multiplies its share of the limits; see `curved_move`."""
        waypoints, factor = np.vstack((q_start, self.q)), speed * self.share
        if self.curved and np.abs(waypoints - q_start).max() > LEAST_CURVE_RAD:
            from pbd.arm.timing.path_smoothing import curved_move  # scipy loads slowly

            timed = curved_move(waypoints, limits, factor, self.t, deviation_share)
        else:
            stops = waypoints[[0, -1]] if self.curved else waypoints
            timed = PiecewiseCubic.join([ptp_move(*ends, limits, factor) for ends in pairwise(stops)])
        if not timed.duration:  # the arm already stands there
            return PiecewiseCubic.hold(q_start, self.least_s)
        return timed.lasting(self.least_s)


def time_moves(
    arm: ArmModel,
    q_start: Array,
    moves: Sequence[Move],
    dwells: Sequence[float],
    grips: Sequence[bool | None],
    *,
    retreat: Move | None = None,
    speed: float = 1.0,
    deviation_share: float = 1.0,
) -> tuple[JointTrajectory, Array]:
    """Time a motion that stops at each keyframe; return it with the durations (n,) of the moves to the keyframes, s.

    The gripper starts open, and moves only while the arm stands still: where it opens or closes, the arm waits at least
    for its stroke.

    Args:
        arm: the arm, with its gripper.
        q_start: (k,) rad, the arm's present joints.
        moves: n, each to the next keyframe.
        dwells: (n,) s to stay at each keyframe.
        grips: (n,) True if the gripper closes there, False if it opens, None if it does not move.
        retreat: the move after the last keyframe, or None.
        speed: share of the velocity, acceleration and jerk limits.
        deviation_share: see `curved_move`.

    Raises:
        PlanError: nothing moves at all, or the motion takes longer than LONGEST_S.
    """
    gripper, q, t, parts = arm.robot.gripper, q_start, 0.0, list[PiecewiseCubic]()

    def add(pieces: PiecewiseCubic) -> float:
        parts.append(pieces)
        # Sum in the same order as the knots below, so that times agree to the last bit.
        return float(np.append(t, pieces.durations).cumsum()[-1])

    gripper_t, opening, begun, ended = [0.0], [1.0], [], []
    for i, (move, dwell, closes) in enumerate(zip(moves, dwells, grips, strict=True)):
        begun.append(t)
        t, q = add(move.pieces(q, arm.limits, speed, deviation_share)), move.q[-1]
        ended.append(t)
        wanted = opening[-1] if closes is None else float(not closes)
        if wanted != opening[-1] and gripper is None:
            warn(f"{arm.robot.name} has no gripper: the grip at keyframe {i} is ignored; add a [gripper] in its TOML")
        elif wanted != opening[-1] and gripper is not None:
            gripper_t += [t, t + gripper.stroke_s]
            opening += [opening[-1], wanted]
            dwell = max(dwell, gripper.stroke_s)
        t = add(PiecewiseCubic.hold(q, dwell))
    if t == 0.0:
        raise PlanError(
            "nothing moves: the arm already stands at every keyframe; demonstrate a motion with two different stops"
        )
    if retreat is not None:
        t = add(retreat.pieces(q, arm.limits, speed, deviation_share))
    if not t <= LONGEST_S:
        message = f"the motion would take {np.ceil(t):.0f} s, at most {LONGEST_S:.0f} can be planned"
        raise PlanError(f"{message}; give a higher --speed, or shorter stays", value=t, bound=LONGEST_S)
    pieces = PiecewiseCubic.join(parts)
    trajectory = JointTrajectory(
        joint_names=arm.robot.joints,
        knots=np.append(0.0, np.cumsum(pieces.durations)),
        coefficients=pieces.coefficients,
        gripper_t=np.array(gripper_t),
        gripper_opening=np.array(opening),
        keyframe_t=np.array(ended),
        keyframe_q=np.array([move.q[-1] for move in moves]),
    )
    return trajectory, np.subtract(ended, begun)


def ptp_move(q_start: Array, q_end: Array, limits: JointLimits, factor: float) -> PiecewiseCubic:
    """Time a straight move in joint space from q_start to q_end (k,), rad, within a share `factor` of the limits."""
    dq = q_end - q_start
    length = float(np.abs(dq).max())
    if length == 0.0:
        return PiecewiseCubic(np.empty(0), np.empty((0, 4, len(dq))))
    direction = dq / length
    moving, wanted, trajectory = dq != 0.0, InputParameter(1), Trajectory(1)
    wanted.target_position = [length]
    for name in ("velocity", "acceleration", "jerk"):
        most = getattr(limits, name)[moving] / np.abs(direction[moving])
        setattr(wanted, f"max_{name}", [WITHIN * factor * float(most.min())])
    Ruckig(1).calculate(wanted, trajectory)
    profile = trajectory.profiles[0][0]
    durations = np.array(profile.t)
    # Seven phases begin at the first seven of eight states; the last state is the end.
    s, v, a, j = (np.array(values)[: len(durations), None] for values in (profile.p, profile.v, profile.a, profile.j))
    coefficients = np.stack((q_start + s * direction, v * direction, a / 2.0 * direction, j / 6.0 * direction), axis=1)
    return PiecewiseCubic.of(durations, coefficients).lasting(LEAST_S)
