"""Keyframes that a path may not stand at as it would, and moves that it may not make."""

from __future__ import annotations

import numpy as np
import pytest

from pbd.arm.ik import check
from pbd.arm.model import ArmModel
from pbd.arm.sequence import BarredError, solve_sequence
from pbd.pose import Array
from tests.arm.bundled import arm_of
from tests.arm.test_sequence import wander


def test_nothing_barred_changes_nothing(arm: ArmModel) -> None:
    truth = wander(arm.robot, 4, seed=50)
    poses = [arm.forward(q) for q in truth[1:]]
    asked: list[tuple[int, int]] = []

    def allowed(i: int, q: Array) -> bool:
        asked.append((i, -1))
        return max(arm.forward(q).distance(poses[i])) < 1e-5

    def clear(i: int, q_from: Array, q_to: Array) -> bool:
        asked.append((i, i))
        assert max(arm.forward(q_to).distance(poses[i])) < 1e-5
        assert max(arm.forward(q_from).distance(poses[i - 1] if i else arm.forward(truth[0]))) < 1e-5
        return True

    path = solve_sequence(arm, poses, truth[0], allowed=allowed, clear=clear)
    np.testing.assert_array_equal(path, solve_sequence(arm, poses, truth[0]))
    # Once for each keyframe and each move, and of nothing that isn't on the path.
    assert asked == [(i, -1) for i in range(4)] + [(i, i) for i in range(4)]


def test_what_isnt_allowed_is_avoided() -> None:
    """An elbow that must point up, then one that must point down: the same poses, other ways to hold the arm."""
    arm = arm_of("ur5")
    start = np.array([0.3, -1.3, 1.6, -1.9, -1.57, 0.0])
    poses = [arm.forward(start + shift) for shift in (0.0, 0.1, 0.2)]
    up = solve_sequence(arm, poses, start, allowed=lambda _, q: q[2] > 0.0)
    down = solve_sequence(arm, poses, start, allowed=lambda _, q: q[2] < 0.0)
    assert (up[:, 2] > 0.0).all()
    assert (down[:, 2] < 0.0).all()
    for pose, q in zip(poses * 2, np.vstack((up, down)), strict=True):
        assert check(arm, pose, q).reached
    # Let the elbow change between the first two keyframes: the one that must be down is, the others aren't.
    mixed = solve_sequence(arm, poses, start, allowed=lambda i, q: (q[2] < 0.0) == (i > 0))
    np.testing.assert_array_equal(mixed[:, 2] < 0.0, [False, True, True])


def test_a_move_that_isnt_clear_is_made_between_other_ways() -> None:
    arm = arm_of("ur5")
    start = np.array([0.3, -1.3, 1.6, -1.9, -1.57, 0.0])
    poses = [arm.forward(start + shift) for shift in (0.0, 0.1, 0.2)]

    def clear(i: int, q_from: Array, q_to: Array) -> bool:
        return i != 2 or q_to[2] < 0.0

    path = solve_sequence(arm, poses, start, clear=clear)
    assert path[2, 2] < 0.0
    assert check(arm, poses[2], path[2]).reached


def test_a_keyframe_with_no_way_to_stand_is_named(arm: ArmModel) -> None:
    truth = wander(arm.robot, 4, seed=51)
    poses = [arm.forward(q) for q in truth[1:]]
    with pytest.raises(BarredError) as caught:
        solve_sequence(arm, poses, truth[0], allowed=lambda i, _: i != 2)
    barred = caught.value
    assert (barred.keyframe, barred.stands, barred.exit_code) == (2, False, 3)
    assert barred.message == ("no collision-free arm pose at keyframe 2 was found; move the dock or the obstacle")
    assert all(check(arm, pose, q).reached for pose, q in zip(poses, barred.path, strict=True))


def test_a_move_that_is_never_clear_is_named_and_the_path_is_free_before_it() -> None:
    arm = arm_of("ur5")
    start = np.array([0.3, -1.3, 1.6, -1.9, -1.57, 0.0])
    poses = [arm.forward(start + shift) for shift in (0.0, 0.1, 0.2)]

    def clear(i: int, q_from: Array, q_to: Array) -> bool:
        return i < 2 and q_to[2] < 0.0

    with pytest.raises(BarredError, match=r"^no collision-free way to keyframe 2 was found; ") as caught:
        solve_sequence(arm, poses, start, clear=clear)
    barred = caught.value
    assert (barred.keyframe, barred.stands) == (2, True)
    assert (barred.path[:2, 2] < 0.0).all()


def test_the_way_back_is_part_of_the_path() -> None:
    """One keyframe far round: where it goes from there decides which way to hold the arm is best."""
    arm = arm_of("ur5")
    start = np.array([0.3, -1.3, 1.6, -1.9, -1.57, 0.0])
    pose, turn = arm.forward(start), np.array([0, 0, 0, 0, 0, 2 * np.pi])
    moves: list[tuple[int, Array, Array]] = []

    def clear(i: int, q_from: Array, q_to: Array) -> bool:
        moves.append((i, q_from, q_to))
        return True

    path = solve_sequence(arm, [pose, pose], start, q_end=start, allowed=lambda i, _: i < 2, clear=clear)
    assert path.shape == (2, 6)
    assert [i for i, _, _ in moves] == [0, 1, 2]
    np.testing.assert_array_equal(moves[2][2], start)
    with pytest.raises(BarredError, match=r"^no collision-free way back from keyframe 1 was found; ") as caught:
        solve_sequence(arm, [pose, pose], start, q_end=start + turn, clear=lambda i, _a, _b: i < 2)
    assert (caught.value.keyframe, caught.value.stands) == (2, True)
    assert caught.value.path.shape == (2, 6)
