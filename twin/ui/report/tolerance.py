"""Draw a tolerance budget: tool error at each state, required value, and largest contributions at the worst state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.analysis.tolerance import ToleranceBudget
from twin.core.units import UM
from twin.ui.report.style import FIT, INK, PALETTE, UNFIT, sheet, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 14
"""Maximum number of contributions that have their own bar; a further bar is the sum of all other contributions."""


@styled()
def figure(found: ToleranceBudget) -> Figure:
    """Return a figure with two panels: tool error at each state, and contributions to the error at the worst state.

    The error is the 95th percentile of the position error; a line shows the required value, if there is one.
    """
    robot, budgets, required = found.robot, found.content()["states"], found.required
    worst = max(budgets, key=lambda b: b["within_position"])

    rows = worst["contributors"][:_SHOWN]
    rest = worst["contributors"][_SHOWN:]
    if rest:
        both = {k: sum(r[k] for r in rest) for k in ("position", "rotation")}
        rows = [*rows, {"what": f"{len(rest)} others", **both}]
    height = 1.7 + 0.3 * len(budgets) + 0.27 * len(rows)
    out = sheet(f"{robot}: tool error caused by part and encoder errors", height)
    top, bottom = out.subplots(2, 1, gridspec_kw={"height_ratios": [0.3 * len(budgets) + 0.2, 0.27 * len(rows)]})
    out.subplots_adjust(left=0.19, right=0.96, top=1 - 0.65 / height, bottom=0.5 / height, hspace=0.9 / height * 2)
    names = [b["state"] for b in budgets]
    values = np.array([b["within_position"] for b in budgets]) / UM
    colors = [FIT if required is None or v <= required / UM else UNFIT for v in values]
    top.barh(names, values, color=colors, height=0.6)
    for y, v in enumerate(values):
        top.text(v, y, f" {v:.4g} µm", va="center", color=INK, fontsize=8.5)
    if required is not None:
        top.axvline(required / UM, color=INK, linewidth=0.9, linestyle="--")
        top.text(required / UM, -0.62, f" required {required / UM:g} µm", fontsize=8.5, color=INK, va="bottom")
    top.invert_yaxis()
    top.set_xlim(0, 1.18 * max(values.max(), (required or 0) / UM))
    top.set_xlabel("95th-percentile position error [µm]")
    top.grid(visible=False, axis="y")
    at = np.arange(len(rows))
    bottom.barh(at - 0.19, [100 * r["position"] for r in rows], height=0.36, color=PALETTE[0], label="position")
    bottom.barh(at + 0.19, [100 * r["rotation"] for r in rows], height=0.36, color=PALETTE[4], label="rotation")
    bottom.set_yticks(at, [r["what"] for r in rows])
    bottom.invert_yaxis()
    bottom.set_xlabel(f"share of the variance in state '{worst['state']}' [%]")
    bottom.grid(visible=False, axis="y")
    bottom.legend(loc="center right")
    return out
