"""Solve small linear systems by unrolled code: it has no loops, no run-time pivoting and no products with zero."""

from __future__ import annotations

import casadi as ca
import numpy as np

from twin.core.spatial import Array

_RELATIVE_DAMPING = 1e-13
"""Damping relative to the diagonal: it makes the step of undetermined unknowns minimal and changes no other unknown."""

_SMALLEST_PIVOT_RATIO = 0.2
"""Minimum size of a pivot relative to the largest entry of its row."""

_EMPTY_DIAGONAL = 1e-30
"""Diagonal element of an unknown without equations: its step is then zero, and not infinite."""

_SMALLEST_ENTRY = 1e-300
"""Entry that stands for 0 in a quotient."""


def largest(x: ca.SX) -> ca.SX:
    """Return the largest absolute entry of a vector; 0 if it is empty."""
    size = ca.SX(0)
    for entry in ca.vertsplit(x):
        size = ca.fmax(size, ca.fabs(entry))
    return size


def solve_square(J: ca.SX, b: ca.SX, pattern: np.ndarray, sample: Array) -> tuple[ca.SX, ca.SX]:
    """Return the solution x (n,) of J x = b by elimination, and the determinant of J up to a constant sign.

    `pattern` (n, n) marks the entries of J (n, n) that can differ from 0. `sample` (n, n) is J in one state, used to
    choose a stable pivot order with few fill-ins.
    """
    count = len(sample)
    entries: dict[tuple[int, int], ca.SX] = {}
    for i in range(count):
        for j in np.flatnonzero(pattern[i]):
            entries[i, int(j)] = J[i, int(j)]
    right_side = ca.vertsplit(b)
    values = np.array(sample, float)
    rows = list(range(count))
    columns = list(range(count))
    order: list[tuple[int, int, ca.SX, list[int]]] = []
    determinant = ca.SX(1)
    while rows:
        i, j = _pivot(entries, values, rows, columns)
        rows.remove(i)
        columns.remove(j)
        inverse = 1 / entries[i, j]
        determinant *= entries[i, j]
        others = []
        for c in columns:
            if (i, c) in entries:
                others.append(c)
        for r in rows:
            if (r, j) not in entries:
                continue
            factor = entries[r, j] * inverse
            for c in others:
                entries[r, c] = entries.get((r, c), ca.SX(0)) - factor * entries[i, c]
            right_side[r] = right_side[r] - factor * right_side[i]
            # The same elimination in numbers: later pivots are chosen by them.
            values[r, columns] -= values[r, j] / values[i, j] * values[i, columns]
        order.append((i, j, inverse, others))

    x: dict[int, ca.SX] = {}
    for i, j, inverse, others in reversed(order):
        known_part = ca.SX(0)
        for c in others:
            known_part = known_part + entries[i, c] * x[c]
        x[j] = (right_side[i] - known_part) * inverse
    return ca.vertcat(*[x[j] for j in range(count)]), determinant


def _pivot(entries: dict, values: Array, rows: list[int], columns: list[int]) -> tuple[int, int]:
    """Return (row, column) of the pivot with the fewest fill-ins (Markowitz), among the sufficiently large pivots."""
    best_cost = (np.inf, np.inf)
    best_pivot = (rows[0], columns[0])
    for i in rows:
        largest_entry = max(np.abs(values[i, columns]).max(), _SMALLEST_ENTRY)
        for j in columns:
            large = abs(values[i, j]) >= _SMALLEST_PIVOT_RATIO * largest_entry
            if (i, j) not in entries or not large:
                continue
            in_row = 0
            for c in columns:
                if (i, c) in entries:
                    in_row += 1
            in_column = 0
            for r in rows:
                if (r, j) in entries:
                    in_column += 1
            # Elimination with this pivot links every other entry of its row with every other one of its column.
            fill_ins = (in_row - 1) * (in_column - 1)
            # Of pivots with equal fill-ins, the relatively largest is the most stable.
            candidate = (fill_ins, -abs(values[i, j]) / largest_entry)
            best_cost, best_pivot = min((best_cost, best_pivot), (candidate, (i, j)))
    return best_pivot


def solve_least_squares(J: ca.SX, b: ca.SX, pattern: np.ndarray) -> ca.SX:
    """Return the shortest x (n,) that minimises |J x - b|, from the normal equations.

    `pattern` (m, n) marks the entries of J (m, n) that can differ from 0; b has m entries.
    """
    J = ca.SX(J)
    linked = (pattern.T.astype(int) @ pattern.astype(int)) > 0
    order = _elimination_order(linked)
    normal_matrix = _normal_matrix(J, pattern, linked, order)
    right_side: list[ca.SX] = []
    for i in order:
        product = ca.SX(0)
        for r in np.flatnonzero(pattern[:, i]):
            product = product + J[int(r), i] * b[int(r)]
        right_side.append(product)

    # A = L D L^T without square roots; forward substitution of the right side beside it.
    count = len(order)
    lower: dict[tuple[int, int], ca.SX] = {}
    reciprocals: list[ca.SX] = []
    for j in range(count):
        reciprocals.append(1 / normal_matrix[j, j])
        below = []
        for i in range(j + 1, count):
            if (i, j) in normal_matrix:
                below.append(i)
        for i in below:
            lower[i, j] = normal_matrix[i, j] * reciprocals[j]
            right_side[i] = right_side[i] - lower[i, j] * right_side[j]
            for k in below:
                if k > i:
                    break
                normal_matrix[i, k] = normal_matrix.get((i, k), ca.SX(0)) - lower[i, j] * normal_matrix[k, j]

    for j in range(count):
        right_side[j] = right_side[j] * reciprocals[j]
    for j in range(count - 1, -1, -1):
        for i in range(j + 1, count):
            if (i, j) in lower:
                right_side[j] = right_side[j] - lower[i, j] * right_side[i]
    # `right_side` has the order of elimination; the caller's order is that of the unknowns
    solution = []
    for i in range(count):
        solution.append(right_side[order.index(i)])
    return ca.vertcat(*solution)


def _normal_matrix(J: ca.SX, pattern: np.ndarray, linked: np.ndarray, order: list[int]) -> dict[tuple[int, int], ca.SX]:
    """Return the lower half of J^T J with damped diagonal, its rows and columns in this order; zeros are absent."""
    entries: dict[tuple[int, int], ca.SX] = {}
    for row, i in enumerate(order):
        for column, k in enumerate(order[: row + 1]):
            if not linked[i, k]:
                continue
            entry = ca.SX(0)
            for r in np.flatnonzero(pattern[:, i] & pattern[:, k]):
                entry = entry + J[int(r), i] * J[int(r), k]
            entries[row, column] = entry
        entries[row, row] = entries.get((row, row), ca.SX(0)) * (1 + _RELATIVE_DAMPING) + _EMPTY_DIAGONAL
    return entries


def _elimination_order(linked: np.ndarray) -> list[int]:
    """Return an order of elimination in which the next unknown is always the one with the fewest neighbours."""
    linked = linked.copy()
    remaining = list(range(len(linked)))
    order: list[int] = []
    while remaining:
        neighbour_counts = linked[np.ix_(remaining, remaining)].sum(axis=1).tolist()
        least = remaining[neighbour_counts.index(min(neighbour_counts))]
        remaining.remove(least)
        order.append(least)
        # The elimination of an unknown links all its neighbours.
        neighbours = []
        for i in remaining:
            if linked[least, i]:
                neighbours.append(i)
        linked[np.ix_(neighbours, neighbours)] = True
    return order
