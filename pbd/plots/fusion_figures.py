"""Figures of fused takes: each take's keyframes relative to the fused ones, and the hand's scatter."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure

from pbd.data import Fusion, HandPath
from pbd.data.one_line_repr import counted
from pbd.plots.compare_figures import LONGEST_NAME, MAX_NAMED, standard_deviations
from pbd.plots.panels import XYZ
from pbd.plots.style import GREY, RUNS_RGB, legend, new_figure, plain_text, style


def draw_fusion(name: str, path: HandPath) -> Figure:
    """Draw one of FUSION_FIGURES."""
    assert path.fusion is not None
    with style():
        return FUSION_FIGURES[name](path.fusion)


def match(fusion: Fusion) -> Figure:
    """Each take's keyframes minus the fused ones, along each axis. A cross is an outlier, which the fusion ignores."""
    figure = new_figure("Keyframes of each take, minus the task's", 10.0, 6.6)
    axes = figure.subplots(3, sharex=True, sharey=True)
    axes[0].set_title(_subtitle(fusion))
    k, used = np.arange(len(fusion.scatter)), [take for take in fusion.takes if not take.left_out]
    for axis, ax in enumerate(axes):
        ax.fill_between(k, *(sign * 1e3 * fusion.tolerance_m[:, axis] for sign in (-1, 1)), color=GREY, alpha=0.15)
        for i, take in enumerate(used):
            look = {"color": RUNS_RGB[i % len(RUNS_RGB)], "linestyle": "", "markersize": 4.5}
            shift = 0.5 * (i + 0.5) / len(used) - 0.25
            label = plain_text(take.name, LONGEST_NAME) if i < MAX_NAMED else None
            out = np.isin(k, take.outliers)
            ax.plot(k[~out] + shift, 1e3 * take.off[~out, axis], marker="o", label=label, **look)
            ax.plot(k[out] + shift, 1e3 * take.off[out, axis], marker="x", **look)
        ax.set_ylabel(f"{XYZ[axis]} (mm)")
    axes[-1].set_xlabel("keyframe (grey: the tolerance that is learned)")
    figure.align_ylabels(axes)
    legend(figure, [axes[0]])
    return figure


def scatter(fusion: Fusion) -> Figure:
    """The hand's scatter at each keyframe, and the sigma of that estimate."""
    title = "How the hand scatters from take to take, without the tracker's uncertainty"
    return standard_deviations(title, _subtitle(fusion), fusion.scatter, fusion.turn, fusion.unsure)


def _subtitle(fusion: Fusion) -> str:
    used = sum(not take.left_out for take in fusion.takes)
    return f"{used} of {len(fusion.takes)} takes, {counted(len(fusion.scatter), 'keyframe')}"


FUSION_FIGURES: Mapping[str, Callable[[Fusion], Figure]] = {"match": match, "scatter": scatter}
"""File name -> how the figure is drawn."""
