"""How regular a closed state is: the rank of its loops in the passive joints, against that of states beside it.

Where the rank is lost, assemblies meet (knees stretched, cranks in line): the passive joints may go either way,
Newton's method has no direction to go in, and small moves of the driven joints fail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.reference.departing import scattered
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise

SINGULAR = 1e-4
"""Smallest singular value of the loops in the passive joints, by the largest, below which a state is singular."""

_RANK = 1e-6
"""... and below which it is none, whatever the state: a constraint that is there twice."""

_BESIDE = (0.03, 0.1, 0.3)
"""Standard deviations in rad of turns (a tenth in m of slides) of the states beside one."""

_TRIES = 6
"""States for each of them."""


@dataclass(frozen=True)
class Regularity:
    """The rank of the loops in the passive joints at a state, the usual one beside it, and what is left of that.

    Attributes:
        rank, usual: see above.
        margin: smallest of the usual singular values at the state, by the largest: 0 where rank is lost.
    """

    rank: int
    usual: int
    margin: float

    @property
    def singular(self) -> bool:
        """Whether rank is lost, or as good as lost."""
        return self.margin < SINGULAR


def regularity(model: ReferenceModel, states: Sequence[Array]) -> list[Regularity]:
    """Return the regularity of closed states (nq,), with the usual rank of the first and of those beside it."""
    beside = closed_beside(model, states[0])
    every = [_values(model, x) for x in (*states, *beside)]
    ranks = [int((s > _RANK * max(s[0], 1e-12)).sum()) if len(s) else 0 for s in every]
    usual = max(ranks)
    out = []
    for s, rank in zip(every, ranks[: len(states)], strict=False):
        out.append(Regularity(rank, usual, float(s[usual - 1] / s[0]) if usual else 1.0))
    return out


def singular_home(model: ReferenceModel, home: Array) -> list[Finding]:
    """Return the warning for a mechanism that is singular where it rests (nq,), if it is."""
    r = regularity(model, [home])[0]
    if not r.singular:
        return []
    text = f"as drawn the mechanism is singular: its loops have rank {r.rank} there and {r.usual} beside it"
    hint = "small moves may fail or go either way: draw it elsewhere, as with knees bent"
    name = model.mechanism.name
    return [Finding("home.singular", "warning", text, name, size=r.margin, limit=SINGULAR, suggestion=hint)]


def closed_beside(model: ReferenceModel, x: Array) -> list[Array]:
    """Return closed states beside a configuration (nq,), driven joints moved as well; always the same ones."""
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
