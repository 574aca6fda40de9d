"""A ladder graph: layers of configurations (states), moves between neighbouring layers, and the shortest free path.

Collision checks are slow, so they are lazy. Dynamic programming finds the shortest path as if everything were free;
only the states and moves on that path are checked. Barred ones are dropped, and the path is searched again from that
layer on (LazySP: Dellin and Srinivasa, "A Unifying Formalism for Shortest Path Problems with Expensive Edge
Evaluations", 2016). If too many moves to a layer are barred, the search returns that layer for mending. All other
results are kept.

A long ladder is searched window by window, so the run time grows linearly with its layers. The first part of a window's
path is final; the rest is searched again with the layers that follow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array

StateCheck = Callable[[int, Array], bool]
"""Says whether joints (k,) are free in a layer; layer 0 is the start."""
MoveCost = Callable[[int, Array, Array], float]
"""Gives the cost of a move to a layer beyond its straight travel, rad, from joints (k,) to (k,); infinite if barred."""
ExtraCost = Callable[[list[int], Array, Array], Sequence[float]]
"""Gives an additional cost of moves to n layers, rad, from rows of joints (n, k) to rows (n, k)."""


UNCHECKED_COST = 0.2
"""Extra cost of an unchecked move, rad: so a path known to be free is not left for one that is slightly shorter."""


@dataclass(frozen=True)
class Barred:
    """Why no path was found: the indices of the layers that no free move leads to.

    `has_free_state`: whether each has a free state; then the moves to it are barred, not its states.
    """

    layers: tuple[int, ...]
    has_free_state: tuple[bool, ...]


@dataclass(eq=False)
class Layer:
    """Configurations at one pose, and the moves to them from the layer before.

    Attributes:
        q: (m, k) rad.
        cost: (m,) cost of each state, in rad of joint travel; infinite for a state that is not free.
        mend_after: number of barred moves after which the layer is returned for mending.
        costly: moves to it are checked last, once all other moves on the path are free.
        in_order: a move to it is checked only if no earlier move on the path was barred in the same pass.
        most_step: rad, largest motion of a joint on a move to this layer.
        unchecked_cost: rad, extra cost of an unchecked move.
        wide_cost: rad, extra cost of a move on which a joint moves by more than half a turn.
        length: (l, m) rad, cost of the moves from the l states of the layer before; infinite if barred.
        barred_moves: number of moves to it that were found barred.
        state_checked: (m,) whether each state was checked.
        move_checked, cost_added: (l, m) whether each move was checked, and whether its additional cost was added.
    """

    q: Array
    cost: Array
    mend_after: int
    most_step: float = np.inf
    costly: bool = False
    in_order: bool = False
    wide_cost: float = 0.0
    unchecked_cost: float = UNCHECKED_COST
    length: Array = field(init=False)
    barred_moves: int = field(init=False, default=0)
    state_checked: NDArray[np.bool_] = field(init=False)
    move_checked: NDArray[np.bool_] = field(init=False)
    cost_added: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.state_checked = np.zeros(len(self.q), dtype=bool)
        self.length = np.empty((0, 0))
        self.move_checked = self.cost_added = np.empty((0, 0), dtype=bool)

    def link(self, before: Array, travel_scale: Array, *, anew: bool = False) -> None:
        """Set the length of the moves from states (l, k); results of checked moves are kept unless `anew`."""
        step = before[:, None] - self.q
        length: Array = np.linalg.norm(step * travel_scale, axis=2)
        move_checked, cost_added = np.zeros((2, *length.shape), dtype=bool)
        farthest = np.abs(step).max(axis=2, initial=0.0)
        length += self.wide_cost * (farthest > np.pi)
        length[farthest > self.most_step] = np.inf
        length += self.unchecked_cost
        if anew:
            self.barred_moves = 0
        else:
            known = tuple(slice(count) for count in self.length.shape)
            length[known], move_checked[known], cost_added[known] = self.length, self.move_checked, self.cost_added
        self.length, self.move_checked, self.cost_added = length, move_checked, cost_added


def joint_travel(q: Array, travel_scale: Array) -> float:
    """Return the length of a polyline in joint space through joints (m, k), rad; `travel_scale`: see ArmModel."""
    step = (q[1:] - q[:-1]) * travel_scale
    return float(np.sqrt(np.einsum("ij,ij->i", step, step)).sum())


class Ladder:
    """The layers through which a path is searched; layer 0 has one state, the start. `place` is the index of a layer.

    Attributes:
        travel_scale: (k,) see ArmModel.
        first, end: the window: the path up to layer `first` is final; layers from `end` on are not searched yet.
    """

    def __init__(self, layers: Sequence[Layer], travel_scale: Array) -> None:
        self.layers, self.travel_scale = list(layers), travel_scale
        for place in range(1, len(self.layers)):
            self._link(place)
        self.first, self.end = 0, len(self.layers)
        self._totals = [self.layers[0].cost]

    def copy(self) -> Ladder:
        """Copy everything that may change in the window."""
        copied, window = copy(self), slice(self.first, self.end + 1)
        copied.layers = [*self.layers]
        copied.layers[window] = deepcopy(self.layers[window])
        copied._totals = list(self._totals)
        return copied

    def advance(self, path: Sequence[int], first: int, end: int) -> None:
        """Move the window: it begins at layer `first`, whose state on the path is now final, and ends before `end`."""
        self.shortest()
        self._totals[first] = np.where(np.arange(len(self.layers[first].q)) == path[first], 0.0, np.inf)
        self.first, self.end = first, min(end, len(self.layers))
        self._discard_totals(first + 1)

    def release(self) -> None:
        """Let the window begin at layer 0 again."""
        self.first = 0
        self._discard_totals(1)

    def add(self, place: int, q: Array, cost: Array) -> None:
        """Add states (m, k) to a layer; ignored if its state is final."""
        if place <= self.first:
            return
        layer = self.layers[place]
        layer.q, layer.cost = np.vstack((layer.q, q)), np.append(layer.cost, cost)
        layer.state_checked = np.append(layer.state_checked, np.zeros(len(q), dtype=bool))
        for at in (place, place + 1):
            if at < len(self.layers):
                self._link(at)
        self._discard_totals(place)

    def reset_moves(
        self,
        place: int,
        mend_after: int,
        *,
        costly: bool,
        in_order: bool = False,
        unchecked_cost: float = UNCHECKED_COST,
    ) -> None:
        """Mark the moves to a layer as unchecked, since they are made in another way from now on."""
        layer = self.layers[place]
        layer.mend_after, layer.costly = mend_after, costly
        layer.in_order, layer.unchecked_cost = in_order, unchecked_cost
        self._link(place, anew=True)
        self._discard_totals(place)

    def keep_only(self, place: int, q_before: Array, q: Array, length: float) -> None:
        """Keep only one move to a layer: from q_before to q, free, and `length` rad long."""
        layer, before = self.layers[place], self.layers[place - 1]
        layer.length[:], layer.move_checked[:], layer.barred_moves = np.inf, True, 0
        layer.length[(before.q == q_before).all(axis=1).argmax(), (layer.q == q).all(axis=1).argmax()] = length
        self._discard_totals(place)

    def set_unchecked_cost(self, place: int, unchecked_cost: float) -> None:
        """Change the extra cost of unchecked moves to a layer, rad."""
        layer = self.layers[place]
        layer.length[~layer.move_checked] += unchecked_cost - layer.unchecked_cost
        layer.unchecked_cost, layer.barred_moves = unchecked_cost, 0
        self._discard_totals(place)

    def insert(self, place: int, layers: Sequence[Layer]) -> None:
        """Insert layers before layer `place`."""
        after = place + len(layers)
        self.end += len(layers)
        self.layers[place:place] = layers
        for at in range(place, after + 1):
            self._link(at, anew=True)
        self._discard_totals(place)

    def drop(self, place: int, end: int) -> None:
        """Remove the layers from `place` up to `end`; moves to the next layer may then be of any length."""
        del self.layers[place:end]
        self.end -= end - place
        if place < len(self.layers):
            self.layers[place].most_step = np.inf
            self._link(place, anew=True)
        self._discard_totals(place)

    def joints(self, path: Sequence[int]) -> Array:
        """Return the states (n, k) on a path."""
        return np.array([layer.q[state] for layer, state in zip(self.layers, path, strict=False)])

    def shortest(self) -> list[int] | Barred:
        """Return the index of the state to take in each layer; or the first layer that no free path leads to."""
        for place in range(len(self._totals), self.end):
            layer = self.layers[place]
            total = (self._totals[-1][:, None] + layer.length).min(axis=0) + layer.cost
            if not np.isfinite(total).any():
                return Barred((place,), (bool(np.isfinite(layer.cost).any()),))
            self._totals.append(total)
        path = [int(self._totals[-1].argmin())]
        for place in range(self.end - 1, 0, -1):
            path.append(int((self._totals[place - 1] + self.layers[place].length[:, path[-1]]).argmin()))
        return path[::-1]

    def travel(self, place: int) -> Array:
        """Return the cost (m,) of the shortest path to each state of a layer, rad; infinite if there is none."""
        self.shortest()
        return self._totals[place] if place < len(self._totals) else np.full(len(self.layers[place].q), np.inf)

    def search(
        self, state_check: StateCheck, moves: MoveCost, extra_cost: ExtraCost | None = None
    ) -> list[int] | Barred:
        """Return the shortest path once it is checked and free; or the layers that must be mended first.

        `extra_cost`: an additional cost of moves, which is faster to compute than a collision check.
        """
        while True:
            path = self.shortest()
            if isinstance(path, Barred):
                return path
            if self._check_states(path, state_check) or (extra_cost and self._add_costs(path, extra_cost)):
                continue
            if not self._check_moves(path, moves, costly=False) and not self._check_moves(path, moves, costly=True):
                return path
            within = range(self.first + 1, self.end)
            exhausted = tuple(i for i in within if self.layers[i].barred_moves >= self.layers[i].mend_after)
            if exhausted:
                return Barred(exhausted, (True,) * len(exhausted))

    def _link(self, place: int, *, anew: bool = False) -> None:
        self.layers[place].link(self.layers[place - 1].q, self.travel_scale, anew=anew)

    def _check_states(self, path: Sequence[int], state_check: StateCheck) -> bool:
        barred = False
        for place in range(self.first + 1, self.end):
            layer, state = self.layers[place], path[place]
            if layer.state_checked[state]:
                continue
            layer.state_checked[state] = True
            if not state_check(place, layer.q[state]):
                layer.cost[state] = np.inf
                self._discard_totals(place)
                barred = True
        return barred

    def _add_costs(self, path: Sequence[int], extra_cost: ExtraCost) -> bool:
        places = []
        for place in range(self.first + 1, self.end):
            layer, move = self.layers[place], (path[place - 1], path[place])
            if not (layer.cost_added[move] or layer.move_checked[move]):
                layer.cost_added[move] = True
                places.append(place)
        if not places:
            return False
        first, q = len(path), self.joints(path)
        for place, cost in zip(places, extra_cost(places, q[[place - 1 for place in places]], q[places]), strict=True):
            self.layers[place].length[path[place - 1], path[place]] += cost
            first = min(first, place) if cost > 0.0 else first
        self._discard_totals(first)
        return first < len(path)

    def _check_moves(self, path: Sequence[int], moves: MoveCost, *, costly: bool) -> bool:
        barred, first = False, len(path)
        for place in range(self.first + 1, self.end):
            layer, state, following = self.layers[place], path[place - 1], path[place]
            if layer.move_checked[state, following] or layer.costly != costly or (layer.in_order and barred):
                continue
            layer.move_checked[state, following], unchecked_cost = True, layer.unchecked_cost
            cost = moves(place, self.layers[place - 1].q[state], layer.q[following])
            layer.length[state, following] += cost - unchecked_cost
            layer.barred_moves += cost == np.inf
            first, barred = min(first, place), barred or cost > 0.0
        self._discard_totals(first)
        return barred

    def _discard_totals(self, place: int) -> None:
        """Discard the path costs from a layer on."""
        place = max(self.first + 1, place)
        del self._totals[place:]
