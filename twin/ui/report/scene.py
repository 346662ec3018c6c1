"""Draw the clearances of a scene: between robots, and between robots and props."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.core.units import MM
from twin.simulation.scene_play import Played
from twin.ui.report.style import BAND, PALETTE, UNFIT, log_ticks, sheet, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEAST = 0.1
"""Smallest drawn distance in mm; smaller distances are drawn at this value."""


@styled()
def figure(played: Played) -> Figure:
    """Return a figure with two panels: distance of each pair of robots or props over time, and phases of each robot."""
    scene, actors = played.scene, played.actors
    height = 4.6 + 0.32 * len(actors)
    out = sheet(f"{scene.title}: minimum clearances", height)
    top, below = out.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [4, 0.45 * len(actors)], "hspace": 0.12})
    out.subplots_adjust(left=0.09, right=0.8, top=1 - 0.5 / height, bottom=0.5 / height)
    for color, ((a, b), d) in zip(PALETTE, played.by_pair.items(), strict=False):
        top.plot(played.t, np.maximum(d.distance / MM, _LEAST), color=color, label=f"{a} - {b}")
    top.axhline(scene.clearance / MM, color=UNFIT, linestyle="--", linewidth=0.9)
    top.annotate(
        f"required: {scene.clearance / MM:g} mm", (0, scene.clearance / MM), (3, 3), textcoords="offset points",
        color=UNFIT, fontsize=8,
    )  # fmt: skip
    log_ticks(top, [0.1, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000], lambda v: f"{v:g}")
    top.set_ylabel("distance [mm]")
    top.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    for i, a in enumerate(actors):
        for k, phase in enumerate(a.trajectory.phases):
            below.barh(i, phase.t1 - phase.t0, left=phase.t0, color=BAND if k % 2 else PALETTE[5], height=0.7)
    below.set_yticks(range(len(actors)), [a.place.name for a in actors])
    below.invert_yaxis()
    below.grid(visible=False)
    below.set_xlabel("time [s]; each block is a phase")
    below.set_xlim(0, played.t[-1])
    return out
