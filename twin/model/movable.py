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

_FACETS_AROUND_AXIS = 48
"""Number of facets around the axis of a ring or ball."""

_FACETS_AROUND_WIRE = 16
"""Number of facets around the wire of a ring, or from pole to pole of a ball."""

_BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of the faces of a box, counter-clockwise seen from outside; z changes fastest from corner to corner."""


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
            corners = list(product((-1.0, 1.0), repeat=3))
            vertices = np.array(corners) * self.size
            a, b, c, d = np.array(_BOX_FACES).T
            triangles = _halves(a, b, c, d).reshape(-1, 3)
        elif self.shape == "ring":
            radius, wire = self.size
            vertices, triangles = _ring(radius, wire)
        else:
            vertices, triangles = _ball(self.size[0])
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


def objects_as_mechanism(objects: Sequence[Movable], name: str = "objects") -> Mechanism:
    """Return the objects as free bodies of one mechanism; its base is the World and has no shape."""
    bodies = [Body(name)]
    joints = []
    rest = {name: np.eye(4)}
    for movable in objects:
        bodies.append(Body(movable.name, (movable.mesh(),), movable.inertia()))
        T_world_object = movable.T_world_object
        joints.append(Joint(f"free_{movable.name}", "free", name, movable.name, T_parent_joint=T_world_object))
        rest[movable.name] = T_world_object
    frames = (Frame(TOOL, name, np.eye(4)),)  # the solvers of loops require a tool frame
    return Mechanism(name, name, tuple(bodies), tuple(joints), frames, rest=rest)


def _ring(radius: float, wire: float) -> tuple[Array, np.ndarray]:
    """Return vertices and triangles of a torus about z, with the radius of the wire's centre line and of the wire."""
    # Without the end: a full turn is the first point of the wire again.
    angles = np.arange(_FACETS_AROUND_WIRE) * (2 * np.pi / _FACETS_AROUND_WIRE)
    vertices = _vertices_of_revolution(radius + wire * np.cos(angles), wire * np.sin(angles))
    halves = _cell_triangles(_FACETS_AROUND_WIRE, _FACETS_AROUND_WIRE)
    return vertices, np.concatenate([halves[:, :, 0].reshape(-1, 3), halves[:, :, 1].reshape(-1, 3)])


def _ball(radius: float) -> tuple[Array, np.ndarray]:
    """Return vertices and triangles of a ball with the poles on z."""
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, _FACETS_AROUND_WIRE + 1)
    vertices = _vertices_of_revolution(0.0 + radius * np.cos(latitudes), radius * np.sin(latitudes))
    halves = _cell_triangles(_FACETS_AROUND_WIRE + 1, _FACETS_AROUND_WIRE)
    # at a pole all vertices of a row coincide: one triangle per column there
    low = halves[:, 1:, 0]
    high = halves[:, :-1, 1]
    return vertices, np.concatenate([low.reshape(-1, 3), high.reshape(-1, 3)])


def _vertices_of_revolution(r: Array, z: Array) -> Array:
    """Return the vertices (`_FACETS_AROUND_AXIS` * n, 3) of a profile r, z (n,) in m turned about z.

    The point of the profile changes fastest.
    """
    angles = np.arange(_FACETS_AROUND_AXIS) * (2 * np.pi / _FACETS_AROUND_AXIS)
    x = np.outer(np.cos(angles), r)
    y = np.outer(np.sin(angles), r)
    return np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1).reshape(-1, 3)


def _cell_triangles(rows: int, cells: int) -> np.ndarray:
    """Return the triangles (`_FACETS_AROUND_AXIS`, cells, 2, 3) of a turned profile with `rows` vertices.

    The triangles close around the axis. The profile closes only if `cells` equals `rows`.
    """
    i, j = np.meshgrid(np.arange(_FACETS_AROUND_AXIS), np.arange(cells), indexing="ij")
    next_i = (i + 1) % _FACETS_AROUND_AXIS
    next_j = (j + 1) % rows
    return _halves(i * rows + j, next_i * rows + j, next_i * rows + next_j, i * rows + next_j)


def _halves(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the two triangles (..., 2, 3) of quadrilaterals with the corners a, b, c, d (...)."""
    return np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=-2)
