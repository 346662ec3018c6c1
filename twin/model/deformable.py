"""A deformable: a mesh whose vertices move, pinned to a body or to the world."""

from __future__ import annotations

from dataclasses import dataclass

from twin.model.mechanism import Mesh


@dataclass(frozen=True)
class Deformable:
    """A mesh at rest, in m, in the frame of the body that it is pinned to.

    Attributes:
        name: identifier, unique among robots and props too.
        mesh: triangles, which stay, and vertices (n, 3) at rest.
        owner, body: the robot or prop and its body that carry it; "": it is pinned to the world.
    """

    name: str
    mesh: Mesh
    owner: str = ""
    body: str = ""
