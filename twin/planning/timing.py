"""Compute the time-optimal timing of a path within limits.

Solvers have absolute tolerances, with which moves of micrometres would fail or lose accuracy. Every problem is
therefore made dimensionless first: time is divided by the shortest possible duration, each coordinate by its
acceleration limit. A move of 1 um is then the same problem as a move of 1 m. Either of two solvers can be chosen: our
own passes (`topp`), or the package toppra (`toppra_solver`). Between grid points the limits may
still be exceeded a little. Each result is therefore checked within every grid interval, the grid is refined, and the
remaining excess is removed by slowing down the whole motion slightly.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TimingError
from twin.core.spatial import Array
from twin.planning import topp, toppra_solver
from twin.planning.path import Path
from twin.planning.protocol.model import Solver
from twin.planning.sampling import TimedSamples, sample

Derivatives = Callable[[Array], tuple[Array, Array]]
"""Function: s (k,) -> first and second derivatives (k, m) of m coordinates with respect to s."""

Load = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Function: s, ds/dt, d2s/dt2, each (k,) -> largest speed and acceleration (k,), each divided by its limit."""

Jerk = Callable[[Array, Array, Array], float]
"""Function: s, ds/dt, d2s/dt2, each (k,), sampled at every dt -> largest jerk divided by its limit."""

ACCEPTED_EXCESS = 1e-3
"""Fraction by which a sample may exceed a limit; a larger excess is an error."""

_STEP_ROUNDING = 1e-9
"""Part of a time step by which a duration may be longer than a whole number of them."""

_REFINED_ABOVE = 1.01
"""Acceleration divided by its limit, above which a finer grid is tried before the motion is slowed down."""

_MOST_SLOWDOWNS = 20
"""Maximum number of attempts to slow down; one attempt is sufficient for a path without kinks."""

_LARGEST_SLOWDOWN = 1e3
"""Maximum slowdown factor in the search for a motion within the jerk limit."""

_LARGEST_WINDOW_GROWTH = 64
"""Maximum factor from one averaging window to the next in the search for a sufficient window."""

_LEAST_SLOWDOWN = 1.02
"""Minimum factor by which a motion is slowed down that no window brings within the jerk limit."""


@dataclass(frozen=True)
class Timing:
    """Path parameter as a function of time.

    Attributes:
        t: (k,) times in s, multiples of dt from 0.
        s, sd, sdd: (k,) path parameter and its first and second time derivative.
        duration: duration in s, a multiple of dt.
        optimal: duration in s of the optimal solution, before slowing down and rounding up.
        overshoot: largest relative excess of the optimal solution over a speed or acceleration limit; negative if none.
        knots: number of grid points, evenly spaced; 0 if no solver was used.
        solver: the solver: "passes" (our own) or "toppra" (the package); None if the timing was given.
        smoothing: length in s of the averaging window that keeps the jerk limit, a part of the duration.
        for_jerk: factor by which the motion was also slowed down, because no window alone kept the jerk limit.
        grid: grid points of the path parameter, between which d2s/dt2 is constant; None if the timing was given.
        rates: ds/dt at the grid points, before the averaging; None if the timing was given.
    """

    t: Array
    s: Array
    sd: Array
    sdd: Array
    duration: float
    optimal: float
    overshoot: float
    knots: int
    solver: Solver | None
    smoothing: float = 0.0
    for_jerk: float = 1.0
    grid: Array | None = None
    rates: Array | None = None


_POINTS_PER_INTERVAL = 5
"""Number of points per grid interval, both ends included, at which speed and acceleration are computed."""

_NO_LIMIT_FACTOR = 1e3
"""A missing limit is replaced by this factor times a typical value, so that the limit is never reached."""


def time_path(
    path: Path,
    max_speed: Array,
    max_acceleration: Array,
    *,
    extra: Derivatives | None = None,
    dt: float = 1e-3,
    load: Load | None = None,
    jerk: Jerk | None = None,
    knots: int = 241,
    finest: int = 961,
    solver: Solver = "passes",
) -> Timing:
    """Return the fastest timing of a path from s = 0 to s = 1, from rest to rest.

    Args:
        path: path of n coordinates; only its derivatives are used.
        max_speed: (m,) speed limits in units of the coordinates per s: those of the path, then those of `extra`.
        max_acceleration: (m,) acceleration limits in units of the coordinates per s2, in the same order.
        extra: derivatives of m - n further limited coordinates (for example, the arc length of the tip).
        dt: sampling time in s; the duration is rounded up to a multiple of dt.
        load: function that checks samples. It must check the limits of the m coordinates, and may check further limits,
            such as limits of vector norms. None: only the limits of the m coordinates are checked.
        jerk: function that returns the relative jerk; the motion is then averaged over the shortest sufficient time
            window. None: the jerk is not limited.
        knots: initial number of grid points.
        finest: maximum number of grid points.
        solver: what solves the problem on the grid: "passes" (`topp`) or "toppra" (the package).

    Raises:
        TimingError: no timing was found, or slowing down does not satisfy the limits.
    """
    if not (np.all(np.asarray(max_speed) > 0) and np.all(np.asarray(max_acceleration) > 0)):
        raise TimingError("every speed and acceleration limit must be positive")

    def derivatives(s: Array) -> tuple[Array, Array]:
        first = path(s, 1)
        second = path(s, 2)
        if extra is None:
            return first, second
        extra_first, extra_second = extra(s)
        return np.column_stack([first, extra_first]), np.column_stack([second, extra_second])

    check_load = load or _plain_load(derivatives, max_speed, max_acceleration)

    def rates_on(grid: Array) -> Array:
        first, second = derivatives(grid)
        return _rates(grid, first, second, max_speed, max_acceleration, solver)

    grid, rates, speed, acceleration = _refined(rates_on, check_load, knots, finest)
    durations = 2 * np.diff(grid) / (rates[1:] + rates[:-1])
    optimal = float(np.sum(durations))
    # a motion slowed down by c has speeds c times, and accelerations c² times smaller
    slowdown = max(1.0, speed, np.sqrt(acceleration))
    optimal_motion = _OptimalMotion(grid, rates, optimal, dt, check_load, jerk)
    window = 0
    final_slowdown = slowdown
    samples, excess = optimal_motion.samples(window, slowdown)
    if excess > 1:
        samples, window, final_slowdown = _averaged(optimal_motion, slowdown)
    t, s, sd, sdd = samples
    duration = float(t[-1])
    smoothing = window * dt
    return Timing(
        t=t,
        s=s,
        sd=sd,
        sdd=sdd,
        duration=duration,
        optimal=optimal,
        overshoot=max(speed, acceleration) - 1,
        knots=len(grid),
        solver=solver,
        smoothing=smoothing,
        for_jerk=final_slowdown / slowdown,
        grid=grid,
        rates=rates * (optimal / (duration - smoothing)),  # as `_OptimalMotion.samples` stretched them
    )


@dataclass(frozen=True)
class _OptimalMotion:
    """The optimal motion, to be slowed down: `rates` are its ds/dt on `grid`, `optimal` is its duration in s."""

    grid: Array
    rates: Array
    optimal: float
    dt: float
    load: Load
    jerk: Jerk | None

    def samples(self, window: int, slowdown: float) -> tuple[TimedSamples, float]:
        """Return (samples of the motion, their jerk divided by its limit).

        The motion is `slowdown` times as long, or more, until speed and acceleration are within their limits; then it
        is averaged over a window of samples.

        Raises:
            TimingError: the limits are exceeded even after `_MOST_SLOWDOWNS` attempts.
        """
        steps = 1
        worst = np.inf
        for _ in range(_MOST_SLOWDOWNS):
            # At least one step more: with few steps, rounding up the duration could undo the slowdown.
            needed = int(np.ceil(self.optimal * slowdown / self.dt - _STEP_ROUNDING))
            steps = max(steps + 1, needed)
            stretched = self.rates * (self.optimal / (steps * self.dt))
            samples = sample(self.grid, stretched, steps, self.dt, window)
            _, s, sd, sdd = samples
            speeds, accelerations = self.load(s, sd, sdd)
            largest_speed = float(np.max(speeds))
            largest_acceleration = float(np.max(accelerations))
            worst = max(largest_speed, largest_acceleration)
            if worst <= 1.0 + ACCEPTED_EXCESS:
                relative_jerk = 0.0
                if self.jerk:
                    relative_jerk = self.jerk(s, sd, sdd)
                return samples, relative_jerk
            # the curvature of the path is so large that the grid missed its worst point
            slowdown *= max(largest_speed, np.sqrt(largest_acceleration))
        raise TimingError(f"a sample exceeds its limit by {100 * (worst - 1):.2g} % even after slowing down")


def _refined(
    rates_on: Callable[[Array], Array], load: Load, knots: int, finest: int
) -> tuple[Array, Array, float, float]:
    """Return (grid, ds/dt on it, largest speed and acceleration, each divided by its limit) of the optimal motion.

    The grid, at first of `knots` points, is refined up to `finest` points until the acceleration between its points is
    within `_REFINED_ABOVE`.
    """
    while True:
        grid = np.linspace(0.0, 1.0, knots)
        rates = rates_on(grid)
        speed, acceleration = _peaks(grid, rates, load)
        if acceleration <= _REFINED_ABOVE or 2 * knots - 1 > finest:
            return grid, rates, speed, acceleration
        # every second point is one of the grid before
        knots = 2 * knots - 1


def _averaged(optimal_motion: _OptimalMotion, slowdown: float) -> tuple[TimedSamples, int, float]:
    """Return samples averaged over the shortest window within the jerk limit, the window in samples, and the slowdown.

    If no window suffices, the motion is slowed down further; the returned slowdown includes the factor for this.
    """
    steps = optimal_motion.optimal / optimal_motion.dt
    least = np.inf
    while slowdown < _LARGEST_SLOWDOWN:
        low = 0
        high = 1
        least = np.inf
        longest = int(2 * slowdown * steps)
        while low < longest:
            samples, excess = optimal_motion.samples(high, slowdown)
            if excess <= 1:
                samples, window = _shortest(optimal_motion, slowdown, low, (high, samples, excess))
                return samples, window, slowdown
            # The jerk is roughly inversely proportional to the window.
            further = max(2 * high, int(high * min(excess, _LARGEST_WINDOW_GROWTH)))
            low = high
            high = min(further, longest)
            least = min(least, excess)
        # a motion slowed down by c has jerks c³ times smaller
        slowdown *= max(float(np.cbrt(least)), _LEAST_SLOWDOWN)
    raise TimingError(f"the jerk is at least {least:.3g} times its limit, even for a very slow motion")


def _shortest(
    optimal_motion: _OptimalMotion, slowdown: float, low: int, sufficient: tuple[int, TimedSamples, float]
) -> tuple[TimedSamples, int]:
    """Return the samples of the shortest sufficient window, and this window; it is accurate to 2 % or one sample.

    Args:
        optimal_motion: the motion.
        slowdown: factor by which the motion is slowed down.
        low: window that is not sufficient.
        sufficient: (sufficient window, its samples, their jerk divided by the limit).
    """
    high, samples, excess = sufficient
    # Try in turn: just below and just above the window at which the jerk, if it is inversely proportional to the
    # window, is at its limit; then the middle.
    factors = itertools.cycle((0.99, 1.01, None))
    while high - low > max(1, high // 50):
        factor = next(factors)
        if factor is None:
            window = (low + high) // 2
        else:
            window = round(factor * high * excess)
        if low < window < high:
            averaged, relative_jerk = optimal_motion.samples(window, slowdown)
            if relative_jerk > 1:
                low = window
            else:
                high = window
                samples = averaged
                excess = relative_jerk
    return samples, high


def _plain_load(derivatives: Derivatives, max_speed: Array, max_acceleration: Array) -> Load:
    """Return a function that checks the limits of the coordinates, each by itself."""

    def load(s: Array, sd: Array, sdd: Array) -> tuple[Array, Array]:
        first, second = derivatives(s)
        v = np.abs(first * sd[:, None]) / max_speed
        a = np.abs(first * sdd[:, None] + second * sd[:, None] ** 2) / max_acceleration
        return np.max(v, axis=1), np.max(a, axis=1)

    return load


def _peaks(grid: Array, rates: Array, load: Load) -> tuple[float, float]:
    """Return the largest speed and acceleration, each divided by its limit; points between grid points are included."""
    fraction = np.linspace(0.0, 1.0, _POINTS_PER_INTERVAL)  # both ends: the path acceleration jumps at grid points
    lengths = np.diff(grid)
    s = (grid[:-1, None] + lengths[:, None] * fraction).ravel()
    # at constant d2s/dt2, (ds/dt)^2 is linear in s
    squares = rates**2
    sd = np.sqrt(squares[:-1, None] * (1 - fraction) + squares[1:, None] * fraction).ravel()
    sdd = np.repeat(np.diff(squares) / (2 * lengths), _POINTS_PER_INTERVAL)
    speed, acceleration = load(s, sd, sdd)
    return float(np.max(speed)), float(np.max(acceleration))


def _rates(grid: Array, first: Array, second: Array, speed: Array, acceleration: Array, solver: Solver) -> Array:
    """Return ds/dt (k,) at the grid points.

    Raises:
        TimingError: the solver found no timing.
    """
    if not (np.all(np.isfinite(first)) and np.all(np.isfinite(second))):
        raise TimingError("the path has no finite derivatives")
    length = np.mean(np.abs(first), axis=0)
    moves = length > 0
    # a length L from rest to rest takes at least 2 sqrt(L / a): its mean speed is at most sqrt(L a) / 2 < sqrt(L a)
    top = np.minimum(speed, np.sqrt(np.where(moves, length, 1.0) * acceleration))
    unit = float(np.max(length[moves] / top[moves], initial=0.0))  # s; lower bound of the duration
    if not unit > 0:
        raise TimingError("the path has no length")
    # Replace a missing limit by a value that is never reached.
    peak = np.max(np.abs(first), axis=0)
    speed = np.where(np.isfinite(speed), speed, _NO_LIMIT_FACTOR * np.where(peak > 0, peak, 1.0) / unit)
    acceleration = np.where(np.isfinite(acceleration), acceleration, _NO_LIMIT_FACTOR * speed / unit)
    size = (acceleration * unit**2)[:, None]
    first = np.ascontiguousarray(first.T) / size
    second = np.ascontiguousarray(second.T) / size
    fastest = topp.fastest
    if solver == "toppra":
        fastest = toppra_solver.fastest
    try:
        rates = fastest(grid, first, second, speed * unit / size[:, 0])
    except TimingError as error:
        raise TimingError(f"{_NOT_FOUND[solver]}: {error}") from error
    if not np.all(rates[1:] + rates[:-1] > 0):
        raise TimingError(f"{_NOT_FOUND[solver]}: the speed is zero between start and end of the path")
    return rates / unit


_NOT_FOUND: dict[Solver, str] = {
    "passes": "our own solver found no timing within the limits (try --timing toppra)",
    "toppra": "toppra found no timing within the limits (try --timing passes)",
}
"""Beginning of the message if a solver finds no timing."""
