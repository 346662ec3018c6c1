"""Draw a fault-injection campaign: peak deviation by class, ROC curves of detection, reaction times of the trainee."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from twin.simulation.hazards.attacked import HARM
from twin.simulation.hazards.roc import dangerous, in_time
from twin.simulation.hazards.summary import Hazards
from twin.ui.report.style import BAND, INK, PALETTE, sheet, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEAST = 1e-2
"""Smallest drawn deviation in mm; smaller deviations are drawn at this value."""

_MANY = 300
"""Number of sessions above which the points are drawn smaller, so that they do not cover each other."""


def figure(found: Hazards) -> Figure:
    """Return a figure of peak deviations (one row for each class of faults), ROC curves and reaction times.

    A row has a point for each session. The ROC curves show the detection of dangerous sessions. The reaction times
    are those of the trainee.
    """
    with styled():
        n = len(found.by_class)
        height = 5.2 + 0.28 * n
        out = sheet(f"{found.robot}: {_sessions(len(found.rows))} of '{found.table.title}'", height)
        grid = out.add_gridspec(2, 2, height_ratios=[0.28 * n + 0.4, 3.3])
        out.subplots_adjust(left=0.22, right=0.98, top=1 - 0.55 / height, bottom=0.5 / height, hspace=0.22, wspace=0.32)
        _peaks(out.add_subplot(grid[0, :]), found)
        _roc(out.add_subplot(grid[1, 0]), found)
        _times(out.add_subplot(grid[1, 1]), found)
        return out


def _sessions(n: int) -> str:
    return f"{n} session{'' if n == 1 else 's'}"


def _peaks(ax: Axes, found: Hazards) -> None:
    size = 2.2 if len(found.rows) > _MANY else 5
    for k, (name, rows) in enumerate(found.by_class.items()):
        if k % 2:
            ax.axhspan(k - 0.5, k + 0.5, color=BAND, linewidth=0, zorder=0)
        aside = 0.3 * np.sin(2.4 * np.arange(len(rows)))  # equal values lie beside each other
        stopped = np.array([r["stop"] is not None for r in rows])
        peaks = np.maximum([r["peak"] for r in rows], _LEAST)
        for part, color, label in ((~stopped, PALETTE[0], "not stopped"), (stopped, PALETTE[1], "stopped by a check")):
            ax.plot(
                peaks[part], k + aside[part], "o", ms=size, alpha=0.5, color=color, mew=0, label=None if k else label
            )
        ax.text(-0.01, k, f"{name} ({len(rows)})", transform=ax.get_yaxis_transform(), ha="right", va="center")
    for limit, text in ((HARM, f"{HARM:g} mm: harm"), (3.0, "3 mm: cue")):
        ax.axvline(limit, color=INK, linewidth=0.9, linestyle="--")
        ax.text(limit, -0.75, text, fontsize=7.5, ha="right" if limit == HARM else "left", va="bottom")
    _logarithmic(ax)
    ax.set_ylim(len(found.by_class) - 0.4, -0.6)
    ax.set_yticks([])
    ax.grid(True, axis="x")
    ax.set_xlabel("peak deviation of the tip without a response [mm]")
    low, high = ax.get_xlim()
    ax.set_xlim(min(low, 0.8 * _LEAST), max(high, 10))  # room for the label of 3 mm
    _legend(ax, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.3, ncols=2, markerscale=6.6 / size)


def _roc(ax: Axes, found: Hazards) -> None:
    for k, c in enumerate(found.roc):
        color, line = PALETTE[k % 2], "-" if k > 1 else ":"
        label = f"{c.name} (area {c.area:.3f})"
        ax.plot(c.false, c.detected, line, color=color, drawstyle="steps-post", label=label)
        detected, false = c.at(c.limit)
        ax.plot([false], [detected], "o", color=color, ms=6, clip_on=False, zorder=4)
    if found.roc:
        used = " or ".join(dict.fromkeys(c.used for c in found.roc))
        ax.plot([], [], "o", color=INK, ms=6, label=f"limit in use, {used}")
    danger = [r for r in found.rows if dangerous(r)]
    if danger:
        share = float(np.mean([in_time(r) for r in danger]))
        ax.plot([0], [share], "^", color=PALETTE[2], ms=7, clip_on=False, label="checks of the software", zorder=4)
    ax.set_xlim(-0.01, 1)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("share of sessions with a false alarm")
    ax.set_ylabel("share of dangerous sessions detected in time")
    _legend(ax, loc="lower right")


def _times(ax: Axes, found: Hazards) -> None:
    rows = [r for r in found.rows if r["response"] is not None]
    for color, key, text in ((PALETTE[0], "noticed", "could notice"), (PALETTE[1], "acted", "acted")):
        times = np.sort([max(r["response"][key], 1) for r in rows])
        if len(times):
            shares = np.linspace(0, 1, len(times) + 1)  # from 0, so that one session is a line too
            ax.step(np.r_[times[0], times], shares, where="post", color=color, label=text)
    _logarithmic(ax)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("time from the start of the fault [ms]")
    ax.set_ylabel("share of sessions with a force or a stop")
    _legend(ax, loc="best", borderaxespad=0.8, title=f"scripted trainee, {_sessions(len(rows))}")


def _logarithmic(ax: Axes) -> None:
    """Make the x axis logarithmic, with decimal numbers as tick labels."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def _legend(ax: Axes, **more: Any) -> None:
    """Add a legend; none if nothing has been drawn."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**more)
