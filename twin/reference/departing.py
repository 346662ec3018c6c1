"""Leave a singular state, where assemblies meet and Newton steps fail, by random kicks of the passive joints.

The result is the nearest closed state within all joint limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin.core.spatial import Array, Index
from twin.reference.tree import Tree

_KICKS = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Standard deviations of the kicks in rad; for slides a tenth of the number, in m."""

_TRIES = 4
"""Number of kicks of each size."""


def depart(tree: Tree, x: Array, move: Callable[[Array], Array], way: Callable[[Array], float]) -> Array | None:
    """Return a state near configuration x (nq,) that a move reaches from a kick, or None; deterministic.

    Args:
        tree: tree of the mechanism.
        x: the configuration (nq,) at which a walk is stuck.
        move: starts (k, nq) -> states (k, nq).
        way: distance of a state from x; infinite if the state is invalid.
    """
    if not len(tree.passive) or not tree.loops.names:
        return None
    X = move(scattered(tree, x, tree.passive, _KICKS, _TRIES))
    found = [(round(breach(tree, new), 6), way(new), i) for i, new in enumerate(X) if np.isfinite(new).all()]
    reached = [f for f in found if np.isfinite(f[1])]
    return X[min(reached)[2]] if reached else None


def scattered(tree: Tree, x: Array, columns: Index, spreads: Sequence[float], tries: int) -> Array:
    """Return configurations (k, nq) scattered around one in some velocities; `spreads` in rad, or tenths of m."""
    rng = np.random.default_rng(0)
    spread = np.repeat(np.asarray(spreads, np.float64), tries)[:, None]
    steps = np.zeros((len(spread), tree.model.nv))
    steps[:, columns] = spread * rng.standard_normal((len(spread), len(columns)))
    steps[:, [tree.coordinate[j.name] for j in tree.mechanism.tree if j.type == "prismatic"]] *= 0.1
    return tree.integrate(np.tile(x, (len(steps), 1)), steps)


def breach(tree: Tree, x: Array) -> float:
    """Return the total excess (rad, m) of a configuration over the limits of the tree's joints."""
    total = 0.0
    for joint in tree.mechanism.tree:
        if joint.limits is not None and joint.name in tree.configuration:
            q = float(x[tree.configuration[joint.name]])
            total += max(joint.limits[0] - q, q - joint.limits[1], 0.0)
    return total
