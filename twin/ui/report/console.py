"""Draw the results of a console check: the requirements (clauses), and the tool's drift during a closed hand motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.core.units import MM
from twin.ui.report.style import FIT, GRID, INK, PALETTE, UNFIT, sheet, styled
from twin.validation.clauses import Contract

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled()
def figure(found: Contract) -> Figure:
    """Return a figure with two panels: clauses of each equation, and distance of the tool from its start position.

    Satisfied clauses are green, unsatisfied clauses red. The distance is drawn over a hand motion that returns to its
    start.
    """
    names = sorted({c.equation for c in found.clauses})
    readings = ", ".join(f"{n}={found.variants.get(n, '?')}" for n in names)
    out = sheet(f"{found.console}: {readings}", 4.2)
    left, right = out.subplots(1, 2)
    out.subplots_adjust(left=0.08, right=0.97, top=0.84, bottom=0.13, wspace=0.28)
    for row, name in enumerate(names):
        mine = [c for c in found.clauses if c.equation == name]
        for k, c in enumerate(mine):
            left.barh(row, 0.86, left=k, height=0.6, color=FIT if c.holds else UNFIT)
        kept = sum(c.holds for c in mine)
        left.annotate(f"{kept} of {len(mine)}", (len(mine) + 0.1, row), va="center", color=INK)
    left.set_yticks(range(len(names)), [f"({n.removeprefix('eq')})" for n in names])
    left.set_xlim(0, 2.5 + max(sum(c.equation == n for c in found.clauses) for n in names))
    left.invert_yaxis()
    left.set_xticks([])
    left.grid(False)
    left.set_title("clauses satisfied, by equation", loc="left")
    away = np.linalg.norm(found.path - found.path[0], axis=1) / MM
    right.plot(np.arange(len(away)), away, color=PALETTE[0], linewidth=0.8)
    right.plot([len(away) - 1], away[-1:], "o", color=FIT if away[-1] < 1e-9 else UNFIT)
    right.set_title(f"closed hand motion: drift of {away[-1]:.2g} mm", loc="left")
    right.set_xlabel("increments")
    right.set_ylabel("tool position relative to its start [mm]")
    right.grid(True, color=GRID)
    return out
