"""FMT* (Fast Marching Tree): search for the shortest path between two points through random collision-free samples.

L. Janson, E. Schmerling, A. Clark, M. Pavone, "Fast Marching Tree: a fast marching sampling-based method for optimal
motion planning in many dimensions", Int. J. Robotics Research 34(7), 2015: algorithm 1, radius of theorem 4.1. A tree
grows outwards in the order of path length. Each sample is connected to the node of the tree's front through which its
path would be shortest without obstacles; only this connection is tested for collisions. The connections from one node
of the front are tested together.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import gamma, log, pi

import numpy as np
from scipy.spatial import KDTree

from twin.core.errors import ProtocolError
from twin.core.spatial import Array
from twin.planning.costs import Cost, length
from twin.planning.space import Space

_WIDER = 1.1
"""Neighbourhood radius, divided by the smallest radius for which the path length converges to the minimum."""

_TRIES = 50
"""Maximum number of samples drawn per required free sample."""

_AHEAD = 16
"""Number of nodes of the front whose connections are tested together."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SearchTree:
    """The tree of a search.

    Attributes:
        q: (k, n) joint values of the samples; row 0 is the start, row 1 the goal.
        parent: (k,) row of each sample's parent; -1 for the start, and for samples that the tree did not reach.
    """

    q: Array
    parent: np.ndarray

    @property
    def branches(self) -> np.ndarray:
        """Row numbers (m, 2) in `q`: parent and child of each of the m branches."""
        child = np.flatnonzero(self.parent >= 0)
        return np.column_stack([self.parent[child], child])

    @property
    def corners(self) -> Array | None:
        """Joint values (k, n) of the path from start to goal; None if the tree did not reach the goal."""
        if self.parent[1] < 0:
            return None
        rows = [1]
        while rows[-1]:
            rows.append(int(self.parent[rows[-1]]))
        return self.q[rows[::-1]]


class FmtSearch:
    """A search between two points; each call of `path` adds further samples.

    Attributes:
        space: the joint space.
        checks: number of connections tested for collisions.
    """

    def __init__(
        self,
        space: Space,
        start: Array,
        goal: Array,
        box: Array,
        rng: np.random.Generator,
        cost: Cost | None = None,
    ) -> None:
        """Set up a search.

        Args:
            space: the joint space, which tests for collisions.
            start: (n,) joint values at the start, free of collisions.
            goal: (n,) joint values at the goal, free of collisions.
            box: (n, 2) lower and upper bounds of the samples; a joint with equal bounds does not move.
            rng: random generator; the same seed gives the same path.
            cost: what the path minimises; None: the length of the path. A forbidden connection has infinite cost.

        Raises:
            ProtocolError: start, goal or box have values that are not finite, or start or goal are not in the box.
        """
        for name, q in (("start", start), ("goal", goal)):
            if not np.all(np.isfinite(q)):
                raise ProtocolError(f"{name} of the search has values that are not finite: {np.asarray(q)}")
            if not (np.all(q >= box[:, 0]) and np.all(q <= box[:, 1])):
                raise ProtocolError(f"{name} of the search is not in its box, lower and upper bounds {box.tolist()}")
        self.cost = cost or length(space.weights)
        self._most = np.inf
        self.space, self._box, self._rng = space, box, rng
        self._q = np.array([start, goal])
        self._moving = np.ptp(box, axis=1) > 0
        self._tried = self._good = self.checks = 0
        self._known: dict[tuple[int, int], bool] = {}  # rows (from, to) of a connection -> whether it is free
        self._graph: tuple[list[np.ndarray], list[Array]] = [], []
        self._parent = np.full(2, -1)

    @property
    def count(self) -> int:
        """Number of free samples."""
        return len(self._q) - 2

    @property
    def tree(self) -> SearchTree:
        """The tree of the last call of `path`, even if this call found no path or ended by an exception."""
        return SearchTree(self._q[: len(self._parent)].copy(), self._parent.copy())

    def path(self, samples: int, progress: Progress = lambda fraction: None) -> Array | None:
        """Return the corners (k, n) of the shortest path found; None if no path was found.

        Free samples are added until the search has `samples` free samples. After `inform`, samples through which no
        path can be shorter than the path of `inform` are left out.

        `progress` is called with the fraction done: 0 to 0.5 while samples are drawn, 0.5 to 1 while the tree grows. An
        exception raised by `progress` ends the search.

        Raises:
            ProtocolError: `samples` is less than 1.
        """
        if samples < 1:
            raise ProtocolError(f"a search with {samples} samples cannot find a path; give at least 1")
        self._draw(samples, lambda f: progress(f / 2))
        x = self._q * self.space.weights
        edges = np.ptp(self._box, axis=1)[self._moving] * self.space.weights[self._moving]
        volume = max(self._good, 1) / max(self._tried, 1) * float(np.prod(edges))
        radius = _radius(len(x), int(self._moving.sum()), volume)
        near = neighbours(x, radius)
        way = [self.cost(self._q[n], np.broadcast_to(self._q[i], (len(n), len(self._box)))) for i, n in enumerate(near)]
        self._graph, self._parent = (near, way), np.full(len(x), -1)
        rows = self._grow(near, way, self._parent, lambda f: progress((1 + f) / 2))[0]
        return None if rows is None else self._q[rows]

    def reached(self) -> tuple[int, int]:
        """Return the numbers of samples connected with the start and with the goal, after `path` found no path."""
        (near, way), none = self._graph, np.full(len(self._graph[0]), -1)
        back = [
            self.cost(np.broadcast_to(self._q[i], (len(n), len(self._box))), self._q[n]) for i, n in enumerate(near)
        ]
        return self._grow(near, way, none.copy())[1], self._grow(near, back, none, ends=(1, 0))[1]

    def inform(self, corners: Array) -> None:
        """From now on, use only samples through which a path can be shorter than the path along corners (k, n).

        J. D. Gammell, S. S. Srinivasa, T. D. Barfoot, "Informed RRT*", IROS 2014: such samples are in an ellipsoid
        whose foci are start and goal. The cost of the search must be the length. Results of collision tests are kept.
        """
        x = corners * self.space.weights
        self._most = float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
        keep = self._useful(self._q)
        keep[:2] = True
        rows = np.flatnonzero(keep)
        new = {int(old): k for k, old in enumerate(rows)}
        self._known = {(new[a], new[b]): f for (a, b), f in self._known.items() if a in new and b in new}
        self._good -= int((~keep).sum())
        self._q, self._parent = self._q[rows], np.full(len(rows), -1)

    def _useful(self, q: Array) -> np.ndarray:
        """Return (k,) bool: whether a path through q (k, n) can be shorter than the path of `inform`."""
        x, ends = q * self.space.weights, self._q[:2] * self.space.weights
        way = np.linalg.norm(x - ends[0], axis=1) + np.linalg.norm(x - ends[1], axis=1)
        return way <= self._most

    def block(self, corners: Array) -> bool:
        """Test the connections along `corners` (k, n) over their whole length; return whether any is blocked.

        Blocked connections are excluded from the search.
        """
        rows = [int(np.flatnonzero((self._q == c).all(axis=1))[0]) for c in corners]
        bad = [
            pair
            for pair, a, b in zip(pairwise(rows), corners, corners[1:], strict=False)
            if not self.space.free_between(a, b)
        ]
        for i, j in bad:
            self._known[i, j] = self._known[j, i] = False
        return bool(bad)

    def _draw(self, samples: int, progress: Progress) -> None:
        first = self._tried
        while self.count < samples and self._tried - first < _TRIES * samples:
            size = min(max(2 * (samples - self.count), 16), 2048)
            block = self._rng.uniform(self._box[:, 0], self._box[:, 1], (size, len(self._box)))
            self._tried += size
            block = block[self._useful(block)]
            good = block[self.space.free(block, exact=False)]
            self._good += len(good)
            self._q = np.concatenate([self._q, good[: samples - self.count]])
            progress(min(max(self.count / samples, (self._tried - first) / (_TRIES * samples)), 1.0))

    def _grow(
        self,
        near: list[np.ndarray],
        way: list[Array],
        parent: np.ndarray,
        progress: Progress = lambda fraction: None,
        ends: tuple[int, int] = (0, 1),
    ) -> tuple[list[int] | None, int]:
        """Grow a tree from sample ends[0] to ends[1]; return (rows of the path or None, number of reached samples).

        `near` are the neighbours of each sample, `way` the costs of the connections to these neighbours. `parent` (k,),
        all -1, receives the rows of the parents. With ends (1, 0), the tree grows from the goal, against the direction
        of motion: connections then lead from a sample to its parent. Testing many connections together is much faster
        than testing them singly. Each test therefore includes connections that the next nodes of the front will
        probably need.
        """
        count, back = len(near), ends[0] > ends[1]
        waiting, cost = np.ones(count, bool), np.full(count, np.inf)
        front = cost.copy()  # cost of each node of the front; infinite for all other nodes
        root, target = ends
        waiting[root], cost[root], front[root] = False, 0.0, 0.0
        heap, z = [(0.0, root)], root

        def candidates(to: np.ndarray) -> list[tuple[int, int]]:
            """Return pairs (node of the front, sample in `to`): the path to the sample is shortest through this node.

            There is no pair for a sample that no node of the front can reach.
            """
            out = []
            for i in to.tolist():
                through = front[near[i]] + way[i]
                k = int(np.argmin(through))
                if np.isfinite(through[k]):
                    out.append((int(near[i][k]), i))
            return out

        def moved(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
            """Return the pairs, each ordered in the direction of motion."""
            return [(i, j) for j, i in pairs] if back else pairs

        while z != target:
            to = near[z][waiting[near[z]]]
            pairs = candidates(to)
            tested = moved(pairs)
            if any(p not in self._known for p in tested):
                coming = np.concatenate([near[i] for _, i in heapq.nsmallest(_AHEAD, heap)])
                coming = np.unique(coming[waiting[coming]])
                self._test([*tested, *moved(candidates(coming))])
            front[z] = np.inf
            heapq.heappop(heap)
            for (j, i), pair in zip(pairs, tested, strict=True):
                if self._known[pair]:
                    k = int(np.searchsorted(near[i], j))
                    parent[i], cost[i] = j, cost[j] + way[i][k]
                    waiting[i], front[i] = False, cost[i]
                    heapq.heappush(heap, (float(cost[i]), i))
            progress(1 - float(waiting.mean()))
            if not heap:
                return None, count - int(waiting.sum()) - 1
            z = heap[0][1]
        rows = [target]
        while rows[-1] != root:
            rows.append(int(parent[rows[-1]]))
        return rows[::-1], count - int(waiting.sum()) - 1

    def _test(self, pairs: list[tuple[int, int]]) -> None:
        """Test the connections (from, to) between samples that have not been tested yet, each once."""
        new = [p for p in dict.fromkeys(pairs) if p not in self._known]
        rows = np.array(new)
        self.checks += len(new)
        for pair, free in zip(new, self.space.free_each(self._q[rows[:, 0]], self._q[rows[:, 1]]), strict=True):
            self._known[pair] = bool(free)


def neighbours(x: Array, radius: float) -> list[np.ndarray]:
    """Return, for each point of x (k, n), the rows of the points within `radius` of it, in ascending order."""
    pairs = KDTree(x).query_pairs(radius, output_type="ndarray")
    a, b = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.lexsort((b, a))
    return np.split(b[order], np.cumsum(np.bincount(a, minlength=len(x)))[:-1])


def _radius(count: int, n: int, volume: float) -> float:
    """Return the neighbourhood radius of theorem 4.1 for `count` samples in n dimensions and the free `volume`."""
    ball = pi ** (n / 2) / gamma(n / 2 + 1)
    return _WIDER * 2 * (volume / (n * ball) * log(count) / count) ** (1 / n)
