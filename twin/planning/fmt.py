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
from itertools import pairwise
from math import gamma, log, pi

import numpy as np
from scipy.spatial import cKDTree

from twin.core.spatial import Array
from twin.planning.space import Space

_WIDER = 1.1
"""Ratio of the radius to the smallest radius for which the path length converges to the minimum."""

_TRIES = 20
"""Maximum number of samples drawn per required free sample."""

Progress = Callable[[float], None]


class Search:
    """A search between two points; each call of `path` adds samples to those before.

    Attributes:
        checks: number of connections tested for collisions.
    """

    def __init__(self, space: Space, start: Array, goal: Array, box: Array, rng: np.random.Generator) -> None:
        """Set up a search.

        Args:
            space: the joint space, which tests for collisions.
            start: (n,) joint values at the start, free of collisions.
            goal: (n,) joint values at the goal, free of collisions.
            box: (n, 2) lower and upper bounds of the samples; a joint with equal bounds does not move.
            rng: random generator; the same seed gives the same path.
        """
        self._space, self._box, self._rng = space, box, rng
        self._q = np.array([start, goal])
        self._moving = np.ptp(box, axis=1) > 0
        self._tried = self._good = self.checks = 0
        self._known: dict[tuple[int, int], bool] = {}

    @property
    def count(self) -> int:
        """Number of free samples."""
        return len(self._q) - 2

    def path(self, samples: int, progress: Progress = lambda fraction: None) -> Array | None:
        """Return the corners (k, n) of the shortest path found through `samples` free samples in all; None if none.

        `progress` is called with the fraction done: first half drawing of samples, second half growth of the tree. An
        exception that it raises ends the search.
        """
        self._draw(samples, lambda f: progress(f / 2))
        x = self._q * self._space.weights
        edges = np.ptp(self._box, axis=1)[self._moving] * self._space.weights[self._moving]
        volume = max(self._good, 1) / max(self._tried, 1) * float(np.prod(edges))
        radius = _radius(len(x), int(self._moving.sum()), volume)
        near = cKDTree(x).query_ball_point(x, radius, return_sorted=True)
        rows = self._grow(x, [np.array(i) for i in near], lambda f: progress((1 + f) / 2))
        return None if rows is None else self._q[rows]

    def block(self, corners: Array) -> bool:
        """Exclude the connections along a path that are not free when tested whole; return whether there are any."""
        rows = [int(np.flatnonzero((self._q == c).all(axis=1))[0]) for c in corners]
        bad = [
            pair
            for pair, a, b in zip(pairwise(rows), corners, corners[1:], strict=False)
            if not self._space.free_between(a, b)
        ]
        for i, j in bad:
            self._known[i, j] = self._known[j, i] = False
        return bool(bad)

    def _draw(self, samples: int, progress: Progress) -> None:
        first = self._tried
        while self.count < samples and self._tried - first < _TRIES * samples:
            size = min(max(2 * (samples - self.count), 16), 256)
            block = self._rng.uniform(self._box[:, 0], self._box[:, 1], (size, len(self._box)))
            good = block[self._space.free(block)]
            self._tried, self._good = self._tried + size, self._good + len(good)
            self._q = np.concatenate([self._q, good[: samples - self.count]])
            progress(min(max(self.count / samples, (self._tried - first) / (_TRIES * samples)), 1.0))

    def _grow(self, x: Array, near: list[np.ndarray], progress: Progress) -> list[int] | None:
        """Grow the tree from sample 0; return the rows of the path to sample 1, None if the tree does not reach it."""
        waiting, front = np.ones(len(x), bool), np.zeros(len(x), bool)
        waiting[0], front[0] = False, True
        cost, parent = np.full(len(x), np.inf), np.full(len(x), -1)
        cost[0] = 0.0
        heap, z = [(0.0, 0)], 0
        while z != 1:
            to = near[z][waiting[near[z]]]
            best = np.zeros(len(to), int)
            costs = np.zeros(len(to))
            for k, i in enumerate(to):
                others = near[i][front[near[i]]]
                off = x[others] - x[i]
                through = cost[others] + np.sqrt(np.einsum("ki,ki->k", off, off))
                least = int(np.argmin(through))
                best[k], costs[k] = others[least], through[least]
            free = self._free(best, to)
            parent[to[free]], cost[to[free]] = best[free], costs[free]
            waiting[to[free]], front[to[free]] = False, True
            front[z] = False
            heapq.heappop(heap)
            for i in to[free]:
                heapq.heappush(heap, (float(cost[i]), int(i)))
            progress(1 - float(waiting.mean()))
            if not heap:
                return None
            z = heap[0][1]
        rows = [1]
        while rows[-1] != 0:
            rows.append(int(parent[rows[-1]]))
        return rows[::-1]

    def _free(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return (k,) bool: whether the connections of samples a (k,) and b (k,) are free; each is tested once."""
        pairs = list(zip(a.tolist(), b.tolist(), strict=True))
        new = [p for p in pairs if p not in self._known]
        if new:
            rows = np.array(new)
            self.checks += len(new)
            for pair, free in zip(new, self._space.free_each(self._q[rows[:, 0]], self._q[rows[:, 1]]), strict=True):
                self._known[pair] = self._known[pair[::-1]] = bool(free)
        return np.array([self._known[p] for p in pairs], bool)


def _radius(count: int, n: int, volume: float) -> float:
    """Return the neighbourhood radius of theorem 4.1 for `count` samples in n dimensions and the free `volume`."""
    ball = pi ** (n / 2) / gamma(n / 2 + 1)
    return _WIDER * 2 * (volume / (n * ball) * log(count) / count) ** (1 / n)
