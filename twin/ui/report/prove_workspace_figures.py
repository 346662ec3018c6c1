"""Draw the boxes of tool positions that are proved regular: sections through the middle of all boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.analysis.proven_workspace import ProvenWorkspace
from twin.core.units import MM
from twin.ui.report.style import PALETTE, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SECTION_AXES = ((0, 1, 2), (0, 2, 1), (1, 2, 0))
"""Axes (0, 1, 2 for x, y, z) of each section: horizontal axis, vertical axis, axis normal to the section."""


@styled()
def figure(workspace: ProvenWorkspace) -> Figure | None:
    """Return three sections of the proved boxes, by planes through their common middle; None if there is no box."""
    if not len(workspace.proof.low):
        return None
    drawing = titled_figure(f"{workspace.robot}: tool positions proved assembled, within limits and not singular", 3.6)
    axes = drawing.subplots(1, len(_SECTION_AXES))
    drawing.subplots_adjust(left=0.08, right=0.98, top=0.78, bottom=0.16, wspace=0.4)
    for ax, section in zip(axes.flat, _SECTION_AXES, strict=True):
        _draw_section(ax, workspace, section)
    return drawing


def _draw_section(ax: Axes, workspace: ProvenWorkspace, section: tuple[int, int, int]) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    across, up, normal = section
    low = workspace.proof.low / MM
    high = workspace.proof.high / MM
    volumes = np.prod(high - low, axis=1)
    middle = np.average((low + high) / 2, axis=0, weights=volumes)
    cut = (low[:, normal] <= middle[normal]) & (middle[normal] < high[:, normal])
    boxes = []
    for first, last in zip(low[cut], high[cut], strict=True):
        sizes = last - first
        boxes.append(Rectangle((first[across], first[up]), sizes[across], sizes[up]))
    ax.add_collection(PatchCollection(boxes, facecolor=PALETTE[0], edgecolor="white", linewidth=0.3))
    ax.set_xlim(low[:, across].min(), high[:, across].max())
    ax.set_ylim(low[:, up].min(), high[:, up].max())
    ax.set_aspect("equal")
    names = "xyz"
    ax.set_xlabel(f"{names[across]} [mm]")
    ax.set_ylabel(f"{names[up]} [mm]")
    ax.set_title(f"{names[normal]} = {middle[normal]:.0f} mm")
