"""Draw the tool's position error over the range of each joint, on a logarithmic axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from twin.core.units import DEG, MM, UM
from twin.ui.report.style import PALETTE, log_ticks, styled, titled_figure
from twin.validation.stroke_result import Strokes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MIN_ERROR = 1e-9
"""Lower end of the axis in µm; smaller position errors are rounding errors and are drawn at this end."""

_ERROR_LABELS = {-9: "1 fm", -6: "1 pm", -3: "1 nm", 0: "1 µm", 3: "1 mm"}
"""Axis label of a position error of 10**k µm, by exponent k."""


@styled()
def figure(strokes: Strokes) -> Figure:
    """Return a figure of the tool's position error over the range of each joint, with a panel for each joint."""
    sweeps = strokes.sweeps
    required = None
    if strokes.requirement is not None:
        required = strokes.requirement.position / UM
    top = _axis_end(strokes, required)
    height = 0.9 + 2.3 * len(sweeps)
    title = f"{strokes.robot}: position error of the tool over the range of each joint, the other joints at home"
    drawing = titled_figure(title, height)
    axes = drawing.subplots(len(sweeps), 1, squeeze=False)[:, 0]
    drawing.subplots_adjust(left=0.09, right=0.83, top=1 - 0.5 / height, bottom=0.55 / height, hspace=0.5)
    for ax, sweep in zip(axes, sweeps, strict=True):
        scale = MM
        unit = "mm"
        if sweep.angle:
            scale = DEG
            unit = "deg"
        x = sweep.q / scale
        curves = {"equations": sweep.equations, **sweep.standins}
        for color, (name, curve) in zip(PALETTE, curves.items(), strict=False):
            if len(curve.offset):
                error = np.maximum(curve.distance / UM, _MIN_ERROR)  # the axis is logarithmic
                ax.plot(x, error, color=color, label=name, linewidth=1.3)
        if required is not None:
            ax.axhline(required, color="#555555", linewidth=0.9, linestyle="--", label=f"required: {required:g} µm")
        log_ticks(ax, [10.0**k for k in range(-9, 6, 3)], _error_label)
        ax.set_ylim(_MIN_ERROR / 3, top)
        ax.set_ylabel("error")
        ax.set_xlabel(f"{sweep.joint} [{unit}]")
        ax.set_xlim(x[0], x[-1])
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    return drawing


def _axis_end(strokes: Strokes, required: float | None) -> float:
    """Return the upper end of the error axes in µm, ten times the largest error or requirement."""
    largest = 1e-3
    if required is not None:
        largest = max(largest, required)
    for sweep in strokes.sweeps:
        for curve in (sweep.equations, *sweep.standins.values()):
            if len(curve.offset):
                largest = max(largest, curve.distance.max() / UM)
    return 10 * largest


def _error_label(value: float) -> str:
    exponent = round(math.log10(value))
    return _ERROR_LABELS.get(exponent, "")
