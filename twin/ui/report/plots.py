"""Draw the plots of a report; each function returns a figure, or None if the report lacks the necessary curves."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from twin.core.format import quantity, seconds
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.ui.report import curves, rounds
from twin.ui.report.convergence import convergence
from twin.ui.report.matrix import residual_matrix
from twin.ui.report.style import (
    FIT,
    INK,
    NEAR,
    PALETTE,
    UNFIT,
    XYZ,
    at,
    headline,
    legend_above,
    legend_beside,
    limit_line,
    log_axis,
    mark,
    panels,
    phase_bands,
    styled,
)
from twin.validation.fulcrum import OUTSIDE
from twin.validation.result import Report, RowKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RATES = (("displacement", ""), ("speed", "/s"), ("acceleration", "/s²"))
_NOISY = 800
"""Maximum number of points in a noisy curve, because the page contains all points."""
_SIDE = 1.5
"""Width in inches of a legend beside the axes."""


def active_joints(report: Report) -> Figure | None:
    """Draw displacement, speed and acceleration of the active joints, as in Fig. 9 of the SILS paper.

    Prismatic joints are in one column, revolute joints in another.
    """
    series = [curves.pair(report, key) for key in ("q", "qd", "qdd")]
    if any(s is None or s[1].ndim != 2 for s in series):
        return None
    n = min(s[1].shape[1] for s in series if s is not None)
    names = (*report.joint_names, *(f"q{j + 1}" for j in range(n)))[:n] if report.joint_names else [
        f"q{j + 1}" for j in range(n)
    ]  # fmt: skip
    units = [curves.joint_unit(report, name) for name in names]
    kinds = [u for u in ("m", "rad") if u in units]
    figure, axes = panels(headline("Active joints", report), [1.75] * 3, len(kinds))
    for c, kind in enumerate(kinds):
        factor, sign = (MM, "mm") if kind == "m" else (DEG, "°")
        for r, (what, per) in enumerate(_RATES):
            found = series[r]
            assert found is not None
            ax = axes[r][c]
            for j in (j for j in range(n) if units[j] == kind):
                t, y = curves.thin(found[0], found[1][:, j] / factor)
                ax.plot(t, y, label=names[j], **_line(j))
            ax.set_ylabel(f"{what} [{sign}{per}]")
        legend_above(axes[0][c])
    return _finish(figure, axes, report)


def tool_motion(report: Report) -> Figure | None:
    """Draw displacement, speed and acceleration of the tool (origin and angles), as in Fig. 10 of the SILS paper.

    Black dashed lines show the motion of the independent model, if the report contains it.
    """
    linear = [curves.pair(report, f"{key}_tool") for key in "pva"]
    if linear[0] is None:
        return None
    angular = _angles(report, "angles", "t")
    columns = 2 if angular else 1
    figure, axes = panels(headline("Tool motion", report), [1.75] * 3, columns)
    for r, (what, per) in enumerate(_RATES):
        _draw_xyz(axes[r][0], linear[r], curves.pair(report, f"{'pva'[r]}_tool_B", "t_coarse"), "xyz", MM)
        axes[r][0].set_ylabel(f"{what} [mm{per}]")
        if angular:
            reference = _angles(report, "angles_B", "t_coarse")
            _draw_xyz(axes[r][1], angular[r], reference[r] if reference else None, "ψθφ", DEG)
            axes[r][1].set_ylabel(("angle", "angle rate", "second derivative")[r] + f" [°{per}]")
    for ax in axes[0]:
        legend_above(ax)
    return _finish(figure, axes, report)


def residuals(report: Report) -> Figure | None:
    """Draw differences between formula and mechanism over time: tool and points, driven joints, tool rotation."""
    driven: dict[str, list[tuple[str, Array, Array]]] = {"m": [], "rad": []}
    for name, t, y in curves.named(report, "residual_driven", "t_coarse"):
        driven[curves.joint_unit(report, name)].append((name, t, y))
    length = list(curves.named(report, "residual_point", "t_coarse"))
    tool = curves.pair(report, "residual_tool")
    turn = curves.pair(report, "residual_rotation")
    groups: list[tuple[str, str, list[tuple[str, Array, Array]], tuple[RowKind, ...]]] = [
        ("tool and points", "m", ([("tool", *tool)] if tool else []) + length, ("tool", "point")),
        ("driven joints", "m", driven["m"], ("driven",)),
        ("driven joints", "rad", driven["rad"], ("driven",)),
        ("tool rotation", "rad", [("tool", *turn)] if turn else [], ("tool",)),
    ]
    groups = [g for g in groups if g[2]]
    if not groups:
        return None
    heights = [1.9 if len(lines) > 1 else 1.3 for _, _, lines, _ in groups]
    figure, axes = panels(headline("Formula against mechanism", report), heights, 1, _SIDE, 0.62, 0.3)
    phase_bands(axes, report.phases)
    for (ax,), (title, unit, lines, quantities) in zip(axes, groups, strict=True):
        limits = {q: limit for q in quantities if (limit := curves.tolerance(report, q, unit)) is not None}
        log_axis(ax, unit, [np.abs(y) for _, _, y in lines], list(limits.values()))
        floor = ax.get_ylim()[0]
        for i, (name, t, y) in enumerate(lines):
            first = lines[0][0] == "tool"
            style = {"color": INK, "lw": 1.6} if first and i == 0 else _line(i - first)
            ax.plot(*curves.thin(t, np.maximum(np.abs(y), floor), _NOISY), label=name, **style)
        for value in sorted(set(limits.values())):
            limit_line(ax, value, f"tolerance {quantity(value, unit)}")
        _mark_worst(ax, unit, lines, min(limits.values(), default=np.inf))
        ax.set_ylabel(title)
        if len(lines) > 1:
            legend_beside(ax)
    return figure


def rcm(report: Report) -> Figure | None:
    """Draw the distance of the shaft axis from the registered RCM, and the maximum allowed distance."""
    found = curves.pair(report, "rcm_error")
    if found is None or found[1].ndim != 1:
        return None
    t, y = found
    limit = curves.rcm_tolerance(report)
    figure, axes = panels(headline("RCM error", report), [2.0], 1, head=0.62)
    phase_bands(axes, report.phases)
    ax = axes[0][0]
    log_axis(ax, "m", [y], [limit] if limit else [])
    ax.plot(*curves.thin(t, np.maximum(y, ax.get_ylim()[0]), _NOISY), color=PALETTE[0])
    limit_line(ax, limit, f"allowed {quantity(limit, 'm')}")
    k = int(np.nanargmax(y))
    mark(ax, float(t[k]), float(y[k]), at(y[k], "m", t[k]), UNFIT if limit and y[k] > limit else INK)
    ax.set_ylabel("shaft axis to RCM")
    return figure


def fulcrum(report: Report) -> Figure | None:
    """Draw the sideways displacements of the tip and of a point of the outer shaft; the two have opposite signs."""
    found = curves.pair(report, "fulcrum")
    if found is None or found[1].ndim != 2 or np.nanmax(found[1][:, 0]) - np.nanmin(found[1][:, 0]) < MM:
        return None  # the tip moves sideways by less than 1 mm
    t, y = found[0], found[1] / MM
    figure, axes = panels(headline("Fulcrum", report), [2.0], 1)
    ax = axes[0][0]
    ax.axhline(0, color=INK, lw=0.6)
    ax.plot(*curves.thin(t, y[:, 0]), color=PALETTE[0], label="tip")
    ax.plot(*curves.thin(t, y[:, 1]), color=PALETTE[1], label=f"shaft, {OUTSIDE / MM:g} mm outside the trocar")
    ax.set_ylabel("sideways [mm]")
    legend_above(ax)
    return _finish(figure, axes, report)


def margins(report: Report) -> Figure | None:
    """Draw over time: distance to the nearest joint limit, distances to the end of the reach, singularity measures."""
    limit = curves.pair(report, "limit_margin")
    reach = list(curves.named(report, "reach"))
    measures = list(curves.named(report, "singularity"))
    groups = [
        ("joint limits", [("nearest joint", *limit)] if limit and limit[1].ndim == 1 else []),
        ("reach", reach),
        ("singularity", measures),
    ]
    groups = [g for g in groups if g[1]]
    if not groups:
        return None
    heights = [1.5 if title != "singularity" else 2.1 for title, _ in groups]
    figure, axes = panels(headline("Margins", report), heights, 1, _SIDE, 0.62, 0.25)
    phase_bands(axes, report.phases)
    for (ax,), (title, lines) in zip(axes, groups, strict=True):
        if title == "singularity":
            _draw_measures(ax, lines, curves.alarms(report))
        else:
            for i, (name, t, y) in enumerate(lines):
                ax.plot(*curves.thin(t, y / MM), label=name, **_line(i))
            ax.set_ylabel(f"{title} [mm]")
            _zero_based(ax, [y / MM for _, _, y in lines])
            _mark_least(ax, [(t, y / MM) for _, t, y in lines], lambda v: quantity(v * MM, "m"))
        legend_beside(ax)
    return figure


def clearance(report: Report) -> Figure | None:
    """Draw the minimum distance between two bodies over time; pairs of bodies that touch by design are excluded."""
    found = curves.pair(report, "clearance", "clearance_t")
    if found is None or found[1].ndim != 1:
        return None
    t, y = found[0], found[1] / MM
    figure, axes = panels(headline("Minimum clearance", report), [1.8], 1, head=0.62)
    phase_bands(axes, report.phases)
    ax = axes[0][0]
    ax.plot(*curves.thin(t, y), color=PALETTE[0])
    _zero_based(ax, [y])
    _mark_least(ax, [(t, y)], lambda v: quantity(v * MM, "m"))
    ax.set_ylabel("clearance [mm]")
    return figure


def path_cost(report: Report) -> Figure | None:
    """Draw the path cost over the number of samples of the search, for each phase with a searched path."""
    searches = {p.name: p.rounds for p in report.phases if p.rounds is not None}
    return rounds.figure(headline("Paths around obstacles", report), searches) if searches else None


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
    with styled():
        drawn = {name: draw(report) for name, draw in PLOTS.items()}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _line(i: int) -> dict:
    dashes = ("-", (0, (4, 1.5)), (0, (1.5, 1.2)))
    return {"color": PALETTE[i % len(PALETTE)], "ls": dashes[i // len(PALETTE) % len(dashes)]}


def _finish(figure: Figure, axes: list[list[Axes]], report: Report) -> Figure:
    phase_bands(axes, report.phases)
    for row in axes:
        for ax in row:
            ax.margins(y=0.08)
    return figure


def _angles(report: Report, key: str, times: str) -> list[tuple[Array, Array]] | None:
    found = curves.pair(report, key, times)
    if found is None or found[1].ndim != 2 or len(found[0]) < 3:
        return None
    t, angles = found[0], np.unwrap(found[1], axis=0)
    rate = np.gradient(angles, t, axis=0)
    return [(t, angles), (t, rate), (t, np.gradient(rate, t, axis=0))]


def _draw_xyz(
    ax: Axes,
    line: tuple[Array, Array] | None,
    reference: tuple[Array, Array] | None,
    names: str,
    factor: float,
) -> None:
    for i, name in enumerate(names):
        if line is not None and line[1].ndim == 2:
            ax.plot(*curves.thin(line[0], line[1][:, i] / factor), color=XYZ[i], lw=1.8, label=name)
    for i in range(len(names)):
        if reference is not None and reference[1].ndim == 2:
            t, y = curves.thin(reference[0], reference[1][:, i] / factor, 400)
            ax.plot(t, y, color=INK, lw=1.0, ls=(0, (3, 3)), label="" if i else "mechanism (B)")


def _draw_measures(ax: Axes, lines: list[tuple[str, Array, Array]], alarms: dict[str, float]) -> None:
    """Draw the absolute value of each measure, divided by its alarm value; all but the five smallest are grey."""
    known = [(name, t, np.abs(y) / alarms.get(name, 1.0)) for name, t, y in lines]
    known.sort(key=lambda line: float(np.nanmin(line[2])))
    for i, (name, t, y) in enumerate(known):
        near = i < 5 or len(known) <= 6
        style = _line(i) if near else {"color": "#9aa5b1", "lw": 0.9}
        label = name if near else f"{len(known) - 5} others" if i == 5 else ""
        ax.plot(*curves.thin(t, y), label=label, zorder=2 if near else 1.5, **style)
    log = alarms and max(float(np.nanmax(y)) for _, _, y in known) > 20
    if log:
        ax.set_yscale("log")
    else:
        _zero_based(ax, [y for _, _, y in known])
    if alarms:
        limit_line(ax, 1.0, "alarm", NEAR)
        ax.set_ylabel("singularity / alarm")
    else:
        ax.set_ylabel("singularity")
    _mark_least(ax, [(t, y) for _, t, y in known[:1]], lambda v: f"{v:.3g}")


def _zero_based(ax: Axes, values: list[Array]) -> None:
    """Begin the y axis at zero, or below zero if a value is negative."""
    low = min(float(np.nanmin(v)) for v in values)
    high = max(float(np.nanmax(v)) for v in values)
    ax.set_ylim(min(0.0, 1.15 * low), max(high, 0.0) * 1.12 or 1.0)
    if low < 0:
        ax.axhspan(ax.get_ylim()[0], 0, color=UNFIT, alpha=0.12, lw=0)
        ax.axhline(0, color=UNFIT, lw=1.0)


def _mark_least(ax: Axes, lines: list[tuple[Array, Array]], text: Callable[[float], str]) -> None:
    t, y = min(lines, key=lambda line: float(np.nanmin(line[1])))
    k = int(np.nanargmin(y))
    mark(
        ax,
        float(t[k]),
        float(y[k]),
        f"{text(float(y[k]))} at {seconds(float(t[k]))}",
        UNFIT if y[k] < 0 else INK,
        below=True,
    )


def _mark_worst(ax: Axes, unit: str, lines: list[tuple[str, Array, Array]], limit: float) -> None:
    """Mark the largest residual, in red if it exceeds its tolerance."""
    name, t, y = max(lines, key=lambda line: float(np.nanmax(np.abs(line[2]))))
    k = int(np.nanargmax(np.abs(y)))
    value = float(abs(y[k]))
    if value <= 0:
        return
    text = at(value, unit, float(t[k]))
    text = f"{name}: {text}" if len(lines) > 1 else text
    mark(ax, float(t[k]), value, text, UNFIT if value > limit else FIT)
