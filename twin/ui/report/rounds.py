"""Draw the path cost over the number of samples of the search, for each phase with a searched path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import count, pretty_unit, quantity
from twin.core.units import MM
from twin.planning.rounds import SearchRounds
from twin.ui.report.style import INK, PALETTE, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIDE = 2.3
"""Space at the right in inches for the legend."""


@styled()
def figure(title: str, searches: Mapping[str, SearchRounds]) -> Figure:
    """Return a figure of the path cost after each round of each search; `searches` are by phase name.

    The x axis is the number of samples. Unlike processor time, this number is the same in each run; thus the bytes of
    the picture are the same, too. Each kind of cost has its own axes, each search its own colour. The dashed line is
    the cost of the path in the search tree. The solid line, with a ring at its end, is the cost of the best path with
    shortcuts. Rounds without a path are crosses on the x axis.
    """
    kinds = list(dict.fromkeys((s.cost, s.unit) for s in searches.values()))
    out, axes = panels(title, [2.1] * len(kinds), 1, _SIDE, 0.5, 0.3)
    for (ax,), (cost, unit) in zip(axes, kinds, strict=True):
        for color, (name, search) in zip(_colors(len(searches)), searches.items(), strict=True):
            if (search.cost, search.unit) == (cost, unit):
                _draw(ax, name, search, color)
        sign = "mm" if unit == "m" else pretty_unit(unit)
        ax.set_ylabel(f"{cost.replace('_', ' ')}{f' [{sign}]' if sign else ''}")
        ax.set_ylim(0, 1.12 * ax.dataLim.ymax)
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1), labelspacing=0.5)
    _samples(axes[-1][0], sorted({r.samples for s in searches.values() for r in s.rounds}))
    return out


def _colors(n: int) -> list[str]:
    return [PALETTE[i % len(PALETTE)] for i in range(n)]


def _draw(ax: Axes, name: str, search: SearchRounds, color: str) -> None:
    """Draw the rounds of one search."""
    x = np.array([r.samples for r in search.rounds], float)
    scale = MM if search.unit == "m" else 1.0
    tree, best = (np.array([getattr(r, kind) for r in search.rounds]) / scale for kind in ("tree", "best"))
    tree[~np.isfinite(tree)], none = np.nan, ~np.isfinite(best)
    best[none] = np.nan
    ax.plot(x, tree, ls=(0, (3, 2)), lw=0.9, marker="s", ms=4, mfc="none", color=color)
    ax.plot(x, best, drawstyle="steps-post", marker="o", ms=4, color=color)
    ax.plot(x[none], np.zeros(none.sum()), "x", color=color, ms=6, clip_on=False, zorder=4)
    ax.plot(x[-1:], best[-1:], "o", ms=9, mfc="none", mec=color, mew=1.4, zorder=4, clip_on=False)
    last = search.rounds[-1]
    value = quantity(last.best, search.unit)
    ax.plot([], [], color=color, label=f"{name}\n{value} after {count(last.samples, 'sample')}")


def _samples(ax: Axes, counts: list[int]) -> None:
    """Make the x axis logarithmic, with ticks at the numbers of samples of the rounds."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    ax.set_xscale("log")
    low, high = max(min(counts), 1), max(*counts, 1)
    ax.set_xlim(low / 1.3, high * 1.3)
    ticks = [low]
    for c in counts:
        if c > 1.25 * ticks[-1] and (c == high or high > 1.25 * c):
            ticks.append(c)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}"))
    ax.xaxis.set_minor_locator(NullLocator())
    text = "samples; squares: path in the search tree, dots: best path with shortcuts, ring: planned path, ×: no path"
    ax.set_xlabel(text, color=INK)
