"""Suggest home and dock for an arm whose TOML lacks them: docks are sampled, ranked, and tried by planning."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.dock import place_in_base
from pbd.calibration.tool_poses import tool_poses
from pbd.data import Calibration, GraspedObject, Keyframe, Robot
from pbd.errors import PbdError, RobotError, collected_warnings, warn
from pbd.planning.choose_joints import PlanRefusal
from pbd.planning.options import PlanOptions
from pbd.planning.plan import plan_task
from pbd.planning.result import Plan
from pbd.planning.task import PlanningTask, arm_of
from pbd.pose import Array, Pose, quat_about_z, quat_rotate

if TYPE_CHECKING:
    from pbd.arm.model import ArmModel

Range = tuple[float, float]
"""Smallest and largest height of the table, m."""
SAMPLES = 20_000
"""Number of random configurations whose tool poses are sampled."""
POINTS_DOWN_COS = float(np.cos(np.radians(20.0)))
"""Cosine of the largest angle, 20 degrees, between straight down and the approach of a tool that points down."""
SCALES = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Scales of the demonstration, in the order in which they are tried."""
GRIP_M = 0.15
"""Height of the lowest keyframe over the table, m: the bundled bottle is 0.2 m high."""
DOCKS, MORE_DOCKS, DOCKS_PLANNED, HOMES_PLANNED = 40, 120, 3, 2
"""Number of docks ranked at each scale in the first round, and of further ones in the second; of the best docks that
are planned; of homes that are planned at each dock."""
NEAR_M = 0.1
"""Largest distance of a sampled height from the wanted one over the table, m; the dock is moved to the wanted one."""
TABLE_STEP_M = 0.01
"""Precision of the largest height of a table, m: that of the positions of docks."""
YAWS_DEG = (0.0, -90.0, 90.0, 180.0)
"""Yaws of the dock in base that are tried, degrees."""
AZIMUTH_COST = 0.2
"""Cost of a dock beside or behind the base's x axis, rad of joint travel per rad."""
OFTEN_SHARE = 0.5
"""Share of random configurations above which two touching links are taken to touch by design: such a contact would bar
most homes."""
HOME_OVER_M = 0.05
"""Height of home over the dock, m, times the scale."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """A home and a dock with which a demonstration was planned.

    Attributes:
        plan: the plan of the demonstration, and the robot with this home and dock.
        near_limit: the joint that is nearest to a limit at home: its name and the distance, rad or m.
        manipulability: that at home, relative to the arm's 25th percentile.
        ranked, within_reach: number of docks ranked at this scale, and of those with all keyframes within reach.
        own_table: the user gave the table's height.
        touching: pairs of links added to `may_touch`, with the number of random configurations in which they touch.
    """

    plan: Plan
    near_limit: tuple[str, float]
    manipulability: float
    ranked: int
    within_reach: int
    own_table: bool
    touching: dict[tuple[str, str], int]


def suggest_home_and_dock(
    robot: Robot,
    keyframes: Sequence[Keyframe],
    grasped: GraspedObject | None,
    tell: Callable[[str], None] = lambda message: None,
) -> Suggestion:
    """Find a home and a dock; deterministic.

    Args:
        robot: as `read_robot` reads a draft; its dock has only the table's height, or there is none.
        keyframes: keyframes of the demonstration that the arm must be able to do.
        grasped: the object that the arm grasps.
        tell: called with a line of progress after each stage of the search.

    Raises:
        RobotError: none was found; the message says why the best one failed.
    """
    from pbd.arm.ik.partial_pose import is_partial
    from pbd.arm.ik.starts import relative_manipulability

    arm = arm_of(robot)
    p, R = _sampled_tool_poses(arm)
    table = None if robot.dock is None else robot.dock.table_height
    tables = (-np.inf, _highest_table(arm, p[:, 2])) if table is None else (table, table)
    lowest = -min(keyframe.T_nav_sensor.p[2] for keyframe in keyframes)
    touching: dict[tuple[str, str], int] = {}
    why = f"no dock has all keyframes within reach, even at {SCALES[-1]} of the size; correct base or T_body_tool"
    z_down = p[R[:, 2, 2] < -POINTS_DOWN_COS, 2]
    why += "" if table is None else ", or table_height"
    why += ", or take a demonstration that tilts the tool less (--for)" if is_partial(arm) else ""
    why += f"; the tool can point down at heights from {z_down.min():.2f} to {z_down.max():.2f} m"
    possible: dict[tuple[Range, float], Iterator[Calibration]] = {}
    for within, scale, count in _search_order(tables, z_down, lowest):
        further = _possible_docks(arm, (p, R), keyframes, within, scale)
        docks = list(islice(possible.setdefault((within, scale), further), count))
        reachable = _rank(arm, docks, keyframes)
        if docks:
            tell(f"{len(reachable)} of {len(docks)} docks have all keyframes within reach at {scale:g} of the size")
        best = [
            # No detours: a dock that needs one is not worth a suggestion, and the search takes seconds.
            PlanningTask(tuple(keyframes), dock, robot, None, grasped, PlanOptions(detour=False))
            for dock in reachable[:DOCKS_PLANNED]
        ]
        planned, refusals = _plan_each(best)
        if refusals and not planned and not touching and (touching := _often_touching(arm)):
            robot = replace(robot, may_touch=(*robot.may_touch, *touching))
            pairs = ", ".join(f"{first} and {second}" for first, second in touching)
            tell(f"links that overlap in most configurations are taken to do so by design: {pairs}")
            planned, refusals = _plan_each([replace(task, robot=robot) for task in best])
        if planned:
            plan, warned = min(planned, key=lambda each: each[0].trajectory.duration)
            for message in warned:
                warn(message)
            room = arm.limit_margins(plan.robot.home)
            nearest = robot.joints[int(room.argmin())], float(room.min())
            manipulability = float(relative_manipulability(arm, plan.robot.home[None])[0])
            counts = len(docks), len(reachable)
            return Suggestion(plan, nearest, manipulability, *counts, table is not None, touching)
        why = next(iter(refusals), why)
    raise RobotError(f"{robot.name}: no home and dock found: {why}", robot=robot.name)


def _often_touching(arm: ArmModel) -> dict[tuple[str, str], int]:
    """Return pair of links -> in how many random configurations it touches, if in most."""
    from pbd.arm.collision.allowed_collisions import sample_coordinates
    from pbd.arm.collision.scene import CollisionScene

    clearance, often = CollisionScene(arm).always, dict[tuple[str, str], int]()
    for row, count in clearance.always_touching(sample_coordinates(arm), OFTEN_SHARE).items():
        links = clearance.names(row)
        often[links] = max(count, often.get(links, 0))
    return often


def _plan_each(tasks: Sequence[PlanningTask]) -> tuple[list[tuple[Plan, list[str]]], list[str]]:
    """Plan at each dock; return the plans that worked, with their warnings, and why the others failed."""
    tried = list(map(_plan_at_dock, tasks))
    return [each for each in tried if isinstance(each, tuple)], [each for each in tried if isinstance(each, str)]


def _sampled_tool_poses(arm: ArmModel) -> tuple[Array, Array]:
    """Return positions (n, 3), m, and rotations (n, 3, 3) of the tool in base for random configurations."""
    from pbd.arm.ik.starts import sample_joints

    p, R = arm.forward_many(sample_joints(arm, SAMPLES))
    if (down := int((R[:, 2, 2] < -POINTS_DOWN_COS).sum())) < DOCKS:
        off_deg = np.degrees(np.arccos(np.clip(-R[:, 2, 2].min(), -1.0, 1.0)))
        raise RobotError(
            f"{arm.robot.name}: the tool points down in only {down} of {SAMPLES} random configurations (at best "
            f"{off_deg:.0f} degrees off); correct T_body_tool, whose z is the way the tool approaches, or base, whose "
            "z is up; an arm that can't point down needs a home and a dock of yours",
            robot=arm.robot.name,
        )
    return p.astype(np.float64), R.astype(np.float64)


def _highest_table(arm: ArmModel, z: Array) -> float:
    """Return the largest height of a table, m, that no moving link nearly always touches; z: the tool's heights."""
    from pbd.arm.collision.scene import CollisionScene

    heights = TABLE_STEP_M * np.arange(z.min() // TABLE_STEP_M, z.max() // TABLE_STEP_M)
    too_high = bisect_left(heights, True, key=lambda height: bool(CollisionScene(arm, float(height)).sunk))
    return float(np.append(-np.inf, heights)[too_high])


def _search_order(tables: Range, z_down: Array, lowest: float) -> Iterator[tuple[Range, float, int]]:
    """Yield the range of the table's height, the scale, and the number of further docks, in the order of trial.

    `tables`: the range that is allowed; `z_down`: heights, m, at which the tool points down; `lowest`: how far the
    lowest keyframe is below the first, m.
    """
    on_table, free = (0.0, 0.0), tables[0] < 0.0 <= tables[1]
    # If the tool, pointing down, usually reaches the height of things on a table at z = 0, try that table first.
    low, high = np.quantile(z_down, (0.1, 0.9))
    if free and low <= GRIP_M + lowest <= high:
        yield from ((on_table, scale, DOCKS) for scale in SCALES[:3])
    yield from ((tables, scale, DOCKS) for scale in SCALES)
    for heights in (on_table, tables) if free else (tables,):
        yield from ((heights, scale, MORE_DOCKS) for scale in SCALES[2:])


def _possible_docks(
    arm: ArmModel, sampled: tuple[Array, Array], keyframes: Sequence[Keyframe], tables: Range, scale: float
) -> Iterator[Calibration]:
    """Yield docks that bring the most tilted keyframe to a sampled tool pose with a similar tilt.

    `tables`: least and largest height of the table, m.
    """
    from pbd.arm.ik.partial_pose import is_partial

    def dock(yaw: float, p: Array, table_height: float) -> Calibration:
        name = arm.robot.name
        place = Pose(p, quat_about_z(yaw))
        return Calibration(name, place, table_height=table_height + 0.0, scale=scale, robots=(name,))

    at_origin = _tool_poses_at(dock(0.0, np.zeros(3), 0.0), keyframes)
    approach = [quat_rotate(pose.wxyz, (0.0, 0.0, 1.0)) for pose in at_origin]
    most_tilted = int(np.argmax([z for _, _, z in approach]))
    over = GRIP_M - min(pose.p[2] for pose in at_origin)
    x, y, z = approach[most_tilted]
    similar = np.abs(sampled[1][:, 2, 2] - z) < 1.0 - POINTS_DOWN_COS
    for i, (p, R) in enumerate(zip(sampled[0][similar], sampled[1][similar], strict=True)):
        yaw_deg = YAWS_DEG[i % len(YAWS_DEG)]
        if is_partial(arm):  # it can tilt its tool about one axis only
            yaw_deg = round(float(np.degrees(np.arctan2(R[1, 2], R[0, 2]) - np.arctan2(y, x))))
        yaw = float(np.radians(yaw_deg))
        at = np.round(p - quat_rotate(quat_about_z(yaw), at_origin[most_tilted].p), 2)
        table = float(np.clip(at[2] - over, *tables))
        if abs(at[2] - table - over) <= NEAR_M:
            at[2] = round(table + over, 3)
            yield dock(yaw, at, round(float(at[2]) - over, 3))


def _rank(arm: ArmModel, docks: Sequence[Calibration], keyframes: Sequence[Keyframe]) -> list[Calibration]:
    """Return the docks at which every keyframe is within reach, least cost first."""
    from pbd.arm.ik.branches import configuration_cost

    found = []
    for dock in docks:
        poses = _tool_poses_at(dock, keyframes)
        q = _solve_all(arm, poses)
        if q is not None:
            x, y, _ = np.mean([pose.p for pose in poses], axis=0)
            cost = float(configuration_cost(arm, q).mean()) + AZIMUTH_COST * abs(float(np.arctan2(y, x)))
            found.append((cost, dock))
    return [dock for _, dock in sorted(found, key=lambda each: each[0])]


def _solve_all(arm: ArmModel, poses: Sequence[Pose]) -> Array | None:
    """Return joints (m, k) for m different poses, farthest from the first pose first; None if one is out of reach."""
    from pbd.arm.ik.partial_pose import WARN_RAD, is_partial, measure
    from pbd.arm.ik.solver import solve
    from pbd.arm.model import to_se3

    found, left = list[Array](), sorted(poses, key=lambda pose: -sum(pose.distance(poses[0])))
    while left:
        pose = left[0]
        result = solve(arm, pose, found[-1] if found else None)
        if not result.reached:
            return None
        if is_partial(arm) and measure(arm, to_se3(pose), result.q).approach_rad > WARN_RAD:
            return None
        found.append(result.q)
        left = [other for other in left if max(pose.distance(other)) > 0.01]
    return np.array(found)


def _plan_at_dock(task: PlanningTask) -> tuple[Plan, list[str]] | str:
    """Return the plan from the first home that works, and its warnings; or why the task can't be planned."""
    why = "the place over the dock is out of reach; correct base or T_body_tool"
    for home in _homes(task):
        with collected_warnings() as warned:
            try:
                found = plan_task(replace(task, robot=replace(task.robot, home=home, dock=task.calibration)))
            except PbdError as error:
                found = PlanRefusal(error)
        if isinstance(found, Plan):
            return found, warned
        why = found.error.message
    return why


def _homes(task: PlanningTask) -> list[Array]:
    """Return joints (k,) with the tool over the first keyframe, least cost first; free ones if there are any."""
    from pbd.arm.ik.branches import configuration_cost, find_branches, turn_toward
    from pbd.arm.ladder_building import STARTS_WIDE

    arm, first, usual = task.arm, task.T_base_tool[0], task.robot.home
    over = Pose(first.p + np.array([0.0, 0.0, HOME_OVER_M * task.calibration.scale]), first.wxyz)
    found = turn_toward(arm, find_branches(arm, over, usual[None], STARTS_WIDE), usual)
    if not len(found):
        return []
    least_first = np.round(found[configuration_cost(arm, found).argsort()], 4)
    # If none is free, planning explains why.
    return [q for q in least_first if task.scene.hit(q) is None][:HOMES_PLANNED] or [least_first[0]]


def _tool_poses_at(dock: Calibration, keyframes: Sequence[Keyframe]) -> tuple[Pose, ...]:
    return tool_poses(place_in_base(keyframes, dock))
