"""A movable object: a rigid shape with mass and friction that tools can grasp and push."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np

from twin.core.spatial import Array
from twin.model.body import TOOL, Body, Finish, Frame, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

ShapeName = Literal["ring", "box", "ball"]

_AROUND, _ACROSS = 48, 16
"""Numbers of facets. `_AROUND`: around the axis of a ring or ball. `_ACROSS`: around the wire, or from pole to pole."""


@dataclass(frozen=True)
class Movable:
    """A movable object; its frame is at the centre of its shape.

    Attributes:
        name: identifier, unique among objects, robots and props.
        shape: "ring": a round wire around z; "box"; "ball".
        size: in m. Ring: (radius of the wire's centre line, radius of the wire); box: three half edges; ball:
            (radius,).
        mass: in kg.
        friction: coefficient of sliding friction; in a contact, the larger coefficient applies.
        T_world_object: (4, 4) pose at the start.
        color_rgba: linear, 0..1.
    """

    name: str
    shape: ShapeName
    size: tuple[float, ...]
    mass: float
    friction: float
    T_world_object: Array = field(default_factory=lambda: np.eye(4))
    color_rgba: tuple[float, float, float, float] = (0.6, 0.6, 0.6, 1.0)

    def mesh(self) -> Mesh:
        """Return the surface in the frame of the object."""
        if self.shape == "box":
            vertices = np.array(list(product((-1.0, 1.0), repeat=3))) * self.size
            quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
            triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
        else:
            radius, wire = self.size if self.shape == "ring" else (0.0, self.size[0])
            vertices, triangles = _turned(radius, wire)
        return Mesh(self.name, vertices, triangles.astype(np.int32), self.color_rgba, Finish(roughness=0.4))

    def inertia(self) -> Inertia:
        """Return the inertia of the solid shape in the frame of the object."""
        if self.shape == "ring":
            radius, wire = self.size
            across = radius**2 / 2 + 5 / 8 * wire**2
            moments = np.array([across, across, radius**2 + 3 / 4 * wire**2])
        elif self.shape == "ball":
            moments = np.full(3, 2 / 5 * self.size[0] ** 2)
        else:
            squares = np.square(self.size)
            moments = (squares.sum() - squares) / 3
        return Inertia(self.mass, np.zeros(3), np.diag(self.mass * moments))


def together(objects: Sequence[Movable], name: str = "objects") -> Mechanism:
    """Return the objects as free bodies of one mechanism; its base is the World and has no shape."""
    bodies = [Body(name), *(Body(o.name, (o.mesh(),), o.inertia()) for o in objects)]
    joints = [Joint(f"free_{o.name}", "free", name, o.name, T_parent_joint=o.T_world_object) for o in objects]
    rest = {name: np.eye(4)} | {o.name: o.T_world_object for o in objects}
    frames = (Frame(TOOL, name, np.eye(4)),)  # the solvers of loops require a tool frame
    return Mechanism(name, name, tuple(bodies), tuple(joints), frames, rest=rest)


def _turned(radius: float, wire: float) -> tuple[Array, np.ndarray]:
    """Return vertices and triangles of a torus about z or, if `radius` is 0, of a ball with the radius `wire`."""
    ball = radius == 0.0
    rows = _ACROSS + 1 if ball else _ACROSS
    v = np.linspace(-np.pi / 2, np.pi / 2, rows) if ball else np.arange(rows) * (2 * np.pi / rows)
    u = np.arange(_AROUND) * (2 * np.pi / _AROUND)
    r, z = radius + wire * np.cos(v), wire * np.sin(v)
    grid = np.stack([np.outer(np.cos(u), r), np.outer(np.sin(u), r), np.broadcast_to(z, (_AROUND, rows))], axis=-1)
    i, j = np.meshgrid(np.arange(_AROUND), np.arange(rows - 1 if ball else rows), indexing="ij")
    k, n = (i + 1) % _AROUND, (j + 1) % rows
    a, b, c, d = (x * rows + y for x, y in ((i, j), (k, j), (k, n), (i, n)))
    low, high = np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)
    if not ball:
        return grid.reshape(-1, 3), np.concatenate([low.reshape(-1, 3), high.reshape(-1, 3)])
    # at a pole all vertices of a row coincide: one triangle per column there
    return grid.reshape(-1, 3), np.concatenate([low[:, 1:].reshape(-1, 3), high[:, :-1].reshape(-1, 3)])
