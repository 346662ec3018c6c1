"""The nearest configuration without collisions, for messages about a configuration in collision."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.planning.space import Space

_AROUND, _SAMPLES = (0.01, 0.03, 0.1, 0.3, 1.0), 200
"""Half edges of the searched boxes in order of search, divided by the joint ranges; number of samples per box."""

_HALVINGS = 8
"""Number of bisections between the nearest free sample and the configuration."""


def nearest_free(space: Space, q: Array, seed: int = 0) -> Array | None:
    """Return a free configuration (n,) near q (n,): the nearest free sample, moved towards q; None if none is free."""
    rng, limits = np.random.default_rng(seed), space.limits
    inside = np.clip(q, limits[:, 0], limits[:, 1])
    if space.free(inside[None])[0]:
        return inside
    for part in _AROUND:
        block = inside + rng.uniform(-part, part, (_SAMPLES, len(q))) * np.ptp(limits, axis=1)
        block = np.clip(block, limits[:, 0], limits[:, 1])
        block = block[space.free(block)]
        if len(block):
            best = block[np.argmin(np.linalg.norm((block - inside) * space.weights, axis=1))]
            low, high = 0.0, 1.0  # fractions of the line from best to inside; free at low
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                free = space.free((best + middle * (inside - best))[None])[0]
                low, high = (middle, high) if free else (low, middle)
            return best + low * (inside - best)
    return None
