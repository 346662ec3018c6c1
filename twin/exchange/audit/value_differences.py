"""Differences of the values that files state: numbers, words, limits, tensors, axes, poses, surfaces."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

Value = Any
"""Value of a compared quantity: a truth value, number, text, tuple, array, or mapping; `QUANTITIES` says which."""

SAME_POINT_TOL = 3e-6
"""Distance in m below which two points count as equal, despite rounding to 0.001 mm and to single precision."""

SLENDER_WEIGHT = 2e-3
"""Weight of a relative difference of moments of inertia: at the tolerance 1e-5 of an inertia it is 0.5 %."""

ANGLE_ARM = 0.1
"""Distance in m by which an angle between poses counts as a length: about the size of a link."""


def number_difference(a: float, b: float) -> float:
    """Return the difference of two numbers, relative to the larger one."""
    if a == b:  # also two infinite limits
        return 0.0
    if not (np.isfinite(a) and np.isfinite(b)):
        return np.inf
    return abs(a - b) / max(abs(a), abs(b))


def row_difference(a: Mapping[str, float], b: Mapping[str, float]) -> float:
    """Return the relative difference between two mappings {joint: factor}; a missing joint has the factor 0."""
    joints = dict.fromkeys((*a, *b))
    factors = np.zeros((len(joints), 2))
    for i, joint in enumerate(joints):
        factors[i] = (a.get(joint, 0.0), b.get(joint, 0.0))
    size = float(np.linalg.norm(factors, axis=0).max(initial=0.0))
    if not size:
        return 0.0
    difference = factors[:, 0] - factors[:, 1]
    return float(np.linalg.norm(difference)) / size


def coordinate_difference(a: Mapping[str, float], b: Mapping[str, float]) -> float:
    """Return the largest difference of two mappings {joint: coordinate}; infinite if they have other joints."""
    if a.keys() != b.keys():
        return np.inf
    largest = 0.0
    for joint in a:
        largest = max(largest, abs(a[joint] - b[joint]))
    return largest


def word_difference(a: Value, b: Value) -> float:
    """Return 0 if two values are equal, else 1: words have no distance."""
    return float(a != b)


def name_difference(a: str, b: str) -> float:
    """Return 0 if two names are equal in letters and digits: formats allow different other characters."""
    return word_difference(re.sub(r"\W", "_", a), re.sub(r"\W", "_", b))


def limit_difference(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the larger difference of two limits; if both are above 1 m or 1 rad, relative to the smaller of them."""
    differences = []
    for x, y in zip(a, b, strict=True):
        if x == y:  # two infinite limits: their difference is not a number
            differences.append(0.0)
            continue
        smaller = min(abs(x), abs(y))
        differences.append(abs(x - y) / max(1.0, smaller))
    return max(differences)


def largest_difference(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the largest difference of two entries, each in its own unit."""
    return float(np.abs(np.subtract(a, b)).max())


def distance(a: Array | float, b: Array | float) -> float:
    """Return the distance of two points or vectors (n,), or of two numbers, in their unit."""
    return float(np.linalg.norm(np.subtract(a, b)))


def ratio_difference(a: Array, b: Array) -> float:
    """Return the distance between the ratios of two couplings; infinite if they couple other numbers of joints."""
    if a.shape != b.shape:
        return np.inf
    return distance(a, b)


def inertia_difference(a: Array, b: Array) -> float:
    """Return the larger of the differences of entries, and of moments by `SLENDER_WEIGHT`, of two tensors (3, 3).

    Entries differ relative to the largest one, because products of inertia are small; moments relative to the moment
    about the same axis, because a slender link has a small one about its length. Rounding to six digits turns the axes
    of a tensor and so changes a small moment more.
    """
    return max(entry_difference(a, b), SLENDER_WEIGHT * moment_difference(a, b))


def entry_difference(a: Array, b: Array) -> float:
    """Return the largest difference of two entries of matrices, relative to the largest entry."""
    # Two matrices of zeros are equal: they must not divide by zero.
    largest = max(np.abs(a).max(), np.abs(b).max(), 1e-300)
    return float(np.abs(a - b).max() / largest)


def moment_difference(a: Array, b: Array) -> float:
    """Return the largest relative difference of the moments about an axis; 0 if the first tensor has none about some.

    With a = L L', it is the largest eigenvalue of L^-1 (b - a) L'^-1, by size.
    """
    try:
        L = np.linalg.cholesky((a + a.T) / 2)
    except np.linalg.LinAlgError:  # not positive: reported by itself
        return 0.0
    inverse = np.linalg.inv(L)
    scaled = inverse @ (b - a) @ inverse.T
    return float(np.abs(np.linalg.eigvalsh((scaled + scaled.T) / 2)).max())


def direction_difference(a: Array, b: Array) -> float:
    """Return the distance between two unit vectors (3,); their sign is ignored."""
    return min(distance(a, b), float(np.linalg.norm(a + b)))


def axis_difference(a: tuple[Array, bool], b: tuple[Array, bool]) -> float:
    """Return the distance between two unit vectors (3,); signs count if both vectors come with True."""
    first, first_signed = a
    second, second_signed = b
    if first_signed and second_signed:
        return distance(first, second)
    return direction_difference(first, second)


def line_difference(a: tuple[Array, Array | None], b: tuple[Array, Array | None]) -> float:
    """Return the distance in m from b's point to line a; if a or b has no direction, the distance of their points.

    A line is a point (3,) with a direction (3,) of unit length, or None.
    """
    point, direction = a
    other_point, other_direction = b
    shift = other_point - point
    if direction is None or other_direction is None:
        return float(np.linalg.norm(shift))
    return float(np.linalg.norm(np.cross(direction, shift)))


def pose_difference(a: Array, b: Array) -> float:
    """Return the larger of the distance in m and of `ANGLE_ARM` times the angle in rad between two poses (4, 4)."""
    shift, angle = shift_and_angle(a, b)
    return max(shift, ANGLE_ARM * angle)


def shift_and_angle(a: Array, b: Array) -> tuple[float, float]:
    """Return the distance in m and the angle in rad between two poses (4, 4)."""
    return distance(a[:3, 3], b[:3, 3]), float(poses.angle(a[:3, :3], b[:3, :3]))


def surface_difference(a: Array, b: Array) -> float:
    """Return the Hausdorff distance in m between the points of two meshes.

    Return 0 if fewer than 70 % of the points of a mesh coincide with points of the other (20 % if both have as many
    points): the meshes then have different triangles, and only `compare_shapes` compares them, by bounding box and
    volume.
    """
    if a.shape == b.shape and np.array_equal(a, b):
        return 0.0
    to_b = _nearest(a, b)
    to_a = _nearest(b, a)
    coinciding = min(np.mean(to_b < SAME_POINT_TOL), np.mean(to_a < SAME_POINT_TOL))
    least_coinciding = 0.2 if len(a) == len(b) else 0.7
    if coinciding < least_coinciding:
        return 0.0
    return float(max(to_b.max(), to_a.max()))


def _nearest(points: Array, others: Array) -> Array:
    """Return the distances (n,) in m of points (n, 3) from the nearest of the other points (m, 3)."""
    # A tree that is neither balanced nor compact is built several times faster, and is asked only once.
    tree = KDTree(others, balanced_tree=False, compact_nodes=False)
    distances, _ = tree.query(points)
    return distances
