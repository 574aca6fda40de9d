"""Gauss-Newton over the knots, with annealing of what is robust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pbd.pose import lengths
from pbd.tracking.smoother.factors import Local, State, Weights, creep, linearise, whitener
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import Solved

FAR, WARM = (40.0, 10.0, 3.0), (3.0,)
"""Of how a hand creeps that stands still, coming down to 1: from a first guess, and from a solution."""

CLEAR = 2.0
"""Where no stop is off by more sigmas, so many times wider, none need be doubted."""

SMALL, ROUGH, MOST = 1e-4, 1e-3, 12
"""rad: the last step's turn, and that of a solution that is solved again; how many iterations there are at most."""


@dataclass(frozen=True, eq=False)
class Descent:
    """A linearisation at a state, with its robust weights, and the step from there."""

    at: State
    weights: Weights
    solved: Solved

    @cached_property
    def x(self) -> State:
        """The state a step further."""
        return self.at.moved(self.solved)


def descend(problem: Problem, x: State, local: Local, anneal: Sequence[float] = (), small: float = SMALL) -> Descent:
    """Gauss-Newton, all factors linearised anew each time, until a step turns nothing by more than `small` (rad).

    Annealing begins where no stop is in doubt; of more than one factor the first is tried without doubting any.
    """
    whiten, still = whitener(problem, local), problem.stop_of >= 0

    def step(x: State, anneal: float, robust: bool = True) -> Descent:
        equations, weights = linearise(problem, x, local, whiten, anneal, robust)
        return Descent(x, weights, equations.solve())

    if len(anneal) > 1:
        x = step(x, anneal[0], robust=False).x
    off = float((lengths(creep(problem, x)[0][still]) / problem.still[still]).max())
    for factor, closer in pairwise((*anneal, 1.0)):
        if off > CLEAR * closer:
            x = step(x, factor).x
    for _ in range(MOST):
        found = step(x, 1.0)
        x = found.x
        if np.abs(found.solved.d[:, :3]).max() < small:
            break
    return found
