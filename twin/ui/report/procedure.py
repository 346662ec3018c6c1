"""Draw the measured values of a procedure over time, and the ends of its stages.

The values are the lift of the organ, the largest pull of a tool, the visible fraction of the vessel, the detached
fraction of the organ's bed, and the depth of the tools in other organs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.api.procedure import ProcedureSession
from twin.core.spoken import spoken
from twin.core.units import MM
from twin.ui.report.curves import thin
from twin.ui.report.style import GRID, INK, PALETTE, WIDTH, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 1500
"""Maximum number of points of a curve, because the page contains all points."""


@styled()
def figure(found: ProcedureSession) -> Figure:
    """Return a figure with one row for each measured value, and a vertical line at the end of each stage."""
    from matplotlib.figure import Figure

    kept, p = found.ran.kept, found.procedure
    nodes = kept[f"{p.organ}.nodes"].reshape(len(kept.t), -1, 3)
    middle = np.einsum("j,tjk->tk", found.organ.weights.mean(axis=0), nodes)
    pulls = np.max([np.linalg.norm(kept[f"{n}.pull"], axis=1) for n in found.measures.paths], axis=0)
    depth = np.max([kept[f"{n}.depth"][:, 0] for n in p.spare], axis=0)
    # name, values, limit, minimum for the upper end of the axis (so that small noise looks like a straight line)
    rows = (
        (f"{spoken(p.organ)} raised [mm]", (middle[:, 2] - middle[0, 2]) / MM, None, p.lift_mm),
        ("pull [N]", pulls, None, 1.0),
        (f"share of {spoken(p.vessel)} seen", kept[f"{p.vessel}.seen"][:, 0], p.seen, 1.0),
        ("share of bed detached", kept[f"{p.organ}.freed"].mean(axis=1), None, 1.0),
        ("depth in organs [mm]", depth / MM, p.depth_mm, p.depth_mm),
    )
    out = Figure(figsize=(WIDTH, 1.1 + 1.05 * len(rows)), layout="constrained")
    axes = out.subplots(len(rows), 1, sharex=True)
    for ax, (name, values, limit, shown) in zip(axes, rows, strict=True):
        ax.plot(*thin(kept.t, values, _POINTS), color=PALETTE[0], lw=1.0)
        low, high = min(0.0, float(values.min())), max(shown, float(values.max()))
        ax.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
        if limit is not None:
            ax.axhline(limit, color=PALETTE[1], lw=0.8, ls="--")
        ax.set_ylabel(name, fontsize=8, rotation=0, ha="right", va="center")
        ax.grid(color=GRID, lw=0.4)
        for check in found.measures.checks:
            if check.t is not None:
                ax.axvline(check.t, color=INK, lw=0.6)
    passed = [c for c in found.measures.checks if c.t is not None]
    for k, check in enumerate(passed):  # at two heights, so that two stages soon after each other can be read
        place = (check.t, 1.0 + 0.13 * (k % 2))
        axes[0].annotate(check.name, place, xycoords=("data", "axes fraction"), fontsize=8, ha="center", va="bottom")
    axes[-1].set_xlabel("time [s]")
    who = "a person" if found.seed is None else f"simulated surgeon, seed {found.seed}"
    out.suptitle(f"{found.scene.name}: {found.task.name}, {who}", fontsize=10, fontweight="bold", x=0.01, ha="left")
    return out
