"""Draw the measures of groups of users: box plot and values of each group, and the medians over the sessions."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array
from twin.ui.report.style import GRID, INK, PALETTE, styled, titled_figure
from twin.validation.rank_tests import Ranks, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW_HEIGHT = 2.2
"""Height of a row in inches."""

_LETTERS_PER_LINE = 124
"""Number of letters that fit on a line below a plot of full width."""


@styled()
def figure(ranks: Ranks) -> Figure:
    """Return a figure with a row for each measure: box plots of the groups; for several sessions, also group medians.

    The values themselves are drawn, too. A measure with the same value for all users has no row, but is named below the
    title.
    """
    users = ranks.users
    constants = []
    names = []
    for name, values in users.measures.items():
        different = np.unique(values)
        if len(different) == 1:
            constants.append(f"{label(name)} {different[0]:g}")
        else:
            names.append(name)
    if not names:
        names = list(users.measures)
    columns = 1
    if users.sessions is not None and len(set(users.sessions)) > 1:
        columns = 2

    height = 0.75 + _ROW_HEIGHT * len(names)
    drawing = titled_figure(f"{ranks.file}: groups", height)
    axes = drawing.subplots(len(names), columns, squeeze=False)
    drawing.subplots_adjust(left=0.1, right=0.98, top=1 - 0.8 / height, bottom=0.45 / height, hspace=0.7, wspace=0.25)
    if constants:
        text = f"Equal for all {users.counted}: {', '.join(constants)}"
        drawing.text(0.012, 1 - 0.46 / height, text, fontsize=8, va="center")
    colors = {}
    for group in users.groups:
        if group not in colors:
            colors[group] = PALETTE[len(colors) % len(PALETTE)]
    for row, name in zip(axes, names, strict=True):
        _draw_boxes(row[0], users.samples(name), name, colors, _LETTERS_PER_LINE // columns)
        if columns == 2:
            _draw_course(row[1], ranks, name, colors)
    return drawing


def _draw_boxes(ax: Axes, samples: dict[str, Array], name: str, colors: Mapping[str, str], letters: int) -> None:
    """Draw a box plot and the values of each sample; up to `letters` letters fit on a line below the axes."""
    scatter_names = {}
    for sample, values in samples.items():
        if len(values):
            scatter_names[sample] = values
    ax.boxplot(
        list(scatter_names.values()),
        widths=0.5,
        showfliers=False,
        medianprops={"color": INK, "lw": 1.4},
        boxprops={"color": INK},
    )
    places = range(1, len(scatter_names) + 1)
    labels = []
    for place, (sample, values) in zip(places, scatter_names.items(), strict=True):
        group = sample
        if sample not in colors:
            # a sample of one of several sessions
            group, _, _ = sample.rpartition(", session ")
        x = place + 0.12 * np.sin(2.4 * np.arange(len(values)))  # equal values lie beside each other
        ax.plot(x, values, "o", ms=4, alpha=0.7, color=colors[group])
        lines = textwrap.wrap(sample, max(letters // len(scatter_names), 6))
        lines.append(f"n = {len(values)}")
        labels.append("\n".join(lines))
    ax.set_xticks(places, labels, fontsize=7.5)
    ax.set_title(label(name), loc="left", fontsize=9)
    ax.grid(True, axis="y", color=GRID)
    ax.tick_params(length=2.5)


def _draw_course(ax: Axes, ranks: Ranks, name: str, colors: Mapping[str, str]) -> None:
    """Draw the values of a measure over the number of the session, and the median of each group."""
    users = ranks.users
    values = np.array(users.measures[name], float)
    groups = np.array(users.groups)
    sessions = np.array(users.sessions, float)
    for group, color in colors.items():
        has_value = (groups == group) & np.isfinite(values)
        ax.plot(sessions[has_value], values[has_value], "o", ms=4, alpha=0.5, color=color)
        numbers = np.unique(sessions[has_value])
        medians = []
        for number in numbers:
            in_session = has_value & (sessions == number)
            medians.append(np.median(values[in_session]))
        ax.plot(numbers, medians, color=color, lw=1.2, label=group)
    ax.set_title("median over sessions", loc="left", fontsize=9)
    ax.set_xticks(np.unique(sessions))
    ax.set_xlabel("session")
    ax.legend(fontsize=7, frameon=False)
    ax.grid(True, color=GRID)
    ax.tick_params(length=2.5)
