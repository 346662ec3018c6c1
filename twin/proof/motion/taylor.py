"""Taylor models: functions of one variable as a polynomial and a proven bound of everything that it leaves out.

A model on a piece of the path encloses f(x) for x from -1 to 1: the sum of c[k] x^k, k from 0 to the order, differs
from f(x) by at most r. Plain intervals forget that two values depend on the same x, so that a difference of two long
levers is as wide as the levers; a polynomial keeps the dependence, and r shrinks with the (order + 1)-th power of the
piece.

Rounding counts. A sum of floating-point products, added in any order, differs from the exact sum by at most
gamma times the sum of the absolute products (Higham, Accuracy and Stability of Numerical Algorithms, 2002, 3.1).
Every operation adds this bound to r; bounds themselves are enlarged by a fraction that exceeds their own rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from twin.core.spatial import Array
from twin.proof.rounding import BOUND_MARGIN, SMALLEST_BOUND, UNIT_ROUNDOFF

_FUNCTION_ERROR = 2.0**-49
"""Error of the sine and the cosine of NumPy, 16 units in the last place of 1; NumPy documents 4."""

_FACTOR_ROUNDINGS = 32
"""Bound of the number of roundings in a Taylor coefficient of a root or of a reciprocal, powers included."""

_LARGEST_EXPONENT = 700.0
"""Exponents beyond which the exponential would overflow."""

Product = Callable[[Array, Array], Array]
"""Function that multiplies two arrays, entry by entry or as matrices."""


def _gamma(terms: int) -> float:
    """Return the bound of the relative rounding error of a sum of products; see the module."""
    return (terms + 2) * UNIT_ROUNDOFF


def _up(bound: Array) -> Array:
    """Return a bound enlarged by its own rounding."""
    return bound * BOUND_MARGIN + SMALLEST_BOUND


@dataclass(frozen=True)
class TaylorModel:
    """Functions of x in [-1, 1], one for each entry of the arrays.

    Attributes:
        c: (order + 1, ...) coefficients of the powers of x.
        r: (...) bound of the difference between polynomial and function; infinite where nothing is known.
    """

    c: Array
    r: Array

    # NumPy arrays leave their operators to this class
    __array_ufunc__ = None

    @property
    def order(self) -> int:
        """Degree of the polynomials."""
        return len(self.c) - 1

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the entries."""
        return self.r.shape

    def __getitem__(self, index: Any) -> TaylorModel:
        """Return some of the functions; the index is one of NumPy, for the dimensions of the entries."""
        entries = index
        if not isinstance(index, tuple):
            entries = (index,)
        return TaylorModel(self.c[(slice(None), *entries)], self.r[entries])

    def __neg__(self) -> TaylorModel:
        """Return the negative functions."""
        return TaylorModel(-self.c, self.r)

    def __add__(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Return the sums."""
        b = self.like(other)
        c = self.c + b.c
        rounding = UNIT_ROUNDOFF * np.abs(c).sum(axis=0)
        return TaylorModel(c, _up(self.r + b.r + rounding))

    __radd__ = __add__

    def __sub__(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Return the differences."""
        return self + (-self.like(other))

    def __rsub__(self, other: Array | float) -> TaylorModel:
        """Return the differences of numbers and these functions."""
        return self.like(other) - self

    def __mul__(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Return the products, entry by entry."""
        if isinstance(other, TaylorModel):
            return _product(self, other, np.multiply, 1)
        factor = np.asarray(other, float)
        c = self.c * factor
        rounding = UNIT_ROUNDOFF * np.abs(c).sum(axis=0)
        return TaylorModel(c, _up(self.r * np.abs(factor) + rounding))

    __rmul__ = __mul__

    def __matmul__(self, other: TaylorModel | Array) -> TaylorModel:
        """Return matrix products over the last two dimensions."""
        if isinstance(other, TaylorModel):
            return _product(self, other, np.matmul, self.shape[-1])
        matrix = np.asarray(other, float)
        c = self.c @ matrix
        sizes = np.abs(self.c).sum(axis=0)
        gamma = _gamma(self.shape[-1])
        return TaylorModel(c, _up((self.r + gamma * sizes) @ np.abs(matrix)))

    def before(self, matrix: Array) -> TaylorModel:
        """Return the products matrix @ self over the last two dimensions, with numbers (..., m, n) in the matrix."""
        c = matrix @ self.c
        sizes = np.abs(self.c).sum(axis=0)
        gamma = _gamma(matrix.shape[-1])
        return TaylorModel(c, _up(np.abs(matrix) @ (self.r + gamma * sizes)))

    def like(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Return numbers as constant functions of this order; functions as they are."""
        if isinstance(other, TaylorModel):
            return other
        numbers = np.asarray(other, float)
        missing = len(self.shape) - numbers.ndim
        return constant(numbers.reshape((1,) * max(missing, 0) + numbers.shape), self.order)

    def swapped(self) -> TaylorModel:
        """Return transposed matrices."""
        return TaylorModel(np.swapaxes(self.c, -1, -2), np.swapaxes(self.r, -1, -2))

    def total(self, axis: int = -1) -> TaylorModel:
        """Return the sum over a dimension of the entries, counted from the end."""
        c = self.c.sum(axis=axis)
        gamma = self.shape[axis] * UNIT_ROUNDOFF
        sizes = np.abs(self.c).sum(axis=0).sum(axis=axis)
        return TaylorModel(c, _up(self.r.sum(axis=axis) + gamma * sizes))

    def widened(self, radius: Array) -> TaylorModel:
        """Return functions that may differ from these by `radius` (...) more."""
        return TaylorModel(self.c, _up(self.r + radius))

    def sizes(self) -> Array:
        """Return upper bounds (...) of the absolute values."""
        return _up(np.abs(self.c).sum(axis=0) + self.r)

    def sine_cosine(self) -> tuple[TaylorModel, TaylorModel]:
        """Return sine and cosine."""
        sine = np.sin(self.c[0])
        cosine = np.cos(self.c[0])
        varying_part, size = self._varying_part()
        # the derivatives of the sine: sine, cosine, -sine, -cosine, and again
        cycle = (sine, cosine, -sine, -cosine)
        left_out = size ** (self.order + 1) / math.factorial(self.order + 1)
        # sum of size^k / k!, which the errors of the rounded sines and cosines are multiplied by
        errors = left_out + 2 * _FUNCTION_ERROR * np.exp(np.minimum(size, _LARGEST_EXPONENT))
        powers = varying_part._powers()
        factors_of_sine = []
        factors_of_cosine = []
        for k in range(self.order + 1):
            factors_of_sine.append(cycle[k % 4] / math.factorial(k))
            factors_of_cosine.append(cycle[(k + 1) % 4] / math.factorial(k))
        return (
            _combined(powers, factors_of_sine).widened(errors),
            _combined(powers, factors_of_cosine).widened(errors),
        )

    def root(self) -> TaylorModel:
        """Return the square root; unknown (r infinite) where the function may be zero or negative."""
        varying_part, size = self._varying_part()
        base = self.c[0]
        smallest = base - size
        positive = smallest > 0
        safe = np.where(positive, base, 1.0)
        nearest = np.where(positive, smallest, 1.0) / BOUND_MARGIN
        factors = []
        for k in range(self.order + 1):
            factors.append(_binomial_of_root(k) * safe ** (0.5 - k))
        left_out = abs(_binomial_of_root(self.order + 1)) * nearest ** (0.5 - self.order - 1) * size ** (self.order + 1)
        return _from_factors(varying_part, size, factors, left_out, positive)

    def inverted(self) -> TaylorModel:
        """Return the reciprocal of a positive function; unknown (r infinite) where the function may be zero."""
        varying_part, size = self._varying_part()
        base = self.c[0]
        positive = base - size > 0
        safe = np.where(positive, base, 1.0)
        nearest = np.where(positive, base - size, 1.0) / BOUND_MARGIN
        # the Taylor coefficients of 1 / x at the constant term, with alternating signs
        factors = [(-1.0) ** k * safe ** (-1.0 - k) for k in range(self.order + 1)]
        left_out = (size / safe) ** (self.order + 1) / nearest
        return _from_factors(varying_part, size, factors, left_out, positive)

    def _varying_part(self) -> tuple[TaylorModel, Array]:
        """Return (the functions without their constant term, bounds of their absolute values)."""
        c = self.c.copy()
        c[0] = 0.0
        return TaylorModel(c, self.r), _up(np.abs(c).sum(axis=0) + self.r)

    def _powers(self) -> list[TaylorModel]:
        """Return the powers 0 to `order`."""
        powers = [constant(np.ones(self.shape), self.order), self]
        for _ in range(2, self.order + 1):
            powers.append(powers[-1] * self)
        return powers[: self.order + 1]

    def on_parts(self, middle: Array, width: Array) -> TaylorModel:
        """Return the functions on parts of the pieces, as models in a new x.

        The old x is middle + width x; a part must be within the piece: |middle| + |width| <= 1. Both have the shape of
        the entries, or one that numpy broadcasts to it.
        """
        order = self.order
        c = [np.zeros(np.broadcast_shapes(self.shape, np.shape(middle)))] * (order + 1)
        sizes = np.zeros(c[0].shape)
        for k in range(order + 1):
            for j in range(k + 1):
                term = self.c[k] * (math.comb(k, j) * middle ** (k - j) * width**j)
                c[j] = c[j] + term
                sizes = sizes + np.abs(term)
        return TaylorModel(np.array(c), _up(self.r + 8 * (order + 2) * UNIT_ROUNDOFF * sizes))

    def range(self) -> tuple[Array, Array]:
        """Return proven (lower, upper) bounds (...) over the piece: those of the Bernstein coefficients.

        At both ends of the piece they are exact but for r, so that a function that only rises has its last value as
        its upper bound.
        """
        matrix = _bernstein(self.order)
        coefficients = np.tensordot(matrix, self.c, axes=1)
        sizes = np.tensordot(np.abs(matrix), np.abs(self.c), axes=1).max(axis=0)
        error = _up(self.r + 2 * (self.order + 3) * UNIT_ROUNDOFF * sizes)
        low = coefficients.min(axis=0) - error
        high = coefficients.max(axis=0) + error
        # one subtraction or addition more
        spread = 2 * UNIT_ROUNDOFF * (np.abs(low) + np.abs(high))
        low = np.where(np.isfinite(low), low - spread, -np.inf)
        high = np.where(np.isfinite(high), high + spread, np.inf)
        return low, high


def constant(values: Array, order: int) -> TaylorModel:
    """Return constant functions with exact values (...)."""
    c = np.zeros((order + 1, *np.shape(values)))
    c[0] = values
    return TaylorModel(c, np.zeros(np.shape(values)))


def stacked(models: Sequence[TaylorModel], axis: int = -1) -> TaylorModel:
    """Return models side by side along a new dimension, counted from the end."""
    coefficients, bounds = _coefficients_and_bounds(models)
    c = np.stack(np.broadcast_arrays(*coefficients), axis=axis)
    r = np.stack(np.broadcast_arrays(*bounds), axis=axis)
    return TaylorModel(c, r)


def joined(models: Sequence[TaylorModel]) -> TaylorModel:
    """Return models one after the other along the first dimension of the entries."""
    coefficients, bounds = _coefficients_and_bounds(models)
    return TaylorModel(np.concatenate(coefficients, axis=1), np.concatenate(bounds, axis=0))


def _coefficients_and_bounds(models: Sequence[TaylorModel]) -> tuple[list[Array], list[Array]]:
    """Return the arrays `c` and the arrays `r` of some models."""
    coefficients = []
    bounds = []
    for model in models:
        coefficients.append(model.c)
        bounds.append(model.r)
    return coefficients, bounds


def cross(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Return cross products over the last dimension."""
    parts = []
    for i, j in ((1, 2), (2, 0), (0, 1)):  # x = a_y b_z - a_z b_y, and so on
        parts.append(a[..., i] * b[..., j] - a[..., j] * b[..., i])
    return stacked(parts)


def _binomial_of_root(k: int) -> float:
    """Return the binomial coefficient (1/2 over k)."""
    binomial = 1.0
    for i in range(k):
        binomial *= (0.5 - i) / (i + 1)
    return binomial


def _product(a: TaylorModel, b: TaylorModel, times: Product, terms: int) -> TaylorModel:
    """Return products; `times` multiplies arrays and adds `terms` products for each entry."""
    order = a.order
    c = []
    for k in range(order + 1):
        total = times(a.c[0], b.c[k])
        for i in range(1, k + 1):
            total = total + times(a.c[i], b.c[k - i])
        c.append(total)
    sizes_a = np.abs(a.c)
    sizes_b = np.abs(b.c)
    tails = np.cumsum(sizes_b[::-1], axis=0)[::-1]  # tails[m]: sum of the sizes from m on
    whole_a = sizes_a.sum(axis=0)
    whole_b = tails[0]
    gamma = 2 * (terms + order + 3) * UNIT_ROUNDOFF
    error = times(whole_a, gamma * whole_b + b.r) + times(a.r, whole_b + b.r)
    for i in range(1, order + 1):
        error = error + times(sizes_a[i], tails[order + 1 - i])
    return TaylorModel(np.array(c), _up(error))


def _combined(powers: Sequence[TaylorModel], factors: Sequence[Array]) -> TaylorModel:
    """Return the sum of factors times powers."""
    combination = powers[0] * factors[0]
    for power, factor in zip(powers[1:], factors[1:], strict=True):
        combination = combination + power * factor
    return combination


def _from_factors(
    varying_part: TaylorModel, size: Array, factors: Sequence[Array], left_out: Array, is_known: np.ndarray
) -> TaylorModel:
    """Return the sum of rounded factors times powers of `varying_part`; infinitely wide where it is not known."""
    with np.errstate(over="ignore", invalid="ignore"):
        rounding = np.zeros(size.shape)
        for k, factor in enumerate(factors):
            rounding = rounding + np.abs(factor) * size**k
        error = left_out + _FACTOR_ROUNDINGS * UNIT_ROUNDOFF * rounding
        combination = _combined(varying_part._powers(), factors).widened(error)
    return TaylorModel(np.where(is_known, combination.c, 0.0), np.where(is_known, combination.r, np.inf))


_MATRICES: dict[int, Array] = {}


def _bernstein(order: int) -> Array:
    """Return the matrix from coefficients of powers of x on [-1, 1] to Bernstein coefficients."""
    if order not in _MATRICES:
        # x = 2 u - 1: the powers of x in those of u, then those of u in the Bernstein basis, as exact fractions
        matrix = np.zeros((order + 1, order + 1))
        for i in range(order + 1):
            for k in range(order + 1):
                entry = Fraction(0)
                for j in range(min(i, k) + 1):
                    in_u = math.comb(k, j) * 2**j * (-1) ** (k - j)
                    entry += Fraction(in_u * math.comb(i, j), math.comb(order, j))
                matrix[i, k] = float(entry)
        _MATRICES[order] = matrix
    return _MATRICES[order]
