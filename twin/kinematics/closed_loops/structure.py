"""Find redundant loop equations numerically, and order the other equations into blocks solved in sequence."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.kinematics.closed_loops.equations import STEP_SIZES, LoopEquations

_SAMPLE_COUNT = 32
"""Number of random states at which residuals and derivatives are evaluated: a zero in all of them is no accident."""

_ZERO_RESIDUAL = 1e-12
"""Residual in m or rad that a redundant equation does not exceed in any state, even with open loops."""

_ZERO_DERIVATIVE = 1e-13
"""Size below which a derivative counts as zero."""


@dataclass(frozen=True)
class EquationBlock:
    """Equations that are solved together, after the previous blocks.

    Attributes:
        rows: indices of the equations.
        unknowns: indices of the joints in `LoopEquations.passive`.
        columns: columns of `LoopEquations.jacobian` that belong to the steps of these joints.
        pattern: (rows, columns) bool, whether an entry of the Jacobian can differ from 0.
    """

    rows: tuple[int, ...]
    unknowns: tuple[int, ...]
    columns: tuple[int, ...]
    pattern: np.ndarray

    @property
    def is_square(self) -> bool:
        """Whether there are as many equations as unknowns."""
        return len(self.rows) == len(self.columns)


def blocks(equations: LoopEquations) -> list[EquationBlock]:
    """Return the blocks in the order of solution; joints that no equation contains are in no block."""
    if not equations.passive or not equations.residual.numel():
        return []
    values, slopes = _samples(equations)
    nonzero_rows = np.flatnonzero(np.abs(values).max(axis=0) > _ZERO_RESIDUAL)
    pattern = np.abs(slopes[:, nonzero_rows]).max(axis=0) > _ZERO_DERIVATIVE
    owners = []
    for k, passive in enumerate(equations.passive):
        owners.append(np.full(STEP_SIZES[passive.joint.type], k))
    owner = np.concatenate(owners)  # of each step
    joint_pattern = pattern.copy()  # all unknowns of a joint are solved for in one block
    for k in range(len(equations.passive)):
        is_own = owner == k
        joint_pattern[:, is_own] = pattern[:, is_own].any(axis=1)[:, None]

    ordered: list[EquationBlock] = []
    for rows, columns in _diagonal_blocks(joint_pattern):
        if not columns:  # an equation of active joints alone determines no unknown
            continue
        unknowns = tuple(dict.fromkeys(owner[columns].tolist()))
        steps: list[int] = []
        for k in unknowns:
            steps += np.flatnonzero(owner == k).tolist()
        equation_rows = tuple(nonzero_rows[rows].tolist())
        ordered.append(EquationBlock(equation_rows, unknowns, tuple(steps), pattern[np.ix_(rows, steps)]))
    return ordered


def _samples(equations: LoopEquations) -> tuple[Array, Array]:
    """Return residuals (k, m) and derivatives (k, m, n) at k random states."""
    expressions = [equations.residual, ca.densify(equations.jacobian)]
    function = ca.Function("tried", [equations.q, equations.states], expressions)
    rng = np.random.default_rng(0)
    values: list[Array] = []
    slopes: list[Array] = []
    for _ in range(_SAMPLE_COUNT):
        states: list[Array] = []
        for passive in equations.passive:
            state = rng.normal(size=passive.state.numel())
            if passive.joint.type in ("spherical", "free"):  # the last four numbers are a unit quaternion
                state[-4:] /= np.linalg.norm(state[-4:])
            states.append(state)
        q = rng.normal(size=equations.q.numel())
        residual, jacobian = function(q, np.concatenate(states))
        values.append(residual.full().ravel())
        slopes.append(jacobian.full())
    return np.array(values), np.array(slopes)


def _diagonal_blocks(pattern: np.ndarray) -> list[tuple[list[int], list[int]]]:
    """Return (rows, columns) of the diagonal blocks; each block depends only on the blocks before it."""
    diagonal: list[tuple[list[int], list[int]]] = []
    for rows, columns in _components(pattern):
        part = pattern[np.ix_(rows, columns)]
        sparsity = ca.sparsify(ca.DM(part.astype(float))).sparsity()
        if len(rows) != len(columns) or ca.sprank(sparsity) < len(rows):
            diagonal.append((rows, columns))  # not square, or singular by its pattern: one least-squares block
            continue
        # Block triangular form: row_order and column_order permute the matrix, the ends cut it into blocks.
        count, row_order, column_order, row_ends, column_ends, _, _ = sparsity.btf()
        for block in range(count):
            block_rows = row_order[row_ends[block] : row_ends[block + 1]]
            block_columns = column_order[column_ends[block] : column_ends[block + 1]]
            rows_of_block = np.array(rows)[block_rows].tolist()
            columns_of_block = np.array(columns)[block_columns].tolist()
            diagonal.append((rows_of_block, columns_of_block))
    return diagonal


def _components(pattern: np.ndarray) -> list[tuple[list[int], list[int]]]:
    """Return the groups (rows, columns) of a pattern; no two groups have a row or a column in common."""
    ungrouped = set(range(pattern.shape[1]))
    groups: list[tuple[list[int], list[int]]] = []
    while ungrouped:
        columns: set[int] = set()
        rows: set[int] = set()
        added = {min(ungrouped)}
        # A group grows by the rows of its columns and by the columns of its rows, until nothing is added.
        while added:
            columns |= added
            linked_rows = pattern[:, sorted(added)].any(axis=1)
            rows |= set(np.flatnonzero(linked_rows).tolist())
            linked_columns = pattern[sorted(rows)].any(axis=0)
            added = set(np.flatnonzero(linked_columns).tolist()) - columns
        ungrouped -= columns
        if rows:
            groups.append((sorted(rows), sorted(columns)))
    return groups
