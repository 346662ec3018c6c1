"""Several arms at once, by priority: each further arm moves while the earlier arms follow their common path.

M. Erdmann, T. Lozano-Perez, "On multiple moving objects", Algorithmica 2, 1987: the arms are planned one after the
other, and time is a coordinate of each search after the first. Here, u replaces time: the fraction (0 to 1) of
their path that the earlier arms have covered. u must not decrease: the earlier arms may wait for the new arm, but they
neither leave their path nor go back. The result is one path of all arms. Bodies of all arms are tested along this whole
path, so that the path is free of collisions with any timing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from twin.core.progress import StepProgress, silent_step
from twin.core.spatial import Array
from twin.core.units import MM, ROUNDING
from twin.model.mechanism import Mechanism
from twin.planning.costs import Cost, length
from twin.planning.fmt import SearchTree
from twin.planning.obstacle_avoidance import around
from twin.planning.path import Path, line
from twin.planning.rounds import SearchRound
from twin.planning.space import PathCertificate, Space

_LEAST_PROGRESS_WEIGHT = 0.05
"""Minimum weight in m of the coordinate u; if the path of the earlier arms is longer, its length is the weight."""

_PARTS_OF_CONNECTION = 8
"""Number of straight parts that replace a connection in a search, if the path of the earlier arms is not straight."""

_SAMPLES = 513
"""Number of points at which a path is evaluated for its length and for its direction."""

_CURVATURE_SAMPLES = 9
"""Number of points at which the curvature of the path of the earlier arms is evaluated."""

_RATE_ROUNDING = 1e-9
"""Rounding by which u may grow faster than by 1 per unit of a path's parameter without a further part."""

_STRAIGHT_CURVATURE = 1e-9
"""Second derivative of a path (in m or rad) up to which it counts as straight."""


class CommonPath:
    """Path q(s) of all arms: the path `first` of the earlier arms at u(s), then the joint values of the new arm.

    `path` returns the joint values of the new arm, then u.
    """

    def __init__(self, first: Path, path: Path) -> None:
        self._first = first
        self._path = path

    def __call__(self, s: Array, order: int = 0) -> Array:
        """Return q (k, n) at s (k,), or its derivative of order 1 or 2."""
        s = np.asarray(s, float)
        z = self._path(s)
        progress = np.clip(z[:, -1], 0.0, 1.0)
        if order == 0:
            return np.column_stack([self._first(progress), z[:, :-1]])
        z1 = self._path(s, 1)
        u1 = z1[:, -1:]
        if order == 1:
            return np.column_stack([self._first(progress, 1) * u1, z1[:, :-1]])
        z2 = self._path(s, 2)
        u2 = z2[:, -1:]
        # chain rule of first(u(s))
        earlier = self._first(progress, 2) * u1**2 + self._first(progress, 1) * u2
        return np.column_stack([earlier, z2[:, :-1]])


class _PathPart:
    """The part of a path from s = `begin` to s = `end`, with a parameter from 0 to 1."""

    def __init__(self, path: Path, begin: float, end: float) -> None:
        self._path = path
        self._begin = begin
        self._end = end

    def at(self, s: float) -> float:
        """Return the parameter of the whole path at the parameter s of the part."""
        return self._begin + (self._end - self._begin) * s

    def __call__(self, s: Array, order: int = 0) -> Array:
        width = self._end - self._begin
        # chain rule: each derivative with respect to the part's parameter has a factor `width`
        return self._path(self._begin + width * np.asarray(s, float), order) * width**order


class NewArmSpace(Space):
    """Space of a new arm: its joint values, then u, the covered fraction of the path of the earlier arms."""

    def __init__(self, all_arms: Space, first: Path) -> None:
        """Define the space.

        Args:
            all_arms: the space of all arms: the earlier arms, then the new arm.
            first: path of the earlier arms.
        """
        self.all_arms = all_arms
        self.first = first
        samples = first(np.linspace(0.0, 1.0, _SAMPLES))
        self._before = samples.shape[1]  # number of joints of the earlier arms
        steps = np.diff(samples, axis=0) * all_arms.weights[: self._before]
        path_length = float(np.linalg.norm(steps, axis=1).sum())
        self._length = max(path_length, _LEAST_PROGRESS_WEIGHT)
        curvature = np.abs(first(np.linspace(0.0, 1.0, _CURVATURE_SAMPLES), 2))
        self._straight = bool(curvature.max(initial=0.0) < _STRAIGHT_CURVATURE)

    def interruptible(self, check: Callable[[], None]) -> NewArmSpace:
        """Return this space with tests that call `check` every few milliseconds; errors in `check` end the test."""
        return NewArmSpace(self.all_arms.interruptible(check), self.first)

    @property
    def limits(self) -> Array:
        """Limits (n + 1, 2): of the new arm's joints in m or rad, and 0 to 1."""
        return np.concatenate([self.all_arms.limits[self._before :], [[0.0, 1.0]]])

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism of all arms."""
        return self.all_arms.mechanism

    @property
    def weights(self) -> Array:
        """Lengths (n + 1,) in m equivalent to one unit of each coordinate."""
        return np.append(self.all_arms.weights[self._before :], self._length)

    @property
    def leads(self) -> np.ndarray:
        """(n + 1,) bool: whether each coordinate can move the tool of the new arm; for u, always True."""
        return np.append(self.all_arms.leads[self._before :], True)

    @property
    def cost(self) -> Cost:
        """The length of a connection; infinite if the earlier arms would move backwards."""
        length_of = length(self.weights)
        return lambda a, b: np.where(b[:, -1] >= a[:, -1], length_of(a, b), np.inf)

    def joints_of_all_arms(self, z: Array) -> Array:
        """Return the joint values (k, all) of all arms at z (k, n + 1)."""
        return np.column_stack([self.first(np.clip(z[:, -1], 0.0, 1.0)), z[:, :-1]])

    def free(self, q: Array, *, exact: bool = True) -> np.ndarray:
        """Return (k,) bool: whether all arms are free of collisions at q (k, n + 1)."""
        return self.all_arms.free(self.joints_of_all_arms(np.asarray(q, float)), exact=exact)

    def clearances(self, q: Array, most: float) -> Array:
        """Return lower bounds (k,) in m of the minimum distance between bodies at q (k, n + 1), each at most `most`."""
        return self.all_arms.clearances(self.joints_of_all_arms(np.asarray(q, float)), most)

    def steer(self, a: Array, b: Array) -> Path:
        """Return the straight path from a (n + 1,) to b (n + 1,)."""
        return line(a, b)

    def free_each(self, a: Array, b: Array) -> np.ndarray:
        """Return (m,) bool: whether the straight paths from a to b (m, n + 1), with free ends, seem free."""
        count = _PARTS_OF_CONNECTION
        if self._straight:
            count = 1
        corners = []
        for fraction in np.linspace(0.0, 1.0, count + 1):
            corners.append(self.joints_of_all_arms(a + fraction * (b - a)))
        free = b[:, -1] >= a[:, -1] - ROUNDING
        for start, end in pairwise(corners):
            # only connections whose parts before are free are tested further
            free[free] = self.all_arms.free_each(start[free], end[free])
        return free

    def free_between(self, a: Array, b: Array) -> bool:
        """Return whether the straight path from a (n + 1,) to b (n + 1,) is free of collisions."""
        return self.free_along(self.steer(a, b))

    def free_along(self, path: Path) -> bool:
        """Return whether no collision occurs on a path, and the earlier arms never move backwards."""
        u = path(np.linspace(0.0, 1.0, _SAMPLES))[:, -1]
        if np.diff(u).min() < -ROUNDING:
            return False
        return all(self.all_arms.free_along(part) for part in self._parts(path))

    def certify(self, path: Path, within: float = 0.5 * MM) -> PathCertificate:
        """Return a certificate of a free path: a proven lower bound of the distance between bodies of all arms.

        `within` is the accepted difference in m between the smallest distance found and the bound.
        """
        nearest_part, *further_parts = self._parts(path)
        nearest = self.all_arms.certify(nearest_part, within)
        proven = nearest.proven
        for part in further_parts:
            certificate = self.all_arms.certify(part, within)
            proven = min(proven, certificate.proven)
            if certificate.found < nearest.found:
                nearest = certificate
                nearest_part = part
        return replace(nearest, proven=proven, s=nearest_part.at(nearest.s))  # pyright: ignore

    def _parts(self, path: Path) -> list[_PathPart]:
        """Divide the path of all arms into parts in which u grows by at most 1 per unit of the part's parameter.

        The tests of paths assume that speeds change little within 1/512 of a path, as they do on the path `first`.
        """
        derivatives = path(np.linspace(0.0, 1.0, _SAMPLES), 1)
        fastest = np.abs(derivatives[:, -1]).max()
        count = max(int(np.ceil(fastest - _RATE_ROUNDING)), 1)
        borders = np.linspace(0.0, 1.0, count + 1).tolist()
        common_path = CommonPath(self.first, path)
        parts = []
        for begin, end in pairwise(borders):
            parts.append(_PathPart(common_path, begin, end))
        return parts

    def why(self, q: Array) -> str:
        """Return why q (n + 1,) is not free, with values and limits; "" if it is free."""
        return self.all_arms.why(self._joints_of_all_arms_at(q))

    def too_small_distance(self, q: Array) -> float | None:
        """Return the distance in m of the two bodies that lack most of the required clearance at q (n + 1,); or None.

        See `Space.too_small_distance`.
        """
        return self.all_arms.too_small_distance(self._joints_of_all_arms_at(q))

    def named(self, q: Array) -> str:
        """Return the joint values of all arms at q (n + 1,) as text."""
        return self.all_arms.named(self._joints_of_all_arms_at(q))

    def _joints_of_all_arms_at(self, q: Array) -> Array:
        """Return `joints_of_all_arms` of one q (n + 1,)."""
        (joint_values,) = self.joints_of_all_arms(np.asarray(q, float)[None])
        return joint_values


def beside(
    all_arms: Space,
    first: Path,
    start: Array,
    goal: Array,
    *,
    seed: int = 0,
    progress: StepProgress = silent_step,
    cancelled: Callable[[], bool] | None = None,
    ended: Callable[[SearchRound, SearchTree], None] = lambda round, tree: None,
) -> CommonPath:
    """Return a common path of all arms: a new arm moves from start to goal while the earlier arms follow `first`.

    Args:
        all_arms: the space of all arms: the arms of `first`, then the new arm.
        first: path of the earlier arms; it begins and ends together with the path of the new arm.
        start: (n,) joint values of the new arm at the start.
        goal: (n,) joint values of the new arm at the goal.
        seed: seed of the random samples.
        progress: called with the fraction done of the current search.
        cancelled: as in `around`.
        ended: as in `around`.

    Raises:
        CancelledError: `cancelled` returned True.
        ProtocolError: start or goal collides with any arm or obstacle, or no path was found.
    """
    space = NewArmSpace(all_arms, first)
    path = around(
        space,
        np.append(start, 0.0),
        np.append(goal, 1.0),
        seed=seed,
        progress=progress,
        cancelled=cancelled,
        cost=space.cost,
        ended=ended,
    )
    return CommonPath(first, path)
