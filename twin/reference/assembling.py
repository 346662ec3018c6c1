"""Close loops that are open in the CAD's rest poses, from many start configurations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from twin.core.spatial import Array, Index
from twin.model.mechanism import Mechanism
from twin.reference.departing import scattered
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise
from twin.reference.states import Assembly

CLOSED = (1e-9, 1e-8)
"""Maximum offset in m and maximum rotation in rad of a loop that counts as closed."""

_SPREADS = (0.1, 0.3, 1.0, 2.0)
"""Standard deviations of the random starts around a state: in rad for rotations; for slides, a tenth of these in m."""

_TRIES = 3
"""Number of random starts per standard deviation."""


def assemble(model: ReferenceModel) -> Assembly:
    """Return the assembly with the smallest loop gaps that is found near the rest poses.

    If the passive joints alone can close the loops, the driven joints keep their values; otherwise they also move. The
    random starts are the same in every call.
    """
    best = model.home()
    drawn = model.tree.start(model.mechanism.rest)
    for columns in (model.tree.passive, np.arange(model.tree.model.nv)):
        for starts in (drawn[None], scattered(model.tree, drawn, columns, _SPREADS, _TRIES)):
            if is_closed(best):
                return best
            best = min((best, _nearest(model, starts, columns, drawn)), key=_misfit)
    return best


def closes_alone(mechanism: Mechanism, loop: str) -> tuple[float, float]:
    """Return the smallest possible gap (m, rad) of one loop if all other loops are removed and all joints are free."""
    others = {j.name for j in mechanism.loops} - {loop}
    alone = replace(mechanism, joints=tuple(j for j in mechanism.joints if j.name not in others), couplings=())
    model = ReferenceModel(alone)
    every = np.arange(model.tree.model.nv)
    drawn = model.tree.start(mechanism.rest)
    starts = np.concatenate([drawn[None], scattered(model.tree, drawn, every, _SPREADS, _TRIES)])
    return _nearest(model, starts, every, drawn).gap[loop]


def settle(model: ReferenceModel, values: Mapping[str, float]) -> Assembly | None:
    """Return the closed assembly nearest to the given values of tree joints; None if the loops cannot be closed.

    `values` is {name of the joint: value in m or rad}; other joints start at the rest poses.
    """
    start = model.tree.start(model.mechanism.rest)
    for name, value in values.items():
        if name in model.tree.configuration:
            start[model.tree.configuration[name]] = value
    for columns in (model.tree.passive, np.arange(model.tree.model.nv)):
        found = _nearest(model, start[None], columns, start)
        if is_closed(found):
            return found
    return None


def is_closed(state: Assembly) -> bool:
    """Return whether every loop is closed, in position and in orientation."""
    return all(offset <= CLOSED[0] and tilt <= CLOSED[1] for offset, tilt in state.gap.values())


def _misfit(state: Assembly) -> float:
    return 0.0 if is_closed(state) else sum(offset + 0.1 * tilt for offset, tilt in state.gap.values())


def _nearest(model: ReferenceModel, starts: Array, columns: Index, drawn: Array) -> Assembly:
    """Return the assembly with the smallest gaps reached from `starts`; if some are equal, the nearest to `drawn`."""
    X = minimise(model.tree, starts, model.loops_only, columns)[0]
    states = [model.state(x) for x in X[np.isfinite(X).all(axis=1)]]
    return min(states, key=lambda s: (_misfit(s), float(np.linalg.norm(s.x - drawn))))
