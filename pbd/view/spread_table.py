"""The spread of several demonstrations at each keyframe, as a table for people and as rows for programs."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from pbd.view.plot_values import ComparePlot, SpreadKeyframe
from pbd.view.units import Units


def spread_table(plot: ComparePlot, units: Units) -> Table:
    """Mean position, standard deviations, and who is furthest off, at each keyframe; what is not known is blank."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    m, deg = units.length, units.angle_sign
    positions, spreads = ([f"{what}{axis} ({m})" for axis in "xyz"] for what in ("", "spread "))
    ends = (f"spread ({deg})", f"σ ({m})", f"furthest ({m})")
    for column in ("#", f"in (of {len(plot.runs)})", *positions, *spreads, *ends):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("which", overflow="fold")
    for number, keyframe in enumerate(plot.keyframes):
        several = keyframe.count > 1
        table.add_row(
            str(number),
            str(keyframe.count),
            *units.lengths(keyframe.p),
            *(units.lengths(keyframe.spread, finer=1) if several else [""] * 3),
            *(units.angles(keyframe.turn) if several else [""]),
            *units.lengths(keyframe.sigma.max(), finer=1),
            *_furthest(plot, keyframe, units),
        )
    return table


def _furthest(plot: ComparePlot, keyframe: SpreadKeyframe, units: Units) -> tuple[str, str]:
    if keyframe.count < 2 or keyframe.furthest_m == 0.0:
        return "", ""
    return units.lengths(keyframe.furthest_m, finer=1)[0], plot.runs[keyframe.furthest].name


def spread_rows(plot: ComparePlot) -> list[dict[str, Any]]:
    """The same for `--json`; what is not known is null."""
    return [
        {
            "index": number,
            "keyframes": list(keyframe.own),
            "position_m": keyframe.p.tolist(),
            "spread_m": [_or_none(x) for x in keyframe.spread.tolist()],
            "spread_deg": _or_none(float(np.degrees(keyframe.turn))),
            "sigma_m": [_or_none(x) for x in keyframe.sigma.tolist()],
            "furthest": plot.runs[keyframe.furthest].name,
            "furthest_m": keyframe.furthest_m,
        }
        for number, keyframe in enumerate(plot.keyframes)
    ]


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
