"""Find out which targets of a task the tips touched, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.task import ConsoleTask, required_goal
from twin.simulation.session.movement import runs
from twin.simulation.tasks.target.task import Targets


@dataclass(frozen=True)
class Touched:
    """Result of one target.

    Attributes:
        name: name of the target.
        t: time in s at which the touch was complete; None: the target was not touched.
        nearest: smallest error in m since the previous touch was complete. The error is the distance between a tip and
            its point; if there are two tips, the larger distance.
    """

    name: str
    t: float | None
    nearest: float


def touched(task: ConsoleTask, t: Array, tips: Mapping[str, Array]) -> list[Touched]:
    """Return the result of every target of a task, in order; a touch counts only after the previous touch is complete.

    Args:
        task: the task.
        t: (k,) times in s, evenly spaced.
        tips: {hand: positions (k, 3) of its tip in m in the World}.
    """
    dt = float(t[1] - t[0]) if len(t) > 1 else np.inf
    results = []
    begin = 0
    for target in required_goal(task, Targets).targets:
        distances = []
        for hand, p in target.p_world.items():
            distances.append(np.linalg.norm(tips[hand][begin:] - p, axis=1))
        error = np.max(distances, axis=0)
        nearest = float(error.min()) if len(error) else np.nan
        first = _first_touch(error, task, dt)
        if first is None:
            results.append(Touched(target.name, None, nearest))
            continue
        begin += first + round(task.hold / dt)
        results.append(Touched(target.name, float(t[begin]), nearest))
    return results


def _first_touch(error: Array, task: ConsoleTask, dt: float) -> int | None:
    """Return the first sample of the first touch that is long enough; error (k,) in m, every dt in s."""
    shortest = task.hold - 1e-9  # rounding of the times
    for first, last in runs(error <= task.tolerance):
        if (last - first) * dt >= shortest:
            return first
    return None
