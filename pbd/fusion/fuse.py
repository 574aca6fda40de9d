"""From several takes of one task to one path: track each, align them, estimate them together, follow their mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.data import Calibration, Demonstration, FusedTake, HandPath
from pbd.errors import TrackingError, warn
from pbd.fusion.joint_estimate import Joint, Parts, State, estimate_jointly
from pbd.fusion.known_stops import told
from pbd.fusion.marginals import marginal_of, pinned
from pbd.fusion.matching import Alignment, align
from pbd.fusion.moved_things import Moved, moved_thing
from pbd.fusion.outliers import Disbelieved, believed, disagreement
from pbd.fusion.result import Fused, hand_path
from pbd.fusion.scatter import TRACKER_WORTH, alike, each
from pbd.fusion.takes import Take, keyframes_of_take, refuse_strangers, start, tracked_take


def fused_path(demo: Demonstration, method: str, calibration: Calibration | None, accept_gap: bool) -> HandPath:
    """The path of a demonstration that lists its takes; see `pbd.pipeline.fuse`.

    Raises:
        TrackingError: the takes are of different tasks, or one of them can't be tracked.
    """
    if method != "default":
        raise TrackingError(f"takes are fused by the default method only; track one of them with --method {method}")
    takes = [tracked_take(take, calibration, accept_gap) for take in demo.takes]
    fused = estimated(takes, calibration)
    path = hand_path(demo, fused, calibration, accept_gap)
    assert path.fusion is not None
    words = [*_left_out(path.fusion.takes), disagreement(fused.parts, fused.joint, [takes[k].name for k in fused.used])]
    for line in filter(None, words):
        warn(line)
    return path


def estimated(takes: Sequence[Take], calibration: Calibration | None = None) -> Fused:
    """The joint estimate, without takes that are of another task or outliers; linearised anew at its own device."""
    keyframes = [keyframes_of_take(take) for take in takes]
    thing = moved_thing(keyframes)
    if thing is not None:
        keyframes = [thing.put_back(k, one) for k, one in enumerate(keyframes)]
    found = align(keyframes)
    refuse_strangers(takes, found)
    left = dict.fromkeys(found.strangers, "another task")
    while True:
        used, parts, joint, disbelieved = _believed(takes, found, thing, calibration)
        if disbelieved.take is None:
            break
        left[used[disbelieved.take]] = "it is far from the other takes"
        found = found.without([used[disbelieved.take]])
        if 2 * len(found.registered) <= len(takes):
            names = ", ".join(takes[k].name for k in left)
            raise TrackingError(f"half of the takes don't agree with the others ({names}); record the task again")
    states = [pinned(takes[k].solution, joint.state.devices[d]) for k, d in zip(used, parts.device, strict=True)]
    marginals = [marginal_of(takes[k].solution, takes[k].knots, state) for k, state in zip(used, states, strict=True)]
    parts = _told(takes, used, replace(parts, marginals=tuple(marginals)), joint.state, calibration, refuse=True)
    joint = estimate_jointly(parts, joint.state, joint.scatter)
    # How sure it is, by what the takes show of the tracker's noise; an estimate by that would be no better.
    sure = estimate_jointly(parts, joint.state, replace(joint.scatter, worth=TRACKER_WORTH))
    own = estimate_jointly(parts, joint.state, each(sure.scatter)).scatter
    joint = replace(sure, state=joint.state.of_case(parts.device[0]))
    return Fused(takes, used, left, found.kept(), disbelieved.keyframes, parts, joint, own, states, thing)


def _told(
    takes: Sequence[Take],
    used: Sequence[int],
    parts: Parts,
    x: State,
    calibration: Calibration | None,
    refuse: bool = False,
) -> Parts:
    """The same with what is known of each take's stops."""
    marginals = [
        told(takes[k], marginal, Q, lever, calibration, refuse)
        for k, marginal, Q, lever in zip(used, parts.marginals, x.Q, x.lever, strict=True)
    ]
    return replace(parts, marginals=tuple(marginals))


def _believed(
    takes: Sequence[Take], found: Alignment, thing: Moved | None, calibration: Calibration | None
) -> tuple[list[int], Parts, Joint, Disbelieved]:
    """The takes that are used, and what they make without the keyframes that don't fit."""
    used = sorted(found.registered)
    parts, x = start(takes, used, found, thing)
    parts = _told(takes, used, parts, x, calibration)
    joint, parts, disbelieved = believed(parts, estimate_jointly(parts, x, alike(len(x.m))))
    return used, parts, joint, disbelieved


def _left_out(takes: Sequence[FusedTake]) -> list[str]:
    """Which takes, and which keyframes of takes, are not believed."""
    words = [f"{take.name} is left out: {take.left_out}" for take in takes if take.left_out]
    used = [take for take in takes if not take.left_out]
    if len(used) == 2:  # of more takes most decide
        words += [
            f"only {take.name} has stops {' '.join(map(str, take.extra))}, and they are left out; "
            "a third take would show whether they belong to the task"
            if len(take.extra) > 1
            else f"only {take.name} has stop {take.extra[0]}, and it is left out; "
            "a third take would show whether it belongs to the task"
            for take in used
            if take.extra
        ]
    return words + [
        f"{take.name} is not believed at keyframe {j}: it is {1e3 * np.linalg.norm(take.off[j]):.0f} mm from the other "
        "takes"
        for take in takes
        for j in take.outliers
    ]
