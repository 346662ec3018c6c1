"""Draw results of computed-torque control: tip error and efforts over time; tip error as a function of mismatch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import quantity
from twin.core.spatial import Array
from twin.core.units import UM
from twin.simulation.dynamics.computed_torque import TIP_LIMIT, Run
from twin.simulation.dynamics.tracking_result import Tracking
from twin.ui.report.plot_data import thinned_curve
from twin.ui.report.style import INK, PALETTE, WIDTH, legend_beside, limit_line, phase_bands, styled, titled_figure
from twin.validation.result import PhaseSummary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MEAN_TICKS = 25
"""Length in ticks of the window for the running mean of the effort."""

_NEAR_LIMIT = 60.0
"""Effort in % of its limit above which the limits are drawn: with smaller efforts, they would compress the curves."""

_NEAR_TIP_LIMIT = 0.4
"""Tip error as a part of the paper's, above which the paper's is drawn."""

_PANELS = ((0.74, 2.3), (0.18, 1.9), (0.78, 1.9))
"""(space above, height) in inches of the panels: tip errors, efforts, tip error over mismatch."""

_FOOT = 0.5
_LEFT = 0.86
_LEGENDS = 1.75
"""Spaces in inches below the last panel, at the left of all panels, and at their right, where the legends are."""

_LABEL_DISTANCE = 0.66
"""Distance in inches of the labels of y axes from the axes."""


@styled()
def figure(result: Tracking) -> Figure:
    """Return a figure with three panels: tip errors of all runs, efforts in the worst one, tip error over mismatch.

    The mismatch is the error in % of all masses and inertias in the controller's model. The third panel is omitted if
    there are no runs at several mismatches.
    """
    worst = result.runs[result.worst]
    w = worst.conditions.w
    title = f"{result.robot}, {result.protocol}: computed torque control, Kp = w², Kv = 2 w, w = {w:g} rad/s"

    panels = _PANELS if result.curves else _PANELS[:2]
    total = 0.0
    for above, tall in panels:
        total += above + tall
    total += _FOOT
    drawing = titled_figure(title, total)
    wide = WIDTH - _LEFT - _LEGENDS
    axes = []
    bottom = 0.0
    for above, tall in panels:
        bottom += above + tall
        axes.append(drawing.add_axes((_LEFT / WIDTH, 1 - bottom / total, wide / WIDTH, tall / total)))
    _draw_errors(axes[0], result.runs)
    _draw_efforts(axes[1], result, worst)
    for ax in axes[:2]:
        ax.set_xlim(worst.t[0], worst.t[-1])
    phases = tuple(PhaseSummary(*phase) for phase in result.phases)
    phase_bands([[axes[0]], [axes[1]]], phases)
    axes[0].tick_params(labelbottom=False)
    axes[1].set_xlabel("time [s]")
    if result.curves:
        _draw_mismatch(axes[2], result.curves)
    for ax in axes:
        ax.tick_params(length=2.5)
        ax.yaxis.set_label_coords(-_LABEL_DISTANCE / wide, 0.5)
    return drawing


def _draw_errors(ax: Axes, runs: Mapping[str, Run]) -> None:
    """Draw the tip error of each run over time."""
    for (name, run), color in zip(runs.items(), cycle((INK, *PALETTE)), strict=False):
        t, error = thinned_curve(run.t, run.tip_error / UM)
        largest = quantity(run.tip_max, "m", 3)
        ax.plot(t, error, color=color, lw=1.1, label=f"{name}\nlargest {largest}")
    _set_error_axis(ax, max(run.tip_max for run in runs.values()))
    ax.set_ylabel("tip error [µm]")
    legend_beside(ax)


def _draw_efforts(ax: Axes, result: Tracking, run: Run) -> None:
    """Draw the running mean of the efforts and, in pale colours, the efforts at every tick, with encoder noise.

    The efforts are in percent of the motor's limit or, without one, of its peak in all runs.
    """
    largest_of_limit = 0.0
    references = set()
    for i, row in enumerate(result.efforts):
        full_scale = row.limit or row.peak or 1.0
        reference = "limit" if row.limit else "peak"
        references.add(reference)
        percent = 100 * run.effort[:, i] / full_scale
        color = PALETTE[i % len(PALETTE)]
        t, y = thinned_curve(run.t, percent)
        ax.plot(t, y, color=color, lw=0.5, alpha=0.3)
        t, y = thinned_curve(run.t, _running_mean(percent))
        ax.plot(t, y, color=color, lw=1.1, label=f"{row.joint}, {reference} {full_scale:g} {row.unit}")
        if row.limit:
            largest_of_limit = max(largest_of_limit, np.abs(percent).max())
    if largest_of_limit > _NEAR_LIMIT:
        for side in (-100, 100):
            limit_line(ax, side, "limit")
    ax.axhline(0, color=INK, lw=0.5, alpha=0.4)
    ax.annotate(f"{result.worst}; pale: value of every tick", (0.006, 0.03), xycoords="axes fraction", fontsize=8.5)
    ax.margins(y=0.12)
    ax.set_ylabel(f"effort, % of {' or '.join(sorted(references))}")
    legend_beside(ax)


def _draw_mismatch(ax: Axes, curves: Mapping[str, Sequence[Run]]) -> None:
    """Draw the largest and the RMS tip error of each series of runs over the error of the model."""
    worst = 0.0
    for (name, runs), color in zip(curves.items(), cycle(PALETTE), strict=False):
        mismatch = np.zeros(len(runs))
        largest = np.zeros(len(runs))
        rms = np.zeros(len(runs))
        for i, run in enumerate(runs):
            mismatch[i] = 100 * run.conditions.inertia_error
            largest[i] = run.tip_max
            rms[i] = run.tip_rms
        label = fill(f"{name}: largest", 22)
        ax.plot(mismatch, largest / UM, "o-", ms=3.5, color=color, label=label)
        ax.plot(mismatch, rms / UM, "o--", ms=3.5, mfc="none", color=color, lw=0.9, label="RMS")
        worst = max(worst, largest.max())
    _set_error_axis(ax, worst)
    ax.set_xlabel("error of all masses and tensors in the controller's model [%]")
    ax.set_ylabel("tip error [µm]")
    legend_beside(ax)


def _set_error_axis(ax: Axes, largest: float) -> None:
    """Set the y axis from 0 to above `largest` (m); if this is near the paper's 1 mm, at least to above 1 mm."""
    top = max(largest, 1e-9)
    if largest > _NEAR_TIP_LIMIT * TIP_LIMIT:
        limit_line(ax, TIP_LIMIT / UM, "1 mm, as the paper reports")
        top = max(largest, TIP_LIMIT)
    ax.set_ylim(0, 1.16 * top / UM)


def _running_mean(y: Array) -> Array:
    """Return the running mean (k,) over `_MEAN_TICKS` samples."""
    half = min(_MEAN_TICKS // 2, (len(y) - 1) // 2)
    padded = np.pad(y, half, mode="edge")
    width = 2 * half + 1
    return np.convolve(padded, np.full(width, 1 / width), mode="valid")
