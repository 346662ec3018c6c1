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

_LEGEND_WIDTH = 2.3
"""Space at the right in inches for the legend."""

_MIN_TICK_RATIO = 1.25
"""Smallest ratio of two ticks in sequence on the logarithmic axis: labels of closer ones would overlap."""


@styled()
def figure(title: str, searches: Mapping[str, SearchRounds]) -> Figure:
    """Return a figure of the path cost after each round of each search; `searches` are by phase name.

    The x axis is the number of samples. Unlike processor time, this number is the same in each run; thus the bytes of
    the picture are the same, too. Each kind of cost has its own axes, each search its own colour. The dashed line is
    the cost of the path in the search tree. The solid line, with a ring at its end, is the cost of the best path with
    shortcuts. Rounds without a path are crosses on the x axis.
    """
    kinds = []
    for search in searches.values():
        kind = (search.cost, search.unit)
        if kind not in kinds:
            kinds.append(kind)
    drawing, axes = panels(title, [2.1] * len(kinds), 1, _LEGEND_WIDTH, 0.5, 0.3)
    counts: set[int] = set()
    for (ax,), (cost, unit) in zip(axes, kinds, strict=True):
        for i, (name, search) in enumerate(searches.items()):
            if (search.cost, search.unit) != (cost, unit):
                continue
            _draw_search(ax, name, search, PALETTE[i % len(PALETTE)])
            for search_round in search.rounds:
                counts.add(search_round.samples)
        sign = "mm" if unit == "m" else pretty_unit(unit)
        label = cost.replace("_", " ")
        if sign:
            label = f"{label} [{sign}]"
        ax.set_ylabel(label)
        ax.set_ylim(0, 1.12 * ax.dataLim.ymax)
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1), labelspacing=0.5)
    _samples(axes[-1][0], sorted(counts))
    return drawing


def _draw_search(ax: Axes, name: str, search: SearchRounds, color: str) -> None:
    """Draw the rounds of one search."""
    scale = MM if search.unit == "m" else 1.0
    x = np.array([search_round.samples for search_round in search.rounds], float)
    tree = np.array([search_round.tree for search_round in search.rounds], float) / scale
    best = np.array([search_round.best for search_round in search.rounds], float) / scale
    # the cost is infinite as long as there is no path
    tree[~np.isfinite(tree)] = np.nan
    without_path = ~np.isfinite(best)
    best[without_path] = np.nan
    ax.plot(x, tree, ls=(0, (3, 2)), lw=0.9, marker="s", ms=4, mfc="none", color=color)
    ax.plot(x, best, drawstyle="steps-post", marker="o", ms=4, color=color)
    crosses = x[without_path]
    ax.plot(crosses, np.zeros(len(crosses)), "x", color=color, ms=6, clip_on=False, zorder=4)
    ax.plot(x[-1:], best[-1:], "o", ms=9, mfc="none", mec=color, mew=1.4, zorder=4, clip_on=False)
    last = search.rounds[-1]
    value = quantity(last.best, search.unit)
    samples = count(last.samples, "sample")
    ax.plot([], [], color=color, label=f"{name}\n{value} after {samples}")


def _samples(ax: Axes, counts: list[int]) -> None:
    """Make the x axis logarithmic, with ticks at the numbers of samples of the rounds."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    ax.set_xscale("log")
    low = max(min(counts), 1)
    high = max(*counts, 1)
    ax.set_xlim(low / 1.3, high * 1.3)
    ticks = [low]
    for number in counts:
        is_apart_from_highest = number == high or high > _MIN_TICK_RATIO * number
        if number > _MIN_TICK_RATIO * ticks[-1] and is_apart_from_highest:
            ticks.append(number)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.0f}"))
    ax.xaxis.set_minor_locator(NullLocator())
    text = "samples; squares: path in the search tree, dots: best path with shortcuts, ring: planned path, ×: no path"
    ax.set_xlabel(text, color=INK)
