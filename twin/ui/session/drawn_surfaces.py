"""Surfaces of simple solids of which surroundings are drawn: box, rod, ball, dome, cylinder, limb, bed and drape.

A surface is made of rings of points about an axis (rod, cylinder, limb), of points of equal latitude (ball, dome), or
of rows and columns of points (bed, drape).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from math import cos, pi, sin

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array

Surface = tuple[Array, np.ndarray]
"""Points (n, 3), and triangles (m, 3) that are counter-clockwise seen from outside."""

_AZIMUTH_FACETS = 40
"""Number of facets of an ellipsoid around its axis."""

_POLAR_FACETS = 20
"""Number of facets of an ellipsoid from pole to pole."""

_LIMB_STEPS = 6
"""Number of facets of a limb from one of its points to the next."""

_LIMB_FACETS = 16
"""Number of facets around a limb."""

_CAP_RINGS = 4
"""Number of facets of each round end of a limb, from its edge to its pole."""

_POLE_RADIUS = 0.02
"""Radius of the last ring of a round end, as a part of the limb's radius: almost a point, with triangles of an area."""

_MIN_LIMB_RADIUS = 0.2
"""Smallest radius of a limb between its points, as a part of the smallest radius at its points."""

_SHEET_FACETS = 48
"""Facets of a bed or a drape along each side."""

_BED_WAVES = (0.011, 0.009)
"""Lengths in m by which the phases of the lobes of a bed grow by 1 rad, along x and along y; chosen by eye."""

_BED_CREST_WAVES = (0.017, 0.015)
"""The same for the waves of the crests of these lobes, along y and along x."""

_HEM_SHARE = 0.45
"""Height of the sides of a drape that hang down straight, as a part of its height."""

_FOLD_DEPTH = 0.008
"""Depth in m of the folds at the lower edges of a drape."""


def box(size: Array) -> Surface:
    """Return points and triangles of a box of a size (3,) in m about the origin."""
    points, triangles = _unit_cube()
    return points * 0.5 * size, triangles


def rod(ends: Array, diameter: float) -> Surface:
    """Return points and triangles of a cylinder between two points (2, 3), in m."""
    axis = ends[1] - ends[0]
    length = float(np.linalg.norm(axis))
    points, triangles = unit_cylinder()
    R = spatial.frame_from_axes(axis, spatial.unit_across(axis))
    sized = points * [0.5 * diameter, 0.5 * diameter, 0.5 * length]
    return sized @ R.T + ends.mean(axis=0), triangles


def limb(line: Array, widths: Array) -> Surface:
    """Return points and triangles of a round body along points (k, 3), with a diameter for each; the ends are round."""
    centres, radii = _smooth_curve(line, 0.5 * widths)
    directions = np.gradient(centres, axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rings = []
    across = spatial.unit_across(directions[0])
    for number, (centre, radius, axis) in enumerate(zip(centres, radii, directions, strict=True)):
        # the ring keeps its angle about the axis from point to point
        across = across - axis * (axis @ across)
        across /= np.linalg.norm(across)
        other = np.cross(axis, across)
        if number == 0:
            rings += _cap(centre, radius, -axis, across, other)[::-1]
        rings.append(_ring(centre, radius, across, other))
        if number == len(centres) - 1:
            rings += _cap(centre, radius, axis, across, other)
    return _closed_surface(rings)


def _smooth_curve(line: Array, radii: Array) -> tuple[Array, Array]:
    """Return points and radii of a smooth curve through the given points (a spline of Catmull and Rom)."""
    knots = np.column_stack([line, radii])
    # one more knot at each end, on the straight continuation: the spline needs a neighbour on both sides
    extended = np.vstack([2 * knots[0] - knots[1], knots, 2 * knots[-1] - knots[-2]])
    points = []
    for k in range(len(knots) - 1):
        a, b, c, d = extended[k : k + 4]  # the curve from b to c
        cubic = -a + 3 * b - 3 * c + d
        square = 2 * a - 5 * b + 4 * c - d
        for t in np.arange(_LIMB_STEPS) / _LIMB_STEPS:
            points.append(0.5 * (2 * b + (c - a) * t + square * t**2 + cubic * t**3))
    points.append(knots[-1])
    curve = np.array(points)
    return curve[:, :3], np.maximum(curve[:, 3], _MIN_LIMB_RADIUS * radii.min())


def _ring(centre: Array, radius: float, across: Array, other: Array) -> Array:
    angles = 2 * pi * np.arange(_LIMB_FACETS) / _LIMB_FACETS
    return centre + radius * (np.outer(np.cos(angles), across) + np.outer(np.sin(angles), other))


def _cap(centre: Array, radius: float, axis: Array, across: Array, other: Array) -> list[Array]:
    """Return the rings of a half ball, from its edge to its pole."""
    rings = []
    for k in range(1, _CAP_RINGS + 1):
        angle = 0.5 * pi * k / _CAP_RINGS
        middle = centre + radius * sin(angle) * axis
        rings.append(_ring(middle, radius * max(cos(angle), _POLE_RADIUS), across, other))
    return rings


def _closed_surface(rings: Sequence[Array]) -> Surface:
    """Return the surface through rings of equal numbers of points, closed at both ends."""
    ring_points = len(rings[0])
    first_centre = rings[0].mean(axis=0)
    last_centre = rings[-1].mean(axis=0)
    points = np.concatenate([*rings, first_centre[None], last_centre[None]])
    # indices in a ring: of each point, and of the next point around the ring
    first = np.arange(ring_points)
    after = (first + 1) % ring_points
    faces = []
    for i in range(len(rings) - 1):
        lower = i * ring_points
        upper = lower + ring_points
        faces.append(np.column_stack([lower + first, lower + after, upper + after]))
        faces.append(np.column_stack([lower + first, upper + after, upper + first]))
    centre = np.full(ring_points, len(rings) * ring_points)
    last = (len(rings) - 1) * ring_points
    faces.append(np.column_stack([centre, after, first]))
    faces.append(np.column_stack([centre + 1, last + first, last + after]))
    return points, np.concatenate(faces).astype(np.int32)


def _sheet_surface(points: Array) -> Surface:
    """Return a surface through points (rows, columns, 3); seen from above, rows go to +y and columns to +x."""
    rows, columns, _ = points.shape
    indices = np.arange(rows * columns).reshape(rows, columns)
    # the corners of each quad, counter-clockwise
    a = indices[:-1, :-1].ravel()
    b = indices[:-1, 1:].ravel()
    c = indices[1:, 1:].ravel()
    d = indices[1:, :-1].ravel()
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return points.reshape(-1, 3), triangles.astype(np.int32)


def bed(size: Array) -> Surface:
    """Return a rough oval ground of a size (3,) in m: lobes of fat, and a rim that falls to the lower side."""
    side = np.linspace(-1, 1, _SHEET_FACETS + 1)
    u, v = np.meshgrid(side, side)
    # the square u, v becomes an ellipse, whose rim is the rim of the square
    x = 0.5 * size[0] * u * np.sqrt(1 - 0.5 * v**2)
    y = 0.5 * size[1] * v * np.sqrt(1 - 0.5 * u**2)
    # waves of some centimetres, along x and along y, whose crests are waves themselves
    waves_x = np.sin(x / _BED_WAVES[0] + 1.3 * np.sin(y / _BED_CREST_WAVES[0]))
    waves_y = np.sin(y / _BED_WAVES[1] + 1.1 * np.sin(x / _BED_CREST_WAVES[1]))
    lobes = 0.35 * waves_x + 0.3 * waves_y
    # 1 inside, 0 at the rim
    rim = np.clip(4 * (1 - np.maximum(np.abs(u), np.abs(v))), 0, 1)
    z = size[2] * rim * (0.65 + 0.5 * lobes)
    return _sheet_surface(np.stack([x, y, z], axis=-1))


def drape(size: Array) -> Surface:
    """Return a cloth of a size (3,) in m over something round: an arch, with folds where it hangs down."""
    width, length, height = size
    # the cross section: a quarter of its facets for each side that hangs down, the others for the arch
    hanging = _SHEET_FACETS // 4
    angles = np.linspace(pi, 0, _SHEET_FACETS + 1 - 2 * hanging)
    arch_x = 0.5 * width * np.sign(np.cos(angles)) * np.abs(np.cos(angles)) ** 0.7
    hem = _HEM_SHARE * height
    arch_z = hem + (1 - _HEM_SHARE) * height * np.sin(angles) ** 0.8
    down = np.linspace(0, hem, hanging + 1)[:-1]
    x = np.concatenate([np.full(hanging, -0.5 * width), arch_x, np.full(hanging, 0.5 * width)])
    z = np.concatenate([down, arch_z, down[::-1]])
    along = np.linspace(-1, 1, _SHEET_FACETS + 1)
    y = 0.5 * length * along
    # it falls to the ground at both ends
    rise = (1 - np.abs(along) ** 10) ** 0.5
    # deepest at the lower edges, none at the arch
    depth = np.clip(1 - z / hem, 0, 1)
    folds = np.sin(y / 0.019) + 0.5 * np.sin(y / 0.008 + 1.0)
    x_all = x[None, :] + _FOLD_DEPTH * np.sign(x)[None, :] * folds[:, None] * depth[None, :]
    y_all = np.broadcast_to(y[:, None], x_all.shape)
    z_all = z[None, :] * rise[:, None]
    return _sheet_surface(np.stack([x_all, y_all, z_all], axis=-1))


def unit_ball(half: bool) -> Surface:
    """Return a ball of radius 1, or its closed upper half."""
    rows = _POLAR_FACETS
    span = pi
    rings = rows - 1
    lower_pole = (0.0, 0.0, -1.0)
    if half:
        rows = _POLAR_FACETS // 2
        span = pi / 2
        rings = rows  # one ring more: its edge
        lower_pole = (0.0, 0.0, 0.0)
    points = [(0.0, 0.0, 1.0)]
    for i in range(1, rings + 1):
        polar = span * i / rows
        for k in range(_AZIMUTH_FACETS):
            azimuth = 2 * pi * k / _AZIMUTH_FACETS
            points.append((sin(polar) * cos(azimuth), sin(polar) * sin(azimuth), cos(polar)))
    points.append(lower_pole)
    # indices in a ring: of each point, and of the next point around the ring
    k = np.arange(_AZIMUTH_FACETS)
    after = (k + 1) % _AZIMUTH_FACETS
    upper_index = np.zeros_like(k)
    lower_index = np.full_like(k, len(points) - 1)
    faces = [np.column_stack([upper_index, 1 + k, 1 + after])]
    for i in range(rings - 1):
        upper = 1 + i * _AZIMUTH_FACETS
        lower = upper + _AZIMUTH_FACETS
        faces.append(np.column_stack([upper + k, lower + k, lower + after]))
        faces.append(np.column_stack([upper + k, lower + after, upper + after]))
    edge = 1 + (rings - 1) * _AZIMUTH_FACETS
    faces.append(np.column_stack([edge + k, lower_index, edge + after]))
    return np.array(points), np.concatenate(faces).astype(np.int32)


def unit_cylinder() -> Surface:
    """Return a cylinder of radius 1 from z = -1 to z = 1."""
    angles = 2 * pi * np.arange(_AZIMUTH_FACETS) / _AZIMUTH_FACETS
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_AZIMUTH_FACETS)])
    up = np.array([0.0, 0.0, 1.0])
    return _closed_surface([circle - up, circle + up])


def _unit_cube() -> Surface:
    """Return a cube with edges of length 2."""
    points = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)], np.int32)
    # two triangles for each quad
    return points, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
