"""What the audit computes anew: bounds of motion, hulls, the gripper's rod, the object, the pairs to check."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import Delaunay

from pbd.arm.collision.allowed_collisions import sample_coordinates
from pbd.arm.gripper import tool_rod as planned_rod
from pbd.arm.model import load_model
from pbd.audit.arm import AuditArm
from pbd.audit.collision_pairs import AuditScene
from pbd.audit.contact import SPAN, Pair, Placement, SampledMotion, coordinates, find_touch
from pbd.audit.grasp import resting_contact, tool_rod
from pbd.audit.solids import _hull_corners, clearance, hull_distance, link_solids, one_encloses_other, simple_solid
from pbd.data import Calibration, GraspedObject, Gripper, JointLimits, JointTrajectory, Obstacle, Robot
from pbd.data.world import ObjectPhase
from pbd.pose import Pose
from tests.arm.bundled import NAMES, arm_of
from tests.arm.conftest import random_joints
from tests.arm.straight_moves import solve_path, time_keyframes
from tests.near import assert_near

BOTTLE = GraspedObject("cylinder", (0.07, 0.2))
BENCH = Calibration("bench", T_base_dock=Pose.identity())
DOWN = (np.pi, 0.0, 0.0)


def swing(robot: Robot, seed: int = 0) -> JointTrajectory:
    q = random_joints(robot, 4, seed=seed, margin=0.2)
    grips = (None, True, False, None) if robot.gripper else (None,) * 4
    return time_keyframes(load_model(robot), q, [0.1] * 4, grips, robot.home)


def without_joint(robot: Robot, i: int) -> Robot:
    """Return a robot whose [arm] leaves out a joint, which is then locked."""
    arrays: dict[str, Any] = {
        name: getattr(robot.limits, name) for name in ("lower", "upper", "velocity", "acceleration", "jerk")
    }
    arrays = {name: np.delete(array, i) for name, array in arrays.items()}
    limits = replace(robot.limits, effort=None, **arrays)
    joints = tuple(name for name in robot.joints if name != robot.joints[i])
    return replace(robot, joints=joints, home=np.delete(robot.home, i), limits=limits)


@pytest.mark.parametrize("name", ["odd", "so101", "kinova", "locked"])
def test_no_point_moves_farther_than_its_bound(name: str, odd_robot: Robot) -> None:
    """Path length of a point on each joint, relative to the base, in steps of 20 us between instants of the grid."""
    locked = without_joint(arm_of("panda").robot, 2) if name == "locked" else None
    robot = locked or (odd_robot if name == "odd" else arm_of(name).robot)
    arm, trajectory = AuditArm(robot), swing(robot)
    motion, rng = SampledMotion(arm, trajectory), np.random.default_rng(0)
    still = simple_solid("still", 0, pin.SE3.Identity(), "sphere", (0.1,))
    for joint in filter(arm.driven_ancestors, range(1, arm.model.njoints)):
        p = rng.normal(0.0, 0.1, 3)
        thing = simple_solid("thing", joint, pin.SE3(np.eye(3), p), "sphere", (1e-6,))
        travel = motion.travel(Pair(thing, still))
        for row in rng.integers(0, len(motion.t) - 1, 5):
            fine = coordinates(trajectory, np.linspace(motion.t[row], motion.t[row + 1], 200))
            steps = np.diff([arm.joint_poses(x)[joint].act(p) for x in fine], axis=0)
            assert np.linalg.norm(steps, axis=1).sum() <= travel[row + 1] - travel[row] + 1e-9


@pytest.mark.parametrize("name", ["odd", "panda"])
def test_nothing_touches_in_spans_that_bounding_spheres_rule_out(name: str, odd_robot: Robot) -> None:
    """All pairs, with a table, a ball and a carried bottle, at a random instant of every other such span."""
    robot = odd_robot if name == "odd" else arm_of(name).robot
    arm, rng = AuditArm(robot), np.random.default_rng(0)
    trajectory = swing(robot)
    ball = Obstacle("the ball", "sphere", (0.1,), Pose.from_rpy((0.3, 0.2, 0.3), DOWN))
    scene = AuditScene(arm, replace(BENCH, table_height=-0.1, obstacles=(ball,)), BOTTLE)
    motion, ruled_out = SampledMotion(arm, trajectory), 0
    starts = np.arange(0, len(motion.t), SPAN)
    rows = rng.integers(starts, np.minimum(starts + SPAN, len(motion.t) - 1) + 1)
    for pair in scene.pairs(trajectory):
        close = motion.close_spans(pair, motion.travel(pair))
        for row in np.delete(rows, close)[::2].tolist():
            assert hull_distance(*pair.placed(motion.placement(row))) > 0.0
            ruled_out += 1
    assert ruled_out > 500


def test_the_last_instant_is_in_a_span_whatever_their_number() -> None:
    robot, counts = arm_of("panda").robot, set()
    arm = AuditArm(robot)
    still, thing = (simple_solid("ball", j, pin.SE3.Identity(), "sphere", (9.0,)) for j in (0, arm.tool_joint))
    for dwell in 0.1 + 0.004 * np.arange(SPAN):
        motion = SampledMotion(arm, time_keyframes(arm_of("panda"), robot.home[None], [dwell], [None], robot.home))
        pair, last = Pair(thing, still), len(motion.t) - 1
        assert motion.close_spans(pair, motion.travel(pair))[-1] == last // SPAN
        counts.add(last % SPAN)
    assert len(counts) == SPAN


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_a_hull_encloses_its_mesh_closely(name: str) -> None:
    directions = np.random.default_rng(0).normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for solid in link_solids(AuditArm(arm_of(name).robot)):
        if solid.mesh is not None:
            hull, mesh = np.array(solid.hull.points()), solid.triangles.reshape(-1, 3)
            beyond = (directions @ hull.T).max(axis=1) + solid.pad - (directions @ mesh.T).max(axis=1)
            assert beyond.min() >= 0.0
            assert beyond.max() <= 2.0 * solid.pad


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_hulls_are_no_farther_apart_than_their_meshes(name: str) -> None:
    own, rng = AuditArm(arm_of(name).robot), np.random.default_rng(0)
    ball = simple_solid("ball", 0, pin.SE3.Identity(), "sphere", (0.02,))
    for link in [each for each in link_solids(own) if each.mesh is not None]:
        for at in rng.uniform(-0.3, 0.3, (5, 3)):
            placed = link, coal.Transform3s(), ball, coal.Transform3s(np.eye(3), at)
            meshes = coal.distance(
                link.exact, placed[1], ball.exact, placed[3], coal.DistanceRequest(), coal.DistanceResult()
            )
            for pair in (placed, (*placed[2:], *placed[:2])):
                assert hull_distance(*pair) < max(meshes, 0.0)


def test_the_order_of_two_solids_is_no_matter() -> None:
    """Balls inside the hulls of the links, where only the meshes tell whether they touch."""
    own, rng = AuditArm(arm_of("panda").robot), np.random.default_rng(0)
    here, apart = coal.Transform3s(), []
    for link in [each for each in link_solids(own) if each.mesh is not None]:
        for share in rng.dirichlet(np.ones(4), 30):
            corners = np.array(link.hull.points())
            center = coal.Transform3s(np.eye(3), share @ corners[rng.choice(len(corners), 4)])
            ball = simple_solid("ball", 0, pin.SE3.Identity(), "sphere", (0.002,))
            apart.append((clearance(link, here, ball, center), clearance(ball, center, link, here)))
    assert min(apart)[0] == 0.0
    assert max(apart)[0] > 0.0
    assert_near(np.array(apart)[:, 0], np.array(apart)[:, 1], 1e-6)


def test_the_hull_of_a_flat_mesh_is_a_thin_box() -> None:
    """A plate, seen straight and edge on; coal would crash."""
    plate = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=np.float64)
    for flat in (plate, np.roll(plate, 1, axis=-1)):
        corners = _hull_corners(flat)["corners"]
        np.testing.assert_allclose(np.sort(np.ptp(corners, axis=0)), (0.002, 1.002, 1.002))


def test_what_is_inside_a_mesh_is_enclosed_by_it() -> None:
    """Points in and around a convex mesh; scipy says which are inside."""
    link = max(link_solids(AuditArm(arm_of("panda").robot)), key=lambda solid: solid.reach)
    corners = link.triangles.reshape(-1, 3)
    points = np.random.default_rng(0).uniform(corners.min(axis=0), corners.max(axis=0), (200, 3))
    point = simple_solid("point", 0, pin.SE3.Identity(), "sphere", (0.001,))
    found = [one_encloses_other(link, coal.Transform3s(), point, coal.Transform3s(np.eye(3), at)) for at in points]
    assert found == (Delaunay(corners).find_simplex(points) >= 0).tolist()
    assert 20 < sum(found) < 180


@pytest.mark.parametrize("name", NAMES)
def test_the_rod_is_the_same_as_the_planners(name: str) -> None:
    arm, planned = AuditArm(arm_of(name).robot), planned_rod(arm_of(name))
    rod = tool_rod(arm, link_solids(arm))
    assert (rod is None) == (planned is None)
    if rod is not None and planned is not None:
        ends = np.array([[0.0, 0.0, -0.5 * planned.size[1]], [0.0, 0.0, 0.5 * planned.size[1]]])
        own = [rod.T_joint_solid.act(np.array([0.0, 0.0, end])) for end in (-rod.hull.halfLength, rod.hull.halfLength)]
        np.testing.assert_allclose(own, planned.T_joint_body.act(ends), atol=2e-3)
        assert rod.hull.radius == 0.5 * planned.size[0]


@pytest.mark.parametrize(("gap_m", "needed"), [(0.015, False), (0.025, True)])
def test_a_finger_or_a_flange_that_ends_near_the_tools_origin_needs_no_rod(gap_m: float, needed: bool) -> None:
    """The finger is beside the tool's axis. Without links that carry the tool, the rod begins at the flange."""
    arm = AuditArm(arm_of("ur5").robot)
    for aside in (*permutations((0.1, 0.0)), *permutations((-0.1, 0.0))):
        T_tool_finger = pin.SE3(np.eye(3), np.array([*aside, -gap_m - 0.05]))
        finger = simple_solid("finger", arm.tool_joint, arm.T_joint_tool * T_tool_finger, "box", (0.02, 0.02, 0.1))
        assert (tool_rod(arm, (finger,)) is not None) == needed
    arm.T_joint_tool = pin.SE3(np.eye(3), np.array([0.0, 0.0, gap_m]))
    assert (tool_rod(arm, ()) is not None) == needed


def test_a_carried_object_is_checked() -> None:
    """A carried bottle meets a post that the gripper itself misses; where the bottle stands it may touch the table."""
    robot = arm_of("panda").robot
    arm, own = arm_of("panda"), AuditArm(robot)
    places = [Pose.from_rpy((0.5, y, z), DOWN) for y, z in ((-0.2, 0.1), (-0.2, 0.25), (0.2, 0.25), (0.2, 0.1))]
    q = solve_path(arm, places, robot.home)
    trajectory = time_keyframes(arm, q, [0.5] * 4, (True, None, None, False), robot.home)
    post = Obstacle("the post", "box", (0.05, 0.05, 0.2), Pose.from_rpy((0.5, 0.0, 0.1), (0.0, 0.0, 0.0)))
    for obstacles, grasped, wanted in (((), BOTTLE, None), ((post,), None, None),
                                       ((post,), BOTTLE, ("the cylinder", "the post"))):  # fmt: skip
        world = replace(BENCH, table_height=0.0, obstacles=obstacles)
        scene = AuditScene(own, world, grasped)
        touch = find_touch(own, trajectory, scene.pairs(trajectory))
        assert (touch and touch.bodies) == wanted
    low = replace(post, T_base_obstacle=Pose.from_rpy((0.5, 0.0, 0.04), (0.0, 0.0, 0.0)))
    scene = AuditScene(own, replace(BENCH, table_height=0.0, obstacles=(low,)), BOTTLE)
    assert find_touch(own, trajectory, scene.pairs(trajectory)) is None


@pytest.mark.parametrize("name", NAMES)
def test_no_pair_of_a_bundled_arm_is_left_out_because_it_always_touches(name: str) -> None:
    robot = arm_of(name).robot
    assert robot.dock is not None
    assert not robot.may_touch, "what may touch is never checked: choose a model whose shapes don't overlap"
    assert not AuditScene(AuditArm(robot), robot.dock, None).always_touching


def two_joints(urdf: Path, odd_robot: Robot, body: str, most_rad: float, gripper: Gripper | None = None) -> Robot:
    """An arm of two joints called first and second, each with limits of -`most_rad` and `most_rad`."""
    limits = {name: getattr(odd_robot.limits, name)[:2] for name in ("velocity", "acceleration", "jerk")}
    return replace(
        odd_robot,
        name="two joints",
        urdf=urdf,
        base="base",
        body=body,
        joints=("first", "second"),
        home=np.zeros(2),
        gripper=gripper,
        limits=JointLimits(np.full(2, -most_rad), np.full(2, most_rad), **limits, source="a test"),
    )


@pytest.mark.parametrize("enclosed", [False, True])
def test_solids_that_touch_in_nearly_every_configuration_are_left_out(
    enclosed: bool, tmp_path: Path, odd_robot: Robot
) -> None:
    """A tall cylinder on the second link always cuts the base's plate, or is inside its mesh; a ball never does."""
    path, urdf = tmp_path / "stack.urdf", STACK
    if enclosed:
        trimesh.creation.box((0.4, 0.4, 0.2)).export(tmp_path / "plate.stl")
        urdf = STACK.replace('<box size="0.4 0.4 0.2"/>', '<mesh filename="plate.stl"/>').replace("-0.1", "-0.15")
    path.write_text(urdf.replace('length="0.2"', 'length="0.1"') if enclosed else urdf, encoding="utf-8")
    stack = two_joints(path, odd_robot, "upper", 1.0)
    scene = AuditScene(AuditArm(stack), BENCH, None)
    (pair,) = scene.always_touching
    assert (pair.first.name, pair.second.name) == ("base", "upper")
    trajectory = time_keyframes(load_model(stack), np.full((1, 2), 0.1), [0.0], [None], stack.home)
    own = [pair for pair in scene.pairs(trajectory) if pair.first.name == "base" and pair.second.name == "upper"]
    assert len(own) == 1


@pytest.mark.parametrize("turns", [-2, 2])
def test_joints_whose_ranges_lie_beyond_a_turn_are_sampled_within_them(
    turns: int, tmp_path: Path, odd_robot: Robot
) -> None:
    """Two whole turns change no pose, so the same pair touches in every configuration."""
    (tmp_path / "stack.urdf").write_text(STACK, encoding="utf-8")
    stack = two_joints(tmp_path / "stack.urdf", odd_robot, "upper", 1.0)
    shift = 2.0 * np.pi * turns
    limits = replace(stack.limits, lower=stack.limits.lower + shift, upper=stack.limits.upper + shift)
    stack = replace(stack, limits=limits, home=stack.home + shift)
    (pair,) = AuditScene(AuditArm(stack), BENCH, None).always_touching
    assert (pair.first.name, pair.second.name) == ("base", "upper")
    samples = sample_coordinates(load_model(stack))[:, :-1]
    assert_near(samples.min(axis=0), limits.lower, 0.1)
    assert_near(samples.max(axis=0), limits.upper, 0.1)


@pytest.mark.parametrize(("reason", "checked"), [("Adjacent", 0), ("Never", 0), ("Default", 1), ("User", 1)])
def test_pairs_that_an_srdf_excludes_because_they_never_meet_or_are_neighbours_are_left_out_and_no_others(
    reason: str, checked: int, tmp_path: Path, odd_robot: Robot
) -> None:
    """A setup assistant's "Default" means that they touched in one pose, and "User" may mean anything."""
    urdf, srdf = tmp_path / "stack.urdf", tmp_path / "stack.srdf"
    urdf.write_text(STACK, encoding="utf-8")
    excluded = f'<disable_collisions link1="upper" link2="base" reason="{reason}"/>'
    srdf.write_text(f'<robot name="stack">{excluded}</robot>', encoding="utf-8")
    stack = replace(two_joints(urdf, odd_robot, "upper", 1.0), srdf=srdf)
    trajectory = time_keyframes(load_model(stack), np.full((1, 2), 0.1), [0.0], [None], stack.home)
    pairs = AuditScene(AuditArm(stack), BENCH, None).pairs(trajectory)
    assert sum({pair.first.name, pair.second.name} == {"base", "upper"} for pair in pairs) == checked


def test_samples_cover_endless_joints_and_the_gripper_and_no_more(tmp_path: Path, odd_robot: Robot) -> None:
    """Three solids touch the base's half plate in about half of the configurations each, so all are checked: a ball on
    the hand while it points to one side, a finger while the gripper is closed, another finger while it is open. A third
    finger always touches the plate, but would not if it moved beyond open or closed; it is left out.
    """
    path = tmp_path / "half_plate.urdf"
    path.write_text(HALF_PLATE, encoding="utf-8")
    gripper = Gripper(("left", "right", "middle"), np.array([0.1, 0.0, 0.045]), np.array([0.0, 0.1, -0.025]), 1.0)
    arm = AuditArm(two_joints(path, odd_robot, "hand", np.inf, gripper))
    scene = AuditScene(arm, BENCH, None)
    rng, plate, left_out = (
        np.random.default_rng(0),
        scene.links[0],
        {pair.second.name for pair in scene.always_touching},
    )
    x = np.column_stack((rng.uniform(-np.pi, np.pi, (200, 2)), rng.uniform(0.0, 1.0, 200)))
    placements = [Placement(arm.joint_poses(each)) for each in x]
    for solid in (each for each in scene.links if each.name in ("hand", "left finger", "right finger")):
        touching = np.mean([hull_distance(*Pair(plate, solid).placed(placement)) < 0.0 for placement in placements])
        assert 0.3 < touching < 0.7
        assert solid.name not in left_out
    assert "middle finger" in left_out


@pytest.mark.parametrize(("closed", "needed"), [(0.1, False), (0.0, True)])
def test_a_finger_that_reaches_the_tools_origin_only_when_open_needs_a_rod(
    closed: float, needed: bool, tmp_path: Path, odd_robot: Robot
) -> None:
    (tmp_path / "half_plate.urdf").write_text(HALF_PLATE, encoding="utf-8")
    gripper = Gripper(("right",), np.array([0.1 - closed]), np.array([closed]), 1.0)
    robot = two_joints(tmp_path / "half_plate.urdf", odd_robot, "hand", np.inf, gripper)
    robot = replace(robot, T_body_tool=Pose.from_rpy((0.0, 0.0, 0.3), (0.0, 0.0, 0.0)))
    arm = AuditArm(robot)
    assert (tool_rod(arm, link_solids(arm)) is not None) == (planned_rod(load_model(robot)) is not None) == needed


HALF_PLATE = """<?xml version="1.0"?>
<robot name="half plate">
  <link name="base">
    <collision><origin xyz="0.17 0 0.18"/><geometry><box size="0.4 0.8 0.04"/></geometry></collision>
  </link>
  <link name="lower"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <link name="hand">
    <collision><origin xyz="0.15 0 0.2"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <link name="left finger"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <link name="right finger"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="first" type="continuous"><parent link="base"/> <child link="lower"/> <axis xyz="0 0 1"/></joint>
  <joint name="second" type="continuous"><parent link="lower"/> <child link="hand"/> <axis xyz="0 0 1"/></joint>
  <link name="middle finger"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="left" type="prismatic">
    <parent link="hand"/> <child link="left finger"/> <origin xyz="0 0 0.17"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="0" upper="0.1" velocity="1"/>
  </joint>
  <joint name="right" type="prismatic">
    <parent link="hand"/> <child link="right finger"/> <origin xyz="0 0 0.17"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="0" upper="0.1" velocity="1"/>
  </joint>
  <joint name="middle" type="prismatic">
    <parent link="hand"/> <child link="middle finger"/> <origin xyz="0 0 0.17"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="-0.025" upper="0.045" velocity="1"/>
  </joint>
</robot>
"""
STACK = """<?xml version="1.0"?>
<robot name="stack">
  <link name="base">
    <collision><origin xyz="0 0 0.1"/><geometry><box size="0.4 0.4 0.2"/></geometry></collision>
  </link>
  <link name="lower">
    <collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.02" length="0.02"/></geometry></collision>
  </link>
  <link name="upper">
    <collision><origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.02" length="0.2"/></geometry></collision>
    <collision><origin xyz="0 0 0.3"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="first" type="revolute">
    <parent link="base"/> <child link="lower"/> <origin xyz="0 0 0.2"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="-1" upper="1" velocity="1"/>
  </joint>
  <joint name="second" type="revolute">
    <parent link="lower"/> <child link="upper"/> <origin xyz="0 0 0.05"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="-1" upper="1" velocity="1"/>
  </joint>
</robot>
"""


def ball_may_touch_slope(degrees: float, gap_m: float, aside_m: float) -> bool:
    """Say whether a held ball of 10 cm may touch a slope, if it is let go `gap_m` above it and is `aside_m` from
    there now.
    """
    own, turn = AuditArm(arm_of("panda").robot), pin.exp3(np.array([np.radians(degrees), 0.0, 0.0]))
    slope = simple_solid("slope", 0, pin.SE3(turn, np.zeros(3)), "box", (2.0, 2.0, 0.2))
    ball = simple_solid("ball", own.tool_joint, pin.SE3.Identity(), "sphere", (0.1,))
    rest = turn @ np.array([0.0, 0.0, 0.15 + gap_m])
    T_base_rest = Pose(own.T_universe_base.inverse().act(rest), Pose.identity().wxyz)
    allowed = resting_contact(own, ObjectPhase(0.0, 1.0, True, Pose.identity(), (T_base_rest,)), ball, slope)
    T_universe_ball = pin.SE3(np.eye(3), rest + np.array([aside_m, 0.0, 0.0]))
    return allowed is not None and allowed({own.tool_joint: T_universe_ball})


@pytest.mark.parametrize(
    ("degrees", "gap_m", "aside_m", "free"),
    [(0.0, 0.028, 0.0, True), (0.0, 0.032, 0.0, False), (0.0, 0.0, 0.028, True), (0.0, 0.0, 0.032, False),
     (44.0, 0.0, 0.0, True), (46.0, 0.0, 0.0, False)],
)  # fmt: skip
def test_a_held_object_may_touch_an_upward_surface_within_3_cm_of_its_rest(
    degrees: float, gap_m: float, aside_m: float, free: bool
) -> None:
    assert ball_may_touch_slope(degrees, gap_m, aside_m) == free


def test_a_speed_that_peaks_between_two_instants_is_bounded() -> None:
    """The speed is zero at the instants of the grid, 2 ms apart, and 7.5 mrad/s between them."""
    robot = arm_of("panda").robot
    coefficients = np.zeros((1, 4, len(robot.joints)))
    coefficients[0, 1:, 3] = 0.0, 7.5, -2500.0  # qd = 7500 s (2 ms - s)
    trajectory = JointTrajectory(
        joint_names=robot.joints,
        knots=np.array([0.0, 0.002]),
        coefficients=coefficients,
        gripper_t=np.zeros(1),
        gripper_opening=np.ones(1),
        keyframe_t=np.zeros(1),
        keyframe_q=np.zeros((1, len(robot.joints))),
    )
    motion = SampledMotion(AuditArm(robot), trajectory)
    assert motion.t.tolist() == [0.0, 0.002]
    assert motion.travelled[-1, 3] >= trajectory.at(motion.t).q[-1, 3] > 9e-6
