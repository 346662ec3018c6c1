"""Condition numbers and inverses of Jacobians with NumPy, also for singular matrices."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array

_SINGULAR = 1e15
"""Condition number from which a matrix is singular within the rounding of doubles."""

_EIGENVALUES_SUFFICE = 1e-8
"""Squared inverse condition number above which the eigenvalues of J J^T are accurate to eight digits."""


def condition_many(Js: Array) -> Array:
    """Return the condition numbers (k,) of Js (k, m, n); infinite for matrices that are singular or not finite.

    Eigenvalues of J J^T take half the time of a singular value decomposition, but lose twice as many digits. Singular
    values are computed for the few matrices for which this loss is too large.
    """
    out = np.full(len(Js), np.inf)
    good = np.flatnonzero(np.isfinite(Js).all(axis=(1, 2)))
    J = Js[good]
    Jt = np.swapaxes(J, 1, 2)
    # The smaller of the two products has no eigenvalues that are always zero.
    wide = Js.shape[1] <= Js.shape[2]
    product = J @ Jt if wide else Jt @ J
    squares = np.linalg.eigvalsh(product)
    smallest = squares[:, 0]
    largest = squares[:, -1]
    well = smallest > _EIGENVALUES_SUFFICE * largest
    out[good[well]] = np.sqrt(largest[well] / smallest[well])

    singular_values = np.linalg.svd(J[~well], compute_uv=False)
    largest = singular_values[:, 0]
    smallest = singular_values[:, -1]
    infinite = np.full(len(largest), np.inf)
    out[good[~well]] = np.divide(largest, smallest, out=infinite, where=smallest > 0)
    return out


def invert_many(Js: Array) -> Array:
    """Return the inverses (k, n, m) of Js (k, m, n), pseudo-inverses if not square; NaN if singular or not finite.

    Each matrix is judged by itself, whatever the others of the batch are.
    """
    out = np.full((len(Js), Js.shape[2], Js.shape[1]), np.nan)
    good = np.flatnonzero(np.isfinite(Js).all(axis=(1, 2)))
    if Js.shape[1] != Js.shape[2]:
        regular = good[condition_many(Js[good]) < _SINGULAR]
        out[regular] = np.linalg.pinv(Js[regular])
        return out
    try:
        out[good] = np.linalg.inv(Js[good])
    except np.linalg.LinAlgError:  # one exactly singular matrix causes this error for the whole batch
        for i in good:
            if np.linalg.matrix_rank(Js[i]) == Js.shape[1]:
                out[i] = np.linalg.inv(Js[i])
    # the product of the Frobenius norms is at least the condition number, and at most n times as large
    sizes = np.linalg.norm(Js, axis=(1, 2)) * np.linalg.norm(out, axis=(1, 2))
    out[~(sizes < _SINGULAR)] = np.nan
    return out
