"""From one place to another around what is in the way: straight if that is free, else searched, shortened, rounded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.errors import ProtocolError
from twin.core.spatial import Array
from twin.planning.fmt import search
from twin.planning.smooth import Smooth, fit, line
from twin.planning.space import Space

_ROUNDS = ((0.15, 60), (0.4, 200), (1.0, 600))
"""Searches in this order: how far beyond start and goal, in parts of the limits; how many samples."""

_SHORTCUTS = 60
"""Pairs of points of a way between which the straight path is tried."""

_WIDTHS = (0.1, 0.05, 0.025, 0.0125)
"""Standard deviations with which corners are rounded, in parts of the way, tried in this order."""


def around(
    space: Space,
    start: Array,
    goal: Array,
    *,
    seed: int = 0,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Smooth:
    """Return a smooth path from start (n,) to goal (n,) that is free all along; the same seed gives the same path.

    Args:
        space: what is free.
        start: joint values.
        goal: joint values.
        seed: of the samples.
        progress: called with the fraction of the present search.

    Raises:
        ProtocolError: an end is not free, or no way was found; the message says what was tried.
    """
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    for name, q in (("start", start), ("goal", goal)):
        if reason := space.why(q):
            raise ProtocolError(f"its {name} is not free: {reason}")
    straight = line(start, goal)
    if space.free_along(straight):
        return straight
    rng, drawn = np.random.default_rng(seed), 0
    tried = []
    for beyond, samples in _ROUNDS:
        wider = beyond * np.ptp(space.limits, axis=1)
        low, high = np.minimum(start, goal) - wider, np.maximum(start, goal) + wider
        box = np.column_stack([np.maximum(low, space.limits[:, 0]), np.minimum(high, space.limits[:, 1])])
        corners, count = search(space, start, goal, box, samples, rng, progress)
        drawn += count
        if corners is None:
            tried.append(f"{count} within {100 * beyond:.0f} % of the limits")
            continue
        for way in (shortened(space, corners, rng), corners):
            for width in _WIDTHS:
                curve = rounded(way, space.weights, width)
                if space.free_along(curve):
                    return curve
        tried.append(f"{count} within {100 * beyond:.0f} % of the limits (a way with corners that no curve can round)")
    raise ProtocolError(
        f"no way was found around what is in the way: the straight path is not free, nor is any through {drawn} free "
        f"places drawn at random, {', '.join(tried)} around start and goal. Lower clearance_mm, change seed, or go by "
        "a waypoint between them"
    )


def shortened(space: Space, corners: Array, rng: np.random.Generator) -> Array:
    """Return the corners (k, n) of a way with straight parts instead of detours, where these are free."""
    points = list(corners)
    for _ in range(_SHORTCUTS):
        if len(points) < 3:
            break
        along = _along(np.array(points) * space.weights)
        s0, s1 = np.sort(rng.uniform(0.0, along[-1], 2))
        i, j = (int(np.searchsorted(along, s, side="right")) - 1 for s in (s0, s1))
        if i == j:
            continue
        a, b = (np.array([np.interp(s, along, column) for column in np.array(points).T]) for s in (s0, s1))
        # all three: a loop that is closed another way at a or b is another assembly
        if space.free_between(a, b) and space.free_between(points[i], a) and space.free_between(b, points[j + 1]):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
    return np.array(points)


def rounded(corners: Array, weights: Array, width: float) -> Smooth:
    """Return a way with these corners (k, n), by its length, averaged over a Gaussian of this standard deviation.

    Averaged is the way prolonged by its mirror images at both ends, so that it begins and ends where the way does.
    A straight part stays, and each change of direction d at s0 adds d (w phi(x) + (s - s0) Phi(x)), x = (s - s0)/w.
    """
    from scipy.special import ndtr

    along = _along(corners * weights)
    at, parts = along / along[-1], np.diff(along)
    slopes = np.diff(corners, axis=0)[parts > 0] / (parts[parts > 0] / along[-1])[:, None]
    at = at[1:][parts > 0][:-1]
    turns, places = np.diff(slopes, axis=0), np.concatenate([-at, at, 2 - at])
    changes = np.concatenate([-turns, turns, -turns])

    def averaged(s: Array) -> Array:
        x = (s[:, None] - places) / width
        bends = width * (np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi) + x * ndtr(x))
        return bends @ changes

    # what is left is the straight line between the ends
    series = fit(averaged)
    c = series.coefficients.copy()
    low, high = c.T @ (-1.0) ** np.arange(len(c)), c.sum(axis=0)
    c[0] += (corners[0] - low + corners[-1] - high) / 2
    c[1] += (corners[-1] - high - corners[0] + low) / 2
    return Smooth(c, series.tail)


def _along(points: Array) -> Array:
    """Return the length (k,) of a way of corners (k, n) until each."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
