"""Paths q(s) with derivatives: the interface between planners and timing, and Chebyshev series that implement it.

Along a phase, q(s) is analytic, so that a few dozen coefficients of a series represent it to rounding accuracy.
Differences of samples would lose half of the digits; differentiating the series loses almost none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol as Interface

import numpy as np
from numpy.polynomial import chebyshev

from twin.core.spatial import Array

_FEWEST_COEFFICIENTS = 17
"""Smallest number of coefficients of a fitted series."""

_MOST_COEFFICIENTS = 513
"""Largest number of coefficients of a fitted series."""

_ROUNDING_LEVEL = 1e-13
"""A coefficient below this fraction of the largest value counts as a rounding error."""

_NOISE_LEVEL = 1e-9
"""Last coefficients up to this fraction of the largest value can be the noise of an iterative inverse."""

_NOISE_POSSIBLE_FROM = 128
"""Number of coefficients above which last coefficients that do not vanish are taken for noise."""


class Path(Interface):
    """Coordinates q (n,) as a smooth function of a parameter s from 0 to 1, which is not time.

    `line` is a straight path, `ChebyshevPath` a series (phases given by poses, curves around obstacles).
    `timing.time_path` computes the timing of a path, `Space.free_along` tests it for collisions.
    """

    def __call__(self, s: Array, order: int = 0) -> Array:
        """Return q (k, n) in m or rad at s (k,), or its derivative with respect to s of order 1 or 2."""
        ...


@dataclass(frozen=True)
class ChebyshevPath:
    """A vector function of s in [0, 1], as a Chebyshev series.

    Attributes:
        coefficients: (degree + 1, n) Chebyshev coefficients in 2 s - 1.
        tail: (n,) truncation error of the series, in the unit of the function.
    """

    coefficients: Array
    tail: Array

    def __call__(self, s: Array, order: int = 0) -> Array:
        """Return the function (k, n) at s (k,), or its derivative of the given order."""
        c = self.coefficients
        if order:
            c = chebyshev.chebder(c, order, scl=2.0)  # s = (x + 1) / 2
        return np.asarray(chebyshev.chebval(2 * np.asarray(s, float) - 1, c), np.float64).T


def line(start: Array, end: Array) -> ChebyshevPath:
    """Return the straight path from start (n,) to end (n,)."""
    return ChebyshevPath(np.array([start + end, end - start]) / 2, np.zeros(len(start)))


def fit(function: Callable[[Array], Array]) -> ChebyshevPath:
    """Fit a series to a function of s (k,) in [0, 1] with values (k, n).

    The degree is increased until the last coefficients are at the level of rounding errors.

    For a less accurate function (an iterative inverse), the degree stops increasing at the noise level. The caller
    must check the truncation error `tail`.
    """
    count = _FEWEST_COEFFICIENTS
    while True:
        c, values = _coefficients(function, count)
        scale = np.max(np.abs(values), axis=0) + np.finfo(float).tiny
        last = c[-max(3, count // 5) :]
        tail = np.max(np.abs(last), axis=0)
        converged = bool(np.all(tail <= _ROUNDING_LEVEL * scale))
        noisy = count > _NOISE_POSSIBLE_FROM and bool(np.all(tail <= _NOISE_LEVEL * scale))
        if converged or noisy or 2 * count - 1 > _MOST_COEFFICIENTS:
            smallest = _ROUNDING_LEVEL * scale / 10
            if not converged:  # coefficients at the level of the noise
                smallest = np.maximum(smallest, 3 * tail)
            return ChebyshevPath(_without_rounding(c, smallest), tail)
        count = 2 * count - 1


def _coefficients(function: Callable[[Array], Array], count: int) -> tuple[Array, Array]:
    """Return the first Chebyshev coefficients (count, n) of a function of s, and its values (count, n) at the nodes."""
    nodes = (np.arange(count) + 0.5) * np.pi / count
    values = function((np.cos(nodes) + 1) / 2)
    # discrete cosine transform: the Chebyshev polynomials are orthogonal in the sum over their roots
    basis = np.cos(np.arange(count)[:, None] * nodes)
    c = 2 / count * basis @ values
    c[0] /= 2
    return c, values


def _without_rounding(c: Array, smallest: Array) -> Array:
    """Return coefficients c (k, n), those up to `smallest` (n,) as 0, up to the last degree that is left."""
    keep = np.abs(c) > smallest
    degrees = np.flatnonzero(keep.any(axis=1))
    degree = int(np.max(degrees, initial=0))
    # two coefficients at least, so that the series has a derivative
    count = max(degree + 1, 2)
    return np.where(keep, c, 0.0)[:count]
