"""A proven lower bound of the distance between bodies along a whole path.

The path is given with stations: states on it with closed loops, between which the motion of each coordinate is bounded.
In an interval of s, the distance of a pair is at least the distance in the middle of the interval minus the largest
possible approach (`relative_motion`) in half of the interval. Intervals are halved until this bound is at most `within`
below the smallest distance found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.reference.collision_pairs import CollisionPairs
from twin.reference.loop_closing import Closing

_FAR = 100 * MM
"""Distance in m up to which lower bounds are computed, as long as no exact distance is known."""


@dataclass(frozen=True)
class Stations:
    """A path with its stations, and bounds of the motion of each coordinate.

    Attributes:
        path: the path q(s).
        closing: closes the loops of the mechanism.
        s: (k,) values of s at the stations.
        X: (k, nq) configurations at the stations.
        fine: (m,) values of s from 0 to 1 for `travel`.
        travel: (m, nv) in m or rad, upper bound of the path length of each coordinate from s = 0 to each s in `fine`.
    """

    path: Callable[[Array], Array]
    closing: Closing
    s: Array
    X: Array
    fine: Array
    travel: Array

    def at(self, s: Array) -> Array | None:
        """Return configurations (k, nq) of the path at s (k,); None if the loops do not close."""
        q = self.path(s)
        closing = self.closing
        if closing.linear is not None:
            return closing.placed(q)
        i, part = _place(self.s, s)
        guess = closing.between(self.X[i], self.X[i + 1], part)
        X, closed = closing.near(guess, q)
        if not closed.all():
            return None
        return X

    def ahead(self, s: Array, width: float) -> Array:
        """Return upper bounds (k, nv) of each coordinate's motion from s (k,), within width / 2 on either side of s."""
        low = self._travel_until(s - 0.5 * width)
        middle = self._travel_until(s)
        high = self._travel_until(s + 0.5 * width)
        return np.maximum(high - middle, middle - low)

    def _travel_until(self, s: Array) -> Array:
        """Return `travel` (k, nv) at s (k,), interpolated between the values of `fine`."""
        i, part = _place(self.fine, s)
        increase = self.travel[i + 1] - self.travel[i]
        return self.travel[i] + part[:, None] * increase


def _place(grid: Array, s: Array) -> tuple[np.ndarray, Array]:
    """Return, for s (k,), the index of the value of a grid before it, and its place from there, 0 to 1."""
    i = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, len(grid) - 2)
    return i, (s - grid[i]) / (grid[i + 1] - grid[i])


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


def nearest(certificates: Iterable[Certificate]) -> Certificate:
    """Combine certificates for different pairs on one path into one; without certificates, distances are infinite."""
    every = [Certificate(np.inf, np.inf, 0.0, ("", "")), *certificates]
    smallest = min(every, key=lambda c: c.found)
    # the proven bound and the smallest distance may be those of different pairs
    proven = min(c.proven for c in every)
    return replace(smallest, proven=proven)


def certify(
    stations: Stations, pairs: CollisionPairs, which: np.ndarray, within: float, check: Callable[[], None]
) -> Certificate:
    """Return the smallest distance, with a proven lower bound, of the pairs `which` (n,) along a path.

    Args:
        stations: the path with its stations.
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
        X = stations.at(middles)
        if X is None:
            raise MechanismError("the loops of the mechanism do not close along the path")
        motion = stations.ahead(middles, width)
        poses, approaches = pairs.around(X, motion)
        ahead = approaches[row, pair]
        bound = pairs.gaps(poses, row, pair)
        candidate_rows = np.flatnonzero(bound - ahead < smallest - within)
        # the distance that excludes a pair; while no exact distance is known, `_FAR` replaces it
        excluding_distance = np.minimum(smallest, _FAR) - within + ahead[candidate_rows]
        closer, *_ = pairs.bounds.at(poses, row[candidate_rows], pair[candidate_rows], excluding_distance)
        bound[candidate_rows] = np.maximum(bound[candidate_rows], closer)
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
                a, b = pairs.rows[pair[i]]
                names = (pairs.shapes[a].name, pairs.shapes[b].name)
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
    return Certificate(proven, smallest, s_smallest, names)
