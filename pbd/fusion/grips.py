"""The grip at each of the task's keyframes: open or closed, as in most takes."""

from collections.abc import Sequence
from itertools import accumulate

from pbd.errors import listed
from pbd.fusion.matching import IndexByTake
from pbd.fusion.takes import Take

DOES = {True: "closes", False: "opens", None: "does not move"}


def fused_grips(keyframes: Sequence[IndexByTake], takes: Sequence[Take]) -> list[bool | None]:
    """Return what the grip does at each of the task's keyframes: True if it closes, False if it opens, else None.

    The takes vote on whether the grip is closed after a keyframe, so a grip counts once even if takes mark it at
    different stops. In a tie it moves if a take moves it here: people forget a mark more often than they add one.
    """
    states = [_states(take) for take in takes]
    before = [False] * len(takes)
    closed, does = False, list[bool | None]()
    for keyframe in keyframes:
        after = {k: states[k][own] for k, own in keyframe.items()}
        others = sum(state is not closed for state in after.values())
        moved = any(state is not closed and state is not before[k] for k, state in after.items())
        changes = 2 * others > len(after) or (2 * others == len(after) and moved)
        closed = closed is not changes
        does.append(closed if changes else None)
        before = [after.get(k, state) for k, state in enumerate(before)]
    return does


def _states(take: Take) -> list[bool]:
    """Return whether the grip is closed after each of a take's own keyframes. It is open at the start."""
    grips = [keyframe.grip for keyframe in take.keyframes]
    return [*accumulate(grips, lambda closed, grip: closed if grip is None else grip, initial=False)][1:]


def differing_grips(keyframes: Sequence[IndexByTake], takes: Sequence[Take]) -> list[str]:
    """Say at which keyframes the takes' grips differ, what the fused grip does, and whether it ends as theirs."""
    lines, does = [], fused_grips(keyframes, takes)
    for j, (keyframe, fused) in enumerate(zip(keyframes, does, strict=True)):
        shown = {takes[k].name: takes[k].keyframes[own].grip for k, own in sorted(keyframe.items())}
        if len(kinds := dict.fromkeys(shown.values())) > 1:
            each = (f"{DOES[kind]} in {listed(name for name, grip in shown.items() if grip is kind)}" for kind in kinds)
            lines.append(f"at keyframe {j} the grip {' but '.join(each)}: fused, it {DOES[fused]}")
    closed = bool([False, *filter(lambda grip: grip is not None, does)][-1])
    ends = [_states(takes[k])[-1] for k in set[int]().union(*keyframes)]
    if 2 * ends.count(not closed) > len(ends):
        word, does_last = ("closed", "opens") if closed else ("open", "closes")
        lines.append(f"the grip stays {word} at the end, but it {does_last} in most takes, at a stop that is left out")
    return [f"{line}; if that is wrong, edit it after pbd keyframes --save" for line in lines]
