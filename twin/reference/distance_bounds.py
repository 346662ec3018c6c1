"""Bounds of the distance between two surfaces, computed from balls and a grid of distances, for many poses at once.

The first surface is covered by balls. For the second surface, a grid in the frame of this surface stores lower bounds
of the distance from the surface. For a ball, let v be the stored value at its centre, and r its radius. The distance of
the surfaces is at least the minimum of v - r over all balls. As each ball contains a part of the first surface, the
distance is also at most v + r plus the error of v, for any ball. A look-up (`distance_lookup`) takes nanoseconds;
computing the distance of two meshes takes up to a millisecond. Grids and balls depend on the surface only and are kept
on disk.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from zipfile import BadZipFile

import numpy as np

from twin.core.atomic import atomic_folder
from twin.core.cache import cache_folder
from twin.core.errors import OutputError
from twin.core.spatial import Array
from twin.core.units import MM
from twin.reference.distance_lookup import BALL, GRID, PAIR, look_up

_GRID_NODES = 400_000
"""Approximate number of grid nodes in the bounding box of a surface; this number determines the edge of a cell."""

_CELL_EDGES = (0.15 * MM, 6 * MM)
"""Smallest and largest edge of a grid cell in m."""

_ACCURATE_CELLS = 3
"""Width in cells of the band around the surface in which stored distances are accurate."""

_MOST_HALVINGS = 12
"""Maximum number of times that a surface is halved to get smaller balls."""

_SMALLEST_BALL_SHARE = 1 / 250
"""Radius of the smallest balls, relative to the extent of the surface."""

_SMALLEST_BALL_RADIUS = 0.1 * MM
"""Radius of the smallest balls in m, however small the surface."""

_MOST_TRIANGLES = 1_500_000
"""Maximum number of triangles after division. If this is too few, triangles stay larger and bounds are less tight."""

_MOST_CACHED_FILES = 512
"""Maximum number of files in the cache; the oldest files are removed first."""

_ROUNDING = 1e-6
"""Margin in m of the errors of a grid, above the rounding of its values to single precision."""

_FLOAT32_ROUNDING = 1e-6
"""Fraction by which a stored value is decreased: it exceeds the rounding to single precision."""

_RADIUS_MARGIN = 1 + 1e-9
"""Factor by which the radius of a ball is increased, because it is rounded."""

_CACHE_VERSION = 3
"""Version of the method that makes grids and balls; cached files of another version are not used."""


def divided(triangles: Array, edge: float) -> Array:
    """Return triangles (k, 3, 3) divided at their longest edges until no edge is longer than `edge`."""
    short_triangles = []
    total = 0
    while len(triangles):
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        is_long = sides.max(axis=1) > edge
        short_triangles.append(triangles[~is_long])
        total += len(short_triangles[-1])
        triangles = triangles[is_long]
        sides = sides[is_long]
        if total + 2 * len(triangles) > _MOST_TRIANGLES:
            short_triangles.append(triangles)
            break
        # the longest edge is that from a to b
        i = np.argmax(sides, axis=1)
        rows = np.arange(len(triangles))
        a = triangles[rows, i]
        b = triangles[rows, (i + 1) % 3]
        c = triangles[rows, (i + 2) % 3]
        middle = (a + b) / 2
        first = np.stack([a, middle, c], axis=1)
        second = np.stack([middle, b, c], axis=1)
        triangles = np.concatenate([first, second])
    return np.concatenate(short_triangles)


def _smallest_radius_by_area(triangles: Array) -> float:
    """Return the approximate radius in m of the smallest balls of the surface of triangles (k, 3, 3)."""
    sides = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1])
    area = float(np.linalg.norm(normals, axis=1).sum()) / 2
    # each of the smallest balls has a share of the area
    return float(np.sqrt(area / 2**_MOST_HALVINGS))


def _cell(triangles: Array) -> float:
    """Return the edge length in m of the grid cells for the surface of triangles (k, 3, 3)."""
    smallest, largest = _CELL_EDGES
    size = np.ptp(triangles.reshape(-1, 3), axis=0) + smallest
    cell = (np.prod(size) / _GRID_NODES) ** (1 / 3)
    return float(np.clip(cell, smallest, largest))


def balls(triangles: Array) -> Array:
    """Return balls (n, 5) that cover the surface of triangles (k, 3, 3); each ball contains a part of the surface.

    The balls form a binary tree: the part of the surface in a ball is halved, and each half has a smaller ball. The
    rows are in depth-first order. A row contains the centre (3) in m, the radius in m, and the index of the first row
    after the subtree of the ball.
    """
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    smallest_radius = max(extent * _SMALLEST_BALL_SHARE, _SMALLEST_BALL_RADIUS)
    pieces = divided(
        triangles, max(2 * smallest_radius, _smallest_radius_by_area(triangles))
    )  # smaller pieces would have no effect
    # The ball `number` has the halves `2 number` and `2 number + 1`; `number` (pieces,) is that of each piece's ball.
    number = np.ones(len(pieces), np.int64)
    ball_of_piece: dict[int, tuple[float, ...]] = {}
    for depth in range(_MOST_HALVINGS + 1):
        order = np.argsort(number, kind="stable")
        pieces = pieces[order]
        number = number[order]
        parts, first, sizes = np.unique(number, return_index=True, return_counts=True)
        part_of_piece = np.repeat(np.arange(len(parts)), sizes)  # the row in `parts` of each piece
        low = np.minimum.reduceat(pieces.min(axis=1), first)
        high = np.maximum.reduceat(pieces.max(axis=1), first)
        middle = (low + high) / 2
        distances = np.linalg.norm(pieces - middle[part_of_piece][:, None], axis=2).max(axis=1)
        radii = np.maximum.reduceat(distances, first)
        for part, centre, radius in zip(parts.tolist(), middle, radii, strict=True):
            ball_of_piece[part] = (*centre, radius * _RADIUS_MARGIN)
        if depth == _MOST_HALVINGS:
            break
        halved = ((radii > smallest_radius) & (sizes > 1))[part_of_piece]
        if not halved.any():
            break
        side = _halves(pieces, first, sizes, part_of_piece, np.argmax(high - low, axis=1))
        pieces = pieces[halved]
        number = (2 * number + side)[halved]
    return _depth_first(ball_of_piece)


def _halves(
    pieces: Array, first: np.ndarray, sizes: np.ndarray, part_of_piece: np.ndarray, axis: np.ndarray
) -> np.ndarray:
    """Return (k,) bool: whether each of the pieces (k, 3, 3) is in the second half of its part, along its longest axis.

    Part i has `sizes[i]` pieces, from `first[i]`, and the longest axis `axis[i]`; `part_of_piece` (k,) is the part of
    each piece.
    """
    centres = pieces.mean(axis=1)
    places = np.take_along_axis(centres, axis[part_of_piece][:, None], axis=1)[:, 0]
    least = np.minimum.reduceat(places, first)
    most = np.maximum.reduceat(places, first)
    side = places > ((least + most) / 2)[part_of_piece]
    even = (least == most)[part_of_piece]  # all centres in one place: halved by index
    index = np.arange(len(pieces)) - first[part_of_piece]
    later = index >= (sizes[part_of_piece] + 1) // 2
    side[even] = later[even]
    return side


def _depth_first(ball_of_number: dict[int, tuple[float, ...]]) -> Array:
    """Return the rows (n, 5) of balls, {number: centre and radius}, in depth-first order; see `balls`."""
    rows: list[tuple[float, ...]] = []
    after: list[int] = []
    # a number of a ball, or the row whose subtree ends here
    waiting = [(1, -1)]
    while waiting:
        part, closes = waiting.pop()
        if closes >= 0:
            after[closes] = len(rows)
            continue
        waiting.append((0, len(rows)))
        rows.append(ball_of_number[part])
        after.append(0)
        for half in (2 * part + 1, 2 * part):
            if half in ball_of_number:
                waiting.append((half, -1))
    return np.column_stack([np.array(rows), after])


@dataclass(frozen=True)
class DistanceGrid:
    """Grid whose nodes store lower bounds of the distance from a surface.

    Attributes:
        values: (x, y, z) float32 in m.
        start: (3,) first node in m.
        cell: edge of a cell in m.
        low, high: (3,) corners of the bounding box of the surface in m.
        near_error: maximum in m of (distance of a node from the surface minus stored value), for stored values below
            `accurate_below`.
        accurate_below: stored value in m below which `near_error` applies.
        far_error: maximum in m of (distance of a node from the surface minus stored value), for stored values of at
            least `accurate_below`.
    """

    values: np.ndarray
    start: Array
    cell: float
    low: Array
    high: Array
    near_error: float
    accurate_below: float
    far_error: float

    @staticmethod
    def of(triangles: Array) -> DistanceGrid:
        """Return the grid of the surface of triangles (k, 3, 3)."""
        from scipy.ndimage import distance_transform_edt
        from scipy.spatial import KDTree

        points = triangles.reshape(-1, 3)
        low = points.min(axis=0)
        high = points.max(axis=0)
        cell = _cell(triangles)
        pieces = divided(triangles, cell)
        middles = pieces.mean(axis=1)
        spread = float(np.linalg.norm(pieces - middles[:, None], axis=2).max())
        start = low - (_ACCURATE_CELLS + 1) * cell
        shape = np.ceil((high - low) / cell).astype(int) + 2 * _ACCURATE_CELLS + 3
        node = np.rint((middles - start) / cell).astype(np.intp)
        free = np.ones(shape, bool)
        free[tuple(node.T)] = False
        steps = np.asarray(distance_transform_edt(free), float)
        # a piece's centre is within half a cell's diagonal of its node; its points are within `spread` of its centre
        values = np.maximum(steps * cell - np.sqrt(3) / 2 * cell - spread, 0.0)
        # near the surface: distance from the nearest centre minus `spread`; the centre is a point of the surface
        band_nodes = np.argwhere(steps <= _ACCURATE_CELLS)
        tree = KDTree(middles, balanced_tree=False, compact_nodes=False)
        distance, _ = tree.query(start + band_nodes * cell, workers=1)
        values[tuple(band_nodes.T)] = np.maximum(distance - spread, 0.0)
        # values of nodes beyond the band are at least this
        accurate_below = max(_ACCURATE_CELLS * cell - np.sqrt(3) / 2 * cell - spread, 0.0)
        near_error = spread + _ROUNDING
        far_error = np.sqrt(3) * cell + spread + _ROUNDING
        # a lower bound must remain one after rounding to float32
        rounded = values.astype(np.float32) * np.float32(1 - _FLOAT32_ROUNDING)
        return DistanceGrid(rounded, start, cell, low, high, near_error, accurate_below, far_error)


def grid_of(triangles: Array) -> DistanceGrid:
    """Return `DistanceGrid.of(triangles)`, from the cache if it is there."""

    def make() -> dict[str, np.ndarray]:
        grid = DistanceGrid.of(triangles)
        bounds = [grid.near_error, grid.accurate_below, grid.far_error]
        numbers = np.concatenate([grid.start, [grid.cell], grid.low, grid.high, bounds])
        return {"values": grid.values, "rest": numbers}

    arrays = _cached_arrays("grid", triangles, make)
    numbers = arrays["rest"]
    return DistanceGrid(
        arrays["values"],
        start=numbers[:3],
        cell=numbers[3],
        low=numbers[4:7],
        high=numbers[7:10],
        near_error=numbers[10],
        accurate_below=numbers[11],
        far_error=numbers[12],
    )


def balls_of(triangles: Array) -> Array:
    """Return `balls(triangles)`, from the cache if they are there."""
    arrays = _cached_arrays("balls", triangles, lambda: {"balls": balls(triangles)})
    return arrays["balls"]


def _cached_arrays(kind: str, triangles: Array, make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return named arrays from the user's cache folder; if they are not there, make them and store them there.

    The key is a hash of the triangles. Arrays of a file that cannot be read are made again; a cache that cannot be
    written is not an error.
    """
    digest = hashlib.sha256(f"{kind} {_CACHE_VERSION} {triangles.shape}\n".encode())
    digest.update(np.ascontiguousarray(triangles, np.float64).data)
    folder = cache_folder("distances")
    name = f"{digest.hexdigest()}.npz"
    with contextlib.suppress(OSError, ValueError, KeyError, EOFError, BadZipFile):
        # numpy would not close a damaged file
        content = BytesIO((folder / name).read_bytes())
        with np.load(content, allow_pickle=False) as file:
            arrays = dict(file)
        stored_sum = bytes(arrays.pop("sum"))
        # an archive can be complete and its content wrong: a damaged grid would prove wrong distances
        if _checksum(arrays) == stored_sum:
            return arrays
    arrays = make()
    checksum = np.frombuffer(_checksum(arrays), np.uint8)
    with contextlib.suppress(OSError, OutputError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        # one file is added: the oldest ones go
        oldest_first = sorted(folder.glob("*.npz"), key=lambda p: p.stat().st_mtime)
        for old in oldest_first[:-_MOST_CACHED_FILES]:
            old.unlink()
        with atomic_folder(folder) as work:
            np.savez(work / name, allow_pickle=False, **arrays, sum=checksum)
    return arrays


def _checksum(arrays: dict[str, np.ndarray]) -> bytes:
    """Return the SHA-256 of the bytes of all arrays, in the order of their names."""
    digest = hashlib.sha256()
    for key in sorted(arrays):
        digest.update(arrays[key].tobytes())
    return digest.digest()


class Bounds:
    """Bounds of the distances of pairs of surfaces: each pair has a grid of one surface and balls of the other."""

    def __init__(self, triangles: Sequence[Array], pairs: np.ndarray) -> None:
        """Define the pairs; grids and balls are made, or loaded from the cache, when they are required.

        In each pair, one shape has the grid and the other shape has the balls. Of the two assignments, the one with the
        smaller sum of half the cell and the radius of the smallest balls is used.

        Args:
            triangles: (k, 3, 3) of each shape, in its own frame.
            pairs: (pairs, 2) indices of two shapes.
        """
        cells = np.zeros(len(triangles))
        radii = np.zeros(len(triangles))
        for i, corners in enumerate(triangles):
            cells[i] = _cell(corners)
            radii[i] = _smallest_radius_by_area(corners)
        a, b = pairs.T
        swapped = cells[a] / 2 + radii[b] > cells[b] / 2 + radii[a]
        self._pairs = np.where(swapped[:, None], pairs[:, ::-1], pairs)
        self._triangles = triangles
        self._is_loaded = np.zeros(len(pairs), bool)
        # {index of a shape: the row of its grid}, and {index of a shape: (first row of its balls, row after the last)}
        self._grid_row: dict[int, int] = {}
        self._ball_rows: dict[int, tuple[int, int]] = {}
        # the numbers that the machine code reads; see `distance_lookup`
        self._grids = np.zeros((0, GRID))
        self._balls = np.zeros((0, BALL))
        self._values = np.zeros(0, np.float32)
        self._table = np.zeros((len(pairs), PAIR), np.int64)

    def load(self, pairs: np.ndarray) -> None:
        """Load the grids and balls of `pairs` (n,) from the cache, or make them, before `at` requires them."""
        new = np.unique(pairs[~self._is_loaded[pairs]])
        with_grid = np.unique(self._pairs[new, 0])
        with_balls = np.unique(self._pairs[new, 1])
        self._load_grids(with_grid.tolist())
        self._load_balls(with_balls.tolist())
        for pair in new:
            a, b = self._pairs[pair].tolist()
            first, last = self._ball_rows[b]
            self._table[pair] = (len(self._triangles), a, b, self._grid_row[a], first, last)
        self._is_loaded[new] = True

    def _load_grids(self, shapes: list[int]) -> None:
        """Append the grids of `shapes` that are not loaded to the arrays of the machine code."""
        grids = [self._grids]
        values = [self._values]
        size = len(self._values)
        for n in shapes:
            if n in self._grid_row:
                continue
            grid = grid_of(self._triangles[n])
            self._grid_row[n] = len(self._grid_row)
            shape = np.array(grid.values.shape)
            numbers = [
                grid.start,
                [grid.cell, 1 / grid.cell],
                shape - 1,
                [shape[1] * shape[2], shape[2], size],
                grid.low,
                grid.high,
                [grid.near_error, grid.accurate_below, grid.far_error],
            ]
            grids.append(np.concatenate(numbers)[None])
            values.append(grid.values.ravel())
            size += grid.values.size
        self._grids = np.concatenate(grids)
        self._values = np.concatenate(values)

    def _load_balls(self, shapes: list[int]) -> None:
        """Append the balls of `shapes` that are not loaded to the array of the machine code."""
        covers = [self._balls]
        count = len(self._balls)
        for n in shapes:
            if n in self._ball_rows:
                continue
            cover = balls_of(self._triangles[n])
            self._ball_rows[n] = (count, count + len(cover))
            # the index of the ball after the subtree counts all balls before
            covers.append(cover + np.array([0, 0, 0, 0, count]))
            count += len(cover)
        self._balls = np.concatenate(covers)

    def at(
        self,
        poses: Array,
        states: np.ndarray,
        pairs: np.ndarray,
        enough: Array,
        reject: Array | None = None,
        smallest_radius: float = 0.0,
    ) -> tuple[Array, Array]:
        """Return (lower bounds (n,), upper bounds (n,)) in m of the distances of `pairs` (n,) in `states` (n,).

        Args:
            poses: (k, shapes, 4, 4) T_base_shape in each state.
            states: (n,) rows of `poses`.
            pairs: (n,) indices of the pairs.
            enough: (n,) in m; a lower bound that reaches this value is not improved, and the upper bound may then be
                infinite.
            reject: (n,) in m; where the upper bound is below this value, the lower bound is 0. None: 0 for all pairs.
            smallest_radius: in m; balls of at most this radius are not replaced by smaller balls.
        """
        if not self._is_loaded[pairs].all():
            self.load(pairs)
        if reject is None:
            reject = np.zeros(len(states))
        return look_up(
            poses,
            states,
            pairs,
            enough,
            reject,
            np.full(len(states), smallest_radius),
            table=self._table,
            grids=self._grids,
            values=self._values,
            balls=self._balls,
        )
