"""Collision shapes for MuJoCo: a ring consists of capsules; a part of a body is a box, a capsule or its convex hull."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.body import Mesh
from twin.model.hull import require_hull
from twin.model.movable import Movable

RING_CAPSULES = 12
"""Number of capsules of a ring."""

_VOLUME_TOLERANCE = 0.03
"""Largest relative difference between the volumes of a part and of a box or capsule that replaces the part."""


NONE = -1
"""Index of an object, instrument or jaw where there is none; the signal `<object>.holder` has this value, too."""


class GeomOwner(NamedTuple):
    """What a collision shape belongs to: index of the object, or of the instrument and its jaw."""

    item: int = NONE
    arm: int = NONE
    jaw: int = NONE


@dataclass(frozen=True)
class Solid:
    """A fixed body: its name, its parts, its pose T_world_body (4, 4), and its coefficient of sliding friction."""

    name: str
    parts: Sequence[Mesh]
    friction: float
    T_world_body: Array = field(default_factory=lambda: np.eye(4))


def add_object(body: mujoco.MjsBody, item: Movable, **geom_attributes: object) -> None:
    """Add the geoms of a movable object to its MuJoCo body."""
    kinds = mujoco.mjtGeom
    if item.shape == "box":
        body.add_geom(type=kinds.mjGEOM_BOX, size=list(item.size), mass=item.mass, **geom_attributes)
    elif item.shape == "ball":
        body.add_geom(type=kinds.mjGEOM_SPHERE, size=[item.size[0], 0, 0], mass=item.mass, **geom_attributes)
    else:
        radius, wire = item.size
        angles = np.arange(RING_CAPSULES + 1) * (2 * np.pi / RING_CAPSULES)
        # the capsules' middles and ends are equally far inside and outside the wire's centre line
        corner_radius = 2 * radius / (1 + np.cos(np.pi / RING_CAPSULES))
        corners = corner_radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(RING_CAPSULES + 1)])
        for start, end in pairwise(corners):
            ends = [*start.tolist(), *end.tolist()]
            mass = item.mass / RING_CAPSULES
            body.add_geom(type=kinds.mjGEOM_CAPSULE, fromto=ends, size=[wire, 0, 0], mass=mass, **geom_attributes)


def add_part(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, part: Mesh, T_body: Array, owner: str, **geom_attributes: object
) -> None:
    """Add the geom of a part to a MuJoCo body: a box or a capsule if the part has this shape, else its convex hull.

    Args:
        spec: the model, which stores hulls.
        body: the body.
        part: the part.
        T_body: (4, 4) pose of the part's frame in the body.
        owner: prefix of the name of the hull.
        geom_attributes: attributes of the geom.

    Raises:
        TwinError: the part is flat.
    """
    kinds = mujoco.mjtGeom
    require_hull(f"{owner}: part '{part.name}'", part.vertices)
    vertices = np.ascontiguousarray(part.vertices, float)
    corners, volume, to_box, edges = _hull(vertices.tobytes())
    longest = int(np.argmax(edges))
    others = np.delete(edges, longest)
    radius = float(others.mean()) / 2
    length = float(edges[longest])
    capsule_volume = np.pi * radius**2 * (length - 2 * radius / 3)
    T_body_box = T_body @ spatial.inverse(to_box)
    is_box = abs(volume / np.prod(edges) - 1) < _VOLUME_TOLERANCE
    is_round = np.ptp(others) < _VOLUME_TOLERANCE * radius
    if is_box:
        _add_placed_geom(body, T_body_box, type=kinds.mjGEOM_BOX, size=(edges / 2).tolist(), **geom_attributes)
    elif is_round and abs(volume / capsule_volume - 1) < _VOLUME_TOLERANCE:
        # a capsule of MuJoCo is along z
        R_box_capsule = spatial.frame_from_axes(np.eye(3)[longest], np.eye(3)[(longest + 1) % 3])
        T_body_capsule = T_body_box @ spatial.pose(R_box_capsule)
        size = [radius, length / 2 - radius, 0]
        _add_placed_geom(body, T_body_capsule, type=kinds.mjGEOM_CAPSULE, size=size, **geom_attributes)
    else:
        name = f"{owner}/{part.name}"
        convex = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        spec.add_mesh(name=name, uservert=corners.ravel().tolist(), inertia=convex)
        _add_placed_geom(body, T_body, type=kinds.mjGEOM_MESH, meshname=name, **geom_attributes)


@lru_cache(maxsize=256)
def _hull(vertices: bytes) -> tuple[Array, float, Array, Array]:
    """Return the convex hull of vertices (float64): corners (k, 3), volume, and the smallest box around the hull.

    The box is given by the pose (4, 4) of the vertices' frame in the frame of the box, and by the lengths (3,) of its
    edges. The origin of the frame of the box is the middle of the box.
    The result is cached, because both arms of a scene have the same instruments, and a restarted World has the same
    parts.
    """
    import trimesh  # imported here, because the import takes a second

    hull = trimesh.convex.convex_hull(np.frombuffer(vertices).reshape(-1, 3))
    to_box, edges = trimesh.bounds.oriented_bounds(hull)
    return np.array(hull.vertices), float(hull.volume), np.array(to_box), np.array(edges)


def _add_placed_geom(body: mujoco.MjsBody, T: Array, **geom_attributes: object) -> None:
    """Add a geom at a pose T (4, 4) in the frame of the body."""
    quaternion = spatial.quat_from_matrix_wxyz(T[:3, :3])
    body.add_geom(pos=T[:3, 3].tolist(), quat=quaternion.tolist(), **geom_attributes)
