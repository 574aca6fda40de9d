"""Find takes, and single keyframes of takes, that don't fit the others by their own covariance.

An outlier would raise the estimated scatter of the hand. So it is tested with the scatter of the remaining takes.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.joint_estimate import JointEstimate, Observations, estimate_jointly
from pbd.fusion.matching import TURN_LEVER_M
from pbd.fusion.scatter import common_scatter, keyframe_scatter
from pbd.pose import lengths

FALSE_ALARM_CHANCE = 0.01
"""Chance that a fusion without outliers reports one."""

LEAST_TAKES = 3
"""Smallest number of takes among which an outlier can be located."""

RAISED_SIGMAS = 2.0
"""How far the scatter is raised for the test, in sigmas of its logarithm: a few takes show the scatter inaccurately."""


def without_outlying_keyframes(
    observations: Observations, joint: JointEstimate
) -> tuple[JointEstimate, Observations, list[tuple[int, int]]]:
    """Remove the worst keyframe of a take and estimate again, as long as it is an outlier.

    Return the last estimate, what it is from, and the outliers: (take, the task's keyframe).
    """
    out: list[tuple[int, int]] = []
    while (worst := _outlying_keyframe(observations, joint, LEAST_TAKES)) is not None:
        out.append(worst)
        observations = observations.subset(~_where(observations, *worst))
        joint = estimate_jointly(observations, joint.state, common_scatter(len(joint.state.m)))
    return joint, observations, out


def disagreement(observations: Observations, joint: JointEstimate, names: Sequence[str]) -> str:
    """Say where two takes differ too much; "" if they don't. Which of the two is wrong can't be known."""
    worst = _outlying_keyframe(observations, joint, 2)
    if worst is None:
        return ""
    both = " and ".join(names[k] for k in observations.take[observations.at == worst[1]])
    return f"{both} differ at keyframe {worst[1]}; a third take would show which is wrong"


def _outlying_keyframe(observations: Observations, joint: JointEstimate, takes: int) -> tuple[int, int] | None:
    """Return the worst keyframe of a take if it is an outlier, of those that `takes` takes have; for LEAST_TAKES, that
    number or more."""
    counts = np.bincount(observations.at)[observations.at]
    tested = np.flatnonzero((counts == takes) | ((counts > takes) & (takes >= LEAST_TAKES)))
    if not len(tested):
        return None
    rows = 6 * tested[:, None] + np.arange(6)
    worst = int(np.argmax(joint.chi_squares(list(rows))))
    which = int(observations.take[tested[worst]]), int(observations.at[tested[worst]])
    rest = observations.subset(~_where(observations, *which))
    return which if _is_outlier(observations, joint, rest, rows[worst], len(tested)) else None


def _where(observations: Observations, take: int, keyframe: int) -> NDArray[np.bool_]:
    return np.asarray((observations.take == take) & (observations.at == keyframe))


def outlying_take(observations: Observations, joint: JointEstimate) -> int | None:
    """Return the take with the largest residuals if it is an outlier."""
    takes = observations.rows
    if len(takes) < LEAST_TAKES:
        return None
    weighted = joint.residuals.reshape(-1, 6) * np.repeat((1.0, TURN_LEVER_M), 3)  # m
    worst = int(np.argmax([np.median(lengths(weighted[observations.take == k])) for k in range(len(takes))]))
    # One keyframe that is off moves the take's nav, and so all its residuals: the take is tested without its worst.
    own = np.flatnonzero(observations.take == worst)
    keyframe = int(np.argmax(joint.chi_squares(list(6 * own[:, None] + np.arange(6)))))
    tested = observations.subset(np.arange(len(observations.take)) != own[keyframe])
    rows = np.arange(tested.rows[worst].start, tested.rows[worst].stop)
    rest = tested.subset(tested.take != worst)
    return worst if _is_outlier(tested, joint, rest, rows, len(takes)) else None


def _is_outlier(
    observations: Observations, joint: JointEstimate, rest: Observations, rows: NDArray[np.intp], tests: int
) -> bool:
    """Say whether some keyframes' positions or attitudes don't fit, with the scatter that the rest shows.

    Each is tested apart: a fault is mostly of one kind. A single keyframe is tested with its own scatter: at some the
    hand is less careful than at most.
    """
    from scipy.special import chdtri

    prior = replace(common_scatter(len(joint.state.m)), log=joint.scatter.log)
    without = estimate_jointly(rest, joint.state, prior).scatter
    if len(rows) == 6:
        without = estimate_jointly(rest, joint.state, keyframe_scatter(without)).scatter
    log, own = without.log + RAISED_SIGMAS * without.log_sigma, joint.scatter.own_variances
    raised = replace(without, log=log, own_variances=own)  # a sensor may sit elsewhere in the hand in one take alone
    again = estimate_jointly(observations, joint.state, raised, iterations=1)
    position, attitude = rows.reshape(-1, 2, 3).swapaxes(0, 1).reshape(2, -1)
    limit = chdtri(len(position), 0.5 * FALSE_ALARM_CHANCE / tests)
    return bool((again.chi_squares([position, attitude]) > limit).any())
