"""A deformable (a mesh that changes its shape and is fixed to a body or to the world), and its recorded motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array, Index
from twin.core.units import UM
from twin.model.body import Mesh

_LARGEST_OMITTED = 0.1 * UM
"""Maximum error in m of a node's position due to the shapes that `Bend.shapes` omits."""


@dataclass(frozen=True, eq=False)
class Deformable:
    """A mesh at rest, in m, in the frame of the body to which it is pinned.

    Attributes:
        name: identifier, unique among deformables, robots and props.
        mesh: triangles (constant) and vertices (n, 3) at rest.
        owner, body: name of a robot or prop, and name of the body of this owner to which the mesh is fixed; "": the
            mesh is fixed to the world.
        weights: (n, k) weights of k nodes: vertices = weights @ nodes. A few nodes move many vertices, and only the
            nodes are recorded. None: each vertex is a node.
    """

    name: str
    mesh: Mesh
    owner: str = ""
    body: str = ""
    weights: Array | None = None

    @property
    def signal(self) -> str:
        """Name of the World signal with the positions in m: `<name>.vertices` or, with weights, `<name>.nodes`."""
        if self.weights is None:
            return f"{self.name}.vertices"
        return f"{self.name}.nodes"

    @property
    def size(self) -> int:
        """Length of the signal: three times the number of vertices or nodes."""
        if self.weights is None:
            return 3 * len(self.mesh.vertices)
        return 3 * self.weights.shape[1]

    def vertices(self, values: Array) -> Array:
        """Return the vertices (n, 3) in m for `values` (size,) of the signal."""
        points = values.reshape(-1, 3)
        if self.weights is None:
            return points
        return self.weights @ points


@dataclass(frozen=True, eq=False)
class Bend:
    """The motion of a deformable, in the World. At the first time, the deformable has its shape at rest.

    Attributes:
        mesh: the mesh at rest.
        weights: (n, m) weights of the nodes: vertices (n, 3) = weights @ nodes at one time.
        times: (k,) in s, evenly spaced from 0.
        nodes: (k, m, 3) positions of the nodes in m.
    """

    mesh: Mesh
    weights: Array
    times: Array
    nodes: Array

    @property
    def name(self) -> str:
        """Name of the deformable."""
        return self.mesh.name

    def vertices(self, k: int) -> Array:
        """Return the vertices (n, 3) in m at the time `times[k]`."""
        return self.weights @ self.nodes[k]

    def changes(self) -> Index:
        """Return the indices of first and last time, and of each time just before or just after a motion of a node."""
        has_moved = np.abs(np.diff(self.nodes, axis=0)).max(axis=(1, 2)) > 0
        keep = np.ones(len(self.times), bool)
        keep[1:-1] = has_moved[:-1] | has_moved[1:]
        return np.flatnonzero(keep)

    def shapes(self) -> tuple[Array, Array]:
        """Return shapes (s, n, 3) in m and factors (k, s): vertices = vertices at rest + sum of factors times shapes.

        The shapes are the principal components of the motion and their opposites. All factors are therefore 0 to 1;
        some players clip other factors. Shapes that move no node by more than 0.1 µm are omitted.
        """
        displacements = self.nodes - self.nodes[0]
        U, S, Vt = np.linalg.svd(displacements.reshape(len(displacements), -1), full_matrices=False)
        needed = 0
        # By the nodes, not by the singular values: one node may have most of a small component.
        while np.abs((U[:, needed:] * S[needed:]) @ Vt[needed:]).max(initial=0.0) > _LARGEST_OMITTED:
            needed += 1
        by_node = Vt[:needed].reshape(needed, displacements.shape[1], 3)
        factors = U[:, :needed] * S[:needed]
        # each component with its opposite: a negative factor of one is a positive factor of the other
        signed_by_node = np.concatenate([by_node, -by_node])
        signed_factors = np.concatenate([factors, -factors], axis=1).clip(0.0)
        largest = signed_factors.max(axis=0, initial=0.0)
        is_used = largest > 0
        shapes = np.einsum("nm,smd->snd", self.weights, signed_by_node[is_used] * largest[is_used][:, None, None])
        return shapes, signed_factors[:, is_used] / largest[is_used]
