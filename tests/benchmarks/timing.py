"""Time-optimal rates along random splines: our two passes against toppra, in turns, from the same derivatives."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable

import numpy as np
from race import race
from scipy.interpolate import CubicSpline

from twin.trajectory import timing, topp

POINTS = (200, 1000, 5000)


def contenders(points: int, m: int = 6, paths: int = 3) -> dict[str, Callable[[], object]]:
    """Return what times `paths` splines of 10 waypoints and m coordinates on a grid of so many points, by name.

    Raises:
        AssertionError: their durations differ by more than 1e-4.
    """
    rng = np.random.default_rng(points)
    grid = np.linspace(0, 1, points)
    problems = []
    for _ in range(paths):
        path = CubicSpline(np.linspace(0, 1, 10), rng.normal(size=(10, m)))
        size = 0.02 * np.max(np.abs(path(grid, 2)))
        first, second = (np.ascontiguousarray(path(grid, order).T) / size for order in (1, 2))
        problems.append((grid, first, second, rng.uniform(0.5, 2, m)))
    for problem in problems:
        ours, theirs = (_duration(grid, solver(*problem)) for solver in (topp.fastest, timing.by_toppra))
        assert abs(ours / theirs - 1) < 1e-4, (ours, theirs)
    return {
        "two passes": lambda: [topp.fastest(*problem) for problem in problems],
        "toppra, seidel": lambda: [timing.by_toppra(*problem) for problem in problems],
    }


def _duration(grid: np.ndarray, rates: np.ndarray) -> float:
    return float(np.sum(2 * np.diff(grid) / (rates[1:] + rates[:-1])))


def main() -> None:
    """Race both at every number of grid points."""
    for m in (6, 8):
        for points in POINTS:
            race(f"time-optimal rate, {m} coordinates, {points} grid points", contenders(points, m), per=3)


if __name__ == "__main__":
    main()
