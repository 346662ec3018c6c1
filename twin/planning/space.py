"""What a search for a way asks of the space in which it searches: `twin.reference.space.JointSpace` is one."""

from __future__ import annotations

from typing import Protocol as Interface

import numpy as np

from twin.core.spatial import Array
from twin.planning.path import Path


class Space(Interface):
    """Joint values within limits, and which of them are free.

    Whoever searches needs no robot: another space (of a tool's poses, of two robots at once) is another class with
    these methods.
    """

    @property
    def limits(self) -> Array:
        """Lower and upper limits (n, 2) in m or rad."""
        ...

    @property
    def weights(self) -> Array:
        """Metres (n,) that one unit of each joint counts for: a step dq is |weights * dq| long."""
        ...

    def free(self, q: Array) -> np.ndarray:
        """Return which of joint values q (k, n) are free."""
        ...

    def steer(self, a: Array, b: Array) -> Path:
        """Return the path that is taken from a (n,) to b (n,) where nothing is in the way."""
        ...

    def free_between(self, a: Array, b: Array) -> bool:
        """Return whether the path from a (n,) to b (n,) that `steer` gives is free."""
        ...

    def free_along(self, path: Path) -> bool:
        """Return whether a path that begins at a free place is free."""
        ...

    def why(self, q: Array) -> str:
        """Return what is not free at q (n,), with numbers and what is allowed; "" if all is."""
        ...
