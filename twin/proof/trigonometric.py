"""Polynomials in sines and cosines of joint angles and in lengths: sums of terms whose coefficients are balls.

A term is a coefficient times e^(i k.q) times powers of numbers from -1 to 1. Its magnitude is at most that of its
coefficient, so that the sum of these bounds the polynomial for all joint values at once. Equal terms of two models
cancel before anything is bounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.core.errors import TwinError
from twin.core.spatial import Array

Complexes = NDArray[np.complex128]
Keys = NDArray[np.int64]

VARIABLES = 12
"""Maximum number of variables: a term keeps the exponent of each in five bits."""

_BASE = 32
"""Base of the number whose digits are the exponents of a term, from -16 to 15: five bits for each."""

_LARGEST_EXPONENT = 15
"""Largest magnitude of an exponent."""

_PRODUCT_ROUNDING = 2.0**-50
"""Relative rounding error of a product of complex numbers (at most 2.24 times 2^-53), with a margin."""

_SMALL_BOUND = 1e-9
"""Length in m below which a bound needs no improvement."""

_NEGLIGIBLE = 1e-5
"""Share of a bound below which a term is not kept by itself in the square."""

_FURTHER_ROUNDINGS = 20
"""Number of roundings of a bound besides one for each of its terms, with a margin."""

_MOST_SQUARED_TERMS = 400
"""Maximum number of terms that are squared."""

_SUM_ROUNDING = 2.0**-52
"""Relative rounding error of one addition of complex numbers, with a margin."""


@dataclass(frozen=True, eq=False)
class TrigonometricSum:
    """A sum of terms.

    Attributes:
        keys: (n,) exponents of each term, as a number in base 32: different ones, in ascending order.
        centre: (n, ...) centres of the coefficients; further axes are entries of vectors or matrices.
        radius: (n, ...) radii of the coefficients.
        degree: largest magnitude of an exponent.
    """

    keys: Keys
    centre: Complexes
    radius: Array
    degree: int

    @property
    def number(self) -> tuple[float, float] | None:
        """(centre, radius) of a sum that depends on no variable; None for others."""
        if self.keys.size == 0:
            return 0.0, 0.0
        if self.keys.size == 1 and self.keys[0] == 0:
            return float(self.centre[0].real), float(self.radius[0])
        return None

    def __neg__(self) -> TrigonometricSum:
        return TrigonometricSum(self.keys, -self.centre, self.radius, self.degree)

    def __add__(self, other: TrigonometricSum) -> TrigonometricSum:
        keys = np.concatenate([self.keys, other.keys])
        centre = np.concatenate([self.centre, other.centre])
        radius = np.concatenate([self.radius, other.radius])
        return _collected(keys, centre, radius, max(self.degree, other.degree))

    def __sub__(self, other: TrigonometricSum) -> TrigonometricSum:
        return self + -other

    def __mul__(self, other: TrigonometricSum) -> TrigonometricSum:
        """Return the product of two sums of numbers."""
        degree = self._degree_with(other)
        keys = (self.keys[:, None] + other.keys).ravel()
        centre = (self.centre[:, None] * other.centre).ravel()
        size = np.abs(self.centre)
        other_size = np.abs(other.centre)
        radius = size[:, None] * other.radius + self.radius[:, None] * (other_size + other.radius)
        radius = radius * (1 + 4 * _PRODUCT_ROUNDING) + _PRODUCT_ROUNDING * np.abs(centre).reshape(radius.shape)
        return _collected(keys, centre, radius.ravel(), degree)

    def matrix_product(self, other: TrigonometricSum) -> TrigonometricSum:
        """Return the product of two sums of matrices (n, 4, 4).

        Raises:
            TwinError: an exponent would be too large for its digit.
        """
        degree = self._degree_with(other)
        keys = (self.keys[:, None] + other.keys).ravel()
        centre = self.centre[:, None] @ other.centre
        size = np.abs(self.centre)[:, None]
        other_size = np.abs(other.centre)
        radius = size @ other.radius + self.radius[:, None] @ (other_size + other.radius)
        # each entry is the sum of four products
        radius = radius * (1 + 16 * _PRODUCT_ROUNDING) + 8 * _PRODUCT_ROUNDING * (size @ other_size)
        shape = (keys.size, *centre.shape[2:])
        return _collected(keys, centre.reshape(shape), radius.reshape(shape), degree)

    def _degree_with(self, other: TrigonometricSum) -> int:
        """Return a bound of the exponents of the product with another sum, of each variable by itself."""
        largest = np.abs(self.exponents()).max(axis=0, initial=0) + np.abs(other.exponents()).max(axis=0, initial=0)
        degree = int(largest.max())
        if degree > _LARGEST_EXPONENT:
            raise TwinError(
                f"a product of sines and cosines would have the exponent {degree} of one joint; at most "
                f"{_LARGEST_EXPONENT} are possible"
            )
        return degree

    def pruned(self, limit: float) -> TrigonometricSum:
        """Return the sum without terms below a limit; an unknown constant, as large as their sum, replaces them."""
        size = np.abs(self.centre) + self.radius
        largest_entries = size
        if size.ndim > 1:
            largest_entries = size.max(axis=tuple(range(1, size.ndim)))
        small = largest_entries < limit
        if not small.any():
            return self
        replaced = size[small].sum(axis=0) * (1 + (small.sum() + 2) * _PRODUCT_ROUNDING)
        keys = np.concatenate([self.keys[~small], np.zeros(1, np.int64)])
        centre = np.concatenate([self.centre[~small], np.zeros((1, *self.centre.shape[1:]), complex)])
        radius = np.concatenate([self.radius[~small], replaced[None]])
        return _collected(keys, centre, radius, self.degree)

    def split(self, places: Sequence[int]) -> list[TrigonometricSum]:
        """Return the parts of the sum whose terms have equal exponents of the variables with some places."""
        exponents = self.exponents()[:, list(places)]
        parts = []
        for row in np.unique(exponents, axis=0):
            in_part = (exponents == row).all(axis=1)
            parts.append(TrigonometricSum(self.keys[in_part], self.centre[in_part], self.radius[in_part], self.degree))
        return parts

    def exponents(self) -> Keys:
        """Return the exponents (n, VARIABLES) of the terms."""
        remaining_digits = self.keys.copy()
        exponents = np.zeros((remaining_digits.size, VARIABLES), np.int64)
        half = _BASE // 2
        for place in range(VARIABLES):
            # a negative digit borrows from the next one
            digits = (remaining_digits + half) % _BASE - half
            exponents[:, place] = digits
            remaining_digits = (remaining_digits - digits) // _BASE
        return exponents

    def bound(self) -> float:
        """Return an upper bound at all values of the magnitude, or of the root of the sum of squares of all entries."""
        size = np.abs(self.centre) + self.radius
        terms = size
        if size.ndim > 1:
            axes = tuple(range(1, size.ndim))
            terms = np.sqrt((size**2).sum(axis=axes))
        return float(terms.sum() * (1 + (terms.size + _FURTHER_ROUNDINGS) * _PRODUCT_ROUNDING))


@dataclass(frozen=True)
class AngleSum:
    """A whole multiple of each of some joint angles, plus a phase.

    Attributes:
        multiples: {place of the joint: multiple}.
        phase: the phase in rad.
        radius: what the phase is known within, in rad.
    """

    multiples: Mapping[int, int]
    phase: float
    radius: float


Operand = TrigonometricSum | AngleSum


def constant(value: float, radius: float = 0.0) -> TrigonometricSum:
    """Return a number known within a radius."""
    return TrigonometricSum(np.zeros(1, np.int64), np.array([value + 0j]), np.array([radius]), 0)


def matrix(T: Array, radius: Array | float = 0.0) -> TrigonometricSum:
    """Return a constant matrix (4, 4) known within a radius."""
    radii = np.broadcast_to(np.asarray(radius, float), T.shape)
    return TrigonometricSum(np.zeros(1, np.int64), T[None].astype(complex), radii[None].copy(), 0)


def variable(place: int, middle: float, spread: float) -> TrigonometricSum:
    """Return a number between `middle - spread` and `middle + spread`, the variable with a place."""
    keys = np.array([0, _unit(place)], np.int64)
    radius = np.array([abs(middle), abs(spread)]) * _SUM_ROUNDING
    return TrigonometricSum(keys, np.array([middle + 0j, spread + 0j]), radius, 1)


def wave(angle: AngleSum, sine: bool) -> TrigonometricSum:
    """Return the cosine or the sine of an angle.

    Raises:
        TwinError: a multiple is too large for its digit.
    """
    exponents = angle.multiples
    for multiple in exponents.values():
        if abs(multiple) > _LARGEST_EXPONENT:
            raise TwinError(
                f"a sine or cosine of {multiple} times a joint angle; at most {_LARGEST_EXPONENT} times are possible"
            )
    key = 0
    degree = 0
    for place, exponent in exponents.items():
        key += _unit(place) * exponent
        degree = max(degree, abs(exponent))
    # cos a = (e^(i a) + e^(-i a)) / 2, sin a = (e^(i a) - e^(-i a)) / 2i: two terms with conjugate coefficients
    half = 0.5 * np.exp(1j * angle.phase)
    if sine:
        half = half * -1j
    error = 0.5 * (angle.radius + 8 * 2.0**-52)
    if key == 0:
        return constant(float(2 * half.real), 2 * error)
    keys = np.array([key, -key], np.int64)
    return _collected(keys, np.array([half, np.conj(half)]), np.array([error, error]), degree)


def stacked(entries: list[list[TrigonometricSum]]) -> TrigonometricSum:
    """Return a sum of matrices from a matrix of sums."""
    rows = len(entries)
    columns = len(entries[0])
    all_keys = []
    degree = 0
    for row in entries:
        for entry in row:
            all_keys.append(entry.keys)
            degree = max(degree, entry.degree)
    keys = np.unique(np.concatenate(all_keys))
    centre = np.zeros((keys.size, rows, columns), complex)
    radius = np.zeros((keys.size, rows, columns))
    for i, row in enumerate(entries):
        for j, entry in enumerate(row):
            places = np.searchsorted(keys, entry.keys)
            centre[places, i, j] = entry.centre
            radius[places, i, j] = entry.radius
    return TrigonometricSum(keys, centre, radius, degree)


def transposed(matrices: TrigonometricSum) -> TrigonometricSum:
    """Return the transposed matrices; the entries of the sum are real."""
    centre = np.swapaxes(matrices.centre, 1, 2)
    return TrigonometricSum(matrices.keys, centre, np.swapaxes(matrices.radius, 1, 2), matrices.degree)


def length_bound(vectors: TrigonometricSum, lengths: Sequence[int]) -> float:
    """Return an upper bound of the length of a column (3, 1) at all values of the variables.

    The square of the length is a sum too. Rotations that change no length cancel in it, so that its bound is sharper
    than that of the column. Terms with equal powers of the variables that are no angles (their places are `lengths`)
    are bounded by themselves.
    """
    total = 0.0
    for column in vectors.split(lengths):
        smallest = column.bound()
        if smallest > _SMALL_BOUND:
            size = np.sort(np.abs(column.centre).max(axis=(1, 2)))
            limit = max(_NEGLIGIBLE * smallest, float(size[-min(_MOST_SQUARED_TERMS, size.size)]))
            large = column.pruned(limit)
            # the square has twice the exponents; without it the bound is only less sharp
            if 2 * int(np.abs(large.exponents()).max(initial=0)) <= _LARGEST_EXPONENT:
                square = transposed(large).matrix_product(large)
                smallest = min(smallest, float(np.sqrt(square.bound()) * (1 + _PRODUCT_ROUNDING)))
        total += smallest
    return total * (1 + 100 * _PRODUCT_ROUNDING)


def part(matrices: TrigonometricSum, rows: slice, columns: slice) -> TrigonometricSum:
    """Return some rows and columns of a sum of matrices."""
    return TrigonometricSum(
        matrices.keys, matrices.centre[:, rows, columns], matrices.radius[:, rows, columns], matrices.degree
    )


def _unit(place: int) -> int:
    """Return the key of a variable.

    Raises:
        TwinError: there are too many variables.
    """
    if not 0 <= place < VARIABLES:
        raise TwinError(f"there are more than {VARIABLES} joints and parameters with a range")
    return _BASE**place


def _collected(keys: Keys, centre: Complexes, radius: Array, degree: int) -> TrigonometricSum:
    """Return a sum whose terms with equal keys are added."""
    unique, places = np.unique(keys, return_inverse=True)
    if unique.size == keys.size:
        order = np.argsort(keys)
        return TrigonometricSum(keys[order], centre[order], radius[order], degree)
    order = np.argsort(places, kind="stable")
    starts = np.searchsorted(places[order], np.arange(unique.size))
    counts = np.diff([*starts, keys.size]).reshape(-1, *[1] * (centre.ndim - 1))
    sums = np.add.reduceat(centre[order], starts)
    size = np.add.reduceat(np.abs(centre[order]), starts)
    radii = np.add.reduceat(radius[order], starts)
    # a sum of n terms in any order has a relative error of at most n - 1 additions of the magnitudes
    total = radii * (1 + counts * _SUM_ROUNDING) + (counts - 1) * _SUM_ROUNDING * size
    return TrigonometricSum(unique, sums, total, degree)
