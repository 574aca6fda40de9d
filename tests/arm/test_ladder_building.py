from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.arm.ik.branches import AT_LIMIT_COST, SINGULAR_COST, configuration_cost, turn_toward
from pbd.arm.ik.solver import ik_result
from pbd.arm.ladder_building import add_turns, build_ladder, joints_to_unwind, turn_variants
from pbd.arm.model import ArmModel, load_model, to_se3
from pbd.data import Robot
from pbd.errors import PlanError
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of
from tests.arm.conftest import changed, random_joints
from tests.arm.straight_moves import solve_path


def travel(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def wander(robot: Robot, keyframes: int, seed: int) -> Array:
    """Return a random joint path (keyframes + 1, k) within limits, with steps of about 1 rad."""
    rng = np.random.default_rng(seed)
    path = [random_joints(robot, 1, seed, margin=0.1)[0]]
    while len(path) <= keyframes:
        q = path[-1] + rng.normal(size=len(path[0])) / np.sqrt(len(path[0]))
        if ((q > robot.limits.lower) & (q < robot.limits.upper)).all():
            path.append(q)
    return np.array(path)


def travel_ratios(arm: ArmModel) -> list[float]:
    """Return the joint travel found for the poses of 7 paths, relative to the travel of those paths."""
    ratios = []
    for seed in range(7):
        truth = wander(arm.robot, 9, seed)
        poses = [arm.forward(q) for q in truth[1:]]
        path = solve_path(arm, poses, truth[0])
        assert all(ik_result(arm, to_se3(pose), q).reached for pose, q in zip(poses, path, strict=True))
        assert ((path >= arm.limits.lower) & (path <= arm.limits.upper)).all()
        ratios.append(travel(np.vstack((truth[0], path))) / travel(truth))
    return ratios


def test_travel_is_less_than_that_of_a_path_known_to_exist(arm: ArmModel) -> None:
    assert max(travel_ratios(arm)) < 1.05


def on_a_lift(robot: Robot, velocity: float, folder: Path) -> ArmModel:
    """Return an arm on a lift of 0.5 m."""
    urdf = folder / "lift.urdf"
    lift = f"""<link name="floor"/><joint name="lift" type="prismatic"><parent link="floor"/><child link="world"/>
        <axis xyz="0 0 1"/><limit lower="0" upper="0.5" velocity="{velocity}" effort="1"/></joint></robot>"""
    urdf.write_text(robot.urdf.read_text().replace("</robot>", lift))
    limits = {name: np.append(value, getattr(robot.limits, name)) for name, value in LIFT.items()}
    limits["velocity"] = np.append(velocity, robot.limits.velocity)
    joints, home = ("lift", *robot.joints), np.append(0.2, robot.home)
    lifted = replace(robot, urdf=urdf, base="floor", joints=joints, home=home, limits=changed(robot.limits, **limits))
    return load_model(lifted)


LIFT = {"lower": 0.0, "upper": 0.5, "acceleration": 1.0, "jerk": 10.0, "effort": 1.0}


def test_a_lift_moves_only_as_far_as_that_saves_time(tmp_path: Path) -> None:
    robot = arm_of("ur5").robot
    turned = []
    for velocity in (0.05, 5.0):
        arm = on_a_lift(robot, velocity, tmp_path)
        scale = np.append(np.median(robot.limits.velocity) / velocity, np.ones(6))
        for seed in range(3):
            truth = np.hstack((np.full((7, 1), 0.2), wander(robot, 6, seed)))
            path = np.vstack((truth[:1], solve_path(arm, [arm.forward(q) for q in truth[1:]], truth[0])))
            assert travel(path * scale) < 1.05 * travel(truth)
            turned.append(travel(path[:, 1:]))
    assert np.all(np.array(turned[3:]) < turned[:3])


@pytest.mark.parametrize("name", ["ur5", "kinova", "so101"])
def test_other_arms_travel_little_too(name: str) -> None:
    arm = arm_of(name)
    for seed in range(3):
        truth = wander(arm.robot, 6, seed)
        poses = [arm.forward(q) for q in truth[1:]]
        path = solve_path(arm, poses, truth[0])
        assert travel(np.vstack((truth[0], path))) < 1.05 * travel(truth)
        # Five joints reach these poses too, since they were made from joints.
        off = [pose.distance(arm.forward(q)) for pose, q in zip(poses, path, strict=True)]
        assert np.max(off, axis=0)[0] < 1e-5
        assert np.max(off, axis=0)[1] < (1e-5 if name != "so101" else 1e-3)


def test_a_still_hand_keeps_the_arm_still(arm: ArmModel) -> None:
    home = arm.robot.home
    path = solve_path(arm, [arm.forward(home)] * 4, home)
    np.testing.assert_array_equal(path, np.tile(home, (4, 1)))


def test_the_null_space_shortens_the_path(arm: ArmModel, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = wander(arm.robot, 6, seed=40)
    poses = [arm.forward(q) for q in truth[1:]]
    slid = solve_path(arm, poses, truth[0])
    monkeypatch.setattr("pbd.arm.ladder_building.SWEEPS", 0)
    unslid = solve_path(arm, poses, truth[0])
    assert travel(np.vstack((truth[0], slid))) < travel(np.vstack((truth[0], unslid)))


def test_no_keyframes_no_path(arm: ArmModel) -> None:
    assert solve_path(arm, [], arm.robot.home).shape == (0, 7)


def test_a_joint_of_many_turns_takes_the_nearest(odd_arm: ArmModel) -> None:
    """The continuous joint may be at any turn, the wrist at one of two: neither may make a whole turn."""
    start = np.array([20.0, 0.2, 6.2, 0.1])
    path = solve_path(odd_arm, [odd_arm.forward(start + step) for step in (0.05, 0.1, 0.15)], start)
    np.testing.assert_allclose(path, start + np.array([[0.05], [0.1], [0.15]]), atol=1e-3)


def test_whole_turns_lead_to_the_nearest(odd_arm: ArmModel) -> None:
    """Oracle: every number of turns is tried."""
    limits, rng = odd_arm.limits, np.random.default_rng(42)
    for _ in range(100):
        q, there = (random_joints(odd_arm.robot, 1, int(seed))[0] for seed in rng.integers(1000, size=2))
        turned = turn_toward(odd_arm, q[None], there[None])[0]
        for joint in range(4):
            turns = 2 * np.pi * np.arange(-4, 5) if odd_arm.turns[joint] else np.zeros(1)
            there_too = q[joint] + turns
            within = there_too[(there_too >= limits.lower[joint]) & (there_too <= limits.upper[joint])]
            least = np.abs(within - there[joint]).min()
            assert abs(turned[joint] - there[joint]) == pytest.approx(least, abs=1e-9)


def test_no_joint_is_unwound_for_a_short_move_within_the_limits() -> None:
    arm = arm_of("ur5")
    q = arm.robot.home + 0.01
    assert arm.turns.any()
    assert joints_to_unwind(arm, arm.forward(q), arm.robot.home, q) == set()


def test_whole_turns_that_a_layer_already_has_are_not_added_again() -> None:
    """Joints that turn by 360 degrees to each side have two variants, and with both there are no others."""
    arm = arm_of("ur5")
    ladder = build_ladder(arm, [arm.forward(arm.robot.home)], arm.robot.home, None, 10)
    different = len(np.unique(np.round(np.mod(ladder.layers[1].q, 2.0 * np.pi), 6), axis=0))
    for joint in (0, 5, 0):
        add_turns(arm, ladder, 1, joint)
    turns = np.round(ladder.layers[1].q, 6)
    assert len(turns) == len(np.unique(turns, axis=0))
    assert len(turns) >= 4 * different
    assert add_turns(arm, ladder, 1, 5) == 0


def test_whole_turns_stay_within_the_limits(odd_robot: Robot) -> None:
    turn = np.array([-np.pi, 0.0, -6.5, -2.0])
    narrow = replace(odd_robot, limits=changed(odd_robot.limits, lower=turn, upper=np.array([np.pi, 0.4, 6.5, 2.0])))
    arm = load_model(narrow)
    start = np.array([3.1, 0.2, 0.0, 0.1])
    beyond = start + np.array([0.2, 0, 0, 0])
    path = solve_path(arm, [arm.forward(beyond)], start)
    np.testing.assert_allclose(path, [beyond - np.array([2 * np.pi, 0, 0, 0])], atol=1e-3)


def test_the_first_keyframe_out_of_reach_is_named(arm: ArmModel) -> None:
    down = (np.pi, 0.0, 0.0)
    poses = [Pose.from_rpy((0.45, 0.0, 0.3), down), Pose.from_rpy((1.2, 0.1, 0.4), down)]
    with pytest.raises(PlanError) as caught:
        solve_path(arm, [poses[0], poses[0], poses[1], poses[1]], arm.robot.home)
    error = caught.value
    centimetres, degrees = 100 * error.fields["value"], np.rad2deg(error.fields["rotation"])
    assert error.fields["keyframe"] == 2
    assert error.fields["bound"] == 1e-5
    assert centimetres > 20
    assert error.message == (
        f"keyframe 2 is out of reach: the tool stays {centimetres:.1f} cm and {degrees:.1f} degrees from its pose at"
        f" (1.200, 0.100, 0.400) m, which is {100 * error.fields['beyond']:.1f} cm beyond the arm's reach;"
        " move the dock"
    )
    assert error.exit_code == 3
    nearest = error.fields["nearest"]
    assert isinstance(nearest, Pose)
    assert nearest.distance(poses[1])[0] == pytest.approx(error.fields["value"])
    assert 0.0 < error.fields["beyond"] <= error.fields["value"]
    assert error.fields["joints"] == ()


def test_a_short_way_out_of_reach_is_told_in_millimetres() -> None:
    """Upper arm and forearm are stretched out along x, and the pose is 0.2 mm farther away."""
    arm = arm_of("ur5")
    stretched = arm.forward(np.array([0.0, 0.0, 0.0, 0.0, -1.5, 0.0]))
    p = stretched.p + np.array([2e-4, 0.0, 0.0])
    with pytest.raises(PlanError, match=r"the tool stays 0\.\d+ mm and 0\.0 degrees from its pose at"):
        solve_path(arm, [Pose(p, stretched.wxyz)], arm.robot.home)


def test_five_joints_fail_only_at_the_position() -> None:
    arm = arm_of("so101")
    with pytest.raises(PlanError) as caught:
        solve_path(arm, [Pose.from_rpy((0.7, 0.0, 0.2), (np.pi, 0.0, 0.0))], arm.robot.home)
    assert caught.value.fields["beyond"] == pytest.approx(caught.value.fields["value"])
    assert "cm beyond the arm's reach" in caught.value.message


# --- limits, singularities --------------------------------------------------------------------------------------------


def test_it_stays_away_from_limits_and_singularities() -> None:
    """Configurations near them cost extra."""
    arm = arm_of("ur5")
    roomy = np.array([0.0, -1.2, 1.6, -1.0, -1.4, 0.0])
    assert configuration_cost(arm, roomy[None])[0] == 0.0
    wrist, pan = roomy.copy(), roomy.copy()
    costs = []
    for by in (0.08, 0.05, 0.02, 0.0):
        wrist[4], pan[0] = by, arm.limits.upper[0] - by  # nearly straight, nearly at its limit
        costs.append(configuration_cost(arm, np.array([wrist, pan])))
    assert (np.diff(costs, axis=0) >= 0.0).all()
    assert (costs[2] > 0.0).all()
    np.testing.assert_allclose(costs[-1], (SINGULAR_COST, AT_LIMIT_COST), atol=1e-6)


def test_the_null_space_leads_away_from_limits(arm: ArmModel) -> None:
    """A seventh joint lets the arm leave the limit at which it starts."""
    start = arm.robot.home.copy()
    start[0] = arm.limits.upper[0] - 0.005
    path = solve_path(arm, [arm.forward(start)] * 3, start)
    assert arm.limit_margins(path[-1]).min() > 0.03


@pytest.mark.parametrize("roll_deg", [-90, -45, 0, 45, 90])
def test_the_surroundings_of_the_dock_are_within_reach(arm: ArmModel, roll_deg: float) -> None:
    """As robots/panda.toml claims: a level sensor in the entire box, a rolled one in the middle of it."""
    dock = arm.robot.dock
    assert dock is not None
    assert dock.T_base_dock is not None
    x, y, z = dock.T_base_dock.p
    assert 0.30 <= x <= 0.65
    assert -0.25 <= y <= 0.25
    assert 0.10 <= z <= 0.45
    across = ((0.30, 0.65), (-0.25, 0.25), (0.10, 0.45)) if roll_deg == 0 else ((0.4, 0.55), (-0.1, 0.1), (0.2, 0.4))
    corners = np.array(np.meshgrid(*across)).reshape(3, -1).T
    poses = [Pose.from_rpy(p, np.deg2rad((roll_deg, 0, 0))) @ dock.T_sensor_tool for p in corners]
    path = solve_path(arm, poses, arm.robot.home)
    assert all(ik_result(arm, to_se3(pose), q).reached for pose, q in zip(poses, path, strict=True))
    assert dock.table_height == 0.0


def test_a_configuration_turned_by_whole_turns_holds_the_tool_where_it_was_and_the_nearest_comes_first() -> None:
    arm = arm_of("ur5")
    q, before = np.array([0.5, -1.0, 1.2, -0.4, 0.9, 3.0]), np.array([0.4, -1.1, 1.0, -0.4, 1.0, -3.0])
    variants = turn_variants(arm, q[None], before[None], 5)
    assert len(np.unique(variants.round(6), axis=0)) == 5
    for each in variants:
        assert max(arm.forward(each).distance(arm.forward(q))) < 1e-9
    far = np.linalg.norm(variants - before, axis=1)
    assert far.tolist() == sorted(far)
    np.testing.assert_allclose(variants[0], q - [0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * np.pi], rtol=0.0, atol=1e-12)
