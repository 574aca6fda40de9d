from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruckig import InputParameter, Ruckig, Trajectory

from pbd.arm.model import ArmModel, load_model
from pbd.arm.timing.piecewise_cubic import WITHIN, PiecewiseCubic
from pbd.arm.timing.time_moves import APPROACH_SPEED, Move, ptp_move, time_moves
from pbd.audit.limits import check_limits, check_smoothness
from pbd.data import JointTrajectory
from pbd.errors import PbdWarning, PlanError
from pbd.pose import Array
from tests.arm.conftest import random_joints
from tests.arm.straight_moves import time_keyframes
from tests.not_none import not_none


def move(arm: ArmModel, start: Array, end: Array, speed: float = 1.0) -> JointTrajectory:
    return time_keyframes(arm, np.array([start, end]), [0, 0], [None, None], start, speed=speed, approach=False)


def shortest(arm: ArmModel, start: Array, end: Array) -> float:
    """Oracle: the time of the slowest joint alone, s; no motion of all joints can be faster."""
    limits, k = arm.limits, len(start)
    wanted, found = InputParameter(k), Trajectory(k)
    wanted.current_position, wanted.target_position = start, end
    # Moves keep a billionth below each limit, for rounding errors.
    wanted.max_velocity, wanted.max_acceleration = WITHIN * limits.velocity, WITHIN * limits.acceleration
    wanted.max_jerk = WITHIN * limits.jerk
    Ruckig(k).calculate(wanted, found)
    return float(max(found.independent_min_durations))


def test_moves_are_straight_and_hardly_longer_than_they_must_be(arm: ArmModel) -> None:
    ratios = []
    for start, end in zip(random_joints(arm.robot, 30, seed=1), random_joints(arm.robot, 30, seed=2), strict=True):
        trajectory = move(arm, start, end)
        ratios.append(trajectory.duration / shortest(arm, start, end))
        share = (trajectory.sample(200.0).q - start) @ (end - start) / ((end - start) @ (end - start))
        np.testing.assert_allclose(trajectory.sample(200.0).q, start + share[:, None] * (end - start), atol=1e-12)
        assert (np.diff(share) > -1e-12).all()
    assert min(ratios) >= 1 - 1e-9
    assert np.mean(ratios) < 1.05


def test_one_joint_alone_is_as_fast_as_ruckig(arm: ArmModel) -> None:
    home = arm.robot.home
    for joint in range(7):
        end = home + 0.3 * np.eye(7)[joint]
        assert move(arm, home, end).duration == pytest.approx(shortest(arm, home, end), rel=1e-12)


def test_derivatives_are_those_of_the_position(arm: ArmModel) -> None:
    """Central differences at a fine step, away from the knots, where the jerk jumps."""
    trajectory = time_keyframes(arm, random_joints(arm.robot, 4, 3), [0, 0.2, 0, 0], [None] * 4, arm.robot.home)
    step = 1e-4
    t = np.linspace(step, trajectory.duration - step, 4000)
    t = t[np.abs(t[:, None] - trajectory.knots).min(axis=1) > step]
    before, here, after = trajectory.at(t - step), trajectory.at(t), trajectory.at(t + step)
    jerk = arm.limits.jerk.max()
    np.testing.assert_allclose((after.q - before.q) / (2 * step), here.qd, atol=jerk * step**2)
    np.testing.assert_allclose((after.qd - before.qd) / (2 * step), here.qdd, atol=jerk * step**2)


def test_each_move_uses_one_limit_fully_and_exceeds_none(arm: ArmModel) -> None:
    for start, end in zip(random_joints(arm.robot, 20, seed=4), random_joints(arm.robot, 20, seed=5), strict=True):
        samples = move(arm, start, end).sample(2000.0)
        velocity = (np.abs(samples.qd) / arm.limits.velocity).max()
        acceleration = (np.abs(samples.qdd) / arm.limits.acceleration).max()
        assert max(velocity, acceleration) == pytest.approx(1.0, abs=1e-6)


def test_keyframes_are_reached_exactly_and_dwells_kept(arm: ArmModel) -> None:
    q, dwells = random_joints(arm.robot, 5, seed=6), [0.0, 0.3, 0.15, 0.5, 0.0]
    trajectory = time_keyframes(arm, q, dwells, [None] * 5, arm.robot.home)
    np.testing.assert_allclose(trajectory.at(trajectory.keyframe_t).q, q, atol=1e-12)
    np.testing.assert_allclose(trajectory.at(trajectory.keyframe_t + dwells).q, q, atol=1e-12)
    for t, dwell in zip(trajectory.keyframe_t, dwells, strict=True):
        assert (trajectory.at(np.linspace(t, t + dwell, 5)[1:-1]).qd == 0.0).all() or dwell == 0.0
    # nothing but moves and dwells
    moves = [move(arm, a, b).duration for a, b in pairwise(q)]
    approach = move(arm, arm.robot.home, q[0], speed=APPROACH_SPEED).duration
    assert trajectory.duration == pytest.approx(approach + sum(moves) + sum(dwells), rel=1e-12)
    assert trajectory.keyframe_t[0] == pytest.approx(approach, rel=1e-12)
    assert trajectory.knots[0] == 0.0
    assert trajectory.joint_names == arm.robot.joints


def test_speed_is_a_share_of_every_limit(arm: ArmModel) -> None:
    start, end = random_joints(arm.robot, 2, seed=8)
    slower = replace(
        arm.limits, velocity=arm.limits.velocity / 4, acceleration=arm.limits.acceleration / 4, jerk=arm.limits.jerk / 4
    )
    slow_arm = load_model(replace(arm.robot, limits=slower))
    assert move(arm, start, end, speed=0.25).duration == pytest.approx(move(slow_arm, start, end).duration, rel=1e-12)


def test_the_gripper_moves_while_the_arm_stands(arm: ArmModel) -> None:
    stroke = not_none(arm.robot.gripper).stroke_s
    q = random_joints(arm.robot, 5, seed=9)
    trajectory = time_keyframes(arm, q, [0.0, 0.1, 2.0, 0.1, 0.0], [None, True, True, False, None], arm.robot.home)
    t = trajectory.keyframe_t
    np.testing.assert_allclose(trajectory.gripper_t, [0, t[1], t[1] + stroke, t[3], t[3] + stroke], rtol=1e-12)
    np.testing.assert_array_equal(trajectory.gripper_opening, [1, 1, 0, 0, 1])
    moving = (trajectory.sample(100.0).gripper > 0) & (trajectory.sample(100.0).gripper < 1)
    assert moving.any()
    assert (trajectory.sample(100.0).qd[moving] == 0.0).all()
    lengths = trajectory.keyframe_t[1:] - trajectory.keyframe_t[:-1]
    assert lengths[2] == pytest.approx(2.0 + move(arm, q[2], q[3]).duration)  # already closed: its own dwell


def test_a_grip_without_a_gripper_is_left_out_with_a_warning(arm: ArmModel) -> None:
    bare = load_model(replace(arm.robot, gripper=None))
    q = random_joints(arm.robot, 2, seed=10)
    expected = "panda has no gripper: the grip at keyframe 1 is ignored; add a [gripper] in its TOML"
    with pytest.warns(PbdWarning) as caught:
        trajectory = time_keyframes(bare, q, [0, 0], [None, True], arm.robot.home)
    assert [str(warning.message) for warning in caught] == [expected]
    np.testing.assert_array_equal(trajectory.gripper_opening, [1])


def test_coincident_keyframes_take_no_time(arm: ArmModel) -> None:
    home = arm.robot.home
    q = np.array([home, home, home + 0.2, home + 0.2, home + 0.2])
    trajectory = time_keyframes(arm, q, [0, 0, 0, 0.3, 0], [None] * 5, home)
    assert trajectory.keyframe_t[0] == trajectory.keyframe_t[1] == 0.0
    assert trajectory.keyframe_t[2] == trajectory.keyframe_t[3]
    assert trajectory.keyframe_t[4] == pytest.approx(trajectory.keyframe_t[3] + 0.3)


def test_a_motion_in_which_nothing_moves_is_refused(arm: ArmModel) -> None:
    with pytest.raises(
        PlanError, match="nothing moves: the arm already stands at every keyframe; demonstrate a motion"
    ):
        move(arm, arm.robot.home, arm.robot.home)


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.lists(st.floats(-10, 0), min_size=1, max_size=5),
    dwells=st.lists(st.floats(0, 1), min_size=5, max_size=5),
    seed=st.integers(0, 2**32 - 1),
)
def test_pieces_join_however_short_the_moves(
    arm: ArmModel, lengths: Sequence[float], dwells: Sequence[float], seed: int
) -> None:
    """Moves from 1e-10 rad to 1 rad have no jump in position, velocity or acceleration, and time increases."""
    rng = np.random.default_rng(seed)
    steps = [10.0**length * rng.uniform(-1, 1, 7) for length in (0, *lengths)]
    q = arm.robot.home + np.cumsum(steps, axis=0)
    trajectory = time_keyframes(arm, q, [*dwells, 0.0][: len(q)], [None] * len(q), arm.robot.home)
    assert (np.diff(trajectory.knots) > 0).all()
    middle, c = np.diff(trajectory.knots)[:, None], np.moveaxis(trajectory.coefficients, 1, 0)
    end_q = c[0] + middle * (c[1] + middle * (c[2] + middle * c[3]))
    end_qd = c[1] + middle * (2 * c[2] + 3 * middle * c[3])
    end_qdd = 2 * c[2] + 6 * middle * c[3]
    np.testing.assert_allclose(end_q[:-1], c[0][1:], atol=1e-9)
    np.testing.assert_allclose(end_qd[:-1], c[1][1:], atol=1e-9)
    np.testing.assert_allclose(end_qdd[:-1], 2 * c[2][1:], atol=1e-7)
    np.testing.assert_allclose(trajectory.at(trajectory.keyframe_t).q, q, atol=1e-8)


def test_a_move_may_have_corners_where_it_rests(arm: ArmModel) -> None:
    q = random_joints(arm.robot, 4, seed=11)
    trajectory, took = time_moves(arm, q[0], [Move(q[1:3]), Move(q[3:])], [0.0, 0.0], [None, None])
    parts = [move(arm, a, b).duration for a, b in pairwise(q)]
    np.testing.assert_allclose(took, [sum(parts[:2]), parts[2]], rtol=1e-12)
    np.testing.assert_allclose(trajectory.keyframe_t, [sum(parts[:2]), sum(parts)], rtol=1e-12)
    at_corner = trajectory.at(np.array([parts[0]]))
    np.testing.assert_allclose(at_corner.q[0], q[1], atol=1e-9)
    np.testing.assert_allclose(at_corner.qd[0], 0.0, atol=1e-9)


@pytest.mark.parametrize("curved", [False, True])
def test_a_move_takes_at_least_its_least_duration(arm: ArmModel, curved: bool) -> None:
    q = arm.robot.home + np.linspace(0.0, 0.3, 12)[:, None]
    ends = q[1:] if curved else q[-1:]
    fast = time_moves(arm, q[0], [Move(ends, curved=curved)], [0.0], [None])[0]
    slow = time_moves(arm, q[0], [Move(ends, curved=curved, least_s=3.0)], [0.0], [None])[0]
    assert fast.duration < 2.0
    assert slow.duration == pytest.approx(3.0, rel=1e-9)
    same = time_moves(arm, q[0], [Move(ends, curved=curved, least_s=0.1)], [0.0], [None])[0]
    assert same.duration == fast.duration
    shares = np.linspace(0.0, 1.0, 50)
    np.testing.assert_allclose(slow.at(3.0 * shares).q, fast.at(fast.duration * shares).q, atol=1e-9)


@pytest.mark.parametrize("curved", [False, True])
def test_a_move_to_where_the_arm_stands_takes_its_least_duration_too(arm: ArmModel, curved: bool) -> None:
    home = arm.robot.home
    moves = [Move(home[None], curved=curved, least_s=1.5), Move(home[None] + 0.1, least_s=2.0)]
    trajectory, took = time_moves(arm, home, moves, [0.2, 0.0], [None, None])
    np.testing.assert_allclose(took, [1.5, 2.0], rtol=1e-9)
    np.testing.assert_array_equal(trajectory.at(np.linspace(0.0, 1.7, 20)).q, np.tile(home, (20, 1)))


@pytest.mark.parametrize("size", 10.0 ** np.arange(-12.0, -3.0))
def test_the_shortest_curves_are_as_smooth_as_others(arm: ArmModel, size: float) -> None:
    """Out and back, or to the side; the smallest curves are within rounding errors of the joints."""
    home, share = arm.robot.home, np.linspace(0.0, 1.0, 9)[:, None]
    for seed, (end, bulge) in enumerate([(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]):
        along, aside = size * np.random.default_rng(seed).standard_normal((2, len(home)))
        curve = home + end * share * along + bulge * np.sin(np.pi * share) ** 2 * aside
        curve[-1] = home + end * along
        for speed in (0.0095, 0.95):
            moves = [Move(curve[1:], curved=True), Move(home[None] + 0.1)]
            trajectory, _ = time_moves(arm, home, moves, [0.2, 0.0], [None, None], speed=speed)
            check_smoothness(trajectory, arm.limits)
            check_limits(trajectory, arm.limits)


def test_the_retreat_comes_after_the_last_dwell_and_stroke(arm: ArmModel) -> None:
    q = random_joints(arm.robot, 2, seed=12)
    back = Move(arm.robot.home[None], share=APPROACH_SPEED)
    trajectory, _ = time_moves(arm, q[0], [Move(q[:1]), Move(q[1:])], [0, 0], [None, True], retreat=back)
    end, stroke = trajectory.keyframe_t[1], not_none(arm.robot.gripper).stroke_s
    alone = move(arm, q[1], arm.robot.home, speed=APPROACH_SPEED).duration
    assert trajectory.duration == pytest.approx(end + stroke + alone, rel=1e-12)
    assert trajectory.gripper_t[-1] == pytest.approx(end + stroke, rel=1e-12)
    np.testing.assert_allclose(trajectory.q[-1], arm.robot.home, atol=1e-12)
    assert len(trajectory.keyframe_t) == 2


def test_the_shortest_move_takes_a_millisecond(arm: ArmModel) -> None:
    q = np.array(arm.robot.home)
    assert ptp_move(q, q + 1e-12, arm.limits, 1.0).durations.sum() == pytest.approx(1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_peaks_are_the_largest_of_dense_samples(seed: int) -> None:
    rng = np.random.default_rng(seed)
    durations, c = rng.uniform(0.2, 1.5, size=6), rng.normal(size=(6, 4, 3))
    s = np.linspace(0.0, 1.0, 20_001)[:, None, None] * durations[:, None]
    velocity = c[:, 1] + 2.0 * c[:, 2] * s + 3.0 * c[:, 3] * s**2
    acceleration = 2.0 * c[:, 2] + 6.0 * c[:, 3] * s
    jerk = 6.0 * c[:, 3]
    for peak, values in zip(PiecewiseCubic(durations, c).peaks(), (velocity, acceleration, jerk), strict=True):
        np.testing.assert_allclose(peak, np.abs(values).reshape(-1, 3).max(axis=0), rtol=1e-6)
