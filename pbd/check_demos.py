"""Check many demonstrations: which are usable, what a person should look at, which differ from the others of a task."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Calibration, Robot
from pbd.data.one_line_repr import brief, counted
from pbd.errors import PbdError, WrongTypeError, WrongValueError, collected_warnings, is_whole_number, require_kind
from pbd.files.demo import load_demo
from pbd.fusion.matching import MATCH_M
from pbd.pipeline import track
from pbd.plots.demo_values import demo_values
from pbd.plots.findings import OFF_SIGMAS, ranges
from pbd.pose import Array, Pose, level_onto, quat_about_z, quat_rotate

FEWEST_SIBLINGS = 4
"""Smallest number of demonstrations of one task that are compared. Among three, a wrong one shifts the median."""

TURNED_RAD = np.radians(30.0)
"""Smallest yaw relative to the siblings, rad, that is taken for a sensor held in another way. Such a yaw is removed
before positions are compared. A smaller yaw stays, and shows as a difference of positions."""

CHI3_MEDIAN = 1.538
"""Median of the chi distribution with 3 degrees of freedom: for a 3-D distance from the mean, in sigmas per axis."""


@dataclass(frozen=True, eq=False)
class DemoCheck:
    """The result of checking one demonstration. Figures are nan, and `p_dock_sensor` is None, where it is unusable.

    Attributes:
        why: why it is unusable, in one line; "" if it is usable.
        duration_s: duration of the recording, s.
        p_dock_sensor: (k, 3) m, the sensor at each keyframe, relative to its position and heading at the first one.
        sigma_m: the largest sigma of a keyframe along an axis, m.
        grips: (keyframe, closes) for each keyframe at which the grip closes (True) or opens (False).
        findings: what a person should look at, in words.
        warnings: those of the findings of which tracking warned.
        motion_s: duration of the robot's motion, s; nan without a robot, or if the robot can't do it.
        refused: why the robot can't do it; "" if it can, or if no robot was named.
        differs: where it is farther from its siblings than chance explains, in words.
    """

    name: str
    why: str = ""
    duration_s: float = np.nan
    p_dock_sensor: Array | None = None
    sigma_m: float = np.nan
    grips: tuple[tuple[int, bool], ...] = ()
    findings: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    motion_s: float = np.nan
    refused: str = ""
    differs: tuple[str, ...] = ()

    def __repr__(self) -> str:
        stopped = "" if self.usable else self.remarks[0]
        return brief(self, stopped or counted(len(self.remarks), "remark") or "nothing to remark", name=self.name)

    @property
    def usable(self) -> bool:
        """Whether it can be tracked and, if a robot was named, replayed by it."""
        return not (self.why or self.refused)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Everything that a person should look at: what makes it unusable, likely causes, then their symptoms."""
        remarks = (self.why, self.refused, *self.warnings, *self.differs, *self.findings)
        return tuple(dict.fromkeys(filter(None, remarks)))


def check_all(
    demos: Sequence[str | Path],
    robot: str | None = None,
    jobs: int | None = None,
    done: Callable[[int], None] | None = None,
    accept_gap: bool = False,
) -> tuple[DemoCheck, ...]:
    """Check each demonstration alone, then compare it with its siblings.

    Siblings have the same number of keyframes and the same grips. joblib distributes the work, to the backend that
    the caller chose with `joblib.parallel_config` (Dask, Ray).

    Args:
        demos: names, folders or files, as `pbd.load_demo` takes them.
        robot: name or file of a robot; each demonstration is also planned for it, on its own dock.
        jobs: number of processes, -1 for one per core; None: one, or what `joblib.parallel_config` says.
        done: called after each demonstration, with the number of those done.
        accept_gap: as `pbd.track` takes it.

    Returns:
        The results in the order of `demos`. An unusable demonstration is a result, not an exception.

    Raises:
        RobotError, CalibrationError: the robot or its calibration can't be loaded.
        WrongTypeError: a single name instead of a list; its letters would be taken for names.
        WrongValueError: `jobs` is 0.
        PbdError: one of the processes was killed.
    """
    from concurrent.futures.process import BrokenProcessPool

    from joblib import Parallel, delayed

    from pbd.planning import load_robot_and_calibration

    if isinstance(demos, str | Path):
        raise WrongTypeError(f"check_all takes a list of demonstrations: check_all([{str(demos)!r}])")
    given = list(demos) if isinstance(demos, Iterable) else [demos]
    valid = all(isinstance(name, str | Path) for name in given)
    require_kind("demos", demos, "a list of demonstrations' names", valid)
    require_kind("jobs", jobs, "a whole number", jobs is None or is_whole_number(jobs))
    if jobs == 0:
        raise WrongValueError("jobs must be 1 or more, or -1 for one process per core, got 0", value=jobs)
    arm = None if robot is None else load_robot_and_calibration(robot)
    names = list(map(str, given))
    jobs = None if jobs is None else min(jobs, len(names) or 1)  # joblib starts as many processes as it is told
    found: list[DemoCheck] = []
    try:
        tasks = (delayed(check_one)(name, arm, accept_gap) for name in names)
        for check in Parallel(n_jobs=jobs, return_as="generator")(tasks):
            found.append(check)
            if done is not None:
                done(len(found))
    except BrokenProcessPool:
        raise PbdError("a process was killed, most often for want of memory; give fewer --jobs") from None
    return compare_siblings(found)


def check_one(name: str, arm: tuple[Robot, Calibration] | None = None, accept_gap: bool = False) -> DemoCheck:
    """Load and track one demonstration, and plan for the `arm`, a robot with its calibration, if there is one."""
    from pbd.planning import plan
    from pbd.planning.preconditions import check_count

    check = DemoCheck(name)
    with collected_warnings() as remarks:
        try:
            demo = load_demo(name)
            check = replace(check, duration_s=float(demo.recording.t[-1]))
            path = track(demo, calibration=arm and arm[1], accept_gap=accept_gap)
            plot = demo_values(path, remarks)
            check_count(plot.keyframes)
        except PbdError as error:
            return replace(check, why=re.sub("; known are [^;]*", "", error.message))  # "did you mean" stays
        keyframes = plot.keyframes
        T_dock_nav = level_onto(keyframes[0].T_nav_sensor, Pose.identity())  # the sensor's heading there is 0
        check = replace(
            check,
            p_dock_sensor=T_dock_nav.act(np.array([keyframe.T_nav_sensor.p for keyframe in keyframes])),
            duration_s=float(path.t[-1]),  # of fused takes: their median, not the first one's
            sigma_m=max(float(np.sqrt(np.diagonal(keyframe.cov)[:3].max())) for keyframe in keyframes),
            grips=tuple((k, each.grip) for k, each in enumerate(keyframes) if each.grip is not None),
            findings=tuple(finding.words for finding in plot.findings),
            warnings=tuple(remarks),
        )
        if arm is None:
            return check
        of_tracking = len(remarks)  # which are findings already
        try:
            motion_s = plan(path, arm[1], arm[0]).duration
        except PbdError as error:
            return replace(check, refused=f"{arm[0].name}: {error.message}")
        return replace(
            check, motion_s=motion_s, findings=tuple(dict.fromkeys((*check.findings, *remarks[of_tracking:])))
        )


def compare_siblings(found: Iterable[DemoCheck]) -> tuple[DemoCheck, ...]:
    """Fill in `differs`: compare a keyframe's distance from the siblings' median with their scatter and its sigma."""
    checks = list(found)
    siblings: dict[Any, list[int]] = defaultdict(list)
    for i, check in enumerate(checks):
        if check.p_dock_sensor is not None:
            siblings[len(check.p_dock_sensor), check.grips].append(i)
    for group in siblings.values():
        if len(group) < FEWEST_SIBLINGS:
            continue
        p = np.array([checks[i].p_dock_sensor for i in group])
        yaws = _sensor_yaws(p)
        p = quat_rotate(quat_about_z(-yaws)[:, None], p)
        distance = np.linalg.norm(p - np.median(p, axis=0), axis=2)
        own = np.array([checks[i].sigma_m for i in group])[:, None]
        bound = OFF_SIGMAS * np.hypot(np.median(distance, axis=0) / CHI3_MEDIAN, own)
        likes = f"the {len(group) - 1} like it"
        for i, yaw, far, most in zip(group, yaws.tolist(), distance, bound, strict=True):
            words, off = [], np.flatnonzero(far > most).tolist()
            if off:
                which = f"keyframe {off[0]} is" if len(off) == 1 else f"keyframes {ranges(off)} are up to"
                words.append(f"{which} {100.0 * far[off].max():.0f} cm from where {likes} have theirs")
            if abs(yaw) > TURNED_RAD:
                words.insert(0, f"the sensor is turned by {np.degrees(yaw):.0f}° about the vertical against {likes}")
            checks[i] = replace(checks[i], differs=tuple(words))
    return tuple(checks)


def _sensor_yaws(p: Array) -> Array:
    """Yaw (n,) rad of each demonstration's keyframes (n, k, 3) m against the demonstration most like the others.

    A yaw up to TURNED_RAD is returned as 0. So are all, where a demonstration has no horizontal motion to show its yaw.
    """
    horizontal = p[..., 0] + 1j * p[..., 1]
    between = np.angle(np.einsum("ik,jk->ij", horizontal.conj(), horizontal))
    yaws: Array = between[np.argmin(np.abs(between).sum(axis=1))]
    shown = (np.abs(horizontal).max(axis=1) > MATCH_M).all()
    return np.where(shown & (np.abs(yaws) > TURNED_RAD), yaws, 0.0)
