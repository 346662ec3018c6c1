"""Draw the results of a console check: the requirements (clauses), and the tool's drift during a closed hand motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.ui.report.style import FIT, GRID, INK, PALETTE, UNFIT, styled, titled_figure
from twin.validation.console_result import Clause, ConsoleResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@styled()
def figure(contract: ConsoleResult) -> Figure:
    """Return a figure with two panels: clauses of each equation, and distance of the tool from its start position.

    Satisfied clauses are green, unsatisfied clauses red. The distance is drawn over a hand motion that returns to its
    start.
    """
    by_equation: dict[str, list[Clause]] = {}
    for clause in sorted(contract.clauses, key=lambda clause: clause.equation):
        by_equation.setdefault(clause.equation, []).append(clause)
    readings = []
    for name in by_equation:
        variant = contract.variants.get(name, "?")
        readings.append(f"{name}={variant}")
    drawing = titled_figure(f"{contract.console}: {', '.join(readings)}", 4.2)
    left_axes, right_axes = drawing.subplots(1, 2)
    drawing.subplots_adjust(left=0.08, right=0.97, top=0.84, bottom=0.13, wspace=0.28)
    _draw_clauses(left_axes, by_equation)
    _draw_drift(right_axes, contract.path)
    return drawing


def _draw_clauses(ax: Axes, by_equation: Mapping[str, Sequence[Clause]]) -> None:
    """Draw a row for each equation, with one bar of equal length for each of its clauses."""
    labels = []
    most = 0
    for row, (name, clauses) in enumerate(by_equation.items()):
        satisfied = 0
        for k, clause in enumerate(clauses):
            color = UNFIT
            if clause.holds:
                color = FIT
                satisfied += 1
            ax.barh(row, 0.86, left=k, height=0.6, color=color)
        ax.annotate(f"{satisfied} of {len(clauses)}", (len(clauses) + 0.1, row), va="center", color=INK)
        number = name.removeprefix("eq")
        labels.append(f"({number})")
        most = max(most, len(clauses))
    ax.set_yticks(range(len(labels)), labels)
    ax.set_xlim(0, 2.5 + most)  # with room for the counts
    ax.invert_yaxis()
    ax.set_xticks([])
    ax.grid(False)
    ax.set_title("clauses satisfied, by equation", loc="left")


def _draw_drift(ax: Axes, path: Array) -> None:
    """Draw the distance from the start of a path (k, 3) in m; the mark at its end is green if the path is closed."""
    distance = np.linalg.norm(path - path[0], axis=1) / MM
    drift = distance[-1]
    color = UNFIT
    if drift < 1e-9:
        color = FIT
    ax.plot(np.arange(len(distance)), distance, color=PALETTE[0], linewidth=0.8)
    ax.plot([len(distance) - 1], [drift], "o", color=color)
    ax.set_title(f"closed hand motion: drift of {drift:.2g} mm", loc="left")
    ax.set_xlabel("increments")
    ax.set_ylabel("tool position relative to its start [mm]")
    ax.grid(True, color=GRID)
