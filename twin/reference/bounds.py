"""Bounds of the distance between two surfaces from balls and a grid of distances, for many poses at once.

One surface is covered by balls; of the other, lower bounds of the distance are stored on a grid in its own frame. The
distance of the surfaces is at least the smallest stored value at a ball's centre minus the ball's radius, and at most
this value plus both errors, because each ball contains a part of its surface. A look-up takes a fraction of a
microsecond, a distance of two meshes up to a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count, product

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM

_NODES = 200_000
"""Number of grid nodes in the bounding box of a surface, on which the edge of a cell depends."""

_CELL = (0.15 * MM, 6 * MM)
"""Smallest and largest edge of a grid cell in m."""

_BAND = 3
"""Width in cells of the band around the surface in which stored distances are accurate."""

_BALLS = 12
"""Number of balls of the first level, and of balls of the next level within each ball."""

_LEVELS = 2
"""Number of levels of balls."""

_BLOCK = 4_000
"""Maximum number of poses treated at once; more do not fit into the processor's cache."""

_PIECES = 400_000
"""Maximum number of triangles after division; beyond, they stay larger and the bounds are wider, but valid."""


def divided(triangles: Array, edge: float) -> Array:
    """Return triangles (k, 3, 3) divided at their longest edges until no edge is longer than `edge`."""
    done = []
    total = 0
    while len(triangles):
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = sides.max(axis=1) > edge
        done.append(triangles[~long])
        total += len(done[-1])
        triangles, sides = triangles[long], sides[long]
        if total + 2 * len(triangles) > _PIECES:
            done.append(triangles)
            break
        i, rows = np.argmax(sides, axis=1), np.arange(len(triangles))
        a, b, c = (triangles[rows, (i + n) % 3] for n in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


@dataclass(frozen=True)
class Level:
    """Balls that cover a surface; each contains a part of it.

    Attributes:
        centres, radii: (n, 3) and (n,) in m, in the frame of the surface.
        first: (m + 1,) where the balls begin that cover the same part as each of the m balls of the level before.
    """

    centres: Array
    radii: Array
    first: np.ndarray


def balls(triangles: Array) -> list[Level]:
    """Return levels of ever smaller balls that cover the surface of triangles (k, 3, 3)."""
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    pieces = divided(triangles, max(extent / 40, 0.25 * MM))
    parts, levels = [np.arange(len(pieces))], []
    for _ in range(_LEVELS):
        split = [_split(pieces, rows, _BALLS) for rows in parts]
        found = [ball for part in split for ball in part]
        first = np.cumsum([0, *(len(part) for part in split)])
        levels.append(Level(np.array([b[1] for b in found]), np.array([b[2] for b in found]), first))
        parts = [b[0] for b in found]
    return levels


def _split(pieces: Array, rows: np.ndarray, most: int) -> list[tuple[np.ndarray, Array, float]]:
    """Return at most `most` parts of the triangles `rows`: (rows, centre (3,) and radius of a ball around them)."""
    number = count()

    def ball(rows: np.ndarray) -> tuple[float, int, np.ndarray, Array]:
        points = pieces[rows].reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        off = points - middle
        return -float(np.sqrt(np.einsum("ki,ki->k", off, off).max())), next(number), rows, middle

    heap = [ball(rows)]
    while len(heap) < most and len(heap[0][2]) > 1:
        rows = heappop(heap)[2]
        corners = pieces[rows, 0]
        low, high = corners.min(axis=0), corners.max(axis=0)
        axis = int(np.argmax(high - low))
        side = corners[:, axis] > (low[axis] + high[axis]) / 2
        if not side.any():
            side[: len(side) // 2] = True
        heappush(heap, ball(rows[side]))
        heappush(heap, ball(rows[~side]))
    return [(rows, middle, -radius) for radius, _, rows, middle in heap]


class Grid:
    """Lower bounds of the distance from a surface on a grid.

    Attributes:
        error: in m, largest difference between the distance from the surface and the result of `at`, where this result
            is below `known`; elsewhere the result may be smaller by more.
        known: in m, see `error`.
    """

    def __init__(self, triangles: Array) -> None:
        from scipy.ndimage import distance_transform_edt
        from scipy.spatial import cKDTree

        points = triangles.reshape(-1, 3)
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        self._cell = cell = float(np.clip((np.prod(self._high - self._low + _CELL[0]) / _NODES) ** (1 / 3), *_CELL))
        pieces = divided(triangles, cell)
        middles = pieces.mean(axis=1)
        spread = float(np.linalg.norm(pieces - middles[:, None], axis=2).max())
        self._start = self._low - (_BAND + 1) * cell
        shape = np.ceil((self._high - self._low) / cell).astype(int) + 2 * _BAND + 3
        marked = np.ones(shape, bool)
        marked[tuple(self._nodes(middles).T)] = False
        steps = np.asarray(distance_transform_edt(marked), float)
        # a middle is within half a diagonal of its marked node, and a point of the surface within `spread` of a middle
        values = np.maximum(steps * cell - np.sqrt(3) / 2 * cell - spread, 0.0)
        near = np.argwhere(steps <= _BAND)
        found = cKDTree(middles, balanced_tree=False, compact_nodes=False).query(self._start + near * cell, workers=1)[
            0
        ]
        values[tuple(near.T)] = np.maximum(found - spread, 0.0)
        self._shape, self._values = shape, values.astype(np.float32).ravel() * np.float32(1 - 1e-6)
        # a stored value is off by a diagonal and two spreads, a look-up by a diagonal more
        self.error, self.known = 2 * spread + 2 * np.sqrt(3) * cell + 1e-6, _BAND * cell

    def _nodes(self, points: Array) -> np.ndarray:
        return np.rint((points - self._start) / self._cell).astype(np.intp)

    def at(self, points: Array) -> Array:
        """Return lower bounds (k,) in m of the distance of points (k, 3) from the surface, from the nearest nodes."""
        last = self._start + (self._shape - 1) * self._cell
        node = self._nodes(np.clip(points, self._start, last))
        beyond = np.maximum(np.maximum(self._low - points, points - self._high), 0.0)
        return np.maximum(self._from(node, points), np.sqrt(np.einsum("ki,ki->k", beyond, beyond)))

    def sharp(self, points: Array) -> Array:
        """Return larger lower bounds (k,) in m than `at`, from the eight nodes around each point (k, 3)."""
        out = self.at(points)
        low = np.clip(np.floor((points - self._start) / self._cell).astype(np.intp), 0, self._shape - 2)
        for corner in product((0, 1), repeat=3):
            np.maximum(out, self._from(low + corner, points), out=out)
        return out

    def _from(self, node: np.ndarray, points: Array) -> Array:
        """Return the bounds (k,) that nodes (k, 3) give for points (k, 3): a distance changes by at most the way."""
        place = (node[:, 0] * self._shape[1] + node[:, 1]) * self._shape[2] + node[:, 2]
        off = points - (self._start + node * self._cell)
        return self._values[place] - np.sqrt(np.einsum("ki,ki->k", off, off))


class Bounds:
    """Bounds of the distance between two surfaces: `grid` of the one, `levels` of balls of the other."""

    def __init__(self, grid: Grid, levels: list[Level]) -> None:
        self._grid, self._levels = grid, levels

    def at(self, Ts: Array, enough: Array) -> tuple[Array, Array]:
        """Return bounds (k,) from below and (k,) from above in m of the distance, for poses T_grid_balls (k, 4, 4).

        Where large balls prove less than `enough` (k,) in m, smaller ones are looked up; where they prove more, the
        upper bound is infinite.
        """
        low, high = np.full(len(Ts), np.inf), np.full(len(Ts), np.inf)
        for start in range(0, len(Ts), _BLOCK):
            here = slice(start, start + _BLOCK)
            state = np.arange(len(Ts[here]))
            parent = np.zeros(len(state), np.intp)
            for number, level in enumerate(self._levels):
                counts = level.first[parent + 1] - level.first[parent]
                before = np.concatenate([[0], np.cumsum(counts)[:-1]])
                ball = np.repeat(level.first[parent] - before, counts) + np.arange(int(counts.sum()))
                state = np.repeat(state, counts)
                points = np.einsum("kij,kj->ki", Ts[here, :3, :3][state], level.centres[ball]) + Ts[here, :3, 3][state]
                values, radii, last = self._grid.at(points), level.radii[ball], number == len(self._levels) - 1
                close = values - radii < enough[here][state]
                if last:
                    values[close] = self._grid.sharp(points[close])
                    known = values < self._grid.known
                    np.minimum.at(high[here], state[known], (values + radii)[known] + self._grid.error)
                proven = np.ones(len(close), bool) if last else ~close
                np.minimum.at(low[here], state[proven], (values - radii)[proven])
                state, parent = state[~proven], ball[~proven]
                if not len(state):
                    break
        return np.maximum(low, 0.0), high
