"""Draw the convergence of the searches for tip and trocar: residual after each step, by outcome."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import power
from twin.core.spatial import Array
from twin.ui.report.style import FIT, INK, NEAR, UNFIT, headline, log_ticks, panels
from twin.validation.result import Report
from twin.validation.trocar_methods import METHODS_TOLERANCE, OUTCOMES, SEARCHES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_CURVES = 20
"""Maximum number of curves of an outcome, because the page contains all points."""

_LAST_STEP = 60
"""Last step of the drawing; searches that do not converge by then stay where they are."""

_MIN_RESIDUAL = 1e-16
_MAX_RESIDUAL = 10.0
"""Range of the residual axis in m."""

_OUTCOME_COLORS = (FIT, NEAR, UNFIT)
"""Colours of the `OUTCOMES`, in their order."""


def convergence(report: Report) -> Figure | None:
    """Draw the residual of each search over its steps; None if the report has no such searches."""
    keys = []
    for key in SEARCHES:
        if key in report.series:
            keys.append(key)
    if not keys:
        return None
    figure, axes = panels(headline("Searches for tip and trocar", report), [3.0], len(keys), head=1.3)
    for i, (ax, key) in enumerate(zip(axes[0], keys, strict=True)):
        history = np.asarray(report.series[key])
        outcome = np.asarray(report.series[f"{key}.outcome"])
        _draw_searches(ax, history, outcome)
        ax.set_title(SEARCHES[key], loc="left", fontsize=9, color=INK, pad=48)
        lines, labels = ax.get_legend_handles_labels()
        ax.legend(
            lines[::-1],  # solved searches, which are drawn last, come first
            labels[::-1],
            loc="lower left",
            bbox_to_anchor=(0, 1),
            borderaxespad=0.2,
            ncols=1,
            labelspacing=0.2,
            fontsize=8.5,
        )
        log_ticks(ax, [1e-16, 1e-12, 1e-8, 1e-4, 1.0], _length_label)
        ax.set_ylim(_MIN_RESIDUAL, _MAX_RESIDUAL)
        ax.set_xlim(0, _LAST_STEP)
        ax.set_xlabel("step")
        ax.axhline(METHODS_TOLERANCE, color=INK, lw=1.0, ls=(0, (5, 2)), zorder=1.8)
        ax.annotate(
            "tolerance",
            (1, METHODS_TOLERANCE),
            (-2, 2),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            color=INK,
            fontsize=8.5,
            ha="right",
            va="bottom",
        )
        if i:
            ax.tick_params(labelleft=False)
    axes[0][0].set_ylabel("residual", labelpad=12)
    return figure


def _length_label(value: float) -> str:
    if value == 1.0:
        return "1 m"
    return f"{power(value, 1)} m".removeprefix("1×")


def _draw_searches(ax: Axes, history: Array, outcome: np.ndarray) -> None:
    """Draw some of the searches of each outcome; the legend states the numbers of all.

    `history` (searches, steps) has the residual after each step, NaN after the last one; `outcome` (searches,) has the
    index of each outcome in `OUTCOMES`.
    """
    for kind in reversed(range(len(OUTCOMES))):  # the solved ones on top
        runs = np.flatnonzero(outcome == kind)
        if not len(runs):
            continue
        color = _OUTCOME_COLORS[kind]
        label: str | None = f"{OUTCOMES[kind]}: {len(runs)}"
        for run in runs[:_MAX_CURVES]:
            steps = history[run]
            steps = steps[~np.isnan(steps)]
            values = np.maximum(steps[: _LAST_STEP + 1], _MIN_RESIDUAL)
            ax.plot(values, color=color, lw=0.9, alpha=0.65, label=label)
            ax.plot([len(values) - 1], values[-1:], ".", ms=3.5, color=color, clip_on=False)
            label = None  # one entry of the legend for all searches of an outcome
