"""Draw a part of a scene as a camera sees it, by a rasteriser with a depth buffer and 8 samples per pixel.

Only a box of the picture is drawn, the box around one surface. It contains this surface and everything that is not
farther away. The rasteriser needs no graphics driver, and draws the same picture on every machine. The rasteriser
shares no code with the projection in `projected_side`.
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
"""Width in pixels of the drawn margin around the surface."""

_SAMPLES = 8
"""Number of samples in a pixel."""

_AMBIENT = 0.3
"""Brightness, as a share, of a triangle that the light along the view only grazes."""

_ROWS = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
"""Heights of the samples in a pixel. All samples are on the vertical centre line of the pixel. There, the height of an
edge is measured to an eighth of a pixel at every slope; samples that are spread over the width do not achieve this."""


@dataclass(frozen=True)
class ColouredSurface:
    """Triangles of one colour: owner, name, corners (n, 3) in m in the World, indices (m, 3), linear colour (3,)."""

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


def draw(surfaces: Sequence[ColouredSurface], name: str, T_world_camera: Array, view: float) -> Picture:
    """Draw the box around a surface.

    Args:
        surfaces: everything that the camera can see.
        name: name of the surface.
        T_world_camera: (4, 4) pose of the camera: z along the view, y down in the picture.
        view: angle of view over the height of the picture, in rad.
    """
    width, height = SIZE
    picture = np.zeros((height, width, 3))
    focal = height / 2 / np.tan(view / 2)
    owner, flat, shade = _project(surfaces, T_world_camera, focal)
    is_target = np.array([surface.name == name for surface in surfaces])[owner]
    if not is_target.any():
        return Picture(picture, {})
    corners = flat[is_target]
    top_left = np.floor(corners[..., :2].min(axis=(0, 1))).astype(int)
    bottom_right = np.ceil(corners[..., :2].max(axis=(0, 1))).astype(int)
    low = np.clip(top_left - _MARGIN, 0, SIZE)
    high = np.clip(bottom_right + _MARGIN, 0, SIZE)
    if (high <= low).any():
        return Picture(picture, {})
    after_low = (flat[..., :2].max(axis=1) > low).all(axis=1)
    before_high = (flat[..., :2].min(axis=1) < high).all(axis=1)
    is_drawn = after_low & before_high
    is_drawn[is_drawn] = is_target[is_drawn] | _reaches(flat[is_drawn], low, high, corners[..., 2].min())
    box = _Box(low, high)
    alone = _Box(low, high)  # the surface as it looks without the others
    for k in np.flatnonzero(is_drawn):
        box.draw(flat[k], owner[k], shade[k])
        if is_target[k]:
            alone.draw(flat[k], owner[k], shade[k])
    colors = np.zeros((len(surfaces) + 1, 3))  # the last one, index -1: nothing
    for i, surface in enumerate(surfaces):
        colors[i] = surface.rgb[:3]
    samples = colors[box.owner] * box.shade[..., None]
    picture[low[1] : high[1], low[0] : high[0]] = samples.mean(axis=0)
    return Picture(picture, _covered(surfaces, box, alone))


def _covered(surfaces: Sequence[ColouredSurface], box: _Box, alone: _Box) -> dict[str, float]:
    """Return {owner: fraction of the samples in `alone` that show this owner in `box` instead}."""
    shows_surface = alone.owner >= 0
    hidden = shows_surface & (box.owner != alone.owner)
    owners = np.array([surface.owner for surface in surfaces])[box.owner[hidden]]
    covered: dict[str, float] = {}
    for name in np.unique(owners):
        covered[str(name)] = float((owners == name).sum() / shows_surface.sum())
    return covered


def _project(
    surfaces: Sequence[ColouredSurface], T_world_camera: Array, focal: float
) -> tuple[np.ndarray, Array, Array]:
    """Return surface indices (k,), corners (k, 3, 3) and shades (k,) of the triangles that face the lens.

    A corner is given by column, row and inverse depth. A triangle that reaches behind the lens is cut.
    """
    owners = []
    triangles = []
    for i, surface in enumerate(surfaces):
        owners.append(np.full(len(surface.triangles), i))
        triangles.append(surface.vertices[surface.triangles])
    owner = np.concatenate(owners)
    corners = np.concatenate(triangles) - T_world_camera[:3, 3]
    corners = corners @ T_world_camera[:3, :3]
    facing = np.sum(_normals(corners) * corners[:, 0], axis=1) < 0
    owner = owner[facing]
    corners = corners[facing]
    before_lens = corners[..., 2] > _NEAR
    is_uncut = before_lens.all(axis=1)
    is_cut = before_lens.any(axis=1) & ~is_uncut
    cut_owners: list[int] = []
    cut_corners: list[Array] = []
    for k in np.flatnonzero(is_cut):
        for triangle in _cut(corners[k]):
            cut_owners.append(owner[k])
            cut_corners.append(triangle)
    owner = np.concatenate([owner[is_uncut], np.array(cut_owners, int)])
    corners = np.concatenate([corners[is_uncut], np.reshape(cut_corners, (-1, 3, 3))])
    normals = _normals(corners)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)  # not 0, by which it is divided
    shade = _AMBIENT + (1 - _AMBIENT) * np.abs(normals[:, 2]) / lengths  # light along the view
    spots = focal * corners[..., :2] / corners[..., 2:] + np.array(SIZE) / 2
    return owner, np.concatenate([spots, 1 / corners[..., 2:]], axis=-1), shade


def _normals(corners: Array) -> Array:
    """Return the normals (k, 3), not of unit length, of triangles (k, 3, 3)."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _reaches(flat: Array, low: np.ndarray, high: np.ndarray, depth: float) -> np.ndarray:
    """Return (k,) bool: whether a triangle's inverse depth may exceed `depth` inside the box from low to high."""
    a = flat[:, 0]
    b = flat[:, 1] - a
    c = flat[:, 2] - a
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    area = np.where(np.abs(area) < 1e-12, np.inf, area)  # a triangle seen from its edge: its depth is that of `a`
    # the inverse depth is linear in the picture: its change per column and per row
    along = (b[:, 2] * c[:, 1] - c[:, 2] * b[:, 1]) / area
    down = (c[:, 2] * b[:, 0] - b[:, 2] * c[:, 0]) / area
    most = np.full(len(flat), -np.inf)
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            at_corner = a[:, 2] + along * (x - a[:, 0]) + down * (y - a[:, 1])
            most = np.maximum(most, at_corner)
    return (most > depth) & (flat[..., 2].max(axis=1) > depth)


def _cut(corners: Array) -> Iterator[Array]:
    """Cut a triangle at the smallest drawn distance; yield the triangles (3, 3) of its farther part."""
    corners_kept: list[Array] = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] > _NEAR:
            corners_kept.append(a)
        if (a[2] > _NEAR) != (b[2] > _NEAR):
            corners_kept.append(a + (b - a) * (_NEAR - a[2]) / (b[2] - a[2]))
    for k in range(1, len(corners_kept) - 1):
        yield np.array([corners_kept[0], corners_kept[k], corners_kept[k + 1]])


class _Box:
    """A part of the picture: owner (index of the surface; -1: nothing), shade and inverse depth of every sample."""

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        self.low = low
        self.high = high
        shape = (_SAMPLES, high[1] - low[1], high[0] - low[0])
        self.owner = np.full(shape, -1)
        self.shade = np.zeros(shape)
        self._depth = np.zeros(shape)

    def draw(self, triangle: Array, owner: int, shade: float) -> None:
        """Draw a triangle (3, 3) where it is nearer than the surfaces drawn before."""
        lowest = np.floor(triangle[:, :2].min(axis=0)).astype(int)
        highest = np.ceil(triangle[:, :2].max(axis=0)).astype(int)
        begin = np.maximum(lowest, self.low)
        end = np.minimum(highest, self.high)
        a, b, c = triangle[:, :2]
        depth_a, depth_b, depth_c = triangle[:, 2]
        area = _turn(b - a, c - a)
        if (end <= begin).any() or area == 0.0:
            return
        x = np.arange(begin[0], end[0])[None, None, :] + 0.5
        y = np.arange(begin[1], end[1])[None, :, None] + _ROWS[:, None, None]
        # barycentric coordinates of every sample: the weights of the corners
        weight_a = ((c[0] - b[0]) * (y - b[1]) - (c[1] - b[1]) * (x - b[0])) / area
        weight_b = ((a[0] - c[0]) * (y - c[1]) - (a[1] - c[1]) * (x - c[0])) / area
        weight_c = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
        inside = (weight_a >= 0) & (weight_b >= 0) & (weight_c >= 0)
        depth = weight_a * depth_a + weight_b * depth_b + weight_c * depth_c
        first = begin - self.low
        last = end - self.low
        window = np.s_[:, first[1] : last[1], first[0] : last[0]]
        front = inside & (depth > self._depth[window])
        self._depth[window][front] = depth[front]
        self.owner[window][front] = owner
        self.shade[window][front] = shade


def _turn(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
