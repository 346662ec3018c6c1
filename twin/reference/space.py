"""The joint space of a mechanism: limits, and what is free of collisions between its bodies and obstacles.

A path is checked without steps. At the middle of an interval of s a pair of bodies is at some distance; where that
exceeds what the two can move towards each other in half of the interval (`travel`), the whole interval is free of
them, otherwise it is halved. The distance of their convex hulls, which is never larger, is enough for most; where it is
not and little is left to move, coal says whether the meshes are nearer than that, in a fraction of the time that their
distance takes.
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
"""Metres that count as much as a radian where paths are compared."""

_STATION = {True: 0.1, False: 0.02}
"""Rad and m of a driven joint between two stations, at which loops are closed and `keep` is asked."""

_ITERATIONS = 8
"""Newton steps from one station to the next after which loops count as open: from near a closed state, 3 are usual."""

_JUMP = 0.5
"""Largest change (m, rad) of any coordinate between stations; more is another branch."""

_FINE = 512
"""Intervals in which the speed of a path is taken as the larger one of both ends, ..."""

_BETWEEN = 1.05
"""... times this: where corners are rounded over 1/80 of the path, six intervals, it is 0.3 % larger between."""

_BETWEEN_LOOPS = 1.5
"""The same for coordinates that loops lead, whose speeds are known at stations only. Chosen, not derived."""

_SAME = 1 * MM
"""Two assemblies whose bodies are nearer than this are the same: their loops are closed in the same way."""

_FIRST = 5
"""Halvings at which the middle itself is asked first: most paths that are not free are seen there."""

_NARROW = 3.0
"""Margin over the required distance up to which meshes are asked: with larger ones coal takes seconds."""

_GJK = 1e-5
"""m by which a distance of hulls may be too large."""

Keep = Callable[[Array, Array], np.ndarray]
"""T_base_tool (k, 4, 4), q (k, n) -> which of these are allowed (k,) for other reasons."""


@dataclass(frozen=True)
class Still:
    """A body at rest: "owner/body", what it is made of, its pose T_base_body (4, 4).

    `touches` names bodies of the mechanism that touch it by design.
    """

    name: str
    body: Body
    T_base_body: Array
    touches: frozenset[str] = frozenset()


@dataclass(frozen=True)
class _Pair:
    """Two bodies that may meet: their rows among the shapes, and the distance in m that is required."""

    a: int
    b: int
    required: float


@dataclass(frozen=True)
class _Stations:
    """A path looked at.

    Attributes:
        path: what is looked at.
        s: (k,) stations. X: (k, nq) configurations there.
        fine: (m,) values of s, and moved: (m, pairs) m by which each pair has moved at most until there.
    """

    path: Callable[[Array], Array]
    s: Array
    X: Array
    fine: Array
    moved: Array

    def moved_until(self, s: Array) -> Array:
        """Return m (k, pairs) by which each pair has moved at most until s (k,)."""
        i = np.clip(np.searchsorted(self.fine, s, side="right") - 1, 0, len(self.fine) - 2)
        part = (s - self.fine[i]) / (self.fine[i + 1] - self.fine[i])
        return self.moved[i] + part[:, None] * (self.moved[i + 1] - self.moved[i])


class JointSpace:
    """What a search asks of a mechanism; see `twin.planning.space.Space`.

    Bodies that a joint connects are left out, for its limits keep them apart, and pairs that touch as drawn. Meshes
    are surfaces: a body that is wholly inside another from the start is not seen.

    Attributes:
        clearance: m that two bodies must keep; two of the mechanism that are nearer as drawn keep half of that
            distance. Between the places at which they are compared it may be half of what is required.
    """

    def __init__(
        self,
        make: Callable[[], ReferenceModel],
        clearance: float,
        *,
        keep: Keep | None = None,
        around: Callable[[], Sequence[Still]] | None = None,
    ) -> None:
        """Make the space of a mechanism.

        Args:
            make: its model, made when it is needed.
            clearance: see the class.
            keep: what else must hold.
            around: obstacles, made when it is needed.
        """
        self._make, self.clearance, self._keep, self._around = make, clearance, keep, around
        self._known: list[tuple[Array, Array]] = []

    @cached_property
    def _model(self) -> ReferenceModel:
        return self._make()

    @cached_property
    def _shapes(self) -> tuple[list[Shape], np.ndarray, Array]:
        """Shapes, with the Pinocchio joint that carries each, and its pose (4, 4) in that frame."""
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
        ]  # the corners of its box are at least as far out as any point of a body
        return Reach(self._model.tree, [(at[p.a], at[p.b]) for p in self._pairs])

    @cached_property
    def _loops(self) -> bool:
        return len(self._model.tree.passive) > 0

    @cached_property
    def _driven(self) -> np.ndarray:
        """Configuration indices (n,) of the driven joints."""
        tree = self._model.tree
        return np.array([tree.configuration[j.name] for j in self._model.mechanism.active], int)

    # -- what a search asks ---------------------------------------------------------------------------

    @property
    def limits(self) -> Array:
        """Lower and upper limits (n, 2) of the driven joints in rad or m.

        Raises:
            MechanismError: a joint has none: where it may go cannot be sampled.
        """
        return self._scales[0]

    @property
    def weights(self) -> Array:
        """Metres (n,) that a rad or m of each driven joint counts for."""
        return self._scales[1]

    @cached_property
    def _scales(self) -> tuple[Array, Array]:
        active, limits = self._model.mechanism.active, self._model.mechanism.limits
        for joint, (low, high) in zip(active, limits, strict=True):
            if not np.isfinite(high - low):
                raise MechanismError(
                    f"joint '{joint.name}' has no limits, so a way around obstacles cannot be searched: give it limits "
                    "in the robot's description"
                )
        return limits, np.array([_ANGLE if j.is_angle else 1.0 for j in active])

    def free(self, q: Array) -> np.ndarray:
        """Return (k,) booleans: True where the loops close at joint values q (k, n) and the clearance is kept."""
        q = np.asarray(q, float).reshape(-1, len(self.weights))
        ok = self._within(q)
        for k in np.flatnonzero(ok):
            x = self._state(q[k])
            ok[k] = x is not None and self._allowed(x[None], q[k][None])[0] and not self._near(x[None])
        return ok

    def steer(self, a: Array, b: Array) -> Callable[..., Array]:
        """Return the straight path from a (n,) to b (n,)."""
        step = np.asarray(b, float) - a

        def path(s: Array, order: int = 0) -> Array:
            s = np.asarray(s, float)[:, None]
            return a + s * step if order == 0 else np.broadcast_to(step if order == 1 else 0 * step, (len(s), len(a)))

        return path

    def free_between(self, a: Array, b: Array) -> bool:
        """Return whether the straight path from a (n,) to b (n,) is free."""
        return self.free_along(self.steer(a, b))

    def free_along(self, path: Callable[..., Array]) -> bool:
        """Return whether a path q(s), s from 0 to 1, is free; see `twin.planning.path.Path`."""
        seen = self._stations(path)
        return seen is not None and self._clear(seen)

    def why(self, q: Array) -> str:
        """Return what is not free at joint values q (n,), with numbers; "" if all is."""
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
        """Return which of configurations (k, nq) with joints q (k, n) `keep` allows."""
        if self._keep is None:
            return np.ones(len(X), bool)
        tree = self._model.tree
        return self._keep(tree.tool(tree.update(X, closing_only=True)[0]), q)

    def _state(self, q: Array) -> Array | None:
        """Return the configuration (nq,) at joint values q (n,), loops closed from the nearest that is known."""
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
        """Return configurations (k, nq) of a mechanism without loops."""
        X = np.tile(self._model.home().x if len(self._driven) < self._model.tree.model.nq else q[0], (len(q), 1))
        X[:, self._driven] = q
        return X

    def _closed(self, path: Callable[..., Array], x: Array) -> tuple[Array, Array | None]:
        """Return stations (k,) of a path that begins at configuration x, and configurations (k, nq) if loops close."""
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
        """Return a path looked at; None if it leaves the limits, is not allowed or its loops open."""
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
        """Return whether configuration x closes its loops as the one that is known at joint values q, if one is."""
        known = next((X for at, X in self._known if np.array_equal(at, q)), None)
        if known is None:
            self._known.append((q, x))
            return True
        a, b = self._poses(np.array([x, known]))
        return float(np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max(initial=0.0)) < _SAME

    def _at(self, seen: _Stations, s: Array) -> Array | None:
        """Return configurations (k, nq) at s (k,) of a path looked at; None if loops do not close."""
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
        """Return a lower bound (k, pairs) of distances in m, by boxes along the axes of base."""
        half = np.array([s.corners[-1] - s.corners[0] for s in self._shapes[0]]) / 2
        centre = np.array([s.corners[-1] + s.corners[0] for s in self._shapes[0]]) / 2
        c = np.einsum("ksij,sj->ksi", poses[..., :3, :3], centre) + poses[..., :3, 3]
        h = np.einsum("ksij,sj->ksi", np.abs(poses[..., :3, :3]), half)
        a, b = [p.a for p in self._pairs], [p.b for p in self._pairs]
        return box_gap(c[:, a] - h[:, a], c[:, a] + h[:, a], c[:, b] - h[:, b], c[:, b] + h[:, b])

    def _hulls_apart(self, pair: _Pair, poses: Array) -> float:
        """Return a lower bound of the distance of a pair in m at poses (shapes, 4, 4): that of its convex hulls."""
        a, b = self._shapes[0][pair.a].hull, self._shapes[0][pair.b].hull
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(a, placed(poses[pair.a]), b, placed(poses[pair.b]), request, result)) - _GJK

    def _hit(self, pair: _Pair, poses: Array, margin: float) -> bool:
        """Return whether a pair is nearer than a margin in m at poses (shapes, 4, 4)."""
        shapes = self._shapes[0]
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.security_margin = margin
        a, b = placed(poses[pair.a]), placed(poses[pair.b])
        return bool(coal.collide(shapes[pair.a].model, a, shapes[pair.b].model, b, request, result))

    def _near(self, X: Array) -> bool:
        """Return whether two bodies are nearer than required at one of configurations (k, nq)."""
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
        """Return whether all pairs keep half of their distance all along, and all of it where they are compared."""
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
