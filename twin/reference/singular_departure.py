"""Leave a singular state, where assembly modes meet and Newton steps fail, by random steps of the passive joints.

The result is the nearest closed state; states within all joint limits have priority.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core.spatial import Array, Index
from twin.reference.tree import Tree

_SPREADS = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Standard deviations of the random steps: in rad for rotations; for slides, a tenth of these numbers in m."""

_STEPS_PER_SPREAD = 4
"""Number of random steps per standard deviation."""


def depart(tree: Tree, x: Array, move: Callable[[Array], Array], distance_of: Callable[[Array], float]) -> Array | None:
    """Return the best state that `move` reaches after random steps from x; None if no valid state is reached.

    x (nq,) is the configuration at which a continuation is stuck. `move` moves starts (k, nq) to the target and returns
    the states (k, nq). `distance_of` returns the distance of a state from x; infinity if the state is invalid. The best
    state has the smallest excess over joint limits; among equal states, the nearest to x is best. The random steps are
    the same in every call.
    """
    if not len(tree.passive) or not tree.loops.names:
        return None
    X = move(scattered(tree, x, tree.passive, _SPREADS, _STEPS_PER_SPREAD))
    reached = []
    for i, new in enumerate(X):
        if not np.isfinite(new).all():
            continue
        distance = distance_of(new)
        if np.isfinite(distance):
            # rounded, so that rounding errors of the excess do not outweigh the distance
            excess = round(limit_excess(tree, new), 6)
            reached.append((excess, distance, i))
    if not reached:
        return None
    _, _, best = min(reached)
    return X[best]


def scattered(tree: Tree, x: Array, columns: Index, spreads: Sequence[float], tries: int) -> Array:
    """Return configurations (k, nq) scattered around x (nq,).

    `columns` are the velocity indices of the moved joints. `spreads` are the standard deviations in rad of rotations;
    prismatic joints have a tenth of these numbers, in m. There are `tries` configurations for each number in `spreads`.
    """
    rng = np.random.default_rng(0)
    spread = np.repeat(np.asarray(spreads, np.float64), tries)[:, None]
    count = len(spread)
    steps = np.zeros((count, tree.model.nv))
    steps[:, columns] = spread * rng.standard_normal((count, len(columns)))
    for joint in tree.mechanism.tree:
        if joint.type == "prismatic":
            slide = tree.coordinate[joint.name]
            steps[:, slide] *= 0.1
    starts = np.tile(x, (count, 1))
    return tree.integrate(starts, steps)


def limit_excess(tree: Tree, x: Array) -> float:
    """Return by how much (sum over joints, rad and m) a configuration exceeds joint limits; 0 within all limits."""
    total = 0.0
    for joint in tree.mechanism.tree:
        if joint.limits is None or joint.name not in tree.configuration:
            continue
        low, high = joint.limits
        q = float(x[tree.configuration[joint.name]])
        total += max(low - q, q - high, 0.0)
    return total
