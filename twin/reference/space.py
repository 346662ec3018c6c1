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
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.reference.model import GAP_TOLERANCE, ReferenceModel
from twin.reference.newton import minimise
from twin.reference.pairs import SEARCHED, Pairs, Still

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
"""Safety factor: in a corner rounded over 1/80 of a path (six intervals), the speed within an interval exceeds the
speeds at its two ends by up to 0.3 %."""

_BETWEEN_LOOPS = 1.5
"""Safety factor for passive joints, whose speeds are known only at stations; the value is chosen, not derived."""

_SAME = 1 * MM
"""Two assemblies are in the same mode if each body has the same position in both, within this distance in m."""

_LEVELS = 2
"""Number of halvings of an interval at once: few large batches are faster than many small ones."""

_NARROW = 3.0
"""Largest margin, in units of the required distance, for which meshes are tested; for larger margins coal is slow."""

_SEARCH = 6 * MM
"""Motion in m of two bodies from the nearest tested state that a search accepts; paths found are tested whole."""

_FAR = 100 * MM
"""Distance in m up to which a certificate asks for lower bounds, as long as no exact distance is known."""

Keep = Callable[[Array, Array], np.ndarray]
"""Additional test of states: T_base_tool (k, 4, 4), q (k, n) -> (k,) bool: whether each state is allowed."""


@dataclass(frozen=True)
class _Stations:
    """A path with its stations, and bounds of the relative motions.

    Attributes:
        path: the path q(s).
        s: (k,) values of s at the stations.
        X: (k, nq) configurations at the stations.
        fine: (m,) values of s from 0 to 1.
        moved: (m, nv) in m or rad, upper bound of the path length of each coordinate from s = 0 to `fine`.
    """

    path: Callable[[Array], Array]
    s: Array
    X: Array
    fine: Array
    moved: Array

    def ahead(self, s: Array, width: float) -> Array:
        """Return the largest motion (k, nv) of each coordinate from s (k,) to both ends of an interval around s."""
        low, middle, high = (self._moved_until(s + part * width) for part in (-0.5, 0.0, 0.5))
        return np.maximum(high - middle, middle - low)

    def _moved_until(self, s: Array) -> Array:
        i = np.clip(np.searchsorted(self.fine, s, side="right") - 1, 0, len(self.fine) - 2)
        part = (s - self.fine[i]) / (self.fine[i + 1] - self.fine[i])
        return self.moved[i] + part[:, None] * (self.moved[i + 1] - self.moved[i])


@dataclass(frozen=True)
class Certificate:
    """Distance between bodies along a path.

    Attributes:
        proven: lower bound in m of the distance along the whole path.
        found: smallest distance in m at the tested values of s.
        s: value of s at which this distance was found.
        bodies: names of the two bodies with this distance; "" if there are none.
    """

    proven: float
    found: float
    s: float
    bodies: tuple[str, str]


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

    def keeping(self, keep: Keep) -> JointSpace:
        """Return the same space with another additional test of states; shapes and stored distances are shared."""
        _ = self._pairs
        out = copy(self)
        out._keep = keep
        return out

    @cached_property
    def _model(self) -> ReferenceModel:
        return self._make()

    @cached_property
    def _pairs(self) -> Pairs:
        return Pairs(self._model, self._around() if self._around else (), self.clearance)

    @cached_property
    def _coupled(self) -> tuple[Array, Array] | None:
        """Return (G (nv, n), x0 (nv,)) such that x = G q + x0 closes the mechanism; None if it has other loops.

        Belts, gears and cables are linear, so that the passive coordinates follow from the driven ones.
        """
        tree = self._model.tree
        active, passive = tree.active, tree.passive
        if tree.loops.joints or tree.model.nq != tree.model.nv:
            return None
        rows, totals = np.zeros((len(tree.loops.couplings), tree.model.nv)), np.zeros(len(tree.loops.couplings))
        for row, total, coupling in zip(rows, range(len(totals)), tree.loops.couplings, strict=True):
            row[coupling.columns] = coupling.ratios
            totals[total] = coupling.total
        if len(rows) != len(passive) or np.linalg.matrix_rank(rows[:, passive]) < len(passive):
            return None
        G, x0 = np.zeros((tree.model.nv, len(active))), np.zeros(tree.model.nv)
        G[active] = np.eye(len(active))
        G[passive] = -np.linalg.solve(rows[:, passive], rows[:, active])
        x0[passive] = np.linalg.solve(rows[:, passive], totals)
        return G, x0

    @property
    def _loops(self) -> bool:
        return self._coupled is None

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

    @property
    def leads(self) -> np.ndarray:
        """(n,) bool: whether each driven joint can move the tool."""
        mechanism = self._model.mechanism
        return np.array([j not in mechanism.auxiliary for j in mechanism.active], bool)

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

    def free(self, q: Array, *, exact: bool = True) -> np.ndarray:
        """Return (k,) bool: whether joint values q (k, n) are within limits, with closed loops and the clearance.

        Without `exact`, a distance whose bounds do not decide is taken as the mean of its bounds; see `Pairs.near`.
        """
        q = np.asarray(q, float).reshape(-1, len(self.weights))
        ok = self._within(q)
        if self._loops:
            X = np.zeros((len(q), self._model.tree.model.nq))
            for k in np.flatnonzero(ok):
                x = self._state(q[k])
                ok[k] = x is not None
                X[k] = x if x is not None else 0.0
        else:
            X = self._placed(q)
        ok[ok] = self._allowed(X[ok], q[ok])
        ok[ok] = ~self._pairs.near(X[ok], exact=exact)
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
        poses = self._pairs.poses(x[None])
        worst, most = "", 0.0
        every = np.arange(len(self._pairs))
        for pair in np.flatnonzero(self._pairs.gaps(poses, 0 * every, every) < self._pairs.required):
            distance, required = self._pairs.distance(int(pair), poses[0]), float(self._pairs.required[pair])
            names = " and ".join(self._pairs.shapes[i].name for i in self._pairs.rows[pair])
            if required - distance > most:
                most = required - distance
                worst = f"{names} are {distance / MM:.2f} mm apart (required: {required / MM:.3g} mm)"
                if distance <= 0:
                    worst = f"{names} collide (required: {required / MM:.3g} mm apart)"
        return worst

    def named(self, q: Array) -> str:
        """Return joint values q (n,) as text, with names and units as in a waypoint of a protocol."""
        names = [
            f"{j.name}_deg = {x / DEG:.4g}" if j.is_angle else f"{j.name}_mm = {x / MM:.4g}"
            for j, x in zip(self._model.mechanism.active, q, strict=True)
        ]
        return ", ".join(names)

    # -- states ---------------------------------------------------------------------------------------

    def _within(self, q: Array) -> np.ndarray:
        return np.all((q >= self.limits[:, 0]) & (q <= self.limits[:, 1]), axis=1)

    def _allowed(self, X: Array, q: Array) -> np.ndarray:
        """Return (k,) bool: whether `keep` allows configurations (k, nq) with driven joint values q (k, n)."""
        if self._keep is None:
            return np.ones(len(X), bool)
        tree = self._model.tree
        return self._keep(tree.tool(tree.place(X)), q)

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
        assert self._coupled is not None
        G, x0 = self._coupled
        return q @ G.T + x0

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
            speeds = rates @ np.abs(self._coupled[0]).T if self._coupled else speeds
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
        moved = np.concatenate([np.zeros((1, cells.shape[1])), np.cumsum(cells, axis=0)])
        return _Stations(path, s, X, speeds_at, moved)

    def _same(self, x: Array, q: Array) -> bool:
        """Return whether x is in the assembly mode already stored for joint values q; store x if none is stored."""
        known = next((X for at, X in self._known if np.array_equal(at, q)), None)
        if known is None:
            self._known.append((q, x))
            return True
        a, b = self._pairs.poses(np.array([x, known]))
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

    def _clear(self, seen: _Stations) -> bool:
        """Return whether all pairs have the required distance where tested, and half of it along the whole path."""
        if len(self._pairs) and self._pairs.near(seen.X).any():
            return False

        ok = self._clear_each(1, lambda path, s: self._at(seen, s), lambda path, s, width: seen.ahead(s, width))
        return bool(ok[0])

    def _clear_each(
        self,
        count: int,
        at: Callable[[np.ndarray, Array], Array | None],
        ahead: Callable[[np.ndarray, Array, float], Array],
        *,
        exact: bool = True,
    ) -> np.ndarray:
        """Return (count,) bool: whether all pairs have the required distance where tested, and half of it elsewhere.

        Without `exact`, a distance whose bounds do not decide is taken as the mean of its bounds.

        Args:
            count: number of paths.
            at: function of path (k,) and s (k,): configurations (k, nq), or None if loops open.
            ahead: function of path (k,), s (k,) and width: (k, nv), largest motion of each coordinate from s to both
                ends of an interval of this width around s.
            exact: whether exact distances decide where bounds do not.
        """
        pairs, ok = self._pairs, np.ones(count, bool)
        # items: one pair in one interval of one path
        path, pair = np.divmod(np.arange(count * len(pairs)), max(len(pairs), 1))
        place, level = np.zeros(len(path), int), 0
        while len(path):
            width = 0.5**level
            keys, row = np.unique(path * 2**level + place, return_inverse=True)
            paths, s = keys >> level, ((keys & (2**level - 1)) + 0.5) * width
            X = at(paths, s)
            if X is None:
                return np.zeros(count, bool)
            poses, ways = pairs.around(X, ahead(paths, s, width))
            required, way = pairs.required[pair], ways[row, pair]
            margin = np.maximum(required, required / 2 + way)
            left = np.flatnonzero(pairs.gaps(poses, row, pair) < margin)
            least, most = pairs.bounds(
                *(poses, row[left], pair[left], margin[left], required[left]), 0.0 if exact else SEARCHED
            )
            blocked = most if exact else (least + most) / 2
            ok[path[left[blocked < required[left]]]] = False
            left = left[(least < margin[left]) & ok[path[left]]]
            # where the bounds do not decide and the interval is short, exact distances do
            split = [] if exact else left[way[left] > _SEARCH]
            for i in left if exact else ():
                if not ok[path[i]]:
                    continue
                p, T = int(pair[i]), poses[row[i]]
                if margin[i] <= required[i]:
                    ok[path[i]] = not pairs.closer(p, X[row[i]][None], T[None])[0]
                elif margin[i] > _NARROW * required[i] or pairs.celled(p) or pairs.nearer(p, T, float(margin[i])):
                    split.append(i)
            left = np.array([i for i in split if ok[path[i]]], int)
            path, pair = np.repeat(path[left], 2**_LEVELS), np.repeat(pair[left], 2**_LEVELS)
            place = (place[left, None] * 2**_LEVELS + np.arange(2**_LEVELS)).ravel()
            level += _LEVELS
        return ok

    def free_each(self, a: Array, b: Array) -> np.ndarray:
        """Return (m,) bool: whether the straight paths from a (m, n) to b (m, n), with free ends, are probably free.

        All paths are tested at once, by bounds of distances only. For a mechanism with loops, each path is tested
        separately and exactly by `free_between`.
        """
        a, b = np.asarray(a, float), np.asarray(b, float)
        if self._coupled is None or not len(a):
            return np.array([self.free_between(p, q) for p, q in zip(a, b, strict=True)], bool)
        ok = self._within(a) & self._within(b)
        ok[ok] = self._allowed_between(a[ok], b[ok])
        first, step = a[ok], (b - a)[ok]
        if not len(self._pairs) or not len(first):
            return ok
        moved = np.abs(step @ self._coupled[0].T)
        ok[ok] = self._clear_each(
            len(first),
            lambda path, s: self._placed(first[path] + s[:, None] * step[path]),
            lambda path, s, width: width / 2 * moved[path],
            exact=False,
        )
        return ok

    def _allowed_between(self, a: Array, b: Array) -> np.ndarray:
        """Return (m,) bool: whether `keep` allows all stations of the straight paths from a (m, n) to b (m, n)."""
        if self._keep is None or not len(a):
            return np.ones(len(a), bool)
        steps = np.array([_STATION[j.is_angle] for j in self._model.mechanism.active])
        counts = np.ceil((np.abs(b - a) / steps).max(axis=1)).astype(int) + 1
        path = np.repeat(np.arange(len(a)), counts + 1)
        s = np.concatenate([np.linspace(0.0, 1.0, n + 1) for n in counts])
        q = a[path] + s[:, None] * (b - a)[path]
        out = np.ones(len(a), bool)
        out[path[~self._allowed(self._placed(q), q)]] = False
        return out

    # -- the certificate ------------------------------------------------------------------------------

    def certify(self, path: Callable[..., Array], within: float = 0.5 * MM) -> Certificate:
        """Return a proven lower bound of the distance between bodies along a whole path, by exact distances only.

        In an interval of s, the distance of a pair is at least its distance in the middle minus the largest possible
        approach (`travel`) in half of the interval. Intervals are halved until this bound is less than `within` below
        the smallest distance found. Pairs of bodies of the mechanism that are nearer than twice the clearance in the
        rest poses are not included: for them, `free_along` requires half of their distance in the rest poses.

        Args:
            path: a path for which `free_along` is true.
            within: accepted difference in m between the smallest distance found and the bound.

        Raises:
            MechanismError: the loops of the mechanism do not close along the path.
        """
        seen, pairs = self._stations(path), self._pairs
        if seen is None:
            raise MechanismError("the path exceeds limits, is not allowed, or the loops of the mechanism do not close")
        pair = np.flatnonzero(pairs.required >= self.clearance)
        place, level = np.zeros(len(pair), int), 0
        least, proven, at, names = np.inf, np.inf, 0.0, ("", "")
        while len(pair):
            width = 0.5**level
            places, row = np.unique(place, return_inverse=True)
            X = self._at(seen, (places + 0.5) * width)
            if X is None:
                raise MechanismError("the loops of the mechanism do not close along the path")
            poses, ways = pairs.around(X, seen.ahead((places + 0.5) * width, width))
            ahead = ways[row, pair]
            bound, halved = pairs.gaps(poses, row, pair), []
            near = np.flatnonzero(bound - ahead < least - within)
            # what is needed to leave a pair out; a first guess, as nothing is found yet, is a large distance
            wanted = np.minimum(least, _FAR) - within + ahead[near]
            bound[near] = np.maximum(bound[near], pairs.bounds(poses, row[near], pair[near], wanted)[0])
            for i in np.argsort(bound - ahead, kind="stable"):
                if bound[i] - ahead[i] < least - within:
                    bound[i] = pairs.distance(int(pair[i]), poses[row[i]])
                    if bound[i] < least:
                        least, at = float(bound[i]), float((places[row[i]] + 0.5) * width)
                        names = tuple(pairs.shapes[j].name for j in pairs.rows[pair[i]])
            left = bound - ahead < least - within
            proven = min(proven, float((bound - ahead)[~left].min(initial=np.inf)))
            halved = np.flatnonzero(left)
            pair = np.repeat(pair[halved], 2)
            place = np.column_stack([2 * place[halved], 2 * place[halved] + 1]).ravel()
            level += 1
        return Certificate(max(min(proven, least), 0.0), least, at, (names[0], names[1]))
