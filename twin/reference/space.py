"""The joint space of a mechanism: joint limits, and joint values at which its bodies do not collide.

A path q(s) is checked as a whole, not at sampled points. In the middle of an interval of s, the distance of a pair of
bodies is computed. Two bodies cannot collide in the interval if this distance exceeds the possible approach of the two
bodies in half of the interval (`travel`); otherwise the interval is halved.

For most intervals, the distance of the convex hulls, a lower bound, is sufficient. Where it is not, and the remaining
motion is small, coal tests whether the meshes are nearer than the motion. This is much faster than computing their
distance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import coal  # pyright: ignore[reportMissingImports] - installed beside site-packages
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.mechanism import Body
from twin.reference.clearance import TOUCHING, Shape, apart, box_gap, distance_between, placed
from twin.reference.model import GAP_TOLERANCE, ReferenceModel
from twin.reference.newton import minimise
from twin.reference.travel import Reach

_ANGLE = 0.1
"""Length in m that is equivalent to 1 rad in comparisons of paths."""

_STATION = {True: 0.1, False: 0.02}
"""Motion of a driven joint (rad if an angle, else m) between two stations (states with closed, tested loops)."""

_ITERATIONS = 8
"""Maximum number of Newton steps between two stations, after which loops count as open; 3 steps are usual."""

_JUMP = 0.5
"""Largest change (m, rad) of a coordinate between stations; a larger change means another assembly mode."""

_FINE = 512
"""Number of intervals of a path; in each, the speed is taken as the larger speed of both ends, times `_BETWEEN`."""

_BETWEEN = 1.05
"""Safety factor: in corners rounded over 1/80 of a path (six intervals), the speed exceeds both ends by up to 0.3 %."""

_BETWEEN_LOOPS = 1.5
"""Safety factor for passive joints, whose speeds are known only at stations; the value is chosen, not derived."""

_SAME = 1 * MM
"""Two assemblies are in the same mode if each body has the same position in both, within this distance in m."""

_FIRST = 5
"""Number of first halvings in which mesh collisions are tested, because they reject most blocked paths early."""

_NARROW = 3.0
"""Largest margin, in units of the required distance, for which meshes are tested; for larger margins coal is slow."""

_GJK = 1e-5
"""Accepted error in m by which a computed hull distance may be too large."""

Keep = Callable[[Array, Array], np.ndarray]
"""Additional test of states: T_base_tool (k, 4, 4), q (k, n) -> (k,) bool: whether each state is allowed."""


@dataclass(frozen=True)
class Still:
    """A body at rest (an obstacle): name "owner/body", body with its meshes, pose T_base_body (4, 4).

    `touches` names the bodies of the mechanism that touch it intentionally.
    """

    name: str
    body: Body
    T_base_body: Array
    touches: frozenset[str] = frozenset()


@dataclass(frozen=True)
class _Pair:
    """Two bodies that could collide: their indices in the shapes, and the required distance in m."""

    a: int
    b: int
    required: float


@dataclass(frozen=True)
class _Stations:
    """A path with its stations, and bounds of the relative motions.

    Attributes:
        path: the path q(s).
        s: (k,) values of s at the stations.
        X: (k, nq) configurations at the stations.
        fine: (m,) values of s from 0 to 1.
        moved: (m, pairs) in m, upper bound of the relative motion of each pair from s = 0 to `fine`.
    """

    path: Callable[[Array], Array]
    s: Array
    X: Array
    fine: Array
    moved: Array

    def moved_until(self, s: Array) -> Array:
        """Return the upper bound (k, pairs) in m of the relative motion of each pair from 0 to s (k,)."""
        i = np.clip(np.searchsorted(self.fine, s, side="right") - 1, 0, len(self.fine) - 2)
        part = (s - self.fine[i]) / (self.fine[i + 1] - self.fine[i])
        return self.moved[i] + part[:, None] * (self.moved[i + 1] - self.moved[i])


class JointSpace:
    """Collision-free joint space of a mechanism, for path searches; implements `twin.planning.space.Space`.

    Two kinds of pairs are not tested: bodies connected by a joint (the joint limits separate them), and bodies that
    touch in the rest poses. Meshes are surfaces: a body that is completely inside another one is not detected.

    Attributes:
        clearance: required distance in m between two bodies; for two bodies of the mechanism at most half of their
            distance in the rest poses. Between the tested values of s, half of the required distance is guaranteed.
    """

    def __init__(
        self,
        make: Callable[[], ReferenceModel],
        clearance: float,
        *,
        keep: Keep | None = None,
        around: Callable[[], Sequence[Still]] | None = None,
    ) -> None:
        """Define the space of a mechanism; nothing is computed yet.

        Args:
            make: function that returns the mechanism's model, called at first use.
            clearance: required distance in m between bodies; see the class.
            keep: additional test of states; None: all states are allowed.
            around: function that returns the obstacles, called at first use; None: there are none.
        """
        self._make, self.clearance, self._keep, self._around = make, clearance, keep, around
        self._known: list[tuple[Array, Array]] = []

    @cached_property
    def _model(self) -> ReferenceModel:
        return self._make()

    @cached_property
    def _shapes(self) -> tuple[list[Shape], np.ndarray, Array]:
        """Return (shapes, Pinocchio joint that carries each shape, pose (4, 4) of each shape in this joint's frame)."""
        own: dict[str, Shape] = {}
        for pair in apart(self._model.mechanism):
            own |= {s.name: s for s in pair}
        own |= (
            {b.name: Shape(b.name, b.name, b.meshes) for b in self._model.mechanism.bodies if b.meshes}
            if (self._still and len(own) < len([b for b in self._model.mechanism.bodies if b.meshes]))
            else {}
        )
        places = [self._model.tree.body(name) for name in own]
        others = [Shape(s.name, s.name, s.body.meshes) for s in self._still]
        numbers = [n for n, _ in places] + [0] * len(others)
        Ts = [T for _, T in places] + [s.T_base_body for s in self._still]
        return [*own.values(), *others], np.array(numbers, int), np.array(Ts).reshape(-1, 4, 4)

    @cached_property
    def _still(self) -> list[Still]:
        return [s for s in (self._around() if self._around else ()) if s.body.meshes]

    @cached_property
    def _pairs(self) -> list[_Pair]:
        shapes, numbers, _ = self._shapes
        rows = {s.name: i for i, s in enumerate(shapes)}
        home = self._model.home().link_poses
        out = []
        for a, b in apart(self._model.mechanism):
            drawn = distance_between(a, b, home[a.body], home[b.body])
            if drawn > TOUCHING:
                out.append(_Pair(rows[a.name], rows[b.name], min(self.clearance, drawn / 2)))
        for still in self._still:
            out += [
                _Pair(i, rows[still.name], self.clearance)
                for i in range(len(shapes) - len(self._still))
                if numbers[i] and shapes[i].name not in still.touches
            ]
        moves = [self._model.tree.moves(n) for n in numbers]
        return [p for p in out if (moves[p.a] != moves[p.b]).any()]

    @cached_property
    def _reach(self) -> Reach:
        shapes, numbers, Ts = self._shapes
        at = [
            (int(n), s.corners @ T[:3, :3].T + T[:3, 3]) for s, n, T in zip(shapes, numbers, Ts, strict=True)
        ]  # a body is inside its bounding box, so the corners' distance from an axis is an upper bound
        return Reach(self._model.tree, [(at[p.a], at[p.b]) for p in self._pairs])

    @cached_property
    def _loops(self) -> bool:
        return len(self._model.tree.passive) > 0

    @cached_property
    def _driven(self) -> np.ndarray:
        """Configuration indices (n,) of the driven joints."""
        tree = self._model.tree
        return np.array([tree.configuration[j.name] for j in self._model.mechanism.active], int)

    # -- the interface for searches -------------------------------------------------------------------

    @property
    def limits(self) -> Array:
        """Lower and upper limits (n, 2) of the driven joints in rad or m.

        Raises:
            MechanismError: a joint has no limits, so that its values cannot be sampled.
        """
        return self._scales[0]

    @property
    def weights(self) -> Array:
        """Lengths (n,) in m that are equivalent to 1 rad or 1 m of each driven joint."""
        return self._scales[1]

    @cached_property
    def _scales(self) -> tuple[Array, Array]:
        active, limits = self._model.mechanism.active, self._model.mechanism.limits
        for joint, (low, high) in zip(active, limits, strict=True):
            if not np.isfinite(high - low):
                raise MechanismError(
                    f"joint '{joint.name}' has no limits, so a path around obstacles cannot be searched: add limits "
                    "to the robot's description"
                )
        return limits, np.array([_ANGLE if j.is_angle else 1.0 for j in active])

    def free(self, q: Array) -> np.ndarray:
        """Return (k,) bool: whether joint values q (k, n) are within limits, with closed loops and the clearance."""
        q = np.asarray(q, float).reshape(-1, len(self.weights))
        ok = self._within(q)
        for k in np.flatnonzero(ok):
            x = self._state(q[k])
            ok[k] = x is not None and self._allowed(x[None], q[k][None])[0] and not self._near(x[None])
        return ok

    def steer(self, a: Array, b: Array) -> Callable[..., Array]:
        """Return the straight path from joint values a (n,) to b (n,), as a function of s from 0 to 1."""
        step = np.asarray(b, float) - a

        def path(s: Array, order: int = 0) -> Array:
            s = np.asarray(s, float)[:, None]
            return a + s * step if order == 0 else np.broadcast_to(step if order == 1 else 0 * step, (len(s), len(a)))

        return path

    def free_between(self, a: Array, b: Array) -> bool:
        """Return whether the straight path from a (n,) to b (n,) is free of collisions."""
        return self.free_along(self.steer(a, b))

    def free_along(self, path: Callable[..., Array]) -> bool:
        """Return whether a path q(s), s from 0 to 1, is free of collisions; see `twin.planning.path.Path`."""
        seen = self._stations(path)
        return seen is not None and self._clear(seen)

    def why(self, q: Array) -> str:
        """Return why joint values q (n,) are not free, with numbers; "" if they are free."""
        q = np.asarray(q, float)
        for joint, x, (low, high) in zip(self._model.mechanism.active, q, self.limits, strict=True):
            unit, factor = ("deg", DEG) if joint.is_angle else ("mm", MM)
            beyond = max(low - x, x - high)
            if beyond > 0:
                return (
                    f"joint {joint.name} = {x / factor:.6g} {unit} is {beyond / factor:.4g} {unit} beyond its limits "
                    f"{low / factor:.6g} to {high / factor:.6g} {unit}"
                )
        x = self._state(q)
        if x is None:
            return "the loops of the mechanism do not close"
        shapes, (poses,) = self._shapes[0], self._poses(x[None])
        worst = ""
        most = 0.0
        for p in self._pairs:
            distance = distance_between(shapes[p.a], shapes[p.b], poses[p.a], poses[p.b])
            names = f"{shapes[p.a].name} and {shapes[p.b].name}"
            if p.required - distance > most:
                most = p.required - distance
                worst = f"{names} are {distance / MM:.2f} mm apart (required: {p.required / MM:.3g} mm)"
                if distance <= 0:
                    worst = f"{names} collide (required: {p.required / MM:.3g} mm apart)"
        return worst

    # -- states ---------------------------------------------------------------------------------------

    def _within(self, q: Array) -> np.ndarray:
        return np.all((q >= self.limits[:, 0]) & (q <= self.limits[:, 1]), axis=1)

    def _allowed(self, X: Array, q: Array) -> np.ndarray:
        """Return (k,) bool: whether `keep` allows configurations (k, nq) with driven joint values q (k, n)."""
        if self._keep is None:
            return np.ones(len(X), bool)
        tree = self._model.tree
        return self._keep(tree.tool(tree.update(X, closing_only=True)[0]), q)

    def _state(self, q: Array) -> Array | None:
        """Return the configuration (nq,) at q (n,), solved from the nearest known one; None if loops open."""
        if not self._loops:
            return self._placed(q[None])[0]
        if not self._known:
            home = self._model.home()
            self._known.append((home.q, home.x))
        near = min(self._known, key=lambda known: float(np.abs((known[0] - q) * self.weights).max()))
        if np.array_equal(near[0], q):
            return near[1]
        X = self._closed(self.steer(near[0], q), near[1])[1]
        if X is None:
            return None
        self._known.append((q, X[-1]))
        return X[-1]

    def _placed(self, q: Array) -> Array:
        """Return configurations (k, nq) at joint values q (k, n) of a mechanism without loops."""
        X = np.tile(self._model.home().x if len(self._driven) < self._model.tree.model.nq else q[0], (len(q), 1))
        X[:, self._driven] = q
        return X

    def _closed(self, path: Callable[..., Array], x: Array) -> tuple[Array, Array | None]:
        """Return (stations (k,) of a path from configuration x, configurations (k, nq) or None if the loops open)."""
        coarse = path(np.linspace(0.0, 1.0, 65))
        steps = np.array([_STATION[j.is_angle] for j in self._model.mechanism.active])
        count = int(np.ceil(64 * (np.abs(np.diff(coarse, axis=0)) / steps).max(initial=0.0))) + 1
        s = np.linspace(0.0, 1.0, max(count, 2))
        tree, X, before = self._model.tree, [x], np.zeros(self._model.tree.model.nv)
        for q in path(s[1:]):
            guess = tree.integrate(X[-1][None], before[None])
            guess[0, self._driven] = q
            new, converged = minimise(tree, guess, self._model.loops_only, tree.passive, _ITERATIONS)
            step = pin.difference(tree.model, X[-1], new[0])
            gaps = tree.loops.gaps(new, tree.update(new, closing_only=True)[0])[..., 0]
            if not converged[0] or np.abs(step).max() > _JUMP or gaps.max(initial=0.0) > GAP_TOLERANCE:
                return s, None
            X.append(new[0])
            before = step
        return s, np.array(X)

    def _stations(self, path: Callable[..., Array]) -> _Stations | None:
        """Return the stations of a path; None if it exceeds limits, is not allowed, or its loops open."""
        fine = np.linspace(0.0, 1.0, _FINE + 1)
        q = path(fine)
        if not self._within(q).all():
            return None
        rates = np.abs(path(fine, 1))
        if not self._loops:
            turns = np.array([_STATION[j.is_angle] for j in self._model.mechanism.active])
            every = max(1, int(1 / max((rates / turns).max(), 1.0) * _FINE))
            s, X = fine[::every], self._placed(q[::every])
            speeds, factor, speeds_at = np.zeros((len(fine), self._model.tree.model.nv)), _BETWEEN, fine
            speeds[:, self._model.tree.active] = rates
        else:
            x = self._state(q[0])
            if x is None:
                return None
            s, found = self._closed(path, x)
            if found is None or not self._same(found[-1], q[-1]):
                return None
            X, factor, speeds_at = found, _BETWEEN_LOOPS, s
            speeds = np.abs(np.einsum("kij,kj->ki", self._model.gains(X), path(s, 1)))
        if not self._allowed(X, path(s)).all():
            return None
        cells = factor * np.maximum(speeds[1:], speeds[:-1]) * np.diff(speeds_at)[:, None]
        bounds = self._reach.bounds(X, cells.max(axis=0))
        moved = np.concatenate([np.zeros((1, len(bounds))), np.cumsum(cells @ bounds.T, axis=0)])
        return _Stations(path, s, X, speeds_at, moved)

    def _same(self, x: Array, q: Array) -> bool:
        """Return whether x is in the assembly mode already stored for joint values q; store x if none is stored."""
        known = next((X for at, X in self._known if np.array_equal(at, q)), None)
        if known is None:
            self._known.append((q, x))
            return True
        a, b = self._poses(np.array([x, known]))
        return float(np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max(initial=0.0)) < _SAME

    def _at(self, seen: _Stations, s: Array) -> Array | None:
        """Return configurations (k, nq) of a path at s (k,); None if the loops do not close."""
        q = seen.path(s)
        if not self._loops:
            return self._placed(q)
        tree = self._model.tree
        i = np.clip(np.searchsorted(seen.s, s, side="right") - 1, 0, len(seen.s) - 2)
        part = (s - seen.s[i]) / (seen.s[i + 1] - seen.s[i])
        X = tree.normalise((1 - part)[:, None] * seen.X[i] + part[:, None] * seen.X[i + 1])
        X[:, self._driven] = q
        X, converged = minimise(tree, X, self._model.loops_only, tree.passive)
        return X if converged.all() else None

    # -- distances ------------------------------------------------------------------------------------

    def _poses(self, X: Array) -> Array:
        """Return T_base_shape (k, shapes, 4, 4) at configurations (k, nq)."""
        _, numbers, Ts = self._shapes
        return self._model.tree.update(X)[0][:, numbers] @ Ts

    def _gaps(self, poses: Array) -> Array:
        """Return lower bounds (k, pairs) in m of the distances, from boxes along the axes of base."""
        half = np.array([s.corners[-1] - s.corners[0] for s in self._shapes[0]]) / 2
        centre = np.array([s.corners[-1] + s.corners[0] for s in self._shapes[0]]) / 2
        c = np.einsum("ksij,sj->ksi", poses[..., :3, :3], centre) + poses[..., :3, 3]
        h = np.einsum("ksij,sj->ksi", np.abs(poses[..., :3, :3]), half)
        a, b = [p.a for p in self._pairs], [p.b for p in self._pairs]
        return box_gap(c[:, a] - h[:, a], c[:, a] + h[:, a], c[:, b] - h[:, b], c[:, b] + h[:, b])

    def _hulls_apart(self, pair: _Pair, poses: Array) -> float:
        """Return the distance in m of a pair's convex hulls, a lower bound, at shape poses (shapes, 4, 4)."""
        a, b = self._shapes[0][pair.a].hull, self._shapes[0][pair.b].hull
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(a, placed(poses[pair.a]), b, placed(poses[pair.b]), request, result)) - _GJK

    def _hit(self, pair: _Pair, poses: Array, margin: float) -> bool:
        """Return whether the meshes of a pair are nearer than `margin` in m at shape poses (shapes, 4, 4)."""
        shapes = self._shapes[0]
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.security_margin = margin
        a, b = placed(poses[pair.a]), placed(poses[pair.b])
        return bool(coal.collide(shapes[pair.a].model, a, shapes[pair.b].model, b, request, result))

    def _near(self, X: Array) -> bool:
        """Return whether any two bodies are nearer than required at any of the configurations (k, nq)."""
        if not self._pairs:
            return False
        poses = self._poses(X)
        near = self._gaps(poses) < np.array([p.required for p in self._pairs])
        for k, row in zip(*np.nonzero(near), strict=True):
            pair = self._pairs[row]
            if self._hulls_apart(pair, poses[k]) < pair.required and self._hit(pair, poses[k], pair.required):
                return True
        return False

    def _clear(self, seen: _Stations) -> bool:
        """Return whether all pairs have the required distance where tested, and half of it along the whole path."""
        if not self._pairs or self._near(seen.X[[0, -1]]):
            return not self._pairs
        required = np.array([p.required for p in self._pairs])
        pair, place, level = np.arange(len(self._pairs)), np.zeros(len(self._pairs), int), 0
        while len(pair):
            width = 0.5**level
            places, row = np.unique(place, return_inverse=True)
            X = self._at(seen, (places + 0.5) * width)
            if X is None:
                return False
            poses = self._poses(X)
            low, middle, high = (seen.moved_until((places + part) * width) for part in (0.0, 0.5, 1.0))
            ahead = np.maximum(high - middle, middle - low)[row, pair]
            margin = np.maximum(required[pair], required[pair] / 2 + ahead)
            gaps = self._gaps(poses)[row, pair]
            left = np.flatnonzero(gaps < margin)
            left = left[np.argsort(gaps[left], kind="stable")]
            halved = []
            for i in left:
                p, T, most = self._pairs[pair[i]], poses[row[i]], float(margin[i])
                last, hulls = most <= p.required, self._hulls_apart(p, T)
                if hulls >= most:
                    continue
                if (last or level < _FIRST) and hulls < p.required and self._hit(p, T, p.required):
                    return False
                if not last and (most > _NARROW * p.required or self._hit(p, T, most)):
                    halved.append(i)
            pair = np.repeat(pair[halved], 2)
            place = np.column_stack([2 * place[halved], 2 * place[halved] + 1]).ravel()
            level += 1
        return True
