"""Values that `pbd.view.scene.build` draws."""

from __future__ import annotations

from dataclasses import dataclass

from pbd.data import GraspedObject, JointTrajectory, Obstacle, Robot
from pbd.data.frozen_arrays import freeze_arrays
from pbd.data.world import Stay
from pbd.pose import Array, Pose
from pbd.view.robot_motion import RobotMotion


@dataclass(frozen=True, eq=False)
class ReplayKeyframe:
    """A keyframe as the replay shows it.

    Attributes:
        label: a word for people; may be empty.
        t: s, when the arm reaches it.
        cov: (6, 6) m and rad, of the tool's position and rotation vector in base; None where it is unknown.
        grip: True where the gripper closes here, False where it opens.
        weight: how sure the tracker is that the hand stood still, 0 to 1.
        tolerance: (3, 3) m2 in base, the square of what it may be off by; None where nobody has said.
        inside: the probability that the tool is within that; None without one.
    """

    label: str
    t: float
    T_base_tool: Pose
    cov: Array | None = None
    grip: bool | None = None
    weight: float = 1.0
    tolerance: Array | None = None
    inside: float | None = None

    def __post_init__(self) -> None:
        freeze_arrays(self, cov=(6, 6), tolerance=(3, 3))


@dataclass(frozen=True, eq=False)
class Rod:
    """What is checked for collisions in place of a gripper that the model lacks: a capsule, "the tool".

    Attributes:
        T_tool_rod: its middle; it lies along z.
        diameter, length: m, of its cylinder; half a sphere closes each end.
    """

    T_tool_rod: Pose
    diameter: float
    length: float


@dataclass(frozen=True)
class Touching:
    """Two bodies that touch in the motion.

    Attributes:
        bodies: links, or other things, by name; they are painted red. "the tool" is the rod.
        start, end: s, from when to when.
    """

    bodies: tuple[str, str]
    start: float
    end: float
    message: str


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Everything that a replay shows.

    Attributes:
        motion: the same, of the whole robot.
        hand_path_base: (n, 3) m, where the demonstrated tool went in base.
        hand_speed: (n,) m/s, colours the path; or None.
        table_height: m, z of the table's top in base; None: the ground at z = 0.
        rod: what stands for a gripper that the model lacks, or None.
        torque: the largest share of a torque limit, or None.
        phases: where what is grasped is, by time; empty where nothing is.
        notes: what the viewer should know: warnings, "simulated data".
        touching: what touches, where that was allowed, by when it begins.
        detours: s, from when to when the arm goes around something on its way to the next keyframe, or back.
    """

    title: str
    robot: Robot
    trajectory: JointTrajectory
    motion: RobotMotion
    hand_path_base: Array
    keyframes: tuple[ReplayKeyframe, ...]
    hand_speed: Array | None = None
    table_height: float | None = None
    grasped: GraspedObject | None = None
    phases: tuple[Stay, ...] = ()
    notes: tuple[str, ...] = ()
    touching: tuple[Touching, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    rod: Rod | None = None
    torque: float | None = None
    detours: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        n = len(self.hand_path_base)
        freeze_arrays(self, hand_path_base=(n, 3), hand_speed=(n,))
