"""The shortest way through layers of states, one of each, where some states and moves may turn out to be barred.

Dynamic programming (Viterbi). States and moves are asked about only along the way that is shortest so far: one that is
refused is barred and the next shortest way is sought, so the costly questions are few.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pbd.pose import Array

Allowed = Callable[[int, Array], bool]
Clear = Callable[[int, Array, Array], bool]


class Layer(NamedTuple):
    """States q (m, k), and what each costs beside the moves (m,)."""

    q: Array
    cost: Array


class NoWayError(Exception):
    """No way was found that isn't barred.

    Attributes:
        layer: the first that can't be come to.
        stands: whether a state of it is allowed, so that it is the moves to it that are barred.
        way: the shortest of those that are free up to the layer before.
    """

    def __init__(self, layer: int, stands: bool, way: list[int]) -> None:
        super().__init__(layer)
        self.layer, self.stands, self.way = layer, stands, way


class Route:
    """Layers to find ways through, the start's (of one state) first; a move costs its length."""

    def __init__(self, layers: Sequence[Layer]) -> None:
        self.layers = tuple(layers)
        self._moves = [np.linalg.norm(a.q[:, None] - b.q, axis=2) for a, b in pairwise(layers)]
        # Infinite where it is barred, and whether it was asked about.
        self._states_barred = [np.zeros(len(layer.q)) for layer in layers]
        self._moves_barred = [np.zeros_like(moves) for moves in self._moves]
        self._known: set[tuple[int, ...]] = set()

    def joints(self, way: Sequence[int]) -> Array:
        """Return the states (n, k) on a way."""
        return np.array([layer.q[state] for layer, state in zip(self.layers, way, strict=True)])

    def shortest(self, free_to: int | None = None) -> list[int]:
        """Return which state of each layer to take.

        Args:
            free_to: what is barred matters up to this layer only; by default in all of them.

        Raises:
            NoWayError: there is no way; that it gives is the shortest, whatever is barred.
        """
        free_to = len(self._moves) if free_to is None else free_to
        total, via = self.layers[0].cost, []
        for layer in range(1, len(self.layers)):
            moves, cost = self._moves[layer - 1], self.layers[layer].cost
            if layer <= free_to:
                moves, cost = moves + self._moves_barred[layer - 1], cost + self._states_barred[layer]
            through = total[:, None] + moves
            via.append(through.argmin(axis=0))
            total = through.min(axis=0) + cost
            if not np.isfinite(total).any():
                raise NoWayError(layer, bool(np.isfinite(cost).any()), self.shortest(0))
        choice = [int(total.argmin())]
        for before in reversed(via):
            choice.append(int(before[choice[-1]]))
        return choice[::-1]

    def shortest_free(self, allowed: Allowed | None, clear: Clear | None, most: int) -> list[int]:
        """Return the shortest way on which every state is allowed and every move clear.

        Args:
            allowed: asked of a layer, 0 for the first after the start, and a state of it; the start isn't asked about.
            clear: asked of a layer, counted likewise, and the two ends of a move to it, once both are allowed.
            most: so many refusals end it.

        Raises:
            NoWayError: there is none, or none is found so soon.
        """
        free_to, no_way, way, barred = len(self._moves), None, self.shortest(), 1
        for _ in range(most):
            layer = self._bar(way[: free_to + 1], allowed, clear)
            if layer is None:
                break
            barred = layer
            try:
                way = self.shortest(free_to)
            except NoWayError as found:
                # What comes before has yet to be found free.
                no_way, free_to = found, found.layer - 1
                way = self.shortest(free_to)
        else:
            no_way = no_way or NoWayError(barred, True, way)
        if no_way:
            raise NoWayError(no_way.layer, no_way.stands, way)
        return way

    def _bar(self, way: list[int], allowed: Allowed | None, clear: Clear | None) -> int | None:
        """Bar every state on a way that isn't allowed, or else the first move that isn't clear; return its layer."""
        barred = None
        for layer, state in enumerate(way[1:], start=1):
            if allowed and (layer, state) not in self._known:
                self._known.add((layer, state))
                if not allowed(layer - 1, self.layers[layer].q[state]):
                    self._states_barred[layer][state] = np.inf
                    barred = barred or layer
        if barred:
            return barred
        for layer, (state, following) in enumerate(pairwise(way), start=1):
            if clear and (layer, state, following) not in self._known:
                self._known.add((layer, state, following))
                if not clear(layer - 1, self.layers[layer - 1].q[state], self.layers[layer].q[following]):
                    self._moves_barred[layer - 1][state, following] = np.inf
                    return layer
        return None
