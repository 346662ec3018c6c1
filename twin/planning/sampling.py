"""Sample a path parameter over time from its rates at grid points, optionally as a moving average.

The moving average limits the jerk. It changes the timing but not the path: the mean of s over the last w seconds rises
from 0 to 1 like s, is at rest at both ends, and ends w seconds later. Its acceleration, (ds/dt(t) - ds/dt(t - w)) / w,
has no jumps, and its jerk is at most the range of d2s/dt2 divided by w. On a straight line with a part at constant
speed, this is the fastest motion with that jerk.
"""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array

TimedSamples = tuple[Array, Array, Array, Array]
"""(t, s, ds/dt, d2s/dt2), each (k,): time t in seconds, path parameter s and its derivatives."""


def sample(grid: Array, rates: Array, steps: int, dt: float, window: int = 0) -> TimedSamples:
    """Return the motion sampled at every dt.

    Args:
        grid: (n,) path parameter from 0 to 1; d2s/dt2 is constant between neighbouring points.
        rates: (n,) ds/dt at the grid points, 0 at both ends; the motion lasts `steps` * dt.
        steps: duration in samples.
        dt: sampling time in s.
        window: number of samples in the moving average; the motion lasts `window` samples longer.
    """
    t = np.arange(steps + window + 1, dtype=np.float64) * dt
    if not window:
        s, sd, sdd, _ = _at(grid, rates, t)
        s[-1] = 1.0  # without rounding
        sd[-1] = 0.0
        return t, s, sd, sdd
    width = window * dt
    last = steps * dt
    before = np.maximum(t - width, 0.0)
    s1, sd1, _, area1 = _at(grid, rates, np.minimum(t, last))
    s0, sd0, _, area0 = _at(grid, rates, before)
    area1 = area1 + np.maximum(t - last, 0.0)  # after the end, s is 1
    s = np.clip((area1 - area0) / width, 0.0, 1.0)
    sd = np.maximum((s1 - s0) / width, 0.0)
    sdd = (sd1 - sd0) / width
    # the ends without rounding
    s[[0, -1]] = (0.0, 1.0)
    sd[[0, -1]] = 0.0
    sdd[[0, -1]] = 0.0
    return t, s, sd, sdd


def _at(grid: Array, rates: Array, t: Array) -> TimedSamples:
    """Return s, ds/dt, d2s/dt2, and the integral of s over time, at times t between start and end of the motion."""
    sdd_of = np.diff(rates**2) / (2 * np.diff(grid))
    spans = 2 * np.diff(grid) / (rates[1:] + rates[:-1])
    ends = np.concatenate([[0.0], np.cumsum(spans)])
    parts = _area(grid[:-1], rates[:-1], sdd_of, spans)
    areas = np.cumsum(np.concatenate([[0.0], parts]))
    i = np.clip(np.searchsorted(ends, t, side="right") - 1, 0, len(sdd_of) - 1)
    x = t - ends[i]
    sdd = sdd_of[i]
    sd = np.maximum(rates[i] + sdd * x, 0.0)
    s = np.clip(grid[i] + rates[i] * x + 0.5 * sdd * x**2, 0.0, 1.0)
    return s, sd, sdd, areas[i] + _area(grid[i], rates[i], sdd, x)


def _area(s: Array, sd: Array, sdd: Array, x: Array) -> Array:
    """Return the integral of s over the first x seconds of an interval with constant d2s/dt2."""
    return x * (s + x * (sd / 2 + x * sdd / 6))
