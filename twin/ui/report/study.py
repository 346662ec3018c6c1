"""Draw the measures of groups of users: box plot and values of each group, and the medians over the sessions."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array
from twin.ui.report.style import GRID, INK, PALETTE, sheet, styled
from twin.validation.ranks import Ranks, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW = 2.2
"""Height of a row in inches."""

_LETTERS = 124
"""Number of letters that fit on a line below a plot of full width."""


@styled()
def figure(found: Ranks) -> Figure:
    """Return a figure with a row for each measure: box plots of the groups; for several sessions, also group medians.

    The values themselves are drawn, too. A measure with the same value for all users has no row, but is named below the
    title.
    """
    users = found.users
    same = {name: x for name, x in ((n, np.unique(x)) for n, x in users.measures.items()) if len(x) == 1}
    names = [name for name in users.measures if name not in same] or list(users.measures)
    curve = users.sessions is not None and len(set(users.sessions)) > 1

    height = 0.75 + _ROW * len(names)
    out = sheet(f"{found.file}: groups", height)
    axes = out.subplots(len(names), 2 if curve else 1, squeeze=False)
    out.subplots_adjust(left=0.1, right=0.98, top=1 - 0.8 / height, bottom=0.45 / height, hspace=0.7, wspace=0.25)
    if same:
        equal = ", ".join(f"{label(name)} {x[0]:g}" for name, x in same.items())
        out.text(0.012, 1 - 0.46 / height, f"Equal for all {users.counted}: {equal}", fontsize=8, va="center")
    colors = {group: PALETTE[k % len(PALETTE)] for k, group in enumerate(dict.fromkeys(users.groups))}
    for row, name in zip(axes, names, strict=True):
        _boxes(row[0], users.samples(name), name, colors, _LETTERS // (2 if curve else 1))
        if curve:
            _course(row[1], found, name, colors)
    return out


def _boxes(ax: Axes, samples: dict[str, Array], name: str, colors: Mapping[str, str], letters: int) -> None:
    drawn = {n: x for n, x in samples.items() if len(x)}
    ax.boxplot(
        list(drawn.values()),
        widths=0.5,
        showfliers=False,
        medianprops={"color": INK, "lw": 1.4},
        boxprops={"color": INK},
    )
    for k, (sample, x) in enumerate(drawn.items()):
        aside = 0.12 * np.sin(2.4 * np.arange(len(x)))  # equal values lie beside each other
        color = colors[sample if sample in colors else sample.rpartition(", session ")[0]]
        ax.plot(k + 1 + aside, x, "o", ms=4, alpha=0.7, color=color)
    lines = [[*textwrap.wrap(n, max(letters // len(drawn), 6)), f"n = {len(x)}"] for n, x in drawn.items()]
    ax.set_xticks(range(1, len(drawn) + 1), ["\n".join(text) for text in lines], fontsize=7.5)
    ax.set_title(label(name), loc="left", fontsize=9)
    ax.grid(True, axis="y", color=GRID)
    ax.tick_params(length=2.5)


def _course(ax: Axes, found: Ranks, name: str, colors: Mapping[str, str]) -> None:
    users = found.users
    values, groups = np.array(users.measures[name], float), np.array(users.groups)
    numbers = np.array(users.sessions, float)
    for group, color in colors.items():
        mine = (groups == group) & np.isfinite(values)
        ax.plot(numbers[mine], values[mine], "o", ms=4, alpha=0.5, color=color)
        at = np.unique(numbers[mine])
        ax.plot(at, [np.median(values[mine & (numbers == n)]) for n in at], color=color, lw=1.2, label=group)
    ax.set_title("median over sessions", loc="left", fontsize=9)
    ax.set_xticks(np.unique(numbers))
    ax.set_xlabel("session")
    ax.legend(fontsize=7, frameon=False)
    ax.grid(True, color=GRID)
    ax.tick_params(length=2.5)
