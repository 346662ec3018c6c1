"""Draw a workspace: sections through the best conditioned region; size as a function of the minimum conditioning."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import Workspace
from twin.core.json_types import JsonMapping
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import MM
from twin.ui.report.style import INK, PALETTE, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SECTION_AXES = ((0, 1, 2), (0, 2, 1), (1, 2, 0))
"""Axes (0, 1, 2 for x, y, z) of each section: horizontal axis, vertical axis, axis normal to the section."""


@styled()
def figure(workspace: Workspace) -> Figure:
    """Return a figure with sections of the workspace, and the workspace size as a function of minimum conditioning.

    There are three sections, or one if all positions are in one plane. If no condition number was computed, the margin
    to the joint limits is drawn instead of the conditioning.
    """
    cube = workspace.cube
    reached = cube[..., 0] > 0
    everywhere = cube[..., 0] == 1
    inverse_condition = cube[..., 1]
    if inverse_condition.any():
        label = "inverse condition number"
        values = inverse_condition
    else:
        label = "margin to the joint limits"
        values = cube[..., 2]
    values = np.where(reached, values, np.nan)
    cut = _cut(reached, values)
    top = 1.0
    if reached.any():
        top = float(np.nanquantile(values, 0.995))  # a few singular values must not make all others dark

    if len(workspace.grid.axes) == 3:
        sections = _SECTION_AXES
        rows = 2
        column_gap = 0.28
        bar_place = (0.915, 0.55, 0.014, 0.33)
    else:
        sections = (_flat(workspace.grid.axes),)
        rows = 1
        column_gap = 0.55  # with room for the colour bar between the two panels
        bar_place = (0.42, 0.16, 0.014, 0.55)
    drawing = titled_figure(f"{workspace.robot}: workspace of the tool{_around(workspace.content())}", 3.7 * rows)
    axes = drawing.subplots(rows, 2)
    drawing.subplots_adjust(left=0.08, right=0.9, top=1 - 0.2 / rows, bottom=0.16 / rows, hspace=0.3, wspace=column_gap)
    for ax, section in zip(axes.flat, sections, strict=False):
        _draw_section(ax, workspace.grid, values, cut, section, top)
    bar = drawing.add_axes(bar_place)
    drawing.colorbar(axes.flat[0].images[0], cax=bar)
    bar.set_title(label.replace(" ", "\n"), fontsize=7.5, loc="left")
    _sizes(axes.flat[-1], values[reached], values[everywhere], workspace, label)
    return drawing


def _draw_section(
    ax: Axes, grid: PoseGrid, values: Array, cut: tuple[int, int, int], section: tuple[int, int, int], top: float
) -> None:
    """Draw the values of the cells of one section as colours from 0 to `top`."""
    a, b, c = section
    plane = np.take(values, cut[c], axis=c)
    # outer edges in mm of the first and the last cell along each axis; `low` is the centre of the first
    first = (grid.low - grid.step / 2) / MM
    last = (grid.low + (np.array(values.shape) - 0.5) * grid.step) / MM
    extent = (first[a], last[a], first[b], last[b])
    ax.imshow(plane.T, origin="lower", extent=extent, cmap="viridis", vmin=0, vmax=top)
    position = (grid.low[c] + grid.step * cut[c]) / MM
    ax.set_title(f"{'xyz'[c]} = {position:.0f} mm", fontsize=9, color=INK, loc="left")
    ax.set_xlabel(f"{'xyz'[a]} [mm]")
    ax.set_ylabel(f"{'xyz'[b]} [mm]")
    ax.grid(visible=False)
    ax.locator_params(nbins=5)


def _flat(axes: tuple[int, ...]) -> tuple[int, int, int]:
    """Return the section that contains all positions, if the positions differ only along `axes`."""
    for section in _SECTION_AXES:
        if set(axes) <= set(section[:2]):
            return section
    raise AssertionError(f"no section contains the axes {axes}")


def _around(summary: JsonMapping) -> str:
    """Return the part of the title on the orientations of the tool."""
    if summary.get("sampled") == "joints":
        return f", {summary['samples']:.3g} joint positions"
    if summary["orientations"] == 1:
        return " in one orientation"
    return f", {summary['orientations']} orientations within {summary['tilt_deg']:g}° about each axis"


def _cut(reached: np.ndarray, values: Array) -> tuple[int, int, int]:
    """Return the indices (3,) of the cell in which the sections intersect: the most central of the best 10 %."""
    if not reached.any():
        return (0, 0, 0)
    best = reached & (np.nan_to_num(values) >= np.nanquantile(values, 0.9))
    cells = np.argwhere(best)
    middle = np.median(cells, axis=0)
    distances = ((cells - middle) ** 2).sum(axis=1)
    i, j, k = cells[np.argmin(distances)].tolist()
    return i, j, k


def _sizes(ax: Axes, somewhere: Array, everywhere: Array, workspace: Workspace, label: str) -> None:
    """Draw the total size of the cells whose conditioning is at least a minimum, as a function of this minimum.

    `somewhere` and `everywhere` are the values of the cells that are reached in at least one and in every orientation.
    """
    cell = 1.0
    unit = "number of cells"
    measure = workspace.measure
    if measure is not None:
        cell = measure.cell(workspace.grid.step)
        unit = f"{measure.name} [{measure.symbol}]"
    _draw_sizes(ax, somewhere, cell, color=PALETTE[0], label="in at least one orientation")
    if len(everywhere) < len(somewhere):
        _draw_sizes(ax, everywhere, cell, color=PALETTE[1], label="in every orientation")
        ax.legend(loc="upper right")
    ax.set_xlabel(f"minimum {label}")
    ax.set_ylabel(unit)
    ax.set_ylim(bottom=0)
    ax.set_xlim(left=0)


def _draw_sizes(ax: Axes, values: Array, cell: float, **style: Any) -> None:
    """Draw the total size of the cells with at least a value over this value; `cell` is the size of one cell."""
    ordered = np.sort(values.astype(float))
    count = len(ordered)
    if not count:
        ax.plot([], [], **style)
        return
    shown_points = spread(count, 400)  # the page contains all points
    ax.plot(ordered[shown_points], cell * (count - shown_points), **style)
