"""Gauss-Newton over the knots, with annealing of the robust factors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pbd.pose import Array, lengths
from pbd.tracking.smoother.factors import creep, linearise, whitener
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import Solved
from pbd.tracking.smoother.state import Local, State

ANNEALING = (40.0, 10.0, 3.0)
"""Factors on the velocity sigma of a stop, coming down to 1; from an earlier solution the last one does."""

UNDOUBTED_SIGMAS = 2.0
"""A step of the annealing is skipped if no stop's velocity exceeds so many of the next step's sigmas."""

CONVERGED_RAD, MAX_ITERATIONS = 3e-4, 12
"""Largest rotation of the last step, rad; limit of iterations."""


@dataclass(frozen=True, eq=False)
class Descent:
    """A linearisation at a state, how much each knot's standing still counts (m,), and the step from there."""

    at: State
    still: Array
    solved: Solved

    @cached_property
    def x(self) -> State:
        """The state a step further."""
        return self.at.moved(self.solved)


def descend(problem: Problem, x: State, local: Local, anneal: Sequence[float] = ()) -> Descent:
    """Gauss-Newton, all factors linearised anew each time, until a step turns nothing by more than CONVERGED_RAD.

    Annealing begins where no stop is in doubt. More than one factor is for a hand that does not move yet: none is
    doubted then, so that the first factor comes before all others.
    """
    whiten, still = whitener(problem, local), problem.stop_of >= 0

    def step(x: State, anneal: float) -> Descent:
        equations, weights = linearise(problem, x, local, whiten, anneal)
        return Descent(x, weights, equations.solve())

    if len(anneal) > 1:
        x = step(x, anneal[0]).x
    off = float((lengths(creep(problem, x)[0][still]) / problem.still[still]).max())
    for factor, closer in pairwise((*anneal, 1.0)):
        if off > UNDOUBTED_SIGMAS * closer:
            x = step(x, factor).x
    for _ in range(MAX_ITERATIONS):
        found = step(x, 1.0)
        x = found.x
        if np.abs(found.solved.d[:, :3]).max() < CONVERGED_RAD:
            break
    return found
