"""A proven lower bound of the distance between bodies along a whole path.

In an interval of s, the distance of a pair is at least the distance in the middle of the interval minus the largest
possible approach (`travel`) in half of the interval. Intervals are halved until this bound is at most `within` below
the smallest distance found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import MechanismError
from twin.core.units import MM
from twin.reference.pairs import CollisionPairs
from twin.reference.stations import Stations

_FAR = 100 * MM
"""Distance in m up to which lower bounds are computed, as long as no exact distance is known."""


@dataclass(frozen=True)
class Certificate:
    """Distance between bodies along a path.

    Attributes:
        proven: lower bound in m of the distance along the whole path.
        found: smallest distance in m at the tested values of s.
        s: path parameter, 0 to 1, at which this distance was found.
        bodies: names of the two bodies with this distance; "" if there are none.
    """

    proven: float
    found: float
    s: float
    bodies: tuple[str, str]


def nearest(found: Iterable[Certificate]) -> Certificate:
    """Combine certificates for different pairs on one path into one; without certificates, distances are infinite."""
    every = [Certificate(np.inf, np.inf, 0.0, ("", "")), *found]
    smallest = min(every, key=lambda c: c.found)
    # the proven bound and the smallest distance may be those of different pairs
    proven = min(c.proven for c in every)
    return replace(smallest, proven=proven)


def certify(
    seen: Stations, pairs: CollisionPairs, which: np.ndarray, within: float, check: Callable[[], None]
) -> Certificate:
    """Return the smallest distance, with a proven lower bound, of the pairs `which` (n,) along a path.

    Args:
        seen: the path with its stations.
        pairs: all pairs of bodies.
        which: (n,) indices of the pairs whose distance is bounded.
        within: accepted difference in m between the smallest distance found and the bound.
        check: called every few milliseconds; an exception of `check` ends the computation.

    Raises:
        MechanismError: loops do not close along the path.
    """
    # the intervals still to be tested: row i is the pair `pair[i]` in interval `place[i]` of 2**level
    pair = which
    place = np.zeros(len(which), int)
    level = 0
    smallest = np.inf
    s_smallest = 0.0
    names = ("", "")
    proven = np.inf
    while len(pair):
        check()
        width = 0.5**level
        places, row = np.unique(place, return_inverse=True)
        middles = (places + 0.5) * width
        X = seen.at(middles)
        if X is None:
            raise MechanismError("the loops of the mechanism do not close along the path")
        motion = seen.ahead(middles, width)
        poses, approaches = pairs.around(X, motion)
        ahead = approaches[row, pair]
        bound = pairs.gaps(poses, row, pair)
        near = np.flatnonzero(bound - ahead < smallest - within)
        # the distance that excludes a pair; while no exact distance is known, `_FAR` replaces it
        wanted = np.minimum(smallest, _FAR) - within + ahead[near]
        closer, *_ = pairs.bounds.at(poses, row[near], pair[near], wanted)
        bound[near] = np.maximum(bound[near], closer)
        # nearest first: a small exact distance excludes many of the following pairs
        for i in np.argsort(bound - ahead, kind="stable"):
            excluded = not bound[i] - ahead[i] < smallest - within
            if excluded:
                continue
            check()
            # a pair beyond this distance is excluded and is not the nearest
            most = smallest + max(float(ahead[i]) - within, 0.0)
            bound[i] = pairs.distance(int(pair[i]), poses[row[i]], most)
            if bound[i] < smallest:
                smallest = float(bound[i])
                s_smallest = float(middles[row[i]])
                names = tuple(pairs.shapes[j].name for j in pairs.rows[pair[i]])
        lower = bound - ahead
        unproven = lower < smallest - within
        proven = min(proven, float(lower[~unproven].min(initial=np.inf)))
        halved = np.flatnonzero(unproven)
        pair = np.repeat(pair[halved], 2)
        first_half = 2 * place[halved]
        place = np.column_stack([first_half, first_half + 1]).ravel()
        level += 1
    # bodies that overlap have the distance 0
    proven = max(min(proven, smallest), 0.0)
    return Certificate(proven, smallest, s_smallest, (names[0], names[1]))
