"""Check many demonstrations: is each usable, what should a person look at, which differs from its siblings?"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Calibration, Robot
from pbd.errors import PbdError, WrongTypeError, collected_warnings
from pbd.files.demo import load_demo
from pbd.fusion.matching import HAND_M
from pbd.pipeline import track
from pbd.plots.demo_values import demo_plot
from pbd.plots.findings import OFF_SIGMAS
from pbd.pose import Array, Pose, level_onto, quat_about_z, quat_rotate

FEWEST_SIBLINGS = 4
"""Fewest demonstrations of one task that are compared: of three, the one that is off pulls the median."""

TURNED_RAD = np.radians(30.0)
"""A demonstration that is turned by more about the vertical, rad, is compared turned back: the sensor was put otherwise
into the hand, and not the hand otherwise to the dock. Less is a difference like any other."""

CHI3_MEDIAN = 1.538
"""Median of the distance from the mean, in sigmas of one axis: of chi with three degrees of freedom."""


@dataclass(frozen=True, eq=False)
class DemoCheck:
    """What was found out about one demonstration.

    Attributes:
        why: what makes it unusable, in one line; "": nothing.
        duration_s: the recording's, s; nan where it can't be read, as in what follows.
        p_dock_sensor: (k, 3) m, where the sensor was at its keyframes, from the first one and in its heading.
        sigma_m: the largest sigma of a keyframe along an axis, m.
        grips: where the grip closes (True) and opens (False), by keyframe: siblings have the same.
        findings: what a person should look at, in words.
        motion_s: how long the robot takes, s; nan without a robot, or where it can't do it.
        refused: what stops the robot; "": nothing, or no robot was named.
        differs: where it is farther from its siblings than chance explains, in words.
    """

    name: str
    why: str = ""
    duration_s: float = np.nan
    p_dock_sensor: Array | None = None
    sigma_m: float = np.nan
    grips: tuple[tuple[int, bool], ...] = ()
    findings: tuple[str, ...] = ()
    motion_s: float = np.nan
    refused: str = ""
    differs: tuple[str, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether it can be tracked, and replayed by the robot that was named."""
        return not (self.why or self.refused)

    @property
    def remarks(self) -> tuple[str, ...]:
        """All that a person should look at, the worst first."""
        return tuple(filter(None, (self.why, self.refused, *self.differs, *self.findings)))


def check_all(
    demos: Sequence[str | Path],
    robot: str | None = None,
    jobs: int | None = None,
    done: Callable[[int], None] | None = None,
) -> tuple[DemoCheck, ...]:
    """Check demonstrations, each on its own, then each against its siblings.

    Siblings have as many keyframes and the same grips. The work is done by joblib: a backend that the caller has
    chosen with `joblib.parallel_config` (Dask, Ray) takes it.

    Args:
        demos: names, folders or files, as `pbd.load_demo` takes them.
        robot: also plan for this one, on its own dock.
        jobs: processes at once; None: one, or what `joblib.parallel_config` says.
        done: is called with the number of those that are done, after each.

    Returns:
        What was found, in the order of `demos`. One that can't be used is told there, not raised.

    Raises:
        RobotError, CalibrationError: the robot or its calibration can't be loaded.
        WrongTypeError: a single name instead of a list; its letters would be taken for names.
    """
    from joblib import Parallel, delayed

    from pbd.planning import load_arm

    if isinstance(demos, str | Path):
        raise WrongTypeError(f"check_all takes a list of demonstrations: check_all([{str(demos)!r}])")
    arm = None if robot is None else load_arm(robot)
    found: list[DemoCheck] = []
    for check in Parallel(n_jobs=jobs, return_as="generator")(delayed(check_one)(str(name), arm) for name in demos):
        found.append(check)
        if done is not None:
            done(len(found))
    return _compared(found)


def check_one(name: str, arm: tuple[Robot, Calibration] | None = None) -> DemoCheck:
    """Check one demonstration: load it, track it, and plan for the robot that is given, on its calibration."""
    check = DemoCheck(name)
    with collected_warnings() as remarks:
        try:
            demo = load_demo(name)
            check = replace(check, duration_s=float(demo.recording.t[-1]))
            path = track(demo)
            plot = demo_plot(path, remarks)
        except PbdError as error:
            return replace(check, why=error.message)
        keyframes = plot.keyframes
        T_dock_nav = level_onto(keyframes[0].T_nav_sensor, Pose.identity())  # the sensor there has no heading
        check = replace(
            check,
            p_dock_sensor=T_dock_nav.act(np.array([keyframe.T_nav_sensor.p for keyframe in keyframes])),
            sigma_m=max(float(np.sqrt(np.diagonal(keyframe.cov)[:3].max())) for keyframe in keyframes),
            grips=tuple((k, each.grip) for k, each in enumerate(keyframes) if each.grip is not None),
            findings=tuple(finding.words for finding in plot.findings),
        )
        if arm is None:
            return check
        from pbd.planning import plan

        try:
            return replace(check, motion_s=plan(path, arm[1], arm[0]).duration)
        except PbdError as error:
            return replace(check, refused=f"{arm[0].name}: {error.message}")


def _compared(found: Iterable[DemoCheck]) -> tuple[DemoCheck, ...]:
    checks = list(found)
    siblings: dict[Any, list[int]] = defaultdict(list)
    for i, check in enumerate(checks):
        if check.p_dock_sensor is not None:
            siblings[len(check.p_dock_sensor), check.grips].append(i)
    for group in siblings.values():
        if len(group) < FEWEST_SIBLINGS:
            continue
        p = np.array([checks[i].p_dock_sensor for i in group])
        turns = _turns(p)
        p = quat_rotate(quat_about_z(-turns)[:, None], p)
        away = np.linalg.norm(p - np.median(p, axis=0), axis=2)
        own = np.array([checks[i].sigma_m for i in group])[:, None]
        bound = OFF_SIGMAS * np.hypot(np.median(away, axis=0) / CHI3_MEDIAN, own)
        likes = f"the {len(group) - 1} like it"
        for i, turn, far, most in zip(group, turns.tolist(), away, bound, strict=True):
            words = [
                f"keyframe {k} is {100.0 * far[k]:.0f} cm from where {likes} have theirs"
                for k in np.flatnonzero(far > most)
            ]
            if abs(turn) > TURNED_RAD:
                words.insert(0, f"the sensor is turned by {np.degrees(turn):.0f}° about the vertical against {likes}")
            checks[i] = replace(checks[i], differs=tuple(words))
    return tuple(checks)


def _turns(p: Array) -> Array:
    """By what angle (n,) about the vertical each way (n, k, 3) is turned against the one that is most like the others.

    Only what is more than TURNED_RAD counts: a sensor that sits otherwise in the hand, as in takes to be fused. A way
    up and down shows no direction.
    """
    level = p[..., 0] + 1j * p[..., 1]
    between = np.angle(np.einsum("ik,jk->ij", level.conj(), level))
    turns: Array = between[np.argmin(np.abs(between).sum(axis=1))]
    shown = (np.abs(level).max(axis=1) > HAND_M).all()
    return np.where(shown & (np.abs(turns) > TURNED_RAD), turns, 0.0)
