"""Draw a workspace: sections through the best conditioned region; size as a function of the minimum conditioning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.analysis.workspace import Workspace
from twin.core.units import MM
from twin.ui.report.style import INK, PALETTE, sheet, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SECTIONS = ((0, 1, 2), (0, 2, 1), (1, 2, 0))
"""Axes (0, 1, 2 for x, y, z) of each section: horizontal axis, vertical axis, axis normal to the section."""


@styled()
def figure(found: Workspace) -> Figure:
    """Return a figure with sections of the workspace, and the workspace size as a function of minimum conditioning.

    There are three sections, or one if all positions are in one plane. If no condition number was computed, the margin
    to the joint limits is drawn instead of the conditioning.
    """
    robot, low, step, summary = found.robot, found.grid.low, found.grid.step, found.content()
    cube = found.cube
    shape = cube.shape
    reached = cube[..., 0] > 0
    conditioned = bool(cube[..., 1].any())
    shown = np.where(reached, cube[..., 1 if conditioned else 2], np.nan)
    cut = _cut(reached, shown)
    most = float(np.nanquantile(shown, 0.995)) if reached.any() else 1.0

    sections = _SECTIONS if len(found.grid.axes) == 3 else (_flat(found.grid.axes),)
    rows = 2 if len(sections) > 1 else 1
    out = sheet(f"{robot}: workspace of the tool{_around(summary)}", 3.7 * rows)
    axes = out.subplots(rows, 2)
    out.subplots_adjust(left=0.08, right=0.9, top=1 - 0.2 / rows, bottom=0.16 / rows, hspace=0.3)
    out.subplots_adjust(wspace=0.28 if rows == 2 else 0.55)
    images = []
    for ax, (a, b, c) in zip(axes.flat, sections, strict=False):
        plane = np.take(shown, cut[c], axis=c)
        edges = [
            (low[a] - step / 2) / MM,
            (low[a] + (shape[a] - 0.5) * step) / MM,
            (low[b] - step / 2) / MM,
            (low[b] + (shape[b] - 0.5) * step) / MM,
        ]
        images.append(ax.imshow(plane.T, origin="lower", extent=edges, cmap="viridis", vmin=0, vmax=most))
        ax.set_title(f"{'xyz'[c]} = {(low[c] + step * cut[c]) / MM:.0f} mm", fontsize=9, color=INK, loc="left")
        ax.set_xlabel(f"{'xyz'[a]} [mm]")
        ax.set_ylabel(f"{'xyz'[b]} [mm]")
        ax.grid(visible=False)
        ax.locator_params(nbins=5)
    bar = out.add_axes((0.915, 0.55, 0.014, 0.33) if rows == 2 else (0.42, 0.16, 0.014, 0.55))
    out.colorbar(images[0], cax=bar)
    label = "inverse condition number" if conditioned else "margin to the joint limits"
    bar.set_title(label.replace(" ", "\n"), fontsize=7.5, loc="left")
    _sizes(axes.flat[-1], shown[reached], cube[reached], found, label)
    return out


def _flat(axes: tuple[int, ...]) -> tuple[int, int, int]:
    """Return the section that contains all positions, if the positions differ only along `axes`."""
    return next(s for s in _SECTIONS if set(axes) <= set(s[:2]))


def _around(summary: Mapping[str, Any]) -> str:
    if summary.get("sampled") == "joints":
        return f", {summary['samples']:.3g} joint positions"
    if summary["orientations"] == 1:
        return " in one orientation"
    return f", {summary['orientations']} orientations within {summary['tilt_deg']:g}° about each axis"


def _cut(reached: np.ndarray, shown: np.ndarray) -> tuple[int, int, int]:
    """Return the indices (3,) of the cell in which the sections intersect: the most central of the best 10 %."""
    if not reached.any():
        return (0, 0, 0)
    good = np.argwhere(reached & (np.nan_to_num(shown) >= np.nanquantile(shown, 0.9)))
    middle = np.median(good, axis=0)
    nearest = good[np.argmin(((good - middle) ** 2).sum(axis=1))]
    return (int(nearest[0]), int(nearest[1]), int(nearest[2]))


def _sizes(ax: Axes, shown: np.ndarray, values: np.ndarray, found: Workspace, label: str) -> None:
    """Draw the total size of the cells whose conditioning is at least a minimum, as a function of this minimum."""
    m = found.measure
    cell = m.cell(found.grid.step) if m is not None else 1
    share = values[:, 0].astype(float)
    ordered = np.sort(shown.astype(float))
    thin = np.unique(np.linspace(0, len(ordered) - 1, 400).astype(int)) if len(ordered) else np.zeros(0, int)
    ax.plot(ordered[thin], cell * (len(ordered) - thin), color=PALETTE[0], label="in at least one orientation")
    if (share < 1).any():
        full = np.sort(shown[share == 1].astype(float))
        thin = np.unique(np.linspace(0, len(full) - 1, 400).astype(int)) if len(full) else np.zeros(0, int)
        ax.plot(full[thin], cell * (len(full) - thin), color=PALETTE[1], label="in every orientation")
        ax.legend(loc="upper right")
    ax.set_xlabel(f"minimum {label}")
    ax.set_ylabel(f"{m.name} [{m.symbol}]" if m is not None else "number of cells")
    ax.set_ylim(bottom=0)
    ax.set_xlim(left=0)
