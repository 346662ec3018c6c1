"""Draw the plots of a report; each function returns a figure, or None if the report lacks the necessary curves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import quantity, seconds
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.ui.report import plot_data, search_figures
from twin.ui.report.convergence_figures import convergence
from twin.ui.report.residual_matrix import residual_matrix
from twin.ui.report.style import (
    FIT,
    INK,
    NEAR,
    PALETTE,
    UNFIT,
    XYZ,
    headline,
    legend_above,
    legend_beside,
    limit_line,
    log_axis,
    mark_sample,
    panels,
    phase_bands,
    styled,
    value_at_time,
)
from twin.validation.report_curves import OUTER_POINT_DISTANCE
from twin.validation.result import Report, RowKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_Curve = tuple[str, Array, Array]
"""Label, times in s and values of a curve."""

_DERIVATIVES = (("displacement", ""), ("speed", "/s"), ("acceleration", "/s²"))
"""Quantity of each row, and what its unit has in addition to the unit of the displacement."""

_MAX_NOISY_POINTS = 800
"""Maximum number of points in a noisy curve, because the page contains all points."""

_LEGEND_WIDTH = 1.5
"""Width in inches of a legend beside the axes."""


def active_joints(report: Report) -> Figure | None:
    """Draw displacement, speed and acceleration of the active joints, as in Fig. 9 of the SILS paper.

    Prismatic joints are in one column, revolute joints in another.
    """
    series: list[tuple[Array, Array]] = []
    columns_of_series = []
    for key in ("q", "qd", "qdd"):
        curve = plot_data.curve_of(report, key)
        if curve is None or curve[1].ndim != 2:
            return None
        series.append(curve)
        columns_of_series.append(curve[1].shape[1])
    n = min(columns_of_series)
    names = list(report.joint_names[:n])
    # joints without a name in the report are numbered
    for j in range(n - len(names)):
        names.append(f"q{j + 1}")
    units = [plot_data.joint_unit(report, name) for name in names]
    columns = [unit for unit in ("m", "rad") if unit in units]
    figure, axes = panels(headline("Active joints", report), [1.75] * 3, len(columns))
    for c, unit in enumerate(columns):
        factor = MM
        sign = "mm"
        if unit == "rad":
            factor = DEG
            sign = "°"
        for r, (what, per) in enumerate(_DERIVATIVES):
            ax = axes[r][c]
            times, values = series[r]
            for j, name in enumerate(names):
                if units[j] == unit:
                    t, y = plot_data.thinned_curve(times, values[:, j] / factor)
                    ax.plot(t, y, label=name, **_line_style(j))
            ax.set_ylabel(f"{what} [{sign}{per}]")
        legend_above(axes[0][c])
    return _with_phase_bands(figure, axes, report)


def tool_motion(report: Report) -> Figure | None:
    """Draw displacement, speed and acceleration of the tool (origin and angles), as in Fig. 10 of the SILS paper.

    Black dashed lines show the motion of the independent model, if the report contains it.
    """
    if plot_data.curve_of(report, "p_tool") is None:
        return None
    angular = _angles(report, "angles", "t")
    columns = 2 if angular else 1
    figure, axes = panels(headline("Tool motion", report), [1.75] * 3, columns)
    for row, (what, per) in enumerate(_DERIVATIVES):
        key = "pva"[row]
        linear = plot_data.curve_of(report, f"{key}_tool")
        reference = plot_data.curve_of(report, f"{key}_tool_B", "t_coarse")
        _draw_xyz(axes[row][0], linear, reference, "xyz", MM)
        axes[row][0].set_ylabel(f"{what} [mm{per}]")
    if angular:
        references = _angles(report, "angles_B", "t_coarse") or [None] * 3
        for row, what in enumerate(("angle", "angle rate", "second derivative")):
            _, per = _DERIVATIVES[row]
            _draw_xyz(axes[row][1], angular[row], references[row], "ψθφ", DEG)
            axes[row][1].set_ylabel(f"{what} [°{per}]")
    for ax in axes[0]:
        legend_above(ax)
    return _with_phase_bands(figure, axes, report)


def residuals(report: Report) -> Figure | None:
    """Draw differences between formula and mechanism over time: tool and points, driven joints, tool rotation."""
    groups = _residual_groups(report)
    if not groups:
        return None
    heights = []
    for group in groups:
        # several curves need room for their legend
        heights.append(1.9 if len(group.lines) > 1 else 1.3)
    figure, axes = panels(headline("Formula against mechanism", report), heights, 1, _LEGEND_WIDTH, 0.62, 0.3)
    phase_bands(axes, report.phases)
    for (ax,), group in zip(axes, groups, strict=True):
        limits = []
        for kind in group.kinds:
            limit = plot_data.tolerance(report, kind, group.unit)
            if limit is not None:
                limits.append(limit)
        absolute = [np.abs(y) for _, _, y in group.lines]
        log_axis(ax, group.unit, absolute, limits)
        floor, _ = ax.get_ylim()
        colored = 0
        for name, t, y in group.lines:
            if name == "tool":
                style = {"color": INK, "lw": 1.6}
            else:
                style = _line_style(colored)
                colored += 1
            t_drawn, y_drawn = plot_data.thinned_curve(t, np.maximum(np.abs(y), floor), _MAX_NOISY_POINTS)
            ax.plot(t_drawn, y_drawn, label=name, **style)
        for limit in sorted(set(limits)):
            limit_line(ax, limit, f"tolerance {quantity(limit, group.unit)}")
        _mark_worst(ax, group.unit, group.lines, min(limits, default=np.inf))
        ax.set_ylabel(group.title)
        legend_beside(ax)
    return figure


@dataclass(frozen=True)
class _ResidualGroup:
    """Residuals that have axes in common: their title, unit and curves, and the kinds of rows with their tolerances."""

    title: str
    unit: str
    lines: list[_Curve]
    kinds: tuple[RowKind, ...]


def _residual_groups(report: Report) -> list[_ResidualGroup]:
    """Return the groups of residuals for which the report has curves."""
    positions: list[_Curve] = []
    tool = plot_data.curve_of(report, "residual_tool")
    if tool is not None:
        positions.append(("tool", *tool))
    positions += plot_data.curves_of_prefix(report, "residual_point", "t_coarse")
    driven: dict[str, list[_Curve]] = {"m": [], "rad": []}
    for line in plot_data.curves_of_prefix(report, "residual_driven", "t_coarse"):
        unit = plot_data.joint_unit(report, line[0])
        driven[unit].append(line)
    rotations: list[_Curve] = []
    rotation = plot_data.curve_of(report, "residual_rotation")
    if rotation is not None:
        rotations.append(("tool", *rotation))
    groups = []
    for group in (
        _ResidualGroup("tool and points", "m", positions, ("tool", "point")),
        _ResidualGroup("driven joints", "m", driven["m"], ("driven",)),
        _ResidualGroup("driven joints", "rad", driven["rad"], ("driven",)),
        _ResidualGroup("tool rotation", "rad", rotations, ("tool",)),
    ):
        if group.lines:
            groups.append(group)
    return groups


def rcm(report: Report) -> Figure | None:
    """Draw the distance of the shaft axis from the registered RCM, and the maximum allowed distance."""
    curve = plot_data.curve_of(report, "rcm_error")
    if curve is None or curve[1].ndim != 1:
        return None
    t, y = curve
    limit = plot_data.rcm_tolerance(report)
    figure, axes = panels(headline("RCM error", report), [2.0], 1, head=0.62)
    phase_bands(axes, report.phases)
    ax = axes[0][0]
    log_axis(ax, "m", [y], [limit] if limit else [])
    floor, _ = ax.get_ylim()
    t_drawn, y_drawn = plot_data.thinned_curve(t, np.maximum(y, floor), _MAX_NOISY_POINTS)
    ax.plot(t_drawn, y_drawn, color=PALETTE[0])
    limit_line(ax, limit, f"allowed {quantity(limit, 'm')}")
    k = int(np.nanargmax(y))
    worst = float(y[k])
    color = UNFIT if limit and worst > limit else INK
    mark_sample(ax, float(t[k]), worst, value_at_time(worst, "m", float(t[k]), limit), color)
    ax.set_ylabel("shaft axis to RCM")
    return figure


def fulcrum(report: Report) -> Figure | None:
    """Draw the sideways displacements of the tip and of a point of the outer shaft; the two have opposite signs."""
    curve = plot_data.curve_of(report, "fulcrum")
    if curve is None or curve[1].ndim != 2:
        return None
    t, displacements = curve
    tip = displacements[:, 0] / MM
    shaft = displacements[:, 1] / MM
    if np.nanmax(tip) - np.nanmin(tip) < 1:
        return None  # the tip moves sideways by less than 1 mm
    figure, axes = panels(headline("Fulcrum", report), [2.0], 1)
    ax = axes[0][0]
    ax.axhline(0, color=INK, lw=0.6)
    ax.plot(*plot_data.thinned_curve(t, tip), color=PALETTE[0], label="tip")
    ax.plot(
        *plot_data.thinned_curve(t, shaft),
        color=PALETTE[1],
        label=f"shaft, {OUTER_POINT_DISTANCE / MM:g} mm outside the trocar",
    )
    ax.set_ylabel("sideways [mm]")
    legend_above(ax)
    return _with_phase_bands(figure, axes, report)


def margins(report: Report) -> Figure | None:
    """Draw over time: distance to the nearest joint limit, distances to the end of the reach, singularity measures."""
    groups: dict[str, list[_Curve]] = {}
    limit = plot_data.curve_of(report, "limit_margin")
    if limit is not None and limit[1].ndim == 1:
        groups["joint limits"] = [("nearest joint", *limit)]
    reach = list(plot_data.curves_of_prefix(report, "reach"))
    if reach:
        groups["reach"] = reach
    measures = list(plot_data.curves_of_prefix(report, "singularity"))
    if measures:
        groups["singularity"] = measures
    if not groups:
        return None
    heights = [1.5] * len(groups)
    if measures:
        heights[-1] = 2.1
    figure, axes = panels(headline("Margins", report), heights, 1, _LEGEND_WIDTH, 0.62, 0.25)
    phase_bands(axes, report.phases)
    for (ax,), (title, lines) in zip(axes, groups.items(), strict=True):
        if title == "singularity":
            _draw_measures(ax, lines, plot_data.alarms(report))
        else:
            _draw_distances(ax, lines)
            ax.set_ylabel(f"{title} [mm]")
        legend_beside(ax)
    return figure


def clearance(report: Report) -> Figure | None:
    """Draw the minimum distance between two bodies over time; pairs of bodies that touch by design are excluded."""
    curve = plot_data.curve_of(report, "clearance", "clearance_t")
    if curve is None or curve[1].ndim != 1:
        return None
    figure, axes = panels(headline("Minimum clearance", report), [1.8], 1, head=0.62)
    phase_bands(axes, report.phases)
    ax = axes[0][0]
    _draw_distances(ax, [("", *curve)])
    ax.set_ylabel("clearance [mm]")
    return figure


def path_cost(report: Report) -> Figure | None:
    """Draw the path cost over the number of samples of the search, for each phase with a searched path."""
    searches = {}
    for phase in report.phases:
        if phase.rounds is not None:
            searches[phase.name] = phase.rounds
    if not searches:
        return None
    return search_figures.figure(headline("Paths around obstacles", report), searches)


PLOTS: dict[str, Callable[[Report], Figure | None]] = {
    "residual_matrix": residual_matrix,
    "active_joints": active_joints,
    "tool_motion": tool_motion,
    "residuals": residuals,
    "rcm": rcm,
    "fulcrum": fulcrum,
    "margins": margins,
    "clearance": clearance,
    "path_cost": path_cost,
    "convergence": convergence,
}
"""Plot functions by file name."""


def figures(report: Report) -> dict[str, Figure]:
    """Return the plots for which the report contains data, by name, in the order of `PLOTS`."""
    curve_names = {}
    with styled():
        for name, draw in PLOTS.items():
            figure = draw(report)
            if figure is not None:
                curve_names[name] = figure
    return curve_names


def _line_style(i: int) -> JsonObject:
    """Return colour and dashes of curve i; the dashes change when all colours have been used."""
    dashes = ("-", (0, (4, 1.5)), (0, (1.5, 1.2)))
    repetition, color = divmod(i, len(PALETTE))
    return {"color": PALETTE[color], "ls": dashes[repetition % len(dashes)]}


def _with_phase_bands(figure: Figure, axes: list[list[Axes]], report: Report) -> Figure:
    phase_bands(axes, report.phases)
    for row in axes:
        for ax in row:
            ax.margins(y=0.08)
    return figure


def _angles(report: Report, key: str, times: str) -> list[tuple[Array, Array]] | None:
    """Return (t, values) of the series `key` of angles in rad, its rate and its second derivative; None: no curve."""
    curve = plot_data.curve_of(report, key, times)
    if curve is None:
        return None
    t, angles = curve
    if angles.ndim != 2 or len(t) < 3:
        return None
    angles = np.unwrap(angles, axis=0)
    rate = np.gradient(angles, t, axis=0)
    second = np.gradient(rate, t, axis=0)
    return [(t, angles), (t, rate), (t, second)]


def _draw_xyz(
    ax: Axes,
    line: tuple[Array, Array] | None,
    reference: tuple[Array, Array] | None,
    names: str,
    factor: float,
) -> None:
    """Draw the three components of a vector over time, and above them, dashed, those of the independent model."""
    if line is not None and line[1].ndim == 2:
        for i, name in enumerate(names):
            t, y = plot_data.thinned_curve(line[0], line[1][:, i] / factor)
            ax.plot(t, y, color=XYZ[i], lw=1.8, label=name)
    if reference is not None and reference[1].ndim == 2:
        label = "mechanism (B)"
        for i in range(len(names)):
            t, y = plot_data.thinned_curve(reference[0], reference[1][:, i] / factor, 400)
            ax.plot(t, y, color=INK, lw=1.0, ls=(0, (3, 3)), label=label)
            label = ""  # one entry of the legend for the three components


def _draw_distances(ax: Axes, lines: list[_Curve]) -> None:
    """Draw distances in m on an axis in mm that begins at zero, and mark the smallest."""
    scaled: list[_Curve] = []
    for i, (name, t, y) in enumerate(lines):
        distance = y / MM
        scaled.append((name, t, distance))
        t_drawn, distance_drawn = plot_data.thinned_curve(t, distance)
        ax.plot(t_drawn, distance_drawn, label=name, **_line_style(i))
    _zero_based(ax, scaled)
    _mark_smallest(ax, scaled, lambda distance: quantity(distance * MM, "m"))


def _draw_measures(ax: Axes, lines: list[_Curve], alarms: dict[str, float]) -> None:
    """Draw the absolute value of each measure, divided by its alarm value; all but the five smallest are grey."""
    relative: list[_Curve] = []
    for name, t, y in lines:
        alarm = alarms.get(name, 1.0)
        relative.append((name, t, np.abs(y) / alarm))
    relative.sort(key=lambda line: float(np.nanmin(line[2])))
    # instead of a single grey curve, a sixth coloured one
    colored = len(relative) if len(relative) <= 6 else 5
    for i, (name, t, y) in enumerate(relative):
        t_drawn, y_drawn = plot_data.thinned_curve(t, y)
        if i < colored:
            ax.plot(t_drawn, y_drawn, label=name, zorder=2, **_line_style(i))
            continue
        # one entry of the legend for all grey curves
        label = f"{len(relative) - colored} others" if i == colored else ""
        ax.plot(t_drawn, y_drawn, label=label, zorder=1.5, color="#9aa5b1", lw=0.9)
    _, largest = _value_range(relative)
    if alarms and largest > 20:
        ax.set_yscale("log")
    else:
        _zero_based(ax, relative)
    if alarms:
        limit_line(ax, 1.0, "alarm", NEAR)
        ax.set_ylabel("singularity / alarm")
    else:
        ax.set_ylabel("singularity")
    _mark_smallest(ax, relative[:1], lambda measure: f"{measure:.3g}")


def _value_range(lines: list[_Curve]) -> tuple[float, float]:
    """Return the smallest and the largest value of all curves."""
    low = np.inf
    high = -np.inf
    for _, _, y in lines:
        low = min(low, float(np.nanmin(y)))
        high = max(high, float(np.nanmax(y)))
    return low, high


def _zero_based(ax: Axes, lines: list[_Curve]) -> None:
    """Begin the y axis at zero, or below zero if a value is negative."""
    low, high = _value_range(lines)
    ax.set_ylim(min(0.0, 1.15 * low), max(high, 0.0) * 1.12 or 1.0)
    if low < 0:
        ax.axhspan(ax.get_ylim()[0], 0, color=UNFIT, alpha=0.12, lw=0)
        ax.axhline(0, color=UNFIT, lw=1.0)


def _mark_smallest(ax: Axes, lines: list[_Curve], text: Callable[[float], str]) -> None:
    """Mark the smallest value of all curves, in red if it is negative; `text` returns the text of a value."""
    _, times, y = min(lines, key=lambda line: float(np.nanmin(line[2])))
    k = int(np.nanargmin(y))
    t = float(times[k])
    value = float(y[k])
    color = UNFIT if value < 0 else INK
    mark_sample(ax, t, value, f"{text(value)} at {seconds(t)}", color, below=True)


def _mark_worst(ax: Axes, unit: str, lines: list[_Curve], limit: float) -> None:
    """Mark the largest residual, in red if it exceeds its tolerance."""
    name, times, y = max(lines, key=lambda line: float(np.nanmax(np.abs(line[2]))))
    k = int(np.nanargmax(np.abs(y)))
    t = float(times[k])
    value = float(abs(y[k]))
    if value <= 0:
        return
    text = value_at_time(value, unit, t, limit)
    if len(lines) > 1:
        text = f"{name}: {text}"
    color = UNFIT if value > limit else FIT
    mark_sample(ax, t, value, text, color)
