"""Draw the trials of the simulated operator: distance to the goal, and pedal state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.core.units import MM
from twin.simulation.operated import Operated
from twin.simulation.trial import remaining
from twin.ui.report.style import BAND, INK, PALETTE, UNFIT, log_ticks, sheet, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEAST = 1e-4
"""Smallest drawn distance in mm; smaller distances are drawn at this value."""

_TICKS = {1e-4: "0.1 µm", 1e-3: "1 µm", 1e-2: "10 µm", 0.1: "0.1 mm", 1.0: "1 mm", 10.0: "10 mm", 100.0: "100 mm"}

_SHOWN = 4
"""Maximum number of drawn trials; further trials are only in the table and the files."""


@styled()
def figure(found: Operated) -> Figure:
    """Return a figure with a panel for each of the first `_SHOWN` trials: distance to the goal over time.

    Insertions are shaded; if an insertion misses its goal, its name is red. A bar shows when the pedal is up.
    """
    shown = found.trials[:_SHOWN]
    height = 1.0 + 2.2 * len(shown)
    title = f"{found.robot}, {found.protocol}: remaining distance of the simulated operator (hand and tremor ASSUMED)"
    out = sheet(title, height)
    axes = out.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    out.subplots_adjust(left=0.09, right=0.86, top=1 - 0.62 / height, bottom=0.5 / height, hspace=0.28)
    for ax, trial in zip(axes, shown, strict=True):
        record, measures, t = trial.record, trial.measures, trial.record.t
        for goal in found.goals:
            if goal.inserts and goal.name in record.spans:
                first, last = record.spans[goal.name]
                ax.axvspan(t[first], t[last], color=BAND, linewidth=0, zorder=0)
                touched = measures.contacts[goal.name]
                x, ink = (t[first] + t[last]) / 2, INK if touched else UNFIT
                text = goal.name if touched else f"{goal.name}: missed"
                ax.annotate(text, (x, 1.02), xycoords=ax.get_xaxis_transform(), color=ink, ha="center", fontsize=8)
        left = np.maximum(remaining(record, found.goals) / MM, _LEAST)
        ax.plot(t, left, color=PALETTE[0], linewidth=1.0)
        log_ticks(ax, list(_TICKS), lambda v: _TICKS[min(_TICKS, key=lambda k: abs(k - v))])
        up = ~record.pedal
        ax.fill_between(t, 0, 0.05, where=up, transform=ax.get_xaxis_transform(), color=PALETTE[1], linewidth=0)
        ax.set_ylim(_LEAST / 3, max(3 * np.nanmax(left), 1.0))
        ax.set_ylabel("distance to goal")
        ax.set_xlim(t[0], t[-1])
        ax.annotate(
            f"seed {trial.seed}\n{measures.time:.1f} s\n{measures.presses} presses\n{measures.path / MM:.1f} mm",
            (1.012, 0.98),
            xycoords="axes fraction",
            va="top",
        )
        ax.annotate("pedal up", (1.012, 0.0), xycoords="axes fraction", color=PALETTE[1], fontsize=8)
    axes[-1].set_xlabel("time [s]")
    return out
