"""What a replay is made of: the values that `pbd.view.scene.build` draws."""

from __future__ import annotations

from dataclasses import dataclass, field

from pbd.data import GraspedObject, JointTrajectory, Obstacle, Robot
from pbd.pose import Array, Pose, readonly


@dataclass(frozen=True, eq=False)
class ReplayKeyframe:
    """A keyframe as the replay shows it.

    Attributes:
        label: a word for people; may be empty.
        t: s, when the arm reaches it.
        T_base_tool: where.
        cov: (6, 6) m and rad, of the tool's position and rotation vector in base; or None: not known.
        grip: True where the gripper closes here, False where it opens.
    """

    label: str
    t: float
    T_base_tool: Pose
    cov: Array | None = None
    grip: bool | None = None

    def __post_init__(self) -> None:
        if self.cov is not None:
            object.__setattr__(self, "cov", cov := readonly(self.cov))
            if cov.shape != (6, 6):
                raise ValueError(f"ReplayKeyframe.cov must have shape (6, 6), got {cov.shape}")


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
        told: in words.
    """

    bodies: tuple[str, str]
    start: float
    end: float
    told: str


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Everything that a replay shows.

    Attributes:
        title: the demonstration's name.
        robot: which arm.
        trajectory: what it does; the tool's own path is worked out from it.
        hand_path_base: (n, 3) m, where the demonstrated tool went in base.
        hand_speed: (n,) m/s, colours the path; or None.
        keyframes: in order.
        table_height: m, z of the table's top in base; None: the ground at z = 0.
        obstacles: what else stands around.
        rod: what stands for a gripper that the model lacks, or None.
        grasped: what the gripper takes, or None.
        notes: what the viewer should know: warnings, "simulated data".
        touching: what touches, where that was allowed, by when it begins.
    """

    title: str
    robot: Robot
    trajectory: JointTrajectory
    hand_path_base: Array
    keyframes: tuple[ReplayKeyframe, ...]
    hand_speed: Array | None = None
    table_height: float | None = None
    grasped: GraspedObject | None = None
    notes: tuple[str, ...] = field(default=())
    touching: tuple[Touching, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    rod: Rod | None = None

    def __post_init__(self) -> None:
        n = len(self.hand_path_base)
        for name, shape in (("hand_path_base", (n, 3)), ("hand_speed", (n,))):
            if (value := getattr(self, name)) is None:
                continue
            object.__setattr__(self, name, array := readonly(value))
            if array.shape != shape:
                raise ValueError(f"ReplayScene.{name} must have shape {shape}, got {array.shape}")
        object.__setattr__(self, "keyframes", tuple(self.keyframes))
        object.__setattr__(self, "notes", tuple(self.notes))
