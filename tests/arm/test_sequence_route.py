"""The shortest free way against every way there is."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.arm.route import Layer, NoWayError, Route
from pbd.pose import Array


def random_layers(rng: np.random.Generator, sizes: list[int]) -> list[Layer]:
    return [Layer(rng.normal(size=(1, 2)), np.zeros(1))] + [
        Layer(rng.normal(size=(size, 2)), rng.uniform(0.0, 0.3, size)) for size in sizes
    ]


def length(layers: list[Layer], way: tuple[int, ...]) -> float:
    states = [layer.q[state] for layer, state in zip(layers, way, strict=True)]
    costs = sum(float(layer.cost[state]) for layer, state in zip(layers, way, strict=True))
    return costs + sum(float(np.linalg.norm(b - a)) for a, b in pairwise(states))


def shortest_free(route: Route, world: World) -> tuple[int, ...] | NoWayError:
    try:
        return tuple(route.shortest_free(world.allowed, world.clear, 1000))
    except NoWayError as no_way:
        return no_way


class World:
    """States and moves that are barred at random, and how often each is asked about."""

    def __init__(self, rng: np.random.Generator, layers: list[Layer], states: float, moves: float) -> None:
        self.layers, self.asked = layers, list[object]()
        self.bad = {
            (i, s) for i, layer in enumerate(layers) for s in range(len(layer.q)) if i and rng.random() < states
        }
        pairs = product(range(1, len(layers)), range(4), range(4))
        self.bad_moves = {(i, a, b) for i, a, b in pairs if rng.random() < moves}

    def state(self, layer: int, q: Array) -> int:
        return int(np.flatnonzero((self.layers[layer].q == q).all(axis=1))[0])

    def allowed(self, i: int, q: Array) -> bool:
        self.asked.append((i, self.state(i + 1, q)))
        return (i + 1, self.state(i + 1, q)) not in self.bad

    def clear(self, i: int, q: Array, q_next: Array) -> bool:
        move = (i + 1, self.state(i, q), self.state(i + 1, q_next))
        self.asked.append(move)
        # It is asked only of states that are allowed.
        assert (i, move[1]) not in self.bad
        assert (i + 1, move[2]) not in self.bad
        return move not in self.bad_moves

    def free(self, way: tuple[int, ...]) -> bool:
        moves = [(i, a, b) for i, (a, b) in enumerate(pairwise(way), start=1)]
        return not self.bad & set(enumerate(way)) and not self.bad_moves & set(moves)


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 10_000), st.lists(st.integers(1, 4), min_size=1, max_size=4), st.floats(0, 0.6), st.floats(0, 0.6)
)
def test_it_is_the_shortest_of_all_that_are_free(seed: int, sizes: list[int], states: float, moves: float) -> None:
    rng = np.random.default_rng(seed)
    layers = random_layers(rng, sizes)
    world, route = World(rng, layers, states, moves), Route(layers)
    every = list(product(*(range(len(layer.q)) for layer in layers)))
    best = min(every, key=lambda way: length(layers, way))
    assert tuple(route.shortest()) == best
    np.testing.assert_array_equal(route.joints(best), [layer.q[s] for layer, s in zip(layers, best, strict=True)])
    free = [way for way in every if world.free(way)]
    found = shortest_free(route, world)
    if free:
        assert found == min(free, key=lambda way: length(layers, way))
    else:
        assert isinstance(found, NoWayError)
        # Up to the layer before there are free ways, and `way` begins with one, the shortest of them in all.
        begun = [way for way in every if world.free(way[: found.layer])]
        assert tuple(found.way) == min(begun, key=lambda way: length(layers, way))
        assert not any(world.free(way[: found.layer + 1]) for way in every)
        standing = {s for s in range(len(layers[found.layer].q)) if (found.layer, s) not in world.bad}
        assert found.stands == bool(standing)
    assert len(world.asked) == len(set(world.asked))


def test_what_isnt_on_the_way_isnt_asked_about() -> None:
    layers = random_layers(np.random.default_rng(0), [4, 4, 4])
    world = World(np.random.default_rng(0), layers, 0.0, 0.0)
    Route(layers).shortest_free(world.allowed, world.clear, 1000)
    assert len(world.asked) == 6


def test_too_many_refusals_end_it() -> None:
    layers = random_layers(np.random.default_rng(0), [4, 4])
    asked = []

    def refused(i: int, q: Array, q_next: Array) -> bool:
        asked.append(i)
        return False

    with pytest.raises(NoWayError) as caught:
        Route(layers).shortest_free(None, refused, 2)
    assert len(asked) == 2
    assert caught.value.layer == 1
