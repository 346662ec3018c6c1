"""Which hinge of a linkage is which hinge of a side that replaces its loops by couplings: by their places.

All hinges are parallel, so that only their places across the hinges are compared.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations, permutations

import numpy as np

from twin.comparison.side import Axis, RobotSide
from twin.core import spatial
from twin.core.spatial import Array

SAME_HINGE_DISTANCE = 2e-3
"""Distance in m up to which two hinges are taken for the same one, drawn inaccurately."""

PARALLEL_ANGLE = 1e-3
"""Angle in rad up to which hinges are parallel."""

_COINCIDENT_DISTANCE = 1e-6
"""Distance in m up to which the hinges on the base coincide as they are drawn."""

_SMALLEST_IMPROVEMENT = 1e-9
"""Distance in m by which a motion of the base must bring hinges closer, or the first motion stays."""

_MAX_BASE_HINGES = 6
"""Maximum number of hinges on the base whose assignments are tried."""


def base_motion(linkage: RobotSide, coupled: RobotSide) -> Array | None:
    """Return the motion (4, 4) of the linkage's base that brings the hinges on the base together.

    None if the sides have no two such hinges, or another number of them, or if they are too far apart.
    """
    own_hinges = _hinges_on_base(linkage)
    targets = _hinges_on_base(coupled)
    if len(own_hinges) < 2 or len(own_hinges) != len(targets) or len(own_hinges) > _MAX_BASE_HINGES:
        return None
    goal = _points(targets)
    along = targets[0].direction
    if _coincides_unmoved(own_hinges, goal, along):
        return np.eye(4)  # two hinges also coincide after half a turn about the line across them
    best: Array | None = None
    smallest_gap = np.inf
    for X, points in _base_motions(own_hinges, goal, along):
        gap = float(_distances_across(X, points, goal, along).sum())
        if gap < smallest_gap - _SMALLEST_IMPROVEMENT:
            smallest_gap = gap
            best = X
    return best


def _points(axes: Sequence[Axis]) -> Array:
    """Return a point (axes, 3) of each line in m."""
    return np.array([axis.point for axis in axes])


def _hinges_on_base(side: RobotSide) -> list[Axis]:
    """Return the joints of the tree that start at the base."""
    on_base = []
    for axis in side.tree:
        if axis.parent == 0:
            on_base.append(axis)
    return on_base


def _coincides_unmoved(hinges: Sequence[Axis], goal: Array, along: Array) -> bool:
    """Return whether the hinges of both sides coincide as they are drawn, in any order."""
    if abs(hinges[0].direction @ along) <= 1.0 - PARALLEL_ANGLE**2:
        return False
    smallest_gap = np.inf
    for ordered in permutations(hinges):
        distances = _distances_across(np.eye(4), _points(ordered), goal, along)
        smallest_gap = min(smallest_gap, float(distances.max()))
    return smallest_gap < _COINCIDENT_DISTANCE


def _base_motions(hinges: Sequence[Axis], goal: Array, along: Array) -> Iterator[tuple[Array, Array]]:
    """Yield (motion (4, 4), points (hinges, 3) of the hinges in the order of the goal) of each possible assignment.

    Two hinges that coincide are likelier than all that nearly do: each motion is that of two of the hinges.
    """
    for ordered in permutations(hinges):
        points = _points(ordered)
        # which way along the hinges is positive is not known
        for direction in (hinges[0].direction, -hinges[0].direction):
            of_all = _plane_fit(points, goal, direction, along)
            if _distances_across(of_all, points, goal, along).max() > SAME_HINGE_DISTANCE:
                continue
            for pair in combinations(range(len(points)), 2):
                pair_of_points = list(pair)
                yield _plane_fit(points[pair_of_points], goal[pair_of_points], direction, along), points


def nearest_hinge(axis: Axis, points: Array, used: Collection[int]) -> int | None:
    """Return the hinge of the linkage nearest to a hinge of the coupled side; None beyond `SAME_HINGE_DISTANCE`.

    `points` (joints, 3) are those of all hinges of the linkage, in the base of the coupled side; `used` are left out.
    """
    offsets = points - axis.point
    distances = np.linalg.norm(_parts_across(offsets, axis.direction), axis=1)
    for i in used:
        distances[i] = np.inf
    nearest = int(np.argmin(distances))
    if distances[nearest] > SAME_HINGE_DISTANCE:
        return None
    return nearest


def matched_links(
    linkage: RobotSide, coupled: RobotSide, partners: Mapping[int, int]
) -> tuple[dict[int, int], set[int]] | None:
    """Return ({group of the coupled side: group of the linkage}, hinges of the linkage that the coupled side holds).

    `partners` is {hinge of the coupled side: hinge of the linkage}. A hinge of the linkage between two links that are
    one link in the coupled side is held there. None if no single hinge connects such links.
    """
    groups = {0: 0}
    held_hinges: set[int] = set()
    matched = set(partners.values())
    for k, axis in enumerate(coupled.axes):
        partner = linkage.axes[partners[k]]
        start = groups[axis.parent]
        ends = (partner.parent, partner.child)
        if start not in ends:
            bridges = []
            for i, hinge in enumerate(linkage.tree):
                if i not in matched and hinge.parent == start and hinge.child in ends:
                    bridges.append(i)
            if len(bridges) != 1:
                return None
            held_hinges.add(bridges[0])
            start = linkage.tree[bridges[0]].child
        groups[axis.child] = ends[1] if ends[0] == start else ends[0]
    return groups, held_hinges


def _parts_across(offsets: Array, along: Array) -> Array:
    """Return the parts of offsets (n, 3) across a direction."""
    return offsets - np.outer(offsets @ along, along)


def _distances_across(X: Array, points: Array, goal: Array, along: Array) -> Array:
    """Return the distances (n,) of moved points from others; along the hinges, nothing is compared."""
    offsets = points @ X[:3, :3].T + X[:3, 3] - goal
    return np.linalg.norm(_parts_across(offsets, along), axis=1)


def _plane_fit(points: Array, goal: Array, direction: Array, target: Array) -> Array:
    """Return the motion (4, 4) that turns `direction` onto `target` and best brings points (n, 3) onto others."""
    R_direction = spatial.frame_from_axes(direction, spatial.unit_across(direction))
    R_target = spatial.frame_from_axes(target, spatial.unit_across(target))
    R0 = R_target @ R_direction.T
    centred_points = _parts_across((points - points.mean(axis=0)) @ R0.T, target)
    centred_goal = _parts_across(goal - goal.mean(axis=0), target)
    # cost of the angle about the hinges: constant - a cos - b sin
    a = float(np.sum(centred_points * centred_goal))
    b = float(np.sum(np.cross(centred_points, centred_goal) @ target))
    R = spatial.exp_so3(np.arctan2(b, a) * target) @ R0
    return spatial.pose(R, goal.mean(axis=0) - R @ points.mean(axis=0))
