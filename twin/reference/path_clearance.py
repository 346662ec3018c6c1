"""Distances of bodies along whole paths: whether they are kept (`are_clear`), and a proven lower bound (`certify`).

A path q(s) is not judged at sampled points but in intervals of s. In an interval, the distance of a pair is at least
the distance in the middle of the interval minus the largest possible approach of the two bodies (`relative_motion`) in
half of the interval. Where this bound does not decide, the interval is halved: for `are_clear` until the distance
exceeds the approach, for `certify` until the bound is at most `within` below the smallest distance found.

For most intervals, bounds of the distance suffice (`collision_pairs`). If they do not and the remaining motion is
small, coal tests whether the meshes are nearer than this motion, which is much faster than a computation of the
distance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.reference.collision_pairs import SEARCH_BALL_RADIUS, CollisionPairs
from twin.reference.loop_closing import Closing

_FAR = 100 * MM
"""Distance in m up to which lower bounds are computed, as long as no exact distance is known."""


_HALVINGS_AT_ONCE = 2
"""Number of halvings of an interval at once: few large batches are faster than many small ones."""

_MESH_MARGIN = 3.0
"""Largest needed distance, in units of the required one, for which meshes are tested; for larger ones coal is slow."""

_SEARCH_MOTION = 6 * MM
"""In a search: largest relative motion in m of two bodies from a tested state. A found path is tested completely."""


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
class PathBatch:
    """Paths that are tested together.

    Attributes:
        count: number of paths.
        configurations: function of the path (k,) and s (k,): configurations (k, nq) there, or None if loops open.
        motion: function of the path (k,), s (k,) and a width: (k, nv), largest motion of each coordinate from s to both
            ends of an interval of this width around s, in m or rad.
    """

    count: int
    configurations: Callable[[np.ndarray, Array], Array | None]
    motion: Callable[[np.ndarray, Array, float], Array]


def are_clear(paths: PathBatch, pairs: CollisionPairs, check: Callable[[], None], *, exact: bool = True) -> np.ndarray:
    """Return (count,) bool: whether all pairs have the required distance at the tested s, and half of it at all s.

    Args:
        paths: the paths.
        pairs: the pairs of bodies, with their required distances.
        check: called every few milliseconds; an exception of `check` ends the computation.
        exact: whether exact distances decide where bounds do not; otherwise `CollisionPairs.seem_near` does.
    """
    is_clear = np.ones(paths.count, bool)
    smallest_radius = 0.0
    if not exact:
        smallest_radius = SEARCH_BALL_RADIUS
    parts = 2**_HALVINGS_AT_ONCE
    # the tests that are still open: row i is the pair `pair[i]` in interval `place[i]`, of 2**level, of `path[i]`
    path, pair = np.divmod(np.arange(paths.count * len(pairs)), max(len(pairs), 1))
    place = np.zeros(len(path), int)
    level = 0
    while len(path):
        check()
        width = 0.5**level
        # each interval of each path is placed once, for all of its pairs
        keys, row = np.unique(path * 2**level + place, return_inverse=True)
        path_of_row = keys >> level
        places = keys & (2**level - 1)
        middles = (places + 0.5) * width
        X = paths.configurations(path_of_row, middles)
        if X is None:
            return np.zeros(paths.count, bool)
        poses, approaches = pairs.around(X, paths.motion(path_of_row, middles, width))
        required = pairs.required[pair]
        approach = approaches[row, pair]
        # the distance in the middle with which a pair is clear in the whole interval
        needed = np.maximum(required, required / 2 + approach)
        tests = np.flatnonzero(pairs.gaps(poses, row, pair) < needed)
        low, high = pairs.bounds.at(poses, row[tests], pair[tests], needed[tests], required[tests], smallest_radius)
        if exact:
            is_near = high < required[tests]
        else:
            is_near = pairs.seem_near(X, poses, row[tests], pair[tests], low, high, is_clear[path_of_row])
        is_clear[path[tests[is_near]]] = False
        tests = tests[(low < needed[tests]) & is_clear[path[tests]]]
        if exact:
            # where the bounds do not decide and the interval is short, exact distances do
            undecided: list[int] = []
            for i in tests:
                check()
                if not is_clear[path[i]]:
                    continue
                T = poses[row[i]]
                if needed[i] <= required[i]:
                    is_clear[path[i]] = not pairs.closer(int(pair[i]), X[[row[i]]], T[None])[0]
                elif _is_undecided_by_meshes(pairs, int(pair[i]), T, float(needed[i])):
                    undecided.append(i)
            tests = np.array(undecided, int)
        else:
            tests = tests[approach[tests] > _SEARCH_MOTION]
        tests = tests[is_clear[path[tests]]]  # a path that was found too near needs no further test
        path = np.repeat(path[tests], parts)
        pair = np.repeat(pair[tests], parts)
        place = (place[tests, None] * parts + np.arange(parts)).ravel()
        level += _HALVINGS_AT_ONCE
    return is_clear


def _is_undecided_by_meshes(pairs: CollisionPairs, pair: int, poses: Array, needed: float) -> bool:
    """Return whether the meshes at shape poses (shapes, 4, 4) do not show that a pair is `needed` in m apart."""
    # coal is slow for a large distance, and for close meshes: shorter intervals need a smaller one
    if needed > _MESH_MARGIN * float(pairs.required[pair]) or pairs.celled(pair):
        return True
    return pairs.nearer(pair, poses, needed)


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
