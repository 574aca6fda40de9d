"""Keyframes of takes are matched in any frame, with missing and additional stops."""

import numpy as np
import pytest

from pbd.fusion.matching import Keyframes, Registration, align_takes, match_by_moves, register
from tests.fusion.made_up_takes import rotations


def keyframes(seed: int = 0, count: int = 7) -> Keyframes:
    rng = np.random.default_rng(seed)
    p, R = rng.uniform(-0.2, 0.2, (count, 3)), rotations(rng.normal(size=(count, 3)))
    return Keyframes(p, R, (None,) * count, np.full(count, 1e-3))


def subset(one: Keyframes, index: list[int]) -> Keyframes:
    return Keyframes(one.p[index], one.R[index], tuple(one.grip[i] for i in index), one.sigma[index])


ELSEWHERE = Registration(2.0, np.array((1.0, -2.0, 0.3)), rotations(np.array((0.0, 1.5, 0.2))))


def test_a_take_in_another_frame_with_missing_stops_is_matched_by_its_moves() -> None:
    here = keyframes(count=9)
    for shown in ([0, 1, 3, 4, 6], [0, 5, 6, 7, 8]):
        there = ELSEWHERE.apply(subset(here, shown))
        assert match_by_moves(here, there)[: len(shown)] == [(i, j) for j, i in enumerate(shown)]


def test_registration_finds_the_frame_and_the_rotation_in_the_hand() -> None:
    here = keyframes()
    there = ELSEWHERE.apply(here)
    back = register(here, there, [(i, i) for i in range(len(here))]).apply(there)
    np.testing.assert_allclose(back.p, here.p, atol=1e-4)
    np.testing.assert_allclose(back.R, here.R, atol=1e-3)


def test_positions_outweigh_rotations_in_a_registration() -> None:
    """Each keyframe is turned by 0.2 rad about the vertical in its place. A lever of 0.1 m weighs turns against places
    that are about 0.2 m from the middle.
    """
    here = keyframes()
    there = Keyframes(here.p, rotations(np.array((0.0, 0.0, 0.2))) @ here.R, here.grip, here.sigma)
    assert 0.02 < -register(here, there, [(i, i) for i in range(len(here))]).yaw < 0.08


def test_a_keyframe_of_most_takes_is_kept_even_if_the_first_lacks_it() -> None:
    task = keyframes()
    takes = [subset(task, [0, 1, 2, 4, 5, 6]), task, ELSEWHERE.apply(task), subset(task, [0, 1, 2, 3, 4, 6])]
    found = align_takes(takes)
    assert [sorted(own.items()) for own in found.kept()[1]][3] == [(1, 3), (2, 3), (3, 3)]
    assert len(found.kept()[1]) == 7


def test_a_take_that_begins_elsewhere_is_of_another_task() -> None:
    here = keyframes()
    there = Keyframes(here.p + (np.arange(7) == 0)[:, None] * (0.3, 0.0, 0.0), here.R, here.grip, here.sigma)
    assert align_takes([here, there]).strangers == (1,)


def test_a_keyframe_of_few_takes_is_left_out() -> None:
    task = keyframes()
    found = align_takes([task, subset(task, [0, 1, 2, 4, 5, 6]), subset(task, [0, 1, 2, 4, 5, 6])])
    assert [own[0] for own in found.kept()[1]] == [0, 1, 2, 4, 5, 6]


@pytest.mark.parametrize("seed", range(5))
def test_another_task_is_a_stranger(seed: int) -> None:
    task = keyframes(seed)
    assert align_takes([task, ELSEWHERE.apply(task), keyframes(seed + 100)]).strangers == (2,)
    assert align_takes([keyframes(seed + 100), task, ELSEWHERE.apply(task)]).strangers == (0,)


def test_a_take_that_starts_elsewhere_is_a_stranger_whatever_matches_by_chance() -> None:
    task = keyframes(count=8)
    assert align_takes([subset(task, [0, 2, 3, 4]), subset(task, [1, 2, 3, 4, 5, 6, 7])]).strangers == (1,)
    assert align_takes([subset(task, [0, 2, 3, 4]), ELSEWHERE.apply(task)]).strangers == ()


def test_a_take_that_was_cut_short_is_a_stranger() -> None:
    task = keyframes(count=8)
    assert align_takes([task, ELSEWHERE.apply(task), subset(task, [0, 1, 2])]).strangers == (2,)
    assert align_takes([task, ELSEWHERE.apply(task), subset(task, [0, 1, 2, 3])]).strangers == ()


def test_the_first_take_is_no_reference_if_most_have_another_number_of_stops() -> None:
    """Its own mistaken stop would shift what the others are compared with."""
    task = keyframes()
    found = align_takes([subset(task, [0, 1, 2, 4, 5, 6]), task, ELSEWHERE.apply(task)])
    assert next(iter(found.registered)) == 1


def test_grips_distinguish_stops_side_by_side() -> None:
    one = keyframes(count=6)
    p = one.p.copy()
    p[3] = p[2] + 0.01  # within a hand's scatter
    R = one.R.copy()
    R[3] = R[2]
    grip = (None, None, True, None, None, None)
    here = Keyframes(p, R, grip, one.sigma)
    there = subset(Keyframes(p, R, (None, None, None, True, None, None), one.sigma), [0, 1, 3, 4, 5])
    assert (2, 2) in match_by_moves(here, there)
