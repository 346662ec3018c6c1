"""Regularity of a closed state: rank of the loop Jacobian in the passive joints, compared with nearby states.

If the rank is lower than at nearby states, assembly modes meet (stretched links, cranks in line). The passive joints
can then follow either mode, Newton's method has no unique direction, and small motions of the driven joints fail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, warning
from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise
from twin.reference.singular_departure import scattered

SINGULAR = 1e-4
"""Value of `Regularity.margin` below which a state is singular."""

_RELATIVE_ZERO = 1e-6
"""Singular values below this fraction of the largest one count as zero: the constraint is redundant in all states."""

_ROUNDING = 1e-12
"""Singular value, in the units of the loop Jacobian, up to which all values are rounding errors."""

_SPREADS = (0.03, 0.1, 0.3)
"""Standard deviations of the nearby states: in rad for rotations; for slides, a tenth of these numbers in m."""

_STATES_PER_SPREAD = 6
"""Number of nearby states per standard deviation."""


@dataclass(frozen=True)
class Regularity:
    """Rank of the loop Jacobian in the passive joints at a state, compared with nearby states.

    Attributes:
        rank, usual: rank at the state, and largest rank at the state and at nearby states.
        margin: singular value number `usual` at the state (counted from 1, largest first), divided by the largest
            singular value; about 0 if the rank is lower than `usual`; 1 if `usual` is 0.
    """

    rank: int
    usual: int
    margin: float

    @property
    def singular(self) -> bool:
        """Whether the rank is lower than `usual` or nearly lower: `margin` is below `SINGULAR`."""
        return self.margin < SINGULAR


def regularity(model: ReferenceModel, states: Sequence[Array]) -> list[Regularity]:
    """Return the regularity of closed states (nq,); `usual` is the largest rank at these states and near the first."""
    beside = closed_beside(model, states[0])
    singular_values = []
    ranks = []
    for x in (*states, *beside):
        values = _values(model, x)
        rank = 0
        if len(values):
            # if all values are rounding errors, the rank is 0
            smallest = max(_RELATIVE_ZERO * values[0], _ROUNDING)
            rank = int((values > smallest).sum())
        singular_values.append(values)
        ranks.append(rank)
    usual = max(ranks)
    regularities = []
    for i in range(len(states)):
        values = singular_values[i]
        margin = 1.0
        if usual and values[0] <= _ROUNDING:  # the rank falls to 0: there is no value to divide by
            margin = 0.0
        elif usual:
            margin = float(values[usual - 1] / values[0])
        regularities.append(Regularity(ranks[i], usual, margin))
    return regularities


def singular_home(model: ReferenceModel, home: Array) -> list[Finding]:
    """Return a warning if the mechanism is singular in its rest state `home` (nq,); else an empty list."""
    r = regularity(model, [home])[0]
    if not r.singular:
        return []
    ranks = f"rank of the loop Jacobian {r.rank}, in nearby poses {r.usual}"
    text = f"the mechanism is singular in its rest poses ({ranks}): conditioning"
    hint = "small moves may fail or change the assembly mode: draw the CAD in a pose without stretched links"
    name = model.mechanism.name
    return [warning("home.singular", name, text, Quantity(r.margin), SINGULAR, hint)]


def closed_beside(model: ReferenceModel, x: Array) -> list[Array]:
    """Return closed states near x (nq,), also at other driven joint values; every call gives the same states."""
    if not model.mechanism.loops and not model.mechanism.couplings:
        return []
    columns = np.arange(model.tree.model.nv)
    starts = scattered(model.tree, x, columns, _SPREADS, _STATES_PER_SPREAD)
    X, _ = minimise(model.tree, starts, model.loops_only, columns)
    X = X[np.isfinite(X).all(axis=1)]
    # a mechanism whose loops are inconsistent keeps a gap: a nearby state may have twice the gap of x
    own_gaps = model.collect(x[None]).gaps[..., 0]
    own_gap = float(own_gaps.max(initial=0.0))
    limit = max(1e-9, 2 * own_gap)
    gaps = model.collect(X).gaps[..., 0].max(axis=1, initial=0.0)
    return list(X[gaps <= limit])


def _values(model: ReferenceModel, x: Array) -> Array:
    """Return the singular values of the loop Jacobian in the passive joints; empty without loops or passive joints."""
    A = model.loop_jacobian(x)[:, model.tree.passive]
    if not A.size:
        return np.zeros(0)
    s = np.linalg.svd(A, compute_uv=False)
    return np.asarray(s, np.float64)
