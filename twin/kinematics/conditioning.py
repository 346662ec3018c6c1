"""Condition numbers and inverses of Jacobians with NumPy, also for singular matrices."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array

_SINGULAR_CONDITION = 1e15
"""Condition number from which a matrix is singular within the rounding of doubles."""

_ACCURATE_EIGENVALUE_RATIO = 1e-8
"""Squared inverse condition number above which the eigenvalues of J J^T are accurate to eight digits."""


def condition_many(Js: Array) -> Array:
    """Return the condition numbers (k,) of Js (k, m, n); infinite for matrices that are singular or not finite.

    Singular means a smallest singular value of exactly 0; a matrix that is singular but for rounding has about 1e16.

    Eigenvalues of J J^T take half the time of a singular value decomposition, but lose twice as many digits. Singular
    values are computed for the few matrices for which this loss is too large.
    """
    conditions = np.full(len(Js), np.inf)
    finite = np.flatnonzero(np.isfinite(Js).all(axis=(1, 2)))
    J = Js[finite]
    Jt = np.swapaxes(J, 1, 2)
    # The smaller of the two products has no eigenvalues that are always zero.
    wide = Js.shape[1] <= Js.shape[2]
    product = J @ Jt if wide else Jt @ J
    squares = np.linalg.eigvalsh(product)
    smallest = squares[:, 0]
    largest = squares[:, -1]
    is_accurate = smallest > _ACCURATE_EIGENVALUE_RATIO * largest
    conditions[finite[is_accurate]] = np.sqrt(largest[is_accurate] / smallest[is_accurate])

    singular_values = np.linalg.svd(J[~is_accurate], compute_uv=False)
    largest = singular_values[:, 0]
    smallest = singular_values[:, -1]
    infinite = np.full(len(largest), np.inf)
    conditions[finite[~is_accurate]] = np.divide(largest, smallest, out=infinite, where=smallest > 0)
    return conditions


def invert_many(Js: Array) -> Array:
    """Return the inverses (k, n, m) of Js (k, m, n), pseudo-inverses if not square; NaN if singular or not finite.

    Singular means a condition number of `_SINGULAR_CONDITION` or more; of square matrices, a bound of it is taken that
    is at most n times as large.
    Each matrix is judged by itself, whatever the others of the batch are.
    """
    inverses = np.full((len(Js), Js.shape[2], Js.shape[1]), np.nan)
    finite = np.flatnonzero(np.isfinite(Js).all(axis=(1, 2)))
    if Js.shape[1] != Js.shape[2]:
        regular = finite[condition_many(Js[finite]) < _SINGULAR_CONDITION]
        inverses[regular] = np.linalg.pinv(Js[regular])
        return inverses
    try:
        inverses[finite] = np.linalg.inv(Js[finite])
    except np.linalg.LinAlgError:  # one exactly singular matrix causes this error for the whole batch
        for i in finite:
            if np.linalg.matrix_rank(Js[i]) == Js.shape[1]:
                inverses[i] = np.linalg.inv(Js[i])
    # the product of the Frobenius norms is at least the condition number, and at most n times as large
    sizes = np.linalg.norm(Js, axis=(1, 2)) * np.linalg.norm(inverses, axis=(1, 2))
    inverses[~(sizes < _SINGULAR_CONDITION)] = np.nan
    return inverses
