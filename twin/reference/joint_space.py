"""The joint space of a mechanism: joint limits, and joint values at which its bodies do not collide.

`JointSpace` joins what a search of paths needs: limits of driven and passive joints, closed loops (`loop_closing`), and
distances of bodies at states (`collision_pairs`) and along paths (`path_clearance`). A path q(s) is checked as a whole:

1. It is within limits, and its *stations*, states with closed loops in small steps, are allowed and free of collisions.
2. Between stations, the motion of each coordinate is bounded by its speeds.
3. With these bounds, no pair of bodies can come near in any interval of s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from types import MappingProxyType

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.core.units import DEG, MM, ROUNDING, display_unit
from twin.model.mechanism import Mechanism
from twin.reference.collision_pairs import SEARCH_BALL_RADIUS, CollisionPairs, Obstacle
from twin.reference.joint_range import within_limits
from twin.reference.loop_closing import Closing
from twin.reference.model import ReferenceModel
from twin.reference.path_clearance import Certificate, PathBatch, Stations, are_clear, certify, nearest

_ANGLE_LENGTH = 0.1
"""Length in m that is equivalent to 1 rad in comparisons of paths."""

_STATION_TURN = 0.1
"""Motion in rad of a driven angle between two stations (states with closed, tested loops)."""

_STATION_SLIDE = 0.02
"""Motion in m of a driven slide between two stations."""

_COARSE_INTERVALS = 64
"""Number of intervals of a path by which its length is estimated."""

_INTERVALS = 512
"""Number of intervals of a path; the speed assumed in one is `_SPEED_FACTOR` times the larger speed at its ends."""

_SPEED_FACTOR = 1.05
"""Safety factor: in a corner rounded over 1/80 of a path (six intervals), the speed within an interval exceeds the
speeds at its two ends by up to 0.3 %."""

_PASSIVE_SPEED_FACTOR = 1.5
"""Safety factor for passive joints, whose speeds are known only at stations; the value is chosen, not derived."""

_SAME_POSITION = 1 * MM
"""Two assemblies are in the same mode if each body has the same position in both, within this distance in m."""

_BLOCK = 2048
"""Number of states whose distances are computed together."""


def _nothing() -> None:
    """Do nothing."""


Keep = Callable[[Array, Array], np.ndarray]
"""Additional test of states: T_base_tool (k, 4, 4), q (k, n) -> (k,) bool: whether each state is allowed."""


class JointSpace:
    """Collision-free joint space of a mechanism, for path searches; implements `twin.planning.space.Space`.

    Two kinds of pairs are not tested: bodies connected by a joint (the joint limits separate them), and bodies that
    touch in the rest poses. Meshes are surfaces: a body that is completely inside another one is not detected.

    Attributes:
        clearance: required distance in m between two bodies. If half of the distance of two bodies of the mechanism in
            the rest poses is less than `clearance`, this half is required. Between the tested values of s, half of the
            required distance is guaranteed.
    """

    def __init__(
        self,
        make: Callable[[], ReferenceModel],
        clearance: float,
        *,
        keep: Keep | None = None,
        around: Callable[[], Sequence[Obstacle]] | None = None,
        arms: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Define the space of a mechanism; nothing is computed yet.

        Args:
            make: function that returns the mechanism's model, called at first use.
            clearance: required distance in m between bodies; see the class.
            keep: additional test of states; None: all states are allowed.
            around: function that returns the obstacles, called at first use; None: there are none.
            arms: name of the arm of each body, for a mechanism made by `twin.model.combined_arms`; see its `owners`.
        """
        self._make = make
        self.clearance = clearance
        self._keep = keep
        self._around = around
        self._arms = arms
        self._check: Callable[[], None] = _nothing

    def load(self) -> JointSpace:
        """Make shapes, grids and balls now, and return this space; otherwise the first tests make them and are slow."""
        self._pairs.load()
        return self

    def keeping(self, keep: Keep) -> JointSpace:
        """Return the same space with `keep` as its additional test; shapes and stored distances are shared."""
        _ = self._pairs
        space = copy(self)
        space._keep = keep
        return space

    def interruptible(self, check: Callable[[], None]) -> JointSpace:
        """Return this space with tests that call `check` every few milliseconds; errors in `check` end the test.

        Shapes and stored distances are shared.
        """
        _ = self._pairs
        space = copy(self)
        space._check = check
        return space

    @cached_property
    def _model(self) -> ReferenceModel:
        return self._make()

    @cached_property
    def _pairs(self) -> CollisionPairs:
        obstacles: Sequence[Obstacle] = ()
        if self._around is not None:
            obstacles = self._around()
        return CollisionPairs(self._model, obstacles, self.clearance, self._arms)

    @cached_property
    def _closing(self) -> Closing:
        return Closing(self._model, self.weights)

    @property
    def _has_loops(self) -> bool:
        return self._closing.linear is None

    # -- the interface for searches -------------------------------------------------------------------

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism whose joints these are."""
        return self._model.mechanism

    @property
    def limits(self) -> Array:
        """Lower and upper limits (n, 2) of the driven joints in rad or m.

        Raises:
            MechanismError: a joint has no limits, so that its values cannot be sampled.
        """
        limits, _ = self._scales
        return limits

    @property
    def weights(self) -> Array:
        """Lengths (n,) in m that are equivalent to 1 rad or 1 m of each driven joint."""
        _, weights = self._scales
        return weights

    @property
    def leads(self) -> np.ndarray:
        """(n,) bool: whether each driven joint can move the tool."""
        mechanism = self._model.mechanism
        return np.array([joint not in mechanism.auxiliary for joint in mechanism.active], bool)

    @cached_property
    def _scales(self) -> tuple[Array, Array]:
        """(Limits, weights) of the driven joints."""
        mechanism = self._model.mechanism
        active = mechanism.active
        limits = mechanism.limits
        for joint, (low, high) in zip(active, limits, strict=True):
            if not np.isfinite(high - low):
                raise MechanismError(
                    f"joint '{joint.name}' has no limits, so a path around obstacles cannot be searched: add limits "
                    "to the robot's description"
                )
        weights = np.ones(len(active))
        for i, joint in enumerate(active):
            if joint.is_angle:
                weights[i] = _ANGLE_LENGTH
        return limits, weights

    def free(self, q: Array, *, exact: bool = True) -> np.ndarray:
        """Return (k,) bool: whether joint values q (k, n) are free.

        Joint values are free if they are within limits, the loops close, `keep` allows the state, and all required
        distances are kept. If not `exact`, `CollisionPairs.seem_near` judges the distances that the bounds leave open.
        """
        self._check()
        q = np.asarray(q, float).reshape(-1, len(self.weights))
        is_free = self._within(q)
        X = np.zeros((len(q), self._model.tree.model.nq))
        X[is_free], is_free[is_free] = self._closing.states(q[is_free], thorough=exact)
        is_free[is_free] = self._allowed(X[is_free], q[is_free])
        is_free[is_free] = ~self._pairs.near(X[is_free], exact=exact)
        return is_free

    def clearances(self, q: Array, most: float) -> Array:
        """Return lower bounds (k,) in m of the smallest distance between bodies at q (k, n); each is at most `most`.

        Pairs of bodies of the mechanism that are nearer than twice the clearance in the rest poses are not included.
        Where loops do not close, the value is 0.
        """
        q = np.asarray(q, float).reshape(-1, len(self.weights))
        included = np.flatnonzero(self._pairs.required >= self.clearance)
        bounds = np.full(len(q), most)
        for first in range(0, len(q), _BLOCK):
            self._check()
            block = slice(first, first + _BLOCK)
            X, closed = self._closing.states(q[block], thorough=False)
            poses = self._pairs.poses(X)
            # all included pairs in all states of the block
            states = np.repeat(np.arange(len(X)), len(included))
            pair = np.tile(included, len(X))
            is_near = self._pairs.gaps(poses, states, pair) < most
            states = states[is_near]
            pair = pair[is_near]
            enough = np.full(len(pair), most)
            low, _ = self._pairs.bounds.at(poses, states, pair, enough, smallest_radius=SEARCH_BALL_RADIUS)
            np.minimum.at(bounds, first + states, low)
            bounds[block][~closed] = 0.0
        return bounds

    def steer(self, a: Array, b: Array) -> Callable[..., Array]:
        """Return the straight path from joint values a (n,) to b (n,), as a function of s from 0 to 1."""
        step = np.asarray(b, float) - a

        def path(s: Array, order: int = 0) -> Array:
            s = np.asarray(s, float)[:, None]
            if order == 0:
                return a + s * step
            rate = step
            if order != 1:
                rate = 0 * step
            return np.broadcast_to(rate, (len(s), len(a)))

        return path

    def free_between(self, a: Array, b: Array) -> bool:
        """Return whether the straight path from a (n,) to b (n,) is free of collisions."""
        return self.free_along(self.steer(a, b))

    def free_along(self, path: Callable[..., Array]) -> bool:
        """Return whether a path q(s), s from 0 to 1, is free of collisions; see `twin.planning.path.Path`."""
        stations = self._stations(path)
        if stations is None:
            return False
        return self._is_clear(stations)

    def why(self, q: Array) -> str:
        """Return why joint values q (n,) are not free, with numbers; "" if they are free."""
        q = np.asarray(q, float)
        for joint, x, (low, high) in zip(self._model.mechanism.active, q, self.limits, strict=True):
            unit, factor = display_unit(joint.is_angle)
            beyond = max(low - x, x - high)
            if beyond > ROUNDING:
                return (
                    f"joint {joint.name} = {x / factor:.6g} {unit} is {beyond / factor:.4g} {unit} beyond its limits "
                    f"{low / factor:.6g} to {high / factor:.6g} {unit}"
                )
        x = self._state(q)
        if x is None:
            return "the loops of the mechanism do not close"
        text = self._beyond_passive_limit(x)
        if text:
            return text
        pair, distance = self._worst_pair(x)
        if pair is None:
            return ""
        a, b = self._pairs.rows[pair]
        names = f"{self._pairs.shapes[a].name} and {self._pairs.shapes[b].name}"
        required = float(self._pairs.required[pair])
        if distance <= 0:
            return f"{names} collide (required: {required / MM:.3g} mm apart)"
        return f"{names} are {distance / MM:.2f} mm apart (required: {required / MM:.3g} mm)"

    def too_small_distance(self, q: Array) -> float | None:
        """Return the distance in m of the two bodies that lack most of the required clearance at q (n,).

        It is 0 or less if they collide; None if q is free, or not free for another reason than a distance: the reason
        that `why` states.
        """
        q = np.asarray(q, float)
        low, high = self.limits.T
        if (np.maximum(low - q, q - high) > ROUNDING).any():
            return None
        x = self._state(q)
        if x is None or self._beyond_passive_limit(x):
            return None
        pair, distance = self._worst_pair(x)
        if pair is None:
            return None
        return distance

    def _beyond_passive_limit(self, x: Array) -> str:
        """Return which passive joint exceeds its limits at a state x, and by how much; "" if none does."""
        links = self._model.link_poses(x[None])
        for joint in self._model.mechanism.limited:
            over = float(joint.beyond(links[joint.parent], links[joint.child])[0])
            if over > ROUNDING:
                unit, factor = display_unit(joint.is_angle or joint.cone is not None)
                return f"passive joint {joint.name} is {over / factor:.4g} {unit} beyond its limits"
        return ""

    def _worst_pair(self, x: Array) -> tuple[int | None, float]:
        """Return the pair that lacks most of its required distance at a state x, and its distance in m.

        The pair is None, and the distance infinite, if no pair is too near.
        """
        pairs = self._pairs
        poses = pairs.poses(x[None])
        every = np.arange(len(pairs))
        is_near = pairs.gaps(poses, 0 * every, every) < pairs.required
        worst: int | None = None
        distance_of_worst = np.inf
        most = 0.0
        for pair in np.flatnonzero(is_near):
            distance = pairs.distance(int(pair), poses[0])
            lacking = float(pairs.required[pair]) - distance
            if lacking > most:
                most = lacking
                worst = int(pair)
                distance_of_worst = distance
        return worst, distance_of_worst

    def nearest(self, q: Array) -> tuple[float, tuple[str, str]]:
        """Return the smallest distance in m of two bodies at joint values q (n,), and the names of these bodies.

        The pairs are those of `certify`. If there are no pairs, infinity and empty names are returned.

        Raises:
            MechanismError: the loops of the mechanism do not close.
        """
        x = self._state(np.asarray(q, float))
        if x is None:
            raise MechanismError("the loops of the mechanism do not close")
        pairs = self._pairs
        poses = pairs.poses(x[None])
        included = np.flatnonzero(pairs.required >= self.clearance)
        gaps = pairs.gaps(poses, 0 * included, included)
        smallest = np.inf
        names = ("", "")
        # the gaps are lower bounds: the first one that is too large ends the search
        for k in np.argsort(gaps, kind="stable"):
            if gaps[k] >= smallest:
                break
            pair = int(included[k])
            if not pairs.hulls_apart(pair, poses[0]) < smallest:
                continue
            distance = pairs.distance(pair, poses[0], smallest)
            if distance < smallest:
                smallest = distance
                a, b = pairs.rows[pair]
                names = (pairs.shapes[a].name, pairs.shapes[b].name)
        return smallest, names

    def named(self, q: Array) -> str:
        """Return joint values q (n,) as text, with names and units as in a waypoint of a protocol."""
        values = []
        for joint, x in zip(self._model.mechanism.active, q, strict=True):
            if joint.is_angle:
                values.append(f"{joint.name}_deg = {x / DEG:.4g}")
            else:
                values.append(f"{joint.name}_mm = {x / MM:.4g}")
        return ", ".join(values)

    # -- states ---------------------------------------------------------------------------------------

    def _within(self, q: Array) -> np.ndarray:
        """Return (k,) bool: whether joint values q (k, n) are within limits."""
        low, high = self.limits.T
        above = q >= low - ROUNDING
        below = q <= high + ROUNDING
        return np.all(above & below, axis=1)

    def _allowed(self, X: Array, q: Array) -> np.ndarray:
        """Return (k,) bool: whether limits of passive joints and `keep` allow configurations (k, nq) at q (k, n)."""
        is_allowed = within_limits(self._model, X)
        if self._keep is None:
            return is_allowed
        tree = self._model.tree
        Ts_base_tool = tree.tool(tree.place(X))
        return is_allowed & self._keep(Ts_base_tool, q)

    def _state(self, q: Array) -> Array | None:
        """Return the configuration (nq,) at q (n,); None if the loops do not close."""
        X, closed = self._closing.states(q[None])
        if not closed[0]:
            return None
        return X[0]

    def _placed(self, q: Array) -> Array:
        """Return configurations (k, nq) at joint values q (k, n) of a mechanism without loops."""
        return self._closing.placed(q)

    def _station_count(self, path: Callable[..., Array]) -> int:
        """Return the number of stations of a path; between them, no driven joint moves more than its step."""
        coarse = path(np.linspace(0.0, 1.0, _COARSE_INTERVALS + 1))
        strides = np.abs(np.diff(coarse, axis=0)) / self._steps
        # this many times the longest stride is at least the length of the path
        intervals = int(np.ceil(_COARSE_INTERVALS * strides.max(initial=0.0)))
        return max(intervals + 1, 2)

    @property
    def _steps(self) -> Array:
        """Largest motion (n,) in rad or m of each driven joint between two stations."""
        return np.where(self._model.tree.are_angles, _STATION_TURN, _STATION_SLIDE)

    def _stations(self, path: Callable[..., Array]) -> Stations | None:
        """Return the stations of a path; None if limits are exceeded, a state is not allowed, or the loops open."""
        s_of_intervals = np.linspace(0.0, 1.0, _INTERVALS + 1)
        q = path(s_of_intervals)
        if not self._within(q).all():
            return None
        rates = np.abs(path(s_of_intervals, 1))
        if not self._has_loops:
            fastest = (rates / self._steps).max()
            intervals_per_station = max(1, int(1 / max(fastest, 1.0) * _INTERVALS))
            s = s_of_intervals[::intervals_per_station]
            X = self._placed(q[::intervals_per_station])
            speeds = rates @ np.abs(self._gain).T
            speeds_at = s_of_intervals
            factor = _SPEED_FACTOR
        else:
            x = self._state(q[0])
            if x is None:
                return None
            s = np.linspace(0.0, 1.0, self._station_count(path))
            X = self._closing.along(path, x, s, self._check)
            if X is None or not self._is_same_mode(X[-1], q[-1]):
                return None
            speeds = np.abs(np.einsum("kij,kj->ki", self._closing.rates(X), path(s, 1)))
            speeds_at = s
            factor = _PASSIVE_SPEED_FACTOR
        if not self._allowed(X, path(s)).all():
            return None
        fastest = np.maximum(speeds[1:], speeds[:-1])
        step_lengths = factor * fastest * np.diff(speeds_at)[:, None]
        start = np.zeros((1, step_lengths.shape[1]))
        travel = np.concatenate([start, np.cumsum(step_lengths, axis=0)])
        return Stations(path, self._closing, s, X, speeds_at, travel)

    def _is_same_mode(self, x: Array, q: Array) -> bool:
        """Return whether x is in the assembly mode of the state stored for q; if none is stored, store x."""
        x_known = self._closing.stored(q)
        if x_known is None:
            self._closing.store(q[None], x[None])
            return True
        a, b = self._pairs.poses(np.array([x, x_known]))
        shifts = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1)
        return float(shifts.max(initial=0.0)) < _SAME_POSITION

    # -- distances ------------------------------------------------------------------------------------

    def _is_clear(self, stations: Stations) -> bool:
        """Return whether all pairs have the required distance at the tested s, and half of this distance at all s."""
        if len(self._pairs) and self._pairs.near(stations.X).any():
            return False

        def configurations(path: np.ndarray, s: Array) -> Array | None:
            return stations.at(s)

        def motion(path: np.ndarray, s: Array, width: float) -> Array:
            return stations.ahead(s, width)

        (is_clear,) = are_clear(PathBatch(1, configurations, motion), self._pairs, self._check)
        return bool(is_clear)

    def free_each(self, a: Array, b: Array) -> np.ndarray:
        """Return (m,) bool: whether the straight paths from a (m, n) to b (m, n), with free ends, are probably free.

        All paths are tested at once, for a search: bounds decide most distances, and loops are closed approximately.
        `free_between` tests a path exactly.
        """
        a = np.asarray(a, float)
        b = np.asarray(b, float)
        if not len(a):
            return np.zeros(0, bool)
        if self._has_loops:
            return self._free_each_closed(a, b)
        is_free = self._within(a) & self._within(b)
        is_free[is_free] = self._allowed_between(a[is_free], b[is_free])
        first = a[is_free]
        step = (b - a)[is_free]
        if not len(self._pairs) or not len(first):
            return is_free
        travel = np.abs(step @ self._gain.T)

        def configurations(path: np.ndarray, s: Array) -> Array:
            return self._placed(first[path] + s[:, None] * step[path])

        def motion(path: np.ndarray, s: Array, width: float) -> Array:
            return width / 2 * travel[path]

        paths = PathBatch(len(first), configurations, motion)
        is_free[is_free] = are_clear(paths, self._pairs, self._check, exact=False)
        return is_free

    def _allowed_between(self, a: Array, b: Array) -> np.ndarray:
        """Return (m,) bool: whether all stations of the straight paths from a (m, n) to b (m, n) are allowed."""
        untested = self._keep is None and not self._model.mechanism.limited
        is_allowed = np.ones(len(a), bool)
        if untested or not len(a):
            return is_allowed
        strides = np.abs(b - a) / self._steps
        counts = np.ceil(strides.max(axis=1)).astype(int) + 1
        path = np.repeat(np.arange(len(a)), counts + 1)
        parameters = []
        for intervals in counts:
            parameters.append(np.linspace(0.0, 1.0, intervals + 1))
        s = np.concatenate(parameters)
        q = a[path] + s[:, None] * (b - a)[path]
        allowed = self._allowed(self._placed(q), q)
        is_allowed[path[~allowed]] = False
        return is_allowed

    def _free_each_closed(self, a: Array, b: Array) -> np.ndarray:
        """Return the result of `free_each`, (m,) bool, for straight paths of a mechanism with loops."""
        strides = np.abs(b - a) / self._steps
        count = max(int(np.ceil(strides.max())) + 1, 2)  # 2 also if all have no length
        intervals = count - 1
        stations, is_free = self._closing.straight_paths(a, b, count)
        is_free &= self._within(a) & self._within(b)
        rows = np.flatnonzero(is_free)
        if not len(rows):
            return is_free
        nq = self._model.tree.model.nq
        nv = self._model.tree.model.nv
        X = stations[rows].reshape(-1, nq)
        part = np.linspace(0.0, 1.0, count)
        step = (b - a)[rows]
        q = (a[rows, None] + part[:, None] * step[:, None]).reshape(len(X), -1)
        allowed = self._allowed(X, q).reshape(-1, count).all(axis=1)
        rates = np.repeat(step, count, axis=0)
        speeds = np.abs(np.einsum("kij,kj->ki", self._closing.rates(X), rates))
        speeds = speeds.reshape(-1, count, nv)
        fastest = np.maximum(speeds[:, 1:], speeds[:, :-1])
        step_lengths = _PASSIVE_SPEED_FACTOR / intervals * fastest
        start = np.zeros_like(step_lengths[:, :1])
        travel = np.concatenate([start, np.cumsum(step_lengths, axis=1)], axis=1)  # at the stations

        def travel_until(path: np.ndarray, s: Array) -> Array:
            i = np.minimum((s * intervals).astype(int), count - 2)
            part = (s * intervals - i)[:, None]
            return (1 - part) * travel[path, i] + part * travel[path, i + 1]

        def configurations(path: np.ndarray, s: Array) -> Array:
            i = np.minimum((s * intervals).astype(int), count - 2)
            row = path * count + i
            return self._closing.between(X[row], X[row + 1], s * intervals - i)

        def motion(path: np.ndarray, s: Array, width: float) -> Array:
            low = travel_until(path, s - 0.5 * width)
            middle = travel_until(path, s)
            high = travel_until(path, s + 0.5 * width)
            return np.maximum(high - middle, middle - low)

        if len(self._pairs):
            paths = PathBatch(len(rows), configurations, motion)
            allowed = allowed & are_clear(paths, self._pairs, self._check, exact=False)
        is_free[rows] = allowed
        return is_free

    @property
    def _gain(self) -> Array:
        """Rates (nv, n) of the tree joints per rate of each driven joint, for a mechanism without loops."""
        assert self._closing.linear is not None
        G, _ = self._closing.linear
        return G

    # -- the certificate ------------------------------------------------------------------------------

    def certify(self, path: Callable[..., Array], within: float = 0.5 * MM) -> Certificate:
        """Return a proven lower bound of the distance between bodies along a whole path (`path_clearance`).

        Pairs of bodies of the mechanism that are nearer than twice the clearance in the rest poses are not included:
        for them, `free_along` requires half of their distance in the rest poses.

        Args:
            path: a path for which `free_along` is true.
            within: accepted difference in m between the smallest distance found and the bound.

        Raises:
            MechanismError: the path exceeds joint limits, `keep` excludes a state, or the loops open.
        """
        certificates = self.certify_each(path, lambda a, b: "", within)
        return nearest(certificates.values())

    def certify_each(
        self, path: Callable[..., Array], group: Callable[[str, str], str], within: float = 0.5 * MM
    ) -> dict[str, Certificate]:
        """Return the result of `certify` for each group of pairs; `group(a, b)` is the group name of bodies a, b.

        Raises:
            MechanismError: as in `certify`.
        """
        stations = self._stations(path)
        if stations is None:
            raise MechanismError(
                "the path exceeds joint limits, has states that the additional test excludes, "
                "or the loops of the mechanism do not close along it"
            )
        pairs = self._pairs
        groups: dict[str, list[int]] = {}
        for k in np.flatnonzero(pairs.required >= self.clearance):
            a, b = pairs.rows[k]
            name = group(pairs.shapes[a].name, pairs.shapes[b].name)
            groups.setdefault(name, []).append(int(k))
        certificates = {}
        for name, which in groups.items():
            certificates[name] = certify(stations, pairs, np.array(which), within, self._check)
        return certificates
