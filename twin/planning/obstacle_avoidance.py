"""Plan a path around obstacles: the straight path if it is free; otherwise a search, then shortcuts and rounding."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import CancelledError, ProtocolError
from twin.core.progress import StepProgress, silent_step
from twin.core.spatial import Array
from twin.planning.costs import Cost, length, total
from twin.planning.fmt import FmtSearch, SearchTree
from twin.planning.path import ChebyshevPath, fit, line
from twin.planning.rounds import SearchRound
from twin.planning.space import Space, nearest_free

_SEARCHES = ((0.15, 60), (0.4, 200), (1.0, 600))
"""Searches, in order: (extension of the box beyond start and goal, divided by the joint ranges; number of samples)."""

_SHORTCUT_ROUNDS = 8
"""Number of rounds of shortcuts."""

_SHORTCUTS_PER_ROUND = 12
"""Number of shortcuts (between pairs of points) that are tried in each round."""

_IMPROVING_PASSES = 5
"""Number of passes of `_SHORTCUT_ROUNDS` rounds each when a path is improved."""

_ENCLOSED_SHARE = 0.1
"""An end (start or goal) seems to be enclosed if it is connected with less than this fraction of the samples."""

_ROUNDING_WIDTHS = (0.1, 0.05, 0.025, 0.0125)
"""Standard deviations of the Gaussian that rounds corners, divided by the path length; the largest first."""


class NoPathError(ProtocolError):
    """No path was found; the message contains the reason, and a suggestion for the protocol.

    Attributes:
        reason: the reason without the suggestion, for callers without a protocol.
        at_start: whether the start collides or exceeds a limit, so that no goal can be reached from it.
    """

    def __init__(self, reason: str, advice: str = "", at_start: bool = False) -> None:
        super().__init__(f"{reason}{advice}")
        self.reason = reason
        self.at_start = at_start


def around(
    space: Space,
    start: Array,
    goal: Array,
    *,
    seed: int = 0,
    progress: StepProgress = silent_step,
    cancelled: Callable[[], bool] | None = None,
    cost: Cost | None = None,
    straight: bool = True,
    samples: int = 0,
    ended: Callable[[SearchRound, SearchTree], None] = lambda round, tree: None,
) -> ChebyshevPath:
    """Return a smooth collision-free path from start to goal; the same seed gives the same path.

    Args:
        space: the joint space, which tests whether joint values and paths are free of collisions.
        start: (n,) joint values at the start.
        goal: (n,) joint values at the goal.
        seed: seed of the random samples.
        progress: called with the fraction done of the current search.
        cancelled: function that is called every few milliseconds, in the same thread; the search ends when the function
            returns True. None: the search cannot be cancelled.
        cost: what the search minimises; None: the length of the path.
        straight: whether a free straight path is returned without a search; pass False if another path may cost less.
        samples: maximum number of samples in the improvement of the first path found; 0: no improvement.
        ended: called at the end of each round (a search or an improvement) with its `SearchRound` and its tree; not
            called if the straight path is returned without a search.

    Raises:
        CancelledError: `cancelled` returned True.
        ProtocolError: a joint value of start or goal is not finite.
        NoPathError: the start or the goal collides or exceeds a limit; or no path was found, and the message then
            lists the searches.
    """
    start = np.asarray(start, float)
    goal = np.asarray(goal, float)
    no_corners = np.array([start, goal])
    if cancelled is not None:
        space = space.interruptible(_ending(cancelled))
    _require_free(space, "start", start, seed)
    _require_free(space, "goal", goal, seed)
    direct = line(start, goal)
    if straight and space.free_along(direct):
        return direct
    record = _recorder(ended)
    rng = np.random.default_rng(seed)
    drawn_count = 0
    reached = (0, 0)
    attempts = []
    count = 0  # of the samples of the last search
    # A joint that neither must move nor moves the tool would only add a dimension to the search.
    resting = (start == goal) & ~space.leads
    for extension, required_samples in _SEARCHES:
        box = _box(space, start, goal, extension, resting)
        search = FmtSearch(space, start, goal, box, rng, cost)
        has_corners, path = searched(search, required_samples, rng, progress)
        if path is not None:
            if not straight and space.free_along(direct):
                path = _cheaper(search.cost, path, FreePath(no_corners, direct))
            record(search.tree, search.cost, path.corners)
            return improved(search, path, samples, rng, progress, informed=cost is None, record=record).curve
        record(search.tree, search.cost, None)
        count = search.count  # fewer than required if most of the box is blocked
        drawn_count += count
        attempt = f"{count} samples in a box that extends {100 * extension:.0f} %"
        if has_corners:
            attempts.append(f"{attempt} (a path was found, but its corners cannot be rounded)")
        else:
            attempts.append(f"{attempt} of the joint range beyond start and goal")
            reached = search.reached()
    raise NoPathError(
        "no path around the obstacles was found: the straight path is not free, and no path was found through "
        f"{drawn_count} free random configurations ({', '.join(attempts)}){_enclosed(reached, count)}",
        ". Lower clearance_mm, change seed, or add a waypoint between start and goal",
    )


def _require_free(space: Space, name: str, q: Array, seed: int) -> None:
    """Raise the errors of `around` if joint values q (n,) at one end of the path are not finite or not free."""
    if not np.all(np.isfinite(q)):
        raise ProtocolError(f"at the {name}, joint values are not finite: {q.tolist()}")
    reason = space.why(q)
    if not reason:
        return
    message = f"at the {name}, {reason}"
    nearest = nearest_free(space, q, seed)
    if nearest is not None:
        message += f"; the nearest free configuration found is {space.named(nearest)}"
    advice = ""
    distance = space.too_small_distance(q)
    if distance is not None:
        advice = ". Move this waypoint"
        if distance > 0:  # bodies that collide have no distance: a lower clearance would not help
            advice += ", or lower clearance_mm"
    raise NoPathError(message, advice, name == "start")


def _box(space: Space, start: Array, goal: Array, extension: float, resting: np.ndarray) -> Array:
    """Return the bounds (n, 2) of samples: start and goal, extended by a fraction of the joint ranges.

    Joints in the mask `resting` (n,) keep their values at the start.
    """
    margin = extension * np.ptp(space.limits, axis=1)
    low = np.maximum(np.minimum(start, goal) - margin, space.limits[:, 0])
    high = np.minimum(np.maximum(start, goal) + margin, space.limits[:, 1])
    box = np.column_stack([low, high])
    box[resting] = start[resting, None]
    return box


def _cheaper(cost: Cost, path: FreePath, other_path: FreePath) -> FreePath:
    """Return the path with the smaller cost along its corners; `path` if both cost the same."""
    if total(cost, other_path.corners) < total(cost, path.corners):
        return other_path
    return path


def _ending(cancelled: Callable[[], bool]) -> Callable[[], None]:
    """Return a function that raises `CancelledError` if `cancelled` returns True."""

    def check() -> None:
        if cancelled():
            raise CancelledError("the search for a path around obstacles was cancelled")

    return check


def _recorder(
    ended: Callable[[SearchRound, SearchTree], None],
) -> Callable[[SearchTree, Cost, Array | None], None]:
    """Return a function of (tree, cost, corners (k, n) of the best path) that calls `ended` as `around` says.

    The times of all rounds are measured from this call.
    """
    processor = time.process_time()
    wall = time.perf_counter()

    def cost_of(corners: Array | None, cost: Cost) -> float:
        if corners is None:
            return np.inf
        return total(cost, corners)

    def record(tree: SearchTree, cost: Cost, best: Array | None) -> None:
        processor_s = time.process_time() - processor
        wall_s = time.perf_counter() - wall
        samples = len(tree.q) - 2  # start and goal are no samples
        ended(SearchRound(samples, cost_of(tree.corners, cost), cost_of(best, cost), processor_s, wall_s), tree)

    return record


@dataclass(frozen=True)
class FreePath:
    """A free path `curve` with rounded corners, and its `corners` (k, n), between which straight lines seem free."""

    corners: Array
    curve: ChebyshevPath


def searched(
    search: FmtSearch, samples: int, rng: np.random.Generator, progress: StepProgress = silent_step
) -> tuple[bool, FreePath | None]:
    """Return (whether a search found corners, the `FreePath` along these corners or None if they cannot be rounded).

    The smoothest path with all shortcuts is tested first, over its whole length, because it is often free. Only if this
    path is not free are the connections between the corners tested over their whole length. If some connections are
    not free, the search goes on without these connections; if all are free, less smooth paths and paths with fewer
    shortcuts are tried.
    """
    space = search.space
    corners = search.path(samples, progress)
    while corners is not None:
        stages = [corners, *shortcuts(space, corners, rng, search.cost)]
        smoothest = rounded(stages[-1], space.weights, _ROUNDING_WIDTHS[0])
        if space.free_along(smoothest):
            return True, FreePath(stages[-1], smoothest)
        if not search.block(corners):
            return True, _last_free(space, stages)
        corners = search.path(samples, progress)
    return False, None


def _last_free(space: Space, stages: Sequence[Array]) -> FreePath | None:
    """Return the `FreePath` along the last of `stages` whose rounded path is free; None if there is none.

    Each stage has the corners (k, n) of a path with one shortcut more than the stage before. A path with many shortcuts
    passes so near obstacles that its rounded corners are often not free. If the rounded path of the last stage is not
    free, an earlier stage is found by bisection.
    """

    def is_blocked(corners: Array) -> bool:
        return not space.free_along(rounded(corners, space.weights, _ROUNDING_WIDTHS[-1]))

    stage = len(stages) - 1
    if is_blocked(stages[stage]):
        stage = bisect_left(stages, True, hi=stage, key=is_blocked) - 1
    if stage < 0:
        return None
    # the narrowest rounding is free; widen it as long as the path stays free
    corners = stages[stage]
    curve = rounded(corners, space.weights, _ROUNDING_WIDTHS[-1])
    for width in reversed(_ROUNDING_WIDTHS[:-1]):
        wider = rounded(corners, space.weights, width)
        if not space.free_along(wider):
            break
        curve = wider
    return FreePath(corners, curve)


def improved(
    search: FmtSearch,
    path: FreePath,
    samples: int,
    rng: np.random.Generator,
    progress: StepProgress = silent_step,
    *,
    informed: bool,
    record: Callable[[SearchTree, Cost, Array], None] = lambda tree, cost, best: None,
) -> FreePath:
    """Continue a search in rounds, each with twice as many samples, up to `samples`; return the best path found.

    In each round, shortcuts are tried `_IMPROVING_PASSES` times as often as for a first path. With `informed`, samples
    that cannot make the path shorter are left out (`FmtSearch.inform`). `record` is called after each round with the
    tree, the cost, and the corners (k, n) of the best path.
    """
    count = search.count
    best = path
    while count < samples:
        count = min(2 * count, samples)
        if informed:
            search.inform(best.corners)
        _, candidate = searched(search, count, rng, progress)
        last_best = best
        if candidate is not None:
            best = _cheaper(search.cost, best, _with_further_shortcuts(search, candidate, rng))
        # the best path of the round before is polished too: its shortcuts are drawn at random
        best = _cheaper(search.cost, best, _with_further_shortcuts(search, last_best, rng))
        record(search.tree, search.cost, best.corners)
    return best


def _with_further_shortcuts(search: FmtSearch, path: FreePath, rng: np.random.Generator) -> FreePath:
    """Return a path with the shortcuts of `_IMPROVING_PASSES` more passes; its rounded path is free after each."""
    for _ in range(_IMPROVING_PASSES):
        stages = [path.corners, *shortcuts(search.space, path.corners, rng, search.cost, partial=True)]
        if len(stages) > 1:
            path = _last_free(search.space, stages) or path
    return path


def _enclosed(reached: tuple[int, int], count: int) -> str:
    """Return a text on each end (start, goal) that seems to be enclosed, or "".

    `reached` contains the numbers of samples connected with start and goal; the search has `count` samples.
    """
    parts = []
    for name, connected in zip(("start", "goal"), reached, strict=True):
        if count and connected < _ENCLOSED_SHARE * count:
            parts.append(
                f"the {name} seems to be enclosed, because only {connected} of {count} samples are connected with it"
            )
    if not parts:
        return ""
    return "; " + " and ".join(parts)


def shortcuts(
    space: Space, corners: Array, rng: np.random.Generator, cost: Cost | None = None, *, partial: bool = False
) -> Iterator[Array]:
    """Yield the corners (k, n) of a path with one free shortcut, then with two free shortcuts, and so on.

    In each round, shortcuts between random pairs of points on the path are tested together. The free shortcut that
    lowers the cost of the path most is applied; without `cost`, the cost is the length. Without `partial`, all
    shortcuts are straight. With `partial`, every second shortcut is straight in some joints only, which are drawn at
    random; the other joints move as before. Such shortcuts shorten paths along obstacles, where no straight shortcut is
    free (R. Geraerts, M. H. Overmars, "Creating high-quality paths for motion planning", Int. J. Robotics Research
    26(8), 2007).
    """
    points = np.asarray(corners)
    cost = cost or length(space.weights)
    is_straight = np.ones((_SHORTCUTS_PER_ROUND, points.shape[1]), bool)
    for _ in range(_SHORTCUT_ROUNDS):
        if len(points) < 3:
            break
        along = _along(points * space.weights)
        ends = np.sort(rng.uniform(0.0, along[-1], (_SHORTCUTS_PER_ROUND, 2)), axis=1)
        if partial:
            is_straight[::2] = rng.integers(0, 2, is_straight[::2].shape)
        # rows of the last corners before the start and before the end of each shortcut
        i = np.searchsorted(along, ends[:, 0], side="right") - 1
        j = np.searchsorted(along, ends[:, 1], side="right") - 1
        j = np.minimum(j, len(points) - 2)
        changing = np.flatnonzero(i < j)  # a shortcut between two points of one straight part changes nothing
        if not len(changing):
            continue
        i = i[changing]
        j = j[changing]
        parts = []
        starts_of_parts = []
        stops_of_parts = []
        first = []  # row of each part's first connection
        count = 0
        for k, shortcut in enumerate(changing):
            part = _shortcut(points, along, i[k], j[k], ends[shortcut], is_straight[shortcut])
            parts.append(part)
            starts_of_parts.append(part[:-1])
            stops_of_parts.append(part[1:])
            first.append(count)
            count += len(part) - 1
        starts = np.concatenate(starts_of_parts)
        stops = np.concatenate(stops_of_parts)
        # cost of the path up to each corner
        cost_so_far = np.concatenate([[0.0], np.cumsum(cost(points[:-1], points[1:]))])
        replaced = cost_so_far[j + 1] - cost_so_far[i]
        gain = replaced - np.add.reduceat(cost(starts, stops), first)
        # test all connections: at the ends of a straight part, the loops could be closed in another assembly mode
        free = np.logical_and.reduceat(space.free_each(starts, stops), first)
        gain[~free] = 0.0
        if gain.max(initial=0.0) <= 0.0:
            continue
        best = int(np.argmax(gain))
        points = np.concatenate([points[: i[best]], parts[best], points[j[best] + 2 :]])
        yield points


def _shortcut(points: Array, along: Array, i: int, j: int, ends: Array, is_straight: np.ndarray) -> Array:
    """Return the corners (m, n) of a path from corner i to corner j + 1 with a shortcut between two points.

    Args:
        points: (k, n) corners of the path.
        along: (k,) length of the path up to each corner.
        i: row of the last corner before the shortcut.
        j: row of the last corner before the end of the shortcut.
        ends: (2,) length of the path up to the start and the end of the shortcut.
        is_straight: (n,) bool: joints that move in a straight line; the others move as before.
    """
    begin, end = ends
    first = _point_at(points, along, begin)
    last = _point_at(points, along, end)
    if is_straight.all():
        return np.array([points[i], first, last, points[j + 1]])
    skipped = slice(i + 1, j + 1)
    share = (along[skipped, None] - begin) / (end - begin)
    between = np.where(is_straight, first + share * (last - first), points[skipped])
    return np.concatenate([[points[i], first], between, [last, points[j + 1]]])


def _point_at(points: Array, along: Array, length: float) -> Array:
    """Return the point (n,) of the path along points (k, n) at a length; `along` (k,) is the length at each point."""
    return np.array([np.interp(length, along, column) for column in points.T])


def rounded(corners: Array, weights: Array, width: float) -> ChebyshevPath:
    """Return a path with rounded corners: the path along the corners (k, n), convolved with a Gaussian.

    `width` is the standard deviation w of the Gaussian, divided by the length of the path; `weights` (n,) are in m per
    unit of each joint. The path is extended by its mirror images at both ends, so that start and end do not change.
    Straight parts remain straight. A change of direction d at s0 contributes d (w phi(x) + (s - s0) Phi(x)), where
    x = (s - s0) / w, and phi and Phi are density and distribution function of the standard normal distribution.
    """
    from scipy.special import ndtr

    along = _along(corners * weights)
    parts = np.diff(along)
    moves = parts > 0  # equal neighbouring corners have no direction
    s_parts = parts[moves] / along[-1]
    slopes = np.diff(corners, axis=0)[moves] / s_parts[:, None]
    s_ends = (along / along[-1])[1:][moves]
    inner = s_ends[:-1]  # s of the inner corners
    turns = np.diff(slopes, axis=0)
    # the mirror images of the inner corners at both ends turn back
    places = np.concatenate([-inner, inner, 2 - inner])
    changes = np.concatenate([-turns, turns, -turns])

    def averaged(s: Array) -> Array:
        x = (s[:, None] - places) / width
        bends = width * (np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi) + x * ndtr(x))
        return bends @ changes

    # add a straight line so that the path begins and ends exactly at the first and last corner
    series = fit(averaged)
    c = series.coefficients.copy()
    # at the ends, Chebyshev polynomial k is (-1)^k and 1
    low = c.T @ (-1.0) ** np.arange(len(c))
    high = c.sum(axis=0)
    c[0] += (corners[0] - low + corners[-1] - high) / 2
    c[1] += (corners[-1] - high - corners[0] + low) / 2
    return ChebyshevPath(c, series.tail)


def _along(points: Array) -> Array:
    """Return the length (k,) of the path along points (k, n), from the first point to each point."""
    parts = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(parts)])
