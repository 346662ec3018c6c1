"""A deformable: a mesh with moving vertices, pinned to a body or to the world."""

from __future__ import annotations

from dataclasses import dataclass

from twin.model.mechanism import Mesh


@dataclass(frozen=True)
class Deformable:
    """A mesh at rest, in m, in the frame of the body to which it is pinned.

    Attributes:
        name: identifier, unique among deformables, robots and props.
        mesh: triangles (constant) and vertices (n, 3) at rest.
        owner, body: the robot or prop, and its body, to which the mesh is pinned; "": pinned to the world.
    """

    name: str
    mesh: Mesh
    owner: str = ""
    body: str = ""
