"""The determinant of the loops' Jacobian along a path, by its logarithm; it is not 0 away from singular states."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.proof.motion.closure import MARGIN, ClosedLinkage
from twin.proof.motion.pieces import OVERLAP
from twin.proof.motion.taylor import TaylorModel, stacked

_SMALLEST_DIAGONAL = 1e-12
"""Smallest entry of the diagonal of a triangular matrix that is inverted, in m per m or rad."""

_LARGEST_NORM = 0.9
"""Largest norm |E| with which a determinant is bounded: at 1, its bound is infinite."""

_QUOTIENT_MARGIN = 1.0 + 1e-9
"""Factor that exceeds the rounding of |E|^2 / (1 - |E|), where the difference is at least 0.1."""

_LOGARITHM_ERROR = 1e-13
"""Bound of the rounding of a logarithm, at most 28 by `_SMALLEST_DIAGONAL`, and of adding it to others."""

_START_WIDTH = 0.9
"""Half of the interval around the start, as a fraction of `OVERLAP`; below 1, it is within the first piece."""


def log_determinant(closed: ClosedLinkage) -> tuple[TaylorModel, Array] | None:
    """Return the logarithm of the determinant of the loops' Jacobian J: (Taylor models (N,), further error (N,)).

    The determinant is the root of det(J^T J), for square J the absolute value of det J. With a triangular matrix U such
    that J U^-1 is nearly orthogonal, det(J^T J) = det(1 + E) det(U)^2, and |log det(1 + E) - tr E| is at most
    |E|^2 / (2 (1 - |E|)) for the Frobenius norm |E| < 1. None without loops.
    """
    if closed.jacobian is None:
        return None
    J = closed.jacobian
    size = J.shape[-1]
    middle = np.where(np.isfinite(J.c[0]), J.c[0], 0.0)
    upper = np.linalg.qr(middle, mode="r")
    diagonal = np.abs(np.diagonal(upper, axis1=1, axis2=2))
    is_regular = diagonal.min(axis=1) > _SMALLEST_DIAGONAL
    upper = np.where(is_regular[:, None, None], upper, np.eye(size))
    inverse = np.triu(np.linalg.inv(upper))
    nearly_orthogonal = J @ inverse
    E = nearly_orthogonal.swapped() @ nearly_orthogonal - np.eye(size)
    norm = np.sqrt((E.sizes() ** 2).sum(axis=(1, 2))) * MARGIN
    is_bounded = is_regular & closed.closed & (norm < _LARGEST_NORM)
    # all by half, for the root: the bound of the docstring, and tr E
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond_trace = 0.25 * norm**2 / (1.0 - norm) * _QUOTIENT_MARGIN
    error = np.where(is_bounded, beyond_trace + _LOGARITHM_ERROR * size, np.inf)
    half_trace = _trace(E) * 0.5
    log_upper = -np.log(np.abs(np.diagonal(inverse, axis1=1, axis2=2))).sum(axis=1)
    return half_trace + log_upper, error


def start_log_determinant(logs: TaylorModel, error: Array) -> tuple[float, float]:
    """Return bounds of `log_determinant` at the start of the path, -1 / (1 + OVERLAP) on the first piece."""
    around_start = logs.on_parts(np.asarray(-1.0 + OVERLAP), np.asarray(_START_WIDTH * OVERLAP))
    low, high = around_start[0].range()
    if not (np.isfinite(low) and np.isfinite(high) and np.isfinite(error[0])):
        return -np.inf, np.inf
    return float(low - error[0]), float(high + error[0])


def _trace(E: TaylorModel) -> TaylorModel:
    """Return the traces (N,) of matrices (N, n, n)."""
    diagonal = [E[:, i, i] for i in range(E.shape[-1])]
    return stacked(diagonal).total(-1)
