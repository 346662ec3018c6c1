"""Draw the residual matrix: a row for each compared quantity, a column for each pair of models."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from twin.core.format import quantity
from twin.ui.report.style import FIT, INK, UNFIT, WIDTH, headline
from twin.validation.result import Report, Residual

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAIRS = {
    "A-B": ("formula against mechanism", "A–B"),
    "A": ("equations by other methods", "A"),
    "B": ("mechanism by itself", "B"),
    "B-C": ("mechanism against USD read back", "B–C"),
    "C": ("USD read back by itself", "C"),
    "B-D": ("mechanism against baked motion", "B–D"),
    "P-T": ("plan by two solvers", "P–T"),
}
"""(Long, short) title of each pair of models, in the order of display; pairs that are not listed come last."""

_MOST_ROWS = 48
_LONGEST = 28
_DECADES = 6.0
"""A green cell is darkest at this number of orders of magnitude below the tolerance, a red cell at half this number
above the tolerance."""


def pair_names(report: Report) -> list[str]:
    """Return the pairs of models in the report: first those in `PAIRS`, in this order, then all others, sorted."""
    found = {r.pair for r in report.residuals}
    return [p for p in PAIRS if p in found] + sorted(found - PAIRS.keys())


def label(row: Residual) -> str:
    """Return the compared quantity of a residual as text: "point s1", "tool rotation", "driven joint q3"."""
    angular = row.unit.startswith("rad")
    if row.quantity == "tool":
        where = "" if row.name == "tool" else f" {row.name}"
        return f"tool {'rotation' if angular else 'position'}{where}"
    if row.quantity in ("driven", "passive"):
        return f"{row.quantity} joint {row.name}"
    if row.quantity in ("speed", "acceleration", "baked"):
        what = {"speed": "speed", "acceleration": "acceleration", "baked": "baked"}[row.quantity]
        turning = " (rotation)" if angular and row.name == "tool" else ""
        return f"{what} {row.name}{turning}"
    if row.quantity == "loop":
        return f"loop gap {row.name}" + (" (rotation)" if angular else "")
    if row.quantity == "trocar":
        return row.name
    if row.quantity in ("duration", "limit"):
        return f"{row.quantity} of {row.name}"
    return "RCM error" if row.quantity == "rcm" and row.name in ("rcm", "tool", "") else (
        f"{'RCM' if row.quantity == 'rcm' else row.quantity} {row.name}"
    )  # fmt: skip


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
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    pairs = pair_names(report)
    table: dict[str, dict[str, Residual]] = {}
    for row in report.residuals:
        cells = table.setdefault(label(row), {})
        if row.pair not in cells or row.worst > cells[row.pair].worst:
            cells[row.pair] = row
    names = _most_telling(table)
    height, head, left = 0.21, 0.92, 2.0
    size = head + height * len(names) + 0.5
    figure = Figure(figsize=(WIDTH, size))
    ax = figure.add_axes((left / WIDTH, 0.42 / size, 1 - (left + 0.2) / WIDTH, height * len(names) / size))
    for y, name in enumerate(names):
        for x, pair in enumerate(pairs):
            row = table[name].get(pair)
            if row is None:
                continue
            over = decades(row)
            bad = not row.agrees
            color = "none" if over is None and not bad else UNFIT if bad else FIT
            strength = min(1.0, abs(over if over is not None else _DECADES) / _DECADES)
            alpha = 0.35 + 0.6 * min(1.0, strength * 2) if bad else 0.10 + 0.38 * strength
            ax.add_patch(Rectangle((x + 0.02, y + 0.05), 0.96, 0.9, fc=color, alpha=alpha, lw=0))
            dark = bad and alpha > 0.6
            ax.text(
                x + 0.5, y + 0.52, f"{'✗ ' if bad else ''}{quantity(row.worst, row.unit)}",
                ha="center", va="center", fontsize=8.5, fontweight="bold" if bad else "normal",
                color="white" if dark and sum(to_rgb(UNFIT)) < 2 else INK,
            )  # fmt: skip
    ax.set(xlim=(0, len(pairs)), ylim=(len(names), 0), yticks=[i + 0.5 for i in range(len(names))])
    ax.set_yticklabels([_short(name) for name in names], fontsize=8.5)
    size_of_headings = 8.5 if len(pairs) < 6 else 7.5
    ax.set_xticks([i + 0.5 for i in range(len(pairs))], [_heading(p) for p in pairs], fontsize=size_of_headings)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    ax.grid(visible=False)
    for spine in ax.spines.values():
        spine.set_visible(False)
    title = headline("Worst residuals", report)
    figure.text(0.12 / WIDTH, 1 - 0.24 / size, title, fontsize=11, fontweight="bold", va="center")
    dropped = len(table) - len(names)
    foot = "green: within tolerance (darker: further below it); red ✗: beyond tolerance; no colour: no tolerance"
    foot += f"; not shown: the {dropped} rows furthest below their tolerance" if dropped else ""
    figure.text(left / WIDTH, 0.2 / size, foot, fontsize=8, va="center")
    return figure


def _most_telling(table: dict[str, dict[str, Residual]]) -> list[str]:
    """Return the names of at most `_MOST_ROWS` rows in unchanged order; omit the rows furthest below the tolerance."""
    if len(table) <= _MOST_ROWS:
        return list(table)

    def worst(name: str) -> float:
        known = [d for row in table[name].values() if (d := decades(row)) is not None]
        return max(known, default=-math.inf)

    kept = set(sorted(table, key=worst, reverse=True)[:_MOST_ROWS])
    return [name for name in table if name in kept]


def _heading(pair: str) -> str:
    """Return the heading of a pair: short and long title on separate lines."""
    words, short = PAIRS.get(pair, ("", pair))
    for break_at in (" against ", " by "):
        words = words.replace(break_at, f"\n{break_at[1:]}")
    return f"{short}\n{words}"


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
