"""Degrees of freedom and redundant constraints, by the rank of the constraint Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array, Index
from twin.reference.loops import AXES, Loops

_FLAT = 1e-9
"""Relative size below which a singular value counts as zero."""

_SHARE = 1e-6
"""Minimum coefficient of a row in a dependency between constraints, above which it counts as repeated."""


@dataclass(frozen=True)
class Mobility:
    """Degrees of freedom and redundancy at one state, by the rank of the constraint Jacobian.

    Attributes:
        freedom: degrees of freedom of the whole mechanism.
        redundancy: number of redundant constraint rows.
        redundant: number of redundant rows by loop, counted in file order.
        repeated: by loop, the directions that other constraints lock as well; one of them could be omitted. "offset z"
            and "turn x" are along and about the axes of the joint's frame on its parent.
        internal: freedoms that remain when all active joints are held (a rod that spins between two balls).
    """

    freedom: int
    redundancy: int
    redundant: dict[str, int]
    repeated: dict[str, tuple[str, ...]]
    internal: int

    def describe(self) -> str:
        """Return the redundant constraints as text; "" if there are none."""
        return "; ".join(
            f"{name}: {count} of {', '.join(self.repeated[name])}" if self.repeated[name] else f"{name}: {count}"
            for name, count in self.redundant.items()
            if count
        )


def count(A: Array, loops: Loops, passive: Index) -> Mobility:
    """Return the mobility at one state from the Jacobian (m, nv) of the loop residuals.

    Args:
        A: Jacobian with rows as in `Loops.evaluate`.
        loops: give the loop and the direction of each row.
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
