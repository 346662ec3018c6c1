"""The nearest configuration without collisions, for messages about a configuration in collision."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array
from twin.planning.space import Space

_HALF_EDGES = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Half edges of the searched boxes in order of search, divided by the joint ranges."""

_SAMPLES = 200
"""Number of samples per box."""

_HALVINGS = 8
"""Number of bisections between the nearest free sample and the configuration."""


def nearest_free(space: Space, q: Array, seed: int = 0) -> Array | None:
    """Return a free configuration (n,) near q (n,): the nearest free sample, moved towards q; None if none is free."""
    rng = np.random.default_rng(seed)
    lower, upper = space.limits.T
    inside = np.clip(q, lower, upper)
    if space.free(inside[None])[0]:
        return inside
    # Small boxes first: in a large one, few samples would be near the configuration.
    for half_edge in _HALF_EDGES:
        offsets = rng.uniform(-half_edge, half_edge, (_SAMPLES, len(q))) * (upper - lower)
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
    high = 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        configuration = free + middle * (blocked - free)
        if space.free(configuration[None])[0]:
            low = middle
        else:
            high = middle
    return free + low * (blocked - free)
