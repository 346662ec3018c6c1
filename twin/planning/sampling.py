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
    end = steps * dt
    s_now, sd_now, _, area_now = _at(grid, rates, np.minimum(t, end))
    area_now = area_now + np.maximum(t - end, 0.0)  # after the end, s is 1
    s_before, sd_before, _, area_before = _at(grid, rates, np.maximum(t - width, 0.0))
    # mean of s over the window, and its derivatives
    s = np.clip((area_now - area_before) / width, 0.0, 1.0)
    sd = np.maximum((s_now - s_before) / width, 0.0)
    sdd = (sd_now - sd_before) / width
    # the ends without rounding
    s[0] = 0.0
    s[-1] = 1.0
    sd[[0, -1]] = 0.0
    sdd[[0, -1]] = 0.0
    return t, s, sd, sdd


def _at(grid: Array, rates: Array, t: Array) -> TimedSamples:
    """Return s, ds/dt, d2s/dt2, and the integral of s over time, at times t between start and end of the motion."""
    lengths = np.diff(grid)
    # between two grid points, d2s/dt2 is constant: 2 d2s/dt2 times the length is the change of (ds/dt)^2
    accelerations = np.diff(rates**2) / (2 * lengths)
    durations = 2 * lengths / (rates[1:] + rates[:-1])
    begins = np.concatenate([[0.0], np.cumsum(durations)])
    parts = _area(grid[:-1], rates[:-1], accelerations, durations)
    areas = np.cumsum(np.concatenate([[0.0], parts]))
    interval = np.searchsorted(begins, t, side="right") - 1
    interval = np.clip(interval, 0, len(accelerations) - 1)
    elapsed = t - begins[interval]
    sdd = accelerations[interval]
    sd = np.maximum(rates[interval] + sdd * elapsed, 0.0)
    s = np.clip(grid[interval] + rates[interval] * elapsed + 0.5 * sdd * elapsed**2, 0.0, 1.0)
    area = areas[interval] + _area(grid[interval], rates[interval], sdd, elapsed)
    return s, sd, sdd, area


def _area(s: Array, sd: Array, sdd: Array, x: Array) -> Array:
    """Return the integral of s over the first x seconds of an interval with constant d2s/dt2."""
    # s x + sd x^2 / 2 + sdd x^3 / 6
    return x * (s + x * (sd / 2 + x * sdd / 6))
