"""Minimum clearances and collisions between the CAD's meshes along a motion, computed by coal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import coal  # pyright: ignore[reportMissingImports] - installed beside site-packages
import numpy as np

from twin.core import spatial
from twin.core.progress import StepProgress
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.hull import require_hull
from twin.model.mechanism import Mechanism

TOUCHING = 0.05 * MM
"""Distance in m up to which two parts of jointed bodies count as mating in the CAD (pin and bore, washer and eye)."""

_JOINTED_INTERVAL = 5
"""Interval in samples between tests of the parts of jointed bodies, whose relative motion is slow."""


@dataclass(frozen=True)
class Clearance:
    """Minimum clearances at the samples of a motion.

    Attributes:
        distance: (k,) in m, minimum clearance of all `unjointed_pairs`; 0 if two bodies collide.
        pair: (k,) names of the two nearest bodies.
        contacts: (sample, part, part) of each collision between non-mating parts of jointed bodies.
    """

    distance: Array
    pair: tuple[tuple[str, str], ...]
    contacts: tuple[tuple[int, str, str], ...]


class Shape:
    """A triangle mesh for coal.

    Attributes:
        triangles: (k, 3, 3) corners of its triangles in m, in the frame of the body.
        corners: (8, 3) corners of its bounding box in m; no point of the mesh moves farther than the corner that moves
            most.
    """

    def __init__(self, name: str, body: str, meshes: Sequence[Mesh]) -> None:
        self.name = name
        self.body = body
        corners = []
        rows = []
        count = 0
        for mesh in meshes:
            corners.append(mesh.vertices)
            rows.append(mesh.triangles + count)
            count += len(mesh.vertices)
        self._vertices = vertices = np.concatenate(corners)
        triangles = np.concatenate(rows)
        self.triangles = vertices[triangles]
        self.model = coal.BVHModelOBBRSS()
        self.model.beginModel(len(triangles), len(vertices))
        self.model.addVertices(vertices)
        self.model.addTriangles(triangles.astype(np.int64))
        self.model.endModel()
        low = vertices.min(axis=0)
        high = vertices.max(axis=0)
        self.corners = np.array(list(product(*zip(low, high, strict=True))))

    @cached_property
    def hull(self) -> coal.Convex:
        """Convex hull of the mesh.

        Raises:
            TwinError: the mesh is flat.
        """
        require_hull(self.name, self._vertices)
        return _hull(self._vertices)

    def corners_in(self, Ts_base_body: Array) -> Array:
        """Return the corners (k, 8, 3) of the bounding box in base, for body poses (k, 4, 4)."""
        R = Ts_base_body[:, :3, :3]
        p = Ts_base_body[:, None, :3, 3]
        return np.einsum("kij,nj->kni", R, self.corners) + p


def _hull(vertices: Array) -> coal.Convex:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    # scipy numbers the corners as in `vertices`, coal as in `points`
    place: dict[int, int] = {}
    points = coal.StdVec_Vec3s()
    for k in hull.vertices:
        place[int(k)] = len(place)
        points.append(vertices[k])
    # coal requires triangles with outward normals; in scipy, only `equations` has these normals
    simplices = hull.simplices.copy()
    p, q, r = np.moveaxis(vertices[hull.simplices], 1, 0)
    normals = np.cross(q - p, r - p)
    inwards = np.einsum("ki,ki->k", normals, hull.equations[:, :3]) <= 0
    simplices[inwards, 1:] = simplices[inwards, :0:-1]
    triangles = coal.StdVec_Triangle()
    for a, b, c in simplices.tolist():
        triangles.append(coal.Triangle(place[a], place[b], place[c]))
    return coal.Convex(points, triangles)


def clearance(mechanism: Mechanism, link_poses: Mapping[str, Array], progress: StepProgress | None = None) -> Clearance:
    """Return the minimum clearances between the meshes of a mechanism.

    A measured distance minus the subsequent motion of both bodies is a lower bound of their distance. The pair is
    measured again only if this bound is below the smallest distance already measured at the sample.

    Args:
        mechanism: the mechanism, with the meshes of its bodies.
        link_poses: T_base_body (k, 4, 4) by name of the body.
        progress: called with the fraction done.
    """
    distance, pair = _track(unjointed_pairs(mechanism), link_poses, progress)
    contacts = _contacts(mechanism, _jointed(mechanism), link_poses)
    return Clearance(distance, pair, contacts)


def unjointed_pairs(mechanism: Mechanism) -> list[tuple[Shape, Shape]]:
    """Return all pairs of shapes whose bodies no joint connects, directly or over bodies without shape."""
    shapes = []
    for body in mechanism.bodies:
        if body.meshes:
            shapes.append(Shape(body.name, body.name, body.meshes))
    jointed = _jointed(mechanism)
    pairs = []
    for a, b in combinations(shapes, 2):
        if frozenset((a.body, b.body)) not in jointed:
            pairs.append((a, b))
    return pairs


def _jointed(mechanism: Mechanism) -> set[frozenset[str]]:
    """Return the pairs of bodies that a joint connects, or a chain of joints over bodies without shape.

    An import inserts such bodies: between two hinges of one body, or for a link that only holds a frame. A free joint
    connects nothing. The base is no part of a chain: it holds bodies that are apart.
    """
    connected = []
    for joint in mechanism.joints:
        if joint.type != "free":
            connected.append(frozenset((joint.parent, joint.child)))
    for body in mechanism.bodies:
        if body.meshes or body.name == mechanism.base:
            continue
        own_pairs = [pair for pair in connected if body.name in pair]
        # with one neighbour the body ends a chain, with three or more its neighbours move against each other
        if len(own_pairs) != 2:
            continue
        neighbours = (own_pairs[0] | own_pairs[1]) - {body.name}
        connected = [pair for pair in connected if pair not in own_pairs]
        if len(neighbours) == 2:
            connected.append(neighbours)
    return set(connected)


def between(
    mechanisms: Mapping[str, Mechanism],
    link_poses: Mapping[str, Mapping[str, Array]],
    touching: frozenset[frozenset[str]] = frozenset(),
) -> dict[tuple[str, str], Clearance]:
    """Return the minimum clearances of each pair of owners (robots, objects); bodies are named "owner/body".

    Args:
        mechanisms: mechanism of each owner.
        link_poses: T_world_body (k, 4, 4) by owner and body.
        touching: pairs of "owner/body" that touch intentionally.
    """
    shapes: dict[str, list[Shape]] = {}
    for owner, mechanism in mechanisms.items():
        shapes[owner] = []
        for body in mechanism.bodies:
            if body.meshes:
                name = f"{owner}/{body.name}"
                shapes[owner].append(Shape(name, name, body.meshes))
    poses = {}
    for owner, links in link_poses.items():
        for body, T in links.items():
            poses[f"{owner}/{body}"] = T
    clearances = {}
    for first_owner, second_owner in combinations(mechanisms, 2):
        pairs = []
        for a, b in product(shapes[first_owner], shapes[second_owner]):
            if frozenset((a.name, b.name)) not in touching:
                pairs.append((a, b))
        distance, pair = _track(pairs, poses, None)
        clearances[first_owner, second_owner] = Clearance(distance, pair, ())
    return clearances


def _contacts(
    mechanism: Mechanism, jointed: set[frozenset[str]], link_poses: Mapping[str, Array]
) -> tuple[tuple[int, str, str], ...]:
    """Return (sample, part, part) of collisions of jointed bodies; parts that mate or touch in the CAD are skipped."""
    mating = set()
    for joint in mechanism.joints:
        for part, partner in combinations(joint.mating, 2):
            mating.add(frozenset((part, partner)))
    contacts = []
    for pair in sorted(jointed, key=sorted):
        a, b = sorted(pair)
        # All poses are relative to a, so only b moves.
        Ts_a_b = (spatial.inverse(link_poses[a]) @ link_poses[b])[::_JOINTED_INTERVAL]
        rest_a = mechanism.rest.get(a, link_poses[a][0])
        rest_b = mechanism.rest.get(b, link_poses[b][0])
        T_rest = spatial.inverse(rest_a) @ rest_b
        parts_a = _part_shapes(mechanism, a)
        for part_b in _part_shapes(mechanism, b):
            for part_a in parts_a:
                if frozenset((part_a.name, part_b.name)) in mating:
                    continue
                k = _first_contact(part_a, part_b, T_rest, Ts_a_b)
                if k is not None:
                    contacts.append((k * _JOINTED_INTERVAL, part_a.name, part_b.name))
    return tuple(contacts)


def _first_contact(a: Shape, b: Shape, T_rest: Array, Ts_a_b: Array) -> int | None:
    """Return the first of the poses Ts_a_b (k, 4, 4) of b at which two parts collide; None if there is none.

    Parts that touch in the rest pose T_rest (4, 4) of b mate, and are not judged. The distance is computed only at
    poses to which b may have moved by as much as the last distance.
    """
    corners_a = a.corners_in(np.eye(4)[None])[0]
    corners_b = b.corners_in(Ts_a_b)
    rest_corners_b = b.corners_in(T_rest[None])[0]
    travel = _largest_shift(corners_b, rest_corners_b)  # since the rest pose
    gap = box_gap(corners_a.min(axis=0), corners_a.max(axis=0), rest_corners_b.min(axis=0), rest_corners_b.max(axis=0))
    if travel.max() < gap:
        return None
    gap = distance_between(a, b, np.eye(4), T_rest)
    if gap <= TOUCHING:
        return None
    k = 0
    while travel[k:].max() >= gap > 0:
        k += int(np.argmax(travel[k:] >= gap))  # before this pose, b has moved too little to touch a
        gap = distance_between(a, b, np.eye(4), Ts_a_b[k])
        travel = _largest_shift(corners_b, corners_b[k])
    if gap > 0:
        return None
    return k


def _part_shapes(mechanism: Mechanism, body: str) -> list[Shape]:
    """Return a shape for each mesh of a body, so that parts can be named and tested one by one."""
    shapes = []
    for mesh in mechanism.body(body).meshes:
        shapes.append(Shape(mesh.name, body, [mesh]))
    return shapes


def _largest_shift(corners: Array, before: Array) -> Array:
    """Return the largest shift (k,) in m of a corner of (k, 8, 3) from the corners `before`: no point moves farther."""
    return np.linalg.norm(corners - before, axis=-1).max(axis=-1)


def _travel(a: Shape, b: Shape, link_poses: Mapping[str, Array], since: int = 0) -> Array:
    """Return an upper bound (k,) in m of the motion of b relative to a after sample `since`."""
    Ts_a_b = spatial.inverse(link_poses[a.body]) @ link_poses[b.body]
    corners = b.corners_in(Ts_a_b)
    return _largest_shift(corners, corners[since])


def box_gap(low_a: Array, high_a: Array, low_b: Array, high_b: Array) -> Array:
    """Return the distance (...) in m between boxes with corners (..., 3): a lower bound for shapes inside the boxes."""
    along_axes = np.maximum(low_a - high_b, low_b - high_a)  # negative where the boxes overlap
    return np.linalg.norm(np.maximum(along_axes, 0), axis=-1)


def _track(
    pairs: list[tuple[Shape, Shape]],
    link_poses: Mapping[str, Array],
    progress: StepProgress | None,
) -> tuple[Array, tuple[tuple[str, str], ...]]:
    """Return the smallest distance (k,) in m of any pair, and the names of the two nearest bodies, at each sample."""
    count = len(next(iter(link_poses.values())))
    if not pairs:
        return np.full(count, np.inf), (("", ""),) * count
    # Lower bound of each pair's distance at all samples: the last measured distance minus the relative motion after it.
    bounds = np.zeros((len(pairs), count))
    for i, (a, b) in enumerate(pairs):
        bounds[i] = _first_bound(a, b, link_poses) - _travel(a, b, link_poses)
    distance = np.zeros(count)
    names = []
    for k in range(count):
        smallest = np.inf
        nearest = pairs[0]
        for i in np.argsort(bounds[:, k]):
            if bounds[i, k] >= smallest:
                break
            a, b = pairs[i]
            measured = distance_between(a, b, link_poses[a.body][k], link_poses[b.body][k])
            bounds[i] = measured - _travel(a, b, link_poses, since=k)
            if measured < smallest:
                smallest = measured
                nearest = pairs[i]
        distance[k] = smallest
        a, b = nearest
        names.append((a.name, b.name))
        if progress is not None:
            progress((k + 1) / count)
    return distance, tuple(names)


def _first_bound(a: Shape, b: Shape, link_poses: Mapping[str, Array]) -> float:
    """Return the distance in m between the bounding boxes at the first sample."""
    corners_a = a.corners_in(link_poses[a.body][:1])[0]
    corners_b = b.corners_in(link_poses[b.body][:1])[0]
    gap = box_gap(corners_a.min(axis=0), corners_a.max(axis=0), corners_b.min(axis=0), corners_b.max(axis=0))
    return float(gap)


def distance_between(a: Shape, b: Shape, Ta: Array, Tb: Array, most: float = np.inf) -> float:
    """Return the distance in m between two meshes at poses (4, 4), but at most `most`; 0 if they collide.

    coal skips all parts that are farther apart than the smallest known distance; this distance is `most` at first. With
    a small `most`, the computation is faster than coal's collision test with a margin: that test is slow for meshes
    that are close everywhere.
    """
    request = coal.DistanceRequest()
    result = coal.DistanceResult()
    result.min_distance = min(most, result.min_distance)
    coal.distance(a.model, placed(Ta), b.model, placed(Tb), request, result)
    return max(0.0, float(result.min_distance))


def placed(T: Array) -> coal.Transform3s:
    """Return a pose (4, 4) as a transform of the package coal."""
    R = np.ascontiguousarray(T[:3, :3])
    return coal.Transform3s(R, T[:3, 3])
