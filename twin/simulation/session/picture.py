"""Draw a part of a scene as a camera sees it, by a rasteriser with a depth buffer and 8 samples per pixel.

Only a box of the picture is drawn, the box around one surface. It contains this surface and everything that is not
farther away. The rasteriser needs no graphics driver, and draws the same picture on every machine. The rasteriser
shares no code with the projection in `aligned`.
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
_ROWS = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
"""Heights of the samples in a pixel. All samples are on the vertical centre line of the pixel. There, the height of an
edge is measured to an eighth of a pixel at every slope; samples that are spread over the width do not achieve this."""


@dataclass(frozen=True)
class Surface:
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


def draw(surfaces: Sequence[Surface], name: str, T_world_camera: Array, view: float) -> Picture:
    """Draw the box around a surface.

    Args:
        surfaces: everything that the camera can see.
        name: name of the surface.
        T_world_camera: (4, 4) pose of the camera: z along the view, y down in the picture.
        view: angle of view over the height of the picture, in rad.
    """
    width, height = SIZE
    picture = np.zeros((height, width, 3))
    owner, flat, shade = _project(surfaces, T_world_camera, height / 2 / np.tan(view / 2))
    mine = np.array([s.name == name for s in surfaces])[owner]
    if not mine.any():
        return Picture(picture, {})
    low = np.clip(np.floor(flat[mine, :, :2].min(axis=(0, 1))).astype(int) - _MARGIN, 0, SIZE)
    high = np.clip(np.ceil(flat[mine, :, :2].max(axis=(0, 1))).astype(int) + _MARGIN, 0, SIZE)
    if (high <= low).any():
        return Picture(picture, {})
    over = (flat[..., :2].max(axis=1) > low).all(axis=1) & (flat[..., :2].min(axis=1) < high).all(axis=1)
    over[over] = mine[over] | _reaches(flat[over], low, high, flat[mine, :, 2].min())
    box, alone = _Box(low, high), _Box(low, high)
    for k in np.flatnonzero(over):
        box.draw(flat[k], owner[k], shade[k])
        if mine[k]:
            alone.draw(flat[k], owner[k], shade[k])
    colors = np.array([np.asarray(s.rgb[:3], float) for s in surfaces] + [np.zeros(3)])
    picture[low[1] : high[1], low[0] : high[0]] = (colors[box.owner] * box.shade[..., None]).mean(axis=0)
    whole = alone.owner >= 0
    owners = np.array([s.owner for s in surfaces])[box.owner[whole & (box.owner != alone.owner)]]
    return Picture(picture, {str(n): float((owners == n).sum() / whole.sum()) for n in np.unique(owners)})


def _project(surfaces: Sequence[Surface], T_world_camera: Array, focal: float) -> tuple[np.ndarray, Array, Array]:
    """Return surface indices (k,), corners (k, 3, 3) and shades (k,) of the triangles that face the lens.

    A corner is given by column, row and inverse depth. A triangle that reaches behind the lens is cut.
    """
    owner = np.repeat(np.arange(len(surfaces)), [len(s.triangles) for s in surfaces])
    corners = np.concatenate([s.vertices[s.triangles] for s in surfaces]) - T_world_camera[:3, 3]
    corners = corners @ T_world_camera[:3, :3]
    facing = np.sum(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * corners[:, 0], axis=1) < 0
    owner, corners = owner[facing], corners[facing]
    before = corners[..., 2] > _NEAR
    whole, part = before.all(axis=1), before.any(axis=1) & ~before.all(axis=1)
    cut = [(k, t) for k in np.flatnonzero(part) for t in _cut(corners[k])]
    owner = np.concatenate([owner[whole], owner[[k for k, _ in cut]]])
    corners = np.concatenate([corners[whole], np.reshape([t for _, t in cut], (-1, 3, 3))])
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shade = 0.3 + 0.7 * np.abs(n[:, 2]) / np.maximum(np.linalg.norm(n, axis=1), 1e-30)  # light along the view
    spots = focal * corners[..., :2] / corners[..., 2:] + np.array(SIZE) / 2
    return owner, np.concatenate([spots, 1 / corners[..., 2:]], axis=-1), shade


def _reaches(flat: Array, low: np.ndarray, high: np.ndarray, depth: float) -> np.ndarray:
    """Return (k,) bool: whether a triangle's inverse depth may exceed `depth` inside the box from low to high."""
    a, b, c = flat[:, 0], flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
    area = np.where(np.abs(area) < 1e-12, np.inf, area)
    along = (b[:, 2] * c[:, 1] - c[:, 2] * b[:, 1]) / area
    down = (c[:, 2] * b[:, 0] - b[:, 2] * c[:, 0]) / area
    most = np.full(len(flat), -np.inf)
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            most = np.maximum(most, a[:, 2] + along * (x - a[:, 0]) + down * (y - a[:, 1]))
    return (most > depth) & (flat[..., 2].max(axis=1) > depth)


def _cut(corners: Array) -> Iterator[Array]:
    """Cut a triangle at the smallest drawn distance; yield the triangles (3, 3) of its farther part."""
    kept: list[Array] = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] > _NEAR:
            kept.append(a)
        if (a[2] > _NEAR) != (b[2] > _NEAR):
            kept.append(a + (b - a) * (_NEAR - a[2]) / (b[2] - a[2]))
    for k in range(1, len(kept) - 1):
        yield np.array([kept[0], kept[k], kept[k + 1]])


class _Box:
    """A part of the picture: owner (index of the surface; -1: nothing), shade and inverse depth of every sample."""

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        self.low, self.high = low, high
        shape = (_SAMPLES, high[1] - low[1], high[0] - low[0])
        self.owner, self.shade, self._depth = np.full(shape, -1), np.zeros(shape), np.zeros(shape)

    def draw(self, triangle: Array, owner: int, shade: float) -> None:
        """Draw a triangle (3, 3) where it is nearer than the surfaces drawn before."""
        at = np.maximum(np.floor(triangle[:, :2].min(axis=0)).astype(int), self.low)
        to = np.minimum(np.ceil(triangle[:, :2].max(axis=0)).astype(int), self.high)
        (a, b, c), w = triangle[:, :2], triangle[:, 2]
        area = _turn(b - a, c - a)
        if (to <= at).any() or area == 0.0:
            return
        x = np.arange(at[0], to[0])[None, None, :] + 0.5
        y = np.arange(at[1], to[1])[None, :, None] + _ROWS[:, None, None]
        parts = [((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])) / area for p, q in ((b, c), (c, a), (a, b))]
        inside = (parts[0] >= 0) & (parts[1] >= 0) & (parts[2] >= 0)
        depth = parts[0] * w[0] + parts[1] * w[1] + parts[2] * w[2]
        here = np.s_[:, at[1] - self.low[1] : to[1] - self.low[1], at[0] - self.low[0] : to[0] - self.low[0]]
        front = inside & (depth > self._depth[here])
        self._depth[here][front] = depth[front]
        self.owner[here][front] = owner
        self.shade[here][front] = shade


def _turn(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
