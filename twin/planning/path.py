"""What every planner here gives and every timing takes: a path q(s) with its derivatives."""

from __future__ import annotations

from typing import Protocol as Interface

from twin.core.spatial import Array


class Path(Interface):
    """Coordinates q (n,) as a smooth function of a parameter s from 0 to 1, which is not time.

    `smooth.line` is the straight one, `smooth.Smooth` a series (phases by their poses, curves around obstacles);
    `timing.time_path` gives any of them a timing, `Space.free_along` asks whether one is free.
    """

    def __call__(self, s: Array, order: int = 0) -> Array:
        """Return q (k, n) in m or rad at s (k,), or its derivative with respect to s of order 1 or 2."""
        ...
