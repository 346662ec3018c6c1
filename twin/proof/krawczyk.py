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

_TRIES = 3
"""Number of boxes that are tried around a prediction, each wider than the one before."""

_WIDER = 1.3
"""Radius of the first box as a multiple of the part of first order."""

_MARGIN = 1.1
"""Radius of the next box as a multiple of the radius that would fit if the derivatives did not vary more."""

_SMALLEST_RADIUS = 1e-9
"""Smallest radius of a tried box, in m or rad."""

_POWERS = 4
"""Number of steps in which a vector approaches that of the largest eigenvalue."""


@dataclass(frozen=True, eq=False)
class Solutions:
    """Enclosures of solutions.

    Attributes:
        found: (n,) whether there is exactly one solution in the box for each parameter.
        x: (n, k) boxes; unknown where none was found.
        shift: (n, k) `C F(m, P)`: the first-order part of x is m - shift.
        inverse: (n, k, k) the matrices C.
        values: (n, k) `F(m, P)`.
        contraction: (n, k, k) enclosures of `1 - C dF/dx`.
    """

    found: Certainty
    x: Intervals
    shift: Intervals
    inverse: Array
    values: Intervals
    contraction: Intervals

    def functionals(self, m: Array, weights: Array) -> Intervals:
        """Return enclosures (n, w) of `weights` (w, k) times x, narrower than from the enclosures of x."""
        rows = intervals.product(intervals.exactly(weights), intervals.exactly(self.inverse))
        first = intervals.product(rows, self.values[..., None])[..., 0]
        centre = intervals.product(intervals.exactly(weights), intervals.exactly(m[..., None]))[..., 0]
        rest = intervals.product(intervals.exactly(weights), self.contraction)
        distance = self.x - m
        second = intervals.product(rest, distance[..., None])[..., 0]
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
    radius = np.maximum(_WIDER * shift.largest, _SMALLEST_RADIUS)
    count, unknowns = m.shape
    identity = np.eye(unknowns)
    found = np.zeros(count, bool)
    x = intervals.unknown(m.shape)
    contraction = intervals.unknown((count, unknowns, unknowns))
    for _ in range(_TRIES):
        tried = intervals.around(m, radius)
        step = intervals.exactly(identity) - intervals.product(intervals.exactly(inverse), jacobian(tried))
        mapped = centre - shift + intervals.product(step, (tried - m)[..., None])[..., 0]
        inside = mapped.within(tried).all(axis=1)
        new = inside & ~found
        x = _replaced(x, mapped, new[:, None])
        contraction = _replaced(contraction, step, new[:, None, None])
        found |= inside
        if found.all():
            break
        radius = _fitting_radius(step.largest, shift.largest)
    # the solution is in K: between it and m, the derivatives vary less
    spanned = intervals.hull(x, centre)
    narrow = intervals.exactly(identity) - intervals.product(intervals.exactly(inverse), jacobian(spanned))
    second = centre - shift + intervals.product(narrow, (x - m)[..., None])[..., 0]
    return Solutions(found, intervals.common(x, second), shift, inverse, values, narrow)


def _fitting_radius(contraction: Array, shift: Array) -> Array:
    """Return the radius r (n, k) with r = shift + contraction r, and a part more: its box is mapped into itself.

    Where there is none, NaN: no box of this shape will do.
    """
    unknowns = shift.shape[1]
    usable = np.all(np.isfinite(contraction), axis=(1, 2)) & np.all(np.isfinite(shift), axis=1)
    matrices = np.eye(unknowns) - np.where(usable[:, None, None], contraction, 0.0)
    with np.errstate(all="ignore"):
        usable &= np.linalg.slogdet(matrices)[0] > 0
    matrices[~usable] = np.eye(unknowns)
    radius = np.linalg.solve(matrices, shift[..., None])[..., 0]
    usable &= (radius >= shift).all(axis=1)
    return np.where(usable[:, None], _MARGIN * radius + _SMALLEST_RADIUS, np.nan)


def regular(matrices: Intervals) -> Certainty:
    """Return where all matrices of the enclosures (n, k, k) are certainly regular.

    With C near the inverse, E = 1 - C A has a spectral radius below 1 if |E| v < v for a positive vector v (Perron and
    Frobenius); then C A is regular, hence A.
    """
    inverse = _inverses(matrices.middle)
    size = matrices.shape[-1]
    error = intervals.exactly(np.eye(size)) - intervals.product(intervals.exactly(inverse), matrices)
    magnitude = error.largest
    v = np.ones(magnitude.shape[:-1])
    with np.errstate(all="ignore"):
        for _ in range(_POWERS):
            v = (magnitude @ v[..., None])[..., 0] + 1e-3 * v
            v = v / v.max(axis=-1, keepdims=True) + 1e-6
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
    return Intervals(np.where(where, new.low, old.low), np.where(where, new.high, old.high))
