"""Joints along a path of the tool are continuous, reach each pose, and never leap."""

from itertools import pairwise

import numpy as np
import pytest

from pbd.arm.choose_motion import choose_motion
from pbd.arm.ik import cartesian
from pbd.arm.ik.branches import find_branches
from pbd.arm.ik.cartesian import LEAP_RAD, OFF_M, OFF_RAD, SPACING_M, SPACING_RAD, follow, keep_on_path, line, refine
from pbd.arm.ik.closed_form import flipped_elbow
from pbd.arm.ik.levenberg_marquardt import Residual
from pbd.arm.ik.partial_pose import is_partial
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import LINE, Motion, MotionRequest
from pbd.arm.timing.path_smoothing import curved_move
from pbd.arm.tool_deviation import off_line
from pbd.pose import Array, Pose, quat_rotate, quat_slerp
from tests.arm.bundled import NAMES, arm_of
from tests.not_none import not_none

SIX_AND_MORE = [name for name in NAMES if not is_partial(arm_of(name))]


def along(arm: ArmModel, distance: float) -> tuple[Pose, ...]:
    """Return a line from home toward the base and down, with a rotation about the tool's axis."""
    home = arm.forward(arm.robot.home)
    inward = -home.p * (1.0, 1.0, 0.0) / np.linalg.norm(home.p[:2]) + (0.0, 0.0, -0.5)
    return line(home, Pose(home.p + distance * inward, (home @ Pose.from_rpy((0, 0, 0), (0, 0, 0.4))).wxyz))


def known_ends(arm: ArmModel, poses: tuple[Pose, ...]) -> tuple[Array, Array]:
    q = arm.robot.home
    for pose in poses:
        found = not_none(refine(arm, pose, q))
        q = found
    return arm.robot.home, q


@pytest.mark.parametrize("name", NAMES)
def test_each_pose_is_reached_and_no_joint_leaps(name: str) -> None:
    arm = arm_of(name)
    poses = along(arm, 0.05)
    q = not_none(follow(arm, poses, *known_ends(arm, poses)))
    assert np.abs(np.diff(q, axis=0)).max() < LEAP_RAD
    for pose, joints in zip(poses, q, strict=True):
        distance, angle = pose.distance(arm.forward(joints))
        assert distance < 1e-8
        assert angle < (1e-8 if not is_partial(arm) else 0.5)
    assert (q >= arm.limits.lower).all()
    assert (q <= arm.limits.upper).all()


@pytest.mark.parametrize("name", SIX_AND_MORE)
def test_the_tool_stays_on_the_line(name: str) -> None:
    """A straight move in joint space leaves the line."""
    arm = arm_of(name)
    poses = along(arm, 0.1)
    q = not_none(follow(arm, poses, *known_ends(arm, poses)))
    straight = np.linspace(q[0], q[-1], len(q))
    assert off_line(arm.forward_many(q)[0]) < 1e-7
    assert off_line(arm.forward_many(straight)[0]) > 1e-4


def test_off_line_is_the_distance_from_a_line() -> None:
    """Computed by hand, point by point."""
    arm = arm_of("ur5")
    q = np.linspace(arm.robot.home, arm.robot.home + np.array([0.5, 0.3, -0.2, 0.1, 0.4, 0.0]), 20)
    places = arm.forward_many(q)[0]
    way = (places[-1] - places[0]) / np.linalg.norm(places[-1] - places[0])
    expected = max(float(np.linalg.norm(np.cross(place - places[0], way))) for place in places)
    assert off_line(places) == pytest.approx(expected, rel=1e-9)
    assert off_line(np.repeat(places[:1], 3, axis=0)) == 0.0


def test_another_branch_is_a_leap() -> None:
    """The same pose with another wrist or elbow cannot be reached along the path."""
    arm = arm_of("ur5")
    poses = along(arm, 0.1)
    start, end = known_ends(arm, poses)
    others = [q for q in find_branches(arm, poses[-1], arm.robot.home[None], 80) if np.abs(q - end).max() > 0.5]
    assert len(others) >= 3
    for other in others:
        assert follow(arm, poses, start, other) is None


def test_an_elbow_that_flips_by_a_fifth_of_a_radian_is_a_leap() -> None:
    """The arm is stretched out except for 0.1 rad."""
    arm, q = arm_of("ur5"), np.array([0.3, -1.2, 0.1, -1.0, -1.4, 0.2])
    here = arm.forward(q)
    lower = Pose(here.p - np.array([0.0, 0.0, 1e-3]), here.wxyz)
    flipped = not_none(flipped_elbow(arm, q))
    end = not_none(refine(arm, lower, flipped))
    assert 0.1 < np.abs(end - q).max() < 0.25
    assert follow(arm, (here, lower), q, end) is None


@pytest.mark.parametrize(("rpy", "q5", "follows"), [((1.0, 0.0, 0.0), 0.002, True), ((0.0, 1.0, 0.0), 0.02, False)])
def test_a_wrist_near_its_singularity_may_turn_fast(rpy: tuple[float, float, float], q5: float, follows: bool) -> None:
    """Two degrees of the tool turn joints 4 and 6 by 3.4 or 1.2 rad; less than half of it in an eighth, or more."""
    arm, middle = arm_of("ur5"), np.array([0.3, -1.2, 1.4, -1.0, q5, 0.2])
    turns, ends = np.linspace(0.0, 0.0175, 101), []
    for side in (-1.0, 1.0):
        q = middle
        for turn in side * turns:
            found = not_none(refine(arm, arm.forward(middle) @ Pose.from_rpy((0, 0, 0), turn * np.array(rpy)), q))
            q = found
        ends.append(q)
    assert np.abs(ends[1] - ends[0]).max() > 1.2
    poses = [arm.forward(q) for q in ends]
    assert (follow(arm, poses, ends[0], ends[1]) is not None) == follows


def test_newton_stops_once_a_pose_is_met_and_gives_up_after_twelve_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, calls = arm_of("ur5"), list[Array]()

    class Counted(Residual):
        def __call__(self, q: Array) -> tuple[Array, Array]:
            calls.append(q)
            return super().__call__(q)

    monkeypatch.setattr(cartesian, "Residual", Counted)
    home = arm.robot.home
    far = Pose.from_rpy((3.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for pose, seed, count in ((arm.forward(home), home, 1), (arm.forward(home), home + 1e-3, 3), (far, home, 12)):
        calls.clear()
        assert (refine(arm, pose, seed) is None) == (pose is far)
        assert len(calls) == count


def test_a_singular_seed_is_no_error() -> None:
    """All joints of the arm are at zero."""
    assert refine(arm_of("ur5"), Pose.from_rpy((0.3, 0.3, 0.3), (0.0, 0.0, 0.0)), np.zeros(6)) is None


def test_a_path_out_of_reach_is_not_followed() -> None:
    arm = arm_of("ur5")
    home = arm.forward(arm.robot.home)
    far = Pose(home.p + np.array([2.0, 0.0, 0.0]), home.wxyz)
    poses = (*line(home, far), *line(far, home))
    assert follow(arm, poses, arm.robot.home, arm.robot.home) is None


def test_lines_are_straight_and_their_poses_close() -> None:
    start, end = Pose.from_rpy((0.1, 0.2, 0.3), (3.0, 0.1, 0.2)), Pose.from_rpy((0.3, 0.0, 0.4), (2.0, 0.3, -0.4))
    poses = line(start, end)
    assert (poses[0], poses[-1]) == (start, end)
    assert len(line(start, Pose(start.p + 1e-3, start.wxyz))) == 8
    steps = [a.distance(b) for a, b in pairwise(poses)]
    assert max(distance for distance, _ in steps) <= SPACING_M + 1e-12
    assert max(angle for _, angle in steps) <= SPACING_RAD + 1e-12
    np.testing.assert_allclose([distance for distance, _ in steps], steps[0][0], rtol=1e-9)
    np.testing.assert_allclose([angle for _, angle in steps], steps[0][1], rtol=1e-6)
    axis = quat_rotate(start.wxyz, (start.inverse() @ end).log()[3:])
    for pose in poses[1:]:  # about one axis
        turned = quat_rotate(start.wxyz, (start.inverse() @ pose).log()[3:])
        np.testing.assert_allclose(np.cross(turned, axis), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_a_redundant_arm_led_around_a_square_comes_back_as_it_left(name: str) -> None:
    """Otherwise its elbow would drift, and the last step would have to make up for it."""
    arm = arm_of(name)
    home = arm.forward(arm.robot.home)
    corners = [Pose(home.p + np.array((0.0, *yz)), home.wxyz)
               for yz in ((0.0, 0.0), (0.2, 0.0), (0.2, -0.2), (-0.2, -0.2), (-0.2, 0.0), (0.0, 0.0))]  # fmt: skip
    poses = [home, *(pose for start, end in pairwise(corners) for pose in line(start, end)[1:])]
    q = not_none(follow(arm, poses, arm.robot.home, arm.robot.home))
    steps = np.abs(np.diff(q, axis=0)).max(axis=1)
    assert steps[-1] < 2.0 * steps[:-1].max()


def off_the_line(arm: ArmModel, q: Array, ends: tuple[Pose, Pose]) -> tuple[float, float]:
    """Return how far the tool is off its line (m) and its even turn (rad) in the timed motion through joints (n, k).

    The turn is compared at the same share of the line.
    """
    pieces, (start, end) = curved_move(q, arm.limits, 0.95), ends
    at = np.vstack([pieces.coefficients[::3, 0], q[-1:]])
    p, _ = arm.forward_many(at)
    along = end.p - start.p
    shares = np.clip((p - start.p) @ along / (along @ along), 0.0, 1.0)
    wanted = quat_slerp(start.wxyz, end.wxyz, shares)
    held = [arm.forward(each).distance(Pose(start.p, wxyz))[1] for each, wxyz in zip(at, wanted, strict=True)]
    return float(off_line(p)), max(held)


@pytest.mark.parametrize(
    ("name", "seed", "off_m"), [("panda", 1086, 0.016), ("ur3", 1030, 8e-4), ("so101", 1055, 0.02)]
)
def test_the_tool_is_kept_on_its_line_where_joints_turn_fast(name: str, seed: int, off_m: float) -> None:
    """Between two poses 5 mm apart a joint moves by up to 0.9 rad: the curve through the joints left the line there."""
    arm, rng = arm_of(name), np.random.default_rng(seed)
    lower, upper = np.maximum(arm.limits.lower, -np.pi) + 0.05, np.minimum(arm.limits.upper, np.pi) - 0.05
    q_start = rng.uniform(lower, upper)
    ends = arm.forward(q_start), arm.forward(np.clip(q_start + rng.normal(0.0, 0.5, len(lower)), lower, upper))
    motion = choose_motion(arm, MotionRequest(ends, arm.robot.home, approach=False, kind=LINE), None)
    assert isinstance(motion, Motion)
    poses, followed = line(*ends), np.vstack((motion.q[0], motion.segments[1].q))
    assert off_the_line(arm, followed, ends)[0] > off_m
    q = keep_on_path(arm, poses, followed)
    assert len(poses) < len(q) < len(poses) + 10
    off, turned = off_the_line(arm, q, ends)
    assert off < 2.0 * OFF_M
    assert turned < 2.0 * OFF_RAD or is_partial(arm)
    given = [int(np.flatnonzero((q == each).all(axis=1))[0]) for each in followed]  # they all stay, in order
    assert given == sorted(set(given))


def test_nothing_is_added_where_the_tool_is_on_its_path() -> None:
    arm = arm_of("ur5")
    poses = along(arm, 0.1)
    q = not_none(follow(arm, poses, *known_ends(arm, poses)))
    np.testing.assert_array_equal(keep_on_path(arm, poses, q), q)
    here = np.repeat(q[:1], 8, axis=0)
    np.testing.assert_array_equal(keep_on_path(arm, poses[:1] * 8, here), here)
