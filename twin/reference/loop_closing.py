"""States of a mechanism at given driven joint values, for searches: many at once, in the rest poses' assembly mode.

Belts, gears and cables are linear couplings, so that a matrix gives the passive coordinates. Other loops are closed by
Newton's method for all states together, from the nearest states that are known. The determinant of the loop equations
changes its sign at a singularity: a state whose determinant has another sign than in the rest poses is in another
assembly mode. Groups of loops that share no coordinate have separate determinants. Mode changes without a change of
these signs are found by following the path in small steps.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import cast

import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.reference.model import ReferenceModel
from twin.reference.newton import minimise
from twin.reference.target_continuation import GAP_TOLERANCE

_MOST_NEWTON_STEPS = 8
"""Maximum number of Newton steps from a guess; loops that need more steps count as open. 3 steps are usual."""

_MODE_JUMP = 0.5
"""Largest change (m, rad) of a coordinate between stations; a larger change means another assembly mode."""

_CERTAIN_TURN = 0.1
"""Step in rad of a driven angle from a known state, if the assembly mode must be certain."""

_CERTAIN_SLIDE = 0.02
"""Step in m of a driven slide from a known state, if the assembly mode must be certain."""

_STEP_DIVISORS = (1, 8)
"""Divisors of the certain steps, in the order of trial: near a singularity, passive joints need small steps."""

_STATIONS_IN_ORDER = 8
"""Number of stations of a path at which loops are closed one by one; the other stations are closed in batches."""

_SEARCH_COST = 1e-14
"""Sum of squares of loop gaps in m2 that is small enough for a search."""

_RATE_DAMPING = 1e-12
"""Damping of the linear equations of the rates, relative to the mean diagonal of the matrix; see `newton`."""

_SMALLEST_PIVOT = 1e-6
"""Pivot of the loop equations, relative to the largest one, up to which an equation depends on others."""

_TURN_FROM_REST = 0.1
"""Largest random displacement in rad or m from the rest poses, to see which coordinates move a loop."""

_ZERO_ENTRY = 1e-9
"""Entry of the loop Jacobian, relative to the largest one, up to which a coordinate does not move a loop."""

_MOST_STORED_STATES = 20_000
"""Maximum number of stored states that were not reached in small steps; if exceeded, the older half is dropped."""


class Closing:
    """Computes configurations of a mechanism at given driven joint values, with all loops closed.

    Attributes:
        linear: (G (nv, n), x0 (nv,)) such that x = G q + x0 closes the mechanism; None if the mechanism has loops that
            are not linear couplings.
    """

    def __init__(self, model: ReferenceModel, weights: Array) -> None:
        """Define the mechanism; distances of states use `weights` (n,), in m per unit (rad or m) of each joint."""
        tree = model.tree
        self._model = model
        self._tree = tree
        self._weights = weights
        self.linear = self._linear_solution()
        self._stride = np.where(tree.are_angles, _CERTAIN_TURN, _CERTAIN_SLIDE)
        # the known states: joint values, configurations, and whether each was reached in small steps
        self._q = np.zeros((0, len(weights)))
        self._x = np.zeros((0, tree.model.nq))
        self._in_small_steps = np.zeros(0, bool)
        self._row_of_key: dict[bytes, int] = {}  # rounded joint values -> row of the state

    def _linear_solution(self) -> tuple[Array, Array] | None:
        """Return the couplings, solved for the passive joints; None if they do not determine these, or with loops."""
        tree = self._tree
        active = tree.active
        passive = tree.passive
        nv = tree.model.nv
        couplings = tree.loops.couplings
        if tree.loops.joints or tree.model.nq != nv:
            return None
        rows = np.zeros((len(couplings), nv))
        totals = np.zeros(len(couplings))
        for i, coupling in enumerate(couplings):
            rows[i, coupling.columns] = coupling.ratios
            totals[i] = coupling.total
        passive_columns = rows[:, passive]
        if len(rows) != len(passive) or np.linalg.matrix_rank(passive_columns) < len(passive):
            return None
        G = np.zeros((nv, len(active)))
        G[active] = np.eye(len(active))
        G[passive] = -np.linalg.solve(passive_columns, rows[:, active])
        x0 = np.zeros(nv)
        x0[passive] = np.linalg.solve(passive_columns, totals)
        return G, x0

    def placed(self, q: Array) -> Array:
        """Return configurations (k, nq) at joint values q (k, n) of a mechanism that is `linear`."""
        assert self.linear is not None
        G, x0 = self.linear
        return q @ G.T + x0

    # -- single states --------------------------------------------------------------------------------

    def states(self, q: Array, *, thorough: bool = True) -> tuple[Array, np.ndarray]:
        """Return (configurations (k, nq), (k,) bool: whether the loops close) at joint values q (k, n).

        Each state is reached in small steps from the nearest known state, and stored as known. If not `thorough`, the
        state is reached in one step. One step is fast but not certain: loops that can close may be reported as open,
        and the state may be in another assembly mode. The mode is tested when a path to this state is followed.
        """
        if self.linear is not None:
            return self.placed(q), np.ones(len(q), bool)
        self._drop_old()
        if not len(self._q):
            home = self._model.home()
            self.store(home.q[None], home.x[None])
        rows = np.array([self._row_of_key.get(key, -1) for key in _keys(q)], int)
        X = self._x[rows]
        is_closed = np.ones(len(q), bool)
        unknown = rows < 0
        new = np.flatnonzero(unknown | (thorough & ~self._in_small_steps[rows]))
        if not len(new):
            return X, is_closed
        usable = np.arange(len(self._q))
        divisors = (0,)  # one step only
        if thorough:
            usable = np.flatnonzero(self._in_small_steps)
            divisors = _STEP_DIVISORS
        known_states = KDTree(self._q[usable] * self._weights)
        _, nearest = known_states.query(q[new] * self._weights, p=np.inf)
        nearest_rows = usable[nearest]
        is_closed[new] = False
        for divisor in divisors:
            strides = np.abs(q[new] - self._q[nearest_rows]) / self._stride
            steps = int(np.ceil(divisor * strides.max(initial=0.0)))
            walked, closes = self._walk(nearest_rows, q[new], max(steps, 1), small=thorough)
            reached = new[closes]
            self.store(q[reached], walked[closes], in_small_steps=thorough)
            X[reached] = walked[closes]
            is_closed[reached] = True
            new = new[~closes]
            nearest_rows = nearest_rows[~closes]
        return X, is_closed

    def store(self, q: Array, X: Array, *, in_small_steps: bool = True) -> None:
        """Store configurations X (k, nq) at q (k, n) as known states.

        `in_small_steps`: whether X was reached in small steps, so that its assembly mode is certain.
        """
        first = len(self._q)
        for i, key in enumerate(_keys(q)):
            self._row_of_key[key] = first + i
        self._q = np.concatenate([self._q, q])
        self._x = np.concatenate([self._x, X])
        self._in_small_steps = np.append(self._in_small_steps, np.full(len(q), in_small_steps))

    def _drop_old(self) -> None:
        """Drop the older half of the states that were not reached in small steps, if there are too many."""
        unsure = np.flatnonzero(~self._in_small_steps)
        if len(unsure) <= _MOST_STORED_STATES:
            return
        older = unsure[: len(unsure) // 2]
        remaining_rows = np.setdiff1d(np.arange(len(self._q)), older)
        self._q = self._q[remaining_rows]
        self._x = self._x[remaining_rows]
        self._in_small_steps = self._in_small_steps[remaining_rows]
        self._row_of_key = {key: i for i, key in enumerate(_keys(self._q))}

    def stored(self, q: Array) -> Array | None:
        """Return the stored configuration (nq,) at joint values q (n,); None if none is stored."""
        (key,) = _keys(np.asarray(q, float)[None])
        row = self._row_of_key.get(key)
        if row is None:
            return None
        return self._x[row]

    def _walk(self, start_rows: np.ndarray, q1: Array, steps: int, *, small: bool) -> tuple[Array, np.ndarray]:
        """Return (configurations (k, nq) at q1, (k,) bool: whether the loops close without a change of the mode).

        `start_rows` (k,) are the rows of the known states from which the walks start. With `small`, no coordinate may
        change by more than `_MODE_JUMP` in any step.
        """
        # several walks may start from one known state: its rates are computed once
        rows, row_of_walk = np.unique(start_rows, return_inverse=True)
        gain = self.rates(self._x[rows])[row_of_walk]
        sign = self.signs(self._x[rows])[row_of_walk]
        X = self._x[start_rows]
        q0 = self._q[start_rows]
        is_closed = np.ones(len(start_rows), bool)
        for i in range(1, steps + 1):
            walking = np.flatnonzero(is_closed)
            if not len(walking):
                break
            ahead = (q1 - q0)[walking] / steps
            tangent = np.einsum("kij,kj->ki", gain[walking], ahead)
            guess = self._tree.step(X[walking], tangent)
            new, closed = self.near(guess, q0[walking] + i * ahead)
            if small:
                closed &= self.change(X[walking], new) <= _MODE_JUMP
            closed &= (self.signs(new) == sign[walking]).all(axis=1)
            arrived = walking[closed]
            X[arrived] = new[closed]
            is_closed[walking[~closed]] = False
            if i < steps:
                gain[arrived] = self.rates(new[closed])
        return X, is_closed

    def near(self, X: Array, q: Array, enough: float | None = None) -> tuple[Array, np.ndarray]:
        """Return (configurations (k, nq) at q (k, n), (k,) bool: whether the loops close), by Newton's method from X.

        `enough` is the accepted sum of squares of the loop gaps in m2; None: the level of rounding errors.
        """
        X = X.copy()
        tree = self._tree
        X[:, tree.active_places] = q
        if enough is None:
            new, is_closed = minimise(tree, X, self._loops, tree.passive, _MOST_NEWTON_STEPS, integrate=tree.step)
        else:
            new, is_closed = minimise(
                tree, X, self._loops, tree.passive, _MOST_NEWTON_STEPS, integrate=tree.step, enough=enough
            )
        gaps = tree.loops.gaps(new, tree.place(new))
        is_closed &= gaps[..., 0].max(axis=1, initial=0.0) <= GAP_TOLERANCE
        return new, is_closed

    def _loops(self, X: Array, _: np.ndarray) -> tuple[Array, Array]:
        """Return the loop residuals (k, m) at configurations X (k, nq), and their Jacobians (k, m, nv)."""
        poses = self._tree.place(X)
        J = self._tree.columns(poses)
        return self._tree.loops.evaluate(X, poses, J)

    def _loop_jacobian(self, X: Array) -> Array:
        """Return the Jacobians (k, m, nv) of the loop residuals at configurations X (k, nq)."""
        _, A = self._loops(X, np.arange(len(X)))
        return A

    def rates(self, X: Array) -> Array:
        """Return the rates of tree joints (k, nv, n) per rate of each driven joint at closed configurations (k, nq)."""
        tree = self._tree
        rates = np.zeros((len(X), tree.model.nv, len(tree.active)))
        rates[:, tree.active] = np.eye(len(tree.active))
        if not len(X) or not len(tree.passive):
            return rates
        A = self._loop_jacobian(X)
        P = A[:, :, tree.passive]
        D = A[:, :, tree.active]
        Pt = np.swapaxes(P, 1, 2)
        normal = Pt @ P
        floor = _RATE_DAMPING * np.trace(normal, axis1=1, axis2=2) / len(tree.passive)
        damping = np.maximum(floor, np.finfo(float).tiny)[:, None, None]
        normal += damping * np.eye(len(tree.passive))
        rates[:, tree.passive] = -np.linalg.solve(normal, Pt @ D)
        return rates

    def change(self, X0: Array, X1: Array) -> Array:
        """Return the largest change (k,) in m or rad of any coordinate between configurations (k, nq)."""
        changes = np.abs(X1 - X0)
        for place in self._tree.quaternions:
            four = slice(place, place + 4)
            cosine = (X0[:, four] * X1[:, four]).sum(axis=1)
            # one rotation angle instead of four differences; q and -q are the same rotation
            changes[:, four] = 0.0
            changes[:, place] = 2 * np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
        return changes.max(axis=1, initial=0.0)

    @cached_property
    def _independent_rows(self) -> np.ndarray:
        """Independent loop equations (rows) in the rest poses, one per passive coordinate; empty if there are fewer."""
        passive = self._tree.passive
        home = self._model.home().x[None]
        A = self._loop_jacobian(home)[0][:, passive]
        if not A.size:
            return np.zeros(0, int)
        # scipy states all results that other arguments would have
        factors = cast("tuple[Array, Array, np.ndarray]", qr(A.T, mode="economic", pivoting=True))
        _, R, order = factors
        pivots = np.abs(np.diag(R))  # largest first
        count = A.shape[1]
        if len(pivots) != count or pivots[-1] <= _SMALLEST_PIVOT * pivots[0]:
            return np.zeros(0, int)
        return order[:count]

    @cached_property
    def _blocks(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(Rows of the loop equations, passive coordinates) of each group of loops; groups share no coordinate.

        The list is empty if the equations do not determine the passive coordinates (an internal freedom).
        """
        rows = self._independent_rows
        columns = self._tree.passive
        if not len(rows):
            return []
        # away from the rest poses, an entry is 0 only if its coordinate does not move the loop
        turned = np.random.default_rng(0).uniform(-_TURN_FROM_REST, _TURN_FROM_REST, (1, self._tree.model.nv))
        away = self._tree.step(self._model.home().x[None], turned)
        A = np.abs(self._loop_jacobian(away)[0])
        equation, coordinate = np.nonzero(A[rows][:, columns] > _ZERO_ENTRY * A.max())
        # nodes of the graph: first the equations, then the coordinates
        count = len(rows)
        edges = (equation, count + coordinate)
        graph = coo_array((np.ones(len(equation)), edges), shape=[2 * count] * 2)
        groups, group = connected_components(graph, directed=False)
        blocks = []
        for g in range(groups):
            own_rows = rows[group[:count] == g]
            own_columns = columns[group[count:] == g]
            blocks.append((own_rows, own_columns))
        return blocks

    def signs(self, X: Array) -> Array:
        """Return the sign (k, blocks) of the determinant of the loop equations of each block at X (k, nq)."""
        if not self._blocks:
            return np.zeros((len(X), 0))
        A = self._loop_jacobian(X)
        signs = []
        for rows, columns in self._blocks:
            sign, _ = np.linalg.slogdet(A[:, rows][:, :, columns])
            signs.append(sign)
        return np.column_stack(signs)

    # -- paths ----------------------------------------------------------------------------------------

    def between(self, X0: Array, X1: Array, part: Array) -> Array:
        """Return configurations (k, nq) at the fractions `part` (k,) from X0 to X1 (k, nq); loops are nearly closed."""
        end = X1.copy()
        for place in self._tree.quaternions:
            four = slice(place, place + 4)
            # the shorter way: q and -q are the same rotation
            opposite = (X0[:, four] * X1[:, four]).sum(axis=1) < 0
            end[opposite, four] *= -1.0
        column = part[:, None]
        return self._tree.unit((1 - column) * X0 + column * end)

    def along(self, path: Callable[..., Array], x: Array, s: Array, check: Callable[[], None]) -> Array | None:
        """Return configurations (k, nq) of a path at stations s (k,), starting from the configuration x (nq,) at s[0].

        Return None if the loops open, or if the assembly mode changes (a determinant changes its sign, or a coordinate
        changes by more than `_MODE_JUMP` between two stations). `check` is called between the steps.
        """
        # first few stations one by one, which is fast; if this fails, all of them
        counts = [_STATIONS_IN_ORDER]
        if len(s) - 1 > _STATIONS_IN_ORDER:
            counts.append(len(s) - 1)
        for count in counts:
            X = self._along(path(s), x, count, check)
            if X is not None:
                return X
        return None

    def _along(self, q: Array, x: Array, ahead: int, check: Callable[[], None]) -> Array | None:
        """Return the result of `along` for q (k, n) at the stations; about `ahead` stations are solved one by one."""
        X = np.tile(x, (len(q), 1))
        solved = spread(len(q), ahead + 1)
        for i, j in pairwise(solved.tolist()):
            check()
            tangent = self.rates(X[[i]]) @ (q[j] - q[i])
            guess = self._tree.step(X[[i]], tangent)
            X[[j]], closes = self.near(guess, q[[j]])
            if not closes[0]:
                return None
        # then the stations in the middle between solved ones, all at once
        while len(solved) < len(q):
            check()
            gap = np.diff(solved) > 1
            lower = solved[:-1][gap]
            upper = solved[1:][gap]
            middle = (lower + upper) // 2
            part = (middle - lower) / (upper - lower)
            guess = self.between(X[lower], X[upper], part)
            X[middle], closes = self.near(guess, q[middle])
            if not closes.all():
                return None
            solved = np.sort(np.concatenate([solved, middle]))
        same_mode = (self.signs(X) == self.signs(x[None])).all()
        if same_mode and (self.change(X[:-1], X[1:]) <= _MODE_JUMP).all():
            return X
        return None

    def straight_paths(self, a: Array, b: Array, stations: int) -> tuple[Array, np.ndarray]:
        """Return configurations (m, stations, nq) of straight paths from a to b (m, n), and (m,) bool: whether closed.

        This is a fast test for searches: the loops are closed approximately, and the assembly modes at both ends are
        those of the nearest known states.
        """
        m = len(a)
        part = np.linspace(0.0, 1.0, stations)
        ends, closed = self.states(np.concatenate([a, b]), thorough=False)
        is_closed = closed[:m] & closed[m:]
        # one row for each station of each path whose ends are closed
        parts = np.tile(part, int(is_closed.sum()))
        first = np.repeat(ends[:m][is_closed], stations, axis=0)
        last = np.repeat(ends[m:][is_closed], stations, axis=0)
        start = np.repeat(a[is_closed], stations, axis=0)
        change = np.repeat((b - a)[is_closed], stations, axis=0)
        q = start + parts[:, None] * change
        configurations, closed = self.near(self.between(first, last, parts), q, _SEARCH_COST)
        jumps = self.change(configurations[:-1], configurations[1:]) > _MODE_JUMP
        jumps[stations - 1 :: stations] = False  # not on a path: from the end of one path to the start of the next
        jumps = np.append(jumps, False)
        is_continuous = closed.reshape(-1, stations).all(axis=1)
        is_continuous &= ~jumps.reshape(-1, stations).any(axis=1)
        X = np.zeros((m, stations, ends.shape[1]))
        X[is_closed] = configurations.reshape(-1, stations, ends.shape[1])
        is_closed[is_closed] = is_continuous
        return X, is_closed


def _keys(q: Array) -> list[bytes]:
    """Return a key for each row of joint values q (k, n); rows that differ by rounding only have equal keys."""
    rounded = np.rint(q / ROUNDING).astype(np.int64)
    return [row.tobytes() for row in rounded]
