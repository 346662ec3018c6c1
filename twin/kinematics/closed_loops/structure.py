"""Find redundant loop equations numerically, and order the other equations into blocks solved in sequence."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.kinematics.closed_loops.equations import STEPS, Equations

_TRIES = 32
_NOTHING = 1e-12
"""Residual in m or rad that a redundant equation does not exceed in any state, even with open loops."""
_FLAT = 1e-13
"""Size below which a derivative counts as zero."""


@dataclass(frozen=True)
class Block:
    """Equations that are solved together, after the previous blocks.

    Attributes:
        rows: indices of the equations.
        unknowns: indices of the joints in `Equations.passive`.
        columns: columns of `Equations.jacobian` that belong to the steps of these joints.
        pattern: (rows, columns) bool, whether an entry of the Jacobian can differ from 0.
    """

    rows: tuple[int, ...]
    unknowns: tuple[int, ...]
    columns: tuple[int, ...]
    pattern: np.ndarray

    @property
    def square(self) -> bool:
        """Whether there are as many equations as unknowns."""
        return len(self.rows) == len(self.columns)


def blocks(equations: Equations) -> list[Block]:
    """Return the blocks in the order of solution; joints that no equation contains are in no block."""
    e = equations
    if not e.passive or not e.residual.numel():
        return []
    values, slopes = _tried(e)
    kept = np.flatnonzero(np.abs(values).max(axis=0) > _NOTHING)
    owner = np.repeat(np.arange(len(e.passive)), [STEPS[p.joint.type] for p in e.passive])
    pattern = np.abs(slopes[:, kept]).max(axis=0) > _FLAT
    whole = pattern.copy()  # all unknowns of a joint are solved for in one block
    for k in range(len(e.passive)):
        whole[:, owner == k] = pattern[:, owner == k].any(axis=1)[:, None]
    out = []
    for rows, columns in _sorted(whole):
        if len(columns):
            members = tuple(dict.fromkeys(int(owner[c]) for c in columns))
            steps = tuple(int(c) for k in members for c in np.flatnonzero(owner == k))
            out.append(Block(tuple(int(kept[r]) for r in rows), members, steps, pattern[np.ix_(rows, steps)]))
    return out


def _tried(e: Equations) -> tuple[Array, Array]:
    """Return residuals (k, m) and derivatives (k, m, n) at k random states."""
    function = ca.Function("tried", [e.q, e.states], [e.residual, ca.densify(e.jacobian)])
    rng = np.random.default_rng(0)
    values, slopes = [], []
    for _ in range(_TRIES):
        x = []
        for p in e.passive:
            state = rng.normal(size=p.state.numel())
            if p.joint.type in ("spherical", "free"):
                state[-4:] /= np.linalg.norm(state[-4:])
            x.append(state)
        r, J = function(rng.normal(size=e.q.numel()), np.concatenate(x))
        values.append(r.full().ravel())
        slopes.append(J.full())
    return np.array(values), np.array(slopes)


def _sorted(pattern: np.ndarray) -> list[tuple[list[int], list[int]]]:
    """Return (rows, columns) of the diagonal blocks; each block depends only on the blocks before it."""
    out = []
    for rows, columns in _components(pattern):
        part = pattern[np.ix_(rows, columns)]
        sparsity = ca.sparsify(ca.DM(part.astype(float))).sparsity()
        if len(rows) != len(columns) or ca.sprank(sparsity) < len(rows):
            out.append((rows, columns))  # not as many equations as unknowns: one least-squares block
            continue
        count, p, q, r, c, _, _ = sparsity.btf()
        out += [([rows[i] for i in p[r[b] : r[b + 1]]], [columns[i] for i in q[c[b] : c[b + 1]]]) for b in range(count)]
    return out


def _components(pattern: np.ndarray) -> list[tuple[list[int], list[int]]]:
    """Return the groups (rows, columns) of a pattern; no two groups have a row or a column in common."""
    left, out = set(range(pattern.shape[1])), []
    while left:
        columns, rows, more = set(), set(), {min(left)}
        while more:
            columns |= more
            rows |= set(np.flatnonzero(pattern[:, sorted(more)].any(axis=1)).tolist())
            more = set(np.flatnonzero(pattern[sorted(rows)].any(axis=0)).tolist()) - columns
        left -= columns
        if rows:
            out.append((sorted(rows), sorted(columns)))
    return out
