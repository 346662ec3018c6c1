"""Interface of paths, q(s) with derivatives, between planners and timing."""

from __future__ import annotations

from typing import Protocol as Interface

from twin.core.spatial import Array


class Path(Interface):
    """Coordinates q (n,) as a smooth function of a parameter s from 0 to 1, which is not time.

    `chebyshev_path.line` is a straight path, `chebyshev_path.ChebyshevPath` a series (phases given by poses, curves
    around obstacles).
    `timing.time_path` computes the timing of a path, `Space.free_along` tests it for collisions.
    """

    def __call__(self, s: Array, order: int = 0) -> Array:
        """Return q (k, n) in m or rad at s (k,), or its derivative with respect to s of order 1 or 2."""
        ...
