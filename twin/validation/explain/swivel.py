"""Fit the free angle (swivel) of a redundant mechanism in each state, so that the rows' residuals are minimal."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array
from twin.validation.explain.rows import Place

_GRID = 12
"""Number of start angles in a full turn."""

_REFINE = 6
_STEP = 1e-6
"""Step in rad of the numeric derivatives; `_REFINE` is the number of Gauss-Newton steps."""


def fitted(rows: Callable[[Array], Mapping[Place, Array]], states: int) -> Array:
    """Return the swivel angles (states,) in rad that minimise the residuals of `rows` in each state.

    A pose of a redundant mechanism determines the joint values only together with the swivel angle. The zero of this
    angle is a convention of the formula, not a property of the mechanism. Rows are therefore judged at the best angle.
    """

    def residuals(angle: Array) -> Array:
        found = rows(angle)
        flat = [r.reshape(states, -1) for _, r in sorted(found.items(), key=lambda x: (x[0].statement, x[0].position))]
        return np.hstack(flat) if flat else np.zeros((states, 0))

    def cost(r: Array) -> Array:
        return np.nan_to_num(np.sum(r**2, axis=1), nan=np.inf)

    best = np.zeros(states)
    r = residuals(best)
    least = cost(r)
    for angle in np.linspace(-np.pi, np.pi, _GRID, endpoint=False):
        tried = residuals(np.full(states, angle))
        better = cost(tried) < least
        best, least, r = np.where(better, angle, best), np.where(better, cost(tried), least), _mixed(better, tried, r)
    for _ in range(_REFINE):
        slope = (residuals(best + _STEP) - r) / _STEP
        step = -np.sum(slope * r, axis=1) / np.maximum(np.sum(slope**2, axis=1), 1e-300)
        ahead = best + np.clip(np.nan_to_num(step), -0.5, 0.5)
        tried = residuals(ahead)
        better = cost(tried) < least
        if not better.any():
            break
        best, least, r = np.where(better, ahead, best), np.where(better, cost(tried), least), _mixed(better, tried, r)
    return best


def _mixed(rows: NDArray[np.bool_], a: Array, b: Array) -> Array:
    return np.where(rows[:, None], a, b) if a.shape == b.shape else b
