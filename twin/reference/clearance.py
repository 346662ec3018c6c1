"""Minimum clearances and collisions between the CAD's meshes along a motion, computed by coal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import coal  # pyright: ignore[reportMissingImports] - installed beside site-packages
import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Mesh
from twin.model.hull import require_hull
from twin.model.mechanism import Mechanism

TOUCHING = 0.05 * MM
"""Distance in m up to which two parts of jointed bodies count as mating in the CAD (pin and bore, washer and eye)."""


@dataclass(frozen=True)
class Clearance:
    """Minimum clearances at the samples of a motion.

    Attributes:
        distance: (k,) in m, minimum clearance between bodies that are not jointed (see `apart`); 0 if two collide.
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
        self.name, self.body = name, body
        self._vertices = vertices = np.concatenate([m.vertices for m in meshes])
        offsets = np.cumsum([0, *(len(m.vertices) for m in meshes)])
        triangles = np.concatenate([m.triangles + o for m, o in zip(meshes, offsets, strict=False)])
        self.triangles = vertices[triangles]
        self.model = coal.BVHModelOBBRSS()
        self.model.beginModel(len(triangles), len(vertices))
        self.model.addVertices(vertices)
        self.model.addTriangles(triangles.astype(np.int64))
        self.model.endModel()
        low, high = vertices.min(axis=0), vertices.max(axis=0)
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
        return np.einsum("kij,nj->kni", Ts_base_body[:, :3, :3], self.corners) + Ts_base_body[:, None, :3, 3]


def _hull(vertices: Array) -> coal.Convex:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    place = {int(k): i for i, k in enumerate(hull.vertices)}
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for k in hull.vertices:
        points.append(vertices[k])
    p, q, r = np.moveaxis(vertices[hull.simplices], 1, 0)
    inwards = np.einsum("ki,ki->k", np.cross(q - p, r - p), hull.equations[:, :3]) <= 0
    simplices = hull.simplices.copy()
    simplices[inwards, 1:] = simplices[inwards, :0:-1]
    for a, b, c in simplices.tolist():
        triangles.append(coal.Triangle(place[a], place[b], place[c]))
    return coal.Convex(points, triangles)


def clearance(
    mechanism: Mechanism, link_poses: Mapping[str, Array], progress: Callable[[float], None] | None = None
) -> Clearance:
    """Return the minimum clearances between the meshes of a mechanism.

    A measured distance minus the subsequent motion of both bodies is a lower bound of their distance. The pair is
    measured again only if this bound is below the smallest distance already measured at the sample.

    Args:
        mechanism: the mechanism, with the meshes of its bodies.
        link_poses: T_base_body (k, 4, 4) by name of the body.
        progress: called with the fraction done.
    """
    distance, pair = _track(apart(mechanism), link_poses, progress)
    return Clearance(distance, pair, _contacts(mechanism, _jointed(mechanism), link_poses))


def apart(mechanism: Mechanism) -> list[tuple[Shape, Shape]]:
    """Return all pairs of shapes whose bodies no joint connects, directly or over bodies without shape."""
    whole = [Shape(b.name, b.name, b.meshes) for b in mechanism.bodies if b.meshes]
    jointed = _jointed(mechanism)
    return [(a, b) for a, b in combinations(whole, 2) if frozenset((a.body, b.body)) not in jointed]


def _jointed(mechanism: Mechanism) -> set[frozenset[str]]:
    """Return the pairs of bodies that a joint connects, or a chain of joints over bodies without shape.

    An import inserts such bodies: between two hinges of one body, or for a link that only holds a frame. A free joint
    connects nothing. The base is no part of a chain: it holds bodies that are apart.
    """
    direct = [frozenset((j.parent, j.child)) for j in mechanism.joints if j.type != "free"]
    for body in mechanism.bodies:
        at = [pair for pair in direct if body.name in pair]
        if body.meshes or body.name == mechanism.base or len(at) != 2:
            continue
        beyond = (at[0] | at[1]) - {body.name}
        direct = [pair for pair in direct if pair not in at]
        if len(beyond) == 2:
            direct.append(beyond)
    return set(direct)


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
    shapes = {
        n: [Shape(f"{n}/{b.name}", f"{n}/{b.name}", b.meshes) for b in m.bodies if b.meshes]
        for n, m in mechanisms.items()
    }
    poses = {f"{n}/{b}": T for n, links in link_poses.items() for b, T in links.items()}
    out = {}
    for m, n in combinations(mechanisms, 2):
        pairs = [(a, b) for a, b in product(shapes[m], shapes[n]) if frozenset((a.name, b.name)) not in touching]
        out[m, n] = Clearance(*_track(pairs, poses, None), ())
    return out


def _contacts(
    mechanism: Mechanism, jointed: set[frozenset[str]], link_poses: Mapping[str, Array]
) -> tuple[tuple[int, str, str], ...]:
    """Return (sample, part, part) of collisions of jointed bodies; parts that mate or touch in the CAD are skipped."""
    mating = {frozenset(p) for j in mechanism.joints for p in combinations(j.mating, 2)}
    found = []
    for a, b in (tuple(sorted(p)) for p in sorted(jointed, key=sorted)):
        # All poses are relative to a, so only b moves.
        T_a_b = (spatial.inverse(link_poses[a]) @ link_poses[b])[::_EVERY]
        T_drawn = spatial.inverse(mechanism.rest.get(a, link_poses[a][0])) @ mechanism.rest.get(b, link_poses[b][0])
        here = [Shape(m.name, a, [m]) for m in mechanism.body(a).meshes]
        there = [Shape(m.name, b, [m]) for m in mechanism.body(b).meshes]
        for q in there:
            corners, drawn = q.corners_in(T_a_b), q.corners_in(T_drawn[None])
            way = np.linalg.norm(corners - drawn, axis=-1).max(axis=-1)
            for p in here:
                own = p.corners_in(np.eye(4)[None])[0]
                apart = box_gap(own.min(axis=0), own.max(axis=0), drawn[0].min(axis=0), drawn[0].max(axis=0))
                if way.max() < apart or frozenset((p.name, q.name)) in mating:
                    continue
                apart = distance_between(p, q, np.eye(4), T_drawn)
                if apart <= TOUCHING:
                    continue
                k = 0
                while way[k:].max() >= apart > 0:
                    k += int(np.argmax(way[k:] >= apart))  # before this sample, b has moved too little to touch a
                    apart = distance_between(p, q, np.eye(4), T_a_b[k])
                    way = np.linalg.norm(corners - corners[k], axis=-1).max(axis=-1)
                if apart <= 0:
                    found.append((k * _EVERY, p.name, q.name))
    return tuple(found)


_EVERY = 5
"""Interval in samples between tests of the parts of jointed bodies, whose relative motion is slow."""


def _way(a: Shape, b: Shape, link_poses: Mapping[str, Array], since: int = 0) -> Array:
    """Return an upper bound (k,) in m of the motion of b relative to a after sample `since`."""
    corners = b.corners_in(spatial.inverse(link_poses[a.body]) @ link_poses[b.body])
    return np.linalg.norm(corners - corners[since], axis=-1).max(axis=-1)


def box_gap(low_a: Array, high_a: Array, low_b: Array, high_b: Array) -> Array:
    """Return the distance (...) in m between boxes with corners (..., 3): a lower bound for shapes inside the boxes."""
    return np.linalg.norm(np.maximum(np.maximum(low_a - high_b, low_b - high_a), 0), axis=-1)


def _track(
    pairs: list[tuple[Shape, Shape]],
    link_poses: Mapping[str, Array],
    progress: Callable[[float], None] | None,
) -> tuple[Array, tuple[tuple[str, str], ...]]:
    count = len(next(iter(link_poses.values())))
    if not pairs:
        return np.full(count, np.inf), (("", ""),) * count
    first = np.array([_first_bound(a, b, link_poses) for a, b in pairs])
    # Lower bound of each pair's distance at all samples: the last measured distance minus the relative motion after it.
    bounds = np.array([d - _way(a, b, link_poses) for d, (a, b) in zip(first, pairs, strict=True)])
    distance, nearest = np.zeros(count), []
    for k in range(count):
        best, best_pair = np.inf, pairs[0]
        for i in np.argsort(bounds[:, k]):
            if bounds[i, k] >= best:
                break
            a, b = pairs[i]
            found = distance_between(a, b, link_poses[a.body][k], link_poses[b.body][k])
            bounds[i] = found - _way(a, b, link_poses, since=k)
            if found < best:
                best, best_pair = found, (a, b)
        distance[k] = best
        nearest.append((best_pair[0].name, best_pair[1].name))
        if progress is not None:
            progress((k + 1) / count)
    return distance, tuple(nearest)


def _first_bound(a: Shape, b: Shape, link_poses: Mapping[str, Array]) -> float:
    """Return the distance in m between the bounding boxes at the first sample."""
    ca, cb = a.corners_in(link_poses[a.body][:1])[0], b.corners_in(link_poses[b.body][:1])[0]
    return float(box_gap(ca.min(axis=0), ca.max(axis=0), cb.min(axis=0), cb.max(axis=0)))


def distance_between(a: Shape, b: Shape, Ta: Array, Tb: Array, most: float = np.inf) -> float:
    """Return the distance in m between two meshes at poses (4, 4), but at most `most`; 0 if they collide.

    coal skips all parts that are farther apart than the smallest known distance; this distance is `most` at first. With
    a small `most`, the computation is faster than coal's collision test with a margin: that test is slow for meshes
    that are close everywhere.
    """
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    result.min_distance = min(most, result.min_distance)
    coal.distance(a.model, placed(Ta), b.model, placed(Tb), request, result)
    return max(0.0, float(result.min_distance))


def placed(T: Array) -> coal.Transform3s:
    """Return a pose (4, 4) as a transform of the package coal."""
    return coal.Transform3s(np.ascontiguousarray(T[:3, :3]), T[:3, 3])
