"""Gauss-Newton over the knots, with annealing of the robust factors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.lazy import cached_property
from pbd.pose import Array, lengths
from pbd.tracking.smoother.factors import linearise, pivot_velocity, whitener
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import NormalEquations, Solved
from pbd.tracking.smoother.state import Fixed, State

UNDOUBTED_SIGMAS = 2.0
"""An annealing step is skipped if no knot in a stop is faster than this many sigmas of the next step."""

CONVERGED_RAD, CONVERGED_SIGMAS, MAX_ITERATIONS = 3e-4, 0.05, 12
"""Iteration ends when a step rotates no knot by more than CONVERGED_RAD (rad per axis), or changes nothing by more than
CONVERGED_SIGMAS of its sigmas (a heading that nothing determines), or after MAX_ITERATIONS."""


@dataclass(frozen=True, eq=False)
class Descent:
    """A linearisation at a state, the robust weight (m,) of zero velocity at each knot, and the step from there."""

    at: State
    still_weight: Array
    solved: Solved

    @property
    def converged(self) -> bool:
        """Whether the step is small: see CONVERGED_RAD."""
        small = np.abs(self.solved.d[:, :3]).max() < CONVERGED_RAD
        return bool(small) or self.solved.decrement < CONVERGED_SIGMAS

    @cached_property
    def x(self) -> State:
        """The state after the step."""
        return self.at.moved(self.solved)


def descend(
    problem: Problem,
    x: State,
    fixed: Fixed,
    anneal: Sequence[float] = (),
    change: Callable[[NormalEquations], None] | None = None,
) -> Descent:
    """Gauss-Newton to convergence; every step linearises all factors anew.

    Args:
        problem, x, fixed: knots and measurements; the state to begin with; what the iterations hold fixed.
        anneal: decreasing factors on the stops' velocity sigma. With several, `x` is a guess that stands still in
            each stop. It can't show which factors may be skipped, so the first is always used.
        change: changes the normal equations of each step in place.
    """
    whiten, still = whitener(problem, fixed), problem.stop_of >= 0

    def step(x: State, anneal: float) -> Descent:
        equations, weights = linearise(problem, x, fixed, whiten, anneal)
        if change is not None:
            change(equations)
        return Descent(x, weights, equations.solve())

    if len(anneal) > 1:
        x = step(x, anneal[0]).x
    off = float((lengths(pivot_velocity(problem, x)[0][still]) / problem.still_sigma[still]).max())
    for factor, closer in pairwise((*anneal, 1.0)):
        if off > UNDOUBTED_SIGMAS * closer:
            x = step(x, factor).x
    for _ in range(MAX_ITERATIONS):
        found = step(x, 1.0)
        x = found.x
        if found.converged:
            break
    return found
