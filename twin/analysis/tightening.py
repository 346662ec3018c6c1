"""Which errors to reduce, and by how much, so that a required tool error is kept at least cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array

COST = "cost of a part assumed inversely proportional to its errors (reciprocal cost model, ASSUMED)"

_SEARCHED_STATES = 4
"""Number of states in the search, those with the largest errors; the others are checked at the end."""

_MOST_HALVINGS = 40
"""Number of halvings in the search for the factors; each one evaluates the tool error."""

_NAMED_PARTS = 3
"""Number of parts that the sentence names."""

_NO_EFFECT_SHARE = 1e-12
"""Share of the largest variance below which a part has no effect on the tool, but for rounding."""

_UNCHANGED_FACTOR = 1e-9
"""Difference of a factor from 1 below which a part stays as it is."""


@dataclass(frozen=True)
class Tightening:
    """Factors on the errors of parts with which a requirement is met.

    Attributes:
        factors: (joint or encoder, factor below 1 on its errors), the smallest factor first; parts that are not in the
            list stay as they are.
        cost: mean cost of all parts in units of the present one.
        uniform_cost: the same if the errors of all parts are reduced by one factor.
        reached: tool error in m with these factors.
    """

    factors: tuple[tuple[str, float], ...]
    cost: float
    uniform_cost: float
    reached: float

    @property
    def sentence(self) -> str:
        """What to tighten, the three strongest reductions by name."""
        named = []
        for name, factor in self.factors[:_NAMED_PARTS]:
            named.append(f"{name} to {100 * factor:.2g} %")
        further = len(self.factors) - len(named)
        text = f"tighten the errors of {', '.join(named)} of the present ones"
        if further:
            text += f", and {further} more, see the table"
        return text


def least_cost(
    names: Sequence[str], covariances_of: Array, required: float, error_of: Callable[[Array], float]
) -> Tightening | None:
    """Return the factors of least cost; None if the requirement is met already.

    The sum of the variances of the tool's position is minimal at this cost: of all factors s with the same sum of
    1 / s, these give the smallest sum of s² v, where v is the variance that a part contributes. Then s³ is inversely
    proportional to v, as far as s is at most 1. With several states, v is the mean over them, and the largest error
    counts.

    Args:
        names: (k,) joint or encoder of each part.
        covariances_of: (states, k, 3, 3) covariance of the tool's position in m², contributed by each part; the state
            with the largest error first.
        required: maximum tool error in m.
        error_of: function that returns the tool error in m of a covariance (3, 3).
    """
    searched = covariances_of[:_SEARCHED_STATES]

    def error(s: Array, states: Array) -> float:
        """Return the largest tool error in m with factors s (k,) over some states."""
        errors = []
        for covariances in states:
            covariance = np.einsum("k,kij->ij", s**2, covariances)
            errors.append(error_of(covariance))
        return max(errors)

    present_error = error(np.ones(len(names)), searched[:1])
    if present_error <= required:
        return None
    variances = np.trace(searched, axis1=2, axis2=3).mean(axis=0)
    counted = variances > _NO_EFFECT_SHARE * variances.max()

    def factors(level: float) -> Array:
        """Return the factors (k,) that lower each larger variance in proportion to the cube root of `level`."""
        s = np.ones(len(variances))
        s[counted] = np.minimum(1.0, np.cbrt(level / variances[counted]))
        return s

    ratio = required / present_error
    # at the upper level no factor is below 1; at the lower one all factors are at most `ratio`, which is enough
    high = float(variances.max())
    low = float(variances[counted].min()) * ratio**3
    for _ in range(_MOST_HALVINGS):
        middle = float(np.sqrt(low * high))  # levels may differ by many orders of magnitude
        if error(factors(middle), searched) <= required:
            low = middle
        else:
            high = middle
    factors_found = factors(low)
    reached = error(factors_found, covariances_of)
    if reached > required:  # in a state that the search has left out
        factors_found = factors_found * (required / reached)
        reached = required
    order = np.argsort(factors_found, kind="stable")
    tightened: list[tuple[str, float]] = []
    for part in order:
        if factors_found[part] < 1.0 - _UNCHANGED_FACTOR:
            tightened.append((names[int(part)], float(factors_found[part])))
    return Tightening(tuple(tightened), float(np.mean(1.0 / factors_found)), 1.0 / ratio, reached)
