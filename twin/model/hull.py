"""Check that a shape has a convex hull: its vertices are not in one plane."""

from __future__ import annotations

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array

_FLAT_RATIO = 1e-9
"""Ratio of thickness to size below which a shape counts as flat."""


def flat(vertices: Array) -> bool:
    """Return whether vertices (n, 3) are in one plane, so that they have no convex hull."""
    if len(vertices) < 4:  # three points are always in a plane
        return True
    # Singular values are extents along the shape's own axes: a flat shape may stand obliquely to x, y, z.
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return bool(extents[2] <= _FLAT_RATIO * extents[0])


def require_hull(name: str, vertices: Array) -> None:
    """Check that vertices (n, 3) have a convex hull; `name` is the name of the shape for the message.

    Raises:
        TwinError: the vertices are in one plane.
    """
    if flat(vertices):
        raise TwinError(
            f"{name} is flat: all its vertices are in one plane, so that it has no convex hull. Draw it with a "
            "thickness, or remove its shape"
        )
