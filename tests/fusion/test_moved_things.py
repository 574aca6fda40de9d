"""A single keyframe that is elsewhere in each take moved with an object; one that is off in one take did not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pbd.fusion.fuse import _matched
from pbd.fusion.matching import Alignment, Keyframes, Registration
from pbd.fusion.moved_things import MovedKeyframes, another_thing, find_moved_keyframes
from pbd.fusion.takes import initial_estimate
from pbd.pose import Array
from tests.fusion.made_up_takes import rotations, truth

ELSEWHERE = np.array(((0.0, 0.0, 0.0), (0.05, 0.03, 0.0), (-0.04, 0.06, 0.0)))
IN_THE_AIR = ELSEWHERE + np.array(((0.0, 0.0, 0.0), (0.0, 0.0, 0.03), (0.0, 0.0, -0.02)))


def shown(shifts: Array, sigma: float = 1e-3, turn: float = 5.0) -> list[Keyframes]:
    """Return takes of six keyframes in one nav, the fourth shifted, and turned about the vertical by `turn`, rad/m."""
    task, rng, takes = truth(1), np.random.default_rng(1), []
    for shift in shifts:
        p, R = task.m + 5e-4 * rng.normal(size=(6, 3)), rotations(0.01 * rng.normal(size=(6, 3))) @ task.A
        p[3] += shift
        R[3] = rotations(np.array((0.0, 0.0, turn * shift[0]))) @ R[3]
        takes.append(Keyframes(p, R, (None,) * 6, np.full(6, sigma)))
    return takes


@pytest.mark.parametrize(
    ("shifts", "found"),
    [
        (ELSEWHERE, (3, 3)),
        (IN_THE_AIR, None),
        (ELSEWHERE * ((0,), (0,), (1,)), None),
        (ELSEWHERE[:2], None),
        (ELSEWHERE[[1, 0, 0]], None),
    ],
    ids=["on a table", "in the air", "in one take only", "of two takes", "in the first take only"],
)
def test_a_single_keyframe_that_moved(shifts: Array, found: tuple[int, int] | None) -> None:
    moved = find_moved_keyframes(shown(shifts))
    assert (None if moved is None else (moved.first, moved.last)) == found


def test_a_slip_of_the_first_take_does_not_move_a_neighbour_with_it() -> None:
    """With a frame of its own, turned, such a pair fits better than each alone."""
    assert (
        find_moved_keyframes(shown(np.array(((0.08, 0.0, 0.03), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))), turn=0.0)) is None
    )


def test_a_move_must_be_likelier_by_ten_in_the_logarithm() -> None:
    likely, unlikely = (find_moved_keyframes(shown(ELSEWHERE, sigma)) for sigma in (4.3e-3, 4.7e-3))  # gains: 12 and 7
    assert likely is not None
    assert unlikely is None


@pytest.mark.parametrize("second", [True, False])
def test_a_second_thing_that_moved_is_said(second: bool) -> None:
    task, rng, takes = truth(1, count=9), np.random.default_rng(1), []
    for shift in ELSEWHERE:
        p = task.m + 5e-4 * rng.normal(size=(9, 3))
        p[2:4] += 2.0 * shift
        p[6:8] -= second * 2.0 * shift[[1, 0, 2]]
        takes.append(Keyframes(p, task.A, (None,) * 9, np.full(9, 1e-3)))
    moved = find_moved_keyframes(takes)
    assert moved is not None
    said = another_thing(moved, [moved.put_back(k, take) for k, take in enumerate(takes)])
    assert said.startswith(f"keyframes {moved.first}..{moved.last}, and apart from them") == second
    assert bool(said) == second


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_take_of_another_task_neither_shows_nor_hides_that_something_moved(elsewhere: bool) -> None:
    """Such a take fits better with a frame of its own for its last keyframes, but then it still does not match."""
    other, rng = truth(1), np.random.default_rng(5)
    other.m[2:] += (1.0, 0.0, 0.0) + 0.3 * rng.normal(size=(4, 3))
    stranger = Keyframes(other.m, other.A, (None,) * 6, np.full(6, 1e-3))
    moved, alignment = _matched([*shown(elsewhere * ELSEWHERE), stranger])
    assert (moved is not None) == elsewhere
    assert alignment.strangers == (3,)


def test_a_thing_of_two_keyframes_that_moved_in_one_of_three_takes() -> None:
    takes = shown(0.0 * ELSEWHERE)
    takes[1].p[3:5] += (0.08, 0.03, 0.0)
    moved = find_moved_keyframes(takes)
    assert moved is not None
    assert (moved.first, moved.last, set(moved.back)) == (3, 4, {1})


@pytest.mark.parametrize("seed", [0, 18])
def test_a_very_unsteady_hand_moves_no_thing(seed: int) -> None:
    """It scatters by 8 mm, the tracker by 2 mm: runs of keyframes seem to move together by chance."""
    task, rng = truth(1), np.random.default_rng(seed)
    takes = []
    for _ in range(4):
        p, R = task.m + 8e-3 * rng.normal(size=(6, 3)), rotations(0.03 * rng.normal(size=(6, 3))) @ task.A
        takes.append(Keyframes(p, R, (None,) * 6, np.full(6, 2e-3)))
    assert find_moved_keyframes(takes) is None


def test_two_keyframes_in_the_other_order_are_no_thing_that_moved() -> None:
    """A half turn about the vertical between them brings their places together, but not their attitudes."""
    takes = shown(0.0 * ELSEWHERE)
    for take in takes:
        take.p[3:5, 2] = 0.1
    for values in (takes[1].p, takes[1].R):
        values[[3, 4]] = values[[4, 3]]
    assert find_moved_keyframes(takes) is None


def test_a_keyframe_that_the_reference_lacks_is_not_in_the_moved_frame() -> None:
    """Of four keyframes the reference lacks the second; its own second one moved."""
    here, (task, *_) = Registration(0.0, np.zeros(3), np.eye(3)), shown(ELSEWHERE)
    takes: Any = [SimpleNamespace(marginal=SimpleNamespace(device=np.zeros(1)), device=k) for k in range(3)]
    own = ({0: 0, 1: 0, 2: 0}, {1: 1, 2: 1}, {0: 1, 1: 2, 2: 2}, {0: 2, 1: 3, 2: 3})
    alignment = Alignment(task[list(range(4))], own, dict.fromkeys(range(3), here), ())
    observed, _ = initial_estimate(takes, range(3), alignment, MovedKeyframes(1, 1, 12.0, 0, {}, {}))
    assert observed.frame.tolist() == [0, 0, 1, 0]
