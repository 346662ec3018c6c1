"""Poses (4, 4) of exact values, as rows. Each value is at k states; see `values`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from twin.proof import program, values
from twin.proof.values import Angle, ExactValue

Matrix = list[list[ExactValue]]
"""A pose (4, 4), as rows."""


def compose(A: Matrix, B: Matrix) -> Matrix:
    """Return A B of two poses."""
    rows = []
    for i in range(3):
        row = []
        for j in range(4):
            terms = []
            for k in range(3):
                terms.append(_product(A[i][k], B[k][j]))
            if j == 3:
                terms.append(A[i][3])
            row.append(_total(terms))
        rows.append(row)
    return [*rows, B[3]]


def inverse(A: Matrix) -> Matrix:
    """Return the inverse of a pose: the transposed rotation, and the origin of the other frame."""
    rows = []
    for i in range(3):
        products = []
        for k in range(3):
            products.append(_product(A[k][i], A[k][3]))
        rows.append([A[0][i], A[1][i], A[2][i], values.minus(_total(products))])
    return [*rows, A[3]]


def _product(a: ExactValue, b: ExactValue) -> ExactValue:
    """Return a b; most entries of poses are 0 or 1, and need no multiplication."""
    for first, second in ((a, b), (b, a)):
        if program.is_zero(first.node):
            return first
        if program.is_one(first.node):
            return second
    return values.product(a, b)


def _total(terms: Sequence[ExactValue]) -> ExactValue:
    """Return the sum of terms."""
    nonzero_terms = [term for term in terms if not program.is_zero(term.node)]
    # All terms are zero: any of them is the sum, and no operation is recorded in the program.
    if not nonzero_terms:
        return terms[0]
    result = nonzero_terms[0]
    for term in nonzero_terms[1:]:
        result = values.total(result, term)
    return result


def identity(states: int) -> Matrix:
    """Return the pose without motion, at a number of states."""
    zero = values.constant(0.0, states)
    one = values.constant(1.0, states)
    return [
        [one, zero, zero, zero],
        [zero, one, zero, zero],
        [zero, zero, one, zero],
        [zero, zero, zero, one],
    ]


def turn(angle: Angle, axis: Literal["x", "z"]) -> Matrix:
    """Return the rotation about the x or the z axis."""
    states = len(angle.real)  # `real`: the angle at each state in double precision
    T = identity(states)
    first, second = {"x": (1, 2), "z": (0, 1)}[axis]
    T[first][first] = angle.cosine
    T[first][second] = values.minus(angle.sine)
    T[second][first] = angle.sine
    T[second][second] = angle.cosine
    return T


def shifted(p: Sequence[ExactValue]) -> Matrix:
    """Return the translation by a vector (3,)."""
    T = identity(len(p[0].real))
    for i in range(3):
        T[i][3] = p[i]
    return T
