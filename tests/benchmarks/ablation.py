"""What each idea of the tracker gains: python tests/benchmarks/ablation.py [--data DIR] [--json] [--quick].

The figures of tracking.py with one idea at a time taken out, by setting its constant to where it does nothing.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from pbd.errors import PbdWarning
from pbd.tracking import integration, orientation, stops
from tests.benchmarks.report import add_data, arguments, print_machine
from tests.benchmarks.tracking import score

WITHOUT: dict[str, tuple[ModuleType, str, float]] = {
    "as it is": (orientation, "TAU_ACC_S", orientation.TAU_ACC_S),
    "VQF's own tilt time constant, 3 s": (orientation, "TAU_ACC_S", 3.0),
    "drift taken out linearly in time": (integration, "EVEN_DRIFT", 1e6),
    "no lulls between strides": (stops, "PEAK_SHARE", 0.0),
    "coasting not found out": (stops, "COASTING_STOPS", 0),
    "no steadiness asked of a rest": (stops, "STEADY_ACC", 1e6),
}
"""Idea taken out -> module, constant, value at which it does nothing."""

COLUMNS = ("slow 1 s", "slow 5 s p95", "fast 1 s", "strides", "strides p95", "walk", "F1 at 40 Hz")


def main() -> None:
    """Score with each idea taken out, and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    rows = {}
    for name, (module, constant, value) in WITHOUT.items():
        kept = getattr(module, constant)
        setattr(module, constant, value)
        try:
            rows[name] = row(score(args.data, ("286", "40")))
        finally:
            setattr(module, constant, kept)
    if args.json:
        import json

        print(json.dumps(rows))
        return
    print_machine()
    print(f"{'cm, at 40 Hz':<36}" + "".join(f"{column:>14}" for column in COLUMNS))
    for name, values in rows.items():
        print(f"{name:<36}" + "".join(f"{values[column]:>14.3g}" for column in COLUMNS))


def row(figures: dict[str, Any]) -> dict[str, float]:
    """The figures that tell the ideas apart; F1 is that of the worst trial."""
    slow, fast = figures["windows"]["slow_translation"], figures["windows"]["fast_translation"]
    (strides,), (walk,) = figures["strides"].values(), figures["walks"].values()
    return dict(
        zip(
            COLUMNS,
            (
                slow["1"]["40"]["median_cm"],
                slow["5"]["40"]["p95_cm"],
                fast["1"]["40"]["median_cm"],
                strides["median_abs_cm"],
                strides["p95_abs_cm"],
                walk["closure_cm"],
                min(trial["rates_hz"]["40"]["f1"] for trial in figures["stops"].values()),
            ),
            strict=True,
        )
    )


if __name__ == "__main__":
    main()
