"""Degrees of freedom and redundant constraints, from the rank of the constraint Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array, Index
from twin.reference.loops import AXES, Loops

_RELATIVE_ZERO = 1e-9
"""Singular values below this fraction of the largest one of all constraints count as zero."""

_REPEATED_NORM = 1e-6
"""A row is repeated if the norm of its coefficients in the left null space of the Jacobian exceeds this value."""


@dataclass(frozen=True)
class Mobility:
    """Degrees of freedom and redundant constraints at one state.

    Attributes:
        freedom: degrees of freedom of the whole mechanism.
        redundancy: number of redundant constraint rows (rows of the loop Jacobian).
        redundant: number of redundant rows by loop: rows that depend on other rows of this loop or of earlier loops.
        repeated: directions of each loop that other constraints also lock, so that one of these constraints could be
            omitted. "offset z": along z, "turn x": about x of the joint's frame on its parent body.
        internal: degrees of freedom that remain if all active joints are locked, such as the spin of a rod between two
            ball joints.
    """

    freedom: int
    redundancy: int
    redundant: dict[str, int]
    repeated: dict[str, tuple[str, ...]]
    internal: int

    def describe(self) -> str:
        """Return the redundant constraints as text; "" if there are none."""
        parts = []
        for name, number in self.redundant.items():
            if not number:
                continue
            part = f"{name}: {number}"
            if self.repeated[name]:
                directions = ", ".join(self.repeated[name])
                part += f" among {directions}"
            parts.append(part)
        return "; ".join(parts)


def count(A: Array, loops: Loops, passive: Index) -> Mobility:
    """Return the mobility at one state.

    A (m, nv) is the Jacobian of the loop residuals, with rows as in `Loops.evaluate`; `loops` gives loop and direction
    of each row. `passive` are the velocity indices of the joints that are not driven.
    """
    size = 0.0
    if A.size:
        size = float(np.linalg.norm(A, 2))
    rank = 0
    redundant: dict[str, int] = {}
    for i, name in enumerate(loops.names):
        is_of_loop = loops.row_loop == i
        # the rank of this loop's rows together with those of all loops before
        extended = _rank(A[loops.row_loop <= i], size)
        redundant[name] = int(np.sum(is_of_loop)) - (extended - rank)
        rank = extended

    # A row with a coefficient in the left null space locks a direction that other rows also lock.
    repeats = np.zeros(len(A), bool)
    if len(A):
        U, _, _ = np.linalg.svd(A)
        null_space = U[:, rank:]
        repeats = np.linalg.norm(null_space, axis=1) > _REPEATED_NORM
    repeated = {}
    for i, name in enumerate(loops.names):
        axes = loops.row_axis[repeats & (loops.row_loop == i)]
        repeated[name] = tuple(AXES[axis] for axis in axes)

    freedom = A.shape[1] - rank
    redundancy = len(A) - rank
    internal = len(passive) - _rank(A[:, passive], size)
    return Mobility(freedom, redundancy, redundant, repeated, internal)


def _rank(A: Array, size: float) -> int:
    if not A.size:
        return 0
    s = np.linalg.svd(A, compute_uv=False)
    return int(np.sum(s > size * _RELATIVE_ZERO))
