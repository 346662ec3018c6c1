"""Draw results of computed-torque control: tip error and efforts over time; tip error as a function of mismatch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import quantity
from twin.core.spatial import Array
from twin.core.units import UM
from twin.simulation.dynamics.result import Tracking
from twin.simulation.dynamics.track import TIP_LIMIT, Run
from twin.ui.report.curves import thin
from twin.ui.report.style import INK, PALETTE, WIDTH, legend_beside, limit_line, phase_bands, sheet, styled
from twin.validation.result import PhaseSummary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TICKS = 25
"""Length in ticks of the window for the running mean of the effort."""


@styled()
def figure(result: Tracking) -> Figure:
    """Return a figure with three panels: tip errors of all runs, efforts in the worst run, tip error over mismatch.

    The mismatch is the error in % of all masses and inertias in the controller's model. The third panel is omitted if
    there are no runs at several mismatches.
    """
    runs, worst, curves = result.runs, result.runs[result.worst], result.curves
    w = worst.conditions.w
    title = f"{result.robot}, {result.protocol}: computed torque control, Kp = w², Kv = 2 w, w = {w:g} rad/s"
    phases = tuple(PhaseSummary(*phase) for phase in result.phases)

    heights = [2.3, 1.9, 1.9] if curves else [2.3, 1.9]
    head, gaps, foot = 0.74, (0.18, 0.78), 0.5
    tops = [head + sum(heights[:i]) + sum(gaps[:i]) for i in range(len(heights))]
    total = tops[-1] + heights[-1] + foot
    out = sheet(title, total)
    left, wide = 0.86 / WIDTH, (WIDTH - 0.86 - 1.75) / WIDTH
    axes = [
        out.add_axes((left, 1 - (top + tall) / total, wide, tall / total))
        for top, tall in zip(tops, heights, strict=True)
    ]
    _errors(axes[0], runs)
    _efforts(axes[1], result, worst)
    for ax in axes[:2]:
        ax.set_xlim(worst.t[0], worst.t[-1])
    phase_bands([[ax] for ax in axes[:2]], phases)
    axes[0].tick_params(labelbottom=False)
    axes[1].set_xlabel("time [s]")
    if curves:
        _curves(axes[2], curves)
    for ax in axes:
        ax.tick_params(length=2.5)
        ax.yaxis.set_label_coords(-0.66 / (wide * WIDTH), 0.5)
    return out


def _errors(ax: Axes, runs: Mapping[str, Run]) -> None:
    for (name, run), color in zip(runs.items(), (INK, *PALETTE), strict=False):
        t, error = thin(run.t, run.tip_error / UM)
        ax.plot(t, error, color=color, lw=1.1, label=f"{name}\nlargest {quantity(run.tip_max, 'm', 3)}")
    _up_to(ax, max(r.tip_max for r in runs.values()))
    ax.set_ylabel("tip error [µm]")
    legend_beside(ax)


def _efforts(ax: Axes, result: Tracking, run: Run) -> None:
    """Draw the running mean of the efforts and, in pale colours, the efforts at every tick, with encoder noise."""
    largest = 0.0
    for i, row in enumerate(result.efforts):
        whole = row.limit or row.peak or 1.0  # without a stated limit, percent of the peak
        part = 100 * run.effort[:, i] / whole
        color = PALETTE[i % len(PALETTE)]
        ax.plot(*thin(run.t, part), color=color, lw=0.5, alpha=0.3)
        label = f"{row.joint}, {'limit' if row.limit else 'peak'} {whole:g} {row.unit}"
        ax.plot(*thin(run.t, _mean(part)), color=color, lw=1.1, label=label)
        largest = max(largest, np.abs(part).max())
    if largest > 60:
        for side in (-100, 100):
            limit_line(ax, side, "limit")
    ax.axhline(0, color=INK, lw=0.5, alpha=0.4)
    ax.annotate(f"{result.worst}; pale: value of every tick", (0.006, 0.03), xycoords="axes fraction", fontsize=8.5)
    ax.margins(y=0.12)
    ax.set_ylabel("effort, % of limit")
    legend_beside(ax)


def _curves(ax: Axes, curves: Mapping[str, Sequence[Run]]) -> None:
    for (name, runs), color in zip(curves.items(), PALETTE, strict=False):
        x = [100 * r.conditions.inertia_error for r in runs]
        label = fill(f"{name}: largest", 22)
        ax.plot(x, [r.tip_max / UM for r in runs], "o-", ms=3.5, color=color, label=label)
        ax.plot(x, [r.tip_rms / UM for r in runs], "o--", ms=3.5, mfc="none", color=color, lw=0.9, label="RMS")
    _up_to(ax, max(r.tip_max for runs in curves.values() for r in runs))
    ax.set_xlabel("error of all masses and tensors in the controller's model [%]")
    ax.set_ylabel("tip error [µm]")
    legend_beside(ax)


def _up_to(ax: Axes, largest: float) -> None:
    """Set the y axis from 0 to above `largest` (m); if `largest` exceeds 0.4 mm, at least to above the paper's 1 mm."""
    near = largest > 0.4 * TIP_LIMIT
    if near:
        limit_line(ax, TIP_LIMIT / UM, "1 mm, as the paper reports")
    ax.set_ylim(0, 1.16 * max(largest, TIP_LIMIT if near else 1e-9) / UM)


def _mean(y: Array) -> Array:
    """Return the running mean (k,) over `_TICKS` samples."""
    half = min(_TICKS // 2, (len(y) - 1) // 2)
    padded = np.pad(y, half, mode="edge")
    return np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")
