"""Arrays of intervals in double precision: each result contains all values of the operation on the given intervals.

    from twin.proof import intervals
    x = intervals.between(low, high)       # arrays of any equal shape; or exactly(numbers), decimals(numbers)
    y = intervals.sine(x) * 0.182 + x**2   # + - * / ** with intervals and with numbers, which are taken as they are
    y.low, y.high                          # arrays
    (y > 0)                                # array: True where it is certain, for all values
    intervals.product(A, B)                # of matrices, (..., m, n) with (..., n, p)

An interval with NaN at an end is unknown: the operation may not exist for all values, as the root of [-1, 1]. What is
computed from it is unknown too, and no comparison of it is certain.

Rounding. IEEE 754 gives the nearest number for + - * / and roots, with an error of at most 2^-53 of its magnitude, or
of 2^-1075 if a product or a quotient underflows. An end x moves outward by fl(2^-52 |x|), which is at least the way
to the next number, hence exceeds the error. Libraries state errors of at most 4 units in the last place for sine,
cosine, arc functions, exponential and logarithm (NumPy with vector instructions; below 1 without); their ends move
outward by twice that. tests/proof/test_intervals.py compares all operations with balls of 200 digits. Gradual underflow
is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.core.spatial import Array

Certainty = NDArray[np.bool_]
"""Where a condition is certain."""

_NEXT = 2.0**-52
"""Relative distance by which an end moves outward after a rounded operation."""

_UNDERFLOW = 2.0**-1074
"""Distance by which an end moves outward besides, after an operation that may underflow."""

_LIBRARY_SINE = 2.0**-50
"""Bound of the error of sine and cosine: 8 units in the last place of numbers below 1."""

_LIBRARY_ANGLE = 2.0**-48
"""Bound of the error of arc functions in rad: 8 units in the last place of numbers below 4."""

_LIBRARY_SHARE = 2.0**-49
"""Bound of the relative error of exponential and logarithm: 8 units in the last place."""

_SUBNORMAL = 1e-300
"""Bound of the error of exponentials below the smallest normal number, 2e-308."""

_LARGEST_ANGLE = 2.0**20
"""Angles in rad beyond which sine and cosine are only known to be in [-1, 1]."""

_PEAK = 1e-9
"""Share of a turn within which an interval counts as containing a maximum of sine or cosine.

The rounding error of an angle up to `_LARGEST_ANGLE`, as a share of a turn, is below 1e-10.
"""


@dataclass(frozen=True, eq=False, slots=True)
class Intervals:
    """An array of intervals.

    Attributes:
        low, high: ends, arrays of one shape; NaN where the interval is unknown.
    """

    low: Array
    high: Array

    __array_priority__ = 100.0
    """NumPy leaves operations with this class to its methods."""

    __array_ufunc__ = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.low.shape

    @property
    def known(self) -> Certainty:
        """Where the interval is finite."""
        return np.isfinite(self.low) & np.isfinite(self.high)

    @property
    def middle(self) -> Array:
        """A number near the middle of the interval."""
        with np.errstate(all="ignore"):
            return 0.5 * self.low + 0.5 * self.high

    @property
    def radius(self) -> Array:
        """The largest distance of a value from `middle`, rounded up."""
        middle = self.middle
        with np.errstate(all="ignore"):
            distance = np.maximum(self.high - middle, middle - self.low)
            return distance + distance * _NEXT

    @property
    def width(self) -> Array:
        """Distance of the ends, rounded up."""
        with np.errstate(all="ignore"):
            distance = self.high - self.low
            return distance + distance * _NEXT

    @property
    def largest(self) -> Array:
        """The largest magnitude of a value."""
        return np.maximum(-self.low, self.high)

    @property
    def smallest(self) -> Array:
        """The smallest magnitude of a value; 0 where the interval contains 0."""
        return np.maximum(np.maximum(self.low, -self.high), np.where(np.isnan(self.low + self.high), np.nan, 0.0))

    def contains(self, numbers: ArrayLike) -> Certainty:
        """Return where numbers are in the intervals; an unknown interval contains all of them."""
        array = np.asarray(numbers, float)
        return ~((self.low > array) | (self.high < array))

    def within(self, other: Intervals) -> Certainty:
        """Return where the interval is certainly in the interior of another one."""
        return (self.low > other.low) & (self.high < other.high)

    def __getitem__(self, key: Any) -> Intervals:
        return Intervals(self.low[key], self.high[key])

    def __len__(self) -> int:
        return len(self.low)

    def __neg__(self) -> Intervals:
        return Intervals(-self.high, -self.low)

    def __add__(self, other: Intervals | ArrayLike) -> Intervals:
        b = as_intervals(other)
        with np.errstate(all="ignore"):
            return _rounded(self.low + b.low, self.high + b.high)

    __radd__ = __add__

    def __sub__(self, other: Intervals | ArrayLike) -> Intervals:
        return self + -as_intervals(other)

    def __rsub__(self, other: ArrayLike) -> Intervals:
        return as_intervals(other) + -self

    def __mul__(self, other: Intervals | ArrayLike) -> Intervals:
        if not isinstance(other, Intervals):
            return _scaled(self, np.asarray(other, float))
        with np.errstate(all="ignore"):
            return _of_corners(
                self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high
            )

    __rmul__ = __mul__

    def __truediv__(self, other: Intervals | ArrayLike) -> Intervals:
        b = as_intervals(other)
        possible = (b.low > 0) | (b.high < 0)
        with np.errstate(all="ignore"):
            low = np.where(possible, b.low, np.nan)
            high = np.where(possible, b.high, np.nan)
            return _of_corners(self.low / low, self.low / high, self.high / low, self.high / high)

    def __rtruediv__(self, other: ArrayLike) -> Intervals:
        return as_intervals(other) / self

    def __pow__(self, exponent: float) -> Intervals:
        return power(self, exponent)

    def __abs__(self) -> Intervals:
        return Intervals(self.smallest, self.largest)

    def __lt__(self, other: Intervals | ArrayLike) -> Certainty:
        return self.high < as_intervals(other).low

    def __le__(self, other: Intervals | ArrayLike) -> Certainty:
        return self.high <= as_intervals(other).low

    def __gt__(self, other: Intervals | ArrayLike) -> Certainty:
        return self.low > as_intervals(other).high

    def __ge__(self, other: Intervals | ArrayLike) -> Certainty:
        return self.low >= as_intervals(other).high


# ------------------------------------------------------------------------------------------- construction


def between(low: ArrayLike, high: ArrayLike) -> Intervals:
    """Return intervals with given ends, of one shape after broadcasting.

    Raises:
        ValueError: a low end is above its high end, or an end is NaN.
    """
    first, last = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    if not np.all(first <= last):
        worst = np.flatnonzero(~(first <= last).ravel())[0]
        raise ValueError(f"interval {worst} from {first.ravel()[worst]} to {last.ravel()[worst]}: low must be <= high")
    return Intervals(first, last)


def exactly(numbers: ArrayLike) -> Intervals:
    """Return the intervals that contain one number each."""
    array = np.asarray(numbers, float)
    return Intervals(array, array)


def around(centre: ArrayLike, radius: ArrayLike) -> Intervals:
    """Return intervals that contain all numbers within a distance `radius` of `centre`."""
    spread = np.asarray(radius, float)
    return exactly(centre) + Intervals(-spread, spread)


def decimals(numbers: ArrayLike) -> Intervals:
    """Return intervals that contain the decimals of which the numbers are the nearest double precision numbers."""
    return _rounded(np.asarray(numbers, float), np.asarray(numbers, float), _UNDERFLOW)


def fraction(number: Fraction) -> Intervals:
    """Return an interval () that contains a fraction."""
    return decimals(float(number))


def unknown(shape: tuple[int, ...]) -> Intervals:
    """Return intervals of which nothing is known."""
    return exactly(np.full(shape, np.nan))


def as_intervals(value: Intervals | ArrayLike) -> Intervals:
    """Return numbers as intervals; intervals as they are."""
    if isinstance(value, Intervals):
        return value
    return exactly(value)


def stack(values: Sequence[Intervals], axis: int = 0) -> Intervals:
    """Return intervals stacked along a new axis, after broadcasting to one shape."""
    lows, highs = _ends(values)
    return Intervals(
        np.stack(np.broadcast_arrays(*lows), axis),
        np.stack(np.broadcast_arrays(*highs), axis),
    )


def joined(values: Sequence[Intervals], axis: int) -> Intervals:
    """Return intervals one after the other along an axis."""
    lows, highs = _ends(values)
    return Intervals(np.concatenate(lows, axis), np.concatenate(highs, axis))


def _ends(values: Sequence[Intervals]) -> tuple[list[Array], list[Array]]:
    """Return the low and the high ends of some arrays of intervals."""
    lows = []
    highs = []
    for value in values:
        lows.append(value.low)
        highs.append(value.high)
    return lows, highs


def hull(a: Intervals, b: Intervals) -> Intervals:
    """Return the smallest intervals that contain both."""
    return Intervals(np.minimum(a.low, b.low), np.maximum(a.high, b.high))


# fmax and fmin, unlike maximum and minimum, take the number where the other one is NaN
def common(a: Intervals, b: Intervals) -> Intervals:
    """Return the common part of two enclosures of the same values; an unknown enclosure restricts nothing."""
    return Intervals(np.fmax(a.low, b.low), np.fmin(a.high, b.high))


PI = Intervals(np.asarray(np.pi), np.nextafter(np.asarray(np.pi), 4.0))
"""The interval () of pi, which is above its nearest double precision number."""


# ------------------------------------------------------------------------------------------- functions


def square(x: Intervals) -> Intervals:
    """Return x^2."""
    with np.errstate(all="ignore"):
        enclosure = _rounded(x.smallest**2, x.largest**2, _UNDERFLOW)
    return Intervals(np.maximum(enclosure.low, 0.0), enclosure.high)


def root(x: Intervals) -> Intervals:
    """Return the square root; unknown where x may be negative."""
    with np.errstate(all="ignore"):
        low = np.sqrt(x.low)
        return _rounded(low, np.where(np.isnan(low), np.nan, np.sqrt(x.high)))


def power(x: Intervals, exponent: float) -> Intervals:
    """Return x to a power: an integer, a half, or another exponent for positive x."""
    if exponent < 0:
        return 1.0 / power(x, -exponent)
    if exponent == 0:
        return exactly(np.ones(x.shape))
    if exponent != int(exponent):
        if 2 * exponent == int(2 * exponent):
            return power(root(x), 2 * exponent)
        return exponential(exponent * logarithm(x))
    if exponent == 1:
        return x
    half = power(square(x), exponent // 2)
    if exponent % 2:
        return half * x
    return half


def sine(x: Intervals) -> Intervals:
    """Return the sine of angles in rad."""
    return _wave(np.sin, x, 0.5 * np.pi)


def cosine(x: Intervals) -> Intervals:
    """Return the cosine of angles in rad."""
    return _wave(np.cos, x, 0.0)


def tangent(x: Intervals) -> Intervals:
    """Return the tangent of angles in rad; unknown where the cosine may be 0."""
    return sine(x) / cosine(x)


def arctangent(x: Intervals) -> Intervals:
    """Return the arc tangent in rad."""
    return Intervals(np.arctan(x.low) - _LIBRARY_ANGLE, np.arctan(x.high) + _LIBRARY_ANGLE)


def arcsine(x: Intervals) -> Intervals:
    """Return the arc sine in rad; unknown where x may be outside [-1, 1]."""
    with np.errstate(all="ignore"):
        low = np.arcsin(np.where(x.high <= 1, x.low, np.nan))
        high = np.arcsin(np.where(x.low >= -1, x.high, np.nan))
        return Intervals(low - _LIBRARY_ANGLE, high + _LIBRARY_ANGLE)


def arccosine(x: Intervals) -> Intervals:
    """Return the arc cosine in rad; unknown where x may be outside [-1, 1]."""
    with np.errstate(all="ignore"):
        low = np.arccos(np.where(x.low >= -1, x.high, np.nan))
        high = np.arccos(np.where(x.high <= 1, x.low, np.nan))
        return Intervals(low - _LIBRARY_ANGLE, high + _LIBRARY_ANGLE)


def direction(y: Intervals, x: Intervals) -> Intervals:
    """Return atan2(y, x) in rad; [-pi, pi] where the values may include the origin or a half turn."""
    cut = ~((x.low > 0) | (y.low > 0) | (y.high < 0))
    # monotonic in x and in y where the box does not meet the cut: the extremes are at its corners
    corners = (
        np.arctan2(y.low, x.low),
        np.arctan2(y.low, x.high),
        np.arctan2(y.high, x.low),
        np.arctan2(y.high, x.high),
    )
    low = np.minimum(np.minimum(corners[0], corners[1]), np.minimum(corners[2], corners[3])) - _LIBRARY_ANGLE
    high = np.maximum(np.maximum(corners[0], corners[1]), np.maximum(corners[2], corners[3])) + _LIBRARY_ANGLE
    is_unknown = np.isnan(low + high)
    cut &= ~is_unknown
    return Intervals(np.where(cut, -PI.high, low), np.where(cut, PI.high, high))


def exponential(x: Intervals) -> Intervals:
    """Return e^x."""
    with np.errstate(all="ignore"):
        low = np.exp(x.low)
        high = np.exp(x.high)
        # results below the smallest normal number have no relative bound
        smallest = np.maximum(low - low * _LIBRARY_SHARE - _SUBNORMAL, 0.0)
        return Intervals(smallest, high * (1 + _LIBRARY_SHARE) + _SUBNORMAL)


def logarithm(x: Intervals) -> Intervals:
    """Return the natural logarithm; unknown where x may be negative or 0."""
    with np.errstate(all="ignore"):
        low = np.log(np.where(x.low > 0, x.low, np.nan))
        high = np.log(np.where(x.low > 0, x.high, np.nan))
        return Intervals(low - np.abs(low) * _LIBRARY_SHARE, high + np.abs(high) * _LIBRARY_SHARE)


def smaller(a: Intervals, b: Intervals) -> Intervals:
    """Return the smaller of two values."""
    return Intervals(np.minimum(a.low, b.low), np.minimum(a.high, b.high))


def larger(a: Intervals, b: Intervals) -> Intervals:
    """Return the larger of two values."""
    return Intervals(np.maximum(a.low, b.low), np.maximum(a.high, b.high))


def total(x: Intervals, axis: int) -> Intervals:
    """Return the sum along an axis."""
    lows = np.moveaxis(x.low, axis, 0)
    highs = np.moveaxis(x.high, axis, 0)
    sums = exactly(np.zeros(lows.shape[1:]))
    for low, high in zip(lows, highs, strict=True):
        sums = sums + Intervals(low, high)
    return sums


# ------------------------------------------------------------------------------------------- matrices


def product(A: Intervals | Array, B: Intervals | Array) -> Intervals:
    """Return the product of matrices (..., m, n) and (..., n, p).

    A product of middles and radii: an entry of a rounded product of n terms differs from the exact one by at most
    n 2^-53 / (1 - n 2^-53) of the product of the magnitudes, in any order of its sums.
    """
    first = as_intervals(A)
    second = as_intervals(B)
    if second.low.ndim == 2 and first.low.ndim > 2:
        # one product with all rows is faster than many small ones
        *stacked, rows, terms = first.shape
        flat = Intervals(first.low.reshape(-1, terms), first.high.reshape(-1, terms))
        flat_product = product(flat, second)
        shape = (*stacked, rows, second.shape[1])
        return Intervals(flat_product.low.reshape(shape), flat_product.high.reshape(shape))
    A_middle = first.middle
    A_radius = first.radius
    B_middle = second.middle
    B_radius = second.radius
    terms = A_middle.shape[-1]
    share = (terms + 4) * _NEXT
    with np.errstate(all="ignore"):
        centre = A_middle @ B_middle
        magnitude = np.abs(A_middle)
        spread = magnitude @ (B_radius + share * np.abs(B_middle)) + A_radius @ (np.abs(B_middle) + B_radius)
        # the rounding of this line, and of the sums below
        spread = spread * (1 + 4 * share) + np.abs(centre) * _NEXT + (terms + 1) * _UNDERFLOW
        # a radius or a share of a subnormal number may be wrong by the smallest number, times the other factor
        rows = (magnitude + A_radius).sum(axis=-1, keepdims=True)
        columns = (np.abs(B_middle) + B_radius).sum(axis=-2, keepdims=first.low.ndim > 1)
        spread = spread + 4 * (rows + columns) * _UNDERFLOW
        return Intervals(centre - spread, centre + spread)


def transposed(A: Intervals) -> Intervals:
    """Return the transposed matrices (..., n, m) of (..., m, n)."""
    return Intervals(np.swapaxes(A.low, -1, -2), np.swapaxes(A.high, -1, -2))


# ------------------------------------------------------------------------------------------- rounding


def _rounded(low: Array, high: Array, underflow: float = 0.0) -> Intervals:
    """Return the interval of rounded ends, moved outward by more than their rounding error.

    A low end that has overflowed to infinity becomes unknown.
    """
    with np.errstate(all="ignore"):
        down = np.abs(low) * _NEXT + underflow
        up = np.abs(high) * _NEXT + underflow
        return Intervals(low - down, high + up)


def _of_corners(a: Array, b: Array, c: Array, d: Array) -> Intervals:
    """Return the interval from the smallest to the largest of four rounded products or quotients."""
    low = np.minimum(np.minimum(a, b), np.minimum(c, d))
    high = np.maximum(np.maximum(a, b), np.maximum(c, d))
    return _rounded(low, high, _UNDERFLOW)


def _scaled(x: Intervals, factor: Array) -> Intervals:
    """Return x multiplied by numbers."""
    with np.errstate(all="ignore"):
        first = x.low * factor
        last = x.high * factor
    return _rounded(np.minimum(first, last), np.maximum(first, last), _UNDERFLOW)


def _wave(function: np.ufunc, x: Intervals, peak: float) -> Intervals:
    """Return sine or cosine, whose maxima are at `peak` plus full turns."""
    with np.errstate(all="ignore"):
        first = function(x.low)
        last = function(x.high)
        low = np.maximum(np.minimum(first, last) - _LIBRARY_SINE, -1.0)
        high = np.minimum(np.maximum(first, last) + _LIBRARY_SINE, 1.0)
        large = (x.low < -_LARGEST_ANGLE) | (x.high > _LARGEST_ANGLE)
        high = np.where(_passes(x, peak) | large, 1.0, high)
        low = np.where(_passes(x, peak - np.pi) | large, -1.0, low)
    return Intervals(low, high)


def _passes(x: Intervals, peak: float) -> Certainty:
    """Return where intervals of angles may contain `peak` or a full turn from it."""
    turns_low = (x.low - peak) / (2 * np.pi) - _PEAK
    turns_high = (x.high - peak) / (2 * np.pi) + _PEAK
    return np.floor(turns_high) >= np.ceil(turns_low)
