"""From several takes of one task to one path: track each, match, estimate jointly, follow the mean path."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pbd.data import Calibration, Demonstration, FusedTake, HandPath
from pbd.errors import RecordingError, TrackingError, in_degrees, warn
from pbd.fusion.grips import differing_grips
from pbd.fusion.joint_estimate import LARGEST_HOLD_RAD, LARGEST_LEVER_M, Observations, TaskState, estimate_jointly
from pbd.fusion.known_stops import condition_on_known_stops
from pbd.fusion.marginals import estimate_with_device, marginal_of
from pbd.fusion.matching import MATCH_M, Alignment, Keyframes, align_takes
from pbd.fusion.moved_things import MovedKeyframes, another_thing, find_moved_keyframes
from pbd.fusion.outliers import disagreement, outlying_take, without_outlying_keyframes
from pbd.fusion.result import Fused, fused_hand_path
from pbd.fusion.scatter import TRACKER_FREEDOM, common_scatter, keyframe_scatter
from pbd.fusion.takes import Take, initial_estimate, matched_keyframes, refuse_other_tasks, tracked_take
from pbd.pose import lengths, matrix_log


def fused_path(demo: Demonstration, method: str, calibration: Calibration | None, accept_gap: bool) -> HandPath:
    """Return the path of a demonstration that lists its takes; see `pbd.pipeline.fuse`.

    Raises:
        RecordingError: two takes are the same recording.
        TrackingError: the takes are of different tasks, or one of them can't be tracked.
    """
    if method != "default":
        raise TrackingError(f"takes are fused by the default method only; track one of them with --method {method}")
    for one, other in combinations([take.recording for take in demo.takes], 2):
        if np.array_equal(one.acc, other.acc, equal_nan=True):
            where = "" if demo.folder is None else f"{demo.folder / 'demo.toml'}: "
            what = f"{where}'{other.info.name}' is the same recording as '{one.info.name}'"
            raise RecordingError(f"{what}; name each take once")
    takes = [tracked_take(take, calibration, accept_gap) for take in demo.takes]
    fused = estimate_task(takes, calibration)
    path = fused_hand_path(demo, fused, calibration, accept_gap)
    assert path.fusion is not None
    lines = _exclusions(path.fusion.takes) + differing_grips(fused.kept, fused.takes)
    lines += [_shifted_sensors(path.fusion.takes), _turned_sensors(fused)]
    lines.append(disagreement(fused.observations, fused.joint, [takes[k].name for k in fused.used]))
    if path.fusion.overall[0] > MATCH_M:
        mm = f"{1e3 * path.fusion.overall[0]:.0f} mm"
        lines.append(f"the keyframes scatter by {mm} from take to take, more than a hand's: are all takes of one task?")
    for line in filter(None, lines):
        warn(line)
    return path


def estimate_task(takes: Sequence[Take], calibration: Calibration | None = None) -> Fused:
    """Estimate a task jointly from its takes, without outliers and takes of another task.

    The first estimate uses each take as it was tracked alone. The final one linearises each take anew at the estimated
    errors of its device.

    Raises:
        TrackingError: most takes don't agree.
    """

    def with_known_stops(observations: Observations, x: TaskState, refuse: bool = False) -> Observations:
        """Return the observations conditioned on what is known of each take's stops."""
        Qs = np.stack((x.Q, x.Q @ x.H), axis=1)
        marginals = [
            condition_on_known_stops(takes[k], marginal, Q, lever, calibration, refuse)
            for k, marginal, Q, lever in zip(used, observations.marginals, Qs, x.lever, strict=True)
        ]
        return replace(observations, marginals=tuple(marginals))

    moved, alignment = _matched([matched_keyframes(take) for take in takes])
    refuse_other_tasks(takes, alignment)
    left_out = dict.fromkeys(alignment.strangers, "another task or another dock, or only a part of it")
    while True:
        used = sorted(alignment.registered)
        observations, x = initial_estimate(takes, used, alignment, moved)
        observations = with_known_stops(observations, x)
        joint = estimate_jointly(observations, x, common_scatter(len(x.m)))
        if (out := outlying_take(observations, joint)) is None:
            break
        left_out[used[out]] = "it is far from the other takes"
        alignment = alignment.without(used[out])
        if 2 * len(alignment.registered) <= len(takes):
            names = ", ".join(takes[k].name for k in left_out)
            raise TrackingError(f"half of the takes don't agree with the others ({names}); record the task again")
    joint, observations, outliers = without_outlying_keyframes(observations, joint)
    states, marginals = [], []
    for k, d in zip(used, observations.device, strict=True):
        states.append(estimate_with_device(takes[k].solution, joint.state.devices[d]))
        marginals.append(marginal_of(takes[k].solution, takes[k].knots, states[-1]))
    observations = replace(observations, marginals=tuple(marginals))
    observations = with_known_stops(observations, joint.state, refuse=True)
    joint = estimate_jointly(observations, joint.state, joint.scatter)
    # A factor for the tracker's covariance, as the takes show it, makes the sigmas honest but not the estimate better.
    honest = estimate_jointly(observations, joint.state, replace(joint.scatter, tracker_freedom=TRACKER_FREEDOM))
    each = estimate_jointly(observations, joint.state, keyframe_scatter(honest.scatter))
    joint = replace(honest, state=joint.state.in_case_axes(observations.device[0]), cov=each.cov)
    _, kept = alignment.kept()
    for line in _undecided_stops(alignment, takes):
        warn(line)
    return Fused(takes, used, left_out, kept, outliers, observations, joint, each.scatter, states)


def _matched(shown: Sequence[Keyframes]) -> tuple[MovedKeyframes | None, Alignment]:
    """Return what moved with an object, and the matched takes."""
    moved = find_moved_keyframes(shown)
    keyframes = shown if moved is None else [moved.put_back(k, one) for k, one in enumerate(shown)]
    if moved is not None and (also := another_thing(moved, keyframes)):
        warn(also)
    return moved, align_takes(keyframes)


def _shifted_sensors(takes: Sequence[FusedTake]) -> str:
    """Say in which takes the sensor seems to sit elsewhere in the hand than in the first one; "" if in none.

    If an object was shifted, and the hand had one attitude at all of its keyframes, a lever explains the shift as well.
    """
    levers = {take.name: float(np.linalg.norm(take.T_hand.p)) for take in takes if take.T_hand is not None}
    first, far = next(iter(levers)), [name for name, lever in levers.items() if lever > LARGEST_LEVER_M]
    if not far:
        return ""
    return (
        f"in {' and '.join(far)} the sensor seems to sit {100.0 * max(levers.values()):.0f} cm from its place in the "
        f"hand in {first}; if nobody moved it, something stood elsewhere, and the keyframes are where {first} had "
        "them: record the takes that are wrong again"
    )


def _turned_sensors(fused: Fused) -> str:
    """Say in which takes the sensor was turned in the hand between the dock and the task; "" if in none."""
    rad = lengths(matrix_log(fused.joint.state.H))
    far = [fused.takes[k].name for k, each in zip(fused.used, rad, strict=True) if each > LARGEST_HOLD_RAD]
    if not far:
        return ""
    return (
        f"in {' and '.join(far)} the sensor seems to be turned in the hand after the dock, by up to "
        f"{in_degrees(rad.max())} from the mean of the takes, which is used; hold it alike, and record those again"
    )


def _undecided_stops(alignment: Alignment, takes: Sequence[Take]) -> list[str]:
    """Say which stops are left out though half of the takes have them."""
    undecided: dict[tuple[int, ...], list[int]] = {}
    for own in alignment.own[1:]:  # the first is the dock, which is kept
        if 2 * len(own) == len(alignment.registered):
            undecided.setdefault(tuple(sorted(own)), []).append(own[min(own)])
    lines = []
    for having, stops in undecided.items():
        names, several = [takes[k].name for k in having], len(stops) > 1
        lines.append(
            f"only {' and '.join(names)} {'has' if len(names) == 1 else 'have'} stop{'s' * several} "
            f"{' '.join(map(str, stops))}{'' if len(names) == 1 else f' of {names[0]}'}, and "
            f"{'they are' if several else 'it is'} left out; one more take would show whether "
            f"{'they belong' if several else 'it belongs'} to the task"
        )
    return lines


def _exclusions(takes: Sequence[FusedTake]) -> list[str]:
    """Say which takes, and which keyframes of takes, are left out."""
    return [f"{take.name} is left out: {take.left_out}" for take in takes if take.left_out] + [
        f"{take.name} is not believed at keyframe {j}: it is {1e3 * np.linalg.norm(take.off[j]):.0f} mm and "
        f"{in_degrees(take.off_rad[j])} from the other takes"
        for take in takes
        for j in take.outliers
    ]
