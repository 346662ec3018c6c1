"""Interface of the space in which a path is searched, and its free configuration nearest to one in collision.

`twin.reference.joint_space.JointSpace` implements the interface.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol as Interface

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.planning.path import Path

_BOX_HALF_EDGES = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Half edges of the searched boxes in order of search, divided by the joint ranges."""

_SAMPLES_PER_BOX = 200
"""Number of samples per box."""

_HALVINGS = 8
"""Number of bisections between the nearest free sample and the configuration."""


class PathCertificate(Interface):
    """Distance between bodies along a path; `twin.reference.path_clearance.Certificate` has these attributes."""

    @property
    def proven(self) -> float:
        """Lower bound in m of the smallest distance along the whole path."""
        ...

    @property
    def found(self) -> float:
        """Smallest distance in m at the tested states of the path."""
        ...

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of the two bodies at the distance `found`; "" if there are none."""
        ...


class Space(Interface):
    """Joint values within limits, with tests for collisions.

    A search needs no robot, only this interface. Other spaces (poses of a tool, two robots at once) can be searched if
    a class implements these methods for them.
    """

    def interruptible(self, check: Callable[[], None]) -> Space:
        """Return this space with tests that call `check` every few milliseconds; errors in `check` end the test."""
        ...

    @property
    def limits(self) -> Array:
        """Lower and upper limit (n, 2) of each joint in m or rad."""
        ...

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that moves, for costs that depend on the motion of its tool."""
        ...

    @property
    def weights(self) -> Array:
        """Lengths (n,) in m equivalent to one unit of each joint: the length of a step dq is |weights * dq|."""
        ...

    @property
    def leads(self) -> np.ndarray:
        """(n,) bool: whether each joint can move the tool; other joints rest if start and goal values are equal."""
        ...

    def free(self, q: Array, *, exact: bool = True) -> np.ndarray:
        """Return (k,) bool: whether joint values q (k, n) are free; if not `exact`, the test is fast but may err."""
        ...

    def clearances(self, q: Array, most: float) -> Array:
        """Return lower bounds (k,) in m of the smallest distance between bodies at q (k, n); each is at most `most`."""
        ...

    def steer(self, a: Array, b: Array) -> Path:
        """Return the direct path from a (n,) to b (n,), without regard to obstacles."""
        ...

    def free_each(self, a: Array, b: Array) -> np.ndarray:
        """Return (m,) bool: whether the direct paths from a (m, n) to b (m, n), with free ends, seem free.

        This is a fast test for searches: `free_between` may find a collision on a path that passes this test.
        """
        ...

    def free_between(self, a: Array, b: Array) -> bool:
        """Return whether the direct path from a (n,) to b (n,), as returned by `steer`, is free of collisions."""
        ...

    def free_along(self, path: Path) -> bool:
        """Return whether a path that begins at a free point is free of collisions."""
        ...

    def certify(self, path: Path, within: float = 0.5 * MM) -> PathCertificate:
        """Return a certificate of a free path: a proven lower bound of the distance between bodies.

        `within` is the accepted difference in m between the smallest distance found and the bound.
        """
        ...

    def why(self, q: Array) -> str:
        """Return why joint values q (n,) are not free, with values and limits; "" if they are free."""
        ...

    def too_small_distance(self, q: Array) -> float | None:
        """Return the distance in m of the two bodies that lack most of the required clearance at q (n,).

        It is 0 or less if they collide; None if q is free, or not free for another reason than a distance.
        """
        ...

    def named(self, q: Array) -> str:
        """Return joint values q (n,) as text, with names and units as in a waypoint of a protocol."""
        ...


def nearest_free(space: Space, q: Array, seed: int = 0) -> Array | None:
    """Return a free configuration (n,) near q (n,): the nearest free sample, moved towards q; None if none is free.

    It is for messages about a q in collision.
    """
    rng = np.random.default_rng(seed)
    lower, upper = space.limits.T
    inside = np.clip(q, lower, upper)
    if space.free(inside[None])[0]:
        return inside
    # Small boxes first: in a large one, few samples would be near the configuration.
    for half_edge in _BOX_HALF_EDGES:
        offsets = rng.uniform(-half_edge, half_edge, (_SAMPLES_PER_BOX, len(q))) * (upper - lower)
        samples = np.clip(inside + offsets, lower, upper)
        samples = samples[space.free(samples)]
        if len(samples):
            distances = np.linalg.norm((samples - inside) * space.weights, axis=1)
            nearest_sample = samples[np.argmin(distances)]
            return _moved_towards(space, nearest_sample, inside)
    return None


def _moved_towards(space: Space, free: Array, blocked: Array) -> Array:
    """Return a free point of the line from the configuration `free` (n,) to `blocked` (n,), near its blocked part."""
    low = 0.0  # fraction of the line where it is free
    high = 1.0  # fraction where it is blocked
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        configuration = free + middle * (blocked - free)
        if space.free(configuration[None])[0]:
            low = middle
        else:
            high = middle
    return free + low * (blocked - free)
