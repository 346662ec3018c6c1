"""Moments of a closed triangle mesh, summed over signed tetrahedra; independent of the library of the CAD build."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.body import Mesh

_UNIT_TETRAHEDRON_MOMENTS = (np.ones((4, 4)) + np.eye(4)) / 20.0
"""Integrals (4, 4) of the products of two barycentric coordinates over a tetrahedron of volume 1.

With its corners p_a and its volume V, the second moments are V times the sum of entry (a, b) times p_a p_b^T.
"""


@dataclass(frozen=True)
class Moments:
    """Moments of a solid about the origin, for density 1; after `scaled`, for a density in kg/m3.

    Attributes:
        volume: volume in m3, after `scaled` the mass in kg; negative if the faces are oriented inwards.
        first: (3,) in m4, after `scaled` in kg m: first moment.
        second: (3, 3) in m5, after `scaled` in kg m2: second moments, the integral of x x^T.
    """

    volume: float
    first: Array
    second: Array

    def __add__(self, other: Moments) -> Moments:
        return Moments(self.volume + other.volume, self.first + other.first, self.second + other.second)

    def scaled(self, density: float) -> Moments:
        """Return the moments for a density in kg/m3: mass in kg, first moment in kg m, second moments in kg m2."""
        return Moments(density * self.volume, density * self.first, density * self.second)


def moments(vertices: Array, triangles: np.ndarray) -> Moments:
    """Return the moments of the volume inside a closed mesh.

    Args:
        vertices: (n, 3) in m.
        triangles: (m, 3) vertex indices, m at least 1, counter-clockwise seen from outside.
    """
    corners = np.asarray(vertices, float)[np.asarray(triangles)]  # (m, corner, xyz)
    # sum about the mean corner, because rounding errors are large far from the origin
    shift = corners.reshape(-1, 3).mean(axis=0)
    corners = corners - shift
    # each triangle and the origin are a tetrahedron, whose signed volume is a sixth of the triple product
    crossed = np.cross(corners[:, 1], corners[:, 2])
    volumes = np.einsum("ki,ki->k", corners[:, 0], crossed) / 6.0
    volume = float(volumes.sum())
    first = np.einsum("k,kai->i", volumes, corners) / 4.0  # the mean of four corners, of which the origin is one
    origin = np.zeros((len(corners), 1, 3))
    with_apex = np.concatenate([corners, origin], axis=1)
    second = np.einsum("k,kai,ab,kbj->ij", volumes, with_apex, _UNIT_TETRAHEDRON_MOMENTS, with_apex, optimize=True)
    # back to the origin of the frame, by x = corner + shift
    mixed = np.outer(first, shift)
    second_about_origin = second + mixed + mixed.T + volume * np.outer(shift, shift)
    return Moments(volume, first + volume * shift, second_about_origin)


def inertia_tensor(second: Array) -> Array:
    """Return the inertia tensor (3, 3) for second moments (3, 3) about the same point."""
    return np.trace(second) * np.eye(3) - second


def is_closed(triangles: np.ndarray) -> bool:
    """Return whether every edge is used equally often in each direction, so that the faces enclose volumes.

    Solids that touch along an edge use it several times in each direction. A mesh without triangles is not closed.
    """
    t = np.asarray(triangles, np.int64)
    if not len(t):
        return False
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    # one number for each directed edge: sorted, the numbers of all edges and of all reversed edges must be the same
    count = int(edges.max(initial=0)) + 1
    start = edges[:, 0]
    end = edges[:, 1]
    forwards = np.sort(start * count + end)
    backwards = np.sort(end * count + start)
    return np.array_equal(forwards, backwards)


def moments_of_meshes(
    meshes: Iterable[Mesh], density: Callable[[Mesh], float | None] = lambda mesh: 1.0
) -> Moments | None:
    """Return the moments of several closed meshes together.

    `density` returns the density of a mesh in kg/m3; default: 1. The result is None if the volume is not positive, a
    mesh is open or empty, or a mesh has no density.
    """
    total = Moments(0.0, np.zeros(3), np.zeros((3, 3)))
    for mesh in meshes:
        rho = density(mesh)
        if rho is None or not is_closed(mesh.triangles):
            return None
        total += moments(mesh.vertices, mesh.triangles).scaled(rho)
    if not total.volume > 0:
        return None
    return total
