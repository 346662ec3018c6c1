"""Draw a part of a scene as a camera sees it, by a rasteriser with a depth buffer and 8 samples per pixel.

Only a box of the picture is drawn, the box around one surface, the target. It contains this surface and everything that
is not farther away. The rasteriser needs no graphics driver, and draws the same picture on every machine. It shares no
code with the projection in `projected_side`.

The camera's z is along the view, its x and y are along columns and rows of the picture. A corner of a triangle in the
picture is (column, row, inverse depth): position in pixels from the upper left, and 1 / z in 1/m. Inverse depth is
linear over a triangle in the picture, which depth is not; it is larger where a surface is nearer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array

SIZE = (960, 720)
"""Width and height of the picture in pixels."""

_NEAR = 3e-3
"""Smallest drawn distance in m from the lens."""

_MARGIN = 6
"""Width in pixels of the drawn margin around the target."""

_SAMPLES = 8
"""Number of samples in a pixel."""

_SAMPLE_ROWS = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
"""Rows of the samples in a pixel, from 0 to 1. All samples are on the vertical centre line of the pixel. There, the row
of an edge is measured to an eighth of a pixel at every slope; samples that are spread over the width do not achieve
this."""

_AMBIENT = 0.3
"""Brightness, as a share, of a triangle that the light along the view only grazes."""

_NOTHING = -1
"""Index of the surface at a sample where nothing is drawn."""

_SMALLEST_AREA = 1e-12
"""Area in square pixels below which a triangle is seen from its edge."""


@dataclass(frozen=True)
class ColouredSurface:
    """Triangles of one colour.

    Attributes:
        owner: what the surface is a part of, such as the name of a robot.
        name: name of the surface.
        vertices: (n, 3) in m in the World.
        triangles: (m, 3) indices of vertices, counter-clockwise as seen from outside.
        rgb: (3,) linear colour.
    """

    owner: str
    name: str
    vertices: Array
    triangles: np.ndarray
    rgb: Sequence[float]


@dataclass(frozen=True)
class Picture:
    """A picture in which only the box around one surface is drawn.

    Attributes:
        rgb: (height, width, 3) linear colours; 0 outside the box.
        covered: {owner: fraction of the surface that is hidden by nearer surfaces of this owner}.
    """

    rgb: Array
    covered: dict[str, float]


def draw(surfaces: Sequence[ColouredSurface], target: str, T_world_camera: Array, view: float) -> Picture:
    """Draw the box around a surface; where the surface is not in the picture, nothing is drawn.

    Args:
        surfaces: everything that the camera can see.
        target: name of the surface.
        T_world_camera: (4, 4) pose of the camera: z along the view, y down in the picture.
        view: angle of view over the height of the picture, in rad.
    """
    width, height = SIZE
    rgb = np.zeros((height, width, 3))
    focal_length = height / 2 / np.tan(view / 2)  # in pixels
    triangles = _project(surfaces, T_world_camera, focal_length)
    is_target_surface = np.array([surface.name == target for surface in surfaces])
    is_target = is_target_surface[triangles.surface]
    if not is_target.any():
        return Picture(rgb, {})
    target_corners = triangles.corners[is_target]
    low, high = _box_around(target_corners)
    if (high <= low).any():
        return Picture(rgb, {})
    is_drawn = _overlap(triangles.corners, low, high)
    farthest_target = target_corners[..., 2].min()
    may_cover = _may_be_nearer(triangles.corners[is_drawn], low, high, farthest_target)
    is_drawn[is_drawn] = is_target[is_drawn] | may_cover
    seen = _Samples(low, high)
    target_alone = _Samples(low, high)  # the target as it looks without the other surfaces
    for k in np.flatnonzero(is_drawn):
        seen.draw(triangles.corners[k], triangles.surface[k], triangles.shade[k])
        if is_target[k]:
            target_alone.draw(triangles.corners[k], triangles.surface[k], triangles.shade[k])
    colors = np.zeros((len(surfaces) + 1, 3))  # the last row, which the index `_NOTHING` selects, is black
    for i, surface in enumerate(surfaces):
        colors[i] = surface.rgb[:3]
    sample_colors = colors[seen.surface] * seen.shade[..., None]
    rgb[low[1] : high[1], low[0] : high[0]] = sample_colors.mean(axis=0)
    return Picture(rgb, _covered(surfaces, seen, target_alone))


def _covered(surfaces: Sequence[ColouredSurface], seen: _Samples, target_alone: _Samples) -> dict[str, float]:
    """Return {owner: fraction of the samples in `target_alone` that show a surface of this owner in `seen` instead}."""
    shows_target = target_alone.surface != _NOTHING
    is_hidden = shows_target & (seen.surface != target_alone.surface)
    owner_of_surface = np.array([surface.owner for surface in surfaces])
    hiding_owners = owner_of_surface[seen.surface[is_hidden]]
    covered: dict[str, float] = {}
    for owner in np.unique(hiding_owners):
        covered[str(owner)] = float((hiding_owners == owner).sum() / shows_target.sum())
    return covered


# ---------------------------------------------------------------------------------------- triangles in the picture


@dataclass(frozen=True)
class _PictureTriangles:
    """k triangles in the picture.

    Attributes:
        surface: (k,) index of the surface of each triangle.
        corners: (k, 3, 3) three corners each: column, row, inverse depth.
        shade: (k,) brightness from `_AMBIENT` to 1.
    """

    surface: np.ndarray
    corners: Array
    shade: Array


def _project(surfaces: Sequence[ColouredSurface], T_world_camera: Array, focal_length: float) -> _PictureTriangles:
    """Return the triangles that face the lens; one that reaches behind the lens is cut. `focal_length` is in pixels."""
    indices = []
    world_corners = []
    for i, surface in enumerate(surfaces):
        indices.append(np.full(len(surface.triangles), i))
        world_corners.append(surface.vertices[surface.triangles])
    surface_index = np.concatenate(indices)
    corners = np.concatenate(world_corners) - T_world_camera[:3, 3]
    corners = corners @ T_world_camera[:3, :3]  # (k, 3, 3) in m in the frame of the camera
    is_facing = np.sum(_normals(corners) * corners[:, 0], axis=1) < 0
    surface_index = surface_index[is_facing]
    corners = corners[is_facing]
    is_before_lens = corners[..., 2] > _NEAR
    is_whole = is_before_lens.all(axis=1)
    is_cut = is_before_lens.any(axis=1) & ~is_whole
    cut_indices: list[int] = []
    cut_corners: list[Array] = []
    for k in np.flatnonzero(is_cut):
        for triangle in _parts_before_lens(corners[k]):
            cut_indices.append(surface_index[k])
            cut_corners.append(triangle)
    surface_index = np.concatenate([surface_index[is_whole], np.array(cut_indices, int)])
    corners = np.concatenate([corners[is_whole], np.reshape(cut_corners, (-1, 3, 3))])
    normals = _normals(corners)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)  # not 0, by which it is divided
    shade = _AMBIENT + (1 - _AMBIENT) * np.abs(normals[:, 2]) / lengths  # light along the view
    depths = corners[..., 2:]
    pixels = focal_length * corners[..., :2] / depths + np.array(SIZE) / 2
    return _PictureTriangles(surface_index, np.concatenate([pixels, 1 / depths], axis=-1), shade)


def _normals(corners: Array) -> Array:
    """Return the normals (k, 3), not of unit length, of triangles (k, 3, 3)."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _parts_before_lens(corners: Array) -> Iterator[Array]:
    """Cut a triangle (3, 3), in m in the frame of the camera, at `_NEAR`; yield the triangles of its farther part."""
    outline: list[Array] = []  # of the farther part: three or four corners
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] > _NEAR:
            outline.append(a)
        if (a[2] > _NEAR) != (b[2] > _NEAR):
            outline.append(a + (b - a) * (_NEAR - a[2]) / (b[2] - a[2]))
    for k in range(1, len(outline) - 1):
        yield np.array([outline[0], outline[k], outline[k + 1]])


# ------------------------------------------------------------------------------------------ what is in the box


def _box_around(corners: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return first and last (excluded) column and row (2,) of the box around triangles (k, 3, 3), with a margin.

    Where the triangles are outside of the picture, the last is not greater than the first.
    """
    top_left = np.floor(corners[..., :2].min(axis=(0, 1))).astype(int)
    bottom_right = np.ceil(corners[..., :2].max(axis=(0, 1))).astype(int)
    low = np.clip(top_left - _MARGIN, 0, SIZE)
    high = np.clip(bottom_right + _MARGIN, 0, SIZE)
    return low, high


def _overlap(corners: Array, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return (k,) bool: whether the box around each triangle (k, 3, 3) overlaps the box from `low` to `high` (2,)."""
    ends_after_low = (corners[..., :2].max(axis=1) > low).all(axis=1)
    begins_before_high = (corners[..., :2].min(axis=1) < high).all(axis=1)
    return ends_after_low & begins_before_high


def _may_be_nearer(corners: Array, low: np.ndarray, high: np.ndarray, inverse_depth: float) -> np.ndarray:
    """Return (k,) bool: whether a triangle (k, 3, 3) may be nearer than `inverse_depth` (1/m) inside the box.

    The plane of the triangle is asked at the corners of the box, and the triangle at its own corners: where neither is
    nearer, no point of the triangle in the box is.
    """
    a = corners[:, 0]
    b = corners[:, 1] - a
    c = corners[:, 2] - a
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    # a triangle seen from its edge has no slope in the picture: its inverse depth is that of `a`
    area = np.where(np.abs(area) < _SMALLEST_AREA, np.inf, area)
    per_column = (b[:, 2] * c[:, 1] - c[:, 2] * b[:, 1]) / area
    per_row = (c[:, 2] * b[:, 0] - b[:, 2] * c[:, 0]) / area
    nearest_in_plane = np.full(len(corners), -np.inf)
    for column in (low[0], high[0]):
        for row in (low[1], high[1]):
            at_box_corner = a[:, 2] + per_column * (column - a[:, 0]) + per_row * (row - a[:, 1])
            nearest_in_plane = np.maximum(nearest_in_plane, at_box_corner)
    nearest_corner = corners[..., 2].max(axis=1)
    return (nearest_in_plane > inverse_depth) & (nearest_corner > inverse_depth)


class _Samples:
    """The samples of a box of the picture, into which triangles are drawn.

    Attributes:
        low, high: (2,) first and last (excluded) column and row of the box.
        surface: (samples, rows, columns) index of the nearest surface; `_NOTHING` where none is drawn.
        shade: (samples, rows, columns) brightness of its triangle.
    """

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        self.low = low
        self.high = high
        shape = (_SAMPLES, high[1] - low[1], high[0] - low[0])
        self.surface = np.full(shape, _NOTHING)
        self.shade = np.zeros(shape)
        self._inverse_depth = np.zeros(shape)  # infinitely far

    def draw(self, triangle: Array, surface: int, shade: float) -> None:
        """Draw a triangle (3, 3) where it is nearer than the surfaces drawn before.

        Args:
            triangle: its three corners: column, row, inverse depth.
            surface: index of its surface.
            shade: its brightness.
        """
        lowest = np.floor(triangle[:, :2].min(axis=0)).astype(int)
        highest = np.ceil(triangle[:, :2].max(axis=0)).astype(int)
        begin = np.maximum(lowest, self.low)
        end = np.minimum(highest, self.high)
        a, b, c = triangle[:, :2]
        inverse_depth_a, inverse_depth_b, inverse_depth_c = triangle[:, 2]
        double_area = _cross(b - a, c - a)
        if (end <= begin).any() or double_area == 0.0:
            return
        x = np.arange(begin[0], end[0])[None, None, :] + 0.5
        y = np.arange(begin[1], end[1])[None, :, None] + _SAMPLE_ROWS[:, None, None]
        # barycentric coordinates of every sample: the weights of the corners
        weight_a = ((c[0] - b[0]) * (y - b[1]) - (c[1] - b[1]) * (x - b[0])) / double_area
        weight_b = ((a[0] - c[0]) * (y - c[1]) - (a[1] - c[1]) * (x - c[0])) / double_area
        weight_c = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / double_area
        is_inside = (weight_a >= 0) & (weight_b >= 0) & (weight_c >= 0)
        inverse_depth = weight_a * inverse_depth_a + weight_b * inverse_depth_b + weight_c * inverse_depth_c
        first = begin - self.low
        last = end - self.low
        window = np.s_[:, first[1] : last[1], first[0] : last[0]]
        is_front = is_inside & (inverse_depth > self._inverse_depth[window])
        self._inverse_depth[window][is_front] = inverse_depth[is_front]
        self.surface[window][is_front] = surface
        self.shade[window][is_front] = shade


def _cross(a: Array, b: Array) -> float:
    """Return the cross product of two vectors (2,): twice the signed area of their triangle."""
    return float(a[0] * b[1] - a[1] * b[0])
