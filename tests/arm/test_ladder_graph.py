"""The shortest free path through a ladder graph, compared with all paths."""

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.arm.ik.solver import ik_result
from pbd.arm.ladder_building import STARTS, VARIANTS, build_ladder, widen
from pbd.arm.ladder_graph import UNCHECKED_COST, Barred, Ladder, Layer
from pbd.arm.model import to_se3
from pbd.pose import Array
from tests.arm.bundled import arm_of

MANY = 10**6
SCALE = np.ones(2)


def random_layers(
    rng: np.random.Generator, sizes: list[int], mend_after: int = MANY, unchecked_cost: float = 0.0
) -> list[Layer]:
    start = Layer(rng.normal(size=(1, 2)), np.zeros(1), mend_after)
    drawn = ((rng.normal(size=(size, 2)), rng.uniform(0.0, 0.3, size)) for size in sizes)
    return [start] + [Layer(q, cost, mend_after, unchecked_cost=unchecked_cost) for q, cost in drawn]


class World:
    """States and moves that are barred at random, and a record of what was checked."""

    def __init__(self, rng: np.random.Generator, layers: list[Layer], states: float, moves: float) -> None:
        self.q, self.cost = [layer.q.copy() for layer in layers], [layer.cost.copy() for layer in layers]
        self.asked = list[tuple[int, ...]]()
        self.bad = {(i, s) for i, q in enumerate(self.q) for s in range(len(q)) if i and rng.random() < states}
        pairs = product(range(1, len(layers)), range(5), range(5))
        self.bad_moves = {(i, a, b) for i, a, b in pairs if rng.random() < moves}

    def state(self, place: int, q: Array) -> int:
        return int(np.flatnonzero((self.q[place] == q).all(axis=1))[0])

    def is_free(self, place: int, q: Array) -> bool:
        self.asked.append((place, self.state(place, q)))
        return self.asked[-1] not in self.bad

    def free_move(self, place: int, q: Array, q_next: Array) -> float:
        move = (place, self.state(place - 1, q), self.state(place, q_next))
        self.asked.append(move)
        assert (place - 1, move[1]) not in self.bad  # only moves between free states are checked
        assert (place, move[2]) not in self.bad
        return np.inf if move in self.bad_moves else 0.0

    def free(self, path: tuple[int, ...]) -> bool:
        moves = {(i, a, b) for i, (a, b) in enumerate(pairwise(path), start=1)}
        return not self.bad & set(enumerate(path)) and not self.bad_moves & moves

    def length(self, path: tuple[int, ...]) -> float:
        states = [q[state] for q, state in zip(self.q, path, strict=True)]
        costs = sum(float(cost[state]) for cost, state in zip(self.cost, path, strict=True))
        return costs + sum(float(np.linalg.norm(b - a)) for a, b in pairwise(states))

    def every(self) -> list[tuple[int, ...]]:
        return list(product(*(range(len(q)) for q in self.q)))


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 10_000), st.lists(st.integers(1, 4), min_size=1, max_size=4), st.floats(0, 0.6), st.floats(0, 0.6)
)
def test_it_is_the_shortest_of_all_that_are_free(seed: int, sizes: list[int], states: float, moves: float) -> None:
    rng = np.random.default_rng(seed)
    layers = random_layers(rng, sizes)
    world = World(rng, layers, states, moves)
    found = Ladder(layers, SCALE).search(world.is_free, world.free_move)
    free = [path for path in world.every() if world.free(path)]
    if isinstance(found, Barred):
        assert not free
        (place,) = found.layers
        assert not any(world.free(path[: place + 1]) for path in world.every())
        assert found.has_free_state == (any((place, s) not in world.bad for s in range(sizes[place - 1])),)
    else:
        assert tuple(found) == min(free, key=world.length)
    assert len(world.asked) == len(set(world.asked))


def test_a_known_path_is_left_only_for_one_that_is_shorter_by_the_extra_cost() -> None:
    """Fewer moves are checked, and a path is longer by at most the extra cost for each move."""
    asked = {0.0: 0, UNCHECKED_COST: 0}
    for seed, unchecked_cost in product(range(20), asked):
        rng = np.random.default_rng(seed)
        layers = random_layers(rng, [4] * 5, unchecked_cost=unchecked_cost)
        world = World(rng, layers, 0.1, 0.4)
        found = Ladder(layers, SCALE).search(world.is_free, world.free_move)
        best = min(filter(world.free, world.every()), key=world.length, default=None)
        assert isinstance(found, Barred) == (best is None)
        if best is not None and not isinstance(found, Barred):
            assert world.length(tuple(found)) <= world.length(best) + 5 * unchecked_cost + 1e-9
        asked[unchecked_cost] += len(world.asked)
    assert asked[UNCHECKED_COST] < asked[0.0]


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000), st.integers(1, 4))
def test_a_mended_ladder_gives_the_same_path_as_one_built_at_once(seed: int, place: int) -> None:
    """States are added, a layer is inserted, moves are reset: all other results are kept, and not checked again."""
    rng = np.random.default_rng(seed)
    layers = random_layers(rng, [4, 4, 5, 4])
    world = World(rng, layers, 0.1, 0.2)
    world.bad = {each for each in world.bad if each[0] != 4}
    third, part = layers.pop(3), layers[2]
    later_q, later_cost = part.q[2:], part.cost[2:].copy()
    ladder = Ladder([*layers[:2], Layer(part.q[:2], part.cost[:2].copy(), MANY, unchecked_cost=0.0), layers[3]], SCALE)
    ladder.search(
        lambda at, q: at > 2 or world.is_free(at, q), lambda at, *q: 0.0 if at > 2 else world.free_move(at, *q)
    )
    ladder.add(2, later_q, later_cost)
    ladder.insert(3, [third])
    ladder.reset_moves(place, MANY, costly=place % 2 == 0, unchecked_cost=0.0)
    world.asked = [each for each in world.asked if each[0] != place or len(each) == 2]
    found = ladder.search(lambda at, q: at > 3 or world.is_free(at, q), world.free_move)
    best = min(filter(world.free, world.every()), key=world.length, default=None)
    assert isinstance(found, Barred) if best is None else found == list(best)
    assert len(world.asked) == len(set(world.asked))
    ladder.drop(len(ladder.layers) - 1, len(ladder.layers))
    shorter = ladder.search(world.is_free, world.free_move)
    assert isinstance(shorter, Barred) or len(shorter) == 4


def test_only_the_path_is_checked_and_costly_moves_last() -> None:
    layers = random_layers(np.random.default_rng(0), [4, 4, 4])
    layers[1].costly = True
    world = World(np.random.default_rng(0), layers, 0.0, 0.0)
    Ladder(layers, SCALE).search(world.is_free, world.free_move)
    assert [place[0] for place in world.asked] == [1, 2, 3, 2, 3, 1]


@pytest.mark.parametrize("barred", [(2, 4), (1, 3)])
def test_layers_with_too_many_barred_moves_are_returned(barred: tuple[int, int]) -> None:
    """All such layers are returned at once."""
    layers = random_layers(np.random.default_rng(0), [4, 4, 4, 4], mend_after=2)
    asked = []

    def free(place: int, q: Array, q_next: Array) -> float:
        asked.append(place)
        return np.inf if place in barred else 0.0

    found = Ladder(layers, SCALE).search(lambda *_: True, free)
    assert found == Barred(barred, (True, True))
    assert [asked.count(place) for place in barred] == [2, 2]


def test_a_step_that_is_too_long_is_no_move() -> None:
    layers = [Layer(np.array([[0.0, 0.0]]), np.zeros(1), 1)]
    layers.append(Layer(np.array([[0.4, 0.6], [0.45, 3.0], [0.4, 0.4]]), np.array([0.0, 0.0, 5.0]), 1, most_step=0.5))
    assert Ladder(layers, SCALE).search(lambda *_: True, lambda *_: 0.0) == [0, 2]


def test_the_elbow_is_on_the_side_that_is_free() -> None:
    """The elbow must be up at the first keyframe and down at the others."""
    arm = arm_of("ur5")
    start = np.array([0.3, -1.3, 1.6, -1.9, -1.57, 0.0])
    poses = [arm.forward(start + shift) for shift in (0.0, 0.1, 0.2)]
    ladder = build_ladder(arm, poses, start, start, MANY)
    assert isinstance(ladder, Ladder)
    before = len(ladder.layers[2].q)
    for place in (2, 3):
        widen(arm, poses[place - 1], ladder, place)
    assert len(ladder.layers[2].q) > before
    found = ladder.search(lambda place, q: place == 4 or (q[2] < 0.0) == (place > 1), lambda *_: 0.0)
    assert isinstance(found, list)
    q = ladder.joints(found)[1:4]
    np.testing.assert_array_equal(q[:, 2] < 0.0, [False, True, True])
    assert all(ik_result(arm, to_se3(pose), joints).reached for pose, joints in zip(poses, q, strict=True))
    assert before <= STARTS * VARIANTS


@pytest.mark.parametrize("count", [0, 1])
def test_no_layers_but_the_start(count: int) -> None:
    layers = random_layers(np.random.default_rng(0), [1] * count)
    assert Ladder(layers, SCALE).search(lambda *_: True, lambda *_: 0.0) == [0] * (count + 1)


class Totalled(Ladder):
    """Counts the layers for which path costs are computed."""

    count = 0

    def shortest(self) -> list[int] | Barred:
        self.count += self.end - len(self._totals)
        return super().shortest()


def by_windows(layers: list[Layer], world: World, window: int) -> tuple[list[int], int]:
    ladder = Totalled(layers, SCALE)
    ladder.end = min(window, len(layers))
    while True:
        path = ladder.search(world.is_free, world.free_move)
        assert isinstance(path, list)
        if ladder.end == len(layers):
            return path, ladder.count
        ladder.advance(path, ladder.end - window // 2, ladder.end + window // 2)


def test_the_cost_of_a_long_ladder_is_linear_in_its_layers() -> None:
    """The checked moves too; and the path is hardly longer than that of a search without windows."""
    asked, counts = [], []
    for length in (60, 120):
        layers = random_layers(np.random.default_rng(3), [4] * length)
        world = World(np.random.default_rng(3), layers, 0.1, 0.3)
        path, count = by_windows(layers, world, 16)
        assert world.free(tuple(path))
        asked.append(len(set(world.asked)))
        counts.append(count)
        whole = random_layers(np.random.default_rng(3), [4] * length)
        best = Ladder(whole, SCALE).search(world.is_free, world.free_move)
        assert isinstance(best, list)
        assert world.length(tuple(path)) <= 1.05 * world.length(tuple(best))
    assert counts[1] < 2.4 * counts[0]
    assert asked[1] < 2.4 * asked[0]


def test_a_final_path_is_searched_again_once_released() -> None:
    """The path that is final leads nowhere; the one beside it does."""
    q = np.array([[0.0, 0.0], [1.0, 0.0]])
    layers = [Layer(q[:1], np.zeros(1), MANY), *(Layer(q, np.zeros(2), MANY) for _ in range(3))]
    ladder = Ladder(layers, SCALE)
    ladder.end = 3

    def free(place: int, before: Array, after: Array) -> float:
        return np.inf if (place == 2 and before[0] != after[0]) or (place == 3 and before[0] == 0.0) else 0.0

    path = ladder.search(lambda *_: True, free)
    assert path == [0, 0, 0]
    ladder.advance(path, 1, 4)
    assert isinstance(ladder.search(lambda *_: True, free), Barred)
    ladder.release()
    assert ladder.search(lambda *_: True, free) == [0, 1, 1, 1]


def test_no_path_leads_to_what_is_behind_a_barred_layer() -> None:
    q, no_cost = np.zeros((1, 2)), np.zeros(1)
    ladder = Ladder([Layer(q, no_cost, MANY), Layer(q, no_cost + np.inf, MANY), Layer(q, no_cost, MANY)], SCALE)
    assert [ladder.travel(place).tolist() for place in range(3)] == [[0.0], [np.inf], [np.inf]]


def test_unchecked_moves_may_become_dearer_after_a_search() -> None:
    ladder = Ladder([Layer(np.zeros((1, 2)), np.zeros(1), MANY) for _ in range(2)], SCALE)
    before = ladder.travel(1).copy()
    ladder.set_unchecked_cost(1, ladder.layers[1].unchecked_cost + 5.0)
    assert ladder.travel(1) == pytest.approx(before + 5.0)


def test_moves_with_an_additional_cost_are_checked_only_on_the_shortest_path() -> None:
    layers = [Layer(np.zeros((1, 2)), np.zeros(1), 1), Layer(np.array([[0.1, 0.0], [0.2, 0.0]]), np.zeros(2), 1)]
    asked = []

    def free(place: int, before: Array, after: Array) -> float:
        asked.append(float(after[0]))
        return 0.0

    heavy = Ladder(layers, SCALE).search(
        lambda *_: True, free, lambda places, before, after: 0.5 * (after[:, 0] == 0.1)
    )
    assert heavy == [0, 1]
    assert asked == [0.2]


def test_a_move_that_was_barred_is_open_again_once_it_is_made_in_another_way() -> None:
    near_and_far = Layer(np.array([[0.1, 0.0], [0.2, 0.0]]), np.zeros(2), MANY)
    ladder = Ladder([Layer(np.zeros((1, 2)), np.zeros(1), MANY), near_and_far], SCALE)
    assert ladder.search(lambda *_: True, lambda place, q, q_next: np.inf if q_next[0] == 0.1 else 0.0) == [0, 1]
    assert ladder.shortest() == [0, 1]
    ladder.reset_moves(1, MANY, costly=False)
    assert ladder.shortest() == [0, 0]


def test_a_copy_leaves_the_original_as_it_was() -> None:
    """A state that is added to the last layer of the window changes the moves to the layer after it too."""
    ladder = Ladder(random_layers(np.random.default_rng(0), [2, 2, 2]), SCALE)
    ladder.end = 3
    ladder.copy().add(2, np.zeros((1, 2)), np.zeros(1))
    assert [layer.length.shape for layer in ladder.layers[1:]] == [(1, 2), (2, 2), (2, 2)]


def test_a_state_that_is_final_gets_no_others() -> None:
    ladder = Ladder(random_layers(np.random.default_rng(0), [2, 2, 2]), SCALE)
    path = ladder.shortest()
    assert not isinstance(path, Barred)
    ladder.advance(path, 1, 4)
    for place, count in ((1, 2), (2, 3)):
        ladder.add(place, np.zeros((1, 2)), np.zeros(1))
        assert len(ladder.layers[place].q) == count
