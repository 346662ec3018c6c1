"""Draw a sweep over designs: the trade-off between the first two objectives, and each objective over each factor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.analysis.sweep import Sweep
from twin.ui.report.style import INK, PALETTE, sheet, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled()
def figure(found: Sweep) -> Figure:
    """Return a figure with the trade-off of the first two objectives, and a panel for each objective and factor.

    The panel of an objective and a factor shows the objective over the factor. A point is a design, a star the design
    of the CAD.
    """
    robot, judged, best, names = found.robot, found.judged, found.best, list(found.rows[0])[1:-1]
    scales = np.array([f.scale for f in found.work.factors])
    designs, factors, objectives = found.designs / scales, names[: len(scales)], names[len(scales) :]

    trade = len(objectives) > 1
    rows = trade + len(objectives)
    height = 0.7 + 3.4 * trade + 2.2 * len(objectives)
    out = sheet(f"{robot}: {len(designs) - 1} designs, compared with the CAD", height)
    grid = out.add_gridspec(rows, len(factors), height_ratios=[3.4] * trade + [2.2] * len(objectives))
    out.subplots_adjust(left=0.09, right=0.97, top=1 - 0.5 / height, bottom=0.5 / height, hspace=0.42, wspace=0.25)
    if trade:
        ax = out.add_subplot(grid[0, :])
        x, y = judged[:, 0], judged[:, 1]
        ax.scatter(x[~best], y[~best], s=12, color=PALETTE[7], label="dominated")
        order = np.flatnonzero(best)[np.argsort(x[best])]
        ax.plot(x[order], y[order], color=PALETTE[0], linewidth=0.8)
        ax.scatter(x[order], y[order], s=22, color=PALETTE[0], label="Pareto-optimal")
        ax.scatter(x[:1], y[:1], s=110, marker="*", color=PALETTE[1], zorder=3, label="CAD")
        ax.set_xlabel(objectives[0])
        ax.set_ylabel(objectives[1])
        ax.legend(loc="best")
    for i, objective in enumerate(objectives):
        for j, factor in enumerate(factors):
            ax = out.add_subplot(grid[trade + i, j])
            ax.scatter(designs[~best, j], judged[~best, i], s=8, color=PALETTE[7])
            ax.scatter(designs[best, j], judged[best, i], s=14, color=PALETTE[0])
            ax.scatter(designs[:1, j], judged[:1, i], s=80, marker="*", color=PALETTE[1], zorder=3)
            ax.tick_params(labelcolor=INK)
            if j == 0:
                ax.set_ylabel(objective)
            if i == len(objectives) - 1:
                ax.set_xlabel(factor)
    return out
