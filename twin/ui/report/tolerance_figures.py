"""Draw a tolerance budget: tool error at each state, required value, and largest contributions at the worst state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.analysis.tolerance import ToleranceBudget
from twin.core.json_types import JsonObject
from twin.core.units import UM
from twin.ui.report.style import FIT, INK, PALETTE, UNFIT, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_BARS = 14
"""Maximum number of contributions that have their own bar; a further bar is the sum of all other contributions."""


@styled()
def figure(budget: ToleranceBudget) -> Figure:
    """Return a figure with two panels: tool error at each state, and contributions to the error at the worst state.

    The error is the 95th percentile of the position error; a line shows the required value, if there is one.
    """
    states = budget.content()["states"]
    worst = max(states, key=lambda state: state["within_position"])
    contributions = _largest(worst["contributors"])
    # in inches
    states_height = 0.3 * len(states)
    contributions_height = 0.27 * len(contributions)
    height = 1.7 + states_height + contributions_height
    drawing = titled_figure(f"{budget.robot}: tool error caused by part and encoder errors", height)
    top, bottom = drawing.subplots(2, 1, gridspec_kw={"height_ratios": [states_height + 0.2, contributions_height]})
    drawing.subplots_adjust(left=0.19, right=0.96, top=1 - 0.65 / height, bottom=0.5 / height, hspace=0.9 / height * 2)
    _draw_states(top, states, budget.required)
    _draw_contributions(bottom, contributions)
    bottom.set_xlabel(f"share of the variance in state '{worst['state']}' [%]")
    return drawing


def _largest(contributors: list[JsonObject]) -> list[JsonObject]:
    """Return the first `_MAX_BARS` contributions, which are the largest, and one for the sum of all others."""
    others = contributors[_MAX_BARS:]
    if not others:
        return contributors
    position = 0
    rotation = 0
    for component in others:
        position += component["position"]
        rotation += component["rotation"]
    others_row = {"what": f"{len(others)} others", "position": position, "rotation": rotation}
    return [*contributors[:_MAX_BARS], others_row]


def _draw_states(ax: Axes, states: list[JsonObject], required: float | None) -> None:
    """Draw the position error of each state in µm; `required` is the required value in m."""
    names = []
    values = np.zeros(len(states))
    for i, state in enumerate(states):
        names.append(state["state"])
        values[i] = state["within_position"] / UM
    end = values.max()
    color = PALETTE[0]
    if required is not None:
        color = FIT
    bars = ax.barh(names, values, color=color, height=0.6)
    # a space at the begin of a text in an SVG is kept only if it is a no-break space
    for y, value in enumerate(values):
        ax.text(value, y, f"\u00a0{value:.4g} µm", va="center", color=INK, fontsize=8.5)
    if required is not None:
        limit = required / UM
        end = max(end, limit)
        for bar, value in zip(bars, values, strict=True):
            if value > limit:
                bar.set_facecolor(UNFIT)
        ax.axvline(limit, color=INK, linewidth=0.9, linestyle="--")
        ax.text(limit, -0.62, f"\u00a0required {limit:g} µm", fontsize=8.5, color=INK, va="bottom")
    ax.invert_yaxis()
    ax.set_xlim(0, 1.18 * end)
    ax.set_xlabel("95th-percentile position error [µm]")
    ax.grid(visible=False, axis="y")


def _draw_contributions(ax: Axes, contributions: list[JsonObject]) -> None:
    """Draw two bars for each contribution: its shares of the variances of position and rotation in %."""
    y = np.arange(len(contributions))
    names = []
    position = []
    rotation = []
    for row in contributions:
        names.append(row["what"])
        position.append(100 * row["position"])
        rotation.append(100 * row["rotation"])
    ax.barh(y - 0.19, position, height=0.36, color=PALETTE[0], label="position")
    ax.barh(y + 0.19, rotation, height=0.36, color=PALETTE[4], label="rotation")
    ax.set_yticks(y, names)
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    ax.legend(loc="center right")
