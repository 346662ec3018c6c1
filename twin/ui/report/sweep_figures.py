"""Draw a sweep over designs: the trade-off between the first two objectives, and each objective over each factor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.analysis.sweep import Sweep
from twin.ui.report.style import INK, PALETTE, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@styled()
def figure(sweep: Sweep) -> Figure:
    """Return a figure with the trade-off of the first two objectives, and a panel for each objective and factor.

    The panel of an objective and a factor shows the objective over the factor. A point is a design, a star the design
    of the CAD.
    """
    best = sweep.best
    scales = np.array([factor.scale for factor in sweep.job.factors])
    designs = sweep.designs / scales
    # the first column of the table is the number of the design, the last one whether it is Pareto-optimal
    names = list(sweep.rows[0])[1:-1]
    factors = names[: len(scales)]
    objectives = names[len(scales) :]

    heights = [2.2] * len(objectives)
    has_trade = len(objectives) > 1
    best_name = "best"
    if has_trade:
        best_name = "Pareto-optimal"
        heights.insert(0, 3.4)
    height = 0.7 + sum(heights)
    drawing = titled_figure(f"{sweep.robot}: {len(designs) - 1} designs, compared with the CAD", height)
    grid = drawing.add_gridspec(len(heights), len(factors), height_ratios=heights)
    drawing.subplots_adjust(left=0.09, right=0.97, top=1 - 0.5 / height, bottom=0.5 / height, hspace=0.42, wspace=0.25)
    if has_trade:
        _draw_trade_off(drawing.add_subplot(grid[0, :]), sweep, objectives)
    first_row = len(heights) - len(objectives)
    for i, objective in enumerate(objectives):
        y = sweep.judged[:, i]
        for j, factor in enumerate(factors):
            x = designs[:, j]
            ax = drawing.add_subplot(grid[first_row + i, j])
            ax.scatter(x[~best], y[~best], s=8, color=PALETTE[7], label="dominated")
            ax.scatter(x[best], y[best], s=14, color=PALETTE[0], label=best_name)
            ax.scatter(x[:1], y[:1], s=80, marker="*", color=PALETTE[1], zorder=3, label="CAD")  # design 0
            ax.tick_params(labelcolor=INK)
            if j == 0:
                ax.set_ylabel(objective)
            if i == len(objectives) - 1:
                ax.set_xlabel(factor)
            if not has_trade and j == 0:
                ax.legend(loc="best")
    return drawing


def _draw_trade_off(ax: Axes, sweep: Sweep, objectives: list[str]) -> None:
    """Draw the second objective over the first, with the Pareto-optimal designs connected."""
    best = sweep.best
    x = sweep.judged[:, 0]
    y = sweep.judged[:, 1]
    ax.scatter(x[~best], y[~best], s=12, color=PALETTE[7], label="dominated")
    optimal = np.flatnonzero(best)
    optimal = optimal[np.argsort(x[optimal])]
    ax.plot(x[optimal], y[optimal], color=PALETTE[0], linewidth=0.8)
    ax.scatter(x[optimal], y[optimal], s=22, color=PALETTE[0], label="Pareto-optimal")
    ax.scatter(x[:1], y[:1], s=110, marker="*", color=PALETTE[1], zorder=3, label="CAD")
    ax.set_xlabel(objectives[0])
    ax.set_ylabel(objectives[1])
    ax.legend(loc="best")
