"""Values that `pbd.view.scene.build` draws: those of a plan, and others computed from them."""

from dataclasses import dataclass
from typing import NamedTuple

from pbd.data import Calibration, GraspedObject, JointTrajectory, Keyframe, Robot
from pbd.data.world import ObjectPhase
from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.pose import Array, Pose
from pbd.view.robot_motion import RobotMotion


class Rod(NamedTuple):
    """The capsule that collision checks use where the robot's model has no gripper.

    Attributes:
        T_tool_rod: pose of its middle in the tool frame; the rod lies along z.
        diameter, length: m, of its cylinder; a hemisphere closes each end.
    """

    T_tool_rod: Pose
    diameter: float
    length: float


class TouchingPair(NamedTuple):
    """Two bodies that touch during the motion.

    Attributes:
        bodies: names of links, of obstacles, of the table, of the grasped object, or THE_TOOL.
        start, end: s, first and last instant of contact.
    """

    bodies: tuple[str, str]
    start: float
    end: float
    message: str


@dataclass(frozen=True, eq=False)
class ReplayScene(Frozen):
    """The values that a replay shows: those of a plan, and others computed from them.

    Attributes:
        motion: the motion of all links, fingers included, during the trajectory.
        keyframes: k, as demonstrated; the arm reaches them at `trajectory.keyframe_t`.
        T_base_tool: (k) the tool's pose at each keyframe.
        cov: (k, 6, 6) m and rad, covariance of those positions and rotation vectors in base, from tracking and
            touch-ups.
        tolerance: (k, 3, 3) m2 in base, the square of the keyframes' `tolerance_m`; NaN where there is none.
        inside: (k,) probability that the tool is within the keyframe's tolerance.
        off_rad: (k, 2) rotations that an arm with too few joints misses there: of its approach axis, and about it.
        hand_path_base: (n, 3) m, where the hand would have carried the tool.
        hand_speed: (n,) m/s, along that path.
        phases: where the grasped object is, by time; empty where nothing is grasped.
        rod: None where the model has a gripper.
        slides: (j) whether each joint is a sliding one; empty: none is.
        torque: largest share of a joint's torque limit; None where no limit is known.
        detours: start and end, s, of each detour around an obstacle on the way to the next keyframe, or home.
        contacts: in the order in which they begin; empty unless collisions were allowed.
        notes: the size if not the hand's, the demonstration's own notes, and the probability that all keyframes are
            within their tolerances.
        warnings: what was warned of while the motion was planned.
    """

    title: str
    robot: Robot
    trajectory: JointTrajectory
    motion: RobotMotion
    calibration: Calibration
    keyframes: tuple[Keyframe, ...]
    T_base_tool: tuple[Pose, ...]
    cov: Array
    tolerance: Array
    inside: Array
    off_rad: Array
    hand_path_base: Array
    hand_speed: Array
    grasped: GraspedObject | None = None
    phases: tuple[ObjectPhase, ...] = ()
    rod: Rod | None = None
    slides: tuple[bool, ...] = ()
    torque: float | None = None
    detours: tuple[tuple[float, float], ...] = ()
    contacts: tuple[TouchingPair, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k, n = len(self.keyframes), len(self.hand_path_base)
        freeze_arrays(
            self,
            cov=(k, 6, 6),
            tolerance=(k, 3, 3),
            inside=(k,),
            off_rad=(k, 2),
            hand_path_base=(n, 3),
            hand_speed=(n,),
        )
