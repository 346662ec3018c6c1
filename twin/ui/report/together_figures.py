"""Draw the distances between arms that are planned together, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from twin.core.format import quantity, seconds
from twin.core.units import MM
from twin.planning.group_result import PlannedTogether
from twin.ui.report.scene_figures import MIN_DRAWN_DISTANCE, RobotPhases, distances
from twin.ui.report.style import mark_sample, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled()
def figure(planned: PlannedTogether) -> Figure:
    """Return a figure with two panels: distance of each pair of arms over time, and phases of each arm."""
    title = f"Clearance between arms · {', '.join(planned.order)} in scene {planned.scene.name}"
    rows = []
    for name in planned.order:
        phases = [(phase.t0, phase.t1) for phase in planned.robots[name].phases]
        rows.append(RobotPhases(name, phases))
    clearances = planned.arm_distances
    pairs = {pair: clearance.distance for pair, clearance in clearances.by_pair.items()}
    drawing = distances(title, clearances.t, pairs, planned.required, rows)
    least, t, _ = clearances.least()
    mark_sample(
        drawing.axes[0], t, max(least / MM, MIN_DRAWN_DISTANCE), f"{quantity(least, 'm')} at {seconds(t)}", below=True
    )
    return drawing
