"""The volume of an organ as a function of the nodes of its grid."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array, Index

_TRIANGLES_PER_PART = 256
"""Smallest number of triangles of which a part consists; the largest is twice as many, less one."""


class Volume:
    """The volume inside a surface, as a polynomial of third degree in the nodes of the organ's grid.

    The volume is the sum of det(a, b, c) / 6 over triangles with corners a, b, c; a corner is a weighted sum of nodes.
    """

    def __init__(self, weights: Array, triangles: Index) -> None:
        """Compute the polynomial from weights (c, n) of n nodes in c corners, and the corners (f, 3) of triangles."""
        n = weights.shape[1]
        sums = np.zeros((n, n * n))
        # in parts, because the products of all triangles at once would take much memory
        for part in np.array_split(triangles, max(1, len(triangles) // _TRIANGLES_PER_PART)):
            a = weights[part[:, 0]]
            b = weights[part[:, 1]]
            c = weights[part[:, 2]]
            products = b[:, :, None] * c[:, None, :]
            sums += a.T @ products.reshape(len(part), n * n)
        cube = sums.reshape(n, n, n) / 6
        cube = cube + cube.transpose(2, 0, 1) + cube.transpose(1, 2, 0)  # a determinant is the same in cyclic order
        j, k = np.triu_indices(n, 1)
        factors = cube[:, j, k] - cube[:, k, j]
        is_used = factors.any(axis=0)  # two nodes that do not move the same triangle have the factor 0
        self._j = j[is_used]
        self._k = k[is_used]
        self._factors = factors[:, is_used]

    def at(self, nodes: Array) -> tuple[float, Array]:
        """Return the volume in m3 at nodes (k, 3), and its derivatives (k, 3) in m2 with respect to the nodes."""
        ax, ay, az = nodes[self._j].T
        bx, by, bz = nodes[self._k].T
        cross = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
        by_node = self._factors @ cross
        # Euler's theorem for a homogeneous polynomial of third degree
        volume = float(np.vdot(nodes, by_node)) / 3
        return volume, by_node
