"""Plot the distance between the tips of machine and model in a panel, and name the joint that differs most."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import viser

from twin.core.units import DEG, MM
from twin.model.joint import Joint

_SECONDS, _EVERY = 12.0, 0.1
"""Time span in s that the curve shows; time in s between two points of the curve."""

_COLORS = ("#0a66c2", "#c7741b")


class DeviationCurve:
    """Plot of the distance in mm between the tips of each machine and its model, over the last `_SECONDS` s.

    A dashed line marks the limit, if there is one.
    """

    def __init__(self, gui: viser.GuiApi, names: Sequence[str], limit: float | None = None) -> None:
        """Add an empty plot for the machines `names`; `limit` in m is the deviation at which the force cue begins."""
        self._limit = None if limit is None else limit / MM
        self._rows: list[list[float]] = []
        lines: list[Any] = [{"label": n, "stroke": _COLORS[i % 2], "width": 2} for i, n in enumerate(names)]
        if limit is not None:
            label = f"force cue above {limit / MM:g} mm"
            lines.append({"label": label, "stroke": "#d62f2f", "dash": [4, 3], "width": 1})
        self._curve = gui.add_uplot(
            tuple(np.zeros((len(lines) + 1, 1))),
            ({"label": "s"}, *lines),
            title="Deviation of the tips [mm]",
            scales={"x": {"time": False}, "y": {"auto": True}},
            aspect=1.6,
        )

    def due(self, t: float) -> bool:
        """Return whether the next point is due at time t in s."""
        return not self._rows or t >= self._rows[-1][0] + _EVERY

    def add(self, t: float, tips: Iterable[float]) -> None:
        """Add the distance in m between the tips of each machine and its model, at time t in s."""
        row = [t, *(tip / MM for tip in tips)]
        self._rows.append(row if self._limit is None else [*row, self._limit])
        self._rows = [r for r in self._rows if r[0] > t - _SECONDS]
        self._curve.data = tuple(np.array(self._rows).T.copy())


def largest(apart: Sequence[float], joints: Sequence[Joint]) -> str:
    """Return a text on the joint whose difference is largest; `apart` (n,) are the joint differences in rad or m."""
    shown = [(abs(v) / (DEG if j.is_angle else MM), j) for v, j in zip(apart, joints, strict=True)]
    size, joint = max(shown, key=lambda pair: pair[0])
    return f"Largest joint difference: {joint.name} {size:.2f}{'°' if joint.is_angle else ' mm'}"
