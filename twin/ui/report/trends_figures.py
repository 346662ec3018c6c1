"""Draw the published experiments of `twin.simulation.campaigns.trends`: deviation of the tips from the model.

The deviation is drawn as a function of the motion scale and, for stuck motor commands, over time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array
from twin.simulation.campaigns.trends_result import PUBLISHED, ScaleRow, Trends
from twin.simulation.machine.physics import TICK
from twin.ui.report.plot_data import thinned_curve
from twin.ui.report.style import INK, PALETTE, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MIN_DEVIATION = 1e-2
"""Smallest drawn deviation in mm; smaller deviations are drawn at this value."""


@styled()
def figure(trends: Trends) -> Figure:
    """Return a figure with a panel for the motion scales, and a panel for each stuck motor command.

    The first panel shows the simulated and the published deviation at each motion scale. The panel of a stuck motor
    command shows the deviation of the tip in mm over time.
    """
    n = len(trends.stuck)
    height = 3.9 + 1.25 * n
    drawing = titled_figure(f"{trends.robot}: published experiments with an ASSUMED plant: trends, not numbers", height)
    grid = drawing.add_gridspec(n + 1, 1, height_ratios=[2.7, *[1.1] * n])
    drawing.subplots_adjust(left=0.09, right=0.98, top=1 - 0.62 / height, bottom=0.5 / height, hspace=0.55)
    ax = drawing.add_subplot(grid[0])
    _draw_scales(ax, trends.by_servo)
    for i, row in enumerate(trends.stuck):
        ax = drawing.add_subplot(grid[1 + i])
        _draw_stuck(ax, trends.curves[row.hand, row.counts])
        end = "no stop"
        if row.stopped is not None:
            end = f"stopped at fault {row.stopped}"
        if row in trends.as_published:
            end += ", as published"
        command = f"hand {row.hand}, {trends.motor} stuck at {row.counts:.0f} counts"
        ax.set_title(f"{command}: jumps above 1 mm: {row.jumps}, {end}", loc="left", fontsize=8.5)
    ax.set_xlabel("time [s]; fault every 8 s for 300 ms; dashed: 3 mm")
    return drawing


def _draw_scales(ax: Axes, scales: Mapping[str, Sequence[ScaleRow]]) -> None:
    """Draw simulated deviations by motion scale, for each servo of the model, and the published one."""
    x = np.array([])
    for k, (servo, rows) in enumerate(scales.items()):
        color = PALETTE[0] if k % 2 == 0 else PALETTE[2]
        x = np.array([row.scale for row in rows])
        mean = np.array([row.mean for row in rows])
        spread = np.array([row.spread for row in rows])
        peak = np.array([row.peak for row in rows])
        # points of two servos beside each other
        beside = x + 0.002 * k
        label = f"model's servo: {servo}"
        ax.errorbar(beside, mean, spread, fmt="o-", color=color, capsize=3, label=f"{label}, mean ± spread")
        ax.plot(beside, peak, "v", color=color, ms=5, label=f"{label}, largest")
    # the publication states one value for all scales: it is drawn in the middle
    middle = float(x.mean())
    ax.errorbar([middle], *PUBLISHED, fmt="s", color=PALETTE[1], capsize=3, label="published, over all scales")
    ax.set_yscale("log")
    ax.set_ylim(_MIN_DEVIATION, 10)
    ax.set_yticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
    ax.set_xticks(x)
    ax.set_title("deviation of the tips in motions without a fault, by motion scale", loc="left", fontsize=8.5)
    ax.set_ylabel("deviation [mm]")
    ax.legend(loc="lower right", fontsize=7.5)


def _draw_stuck(ax: Axes, deviation: Array) -> None:
    """Draw the deviation (k,) of the tip in mm at each tick, and the limit of 3 mm."""
    times = TICK * np.arange(1.0, len(deviation) + 1)
    # the axis is logarithmic, and a machine without a fault has no deviation at first
    t, y = thinned_curve(times, np.maximum(deviation, _MIN_DEVIATION))
    ax.plot(t, y, color=PALETTE[0], linewidth=0.9)
    ax.axhline(3.0, color=INK, linewidth=0.8, linestyle="--")
    ax.set_yscale("log")
    ax.set_xlim(0, 34)
    ax.set_ylim(_MIN_DEVIATION, 300)
    ax.set_yticks([0.01, 1, 100], ["0.01", "1", "100"])
    ax.set_ylabel("tip [mm]")
