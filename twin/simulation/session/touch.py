"""Find out which targets of a task the tips touched, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.task import Task
from twin.simulation.session.movement import runs


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


def touched(task: Task, t: Array, tips: Mapping[str, Array]) -> list[Touched]:
    """Return the result of every target of a task, in order; a touch counts only after the previous touch is complete.

    Args:
        task: the task.
        t: (k,) times in s, evenly spaced.
        tips: {hand: positions (k, 3) of its tip in m in the World}.
    """
    dt = float(t[1] - t[0]) if len(t) > 1 else np.inf
    out, begin = [], 0
    for target in task.targets:
        off = np.max([np.linalg.norm(tips[h][begin:] - p, axis=1) for h, p in target.p_world.items()], axis=0)
        done = next((a for a, b in runs(off <= task.tolerance) if (b - a) * dt >= task.hold - 1e-9), None)
        nearest = float(off.min()) if len(off) else np.nan
        if done is None:
            out.append(Touched(target.name, None, nearest))
            continue
        begin += done + round(task.hold / dt)
        out.append(Touched(target.name, float(t[begin]), nearest))
    return out
