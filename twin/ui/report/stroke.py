"""Draw the tool's position error over the range of each joint, on a logarithmic axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from twin.core.units import DEG, MM, UM
from twin.ui.report.style import PALETTE, log_ticks, sheet, styled
from twin.validation.sweep import Strokes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEAST = 1e-9
"""Lower end of the axis in µm; smaller position errors are rounding errors and are drawn at this end."""

_UNITS = {-9: "1 fm", -6: "1 pm", -3: "1 nm", 0: "1 µm", 3: "1 mm"}
"""Axis label of a position error of 10**k µm, by exponent k."""


@styled()
def figure(strokes: Strokes) -> Figure:
    """Return a figure of the tool's position error over the range of each joint, with a panel for each joint."""
    robot, sweeps, requirement = strokes.robot, strokes.sweeps, strokes.requirement
    drawn = [c.distance.max() / UM for s in sweeps for c in (s.formula, *s.standins.values()) if len(c.offset)]
    most = 10 * max(*drawn, requirement[0] / UM if requirement else 0.0, 1e-3)
    height = 0.9 + 2.3 * len(sweeps)
    title = f"{robot}: position error of the tool over the range of each joint, the other joints at home"
    out = sheet(title, height)
    axes = out.subplots(len(sweeps), 1, squeeze=False)[:, 0]
    out.subplots_adjust(left=0.09, right=0.83, top=1 - 0.5 / height, bottom=0.55 / height, hspace=0.5)
    for ax, one in zip(axes, sweeps, strict=True):
        x = one.q / (DEG if one.angle else MM)
        curves = {"equations": one.formula, **one.standins}
        for color, (name, curve) in zip(PALETTE, curves.items(), strict=False):
            if len(curve.offset):
                ax.plot(x, np.maximum(curve.distance / UM, _LEAST), color=color, label=name, linewidth=1.3)
        if requirement is not None:
            needed = requirement[0] / UM
            ax.axhline(needed, color="#555555", linewidth=0.9, linestyle="--", label=f"required: {needed:g} µm")
        log_ticks(ax, [10.0**k for k in range(-9, 6, 3)], lambda v: _UNITS.get(round(math.log10(v)), ""))
        ax.set_ylim(_LEAST / 3, most)
        ax.set_ylabel("error")
        ax.set_xlabel(f"{one.joint} [{'deg' if one.angle else 'mm'}]")
        ax.set_xlim(x[0], x[-1])
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    return out
