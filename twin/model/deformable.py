"""A deformable: a mesh with moving vertices, pinned to a body or to the world."""

from __future__ import annotations

from dataclasses import dataclass

from twin.core.spatial import Array
from twin.model.body import Mesh


@dataclass(frozen=True, eq=False)
class Deformable:
    """A mesh at rest, in m, in the frame of the body to which it is pinned.

    Attributes:
        name: identifier, unique among deformables, robots and props.
        mesh: triangles (constant) and vertices (n, 3) at rest.
        owner, body: the robot or prop, and its body, to which the mesh is pinned; "": pinned to the world.
        weights: (n, k), vertices = weights @ nodes: few nodes move many vertices, and only the nodes are recorded;
            None: each vertex is a node.
    """

    name: str
    mesh: Mesh
    owner: str = ""
    body: str = ""
    weights: Array | None = None

    @property
    def signal(self) -> str:
        """Name of the signal that its plant writes: `<name>.vertices` or `<name>.nodes`, three numbers each in m."""
        return f"{self.name}.vertices" if self.weights is None else f"{self.name}.nodes"

    @property
    def size(self) -> int:
        """Number of numbers in the signal."""
        return 3 * (len(self.mesh.vertices) if self.weights is None else self.weights.shape[1])

    def vertices(self, values: Array) -> Array:
        """Return the vertices (n, 3) in m for a value of the signal."""
        points = values.reshape(-1, 3)
        return points if self.weights is None else self.weights @ points
