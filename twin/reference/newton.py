"""Damped Gauss-Newton for many samples at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twin.core.spatial import Array, Index
from twin.reference.tree import Tree

_LAST_STEP = 1e-9
"""Step (m, rad) below which the iteration ends: convergence is quadratic, so the remaining error is rounding."""

_ZERO_COST = 1e-29
"""Sum of squares below which a residual is a rounding error."""

_MAX_ITERATIONS = 40
"""Maximum number of steps; a sample that needs more counts as not converged."""

_SMALLEST_DAMPING = 1e-13
"""Minimum damping, relative to the mean diagonal.

This damping selects the shortest step if the mechanism has an internal freedom (a rod that spins between two ball
joints); otherwise it has no effect.
"""

_NEGLIGIBLE_DAMPING = 1e-9
"""Damping, relative to the mean diagonal, below which damping shortens a step only negligibly."""

Residual = Callable[[Array, Index], tuple[Array, Array]]
"""Function of configurations X (k, nq) and sample indices (k,); returns residuals (k, m) and Jacobians (k, m, nv)."""


def minimise(
    tree: Tree,
    X: Array,
    residual: Residual,
    columns: Index,
    iterations: int = _MAX_ITERATIONS,
    *,
    integrate: Callable[[Array, Array], Array] | None = None,
    enough: float = _ZERO_COST,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (configurations (k, nq) near X that minimise the residual, (k,) bool: whether each converged).

    X (k, nq) are the start configurations; only the velocity indices `columns` change. A sample that needs more than
    `iterations` counts as not converged. `integrate` replaces `tree.integrate`. The iteration of a sample ends when the
    sum of squares of its residual is below `enough`.
    """
    if integrate is None:
        integrate = tree.integrate
    X = X.copy()
    todo = np.arange(len(X))
    is_done = np.zeros(len(X), bool)
    r, A = residual(X, todo)
    if not len(columns) or not r.shape[1]:
        return X, ~is_done
    cost = np.sum(r**2, axis=1)
    damping = np.zeros(len(X))
    eye = np.eye(len(columns))
    for _ in range(iterations):
        A = A[:, :, columns]
        At = np.swapaxes(A, 1, 2)
        normal = At @ A
        size = np.trace(normal, axis1=1, axis2=2) / len(columns)
        steps = np.zeros((len(todo), tree.model.nv))
        # If no column affects the residual, `size` is 0, and the step must be 0.
        floor = damping[todo] + _SMALLEST_DAMPING * size
        weight = np.maximum(floor, np.finfo(float).tiny)[:, None, None]
        gradient = At @ r[..., None]
        steps[:, columns] = -np.linalg.solve(normal + weight * eye, gradient)[..., 0]
        new = integrate(X[todo], steps)
        # A small step proves convergence only if damping does not shorten it.
        free = damping[todo] <= _NEGLIGIBLE_DAMPING * size
        small = np.abs(steps).max(axis=1) < _LAST_STEP
        last = small & free
        X[todo[last]] = new[last]
        is_done[todo[last]] = True
        todo = todo[~last]
        new = new[~last]
        size = size[~last]
        if not len(todo):
            break
        new_r, new_A = residual(new, todo)
        new_cost = np.sum(new_r**2, axis=1)
        # A higher cost is no reason to damp if it is a rounding error.
        higher = new_cost > cost[todo] * (1 + 1e-9)
        worse = higher & (new_cost > _ZERO_COST)
        damping[todo[worse]] = np.maximum(10 * damping[todo[worse]], 1e-6 * size[worse])
        better = todo[~worse]
        damping[better] /= 10
        X[better] = new[~worse]
        cost[better] = new_cost[~worse]
        finished = ~worse & (new_cost < enough)
        is_done[todo[finished]] = True
        todo = todo[~finished]
        if not len(todo):
            break
        if worse.any():  # these samples return to their old states: evaluate the residual there again
            r, A = residual(X[todo], todo)
        else:
            r = new_r[~finished]
            A = new_A[~finished]
    return X, is_done
