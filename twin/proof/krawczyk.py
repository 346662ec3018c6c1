"""Existence and uniqueness of solutions in boxes: Krawczyk's operator for many boxes at once.

For equations F(x, p) = 0 with as many unknowns x as equations, a prediction m, and any matrix C near the inverse of
dF/dx: if K = m - C F(m, P) + (1 - C dF/dx(X, P)) (X - m) is in the interior of the box X, then for each p in P there is
exactly one x in X, it is in K, and dF/dx is regular on X and P (Krawczyk 1969; Moore 1977).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.proof import intervals
from twin.proof.intervals import Certainty, Intervals

_MOST_BOXES = 3
"""Number of boxes that are tried around a prediction, each wider than the one before."""

_FIRST_FACTOR = 1.3
"""Radius of the first box as a multiple of the part of first order."""

_NEXT_FACTOR = 1.1
"""Radius of the next box as a multiple of the radius that would fit if the derivatives did not vary more."""

_SMALLEST_RADIUS = 1e-9
"""Smallest radius of a tried box, in m or rad."""

_POWER_STEPS = 4
"""Number of steps in which a vector approaches that of the largest eigenvalue."""

_KEPT_SHARE = 1e-3
"""Share of the vector of the step before that is added in each of these steps."""

_SMALLEST_COMPONENT = 1e-6
"""Added to each component of this vector, whose largest one is 1."""


@dataclass(frozen=True, eq=False)
class Solutions:
    """Enclosures of solutions.

    Attributes:
        solved: (n,) whether there is exactly one solution in the box for each parameter.
        x: (n, k) boxes; unknown where none was found.
        shift: (n, k) `C F(m, P)`: the first-order part of x is m - shift.
        inverse: (n, k, k) the matrices C.
        values: (n, k) `F(m, P)`.
        contraction: (n, k, k) enclosures of `1 - C dF/dx`.
    """

    solved: Certainty
    x: Intervals
    shift: Intervals
    inverse: Array
    values: Intervals
    contraction: Intervals

    def functionals(self, m: Array, weights: Array) -> Intervals:
        """Return enclosures (n, w) of `weights` (w, k) times x, narrower than from the enclosures of x."""
        # x = m - C F + (1 - C dF/dx) (x - m): a weighted sum of the right side has no sum of the widths of x
        rows = intervals.product(intervals.exactly(weights), intervals.exactly(self.inverse))
        first = intervals.product(rows, self.values[..., None])[..., 0]
        centre = intervals.product(intervals.exactly(weights), intervals.exactly(m[..., None]))[..., 0]
        weighted_contraction = intervals.product(intervals.exactly(weights), self.contraction)
        distance = self.x - m
        second = intervals.product(weighted_contraction, distance[..., None])[..., 0]
        return centre - first + second


def solve(
    residual: Callable[[Intervals], Intervals], jacobian: Callable[[Intervals], Intervals], m: Array
) -> Solutions:
    """Return the enclosures of solutions around predictions m (n, k), in m and rad.

    `residual` and `jacobian` return F (n, k) and dF/dx (n, k, k) on boxes x (n, k), for all parameters of each box.
    """
    centre = intervals.exactly(m)
    inverse = _inverses(jacobian(centre).middle)
    values = residual(centre)
    shift = intervals.product(intervals.exactly(inverse), values[..., None])[..., 0]
    radius = np.maximum(_FIRST_FACTOR * shift.largest, _SMALLEST_RADIUS)
    solved = np.zeros(len(m), bool)
    x = intervals.unknown(m.shape)
    for _ in range(_MOST_BOXES):
        box = intervals.around(m, radius)
        contraction = _contraction(inverse, jacobian(box))
        mapped = centre - shift + intervals.product(contraction, (box - m)[..., None])[..., 0]
        inside = mapped.within(box).all(axis=1)
        x = _replaced(x, mapped, (inside & ~solved)[:, None])
        solved |= inside
        if solved.all():
            break
        radius = _fitting_radius(contraction.largest, shift.largest)
    # the solution is in K: between it and m, the derivatives vary less
    spanned = intervals.hull(x, centre)
    contraction = _contraction(inverse, jacobian(spanned))
    narrower = centre - shift + intervals.product(contraction, (x - m)[..., None])[..., 0]
    return Solutions(solved, intervals.common(x, narrower), shift, inverse, values, contraction)


def _contraction(inverse: Array, slopes: Intervals) -> Intervals:
    """Return 1 - C dF/dx (n, k, k) for matrices C = `inverse` and enclosures `slopes` of dF/dx."""
    identity = np.eye(inverse.shape[-1])
    return intervals.exactly(identity) - intervals.product(intervals.exactly(inverse), slopes)


def _fitting_radius(contraction: Array, shift: Array) -> Array:
    """Return the radius r (n, k) with r = shift + contraction r, and a part more: its box is mapped into itself.

    Where there is none, NaN: no box of this shape will do.
    """
    unknowns = shift.shape[1]
    usable = np.all(np.isfinite(contraction), axis=(1, 2)) & np.all(np.isfinite(shift), axis=1)
    matrices = np.eye(unknowns) - np.where(usable[:, None, None], contraction, 0.0)
    with np.errstate(all="ignore"):
        # singular matrices would stop the solution for all boxes; a negative determinant has no radius either
        usable &= np.linalg.slogdet(matrices)[0] > 0
    matrices[~usable] = np.eye(unknowns)
    radius = np.linalg.solve(matrices, shift[..., None])[..., 0]
    usable &= (radius >= shift).all(axis=1)
    return np.where(usable[:, None], _NEXT_FACTOR * radius + _SMALLEST_RADIUS, np.nan)


def regular(matrices: Intervals) -> Certainty:
    """Return where all matrices of the enclosures (n, k, k) are certainly regular.

    With C near the inverse, E = 1 - C A has a spectral radius below 1 if |E| v < v for a positive vector v (Perron and
    Frobenius); then C A is regular, hence A.
    """
    magnitude = _contraction(_inverses(matrices.middle), matrices).largest
    v = np.ones(magnitude.shape[:-1])
    with np.errstate(all="ignore"):
        for _ in range(_POWER_STEPS):
            # the part of v before keeps a component positive that no power reaches; so does the number that is added
            v = (magnitude @ v[..., None])[..., 0] + _KEPT_SHARE * v
            v = v / v.max(axis=-1, keepdims=True) + _SMALLEST_COMPONENT
    image = intervals.product(intervals.exactly(magnitude), intervals.exactly(v)[..., None])[..., 0]
    return np.all(image.high < v, axis=-1)


def _inverses(matrices: Array) -> Array:
    """Return inverses (n, k, k), NaN where a matrix is not known or singular."""
    usable = np.all(np.isfinite(matrices), axis=(1, 2))
    safe = np.where(usable[:, None, None], matrices, np.eye(matrices.shape[-1]))
    with np.errstate(all="ignore"):
        usable &= np.abs(np.linalg.slogdet(safe)[0]) == 1
    safe = np.where(usable[:, None, None], safe, np.eye(matrices.shape[-1]))
    return np.where(usable[:, None, None], np.linalg.inv(safe), np.nan)


def _replaced(old: Intervals, new: Intervals, where: Certainty) -> Intervals:
    """Return `new` where a condition is certain, and `old` elsewhere."""
    return Intervals(np.where(where, new.low, old.low), np.where(where, new.high, old.high))
