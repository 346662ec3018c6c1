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
from typing import Any

import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.reference.model import GAP_TOLERANCE, ReferenceModel
from twin.reference.newton import minimise

_ITERATIONS = 8
"""Maximum number of Newton steps from a guess; loops that need more steps count as open. 3 steps are usual."""

_JUMP = 0.5
"""Largest change (m, rad) of a coordinate between stations; a larger change means another assembly mode."""

_STRIDE = {True: 0.1, False: 0.02}
"""Step of a driven joint (rad if an angle, else m) from a known state, if the assembly mode must be certain."""

_FINER = (1, 8)
"""Divisors of `_STRIDE`, in the order of trial: near a singularity, passive joints move fast and need small steps."""

_COARSE = 8
"""Number of stations of a path at which loops are closed one by one; the other stations are closed in batches."""

_ENOUGH = 1e-14
"""Sum of squares of loop gaps in m2 that is small enough for a search."""

_FLOOR = 1e-12
"""Damping of the linear equations of the rates, relative to the mean diagonal of the matrix; see `newton`."""

_KNOWN = 20_000
"""Maximum number of stored states that were not reached in small steps; if exceeded, the older half is dropped."""


class Closing:
    """Computes configurations of a mechanism at given driven joint values, with all loops closed.

    Attributes:
        linear: (G (nv, n), x0 (nv,)) such that x = G q + x0 closes the mechanism; None if the mechanism has loops that
            are not linear couplings.
    """

    def __init__(self, model: ReferenceModel, weights: Array) -> None:
        """Define the mechanism; distances of states use `weights` (n,), in m per unit (rad or m) of each joint."""
        self._model, self._tree, self._weights = model, model.tree, weights
        self._driven = np.array([self._tree.configuration[j.name] for j in model.mechanism.active], int)
        self.linear = self._coupled()
        self._stride = np.array([_STRIDE[j.is_angle] for j in model.mechanism.active])
        self._q, self._x = np.zeros((0, len(weights))), np.zeros((0, self._tree.model.nq))
        self._sure = np.zeros(0, bool)  # whether a state was reached in small steps
        self._row: dict[bytes, int] = {}  # rounded joint values -> row of the state

    def _coupled(self) -> tuple[Array, Array] | None:
        tree = self._tree
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
            self.keep(home.q[None], home.x[None])
        rows = np.array([self._row.get(key, -1) for key in _keys(q)], int)
        X, good = self._x[rows], np.ones(len(q), bool)
        new = np.flatnonzero((rows < 0) | (thorough & ~self._sure[rows]))
        if not len(new):
            return X, good
        usable = np.flatnonzero(self._sure) if thorough else np.arange(len(self._q))
        near = usable[cKDTree(self._q[usable] * self._weights).query(q[new] * self._weights, p=np.inf)[1]]
        good[new] = False
        for finer in _FINER if thorough else (0,):
            steps = int(np.ceil(finer * (np.abs(q[new] - self._q[near]) / self._stride).max(initial=0.0)))
            found, ok = self._walk(near, q[new], max(steps, 1), small=thorough)
            self.keep(q[new[ok]], found[ok], sure=thorough)
            X[new[ok]], good[new[ok]] = found[ok], True
            new, near = new[~ok], near[~ok]
        return X, good

    def keep(self, q: Array, X: Array, *, sure: bool = True) -> None:
        """Store configurations X (k, nq) at q (k, n) as known states; `sure`: whether small steps reached X."""
        self._row |= {key: len(self._q) + i for i, key in enumerate(_keys(q))}
        self._q, self._x = np.concatenate([self._q, q]), np.concatenate([self._x, X])
        self._sure = np.append(self._sure, np.full(len(q), sure))

    def _drop_old(self) -> None:
        """Drop the older half of the states that were not reached in small steps, if there are too many."""
        unsure = np.flatnonzero(~self._sure)
        if len(unsure) <= _KNOWN:
            return
        left = np.setdiff1d(np.arange(len(self._q)), unsure[: len(unsure) // 2])
        self._q, self._x, self._sure = self._q[left], self._x[left], self._sure[left]
        self._row = {key: i for i, key in enumerate(_keys(self._q))}

    def known(self, q: Array) -> Array | None:
        """Return the stored configuration (nq,) at joint values q (n,); None if none is stored."""
        row = self._row.get(_keys(np.asarray(q, float)[None])[0])
        return None if row is None else self._x[row]

    def _walk(self, known: np.ndarray, q1: Array, steps: int, *, small: bool) -> tuple[Array, np.ndarray]:
        """Return (configurations (k, nq) at q1, (k,) bool: whether the loops close without a change of the mode).

        `known` (k,) are the rows of the known states from which the walk starts. With `small`, no coordinate may change
        by more than `_JUMP` in any step.
        """
        rows, of = np.unique(known, return_inverse=True)
        gain, sign = self.rates(self._x[rows])[of], self.signs(self._x[rows])[of]
        X, q0, ok = self._x[known], self._q[known], np.ones(len(known), bool)
        for i in range(1, steps + 1):
            here = np.flatnonzero(ok)
            if not len(here):
                break
            ahead = (q1 - q0)[here] / steps
            guess = self._tree.step(X[here], np.einsum("kij,kj->ki", gain[here], ahead))
            new, closed = self.near(guess, q0[here] + i * ahead)
            if small:
                closed &= self.change(X[here], new) <= _JUMP
            closed &= (self.signs(new) == sign[here]).all(axis=1)
            X[here[closed]] = new[closed]
            ok[here[~closed]] = False
            if i < steps:
                gain[here[closed]] = self.rates(new[closed])
        return X, ok

    # -- many states ----------------------------------------------------------------------------------

    def near(self, X: Array, q: Array, enough: float | None = None) -> tuple[Array, np.ndarray]:
        """Return (configurations (k, nq) at q (k, n), (k,) bool: whether the loops close), by Newton's method from X.

        `enough` is the accepted sum of squares of the loop gaps in m2; None: the level of rounding errors.
        """
        X = X.copy()
        X[:, self._driven] = q
        tree = self._tree
        more = {} if enough is None else {"enough": enough}
        new, ok = minimise(tree, X, self._loops, tree.passive, _ITERATIONS, integrate=tree.step, **more)
        ok &= tree.loops.gaps(new, tree.place(new))[..., 0].max(axis=1, initial=0.0) <= GAP_TOLERANCE
        return new, ok

    def _loops(self, X: Array, _: np.ndarray) -> tuple[Array, Array]:
        poses = self._tree.place(X)
        return self._tree.loops.evaluate(X, poses, self._tree.columns(poses))

    def rates(self, X: Array) -> Array:
        """Return the rates of tree joints (k, nv, n) per rate of each driven joint at closed configurations (k, nq)."""
        tree = self._tree
        out = np.zeros((len(X), tree.model.nv, len(tree.active)))
        out[:, tree.active] = np.eye(len(tree.active))
        if not len(X) or not len(tree.passive):
            return out
        A = self._loops(X, np.arange(len(X)))[1]
        P, D = A[:, :, tree.passive], A[:, :, tree.active]
        Pt = np.swapaxes(P, 1, 2)
        normal = Pt @ P
        floor = _FLOOR * np.trace(normal, axis1=1, axis2=2) / len(tree.passive)
        normal += np.maximum(floor, np.finfo(float).tiny)[:, None, None] * np.eye(len(tree.passive))
        out[:, tree.passive] = -np.linalg.solve(normal, Pt @ D)
        return out

    def change(self, X0: Array, X1: Array) -> Array:
        """Return the largest change (k,) in m or rad of any coordinate between configurations (k, nq)."""
        off = np.abs(X1 - X0)
        for place in self._tree.quaternions:
            a, b = X0[:, place : place + 4], X1[:, place : place + 4]
            off[:, place : place + 4] = 0.0
            off[:, place] = 2 * np.arccos(np.clip(np.abs((a * b).sum(axis=1)), 0.0, 1.0))
        return off.max(axis=1, initial=0.0)

    @cached_property
    def _independent(self) -> np.ndarray:
        """Independent loop equations (rows) in the rest poses, one per passive coordinate; empty if there are fewer."""
        A = self._loops(self._model.home().x[None], np.zeros(1, int))[1][0][:, self._tree.passive]
        if not A.size:
            return np.zeros(0, int)
        found: Any = qr(A.T, mode="economic", pivoting=True)
        size, order = np.abs(np.diag(found[1])), found[2]
        full = len(size) == A.shape[1] and bool(size[-1] > 1e-6 * size[0])
        return order[: A.shape[1]] if full else np.zeros(0, int)

    @cached_property
    def _blocks(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(Rows of the loop equations, passive coordinates) of each group of loops; groups share no coordinate.

        The list is empty if the equations do not determine the passive coordinates (an internal freedom).
        """
        rows, columns, tree = self._independent, self._tree.passive, self._tree
        if not len(rows):
            return []
        # away from the rest poses, an entry is 0 only if its coordinate does not move the loop
        turned = np.random.default_rng(0).uniform(-0.1, 0.1, (1, tree.model.nv))
        A = np.abs(self._loops(tree.step(self._model.home().x[None], turned), np.zeros(1, int))[1][0])
        linked = np.argwhere(A[rows][:, columns] > 1e-9 * A.max())
        graph = coo_array((np.ones(len(linked)), (linked[:, 0], len(rows) + linked[:, 1])), shape=[2 * len(rows)] * 2)
        count, group = connected_components(graph, directed=False)
        return [(rows[group[: len(rows)] == g], columns[group[len(rows) :] == g]) for g in range(count)]

    def signs(self, X: Array) -> Array:
        """Return the sign (k, blocks) of the determinant of the loop equations of each block at X (k, nq)."""
        if not self._blocks:
            return np.zeros((len(X), 0))
        A = self._loops(X, np.arange(len(X)))[1]
        return np.column_stack([np.linalg.slogdet(A[:, rows][:, :, columns])[0] for rows, columns in self._blocks])

    # -- paths ----------------------------------------------------------------------------------------

    def between(self, X0: Array, X1: Array, part: Array) -> Array:
        """Return configurations (k, nq) at the fractions `part` (k,) from X0 to X1 (k, nq); loops are nearly closed."""
        end = X1.copy()
        for place in self._tree.quaternions:
            four = slice(place, place + 4)
            end[(X0[:, four] * X1[:, four]).sum(axis=1) < 0, four] *= -1.0
        return self._tree.unit((1 - part)[:, None] * X0 + part[:, None] * end)

    def along(self, path: Callable[..., Array], x: Array, s: Array, check: Callable[[], None]) -> Array | None:
        """Return configurations (k, nq) of a path at stations s (k,), starting from the configuration x (nq,) at s[0].

        Return None if the loops open, or if the assembly mode changes (a determinant changes its sign, or a coordinate
        changes by more than `_JUMP` between two stations). `check` is called between the steps.
        """
        for ahead in (_COARSE, len(s) - 1)[: 1 + (len(s) - 1 > _COARSE)]:
            if (X := self._along(path(s), x, ahead, check)) is not None:
                return X
        return None

    def _along(self, q: Array, x: Array, ahead: int, check: Callable[[], None]) -> Array | None:
        """Return the result of `along` for q (k, n) at the stations; about `ahead` stations are solved one by one."""
        X = np.tile(x, (len(q), 1))
        done = np.unique(np.linspace(0, len(q) - 1, min(ahead, len(q) - 1) + 1).astype(int))
        for i, j in pairwise(done.tolist()):
            check()
            guess = self._tree.step(X[[i]], (self.rates(X[[i]]) @ (q[j] - q[i])))
            X[[j]], ok = self.near(guess, q[[j]])
            if not ok[0]:
                return None
        while len(done) < len(q):
            check()
            gap = np.diff(done) > 1
            left, right = done[:-1][gap], done[1:][gap]
            middle = (left + right) // 2
            guess = self.between(X[left], X[right], (middle - left) / (right - left))
            X[middle], ok = self.near(guess, q[middle])
            if not ok.all():
                return None
            done = np.sort(np.concatenate([done, middle]))
        same = self.signs(X) == self.signs(x[None])
        return X if same.all() and (self.change(X[:-1], X[1:]) <= _JUMP).all() else None

    def each(self, a: Array, b: Array, stations: int) -> tuple[Array, np.ndarray]:
        """Return configurations (m, stations, nq) of straight paths from a to b (m, n), and (m,) bool: whether closed.

        This is a fast test for searches: the loops are closed approximately, and the assembly modes at both ends are
        those of the nearest known states.
        """
        m, part = len(a), np.linspace(0.0, 1.0, stations)
        X, closed = self.states(np.concatenate([a, b]), thorough=False)
        ok = closed[:m] & closed[m:]
        first, last = (np.repeat(x[ok], stations, axis=0) for x in (X[:m], X[m:]))
        parts = np.tile(part, int(ok.sum()))
        q = np.repeat(a[ok], stations, axis=0) + parts[:, None] * np.repeat((b - a)[ok], stations, axis=0)
        found, closed = self.near(self.between(first, last, parts), q, _ENOUGH)
        jumps = self.change(found[:-1], found[1:]) > _JUMP
        jumps[stations - 1 :: stations] = False  # not on a path: from the end of one path to the start of the next
        good = closed.reshape(-1, stations).all(axis=1)
        good &= ~np.append(jumps, False).reshape(-1, stations).any(axis=1)
        out = np.zeros((m, stations, X.shape[1]))
        out[ok] = found.reshape(-1, stations, X.shape[1])
        ok[ok] = good
        return out, ok


def _keys(q: Array) -> list[bytes]:
    """Return a key for each row of joint values q (k, n); rows that differ by rounding only have equal keys."""
    return [row.tobytes() for row in np.rint(q / ROUNDING).astype(np.int64)]
