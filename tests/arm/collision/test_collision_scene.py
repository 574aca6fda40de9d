"""Known contacts, the table, obstacles, and the object where it stands and where it is held."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from pbd.arm.collision.clearance import MARGIN_M
from pbd.arm.collision.geometry import link_bodies
from pbd.arm.collision.scene import NEAR_SUPPORT_M, CollisionScene, GraspState
from pbd.arm.gripper import arm_bodies
from pbd.arm.ik.solver import solve
from pbd.arm.model import ArmModel, from_se3, load_model
from pbd.data import GraspedObject, Obstacle
from pbd.data.world import TABLE, ObjectPhase
from pbd.pose import Array, Pose, quat_from_rpy
from tests.arm.bundled import KINDS, NAMES, arm_of
from tests.arm.collision_oracles import coordinates, placements, points_of
from tests.not_none import not_none

DOWN = quat_from_rpy((np.pi, 0.0, 0.0))
BOTTLE = GraspedObject("cylinder", (0.06, 0.2))


def at(arm: ArmModel, x: float, y: float, z: float) -> Array:
    """Return joints with the tool pointing down at a position in base, m, solved from home."""
    result = solve(arm, Pose(np.array([x, y, z]), DOWN), arm.robot.home)
    assert result.reached
    return result.q


@pytest.mark.parametrize("name", NAMES)
def test_home_is_free(name: str) -> None:
    arm = arm_of(name)
    dock = not_none(arm.robot.dock)
    assert CollisionScene(arm, dock.table_height, dock.obstacles).hit(arm.robot.home) is None


@pytest.mark.parametrize("name", KINDS)
def test_a_hit_is_what_the_distances_say(name: str) -> None:
    """It is the smallest distance, and names the two links."""
    arm = arm_of(name)
    scene = CollisionScene(arm)
    hits = 0
    for x in coordinates(arm, 30, seed=3):
        hit, distances = scene.hit(x[:-1], GraspState(x[-1])), scene.always.distances(x)
        assert (hit is None) == (distances.min() >= MARGIN_M)
        if hit is not None:
            hits += 1
            assert hit.distance == pytest.approx(distances.min(), abs=1e-5)  # coal begins where it last ended
            assert hit.depth == max(0.0, -hit.distance)
            worst = scene.always.pairs[np.argmin(distances)]
            assert [hit.first, hit.second] == [arm_bodies(arm)[i].name for i in worst]
    assert hits > 0


@pytest.mark.parametrize(
    ("name", "joints", "links"),
    [
        # Folded until the hand touches the shoulder, or the wrist the upper arm.
        (
            "panda",
            {3: -3.0, 5: 0.0},
            {"panda_link1", "panda_link2", "panda_link5", "panda_hand", "panda_leftfinger", "panda_rightfinger"},
        ),
        ("ur5", {2: 2.9}, {"upper_arm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link", "shoulder_link"}),
    ],
)
def test_known_contacts(name: str, joints: dict[int, float], links: set[str]) -> None:
    arm = arm_of(name)
    q = arm.robot.home.copy()
    for joint, angle in joints.items():
        q[joint] = angle
    scene = CollisionScene(arm)
    hit = not_none(scene.hit(q))
    assert {hit.first, hit.second} <= links
    assert hit.depth > 0.005
    assert scene.check_path(np.stack((arm.robot.home, q))) is not None
    assert scene.check_path(arm.robot.home + np.outer((0.0, 0.3), q - arm.robot.home)) is None


@pytest.mark.parametrize(
    ("name", "first", "second"),
    [("ur5", "forearm_link", "wrist_2_link"), ("panda", "panda_link5", "panda_hand")],
)
def test_what_the_srdf_does_not_call_adjacent_or_never_is_checked(name: str, first: str, second: str) -> None:
    """Their SRDFs disable these pairs ("disabled", "Default"), but they touch when the arm is folded."""
    scene = CollisionScene(arm_of(name))
    found = {(hit.first, hit.second) for x in coordinates(arm_of(name), 300) if (hit := scene.hit(x[:-1]))}
    assert (first, second) in found


@pytest.mark.parametrize("height", [-0.1, 0.0, 0.2])
def test_the_table(arm: ArmModel, height: float) -> None:
    """The distance of the hand's lowest point from the table is as its height says."""
    scene = CollisionScene(arm, height)
    for gap in (0.004, 0.001, -0.03):
        q = at(arm, 0.5, 0.1, height + 0.3)
        lowest = min(points_of(body, placements(arm, np.append(q, 1.0)))[:, 2].min() for body in link_bodies(arm)[8:])
        q = at(arm, 0.5, 0.1, height + 0.3 - (lowest - height) + gap)
        hit = scene.hit(q)
        if gap > MARGIN_M:
            assert hit is None
        else:
            assert hit is not None
            assert hit.second == TABLE
            assert "finger" in hit.first
            assert hit.distance == pytest.approx(gap, abs=1e-4)
            assert_allclose(hit.p_base, (0.5, 0.1, height), atol=0.06)


def test_a_link_that_always_touches_the_table_is_listed_as_sunk(arm: ArmModel) -> None:
    """Link 1 turns about the vertical at 0.33 m, so a table at 0.35 m always touches it."""
    assert "panda_link1" in CollisionScene(arm, 0.35).sunk
    assert not CollisionScene(arm, 0.0).sunk


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("shape", "size"), [("box", (0.1, 0.2, 0.3)), ("cylinder", (0.1, 0.3)), ("sphere", (0.15,))])
def test_obstacles(arm: ArmModel, shape: str, size: tuple[float, ...], turned: bool) -> None:
    """The tool comes down onto its top: the distance is as its size says, and the hit has its name."""
    rpy = (np.pi, 0.0, 0.7) if turned else (0.0, 0.0, 0.0)  # upside down it is as high
    obstacle = Obstacle("the thing", shape, size, Pose.from_rpy((0.5, 0.0, 0.1), rpy))
    scene = CollisionScene(arm, None, [obstacle])
    top = 0.1 + size[-1] / 2.0
    q = at(arm, 0.5, 0.0, top + 0.3)
    fingers = [body for body in link_bodies(arm) if "finger" in body.name]
    closed = placements(arm, np.append(q, 0.0))
    low = min(points_of(body, closed)[:, 2].min() for body in fingers)  # both fingers meet over its middle
    for gap in (0.01, 0.001, -0.01):
        hit = scene.hit(at(arm, 0.5, 0.0, top + 0.3 - (low - top) + gap), GraspState(0.0))
        assert (hit is None) == (gap > MARGIN_M)
        if hit is not None:
            assert hit.second == "the thing"
            assert "finger" in hit.first
            assert hit.distance == pytest.approx(gap, abs=1.5e-3)  # a sphere's top is round


def test_an_obstacle_deep_inside_a_links_mesh_is_a_hit(arm: ArmModel) -> None:
    """It touches the mesh's surface nowhere."""
    placed = placements(arm, np.append(arm.robot.home, 0.0))
    for link in link_bodies(arm):
        if link.joint > 0 and link.mesh is not None:
            inside = placed[link.joint] @ link.T_joint_body @ Pose(link.points.mean(axis=0), DOWN)
            hit = CollisionScene(arm, obstacles=[Obstacle("ball", "sphere", (0.01,), inside)]).hit(arm.robot.home)
            assert hit is not None, link.name


def test_an_obstacle_stands_in_base_not_in_the_urdfs_world(odd_arm: ArmModel) -> None:
    """The base of the odd robot is not the URDF's root; its links have no shape, but the obstacle's pose is known."""
    obstacle = Obstacle("thing", "sphere", (0.1,), Pose.from_rpy((0.1, 0.2, 0.3), (0, 0, 0)))
    scene = CollisionScene(odd_arm, 0.0, [obstacle])
    bodies = {body.name: body for body in scene.always.bodies}
    full, data = odd_arm.full, odd_arm.full.createData()
    pin.framesForwardKinematics(full, data, odd_arm.configurations(np.append(odd_arm.robot.home, 1.0)))
    base = from_se3(data.oMf[full.getFrameId(odd_arm.robot.base, pin.FrameType.BODY)])
    assert_allclose(bodies["thing"].T_joint_body.p, base.act((0.1, 0.2, 0.3)), atol=1e-12)
    assert_allclose(bodies[TABLE].T_joint_body.wxyz, base.wxyz, atol=1e-12)


def test_fingers_are_where_the_opening_puts_them(arm: ArmModel) -> None:
    q = at(arm, 0.5, 0.0, 0.3)
    beside = Obstacle("post", "cylinder", (0.02, 0.4), Pose.from_rpy((0.5 + 0.055, 0.0, 0.1), (0, 0, 0)))
    scene = CollisionScene(arm, None, [beside])
    assert scene.hit(q, GraspState(1.0)) is not None
    assert scene.hit(q, GraspState(0.0)) is None


# The object


def tool_over(x: float, z: float) -> Pose:
    return Pose(np.array([x, 0.0, z]), DOWN)


def test_legs_have_the_place_of_the_object_and_the_gripper_opening(arm: ArmModel) -> None:
    scene = CollisionScene(arm, 0.0, grasped=BOTTLE)
    poses = [tool_over(0.4, 0.3), tool_over(0.4, 0.15), tool_over(0.5, 0.3), tool_over(0.5, 0.15), tool_over(0.4, 0.3)]
    grasps = scene.grasp_states(poses, [None, True, None, False, None])
    assert [grasp.opening for grasp in grasps] == [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert [grasp.phase is not None and grasp.phase.held for grasp in grasps] == [
        False,
        False,
        True,
        True,
        False,
        False,
    ]
    before, after = grasps[0].phase, grasps[-1].phase
    assert_allclose(not_none(before).pose.p, (0.4, 0.0, 0.1), atol=1e-12)  # it stands on the table
    assert_allclose(not_none(after).pose.p, (0.5, 0.0, 0.1), atol=1e-12)


def test_without_a_gripper_or_an_object_nothing_is_carried(arm: ArmModel) -> None:
    poses = [tool_over(0.4, 0.3), tool_over(0.4, 0.15), tool_over(0.5, 0.3)]
    handless = load_model(replace(arm.robot, gripper=None))
    for scene in (CollisionScene(arm), CollisionScene(handless, grasped=BOTTLE)):
        grasps = scene.grasp_states(poses, [None, True, None])
        assert len(grasps) == 4
        assert all(grasp.phase is None for grasp in grasps)


def held(T_tool_object: Pose, *rests: Pose) -> GraspState:
    return GraspState(0.0, ObjectPhase(0.0, 1.0, True, T_tool_object, rests))


def test_a_held_object_touches_what_the_arm_does_not(arm: ArmModel) -> None:
    """A rod of 30 cm hangs from the fingers and touches a box below; without the rod the arm is free."""
    rod = GraspedObject("cylinder", (0.02, 0.3))
    box = Obstacle("box", "box", (0.1, 0.1, 0.1), Pose.from_rpy((0.5, 0.0, 0.05), (0, 0, 0)))
    scene = CollisionScene(arm, None, [box], rod)
    grasp = held(Pose.from_rpy((0, 0, 0.15), (0, 0, 0)))
    q = at(arm, 0.5, 0.0, 0.38)
    assert scene.hit(q) is None
    hit = not_none(scene.hit(q, grasp))
    assert (hit.first, hit.second) == ("the cylinder", "box")
    assert hit.depth == pytest.approx(0.02, abs=1e-4)
    assert scene.hit(at(arm, 0.5, 0.0, 0.41), grasp) is None
    assert scene.hit(at(arm, 0.5, 0.2, 0.38), grasp) is None


def test_a_held_object_may_touch_the_gripper_but_not_the_arm(arm: ArmModel) -> None:
    scene = CollisionScene(arm, grasped=GraspedObject("cylinder", (0.02, 1.2)))
    q = at(arm, 0.5, 0.0, 0.3)
    down, across = Pose.from_rpy((0, 0, 0.5), (0, 0, 0)), Pose.from_rpy((0, 0, 0), (0, np.pi / 2, 0))
    assert scene.hit(q, held(down)) is None  # it goes up through the whole hand
    hit = not_none(scene.hit(q, held(across)))
    assert hit.second == "the cylinder"
    assert hit.first in ("panda_link0", "panda_link1")


def test_a_standing_object_may_touch_the_gripper_but_not_the_arm(arm: ArmModel) -> None:
    standing = ObjectPhase(-np.inf, 1.0, False, Pose.from_rpy((0.5, 0.0, 0.1), (0, 0, 0)))
    scene = CollisionScene(arm, 0.0, grasped=BOTTLE)
    assert scene.hit(at(arm, 0.5, 0.0, 0.15), GraspState(1.0, standing)) is None
    elbow = arm.robot.home
    forearm = placements(arm, np.append(elbow, 1.0))[5].p
    hit = not_none(scene.hit(elbow, GraspState(1.0, replace(standing, pose=Pose(forearm, DOWN)))))
    assert hit.second == "the cylinder"


@pytest.mark.parametrize("support", ["the table", "a shelf"])
def test_a_held_object_may_touch_its_support_near_its_rest(arm: ArmModel, support: str) -> None:
    """It hangs 10 cm below the tool. Near its rest it may touch, even 1 cm deep; 4 cm beside it may not."""
    shelf = Obstacle("a shelf", "box", (0.6, 0.6, 0.1), Pose.from_rpy((0.5, 0.0, 0.05), (0, 0, 0)))
    level = 0.0 if support == "the table" else 0.1
    scene = CollisionScene(arm, 0.0, [] if support == "the table" else [shelf], BOTTLE)
    grasp = held(Pose.from_rpy((0, 0, 0), (np.pi, 0, 0)), Pose.from_rpy((0.45, 0.0, level + 0.1), (0, 0, 0)))
    for aside, deep, free in [(0.0, 0.0, True), (0.0, 0.01, True), (0.025, 0.005, True), (0.04, 0.001, False),
                              (0.0, NEAR_SUPPORT_M + 0.01, False), (0.04, -0.01, True)]:  # fmt: skip
        hit = scene.hit(at(arm, 0.45 + aside, 0.0, level + 0.1 - deep), grasp)
        assert (hit is None) == free, (aside, deep)
        if hit is not None:
            assert (hit.first, hit.second) == ("the cylinder", support)


def test_a_wall_beside_the_object_is_no_support(arm: ArmModel) -> None:
    """An object released against a wall touches the wall, but does not stand on it."""
    wall = Obstacle("wall", "box", (0.02, 0.4, 0.06), Pose.from_rpy((0.5, 0.0, 0.03), (0, 0, 0)))
    scene = CollisionScene(arm, 0.0, [wall], BOTTLE)
    grasp = held(Pose.from_rpy((0, 0, 0), (np.pi, 0, 0)), Pose.from_rpy((0.465, 0.0, 0.1), (0, 0, 0)))
    hit = not_none(scene.hit(at(arm, 0.465, 0.0, 0.1), grasp))
    assert hit.second == "wall"
    assert scene.hit(at(arm, 0.455, 0.0, 0.1), grasp) is None  # the table it may touch


def test_both_ends_of_a_move_count(arm: ArmModel) -> None:
    ball = Obstacle("ball", "sphere", (0.1,), Pose(arm.forward(arm.robot.home).p, DOWN))
    scene = CollisionScene(arm, None, [ball])
    away = arm.robot.home + 0.5 * np.eye(7)[0]
    assert scene.hit(away) is None
    for move in (away, arm.robot.home), (arm.robot.home, away):
        assert scene.check_path(np.stack(move)) is not None
    assert scene.check_path(np.stack((away, 0.5 * (away + arm.robot.home)))) is None
    assert scene.check_path(np.stack((away, away))) is None
