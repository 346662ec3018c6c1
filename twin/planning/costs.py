"""Costs of straight connections for a search: length, stops, weighted sum of both, clearance, and the Raven paper's.

`stops` prefers paths with few corners. It assumes that each connection begins and ends at rest, with a constant
acceleration a along its weighted length l in joint space, and then the same deceleration. The connection then takes
2 sqrt(l / a), and the integral of the squared acceleration is 2 a^(3/2) sqrt(l). `length_and_stops` is 0.1 times
`length` plus 0.5 times `stops`. All three obey the triangle inequality. If a path is divided into more connections,
`stops` grows: it does not converge as the number of samples grows.

`published` is the cost of the Raven paper, eq. (1): eta_1 c(path) + eta_2 (integral of |tip acceleration|^2 dt), along
the motion of a plant under PD control (`twin.planning.published_cost`). `length_and_stops` has its form and its weights
but ranks connections differently (docs/derivations.md).

The cost for clearance is a length in which parts of a path near other bodies count more: at a distance d from the
nearest body, the length is multiplied by 1 + 9 max(0, 1 - d / 20 mm). Both numbers are ASSUMED: a path may be ten times
as long to avoid a contact, and distances above 20 mm do not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.planning.space import Space

Cost = Callable[[Array, Array], Array]
"""Function of joint values a (k, n) and b (k, n): cost (k,), at least 0, of the straight connections from a to b."""

_LENGTH_WEIGHT = 0.1
"""Weight of the length in `length_and_stops`: that of the first term in the Raven paper's Table 2."""

_STOPS_WEIGHT = 0.5
"""Weight of the stops: that of the second term there."""

ACCELERATION = 0.24
"""Acceleration and deceleration of a connection in m/s2 (ASSUMED: the limit of the tip in the dome's protocol)."""


def length(weights: Array) -> Cost:
    """Return the length in m as a cost; `weights` (n,) are in m per unit of each joint."""

    def cost(a: Array, b: Array) -> Array:
        steps = (b - a) * weights
        return np.sqrt(np.einsum("ki,ki->k", steps, steps))

    return cost


def stops(weights: Array) -> Cost:
    """Return, in m2/s3, the integral of the squared acceleration along a connection from rest to rest, as a cost."""
    length_of = length(weights)
    return lambda a, b: 2 * ACCELERATION**1.5 * np.sqrt(length_of(a, b))


def length_and_stops(weights: Array) -> Cost:
    """Return 0.1 times `length` plus 0.5 times `stops` as a cost; this is not eq. (1) of the Raven paper."""
    length_of = length(weights)
    stops_of = stops(weights)
    return lambda a, b: _LENGTH_WEIGHT * length_of(a, b) + _STOPS_WEIGHT * stops_of(a, b)


_CLEARANCE_RANGE = 20 * MM
"""Distance in m above which only the length counts (ASSUMED)."""

_CONTACT_COST = 9.0
"""Additional cost per length at distance 0 (ASSUMED)."""

_STATE_SPACING = 20 * MM
"""Along a connection, distances are computed at states with at most this spacing (weighted length in m)."""


def clearance(space: Space) -> Cost:
    """Return the cost for clearance: a length in m in which parts of a path near other bodies count more.

    The distances are lower bounds (`Space.clearances`) at states that are at most `_STATE_SPACING` apart.
    """
    length_of = length(space.weights)

    def cost(a: Array, b: Array) -> Array:
        lengths = length_of(a, b)
        if not len(lengths):
            return lengths
        counts = np.maximum(np.ceil(lengths / _STATE_SPACING).astype(int), 1)  # number of states on each connection
        first = np.cumsum(counts) - counts  # row of the first state of each connection
        index = np.arange(counts.sum()) - np.repeat(first, counts)
        fraction = (index + 0.5) / np.repeat(counts, counts)  # in the middle of equal parts
        states = np.repeat(a, counts, axis=0) + fraction[:, None] * np.repeat(b - a, counts, axis=0)
        nearness = 1 - np.minimum(space.clearances(states, _CLEARANCE_RANGE) / _CLEARANCE_RANGE, 1.0)
        return lengths * (1 + _CONTACT_COST * np.add.reduceat(nearness, first) / counts)

    return cost


def published(space: Space) -> Cost:
    """Return eq. (1) of the Raven paper with the weights of its Table 2 as a cost; for an arm without loops only."""
    from twin.planning.published_cost import published_cost  # imports casadi and the compiler, which load slowly

    return published_cost(space.mechanism, space.limits)


COSTS: Mapping[str, Callable[[Space], Cost]] = MappingProxyType(
    {
        "length": lambda space: length(space.weights),
        "stops": lambda space: stops(space.weights),
        "length_and_stops": lambda space: length_and_stops(space.weights),
        "clearance": clearance,
        "published": published,
    }
)
"""{name of a cost in a protocol: function of a space that returns this cost}; `published` with the paper's weights."""

SMALLEST_WHEN_STRAIGHT = ("length", "stops", "length_and_stops")
"""Names of the costs that are smallest on the straight connection of two points."""


def total(cost: Cost, corners: Array) -> float:
    """Return the cost of a path along corners (k, n)."""
    return float(cost(corners[:-1], corners[1:]).sum())
