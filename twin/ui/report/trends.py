"""Draw the published experiments of `twin.simulation.hazards.trends`: deviation of the tips from the model.

The deviation is drawn as a function of the motion scale and, for stuck motor commands, over time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.simulation.hazards.trends import PUBLISHED, Trends
from twin.simulation.machine.plant import TICK
from twin.ui.report.curves import thin
from twin.ui.report.style import INK, PALETTE, sheet, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEAST = 1e-2
"""Smallest drawn deviation in mm; smaller deviations are drawn at this value."""


def figure(found: Trends) -> Figure:
    """Return a figure with a panel for the motion scales, and a panel for each stuck motor command.

    The first panel shows the simulated and the published deviation at each motion scale. The panel of a stuck motor
    command shows the deviation of the tip in mm over time.
    """
    with styled():
        n = len(found.stuck)
        height = 3.9 + 1.25 * n
        out = sheet(f"{found.robot}: published experiments with an ASSUMED plant: trends, not numbers", height)
        grid = out.add_gridspec(n + 1, 1, height_ratios=[2.7, *[1.1] * n])
        out.subplots_adjust(left=0.09, right=0.98, top=1 - 0.62 / height, bottom=0.5 / height, hspace=0.55)
        ax = out.add_subplot(grid[0])
        x = np.array([r.scale for r in found.scales])
        mean, spread = np.array([r.mean for r in found.scales]), np.array([r.spread for r in found.scales])
        ax.errorbar(x, mean, spread, fmt="o-", color=PALETTE[0], capsize=3, label="simulated, mean ± spread")
        ax.plot(x, [r.peak for r in found.scales], "v", color=PALETTE[0], ms=5, label="simulated, largest")
        middle = float(x.mean())
        ax.errorbar([middle], *PUBLISHED, fmt="s", color=PALETTE[1], capsize=3, label="published, over all scales")
        ax.set_yscale("log")
        ax.set_ylim(_LEAST, 10)
        ax.set_yticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
        ax.set_xticks(x)
        ax.set_title("deviation of the tips in motions without a fault, by motion scale", loc="left", fontsize=8.5)
        ax.set_ylabel("deviation [mm]")
        ax.set_xlabel("motion scale")
        ax.legend(loc="upper left")
        for i, row in enumerate(found.stuck):
            ax = out.add_subplot(grid[1 + i])
            y = found.curves[row.hand, row.counts]
            t, y = thin(TICK * np.arange(1.0, len(y) + 1), np.maximum(y, _LEAST))
            ax.plot(t, y, color=PALETTE[0], linewidth=0.9)
            ax.axhline(3.0, color=INK, linewidth=0.8, linestyle="--")
            ax.set_yscale("log")
            ax.set_xlim(0, 34)
            ax.set_ylim(_LEAST, 300)
            ax.set_yticks([0.01, 1, 100], ["0.01", "1", "100"])
            end = "no stop" if row.stopped is None else f"stopped at fault {row.stopped}"
            end += ", as published" if row in found.as_published else ""
            text = (
                f"hand {row.hand}, {found.motor} stuck at {row.counts:.0f} counts: jumps above 1 mm: {row.jumps}, {end}"
            )
            ax.set_title(text, loc="left", fontsize=8.5)
            ax.set_ylabel("tip [mm]")
        ax.set_xlabel("time [s]; fault every 8 s for 300 ms; dashed: 3 mm")
        return out
