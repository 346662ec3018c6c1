"""Fit the free angle (swivel) of a redundant mechanism in each state, so that the rows' residuals are minimal."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from twin.core.spatial import Array
from twin.validation.explain.equation_steps import RowPlace

_START_ANGLES = 12
"""Number of start angles in a full turn."""

_MOST_NEWTON_STEPS = 6
"""Maximum number of Gauss-Newton steps from the best start angle."""

_DERIVATIVE_STEP = 1e-6
"""Difference in rad for numeric derivatives."""

_LONGEST_STEP = 0.5
"""Largest step in rad, about the distance of start angles: a longer one would leave the valley of the best of them."""

_LEAST_DIVISOR = 1e-300
"""Minimum divisor where rows may not depend on the angle."""


def fitted_swivel(rows: Callable[[Array], Mapping[RowPlace, Array]], states: int) -> Array:
    """Return the swivel angles (states,) in rad that minimise the residuals of `rows` in each state.

    A pose of a redundant mechanism determines the joint values only together with the swivel angle. The zero of this
    angle is a convention of the formula, not a property of the mechanism. Rows are therefore judged at the best angle.
    """

    def residuals(angle: Array) -> Array:
        """Return the residuals (states, entries) of all rows, always in the same order."""
        by_row = rows(angle)
        if not by_row:
            return np.zeros((states, 0))
        columns: list[Array] = []
        for place in sorted(by_row, key=lambda place: (place.statement, place.position)):
            columns.append(by_row[place].reshape(states, -1))
        return np.hstack(columns)

    def cost(r: Array) -> Array:
        return np.nan_to_num(np.sum(r**2, axis=1), nan=np.inf)

    best = np.zeros(states)
    r = residuals(best)
    least = cost(r)

    def keep_better(angle: Array) -> bool:
        """Take over the angles with which the cost is smaller; return whether there are any."""
        nonlocal best, least, r
        residuals_at_angle = residuals(angle)
        costs = cost(residuals_at_angle)
        is_better = costs < least
        best = np.where(is_better, angle, best)
        least = np.where(is_better, costs, least)
        if residuals_at_angle.shape == r.shape:
            r = np.where(is_better[:, None], residuals_at_angle, r)
        return bool(is_better.any())

    for angle in np.linspace(-np.pi, np.pi, _START_ANGLES, endpoint=False):
        keep_better(np.full(states, angle))
    for _ in range(_MOST_NEWTON_STEPS):
        slope = (residuals(best + _DERIVATIVE_STEP) - r) / _DERIVATIVE_STEP
        squares = np.maximum(np.sum(slope**2, axis=1), _LEAST_DIVISOR)
        step = np.nan_to_num(-np.sum(slope * r, axis=1) / squares)
        if not keep_better(best + np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)):
            break
    return best
