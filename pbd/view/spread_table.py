"""The spread of several demonstrations at each keyframe, as a table for people and as rows for programs."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from pbd.view.plot_values import ComparePlot, SpreadKeyframe


def spread_table(plot: ComparePlot) -> Table:
    """Mean position, standard deviations, and who is furthest off, at each keyframe of the task."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    columns = ("x (m)", "y (m)", "z (m)", "spread x (mm)", "y (mm)", "z (mm)", "turn (°)", "σ (mm)", "furthest (mm)")
    for column in ("#", "in", *columns):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("which", overflow="fold")
    for number, keyframe in enumerate(plot.keyframes):
        table.add_row(
            str(number),
            f"{keyframe.count} of {len(plot.runs)}",
            *(f"{x + 0.0:.3f}" for x in np.round(keyframe.p, 3)),
            *(_or_dash(1e3 * x) for x in keyframe.spread),
            _or_dash(float(np.degrees(keyframe.turn))),
            _or_dash(1e3 * float(keyframe.sigma.max())),
            *_furthest(plot, keyframe),
        )
    return table


def _furthest(plot: ComparePlot, keyframe: SpreadKeyframe) -> tuple[str, str]:
    if keyframe.count < 2 or keyframe.furthest_m == 0.0:
        return "", ""
    return f"{1e3 * keyframe.furthest_m:.1f}", plot.runs[keyframe.furthest].name


def _or_dash(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "–"


def spread_rows(plot: ComparePlot) -> list[dict[str, Any]]:
    """The same for `--json`; what is not known is null."""
    return [
        {
            "index": number,
            "keyframes": list(keyframe.own),
            "position_m": keyframe.p.tolist(),
            "spread_m": [_or_none(x) for x in keyframe.spread.tolist()],
            "spread_deg": _or_none(float(np.degrees(keyframe.turn))),
            "sigma_m": keyframe.sigma.tolist(),
            "furthest": plot.runs[keyframe.furthest].name,
            "furthest_m": keyframe.furthest_m,
        }
        for number, keyframe in enumerate(plot.keyframes)
    ]


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None
