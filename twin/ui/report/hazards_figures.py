"""Draw a fault-injection campaign: peak deviation by class, ROC curves of detection, reaction times of the trainee."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from twin.core.format import count
from twin.core.json_types import JsonMapping
from twin.simulation.campaigns.attacked_session import HARM
from twin.simulation.campaigns.roc import dangerous, in_time
from twin.simulation.campaigns.summary import Hazards
from twin.simulation.controllers.cue import Cue
from twin.ui.report.style import BAND, INK, PALETTE, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MIN_DEVIATION = 1e-2
"""Smallest drawn deviation in mm; smaller deviations are drawn at this value."""

_CUE_DEVIATION = Cue().tol
"""Deviation in mm from which a force warns the operator."""

_CROWDED_SESSIONS = 300
"""Number of sessions above which the points are drawn smaller, so that they do not cover each other."""


@styled()
def figure(campaign: Hazards) -> Figure:
    """Return a figure of peak deviations (one row for each class of faults), ROC curves and reaction times.

    A row has a point for each session. The ROC curves show the detection of dangerous sessions. The reaction times
    are those of the trainee.
    """
    n = len(campaign.by_class)
    height = 5.2 + 0.28 * n
    sessions = count(len(campaign.rows), "session")
    drawing = titled_figure(f"{campaign.robot}: {sessions} of '{campaign.table.title}'", height)
    grid = drawing.add_gridspec(2, 2, height_ratios=[0.28 * n + 0.4, 3.3])
    drawing.subplots_adjust(left=0.22, right=0.98, top=1 - 0.55 / height, bottom=0.5 / height, hspace=0.22, wspace=0.32)
    _draw_peaks(drawing.add_subplot(grid[0, :]), campaign)
    _draw_roc(drawing.add_subplot(grid[1, 0]), campaign)
    _draw_response_times(drawing.add_subplot(grid[1, 1]), campaign)
    return drawing


def _draw_peaks(ax: Axes, campaign: Hazards) -> None:
    """Draw a row for each class of faults, with a point for each session."""
    size = 5
    if len(campaign.rows) > _CROWDED_SESSIONS:
        size = 2.2
    for k, (name, rows) in enumerate(campaign.by_class.items()):
        if k % 2:
            ax.axhspan(k - 0.5, k + 0.5, color=BAND, linewidth=0, zorder=0)
        _peaks_of_class(ax, k, rows, size)
        ax.text(-0.01, k, f"{name} ({len(rows)})", transform=ax.get_yaxis_transform(), ha="right", va="center")
    # the labels of the two limits extend to opposite sides, because the limits are close to each other
    _limit(ax, HARM, "harm", "right")
    _limit(ax, _CUE_DEVIATION, "cue", "left")
    _logarithmic(ax)
    ax.set_ylim(len(campaign.by_class) - 0.4, -0.6)
    ax.set_yticks([])
    ax.grid(True, axis="x")
    ax.set_xlabel("peak deviation of the tip without a response [mm]")
    low, high = ax.get_xlim()
    ax.set_xlim(min(low, 0.8 * _MIN_DEVIATION), max(high, 10))  # room for the label of 3 mm
    _legend(ax, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0.3, ncols=2, markerscale=6.6 / size)


def _peaks_of_class(ax: Axes, class_number: int, rows: Sequence[JsonMapping], size: float) -> None:
    """Draw the peak deviations of the sessions of a class in row k, as points of a size in points."""
    y = class_number + 0.3 * np.sin(2.4 * np.arange(len(rows)))  # equal values lie beside each other
    stopped = np.zeros(len(rows), bool)
    peaks = np.zeros(len(rows))
    for i, row in enumerate(rows):
        stopped[i] = row["stop"] is not None
        peaks[i] = max(row["peak"], _MIN_DEVIATION)
    parts = ((~stopped, PALETTE[0], "not stopped"), (stopped, PALETTE[1], "stopped by a check"))
    for part, color, text in parts:
        label = text if class_number == 0 else None  # one entry of the legend for all classes
        ax.plot(peaks[part], y[part], "o", ms=size, alpha=0.5, color=color, mew=0, label=label)


def _limit(ax: Axes, limit: float, meaning: str, side: Literal["left", "right"]) -> None:
    """Draw a limit in mm as a vertical line; its label ends ("right") or begins ("left") at the line."""
    ax.axvline(limit, color=INK, linewidth=0.9, linestyle="--")
    ax.text(limit, -0.75, f"{limit:g} mm: {meaning}", fontsize=7.5, ha=side, va="bottom")


def _draw_roc(ax: Axes, campaign: Hazards) -> None:
    """Draw the ROC curves with a dot at each limit in use, and a triangle for the checks of the robot's software."""
    for k, curve in enumerate(campaign.roc):
        color = PALETTE[k % 2]
        # the first two curves are those without the checks of the robot's software
        line = "-" if k > 1 else ":"
        label = f"{curve.name} (area {curve.area:.3f})"
        ax.plot(curve.false, curve.detected, line, color=color, drawstyle="steps-post", label=label)
        detected, false = curve.at(curve.limit)
        ax.plot([false], [detected], "o", color=color, ms=6, clip_on=False, zorder=4)
    if campaign.roc:
        # each limit is used without and with the checks: its text comes once
        used_thresholds = dict.fromkeys(curve.used for curve in campaign.roc)
        ax.plot([], [], "o", color=INK, ms=6, label=f"limit in use, {' or '.join(used_thresholds)}")
    detections = []
    for row in campaign.rows:
        if dangerous(row):
            detections.append(in_time(row))
    if detections:
        share = float(np.mean(detections))
        # each session that these checks stop counts as dangerous: they have no false alarm
        ax.plot([0], [share], "^", color=PALETTE[2], ms=7, clip_on=False, label="checks of the software", zorder=4)
    ax.set_xlim(-0.01, 1)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("share of sessions with a false alarm")
    ax.set_ylabel("share of dangerous sessions detected in time")
    _legend(ax, loc="lower right")


def _draw_response_times(ax: Axes, campaign: Hazards) -> None:
    """Draw the share of sessions in which the scripted trainee has noticed, or acted, by a time after the fault."""
    responses = []
    for row in campaign.rows:
        if row["response"] is not None:
            responses.append(row["response"])
    stages = ((PALETTE[0], "noticed", "could notice"), (PALETTE[1], "acted", "acted"))
    for color, key, text in stages:
        if responses:
            times = np.sort([response[key] for response in responses])
            times = np.maximum(times, 1)  # ms; the axis is logarithmic
            shares = np.linspace(0, 1, len(times) + 1)  # from 0, so that one session is a line too
            ax.step(np.r_[times[0], times], shares, where="post", color=color, label=text)
    _logarithmic(ax)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("time from the start of the fault [ms]")
    ax.set_ylabel("share of sessions with a force or a stop")
    sessions = count(len(responses), "session")
    _legend(ax, loc="best", borderaxespad=0.8, title=f"scripted trainee, {sessions}")


def _logarithmic(ax: Axes) -> None:
    """Make the x axis logarithmic, with decimal numbers as tick labels."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def _legend(ax: Axes, **more: object) -> None:
    """Add a legend; none if nothing has been drawn."""
    handles, _ = ax.get_legend_handles_labels()
    if handles:
        ax.legend(**more)
