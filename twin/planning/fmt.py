"""FMT* (Fast Marching Tree): search for the shortest path between two points through random collision-free samples.

L. Janson, E. Schmerling, A. Clark, M. Pavone, "Fast Marching Tree: a fast marching sampling-based method for optimal
motion planning in many dimensions", Int. J. Robotics Research 34(7), 2015: algorithm 1, radius of theorem 4.1. A tree
grows outwards in the order of path length. Each sample is connected to the node of the tree's front through which its
path would be shortest without obstacles; only this connection is tested for collisions. The connections from one node
of the front are tested together.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import pairwise
from math import gamma, log, pi

import numpy as np
from scipy.spatial import KDTree

from twin.core.errors import ProtocolError
from twin.core.progress import StepProgress, silent_step
from twin.core.spatial import Array
from twin.planning.costs import Cost, length
from twin.planning.space import Space

_RADIUS_FACTOR = 1.1
"""Neighbourhood radius, divided by the smallest radius for which the path length converges to the minimum."""

_MOST_DRAWS = 50
"""Maximum number of samples drawn per required free sample."""

_FRONT_NODES = 16
"""Number of nodes of the front whose connections are tested together."""

_SMALLEST_BLOCK = 16
"""Minimum number of samples that are drawn together: twice as many as are missing, because some collide."""

_LARGEST_BLOCK = 2048
"""Maximum number of samples that are drawn together."""


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
        self.space = space
        self.cost = cost or length(space.weights)
        self.checks = 0
        self._box = box
        self._rng = rng
        self._longest_useful = np.inf  # m; `inform` lowers it
        self._q = np.array([start, goal])
        self._moving = np.ptp(box, axis=1) > 0
        self._drawn_count = 0  # number of samples drawn, free or not
        self._free_count = 0  # number of them that are free
        self._is_free: dict[tuple[int, int], bool] = {}  # rows (from, to) of a connection -> whether it is free
        self._neighbours: list[np.ndarray] = []  # rows of the neighbours of each sample
        self._costs: list[Array] = []  # costs of the connections from these neighbours to the sample
        self._parent = np.full(2, -1)

    @property
    def count(self) -> int:
        """Number of free samples."""
        return len(self._q) - 2

    @property
    def tree(self) -> SearchTree:
        """The tree of the last call of `path`, even if this call found no path or ended by an exception."""
        return SearchTree(self._q[: len(self._parent)].copy(), self._parent.copy())

    def path(self, samples: int, progress: StepProgress = silent_step) -> Array | None:
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
        if not self._moving.any():  # start and goal are the only state of the box
            self._parent = np.array([-1, 0])
            return self._q[:2].copy()
        self._draw(samples, lambda f: progress(f / 2))
        x = self._q * self.space.weights
        edges = np.ptp(self._box, axis=1)[self._moving] * self.space.weights[self._moving]
        free_fraction = max(self._free_count, 1) / max(self._drawn_count, 1)
        # Theorem 4.1 has the volume of the free space; the share of free samples estimates it.
        volume = free_fraction * float(np.prod(edges))
        radius = _radius(len(x), int(self._moving.sum()), volume)
        self._neighbours = neighbours(x, radius)
        self._costs = []
        for i, neighbour_rows in enumerate(self._neighbours):
            self._costs.append(self.cost(self._q[neighbour_rows], self._repeated(i, len(neighbour_rows))))
        self._parent = np.full(len(x), -1)
        rows, _ = self._grow(self._costs, self._parent, lambda f: progress((1 + f) / 2))
        if rows is None:
            return None
        return self._q[rows]

    def reached(self) -> tuple[int, int]:
        """Return the numbers of samples connected with the start and with the goal, after `path` found no path."""
        backward = []  # costs of the connections in the other direction
        for i, neighbour_rows in enumerate(self._neighbours):
            backward.append(self.cost(self._repeated(i, len(neighbour_rows)), self._q[neighbour_rows]))
        count = len(self._neighbours)
        _, from_start = self._grow(self._costs, np.full(count, -1))
        _, from_goal = self._grow(backward, np.full(count, -1), ends=(1, 0))
        return from_start, from_goal

    def _repeated(self, row: int, count: int) -> Array:
        """Return the joint values (count, n) of one sample, repeated without a copy."""
        return np.broadcast_to(self._q[row], (count, len(self._box)))

    def inform(self, corners: Array) -> None:
        """From now on, use only samples through which a path can be shorter than the path along corners (k, n).

        J. D. Gammell, S. S. Srinivasa, T. D. Barfoot, "Informed RRT*", IROS 2014: such samples are in an ellipsoid
        whose foci are start and goal. The cost of the search must be the length. Results of collision tests are kept.
        """
        x = corners * self.space.weights
        self._longest_useful = float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())
        keep = self._useful(self._q)
        keep[:2] = True  # rounding could exclude start and goal
        rows = np.flatnonzero(keep)
        new_rows = dict(zip(rows.tolist(), range(len(rows)), strict=True))
        known_connections = {}
        for (a, b), free in self._is_free.items():
            if a in new_rows and b in new_rows:
                known_connections[new_rows[a], new_rows[b]] = free
        self._is_free = known_connections
        self._free_count -= int((~keep).sum())
        self._q = self._q[rows]
        self._parent = np.full(len(rows), -1)

    def _useful(self, q: Array) -> np.ndarray:
        """Return (k,) bool: whether a path through q (k, n) can be shorter than the path of `inform`."""
        x = q * self.space.weights
        start, goal = self._q[:2] * self.space.weights
        shortest = np.linalg.norm(x - start, axis=1) + np.linalg.norm(x - goal, axis=1)
        return shortest <= self._longest_useful

    def block(self, corners: Array) -> bool:
        """Test the connections along `corners` (k, n) over their whole length; return whether any is blocked.

        Blocked connections are excluded from the search.
        """
        rows = []
        for corner in corners:
            equal = (self._q == corner).all(axis=1)
            rows.append(int(np.flatnonzero(equal)[0]))
        blocked = False
        for k, (i, j) in enumerate(pairwise(rows)):
            if not self.space.free_between(corners[k], corners[k + 1]):
                blocked = True
                self._is_free[i, j] = False
                self._is_free[j, i] = False
        return blocked

    def _draw(self, samples: int, progress: StepProgress) -> None:
        """Add free samples until there are `samples`, or until `_MOST_DRAWS` samples per required sample are drawn."""
        limit = _MOST_DRAWS * samples
        drawn_count = 0
        low, high = self._box.T
        while self.count < samples and drawn_count < limit:
            missing = samples - self.count
            size = min(max(2 * missing, _SMALLEST_BLOCK), _LARGEST_BLOCK)
            block = self._rng.uniform(low, high, (size, len(self._box)))
            drawn_count += size
            self._drawn_count += size
            block = block[self._useful(block)]
            # A fast test may err here: the connections of a sample are tested too, and the path over its whole
            # length.
            free = block[self.space.free(block, exact=False)]
            self._free_count += len(free)
            self._q = np.concatenate([self._q, free[:missing]])
            fraction = max(self.count / samples, drawn_count / limit)
            progress(min(fraction, 1.0))

    def _grow(
        self,
        costs: list[Array],
        parent: np.ndarray,
        progress: StepProgress = silent_step,
        ends: tuple[int, int] = (0, 1),
    ) -> tuple[list[int] | None, int]:
        """Grow a tree from sample ends[0] to ends[1]; return (rows of the path or None, number of reached samples).

        `costs` are those of the connections between each sample and its neighbours. `parent` (k,),
        all -1, receives the rows of the parents. With ends (1, 0), the tree grows from the goal, against the direction
        of motion: connections then lead from a sample to its parent. Testing many connections together is much faster
        than testing them singly. Each test therefore includes connections that the next nodes of the front will
        probably need.
        """
        neighbours_of = self._neighbours
        count = len(neighbours_of)
        root, target = ends
        from_goal = root > target
        waiting = np.ones(count, bool)  # samples outside of the tree
        waiting[root] = False
        cost = np.full(count, np.inf)  # cost of the path from the root
        cost[root] = 0.0
        front = cost.copy()  # cost of each node of the front; infinite for all other nodes
        heap = [(0.0, root)]
        node = root  # node of the front with the lowest cost

        def candidates(to: np.ndarray) -> list[tuple[int, int]]:
            """Return pairs (node of the front, sample in `to`): the path to the sample is shortest through this node.

            There is no pair for a sample that no node of the front can reach.
            """
            pairs = []
            for sample in to.tolist():
                through = front[neighbours_of[sample]] + costs[sample]
                cheapest = int(np.argmin(through))
                if np.isfinite(through[cheapest]):
                    pairs.append((int(neighbours_of[sample][cheapest]), sample))
            return pairs

        def directed(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
            """Return the pairs, each ordered in the direction of motion."""
            if not from_goal:
                return pairs
            return [(sample, parent) for parent, sample in pairs]

        while node != target:
            pairs = candidates(neighbours_of[node][waiting[neighbours_of[node]]])
            connections = directed(pairs)
            if not self._is_free.keys() >= set(connections):
                next_samples = self._waiting_around_front(heap, waiting)
                self._test([*connections, *directed(candidates(next_samples))])
            front[node] = np.inf
            heapq.heappop(heap)
            for (front_node, sample), connection in zip(pairs, connections, strict=True):
                if not self._is_free[connection]:
                    continue  # without obstacles it would be the best one: the sample stays outside for now
                place = int(np.searchsorted(neighbours_of[sample], front_node))
                parent[sample] = front_node
                cost[sample] = cost[front_node] + costs[sample][place]
                front[sample] = cost[sample]
                waiting[sample] = False
                heapq.heappush(heap, (float(cost[sample]), sample))
            progress(1 - float(waiting.mean()))
            if not heap:
                return None, count - int(waiting.sum()) - 1
            node = heap[0][1]
        rows = [target]
        while rows[-1] != root:
            rows.append(int(parent[rows[-1]]))
        return rows[::-1], count - int(waiting.sum()) - 1

    def _waiting_around_front(self, heap: list[tuple[float, int]], waiting: np.ndarray) -> np.ndarray:
        """Return the samples outside of the tree near the next nodes of the front; `heap`: (cost, node) of each."""
        neighbours_of_front = []
        for _, node in heapq.nsmallest(_FRONT_NODES, heap):
            neighbours_of_front.append(self._neighbours[node])
        samples = np.concatenate(neighbours_of_front)
        return np.unique(samples[waiting[samples]])

    def _test(self, pairs: list[tuple[int, int]]) -> None:
        """Test the connections (from, to) between samples that have not been tested yet, each once."""
        new = [pair for pair in dict.fromkeys(pairs) if pair not in self._is_free]
        rows = np.array(new)
        self.checks += len(new)
        begins = self._q[rows[:, 0]]
        ends = self._q[rows[:, 1]]
        free = self.space.free_each(begins, ends)
        self._is_free.update(zip(new, free.tolist(), strict=True))


def neighbours(x: Array, radius: float) -> list[np.ndarray]:
    """Return, for each point of x (k, n), the rows of the points within `radius` of it, in ascending order."""
    pairs = KDTree(x).query_pairs(radius, output_type="ndarray")
    a, b = np.concatenate([pairs, pairs[:, ::-1]]).T  # each pair in both directions
    order = np.lexsort((b, a))
    counts = np.bincount(a, minlength=len(x))
    return np.split(b[order], np.cumsum(counts)[:-1])


def _radius(count: int, n: int, volume: float) -> float:
    """Return the neighbourhood radius of theorem 4.1 for `count` samples in n dimensions and the free `volume`."""
    ball = pi ** (n / 2) / gamma(n / 2 + 1)  # volume of the unit ball
    # theorem 4.1: (1 + eta) 2 (1 / n)^(1/n) (volume / ball)^(1/n) (log k / k)^(1/n)
    return _RADIUS_FACTOR * 2 * (volume / (n * ball) * log(count) / count) ** (1 / n)
