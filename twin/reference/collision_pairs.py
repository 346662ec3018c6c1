"""The pairs of bodies that could collide while a mechanism moves among obstacles, with tests of their distance.

The tests, from cheap to expensive, use boxes along the axes of base; bounds from balls and a grid of distances
(`distance_bounds`), for many states at once; convex hulls; the meshes, by coal, for pairs that the bounds do not
decide.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import coal  # pyright: ignore[reportMissingImports] - installed beside site-packages
import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body
from twin.reference.clearance import TOUCHING, Shape, distance_between, placed, unjointed_pairs
from twin.reference.distance_bounds import Bounds
from twin.reference.model import ReferenceModel
from twin.reference.relative_motion import GlobalMotionBounds, LocalMotionBounds

_HULL_DISTANCE_ERROR = 1e-5
"""Maximum excess in m of a computed hull distance over the true distance."""

SEARCH_BALL_RADIUS = 2 * MM
"""Radius in m of balls that are small enough for a search; a found path is tested with smaller balls."""

_MOST_STORED_TURNS = 3
"""Maximum number of revolute joints between two bodies with stored results, see `CollisionPairs.closer`."""


@dataclass(frozen=True)
class Obstacle:
    """A body at rest (an obstacle): name "owner/body", body with its meshes, pose T_base_body (4, 4).

    `touches` names the bodies of the mechanism that touch the obstacle intentionally.
    """

    name: str
    body: Body
    T_base_body: Array
    touches: frozenset[str] = frozenset()


class CollisionPairs:
    """Pairs of bodies that could collide.

    Two kinds of pairs are left out: bodies connected by a joint (the joint limits separate them), and bodies that touch
    in the rest poses. Meshes are surfaces: a body that is completely inside another one is not detected.

    Attributes:
        shapes: the bodies' shapes; obstacles last.
        rows: (pairs, 2) indices of the two shapes.
        required: (pairs,) required distances in m.
        bounds: bounds of the distances of pairs at shape poses (k, shapes, 4, 4).
    """

    def __init__(
        self,
        model: ReferenceModel,
        obstacles: Sequence[Obstacle],
        clearance: float,
        arms: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Find the pairs.

        Args:
            model: the mechanism's model.
            obstacles: the obstacles.
            clearance: required distance in m. For two bodies of the mechanism, at most half of their distance in the
                rest poses is required.
            arms: name of the arm of each body, for a mechanism made by `twin.model.combined_arms`. Two bodies of
                different arms must have the full clearance, even if they are nearer in the rest poses.
        """
        self._tree = model.tree
        self._clearance = clearance
        own_pairs = unjointed_pairs(model.mechanism)
        obstacles = [obstacle for obstacle in obstacles if obstacle.body.meshes]
        own_shapes = self._own_shapes(model, own_pairs, has_obstacles=bool(obstacles))
        self.shapes = list(own_shapes.values())
        numbers = []
        Ts = []
        for name in own_shapes:
            number, T_joint_body = self._tree.body(name)
            numbers.append(number)
            Ts.append(T_joint_body)
        for obstacle in obstacles:
            self.shapes.append(Shape(obstacle.name, obstacle.name, obstacle.body.meshes))
            numbers.append(0)
            Ts.append(obstacle.T_base_body)
        self._joint_numbers = np.array(numbers, int)
        self._Ts_joint_shape = np.array(Ts).reshape(-1, 4, 4)

        moves = [self._tree.moves(number) for number in self._joint_numbers]
        rows: list[tuple[int, int]] = []
        required: list[float] = []
        for a, b, distance in self._possible_pairs(model, own_pairs, obstacles, arms, len(own_shapes)):
            # two bodies that the same coordinates move are at rest relative to each other
            if (moves[a] != moves[b]).any():
                rows.append((a, b))
                required.append(distance)
        self.rows = np.array(rows, int).reshape(-1, 2)
        self.required = np.array(required)

        placed_boxes = []
        for shape, number, T in zip(self.shapes, self._joint_numbers, self._Ts_joint_shape, strict=True):
            # a body is inside its bounding box, so the corners' distance from an axis is an upper bound
            corners = shape.corners @ T[:3, :3].T + T[:3, 3]
            placed_boxes.append((int(number), corners))
        box_pairs = []
        for a, b in self.rows:
            box_pairs.append((placed_boxes[a], placed_boxes[b]))
        self.global_bounds = GlobalMotionBounds(self._tree, box_pairs)
        diagonals = []
        sums = []
        for shape in self.shapes:
            # the first corner of a box is its lowest, the last its highest
            lowest = shape.corners[0]
            highest = shape.corners[-1]
            diagonals.append(highest - lowest)
            sums.append(highest + lowest)
        self._half_edges = np.array(diagonals).reshape(-1, 3) / 2
        self._middles = np.array(sums).reshape(-1, 3) / 2
        self._radii = np.linalg.norm(self._half_edges, axis=1)
        self.bounds = Bounds([shape.triangles for shape in self.shapes], self.rows)
        self._cells: dict[tuple[int, ...], bool] = {}
        self._turns = self._pairs_with_few_turns(moves)

    @staticmethod
    def _own_shapes(
        model: ReferenceModel, own_pairs: Sequence[tuple[Shape, Shape]], *, has_obstacles: bool
    ) -> dict[str, Shape]:
        """Return {body: its shape} of the bodies in `own_pairs`; of all bodies if obstacles can be near any of them."""
        shapes: dict[str, Shape] = {}
        for a, b in own_pairs:
            shapes[a.name] = a
            shapes[b.name] = b
        if has_obstacles:
            for body in model.mechanism.bodies:
                if body.meshes and body.name not in shapes:
                    shapes[body.name] = Shape(body.name, body.name, body.meshes)
        return shapes

    def _possible_pairs(
        self,
        model: ReferenceModel,
        own_pairs: Sequence[tuple[Shape, Shape]],
        obstacles: Sequence[Obstacle],
        arms: Mapping[str, str],
        count: int,
    ) -> Iterator[tuple[int, int, float]]:
        """Yield (shape, shape, required distance in m) of the pairs, whether they can move or not.

        `count` is the number of the mechanism's own shapes; the arguments are those of the class.
        """
        row = {shape.name: i for i, shape in enumerate(self.shapes)}
        home = model.home().link_poses
        for a, b in own_pairs:
            required = self._clearance
            if arms.get(a.name) == arms.get(b.name):
                rest_distance = distance_between(a, b, home[a.body], home[b.body])
                if rest_distance <= TOUCHING:
                    continue
                required = min(required, rest_distance / 2)
            yield row[a.name], row[b.name], required
        for obstacle in obstacles:
            for i in range(count):
                # bodies at rest cannot approach an obstacle
                if self._joint_numbers[i] and self.shapes[i].name not in obstacle.touches:
                    yield i, row[obstacle.name], self._clearance

    def _pairs_with_few_turns(self, moves: Sequence[Array]) -> dict[int, tuple[np.ndarray, Array]]:
        """Return the pairs whose relative pose depends on few rotations: (velocity indices, edges of a cell in rad)."""
        nq = self._tree.model.nq
        nv = self._tree.model.nv
        if nq != nv:
            return {}
        at_rest = np.zeros(nv)
        bounds = self.global_bounds.bounds(np.full((1, nq), 0.0), at_rest)
        extended = self.global_bounds.bounds(np.full((1, nq), 1.0), at_rest)
        turns = {}
        for pair, (a, b) in enumerate(self.rows):
            moving = np.flatnonzero(moves[a] != moves[b])
            lever = bounds[pair, moving]
            # the bound of a pair that a slide moves grows with the extension of the slide
            rotates = np.array_equal(bounds[pair], extended[pair]) and bool((lever > 0).all())
            if rotates and len(moving) <= _MOST_STORED_TURNS:
                turns[pair] = (moving, self.required[pair] / (len(moving) * lever))
        return turns

    def __len__(self) -> int:
        return len(self.rows)

    def load(self) -> None:
        """Make the grids, balls and hulls of all shapes now; otherwise the first tests make them and are slow."""
        self.bounds.load(np.arange(len(self)))
        for shape in set(self.rows.ravel().tolist()):
            _ = self.shapes[shape].hull

    def poses(self, X: Array) -> Array:
        """Return T_base_shape (k, shapes, 4, 4) at configurations (k, nq)."""
        joints = self._tree.place(X)
        return joints[:, self._joint_numbers] @ self._Ts_joint_shape

    @cached_property
    def local_bounds(self) -> LocalMotionBounds | None:
        """Bounds of motion around a state; None if a joint of the tree is neither revolute, prismatic nor spherical."""
        if not LocalMotionBounds.possible(self._tree):
            return None
        return LocalMotionBounds(self._tree, self._joint_numbers, self.rows)

    def around(self, X: Array, moved: Array) -> tuple[Array, Array]:
        """Return (`poses(X)`, bounds (k, pairs) in m of the relative motion of each pair) around X (k, nq).

        Args:
            X: (k, nq) configurations.
            moved: (k, nv) largest motion of each coordinate from X, in m or rad.
        """
        joints = self._tree.place(X)
        poses = joints[:, self._joint_numbers] @ self._Ts_joint_shape
        if self.local_bounds is None:
            bounds = self.global_bounds.bounds(X, moved.max(axis=0))
            return poses, np.einsum("kj,pj->kp", moved, bounds)
        centres, _ = self._boxes(poses)
        return poses, self.local_bounds.bounds(joints, centres, self._radii, moved).T

    def _boxes(self, poses: Array) -> tuple[Array, Array]:
        """Return centres and half edges (shapes, 3, k) in m of boxes along the axes of base around the shapes."""
        T = np.ascontiguousarray(np.moveaxis(poses[:, :, :3], 0, -1))  # numpy is fast along the last axis
        m = self._middles[:, None, :, None]
        h = self._half_edges[:, None, :, None]
        centres = T[:, :, 0] * m[:, :, 0] + T[:, :, 1] * m[:, :, 1] + T[:, :, 2] * m[:, :, 2] + T[:, :, 3]
        R = np.abs(T[:, :, :3])
        half_edges = R[:, :, 0] * h[:, :, 0] + R[:, :, 1] * h[:, :, 1] + R[:, :, 2] * h[:, :, 2]
        return centres, half_edges

    def gaps(self, poses: Array, states: np.ndarray, pairs: np.ndarray) -> Array:
        """Return lower bounds (n,) in m of the distances of `pairs` (n,) at rows `states` (n,) of poses.

        The bounds are the distances of boxes along the axes of base.
        """
        centres, half_edges = self._boxes(poses)
        a, b = self.rows[pairs].T
        between_centres = np.abs(centres[a, :, states] - centres[b, :, states])
        gap = np.maximum(between_centres - half_edges[a, :, states] - half_edges[b, :, states], 0.0)
        return np.sqrt((gap * gap).sum(axis=1))

    def hulls_apart(self, pair: int, poses: Array) -> float:
        """Return a lower bound in m of a pair's distance at shape poses (shapes, 4, 4), from the convex hulls."""
        a, b = self.rows[pair]
        hull_a = self.shapes[a].hull
        hull_b = self.shapes[b].hull
        request = coal.DistanceRequest()
        result = coal.DistanceResult()
        distance = coal.distance(hull_a, placed(poses[a]), hull_b, placed(poses[b]), request, result)
        return float(distance) - _HULL_DISTANCE_ERROR

    def nearer(self, pair: int, poses: Array, margin: float) -> bool:
        """Return whether the distance of a pair is below `margin` in m at shape poses (shapes, 4, 4)."""
        # the hulls first: they are convex, and much faster
        if self.hulls_apart(pair, poses) < margin:
            return self.distance(pair, poses, margin) < margin
        return False

    def distance(self, pair: int, poses: Array, most: float = np.inf) -> float:
        """Return the distance in m of a pair's meshes at shape poses (shapes, 4, 4), at most `most`; 0: they collide.

        The computation is faster for a smaller `most`.
        """
        a, b = self.rows[pair]
        return distance_between(self.shapes[a], self.shapes[b], poses[a], poses[b], most)

    def celled(self, pair: int) -> bool:
        """Return whether distances of a pair are stored in cells; see `closer`."""
        return pair in self._turns

    def closer(self, pair: int, X: Array, poses: Array) -> np.ndarray:
        """Return (k,) bool: whether the exact distance of a pair is below its required distance at X (k, nq).

        The relative motion of some pairs (jaws and wrist of an instrument) depends on few joint angles, and their two
        bodies are often close. Distance tests of close meshes are slow, so these angles are divided into cells, and
        one result is stored for each cell. Between the middle and any other point of a cell, the relative motion of the
        two bodies is at most half of the required distance.
        """
        required = float(self.required[pair])
        undecided = np.ones(len(X), bool)
        if pair in self._turns:
            moving, edges = self._turns[pair]
            numbers = np.rint(X[:, moving] / edges).astype(int)
            cells, row = np.unique(numbers, axis=0, return_inverse=True)
            is_free = np.zeros(len(cells), bool)
            for i, cell in enumerate(cells.tolist()):
                is_free[i] = self._free_cell(pair, tuple(cell), X[0])
            undecided = ~is_free[row.ravel()]
        is_closer = np.zeros(len(X), bool)
        for k in np.flatnonzero(undecided):
            is_closer[k] = self.nearer(pair, poses[k], required)
        return is_closer

    def _free_cell(self, pair: int, cell: tuple[int, ...], x: Array) -> bool:
        """Return whether a pair has its required distance in a whole cell; x (nq,) contains the other coordinates."""
        key = (pair, *cell)
        if key in self._cells:
            return self._cells[key]
        moving, edges = self._turns[pair]
        middle = x.copy()
        middle[moving] = np.array(cell) * edges
        poses = self.poses(middle[None])[0]
        # one required distance in the cell, and half of one for the motion from its middle
        margin = 1.5 * float(self.required[pair])
        free = not self.nearer(pair, poses, margin)
        self._cells[key] = free
        return free

    def seem_near(
        self, X: Array, poses: Array, states: np.ndarray, pairs: np.ndarray, low: Array, high: Array, matter: np.ndarray
    ) -> np.ndarray:
        """Return (n,) bool: whether distances of `pairs` (n,) in `states` (n,) seem to be below the required ones.

        This is a fast test for searches. A pair seems near if the mean of the bounds `low` and `high` (n,) is below its
        required distance. For large bodies, which have large balls, the mean may be too large. Therefore, if `low` is 0
        and the required distance is the full clearance, the exact distance decides. Exact distances are computed only
        in the states for which `matter` (k,) is true, and in each of these states only until one pair is near.
        """
        required = self.required[pairs]
        seems_near = (low + high) / 2 < required
        is_open = ~seems_near & (low <= 0) & (required >= self._clearance)
        possible = matter.copy()
        possible[states[seems_near]] = False
        for i in np.flatnonzero(is_open):
            k = int(states[i])
            if not possible[k]:
                continue
            is_near = self.closer(int(pairs[i]), X[[k]], poses[[k]])
            seems_near[i] = is_near[0]
            possible[k] = not seems_near[i]
        return seems_near

    def near(self, X: Array, *, exact: bool = True) -> np.ndarray:
        """Return (k,) bool: whether the distance of any pair is below its required distance at X (k, nq).

        Pairs that the bounds do not decide are decided by the exact distance or, without `exact`, by `seem_near`.
        """
        is_near = np.zeros(len(X), bool)
        if not len(self):
            return is_near
        poses = self.poses(X)
        states, pairs = np.divmod(np.arange(len(X) * len(self)), len(self))
        close = self.gaps(poses, states, pairs) < self.required[pairs]
        states = states[close]
        pairs = pairs[close]
        required = self.required[pairs]
        smallest_radius = 0.0
        if not exact:
            smallest_radius = SEARCH_BALL_RADIUS
        low, high = self.bounds.at(poses, states, pairs, required, required, smallest_radius)
        is_near[states[high < required]] = True
        if not exact:
            seems_near = self.seem_near(X, poses, states, pairs, low, high, ~is_near)
            is_near[states[seems_near]] = True
            return is_near
        unknown = low < required
        for pair in np.unique(pairs[unknown]):
            k = states[unknown & (pairs == pair)]
            k = k[~is_near[k]]  # one near pair is enough
            is_near[k] = self.closer(int(pair), X[k], poses[k])
        return is_near
