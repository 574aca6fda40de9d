"""Other options that a refusal may name: each is tried first, and only those that lead to a motion are named."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace

from pbd.errors import PbdError
from pbd.planning.options import PlanOptions


def works(plan: Callable[[PlanOptions], object], options: PlanOptions) -> bool:
    """Whether a motion can be planned with these options; what is told on the way is not passed on."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            plan(options)
        except PbdError:
            return False
    return True


def advised(error: PbdError, plan: Callable[[PlanOptions], object], options: PlanOptions) -> PbdError:
    """Add to a refusal with `options` what the user may choose instead, as far as it works."""
    words = [said for said, instead in _others(error, options) if works(plan, instead)]
    return type(error)(", or ".join((error.message, *words)), **error.fields) if words else error


def _others(error: PbdError, options: PlanOptions) -> Iterator[tuple[str, PlanOptions]]:
    if "home" in error.fields:
        if options.approach and options.start is None:
            said = "skip home (--no-approach --no-retreat), or start elsewhere (--from, --no-retreat)"
            yield said, replace(options, approach=False, retreat=False)
        else:
            yield "do not go back home (--no-retreat)", replace(options, retreat=False)
    if "apart" in error.fields:
        yield "follow the hand with --path demo", replace(options, path="demo", tolerance_m=None)
    straight = options.path == "keyframes" and options.tolerance_m is None
    if "way" in error.fields and not straight:
        yield "use --path keyframes", replace(options, path="keyframes", tolerance_m=None)
    if "closest" in error.fields and not options.allow_collision:
        yield "view the motion with --allow-collision", replace(options, allow_collision=True)
