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
from twin.reference.departing import scattered
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise

SINGULAR = 1e-4
"""Value of `Regularity.margin` below which a state is singular."""

_RANK = 1e-6
"""Singular values below this fraction of the largest one count as zero: the constraint is redundant in all states."""

_BESIDE = (0.03, 0.1, 0.3)
"""Standard deviations of the nearby states: in rad for rotations; for slides, a tenth of these numbers in m."""

_TRIES = 6
"""Number of nearby states per standard deviation."""


@dataclass(frozen=True)
class Regularity:
    """Rank of the loop Jacobian in the passive joints at a state, compared with nearby states.

    Attributes:
        rank, usual: rank at the state, and largest rank at the state and at nearby states.
        margin: singular value number `usual` at the state (counted from 1, largest first), divided by the largest
            singular value; about 0 if the rank is lower than `usual`.
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
    every = [_values(model, x) for x in (*states, *beside)]
    ranks = [int((s > _RANK * max(s[0], 1e-12)).sum()) if len(s) else 0 for s in every]
    usual = max(ranks)
    out = []
    for s, rank in zip(every, ranks[: len(states)], strict=False):
        out.append(Regularity(rank, usual, float(s[usual - 1] / s[0]) if usual else 1.0))
    return out


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
    X = minimise(model.tree, scattered(model.tree, x, columns, _BESIDE, _TRIES), model.loops_only, columns)[0]
    X = X[np.isfinite(X).all(axis=1)]
    gaps = model.collect(X).gaps
    limit = max(1e-9, 2 * float(model.collect(x[None]).gaps[..., 0].max(initial=0.0)))
    return [x for x, gap in zip(X, gaps[..., 0].max(axis=1, initial=0.0), strict=True) if gap <= limit]


def _values(model: ReferenceModel, x: Array) -> Array:
    A = model.loop_jacobian(x)[:, model.tree.passive]
    return np.asarray(np.linalg.svd(A, compute_uv=False) if A.size else np.zeros(0), np.float64)
