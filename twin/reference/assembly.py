"""Close loops that are open in the CAD's rest poses, from many start configurations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from twin.core.spatial import Array, Index
from twin.model.mechanism import Mechanism
from twin.reference.loops import LENGTH_SCALE
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise
from twin.reference.singular_departure import scattered
from twin.reference.states import Assembly

CLOSED = (1e-9, 1e-8)
"""Maximum offset in m and maximum rotation in rad of a loop that counts as closed."""

_SPREADS = (0.1, 0.3, 1.0, 2.0)
"""Standard deviations of the random starts around a state: in rad for rotations; for slides, a tenth of these in m."""

_STARTS_PER_SPREAD = 3
"""Number of random starts per standard deviation."""


def assemble(model: ReferenceModel) -> Assembly:
    """Return the assembly with the smallest loop gaps that is found near the rest poses.

    If the passive joints alone can close the loops, the driven joints keep their values; otherwise they also move. The
    random starts are the same in every call.
    """
    tree = model.tree
    best = model.home()
    x_rest = tree.start(model.mechanism.rest)
    every_column = np.arange(tree.model.nv)
    for columns in (tree.passive, every_column):
        near_rest = scattered(tree, x_rest, columns, _SPREADS, _STARTS_PER_SPREAD)
        # The rest poses alone come first: in most CAD, they suffice.
        for starts in (x_rest[None], near_rest):
            if is_closed(best):
                return best
            candidate = _nearest(model, starts, columns, x_rest)
            # among equal gaps, that at the drawn driven joints stays: a loop that cannot be closed moves nothing
            if candidate is not None and not _as_small(_misfit(best), _misfit(candidate)):
                best = candidate
    return best


def closes_alone(mechanism: Mechanism, loop: str) -> tuple[float, float]:
    """Return the smallest possible gap (m, rad) of one loop if all other loops are removed and all joints are free.

    Infinite if no start leads to finite values.
    """
    other_loops = {joint.name for joint in mechanism.loops} - {loop}
    joints = []
    for joint in mechanism.joints:
        if joint.name not in other_loops:
            joints.append(joint)
    # a coupling could hold the joints apart, so that the gap would not be that of the loop alone
    alone = replace(mechanism, joints=tuple(joints), couplings=())
    model = ReferenceModel(alone)
    every_column = np.arange(model.tree.model.nv)
    x_rest = model.tree.start(mechanism.rest)
    near_rest = scattered(model.tree, x_rest, every_column, _SPREADS, _STARTS_PER_SPREAD)
    starts = np.concatenate([x_rest[None], near_rest])
    nearest = _nearest(model, starts, every_column, x_rest)
    if nearest is None:
        return np.inf, np.inf
    return nearest.gap[loop]


def settle(model: ReferenceModel, values: Mapping[str, float]) -> Assembly | None:
    """Return the closed assembly nearest to the given values of tree joints; None if the loops cannot be closed.

    `values` is {name of the joint: value in m or rad}; other joints start at the rest poses.
    """
    tree = model.tree
    start = tree.start(model.mechanism.rest)
    for name, value in values.items():
        if name in tree.configuration:
            place = tree.configuration[name]
            start[place] = value
    every_column = np.arange(tree.model.nv)
    for columns in (tree.passive, every_column):
        nearest = _nearest(model, start[None], columns, start)
        if nearest is not None and is_closed(nearest):
            return nearest
    return None


def is_closed(state: Assembly) -> bool:
    """Return whether every loop is closed, in position and in orientation."""
    max_offset, max_tilt = CLOSED
    for offset, tilt in state.gap.values():
        # written so that a gap that is NaN counts as open
        closed = offset <= max_offset and tilt <= max_tilt
        if not closed:
            return False
    return True


def _misfit(state: Assembly) -> float:
    """Return the sum of the gaps, in m with 1 rad as `LENGTH_SCALE`; 0 if all loops are closed."""
    if is_closed(state):
        return 0.0
    sizes = []
    for offset, tilt in state.gap.values():
        sizes.append(offset + LENGTH_SCALE * tilt)
    return sum(sizes)


def _as_small(misfit: float, other_misfit: float) -> bool:
    """Return whether a misfit is at most as large as another, up to rounding; only 0 (closed) is as small as 0."""
    if other_misfit == 0.0:
        return misfit == 0.0
    return misfit <= other_misfit + CLOSED[0]


def _nearest(model: ReferenceModel, starts: Array, columns: Index, x_rest: Array) -> Assembly | None:
    """Return the assembly with the smallest gaps reached from `starts`; if some are equal, the nearest to `x_rest`.

    None if no start leads to finite values.
    """
    X, _ = minimise(model.tree, starts, model.loops_only, columns)
    finite = np.isfinite(X).all(axis=1)
    assemblies = []
    misfits = []
    for x in X[finite]:
        assembly = model.state(x)
        assemblies.append(assembly)
        misfits.append(_misfit(assembly))
    smallest = min(misfits, default=0.0)
    # of a loop that cannot be closed, every start leaves the same gap, in which only the rounding differs
    equal = []
    for assembly, misfit in zip(assemblies, misfits, strict=True):
        if _as_small(misfit, smallest):
            equal.append(assembly)
    return min(equal, key=lambda assembly: float(np.linalg.norm(assembly.x - x_rest)), default=None)
