"""Solve small linear systems by unrolled code: it has no loops, no run-time pivoting and no products with zero."""

from __future__ import annotations

import casadi as ca
import numpy as np

from twin.core.spatial import Array

_FLOOR = 1e-13
"""Damping relative to the diagonal: it makes the step of undetermined unknowns minimal and changes no other unknown."""

_PIVOT = 0.2
"""Minimum size of a pivot relative to the largest entry of its row."""


def largest(x: ca.SX) -> ca.SX:
    """Return the largest absolute entry of a vector; 0 if it is empty."""
    size = ca.SX(0)
    for entry in ca.vertsplit(x):
        size = ca.fmax(size, ca.fabs(entry))
    return size


def square(J: ca.SX, b: ca.SX, pattern: np.ndarray, sample: Array) -> tuple[ca.SX, ca.SX]:
    """Return the solution x (n,) of J x = b by elimination, and the determinant of J up to a constant sign.

    `pattern` (n, n) marks the entries of J (n, n) that can differ from 0. `sample` (n, n) is J in one state, used to
    choose a stable pivot order with few fill-ins.
    """
    n = len(sample)
    a = {(i, j): J[i, j] for i in range(n) for j in range(n) if pattern[i, j]}
    y, values = {i: b[i] for i in range(n)}, np.array(sample, float)
    rows, columns = list(range(n)), list(range(n))
    order, determinant = [], ca.SX(1)
    while rows:
        i, j = _pivot(a, values, rows, columns)
        rows.remove(i)
        columns.remove(j)
        inverse = 1 / a[i, j]
        determinant *= a[i, j]
        for r in (r for r in rows if (r, j) in a):
            factor = a[r, j] * inverse
            for c in (c for c in columns if (i, c) in a):
                a[r, c] = a.get((r, c), ca.SX(0)) - factor * a[i, c]
            y[r] = y[r] - factor * y[i]
            values[r, columns] -= values[r, j] / values[i, j] * values[i, columns]
        order.append((i, j, inverse, [c for c in columns if (i, c) in a]))
    x: dict[int, ca.SX] = {}
    for i, j, inverse, others in reversed(order):
        x[j] = (y[i] - sum((a[i, c] * x[c] for c in others), ca.SX(0))) * inverse
    return ca.vertcat(*[x[j] for j in range(n)]), determinant


def _pivot(a: dict, values: Array, rows: list[int], columns: list[int]) -> tuple[int, int]:
    """Return (row, column) of the pivot with the fewest fill-ins (Markowitz), among the sufficiently large pivots."""
    best, at = (np.inf, np.inf), (rows[0], columns[0])
    for i in rows:
        most = max(np.abs(values[i, columns]).max(), 1e-300)
        for j in (j for j in columns if (i, j) in a and abs(values[i, j]) >= _PIVOT * most):
            fill = (sum((i, c) in a for c in columns) - 1) * (sum((r, j) in a for r in rows) - 1)
            best, at = min((best, at), ((fill, -abs(values[i, j]) / most), (i, j)))
    return at


def least_squares(J: ca.SX, b: ca.SX, pattern: np.ndarray) -> ca.SX:
    """Return the shortest x (n,) that minimises |J x - b|, from the normal equations.

    `pattern` (m, n) marks the entries of J (m, n) that can differ from 0; b has m entries.
    """
    n = pattern.shape[1]
    J = ca.SX(J)
    a, diagonal = {}, []
    linked = (pattern.T.astype(int) @ pattern.astype(int)) > 0
    order = _least_filling(linked)
    for s, i in enumerate(order):
        for t, k in enumerate(order[: s + 1]):
            if linked[i, k]:
                common = [r for r in range(len(pattern)) if pattern[r, i] and pattern[r, k]]
                a[s, t] = sum((J[r, i] * J[r, k] for r in common), ca.SX(0))
        a[s, s] = a.get((s, s), ca.SX(0)) * (1 + _FLOOR) + 1e-30
    y = [sum((J[r, i] * b[r] for r in range(len(pattern)) if pattern[r, i]), ca.SX(0)) for i in order]
    lower: dict[tuple[int, int], ca.SX] = {}
    for j in range(n):
        diagonal.append(1 / a[j, j])
        below = [i for i in range(j + 1, n) if (i, j) in a]
        for i in below:
            lower[i, j] = a[i, j] * diagonal[j]
            y[i] = y[i] - lower[i, j] * y[j]
            for k in (k for k in below if k <= i):
                a[i, k] = a.get((i, k), ca.SX(0)) - lower[i, j] * a[k, j]
    y = [v * d for v, d in zip(y, diagonal, strict=True)]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            if (i, j) in lower:
                y[j] = y[j] - lower[i, j] * y[i]
    return ca.vertcat(*[y[order.index(i)] for i in range(n)])


def _least_filling(linked: np.ndarray) -> list[int]:
    """Return an order of elimination in which the next unknown is always the one with the fewest neighbours."""
    linked, left, order = linked.copy(), list(range(len(linked))), []
    while left:
        least = min(left, key=lambda i: int(linked[i, left].sum()))
        left.remove(least)
        order.append(least)
        around = [i for i in left if linked[least, i]]
        linked[np.ix_(around, around)] = True
    return order
