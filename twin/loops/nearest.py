"""The step that comes nearest to what is wanted without leaving what is allowed."""

from __future__ import annotations

import numpy as np

from twin.spatial import Array

_FEASIBLE = 1e-10
"""Relative to the size of a row: what is broken by less is kept."""


def nearest_step(J: Array, miss: Array, damping: float, G: Array, h: Array) -> Array:
    """Return y (n,) that minimises |J y - miss|² + damping |y|² subject to G y >= h.

    The bounded case is a least distance problem, solved by the non-negative least squares of its dual
    (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, chapter 23).

    Args:
        J: (m, n).
        miss: (m,).
        damping: above 0.
        G: (k, n).
        h: (k,), at most 0 where y = 0 is to be allowed.
    """
    from scipy.optimize import nnls

    n = J.shape[1]
    H = J.T @ J + damping * np.eye(n)
    free = np.linalg.solve(H, J.T @ miss)
    near = G @ free - h
    if not len(h) or (near >= -_FEASIBLE).all():
        return free
    root = np.linalg.inv(np.linalg.cholesky(H))  # H = L L^T; z = L^T (y - free)
    E = np.vstack([root @ G.T, -near])  # of the rows G L^-T z >= -near
    weights, _ = nnls(E, np.eye(n + 1)[n], maxiter=50 * (len(h) + 1))
    r = E @ weights - np.eye(n + 1)[n]
    if -r[n] < 1e-12:  # nothing is allowed at all: stay
        return np.zeros(n)
    return free + root.T @ (-r[:n] / r[n])
