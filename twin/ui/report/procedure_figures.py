"""Draw the measured values of a procedure over time, and the ends of its stages.

The values are the lift of the organ, the largest pull of a tool, the visible fraction of the vessel, the detached
fraction of the organ's bed, and the depth of the tools in other organs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.api.procedure import ProcedureSession
from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import MM
from twin.simulation.world.signal_kinds import ORGAN_DEPTH, ORGAN_FREED, ORGAN_NODES, ROBOT_PULL, VESSEL_SEEN
from twin.ui.report.plot_data import thinned_curve
from twin.ui.report.session_figures import operator_text
from twin.ui.report.style import GRID, INK, PALETTE, WIDTH, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_CURVE_POINTS = 1500
"""Maximum number of points of a curve, because the page contains all points."""


@styled()
def figure(session: ProcedureSession) -> Figure:
    """Return a figure with one row for each measured value, and a vertical line at the end of each stage."""
    from matplotlib.figure import Figure

    t = session.run.recording.t
    rows = _measured_curves(session)
    passed = []
    for check in session.measures.checks:
        if check.t is not None:
            passed.append(check)
    drawing = Figure(figsize=(WIDTH, 1.1 + 1.05 * len(rows)), layout="constrained")
    axes = drawing.subplots(len(rows), 1, sharex=True)
    for ax, row in zip(axes, rows, strict=True):
        t_drawn, values = thinned_curve(t, row.values, _MAX_CURVE_POINTS)
        ax.plot(t_drawn, values, color=PALETTE[0], lw=1.0)
        low = min(0.0, float(row.values.min()))
        high = max(row.top, float(row.values.max()))
        room = 0.08 * (high - low)
        ax.set_ylim(low - room, high + room)
        if row.limit is not None:
            ax.axhline(row.limit, color=PALETTE[1], lw=0.8, ls="--")
        ax.set_ylabel(row.name, fontsize=8, rotation=0, ha="right", va="center")
        ax.grid(color=GRID, lw=0.4)
        for check in passed:
            ax.axvline(check.t, color=INK, lw=0.6)
    for k, check in enumerate(passed):
        # at two heights, so that two stages soon after each other can be read
        height = 1.0 + 0.13 * (k % 2)
        axes[0].annotate(
            check.name,
            (check.t, height),
            xycoords=("data", "axes fraction"),
            fontsize=8,
            ha="center",
            va="bottom",
        )
    axes[-1].set_xlabel("time [s]")
    title = f"{session.scene.name}: {session.task.name}, {operator_text(session.seed)}"
    drawing.suptitle(title, fontsize=10, fontweight="bold", x=0.01, ha="left")
    return drawing


@dataclass(frozen=True)
class _MeasuredCurve:
    """A measured value over time, with its limit.

    The axis extends at least to `top`, so that small noise looks like a straight line.
    """

    name: str
    values: Array
    limit: float | None
    top: float


def _measured_curves(session: ProcedureSession) -> list[_MeasuredCurve]:
    """Return the measured values of a session."""
    log = session.run.recording
    procedure = session.procedure
    organ = spoken(procedure.organ)
    vessel = spoken(procedure.vessel)
    nodes = log[ORGAN_NODES.of(procedure.organ)].reshape(len(log.t), -1, 3)
    # the weights of a vertex by nodes: their mean over the vertices gives the middle of the surface
    middle = np.einsum("j,tjk->tk", session.organ.weights.mean(axis=0), nodes)
    lift = (middle[:, 2] - middle[0, 2]) / MM
    pulls = []
    for robot in session.measures.paths:
        pulls.append(np.linalg.norm(log[ROBOT_PULL.of(robot)], axis=1))
    depths = [log[ORGAN_DEPTH.of(spared)][:, 0] for spared in procedure.spare]
    visible = log[VESSEL_SEEN.of(procedure.vessel)][:, 0]
    freed = log[ORGAN_FREED.of(procedure.organ)].mean(axis=1)
    return [
        _MeasuredCurve(f"{organ} raised [mm]", lift, None, procedure.lift_mm),
        _MeasuredCurve("pull [N]", np.max(pulls, axis=0), None, 1.0),
        _MeasuredCurve(f"share of {vessel} seen", visible, procedure.seen, 1.0),
        _MeasuredCurve("share of bed detached", freed, None, 1.0),
        _MeasuredCurve("depth in organs [mm]", np.max(depths, axis=0) / MM, procedure.depth_mm, procedure.depth_mm),
    ]
