"""Chebyshev series of a path as Taylor models on pieces of the path.

The Taylor coefficients of the Chebyshev polynomials T_j at the middle of a piece follow from the recurrence
T_{j+1} = 2 x T_j - T_{j-1}, differentiated k times: t_{j+1}^k = 2 x t_j^k + 2 t_j^{k-1} - t_{j-1}^k with t^k the k-th
derivative divided by k!. An error made at index i reaches index j multiplied by U_{j-i}(x), at most j - i + 1, and
the errors of order k - 1 enter those of order k. What the coefficients up to `_TERMS` leave out is bounded by Markov's
inequality: on [-1, 1] no derivative of T_j is larger than at x = 1.
"""

from __future__ import annotations

import math

import numpy as np

from twin.core.spatial import Array
from twin.proof.motion.taylor import TaylorModel, constant
from twin.proof.rounding import BOUND_MARGIN, SMALLEST_BOUND, UNIT_ROUNDOFF

_LOGARITHM_MARGIN = 1.0 + 1e-9
"""Factor by which a bound is enlarged that is computed by logarithms and exponentials."""

_TERMS = 16
"""Number of Taylor coefficients of a series; those beyond the order of a model enlarge its bound."""


def on_pieces(coefficients: Array, middle: Array, half: Array, order: int) -> tuple[TaylorModel, TaylorModel]:
    """Return (the path (N, n), its derivative with respect to s (N, n)) on N pieces.

    Args:
        coefficients: (degree + 1, n) Chebyshev coefficients in 2 s - 1.
        middle: (N,) middle in s of each piece.
        half: (N,) half of its length in s.
        order: degree of the Taylor models.
    """
    x = 2.0 * middle - 1.0  # exact to one rounding, counted below
    terms = min(_TERMS, len(coefficients) - 1)
    values, errors = _coefficients(coefficients, x, terms)
    # a rounding of x moves the middle; the pieces are enlarged by more than that
    width = 2.0 * half
    beyond = _markov(coefficients, terms + 1)
    path = _model(values, errors, beyond, width, order)
    # the derivative with respect to s is twice that with respect to x
    counts = np.arange(1, terms + 1)[:, None, None]
    slopes = 2.0 * counts * values[1:]
    slope_errors = 2.0 * counts * errors[1:] + 4 * UNIT_ROUNDOFF * np.abs(slopes)
    slope_beyond = 2.0 * (terms + 1) * beyond
    if terms == 0:
        return path, constant(np.zeros(path.shape), order)
    return path, _model(slopes, slope_errors, slope_beyond, width, order)


def _coefficients(coefficients: Array, x: Array, terms: int) -> tuple[Array, Array]:
    """Return (Taylor coefficients (terms + 1, N, n) of the series at x (N,), bounds of their errors)."""
    count = len(x)
    before = np.zeros((terms + 1, count))  # t_{j-1}
    current = np.zeros((terms + 1, count))  # t_j
    current[0] = 1.0
    # errors of t_j, and the sums of the errors that were added up to j
    error = np.zeros((terms + 1, count))
    added = np.zeros((terms + 1, count))
    values = coefficients[0] * current[:, :, None]
    bounds = np.zeros(values.shape)
    sizes = np.abs(values)
    for j in range(1, len(coefficients)):
        lower = np.zeros_like(current)
        lower[1:] = current[:-1]
        lower_error = np.zeros_like(error)
        lower_error[1:] = error[:-1]
        factor = 2.0
        if j == 1:
            factor = 1.0  # T_1 = x T_0
        after = factor * x * current + factor * lower - before
        size = factor * np.abs(x) * np.abs(current) + factor * np.abs(lower) + np.abs(before)
        # the rounding of x (one unit) counts like that of a product
        added = added + 6 * UNIT_ROUNDOFF * size + factor * lower_error
        error = (error + added) * BOUND_MARGIN
        before = current
        current = after
        term = coefficients[j] * current[:, :, None]
        values = values + term
        bounds = bounds + np.abs(coefficients[j]) * error[:, :, None]
        sizes = sizes + np.abs(term)
    rounding = (len(coefficients) + 2) * UNIT_ROUNDOFF * sizes
    return values, (bounds + rounding) * BOUND_MARGIN


def _markov(coefficients: Array, k: int) -> Array:
    """Return bounds (n,) over [-1, 1] of the k-th derivative of a series divided by k!."""
    bound = np.zeros(coefficients.shape[1])
    for j in range(k, len(coefficients)):
        # the k-th derivative of T_j at x = 1 is the product of these quotients
        log = -math.lgamma(k + 1)
        for i in range(k):
            log += math.log((j * j - i * i) / (2 * i + 1))
        bound = bound + np.abs(coefficients[j]) * math.exp(log)
    return bound * _LOGARITHM_MARGIN


def _model(values: Array, errors: Array, beyond: Array, width: Array, order: int) -> TaylorModel:
    """Return the Taylor models of functions on pieces.

    Args:
        values: (terms, N, n) Taylor coefficients in the middle of the pieces.
        errors: (terms, N, n) bounds of their errors.
        beyond: (n,) bounds of the next coefficient at any place of a piece.
        width: (N,) half of the length of the pieces, in the variable of the coefficients.
        order: degree of the models; further terms enlarge their bounds.
    """
    count, points, n = values.shape
    c = np.zeros((order + 1, points, n))
    r = np.zeros((points, n))
    for k in range(count):
        scale = (width**k)[:, None]
        term = values[k] * scale
        r = r + errors[k] * scale
        if k <= order:
            c[k] = term
            r = r + (2 * k + 2) * UNIT_ROUNDOFF * np.abs(term)
        else:
            r = r + np.abs(term)
    r = r + beyond * (width**count)[:, None]
    return TaylorModel(c, r * BOUND_MARGIN + SMALLEST_BOUND)
