"""The audit's own collision check agrees with a dense check of meshes, and catches faults of the planner."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from pbd.arm.collision.geometry import Body
from pbd.arm.collision.scene import CollisionScene
from pbd.audit.arm import AuditArm
from pbd.audit.audit import audit
from pbd.audit.collision_pairs import AuditScene
from pbd.audit.contact import Pair, SampledMotion, coordinates, find_touch
from pbd.audit.solids import MESH_DISTANCES_M, Solid, half_space, link_solids, simple_solid
from pbd.data import Calibration, JointTrajectory, Obstacle, Robot
from pbd.data.world import THE_TOOL
from pbd.errors import PlanError
from pbd.files.demo import load_demo
from pbd.io.urdf import Shape
from pbd.planning import plan_keyframes
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of, keyframes_of, path_of
from tests.arm.conftest import random_joints
from tests.arm.dense_collision_check import Dense
from tests.arm.straight_moves import time_keyframes
from tests.audit.motions import changed_sample
from tests.not_none import not_none

PANDA = arm_of("panda").robot
BOTTLE = load_demo("pouring").grasped
SIDES = [np.where(mask, 1.0, -1.0) for mask in np.ndindex(2, 2, 2)]
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def calibration(*obstacles: Obstacle, table: float | None = None) -> Calibration:
    return Calibration("bench", T_base_dock=Pose.identity(), obstacles=obstacles, table_height=table)


def touched(robot: Robot, trajectory: JointTrajectory, world: Calibration) -> tuple[str, str] | None:
    scene = AuditScene(AuditArm(robot), world, None)
    touch = find_touch(scene.arm, trajectory, scene.pairs(trajectory))
    return None if touch is None else touch.bodies


# --- faults of the planner -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ball_on_the_way() -> Obstacle:
    """A ball of 3 cm diameter on the way of a finger as the arm returns home."""
    plan = plan_keyframes(keyframes_of("pouring"), dock(), PANDA, None, path_of("pouring"), BOTTLE)
    arm, trajectory = AuditArm(PANDA), plan.trajectory
    t = float(0.4 * trajectory.keyframe_t[-1] + 0.6 * trajectory.duration)
    joint, T_joint_finger = arm.link_on_joint("panda_leftfinger")
    placed = arm.joint_poses(coordinates(trajectory, np.array([t]))[0])
    tip = (placed[joint] * T_joint_finger).act(np.array([0.0, 0.01, 0.045]))
    return Obstacle("the ball", "sphere", (0.03,), Pose(tip, LEVEL))


def dock() -> Calibration:
    return not_none(PANDA.dock)


def slow_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    from pbd.arm.collision.motion_bounds import rates

    monkeypatch.setattr("pbd.arm.collision.clearance.rates", lambda *args: 0.02 * rates(*args))


def small_hulls(monkeypatch: pytest.MonkeyPatch) -> None:
    from pbd.arm.gripper import arm_bodies

    def shrunk(body: Body) -> Body:
        return replace(body, points=0.02 * body.points, size=tuple(0.02 * each for each in body.size))

    monkeypatch.setattr("pbd.arm.collision.scene.arm_bodies", lambda arm: tuple(map(shrunk, arm_bodies(arm))))


def dropped_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing: Any = np.empty((0, 2), dtype=np.int64)
    monkeypatch.setattr(CollisionScene, "_pairs_between", lambda *_: nothing)


def moved_keyframe(monkeypatch: pytest.MonkeyPatch) -> None:
    from pbd.arm.motion_request import MotionRequest

    def faulty(T_base_tool: Any, *args: Any) -> Any:
        moved = list(T_base_tool)
        moved[2] = Pose(moved[2].p + np.array([0.0, 0.0, 0.003]), moved[2].wxyz)
        return MotionRequest(moved, *args)

    monkeypatch.setattr("pbd.arm.motion_request.MotionRequest", faulty)


@pytest.mark.parametrize(
    ("fault", "with_ball", "message"),
    [
        (slow_bodies, True, "would touch the ball"),
        (small_hulls, True, "would touch the ball"),
        (dropped_pairs, True, "would touch the ball"),
        (changed_sample, False, "panda_joint6 has velocity"),
        (moved_keyframe, False, "at keyframe 2 .* the tool is 0.003 m"),
    ],
)
def test_a_fault_of_the_planner_is_caught(
    fault: Any, with_ball: bool, message: str, ball_on_the_way: Obstacle, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = replace(dock(), obstacles=(ball_on_the_way,) if with_ball else ())
    fault(monkeypatch)
    audited = list[Any]()

    def trust(*motion: Any) -> SimpleNamespace:
        audited.append(motion)
        return SimpleNamespace(torque=None)

    monkeypatch.setattr("pbd.audit.audit.audit", trust)
    # Nothing but the audit catches the fault.
    plan_keyframes(keyframes_of("pouring"), world, PANDA, None, path_of("pouring"), BOTTLE)
    with pytest.raises(PlanError, match=f"^audit: .*{message}"):
        audit(*audited[0])


# --- the verdict agrees with the meshes ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_the_verdict_agrees_with_a_dense_check_of_the_meshes(name: str) -> None:
    arm, rng, verdicts = arm_of(name), np.random.default_rng(4), set()
    own = AuditArm(arm.robot)
    for _ in range(8):
        trajectory = around_home(arm.robot, rng)
        x = coordinates(trajectory, rng.uniform(0.0, trajectory.duration, 1))[0]
        shape, sizes = (("sphere", 1), ("box", 3), ("cylinder", 2))[rng.integers(3)]
        size = tuple(float(each) for each in rng.uniform(0.02, 0.15, sizes))
        there = Pose.from_rpy(own.tool_pose(x).p + rng.normal(0.0, 0.1, 3), rng.uniform(-3.0, 3.0, 3))
        thing = Obstacle("thing", shape, size, there)
        # The rod is not in the URDF, so the dense check doesn't know it.
        pairs = [
            pair
            for pair in AuditScene(own, calibration(thing), None).pairs(trajectory)
            if THE_TOOL not in (pair.first.name, pair.second.name)
        ]
        names = {frozenset((pair.first.name, pair.second.name)) for pair in pairs}
        found, dense = find_touch(own, trajectory, pairs) is not None, Dense(arm.robot, [thing], 2e-3)
        verdicts.add(found)
        if dense.touch(trajectory, names, 0.0):
            assert found
        elif not dense.touch(trajectory, names, 5e-4):
            assert not found
    assert verdicts == {True, False}


def around_home(robot: Robot, rng: np.random.Generator) -> JointTrajectory:
    q = robot.home + rng.uniform(-0.5, 0.5, (3, len(robot.joints)))
    q = np.clip(q, robot.limits.lower + 0.01, robot.limits.upper - 0.01)
    return time_keyframes(arm_of(robot.name), q, [0.0] * 3, [None] * 3, robot.home)


@pytest.mark.parametrize(("gap_m", "free"), [(3e-4, True), (-3e-4, False)])
def test_a_gap_of_0_3_mm_is_told_from_an_overlap_of_0_3_mm(gap_m: float, free: bool) -> None:
    """panda's fingers, which are boxes, pass sideways over a box."""
    arm = AuditArm(PANDA)
    q = np.tile(PANDA.home, (2, 1))
    q[:, 0] = -0.3, 0.3
    trajectory = time_keyframes(arm_of("panda"), q, [0.0] * 2, [None] * 2, PANDA.home)
    fingers = [link for link in link_solids(arm) if "finger" in link.name]
    lowest = min(
        float((placed[link.joint] * link.T_joint_solid).act(side * link.hull.halfSide)[2])
        for placed in map(arm.joint_poses, coordinates(trajectory, np.linspace(0.0, trajectory.duration, 200)))
        for link in fingers
        for side in SIDES
    )
    x, y, _ = arm.tool_pose(np.append(PANDA.home, 1.0)).p
    middle = np.array([x, y, lowest - gap_m - 0.05])
    box = Obstacle("the box", "box", (0.2, 0.04, 0.1), Pose(middle, LEVEL))
    assert (touched(PANDA, trajectory, calibration(box)) is None) == free


PALM = AuditArm(PANDA)
BALL = simple_solid("the ball", PALM.tool_joint, PALM.T_joint_tool, "sphere", (0.02,))


def centers(trajectory: JointTrajectory, t: Array) -> Array:
    """Return the center of the ball at the tool (n, 3), m."""
    return np.array(
        [PALM.joint_poses(x)[PALM.tool_joint].act(BALL.bounding_sphere[0]) for x in coordinates(trajectory, t)]
    )


def passed_ball(trajectory: JointTrajectory, t: float, apart_m: float) -> Solid:
    """Return a ball, 4 cm in diameter, that the ball at the tool passes at this distance at t (s)."""
    before, center, after = centers(trajectory, np.array([t - 1e-4, t, t + 1e-4]))
    across = np.cross(after - before, (0.0, 0.0, 1.0))
    center = center + (0.03 + apart_m) * across / np.linalg.norm(across)
    return simple_solid(f"passed at {t} s", 0, pin.SE3(np.eye(3), center), "sphere", (0.04,))


def test_a_contact_of_two_milliseconds_is_found_at_its_time() -> None:
    """Oracle: the distance of two balls' centers, every 0.02 ms. Nearer than 0.1 mm counts as contact.

    A second ball, which is hit later and deeply, changes nothing, in either order of the pairs.
    """
    q = np.tile(PANDA.home, (2, 1))
    q[:, 0] = -0.8, 0.8
    trajectory = time_keyframes(arm_of("panda"), q, [0.0] * 2, [None] * 2, q[0], approach=False)
    later = Pair(BALL, passed_ball(trajectory, 0.9 * trajectory.duration, -0.01))
    for passed in np.random.default_rng(1).uniform(0.2, 0.7, 4) * trajectory.duration:
        t = passed + np.arange(-2e-3, 2e-3, 2e-5)
        grazed, missed = (passed_ball(trajectory, passed, MESH_DISTANCES_M[-1] + more) for more in (-1e-6, 1e-6))
        touching = t[
            np.linalg.norm(centers(trajectory, t) - grazed.bounding_sphere[0], axis=1) <= 0.03 + MESH_DISTANCES_M[-1]
        ]
        assert 0.0 < np.ptp(touching) < 2e-3
        pairs = [Pair(BALL, grazed), later]
        for ordered in (pairs, pairs[::-1]):
            found = find_touch(PALM, trajectory, ordered)
            assert found is not None
            assert found.pair is pairs[0]
            assert found.t == pytest.approx(touching[0], abs=1e-4)
        assert find_touch(PALM, trajectory, [Pair(BALL, missed)]) is None


def test_the_last_interval_ends_where_the_trajectory_does() -> None:
    q = np.stack((PANDA.home, PANDA.home + 0.1))
    trajectory = time_keyframes(arm_of("panda"), q, [0.0] * 2, [None] * 2, q[0], approach=False)
    motion = SampledMotion(PALM, trajectory)
    assert motion.time(len(motion.t) - 2, 1.0) == pytest.approx(trajectory.duration)


def test_a_contact_is_found_after_a_part_in_which_it_is_allowed() -> None:
    """The balls may touch until they are 2 cm apart, which says nothing of the distance after that."""
    q = np.tile(PANDA.home, (2, 1))
    q[:, 0] = -0.8, 0.8
    trajectory = time_keyframes(arm_of("panda"), q, [0.0] * 2, [None] * 2, q[0], approach=False)
    ball = passed_ball(trajectory, 0.5 * trajectory.duration, -0.01)

    def far(T_universe_joint: Any) -> bool:
        center = T_universe_joint[PALM.tool_joint].act(BALL.bounding_sphere[0])
        return bool(np.linalg.norm(center - ball.bounding_sphere[0]) > 0.05)

    touches = [find_touch(PALM, trajectory, [Pair(BALL, ball, allowed=allowed)]) for allowed in (None, far)]
    assert not_none(touches[0]).t == pytest.approx(not_none(touches[1]).t, abs=1e-3)


@pytest.mark.parametrize(("into_m", "touches"), [(0.001, True), (-0.001, False)])
def test_a_table_is_touched_at_its_height(into_m: float, touches: bool) -> None:
    """A ball at the tool descends to 1 mm above the table, or 1 mm into it."""
    q = np.tile(PANDA.home, (2, 1))
    q[:, 1] += -0.2, 0.2
    trajectory = time_keyframes(arm_of("panda"), q, [0.0] * 2, [None] * 2, q[0], approach=False)
    lowest = float(centers(trajectory, np.linspace(0.0, trajectory.duration, 2000))[:, 2].min()) - 0.01
    top = pin.SE3(np.eye(3), np.array([0.0, 0.0, lowest + into_m]))
    assert (find_touch(PALM, trajectory, [Pair(half_space("the table", top), BALL)]) is not None) == touches


@pytest.mark.parametrize("joint", [0, 5])
def test_an_object_inside_a_link_touches_it(joint: int) -> None:
    """A pea on the axis of panda's first joint: the link's mesh turns around it, or is still, and never meets its
    surface."""
    q = np.tile(PANDA.home, (2, 1))
    q[:, joint] += -0.3, 0.3
    trajectory = time_keyframes(arm_of("panda"), q, [0.0] * 2, [None] * 2, PANDA.home)
    pea = Obstacle("the pea", "sphere", (0.01,), Pose(np.array([0.0, 0.0, 0.25]), LEVEL))
    found = touched(PANDA, trajectory, calibration(pea))
    assert found == ("panda_link1", "the pea")
    assert not Dense(PANDA, [pea]).touch(trajectory, {frozenset(found)}, 0.0)


def test_pairs_that_the_srdf_excludes_without_a_trusted_reason_are_checked() -> None:
    """ur5's SRDF excludes the forearm against the wrist's last links; when the wrist is folded, they meet."""
    robot = arm_of("ur5").robot
    for q in random_joints(robot, 400, seed=2, margin=0.1):
        trajectory = time_keyframes(arm_of("ur5"), np.stack((q, q + 0.01)), [0.0] * 2, [None] * 2, q)
        found = touched(robot, trajectory, calibration())
        if found is not None and "forearm_link" in found and "wrist_2_link" in found:
            break
    else:
        pytest.fail("in none of 400 configurations the forearm touches the wrist")
    assert Dense(robot, []).touch(trajectory, {frozenset(found)}, 0.0)


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_no_corner_of_a_link_is_farther_from_its_joint_than_its_reach(name: str) -> None:
    solids = [solid for solid in link_solids(AuditArm(arm_of(name).robot)) if solid.mesh]
    assert solids
    for solid in solids:
        corners = solid.triangles.reshape(-1, 3) @ solid.T_joint_solid.rotation.T + solid.T_joint_solid.translation
        assert 0.0 <= solid.reach - np.linalg.norm(corners, axis=1).max() <= 2.0 * solid.pad


def test_a_mesh_in_millimetres_is_as_large_as_its_scale_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    box = tmp_path / "box.stl"
    trimesh.creation.box((200.0, 40.0, 60.0)).export(box)
    shape = Shape("panda_link0", "collision", Pose.identity(), "mesh", mesh=box, scale=(0.001, 0.002, 0.003))
    monkeypatch.setattr("pbd.audit.solids.collision_shapes", lambda robot: (shape,))
    (solid,) = link_solids(AuditArm(replace(PANDA)))
    assert np.ptp(np.array(solid.hull.points()), axis=0) == pytest.approx((0.2, 0.08, 0.18), abs=1e-3)
