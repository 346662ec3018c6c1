"""Draw the trials of the simulated operator: distance to the goal, and pedal state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.core.units import MM
from twin.simulation.devices.hand import Goal
from twin.simulation.operator_trials import Operated, Trial
from twin.simulation.trial import remaining
from twin.ui.report.style import BAND, INK, PALETTE, UNFIT, log_ticks, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MIN_DISTANCE = 1e-4
"""Smallest drawn distance in mm; smaller distances are drawn at this value."""

_DISTANCE_TICKS = {
    1e-4: "0.1 µm",
    1e-3: "1 µm",
    1e-2: "10 µm",
    0.1: "0.1 mm",
    1.0: "1 mm",
    10.0: "10 mm",
    100.0: "100 mm",
}
"""Tick labels of the distance axis, by distance in mm."""

_MAX_TRIALS = 4
"""Maximum number of drawn trials; further trials are only in the table and the files."""


@styled()
def figure(operated: Operated) -> Figure:
    """Return a figure with a panel for each of the first `_MAX_TRIALS` trials: distance to the goal over time.

    Insertions are shaded; if an insertion misses its goal, its name is red. A bar shows when the pedal is up.
    """
    shown_trials = operated.trials[:_MAX_TRIALS]
    height = 1.0 + 2.2 * len(shown_trials)
    title = f"{operated.robot}, {operated.protocol}: "
    title += "remaining distance of the simulated operator (hand and tremor ASSUMED)"
    drawing = titled_figure(title, height)
    axes = drawing.subplots(len(shown_trials), 1, squeeze=False, sharex=True)[:, 0]
    drawing.subplots_adjust(left=0.09, right=0.86, top=1 - 0.62 / height, bottom=0.5 / height, hspace=0.28)
    for ax, trial in zip(axes, shown_trials, strict=True):
        _draw_insertions(ax, trial, operated.goals)
        t = trial.record.t
        # the axis is logarithmic: 0 would not be drawn
        distance = np.maximum(remaining(trial.record, operated.goals) / MM, _MIN_DISTANCE)
        ax.plot(t, distance, color=PALETTE[0], linewidth=1.0)
        log_ticks(ax, list(_DISTANCE_TICKS), _distance_label)
        pedal_up = ~trial.record.pedal
        band = ax.get_xaxis_transform()  # heights as fractions of the axes
        ax.fill_between(t, 0, 0.05, where=pedal_up, transform=band, color=PALETTE[1], linewidth=0)
        ax.set_ylim(_MIN_DISTANCE / 3, max(3 * np.nanmax(distance), 1.0))
        ax.set_ylabel("distance to goal")
        ax.set_xlim(t[0], t[-1])
        measures = trial.measures
        ax.annotate(
            f"seed {trial.seed}\n{measures.time:.1f} s\n{measures.presses} presses\n{measures.path / MM:.1f} mm",
            (1.012, 0.98),
            xycoords="axes fraction",
            va="top",
        )
        ax.annotate("pedal up", (1.012, 0.0), xycoords="axes fraction", color=PALETTE[1], fontsize=8)
    axes[-1].set_xlabel("time [s]")
    return drawing


def _draw_insertions(ax: Axes, trial: Trial, goals: Sequence[Goal]) -> None:
    """Shade the insertions of a trial, with the names of their goals above."""
    record = trial.record
    for goal in goals:
        if not goal.inserts or goal.name not in record.spans:
            continue
        first, last = record.spans[goal.name]
        start = record.t[first]
        end = record.t[last]
        ax.axvspan(start, end, color=BAND, linewidth=0, zorder=0)
        text = goal.name
        color = INK
        if not trial.measures.contacts[goal.name]:
            text = f"{goal.name}: missed"
            color = UNFIT
        place = ((start + end) / 2, 1.02)
        ax.annotate(text, place, xycoords=ax.get_xaxis_transform(), color=color, ha="center", fontsize=8)


def _distance_label(value: float) -> str:
    # a power of ten that matplotlib returns can differ from the key by rounding
    nearest = min(_DISTANCE_TICKS, key=lambda tick: abs(tick - value))
    return _DISTANCE_TICKS[nearest]
