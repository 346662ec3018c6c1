"""Fit the free angle (swivel) of a redundant mechanism in each state, so that the rows' residuals are minimal."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.equation_steps import RowPlace

_GRID = 12
"""Number of start angles in a full turn."""

_REFINE = 6
_STEP = 1e-6
"""Step in rad of the numeric derivatives; `_REFINE` is the number of Gauss-Newton steps."""


def fitted(rows: Callable[[Array], Mapping[RowPlace, Array]], states: int) -> Array:
    """Return the swivel angles (states,) in rad that minimise the residuals of `rows` in each state.

    A pose of a redundant mechanism determines the joint values only together with the swivel angle. The zero of this
    angle is a convention of the formula, not a property of the mechanism. Rows are therefore judged at the best angle.
    """

    def residuals(angle: Array) -> Array:
        by_row = rows(angle)
        if not by_row:
            return np.zeros((states, 0))
        places = sorted(by_row, key=lambda place: (place.statement, place.position))
        return np.hstack([by_row[place].reshape(states, -1) for place in places])

    def cost(r: Array) -> Array:
        return np.nan_to_num(np.sum(r**2, axis=1), nan=np.inf)

    best = np.zeros(states)
    r = residuals(best)
    least = cost(r)

    def keep_better(angle: Array) -> bool:
        """Take over the angles with which the cost is smaller; return whether there are any."""
        nonlocal best, least, r
        tried = residuals(angle)
        costs = cost(tried)
        better = costs < least
        best = np.where(better, angle, best)
        least = np.where(better, costs, least)
        if tried.shape == r.shape:
            r = np.where(better[:, None], tried, r)
        return bool(better.any())

    for angle in np.linspace(-np.pi, np.pi, _GRID, endpoint=False):
        keep_better(np.full(states, angle))
    for _ in range(_REFINE):
        slope = (residuals(best + _STEP) - r) / _STEP
        step = -np.sum(slope * r, axis=1) / np.maximum(np.sum(slope**2, axis=1), 1e-300)
        # A long step would leave the valley of the best angle of the grid.
        if not keep_better(best + np.clip(np.nan_to_num(step), -0.5, 0.5)):
            break
    return best
