"""Draw the residual matrix: a row for each compared quantity, a column for each pair of models."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import deviation
from twin.ui.report.style import FIT, INK, UNFIT, WIDTH, headline
from twin.validation.result import Report, Residual

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAIR_TITLES = {
    "A-B": ("formula against mechanism", "A–B"),
    "A": ("equations by other methods", "A"),
    "B": ("mechanism by itself", "B"),
    "B-C": ("mechanism against USD read back", "B–C"),
    "C": ("USD read back by itself", "C"),
    "B-D": ("mechanism against baked motion", "B–D"),
    "P-T": ("plan by two solvers", "P–T"),
}
"""(Long, short) title of each pair of models, in the order of display; pairs that are not listed come last."""

_MAX_ROWS = 48

_MAX_NAME_LENGTH = 28
"""Maximum number of letters of a row's name."""

_DARKEST_DECADES = 6.0
"""A green cell is darkest at this number of orders of magnitude below the tolerance, a red cell at half this number
above the tolerance."""


def pair_names(report: Report) -> list[str]:
    """Return the pairs of models in the report: first those in `PAIR_TITLES`, in this order, then others, sorted."""
    pairs = {residual.pair for residual in report.residuals}
    names = []
    for pair in PAIR_TITLES:
        if pair in pairs:
            names.append(pair)
    return names + sorted(pairs - PAIR_TITLES.keys())


def label(row: Residual) -> str:
    """Return the compared quantity of a residual as text: "point s1", "tool rotation", "driven joint q3"."""
    angular = row.unit.startswith("rad")
    if row.quantity == "tool":
        text = "tool position"
        if angular:
            text = "tool rotation"
        if row.name == "tool":
            return text
        return f"{text} {row.name}"
    if row.quantity in ("driven", "passive"):
        return f"{row.quantity} joint {row.name}"
    if row.quantity in ("speed", "acceleration", "baked"):
        text = f"{row.quantity} {row.name}"
        if angular and row.name == "tool":
            return f"{text} (rotation)"
        return text
    if row.quantity == "loop":
        text = f"loop gap {row.name}"
        if angular:
            return f"{text} (rotation)"
        return text
    if row.quantity == "trocar":
        return row.name
    if row.quantity in ("duration", "limit"):
        return f"{row.quantity} of {row.name}"
    if row.quantity == "rcm":
        if row.name in ("rcm", "tool", ""):
            return "RCM error"
        return f"RCM {row.name}"
    return f"{row.quantity} {row.name}"


def decades(row: Residual) -> float | None:
    """Return log10(worst value / tolerance) of a residual; None if it has no tolerance or its value is not finite."""
    if not row.tolerance or not math.isfinite(row.worst):
        return None
    return math.log10(max(row.worst / row.tolerance, 1e-300))


def residual_matrix(report: Report) -> Figure | None:
    """Draw the residual matrix; None if the report has fewer than two residuals.

    A cell is green if the residual is within its tolerance, else red; the further it is from the tolerance, the darker
    the cell.
    """
    if len(report.residuals) < 2:
        return None
    from matplotlib.figure import Figure

    pairs = pair_names(report)
    table = _worst_of_cells(report.residuals)
    names = _drawn_rows(table)
    # in inches
    row_height = 0.21
    head = 0.92
    foot = 0.5
    left_margin = 2.0
    right = 0.2
    total_height = head + row_height * len(names) + foot
    figure = Figure(figsize=(WIDTH, total_height))
    wide = 1 - (left_margin + right) / WIDTH
    tall = row_height * len(names) / total_height
    bottom = 0.42  # the legend is below; the rest of `foot` is free above the rows
    ax = figure.add_axes((left_margin / WIDTH, bottom / total_height, wide, tall))
    for y, name in enumerate(names):
        for x, pair in enumerate(pairs):
            row = table[name].get(pair)
            if row is not None:
                _draw_cell(ax, x, y, row)
    rows = np.arange(len(names)) + 0.5
    columns = np.arange(len(pairs)) + 0.5
    ax.set(xlim=(0, len(pairs)), ylim=(len(names), 0), yticks=rows)
    ax.set_yticklabels(list(map(_shortened, names)), fontsize=8.5)
    heading_size = 8.5 if len(pairs) < 6 else 7.5
    ax.set_xticks(columns, list(map(_heading, pairs)), fontsize=heading_size)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    ax.grid(visible=False)
    for spine in ax.spines.values():
        spine.set_visible(False)
    title = headline("Worst residuals", report)
    figure.text(0.12 / WIDTH, 1 - 0.24 / total_height, title, fontsize=11, fontweight="bold", va="center")
    legend = "green: within tolerance (darker: further below it); red ✗: beyond tolerance; no colour: no tolerance"
    dropped = len(table) - len(names)
    if dropped:
        legend += f"\nnot shown: the {dropped} rows furthest below their tolerance"
    figure.text(0.12 / WIDTH, 0.2 / total_height, legend, fontsize=8, va="center", linespacing=1.15)
    return figure


def _worst_of_cells(residuals: Iterable[Residual]) -> dict[str, dict[str, Residual]]:
    """Return the largest residual of each cell, by name of the row, then by pair of models; NaN is larger than any."""

    def size(residual: Residual) -> float:
        return math.inf if math.isnan(residual.worst) else residual.worst

    table: dict[str, dict[str, Residual]] = {}
    for residual in residuals:
        cells = table.setdefault(label(residual), {})
        cell = cells.get(residual.pair)
        if cell is None or size(residual) > size(cell):
            cells[residual.pair] = residual
    return table


def _draw_cell(ax: Axes, x: int, y: int, row: Residual) -> None:
    """Draw a residual as a coloured cell of column x and row y, with its value."""
    from matplotlib.patches import Rectangle

    over = decades(row)
    strength = 1.0
    if over is not None:
        strength = min(1.0, abs(over) / _DARKEST_DECADES)
    text = deviation(row.worst, row.unit, row.tolerance)
    ink = INK
    weight = "normal"
    if not row.agrees:
        color = UNFIT
        alpha = 0.35 + 0.6 * min(1.0, 2 * strength)
        text = f"✗ {text}"
        weight = "bold"
        if alpha > 0.6:
            ink = "white"
    else:
        color = "none" if over is None else FIT
        alpha = 0.10 + 0.38 * strength
    ax.add_patch(Rectangle((x + 0.02, y + 0.05), 0.96, 0.9, fc=color, alpha=alpha, lw=0))
    ax.text(x + 0.5, y + 0.52, text, ha="center", va="center", fontsize=8.5, fontweight=weight, color=ink)


def _drawn_rows(table: dict[str, dict[str, Residual]]) -> list[str]:
    """Return the names of at most `_MAX_ROWS` rows in unchanged order; omit the rows furthest below the tolerance."""
    if len(table) <= _MAX_ROWS:
        return list(table)

    def worst(name: str) -> float:
        """Return the largest ratio of a row's residuals to their tolerances, in decades."""
        largest = -math.inf
        for row in table[name].values():
            over = decades(row)
            if over is not None:
                largest = max(largest, over)
            elif not row.agrees:  # a value that is not finite, or a tolerance of 0
                largest = math.inf
        return largest

    by_ratio = sorted(table, key=worst, reverse=True)
    dropped = set(by_ratio[_MAX_ROWS:])
    names = []
    for name in table:
        if name not in dropped:
            names.append(name)
    return names


def _heading(pair: str) -> str:
    """Return the heading of a pair: short and long title on separate lines."""
    words, short = PAIR_TITLES.get(pair, ("", pair))
    for break_at in (" against ", " by "):
        words = words.replace(break_at, f"\n{break_at[1:]}")
    return f"{short}\n{words}"


def _shortened(text: str) -> str:
    if len(text) <= _MAX_NAME_LENGTH:
        return text
    return f"{text[: _MAX_NAME_LENGTH - 1]}…"
