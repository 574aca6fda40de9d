"""Distances, how fast they may change, and which pairs are watched: against exact distances and by properties."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pbd.arm.collision.allowed_collisions import NEARLY_ALWAYS, link_pairs, sample_coordinates
from pbd.arm.collision.clearance import CLOSE_M, MARGIN_M, Clearance, JointPath
from pbd.arm.collision.geometry import Body, link_bodies
from pbd.arm.collision.motion_bounds import lever_arms, outline, rates
from pbd.arm.collision.motion_check import all_hits
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.gripper import arm_bodies, gripper_links
from pbd.arm.model import ArmModel, load_model
from pbd.arm.path_sampling import sample_polyline, sample_trajectory
from pbd.arm.timing.time_moves import Move, time_moves
from pbd.data import Gripper, JointTrajectory, Robot
from pbd.pose import Array, Pose, quat_about_z, quat_inverse, quat_rotate
from tests.arm.bundled import KINDS, NAMES, arm_of
from tests.arm.collision_oracles import coordinates, hull_distance, placements, points_of, rounding_of
from tests.arm.dense_collision_check import joint_values
from tests.audit.motions import spline
from tests.not_none import not_none

STEP_M = 2.0 * MARGIN_M


def links_only(arm: ArmModel) -> Clearance:
    return Clearance(arm, arm_bodies(arm), link_pairs(arm)[0])


def test_distances_are_measured_once_and_forgotten_once_there_are_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pbd.arm.collision.clearance.CACHED", 2)
    clearance, (one, other, third) = links_only(arm_of("so101")), coordinates(arm_of("so101"), 3)
    first = clearance.distances(one)
    clearance.distances(other)
    assert clearance.distances(one) is first
    clearance.distances(third)
    assert clearance.distances(one) is not first


@pytest.mark.parametrize("name", NAMES)
def test_coordinates_become_pinocchios_configurations(name: str) -> None:
    arm = arm_of(name)
    full, x = arm.full, coordinates(arm, 5)
    for *q, opening, found in zip(*x.T, arm.configurations(x), strict=True):
        turned = np.zeros(full.nv)
        for joint, value in joint_values(arm.robot, q, opening).items():
            turned[full.joints[full.getJointId(joint)].idx_v] = value
        assert_allclose(found, pin.integrate(full, pin.neutral(full), turned), atol=1e-15)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_distances_are_exact(name: str) -> None:
    """For hulls, boxes and capsules, compared with least squares over their corners."""
    arm = arm_of(name)
    clearance = links_only(arm)
    for x in coordinates(arm, 4):
        joints, got = placements(arm, x), clearance.distances(x)
        for pair, (a, b) in enumerate(clearance.pairs):
            first, second = clearance.bodies[a], clearance.bodies[b]
            exact = hull_distance(points_of(first, joints), points_of(second, joints))
            exact -= rounding_of(first) + rounding_of(second)
            asked = got[pair] >= MARGIN_M > exact and (first.mesh is not None or second.mesh is not None)
            assert got[pair] == pytest.approx(exact, abs=1e-5) or (got[pair] < 0.0 and exact < 1e-5) or asked


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_distances_change_no_faster_than_the_bound(name: str) -> None:
    arm = arm_of(name)
    clearance, rng = links_only(arm), np.random.default_rng(0)
    for x in coordinates(arm, 8):
        step = rng.normal(size=x.shape) * rng.choice([0.003, 0.1, 1.0]) * (rng.random(x.shape) < 0.5)
        step[-1] = np.clip(x[-1] + step[-1], 0.0, 1.0) - x[-1]
        before, after = clearance.distances(x), clearance.distances(x + step)
        of_hulls = np.minimum(before, after) > MARGIN_M  # of meshes only a bound is known
        assert (np.abs(after - before) <= clearance.rates @ np.abs(step) + 1e-5)[of_hulls].all()


def test_a_sliding_and_an_endless_joint_are_bounded_too(odd_arm: ArmModel) -> None:
    """For bodies on every link of an arm with every kind of joint."""
    joints = range(odd_arm.full.njoints)
    bodies = [
        Body(str(i), i, Pose.from_rpy((0.1, 0.05 * i, 0.0), (0.3, 0.0, i)), "box", (0.1, 0.2, 0.02)) for i in joints
    ]
    pairs = np.array([(i, j) for j in joints for i in range(j)])
    clearance, rng = Clearance(odd_arm, bodies, pairs), np.random.default_rng(1)
    assert (clearance.rates[:, 1].max(), clearance.rates[:, -1].max()) == (1.0, 0.0)  # the lift slides; no gripper
    low, high = np.array([-9.0, 0.0, -6.5, -2.0, 0.0]), np.array([9.0, 0.4, 6.5, 2.0, 1.0])
    for _ in range(50):
        x, end = rng.uniform(low, high, (2, 5))
        end = x + rng.choice([0.01, 1.0]) * (end - x)
        change = clearance.distances(end) - clearance.distances(x)
        assert (np.abs(change) <= clearance.rates @ np.abs(end - x) + 1e-5).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 7), st.floats(0.01, 1.0), st.integers(0, 2**32 - 1))
def test_the_bound_of_motion_holds_for_each_point_and_is_tight(joint: int, turn: float, seed: int) -> None:
    """Points of the panda's hand move by at most the bound for each joint, and for the last one by nearly as much."""
    arm = arm_of("panda")
    hand = next(body for body in link_bodies(arm) if body.name == "panda_hand")
    foot = Body("foot", 0, Pose.identity(), "floor")
    rate = rates(arm, [foot, hand], np.array([[0, 1]]))[0]
    x = coordinates(arm, 1, seed)[0]
    moved = x.copy()
    moved[joint] += turn
    before, after = (points_of(hand, placements(arm, each)) for each in (x, moved))
    way = np.linalg.norm(after - before, axis=1).max()
    assert way <= rate[joint] * abs(turn) + 1e-12
    if joint == 6:
        assert way >= 0.95 * rate[6] * 2.0 * np.sin(abs(turn) / 2.0)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_a_body_that_a_joint_does_not_carry_moves_no_faster_past_it_than_the_bound(name: str) -> None:
    arm, rng = arm_of(name), np.random.default_rng(2)
    for _ in range(20):
        box = Body(
            "box", 0, Pose.from_rpy(rng.uniform(-0.7, 0.7, 3), rng.uniform(-3.0, 3.0, 3)), "box", (0.1, 0.2, 0.05)
        )
        bound, x = lever_arms(arm, box), coordinates(arm, 1, int(rng.integers(2**31)))[0]
        for column, joint in enumerate(map(arm.full.getJointId, arm.robot.joints)):
            moved = x.copy()
            moved[column] += 0.05
            ends = (
                quat_rotate(quat_inverse(joints[joint].wxyz), points_of(box, joints) - joints[joint].p)
                for joints in (placements(arm, x), placements(arm, moved))
            )
            way = float(np.linalg.norm(np.subtract(*ends), axis=1).max())
            assert way <= 0.05 * bound[joint] + 1e-12
            if column == 0:  # nothing before it moves
                assert way >= 0.95 * 0.05 * bound[joint]


def test_the_bound_of_motion_is_finite_where_a_slide_is_locked_and_the_first_joint_is_endless(odd_robot: Robot) -> None:
    kept = [0, 2, 3]
    limits = replace(
        odd_robot.limits,
        **{
            name: getattr(odd_robot.limits, name)[kept]
            for name in ("lower", "upper", "velocity", "acceleration", "jerk")
        },
    )
    locked = tuple(odd_robot.joints[i] for i in kept)
    arm = load_model(replace(odd_robot, joints=locked, home=np.zeros(3), limits=limits))
    hand = Body("hand", arm.full.getJointId("swing"), Pose.identity(), "sphere", (0.1,))
    foot = Body("foot", 0, Pose.identity(), "floor")
    assert np.isfinite(rates(arm, [foot, hand], np.array([[0, 1]]))).all()


def test_joints_before_both_bodies_do_not_count() -> None:
    arm = arm_of("panda")
    bodies = link_bodies(arm)
    names = [body.name for body in bodies]
    pair = np.array([[names.index("panda_link5"), names.index("panda_link7")]])
    assert_array_equal(rates(arm, bodies, pair)[0] > 0.0, [False] * 5 + [True] * 2 + [False])


@pytest.mark.parametrize("seed", range(5))
def test_nodes_are_dense_enough(arm: ArmModel, seed: int) -> None:
    """Between two nodes each joint is monotonic, and no pair moves by more than STEP_M."""
    trajectory, _ = spline(arm, seed)
    trajectory = replace(trajectory, gripper_t=np.array([0.0, 0.5, 0.9]), gripper_opening=np.array([1.0, 1.0, 0.2]))
    bound = links_only(arm).rates
    path = sample_trajectory(trajectory, bound, STEP_M)
    assert (path.t[0], path.t[-1]) == (0.0, trajectory.duration)
    assert (np.diff(path.t) > 0.0).all()
    motion = bound @ np.abs(np.diff(path.x.T))
    assert motion.max() <= STEP_M * (1.0 + 1e-9)
    assert motion.max() > 0.3 * STEP_M  # and not closer than they must be
    for share in np.linspace(0.1, 0.9, 5):
        between = trajectory.at(path.t[:-1] + share * np.diff(path.t))
        x = np.column_stack((between.q, between.gripper))
        low, high = np.minimum(path.x[:-1], path.x[1:]), np.maximum(path.x[:-1], path.x[1:])
        assert (x >= low - 1e-12).all()
        assert (x <= high + 1e-12).all()


def test_nodes_are_dense_enough_in_a_piece_that_is_faster_than_the_one_before(arm: ArmModel) -> None:
    trajectory, _ = spline(arm, 0)
    powers = np.zeros((2, 4, 7))
    powers[:, 0], powers[:, 1] = arm.robot.home + np.array([[0.0], [0.005]]), np.array([[0.01], [1.0]])
    trajectory = replace(trajectory, knots=np.array([0.0, 0.5, 0.7]), coefficients=powers)
    bound = links_only(arm).rates
    assert (bound @ np.abs(np.diff(sample_trajectory(trajectory, bound, STEP_M).x.T))).max() <= STEP_M * (1.0 + 1e-9)


def test_a_part_of_a_trajectory(arm: ArmModel) -> None:
    trajectory, _ = spline(arm, 0)
    path = sample_trajectory(trajectory, links_only(arm).rates, STEP_M, 0.7, 1.1)
    assert (path.t[0], path.t[-1]) == (0.7, 1.1)
    assert_array_equal(path.x[:, :-1], trajectory.at(path.t).q)


class Counted(Clearance):
    """Counts the distances that are measured."""

    looks = 0

    def _distance(self, pair: int) -> float:
        self.looks += 1
        return super()._distance(pair)


def swing(arm: ArmModel, angle: float) -> JointPath:
    home: Array = arm.robot.home
    return sample_polyline(np.stack((home, home + angle * np.eye(7)[0])), 1.0, np.ones((1, 8)), STEP_M)


def beside(arm: ArmModel, gap: float, size: float = 0.1) -> Clearance:
    """Return the panda's hand and a sphere; as joint 1 turns, the hand passes it at `gap`, m, after 0.6 rad."""
    hand = next(body for body in link_bodies(arm) if body.name == "panda_hand")
    x = np.append(arm.robot.home + 0.6 * np.eye(7)[0], 1.0)
    top = points_of(hand, placements(arm, x))
    corner = top[np.argmax(top[:, 2])]
    middle = corner + np.array([0.0, 0.0, gap + hand.pad + size / 2])
    sphere = Body("ball", 0, Pose.from_rpy(middle, (0, 0, 0)), "sphere", (size,))
    return Counted(arm, [hand, sphere], np.array([[0, 1]]))


def test_a_free_path_needs_few_distances() -> None:
    arm = arm_of("panda")
    clearance = beside(arm, 1.1 * MARGIN_M)
    path = swing(arm, 1.2)
    assert clearance.first_contact(path) is None
    assert isinstance(clearance, Counted)
    assert 2 < clearance.looks < len(path.t) / 3


@pytest.mark.parametrize("depth", [0.004, 0.03])
def test_a_contact_is_found_with_its_beginning_end_and_depth(depth: float) -> None:
    arm = arm_of("panda")
    clearance, path = beside(arm, -depth), swing(arm, 1.2)
    met = clearance.first_contact(path)
    dense = np.array([clearance.distances(x)[0] for x in path.x])
    assert met is not None
    inside = np.flatnonzero(dense < MARGIN_M)
    assert abs(path.t[met.first] - path.t[inside[0]]) * 1.2 * 0.9 < STEP_M
    assert abs(path.t[met.last] - path.t[inside[-1]]) * 1.2 * 0.9 < 2 * STEP_M
    assert met.distance == pytest.approx(-depth, abs=0.2 * STEP_M)
    assert clearance.distances(path.x[met.deepest])[0] == met.distance


def test_a_contact_that_leaves_a_part_of_the_margin_is_found() -> None:
    """A small ball on a lever of 1 m, the bound of whose motion is tight, ends half a margin before another."""
    arm, turn = arm_of("panda"), 0.01
    pose = placements(arm, np.append(arm.robot.home, 1.0))[1]
    ahead = turn * 1.0 + 0.5 * MARGIN_M + 0.001
    balls = [
        Body("ball", 1, Pose.from_rpy((1.0, 0.0, 0.0), (0, 0, 0)), "sphere", (0.001,)),
        Body("other", 0, pose @ Pose.from_rpy((1.0, ahead, 0.0), (0, 0, 0)), "sphere", (0.001,)),
    ]
    clearance, path = Clearance(arm, balls, np.array([[0, 1]])), swing(arm, turn)
    assert 0.0 < clearance.distances(path.x[-1])[0] < MARGIN_M
    assert clearance.first_contact(path) is not None


def test_a_graze_at_the_smaller_margin_is_found_wherever_the_nodes_lie() -> None:
    """Two balls of 1 mm at the end of a lever of 1 m overlap by 0.3 mm, for 1.4 mm of a motion of 0.6 m."""
    arm, scene = arm_of("panda"), CollisionScene(arm_of("panda")).closer()
    start, end = (arm.robot.home + turn * np.eye(7)[0] for turn in (-0.3, 0.3))
    trajectory, _ = time_moves(arm, start, [Move(end[None])], [0.0], [None])
    at_start = placements(arm, np.append(start, 1.0))[1]
    ball = Body("ball", 1, Pose.from_rpy((1.0, 0.0, 0.0), (0, 0, 0)), "sphere", (0.001,))
    for turned in np.linspace(0.3, 0.31, 11):
        middle = (np.cos(turned), np.sin(turned), 0.0007)
        other = Body("other", 0, at_start @ Pose.from_rpy(middle, (0, 0, 0)), "sphere", (0.001,))
        scene.always = Clearance(arm, [ball, other], np.array([[0, 1]]), CLOSE_M)
        assert len(all_hits(scene, trajectory)) == 1


@pytest.mark.parametrize("shape", ["cylinder", "capsule"])
def test_the_outline_of_a_round_rod_is_its_axis_and_its_radius(shape: str) -> None:
    points, radius = outline(Body("rod", 0, Pose.identity(), shape, (0.1, 0.4)))
    assert points.tolist() == [[0.0, 0.0, -0.2], [0.0, 0.0, 0.2]]
    assert radius == pytest.approx(0.05)


def test_an_allowed_contact_is_ignored() -> None:
    arm = arm_of("panda")
    clearance, path = beside(arm, -0.01), swing(arm, 1.2)
    clearance.allowed = {0: lambda T_base_tool: True}
    assert clearance.first_contact(path) is None
    clearance.allowed = {0: lambda T_base_tool: bool(np.arctan2(T_base_tool.p[1], T_base_tool.p[0]) < 0.6)}
    met = not_none(clearance.first_contact(path))
    assert 0.6 <= path.x[met.first, 0] < 0.61


def test_the_distances_at_both_ends_save_measurements_between(monkeypatch: pytest.MonkeyPatch) -> None:
    """They cover so much of the path that its middle covers the rest."""
    arm = arm_of("panda")
    clearance = beside(arm, 0.05)
    distance = Mock(wraps=clearance._distance)
    monkeypatch.setattr(clearance, "_distance", distance)
    assert not clearance.touches_on(swing(arm, 0.9))
    distance.assert_called_once()


def test_the_first_contact_does_not_depend_on_the_order_of_pairs() -> None:
    arm = arm_of("panda")
    clearance = beside(arm, -0.02)
    ball = clearance.bodies[1]
    early = replace(ball, name="early", T_joint_body=Pose(np.zeros(3), quat_about_z(-0.3)) @ ball.T_joint_body)
    bodies = [*clearance.bodies, early]
    for pairs in ([[0, 1], [0, 2]], [[0, 2], [0, 1]]):
        met = not_none(Clearance(arm, bodies, np.array(pairs)).first_contact(swing(arm, 1.2)))
        assert pairs[met.pair] == [0, 2]


def test_of_contacts_that_begin_together_the_deepest_is_named() -> None:
    arm = arm_of("panda")
    back, (hand, _) = Pose(np.zeros(3), quat_about_z(-0.6)), beside(arm, 0.0).bodies
    balls = [beside(arm, -depth).bodies[1] for depth in (0.02, 0.03)]
    bodies = [hand, *(replace(ball, name=str(ball), T_joint_body=back @ ball.T_joint_body) for ball in balls)]
    for pairs in ([[0, 1], [0, 2]], [[0, 2], [0, 1]]):
        met = not_none(Clearance(arm, bodies, np.array(pairs)).first_contact(swing(arm, 1.2)))
        assert pairs[met.pair] == [0, 2]


def dropped(arm: ArmModel) -> dict[frozenset[str], str]:
    return {frozenset((pair.first, pair.second)): pair.why for pair in link_pairs(arm)[1]}


def test_the_unchecked_pairs_of_the_panda() -> None:
    arm = arm_of("panda")
    why = dropped(arm)
    assert why[frozenset(("panda_link2", "panda_link3"))] == "next to each other"
    assert why[frozenset(("panda_hand", "panda_leftfinger"))] == "both belong to the gripper"
    assert why[frozenset(("panda_link0", "panda_link2"))].startswith("SRDF: ")
    watched = {frozenset(link_bodies(arm)[i].name for i in pair) for pair in link_pairs(arm)[0]}
    assert frozenset(("panda_link0", "panda_hand")) in watched
    assert not watched & why.keys()
    assert gripper_links(arm, link_bodies(arm)) == {
        "panda_link7", "panda_hand", "panda_leftfinger", "panda_rightfinger"
    }  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_every_pair_is_checked_or_listed_or_rigid(name: str) -> None:
    arm = arm_of(name)
    bodies, why = arm_bodies(arm), dropped(arm)
    watched = {tuple(pair) for pair in link_pairs(arm)[0]}
    here, there = (placements(arm, x) for x in coordinates(arm, 2))
    for j in range(len(bodies)):
        for i in range(j):
            if (i, j) in watched or frozenset((bodies[i].name, bodies[j].name)) in why:
                continue
            T_i_j, other = ((T[bodies[i].joint].inverse() @ T[bodies[j].joint]).p for T in (here, there))
            assert_allclose(T_i_j, other, atol=1e-12)


NESTED = """<robot name="nested">
<link name="foot"><collision><geometry><sphere radius="{}"/></geometry></collision></link>
<link name="arm"><collision><origin xyz="1 0 0"/><geometry><sphere radius="0.01"/></geometry></collision></link>
<link name="axle"/>
<link name="hand"><collision><geometry><sphere radius="{}"/></geometry></collision></link>
<link name="finger"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="pan" type="revolute"><parent link="foot"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="tilt" type="revolute"><parent link="arm"/><child link="axle"/><origin xyz="0.1 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="axle"/><child link="hand"/><origin xyz="0 0 0.1"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/><origin xyz="0.9 0 0"/>
<axis xyz="1 0 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint></robot>"""


def nested(folder: Path, panda: Robot, radius: float = 0.05, foot: float = 0.3) -> ArmModel:
    """Return an arm whose hand is inside its foot; a link without a shape lies between arm and hand."""
    path = folder / "nested.urdf"
    path.write_text(NESTED.format(foot, radius), encoding="utf-8")
    limits: Any = {name: np.ones(3) for name in ("upper", "velocity", "acceleration", "jerk")}
    return load_model(
        replace(
            panda,
            urdf=path,
            srdf=None,
            base="foot",
            body="hand",
            joints=("pan", "tilt", "turn"),
            home=np.zeros(3),
            gripper=Gripper(("grip",), np.array([0.1]), np.zeros(1), 1.0),
            limits=replace(panda.limits, lower=-np.ones(3), effort=None, **limits),
        )
    )


def test_pairs_that_always_touch_are_listed_as_unchecked(tmp_path: Path, panda: Robot) -> None:
    why = dropped(nested(tmp_path, panda))
    assert why == {
        frozenset(("foot", "arm")): "next to each other",
        frozenset(("arm", "hand")): "next to each other",  # the axle between them is nothing
        frozenset(("hand", "finger")): "both belong to the gripper",
        frozenset(("foot", "hand")): "touch in every configuration",
    }
    assert len(link_pairs(nested(tmp_path, panda))[0]) == 2  # the finger against foot and arm


def test_a_pair_that_touches_less_often_is_checked(tmp_path: Path, panda: Robot) -> None:
    """A smaller foot, which the hand touches only in some tilts."""
    arm = nested(tmp_path, panda)
    body = next(body for body in link_bodies(arm) if body.name == "foot")
    reach = [np.linalg.norm(placements(arm, np.array([0.0, tilt, 0, 1]))[3].p) for tilt in (-1.0, 0.0, 1.0)]
    assert min(reach) < max(reach)
    foot = replace(body, size=(2.0 * float(np.mean((min(reach), max(reach)))) - 0.1,))
    hand = next(body for body in link_bodies(arm) if body.name == "hand")
    clearance = Clearance(arm, [foot, hand], np.array([[0, 1]]))
    assert clearance.always_touching(sample_coordinates(arm, 500), NEARLY_ALWAYS) == {}
    assert (np.array([clearance.distances(x)[0] for x in sample_coordinates(arm, 100)]) < 0.0).any()


def test_pairs_that_nearly_always_touch_are_listed_as_unchecked(tmp_path: Path, panda: Robot) -> None:
    """The hand clears a foot of 13.8 cm only at the smallest tilts, in three of a hundred configurations."""
    why = dropped(nested(tmp_path, panda, foot=0.1378))[frozenset(("foot", "hand"))]
    found = not_none(re.fullmatch(r"touch in (\d+) of 200 random configurations", why))
    assert 190 <= int(found[1]) < 200
    assert dropped(nested(tmp_path, panda, foot=0.1378))[frozenset(("foot", "hand"))] == why
    assert frozenset(("foot", "hand")) not in dropped(nested(tmp_path, panda, foot=0.1334))  # in nine of ten


def test_a_trajectory_of_one_instant(arm: ArmModel) -> None:
    """A stay of the object may have no duration."""
    trajectory: JointTrajectory = spline(arm, 0)[0]
    path = sample_trajectory(trajectory, links_only(arm).rates, STEP_M, 0.7, 0.7)
    assert_array_equal(path.t, [0.7])
    assert links_only(arm).first_contact(path) is None
