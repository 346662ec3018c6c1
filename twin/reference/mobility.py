"""Degrees of freedom, and which constraints are there more than once, by the rank of the constraint Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array, Index
from twin.reference.loops import AXES, Loops

_FLAT = 1e-9
"""Relative size of singular values that count as zero."""

_SHARE = 1e-6
"""Part that a row must have in a dependency between constraints to count as repeated."""


@dataclass(frozen=True)
class Mobility:
    """Degrees of freedom and redundancy at one state, by the rank of the constraint Jacobian.

    Attributes:
        freedom: degrees of freedom of the whole mechanism.
        redundancy: constraint rows that add nothing.
        redundant: rows that add nothing, by loop, counted in file order.
        repeated: by loop, the directions that other constraints lock as well: any one of them could be left
            out. "offset z" and "turn x" are along and about the axes of the joint's frame on its parent.
        internal: freedoms that remain when all active joints are held (a rod that spins between two balls).
    """

    freedom: int
    redundancy: int
    redundant: dict[str, int]
    repeated: dict[str, tuple[str, ...]]
    internal: int

    def describe(self) -> str:
        """Return which constraints are redundant, in words; "" if none is."""
        return "; ".join(
            f"{name}: {count} of {', '.join(self.repeated[name])}" if self.repeated[name] else f"{name}: {count}"
            for name, count in self.redundant.items()
            if count
        )


def count(A: Array, loops: Loops, passive: Index) -> Mobility:
    """Return the mobility at one state from the Jacobian (m, nv) of the loop residuals.

    Args:
        A: rows as in `Loops.evaluate`.
        loops: which loop and direction each row belongs to.
        passive: the velocities that are not driven.
    """
    redundant: dict[str, int] = {}
    rank = 0
    for i, name in enumerate(loops.names):
        new = _rank(A[loops.row_loop <= i])
        redundant[name] = int(np.sum(loops.row_loop == i)) - (new - rank)
        rank = new
    # A row that takes part in a dependency (the left null space) is locked by others as well.
    repeats = np.linalg.norm(np.linalg.svd(A)[0][:, rank:], axis=1) > _SHARE if len(A) else np.zeros(0, bool)
    repeated = {
        name: tuple(AXES[a] for a in loops.row_axis[repeats & (loops.row_loop == i)])
        for i, name in enumerate(loops.names)
    }
    internal = len(passive) - _rank(A[:, passive])
    return Mobility(A.shape[1] - rank, len(A) - rank, redundant, repeated, internal)


def _rank(A: Array) -> int:
    if not A.size:
        return 0
    s = np.linalg.svd(A, compute_uv=False)
    return int(np.sum(s > s[0] * _FLAT))
