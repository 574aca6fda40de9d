"""The grip at each of the task's keyframes: what most takes do there."""

from __future__ import annotations

from collections.abc import Sequence

from pbd.errors import listed
from pbd.fusion.matching import Candidate
from pbd.fusion.takes import Take

DOES = {True: "closes", False: "opens", None: "does not move"}


def fused_grip(shown: Sequence[bool | None]) -> bool | None:
    """Return the grip of most takes. Of a tie it is the one that moves, which is forgotten more easily than made up."""
    return max(shown, key=lambda grip: (shown.count(grip), grip is not None))


def grips_of(keyframe: Candidate, takes: Sequence[Take]) -> dict[str, bool | None]:
    """Return take -> its grip at one of the task's keyframes."""
    return {takes[k].name: takes[k].keyframes[own].grip for k, own in sorted(keyframe.own.items())}


def differing_grips(keyframes: Sequence[Candidate], takes: Sequence[Take]) -> list[str]:
    """Say at which keyframes the takes' grips differ, and what the fused grip does."""
    lines = []
    for j, keyframe in enumerate(keyframes):
        shown = grips_of(keyframe, takes)
        if len(kinds := dict.fromkeys(shown.values())) > 1:
            each = (f"{DOES[kind]} in {listed(name for name, grip in shown.items() if grip is kind)}" for kind in kinds)
            does = DOES[fused_grip([*shown.values()])]
            what = f"at keyframe {j} the grip {' but '.join(each)}: fused, it {does}"
            lines.append(f"{what}; if that is wrong, edit it after pbd keyframes --save")
    return lines
