"""Draw the clearances of a scene: between robots, and between robots and props."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.simulation.scene_play import Played
from twin.ui.report.style import BAND, PALETTE, UNFIT, log_ticks, styled, titled_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MIN_DRAWN_DISTANCE = 0.1
"""Smallest drawn distance in mm; smaller distances are drawn at this value."""

_LINE_STYLES = ("-", ":", "-.")
"""Line styles; the next style is used when all colours have been used with the present style."""


@dataclass(frozen=True)
class RobotPhases:
    """Name of a robot, and (start, end) in s of each of its phases."""

    name: str
    phases: Sequence[tuple[float, float]]


@styled()
def figure(played: Played) -> Figure:
    """Return a figure with two panels: distance over time of each pair of robots or props; phases of each robot."""
    rows = []
    for actor in played.actors:
        phases = [(phase.t0, phase.t1) for phase in actor.trajectory.phases]
        rows.append(RobotPhases(actor.place.name, phases))
    pairs = {pair: clearance.distance for pair, clearance in played.by_pair.items()}
    return distances(f"{played.scene.title}: minimum clearances", played.t, pairs, played.scene.clearance, rows)


def distances(
    title: str, t: Array, pairs: Mapping[tuple[str, str], Array], required: float, rows: Sequence[RobotPhases]
) -> Figure:
    """Return a figure with two panels: distances of pairs over time, and phases of robots.

    `pairs` has the distances (k,) in m of each pair at the times t (k,) in s; `required` is the required distance in m.
    """
    height = 4.6 + 0.32 * len(rows)
    drawing = titled_figure(title, height)
    spaces = {"height_ratios": [4, 0.45 * len(rows)], "hspace": 0.12}
    top, below = drawing.subplots(2, 1, sharex=True, gridspec_kw=spaces)
    names = [row.name for row in rows]
    longest = max(map(len, names))
    left_margin = max(0.09, 0.025 + 0.0075 * longest)  # room for the names
    drawing.subplots_adjust(left=left_margin, right=0.8, top=1 - 0.5 / height, bottom=0.5 / height)
    for k, ((a, b), distance) in enumerate(pairs.items()):
        repetition, color = divmod(k, len(PALETTE))
        style = _LINE_STYLES[repetition % len(_LINE_STYLES)]
        shown_distances = np.maximum(distance / MM, MIN_DRAWN_DISTANCE)
        top.plot(t, shown_distances, style, color=PALETTE[color], label=f"{a} - {b}")
    required_mm = required / MM
    top.axhline(required_mm, color=UNFIT, linestyle="--", linewidth=0.9)
    top.annotate(
        f"required: {required_mm:g} mm",
        (0, required_mm),
        (3, 3),
        textcoords="offset points",
        color=UNFIT,
        fontsize=8,
    )
    log_ticks(top, [0.1, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000], lambda v: f"{v:g}")
    top.set_ylabel("distance [mm]")
    top.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    for i, row in enumerate(rows):
        for k, (start, end) in enumerate(row.phases):
            color = BAND if k % 2 else PALETTE[5]
            below.barh(i, end - start, left=start, color=color, height=0.7)
    below.set_yticks(range(len(rows)), names)
    below.invert_yaxis()
    below.grid(visible=False)
    below.set_xlabel("time [s]; each block is a phase")
    below.set_xlim(0, t[-1])
    return drawing
