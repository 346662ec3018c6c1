"""FMT* (Fast Marching Tree): search for the shortest path between two points through random collision-free samples.

L. Janson, E. Schmerling, A. Clark, M. Pavone, "Fast Marching Tree: a fast marching sampling-based method for optimal
motion planning in many dimensions", Int. J. Robotics Research 34(7), 2015: algorithm 1, radius of theorem 4.1. A tree
grows outwards in the order of path length. Each sample is connected to the node of the tree's front through which its
path would be shortest without obstacles; only this connection is tested for collisions.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from math import gamma, log, pi

import numpy as np
from scipy.spatial import cKDTree

from twin.core.spatial import Array
from twin.planning.space import Space

_WIDER = 1.1
"""Ratio of the radius to the smallest radius for which the path length converges to the minimum."""

_TRIES = 20
"""Maximum number of samples drawn per required free sample."""


def search(
    space: Space,
    start: Array,
    goal: Array,
    box: Array,
    samples: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[Array | None, int]:
    """Return (corners (k, n) of the shortest path found, or None; number of free samples).

    Args:
        space: the joint space, which tests for collisions.
        start: (n,) joint values at the start, free of collisions.
        goal: (n,) joint values at the goal, free of collisions.
        box: (n, 2) lower and upper bounds of the samples.
        samples: number of free samples to draw.
        rng: random generator; the same seed gives the same path.
        progress: called with the fraction done: first half drawing of samples, second half growth of the tree.
    """
    drawn, share = _drawn(space, box, samples, rng, lambda f: progress(f / 2))
    q = np.concatenate([start[None], goal[None], drawn])
    x = q * space.weights
    radius = _radius(len(q), x.shape[1], share * float(np.prod(np.ptp(box, axis=1) * space.weights)))
    near = cKDTree(x).query_ball_point(x, radius)
    return _grown(space, q, x, near, lambda f: progress((1 + f) / 2)), len(drawn)


def _drawn(
    space: Space, box: Array, samples: int, rng: np.random.Generator, progress: Callable[[float], None]
) -> tuple[Array, float]:
    """Return (free samples (k, n), fraction of the drawn samples that is free)."""
    kept: list[Array] = []
    count = tried = 0
    while count < samples and tried < _TRIES * samples:
        block = rng.uniform(box[:, 0], box[:, 1], (16, len(box)))
        kept.append(block[space.free(block)])
        count, tried = count + len(kept[-1]), tried + len(block)
        progress(max(count / samples, tried / (_TRIES * samples)))
    return np.concatenate(kept)[:samples], max(count, 1) / tried


def _radius(count: int, n: int, volume: float) -> float:
    """Return the neighbourhood radius of theorem 4.1 for `count` samples in n dimensions and the free `volume`."""
    ball = pi ** (n / 2) / gamma(n / 2 + 1)
    return _WIDER * 2 * (volume / (n * ball) * log(count) / count) ** (1 / n)


def _grown(space: Space, q: Array, x: Array, near: list[list[int]], progress: Callable[[float], None]) -> Array | None:
    """Grow the tree from sample 0; return the corners of the path to sample 1, None if the tree does not reach it."""
    waiting, front = np.ones(len(q), bool), np.zeros(len(q), bool)
    waiting[0], front[0] = False, True
    cost, parent = np.full(len(q), np.inf), np.full(len(q), -1)
    cost[0] = 0.0
    heap, z = [(0.0, 0)], 0
    while z != 1:
        added = []
        for i in near[z]:
            if not waiting[i]:
                continue
            others = np.array([j for j in near[i] if front[j]])
            costs = cost[others] + np.linalg.norm(x[others] - x[i], axis=1)
            best = int(np.argmin(costs))
            if space.free_between(q[others[best]], q[i]):
                parent[i], cost[i] = others[best], costs[best]
                added.append(i)
        front[z] = False
        heapq.heappop(heap)
        for i in added:
            waiting[i], front[i] = False, True
            heapq.heappush(heap, (float(cost[i]), i))
        progress(1 - float(waiting.mean()))
        if not heap:
            return None
        z = heap[0][1]
    rows = [1]
    while rows[-1] != 0:
        rows.append(int(parent[rows[-1]]))
    return q[rows[::-1]]
