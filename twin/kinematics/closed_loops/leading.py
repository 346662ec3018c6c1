"""Taking a mechanism by the hand: a point of any body, or its active joints, led along a line; the loops follow.

The way of the hand is walked in steps of one length, whatever its speed; what is left of a step is walked anew each
time, and nothing starts from there. Each step goes on in the assembly where the last one ended, slides along limits,
and is halved where the loops do not close. Two kinds of singularity end an assembly:
the loops no longer hold their joints (type II), or the joints no longer hold the tool (type I). Leading a point
stops before either; turning a joint passes through the second, as a drive would.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.core.spatial import Array
from twin.kinematics.closed_loops.equations import LENGTH_SCALE, STATES, STEPS
from twin.kinematics.closed_loops.sight import Look, Sight
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.mechanism import Mechanism

_STEP = 1e-3
"""Length in m of the way of the hand that is walked at once."""

_LAG = 0.05
"""The same as part of the way that the point lags behind, if that is longer."""

_STRIDE = 4e-3
"""Longest motion (m; rad times `LENGTH_SCALE`) of the active joints at once; of the others ten times as much."""

_THERE, _PASSED = 1e-10, 1e-7
"""Distance in m at which a point is where it should be, and where it passes on the way."""

_GAIN, _LAST_GAIN = 1e-3, 1e-5
"""Part of the remaining distance that a step must win for another one to be worth it, on the way and at its end.

A point that slides along limits, a distance d from the hand, wins x²/2d on the last x of its way: 45 µm before its
place a thousandth of a millimetre, at d = 1 mm.
"""

_DAMPINGS = (1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e2)
"""Relative to the gains: each is tried where a step with less leads no nearer."""

_WEAK = 0.05
"""Way of the point for the same way of the joints, below which it is not led: they would run for nothing."""

_HALVINGS = 7
"""How often a step is halved where the loops do not close, or another assembly begins."""

_TRIES, _LAST_TRIES = 4, 25
"""Steps for a goal on the way, and for the last one."""

_LEFT = 1e-3
"""Part of a determinant as drawn that must be left: beyond it another assembly begins."""

_NEAR = 1e-7
"""A limit (m; rad times `LENGTH_SCALE`) is reached within this."""


@dataclass(frozen=True)
class Bound:
    """What active joints may do: the sum of weights times q is at least `least`.

    Attributes:
        name: joint, pair of joints, or motor.
        kind: "lower", "upper", "gap", or "motor" for the actuator of a transmission.
        weights: (n,) of q.
        least: in m or rad.
    """

    name: str
    kind: str
    weights: Array
    least: float

    def slack(self, q: Array) -> float:
        """Return what is left at q (n,), in m or rad; negative beyond."""
        return float(self.weights @ q - self.least)


@dataclass(frozen=True, eq=False)
class Led:
    """Where leading ended.

    Attributes:
        q, u: active joints (n,) and unknowns.
        stops: bounds that are in the way.
        singular: what ends there, as "loop r13" or "tool": another assembly begins, or none; empty if nothing does.
        more: whether the time was up before the way was.
    """

    q: Array
    u: Array
    stops: tuple[Bound, ...] = ()
    singular: str = ""
    more: bool = False


def bounds_of(mechanism: Mechanism, gaps: Sequence[tuple[str, str, float]] = ()) -> tuple[Bound, ...]:
    """Return the hard limits of the active joints and of their motors, and `gaps`.

    Args:
        mechanism: owner of the limits.
        gaps: lower joint, upper joint, minimum distance in m.
    """
    order, eye, out = [j.name for j in mechanism.active], np.eye(len(mechanism.active)), []
    for i, joint in enumerate(mechanism.active):
        low, high = joint.limits or (-np.inf, np.inf)
        out += [Bound(joint.name, "lower", eye[i], low)] if np.isfinite(low) else []
        out += [Bound(joint.name, "upper", -eye[i], -high)] if np.isfinite(high) else []
    for name, row in zip(mechanism.motor_names, mechanism.motors(eye).T, strict=True):
        low, high = (mechanism.actuator(name).limits if name not in order else None) or (-np.inf, np.inf)
        out += [Bound(name, "motor", w, b) for w, b in ((row, low), (-row, -high)) if np.isfinite(b)]
    for lower, upper, least in gaps:
        out.append(Bound(f"{lower} {upper}", "gap", eye[order.index(upper)] - eye[order.index(lower)], least))
    return tuple(out)


class Leader:
    """Leads one mechanism; see `take` and `joints`.

    Attributes:
        solver: closes its loops.
        bounds: that are kept.
    """

    def __init__(self, mechanism: Mechanism, bounds: Sequence[Bound] = ()) -> None:
        """Compile the loops (`AssemblyError`: they do not close as drawn)."""
        self.solver, self.bounds = LoopSolver(mechanism), tuple(bounds)
        angle = np.array([j.is_angle for j in mechanism.active], bool)
        self._scale = np.where(angle, 1 / LENGTH_SCALE, 1.0)  # of a step in m
        self._G = np.array([b.weights * self._scale for b in self.bounds]).reshape(-1, len(angle))
        size = np.abs(self._G).max(axis=1, initial=0.0, keepdims=True)
        self._G = self._G / np.where(size > 0, size, 1.0)
        self._size = size[:, 0]
        passive = self.solver.equations.passive
        turning = {"revolute": [True], "prismatic": [False], "cylindrical": [False, True], "spherical": [True] * 3}
        turning["free"] = [False] * 3 + [True] * 3
        self._turns = np.array([t for p in passive for t in turning[p.joint.type]], bool)
        self._kinds = [p.joint.type for p in passive]
        self.look = Sight(self.solver)
        names = self.solver.equations.row_names
        self.solver.close(self.solver.q, np.concatenate([*self.solver.home, []]))
        self._loops = [" ".join(dict.fromkeys(names[r] for r in b.rows)) for b in self.solver.blocks]

    # -- by a point -----------------------------------------------------------------------------------

    def take(self, q: Array, u: Array, body: str, p_body: Array) -> Grip:
        """Take a point of a body into the hand, and lead it along straight lines by the smallest motion of the joints.

        Args:
            q: active joints (n,).
            u: unknowns, loops closed.
            body: name.
            p_body: the point (3,) on it, in m.
        """
        p_body = np.asarray(p_body, float)
        return Grip(self, self.look(q, u, body, p_body), (body, p_body))

    # -- by the joints --------------------------------------------------------------------------------

    def joints(self, q: Array, u: Array, target: Array, seconds: float = np.inf) -> Led:
        """Turn the active joints from q (n,) towards a target (n,), all by the same part of their way."""
        q, held = np.asarray(q, float), (self.solver.mechanism.base, np.zeros(3))
        way = np.asarray(target, float) - q
        stops = [b for b in self.bounds if b.weights @ way < 0 and b.slack(q) + b.weights @ way < -1e-12]
        part = min((max(0.0, b.slack(q)) / -(b.weights @ way) for b in stops), default=1.0)
        stops = [b for b in stops if max(0.0, b.slack(q)) / -(b.weights @ way) <= part + 1e-9]
        now, s, stride = self.look(q, u, *held), 0.0, _STRIDE / max(np.abs(way / self._scale).max(initial=0.0), 1e-12)
        step, until = stride, time.thread_time() + seconds
        while s < part:
            if time.thread_time() > until:
                return Led(now.q, now.u, more=True)
            ahead = min(s + step, part)
            goal = np.asarray(target, float) if ahead == 1 else q + ahead * way
            further, why = self._moved(now, goal - now.q, held, tool=False)
            if further is not None:
                now, s, step = further, ahead, min(stride, 2 * step)
                continue
            step /= 2
            if step < stride / 2**14:
                return Led(now.q, now.u, singular=why or self.nearest(now))
        return Led(now.q, now.u, tuple(stops))

    # -- one step -------------------------------------------------------------------------------------

    def _moved(self, look: Look, dq: Array, held: tuple[str, Array], tool: bool = True) -> tuple[Look | None, str]:
        """Return the next look after a step dq (n,) in the same assembly; or None, and what becomes singular."""
        du = look.answers @ dq
        if np.abs(np.where(self._turns, LENGTH_SCALE, 1.0) * du).max(initial=0.0) > 10 * _STRIDE:
            return None, ""
        q = look.q + dq
        guess = self._stepped(look.u, du)
        u = self.solver.close(q, guess)
        if u is None or np.abs(u - guess).max(initial=0.0) > 0.1:
            return None, ""
        new = self.look(q, u, *held)
        left, drawn = self.determinants(look, new, tool), self._as_drawn
        for name, value in left.items():
            size = abs(value[1])
            if value[0] * value[1] <= 0 or (size < abs(value[0]) and size < _LEFT * drawn[name]):
                return None, name
        return new, ""

    def determinants(self, before: Look, look: Look, tool: bool) -> dict[str, tuple[float, float]]:
        """Return by what may become singular a determinant before and now: no sign changes within an assembly.

        Matrices that are not square are seen in the directions that they had before.
        """
        out = {}
        for name, A, B in zip(self._loops, before.loops, look.loops, strict=True):
            out[f"loop {name}"] = _determinants(A, B)
        n = len(look.q)
        if tool and n <= 6:  # with more, the arm may pass from one posture to another while the tool stands
            out["tool"] = _determinants(
                before.tool * self._scale * LENGTH_SCALE, look.tool * self._scale * LENGTH_SCALE
            )
        return out

    def nearest(self, look: Look) -> str:
        """Return the loop with least left of its determinant: where the loops close no more, it is why."""
        left = {n: abs(v[0]) / max(self._as_drawn[n], 1e-300) for n, v in self.determinants(look, look, False).items()}
        return min(left, key=left.__getitem__, default="")

    @cached_property
    def _as_drawn(self) -> dict[str, float]:
        u = np.concatenate([*self.solver.home, []])
        look = self.look(self.solver.q, u, self.solver.mechanism.base, np.zeros(3))
        return {n: abs(v[0]) for n, v in self.determinants(look, look, True).items()}

    def _stepped(self, u: Array, du: Array) -> Array:
        """Return the unknowns after steps: quaternions are turned in their own frame."""
        out, i, j = u.copy(), 0, 0
        for kind in self._kinds:
            lengths = STATES[kind] - 4 if kind in ("spherical", "free") else STATES[kind]
            out[i : i + lengths] += du[j : j + lengths]
            if kind in ("spherical", "free"):
                w, v = u[i + lengths], u[i + lengths + 1 : i + STATES[kind]]
                turn = du[j + lengths : j + STEPS[kind]] / 2
                (a, b, c), (x, y, z) = v, turn
                cross = np.array([b * z - c * y, c * x - a * z, a * y - b * x])
                quat = np.array([w - v @ turn, *(v + w * turn + cross)])
                out[i + lengths : i + STATES[kind]] = quat / np.linalg.norm(quat)
            i, j = i + STATES[kind], j + STEPS[kind]
        return out


class Grip:
    """A point in the hand. Where it ends depends on the line that the hand went, not on the positions seen of it."""

    def __init__(self, leader: Leader, look: Look, held: tuple[str, Array]) -> None:
        self._walk, self._hand = _Walk(leader, look, held), look.p
        self._target, self._end = look.p, self._walk

    def to(self, target: Array, seconds: float = np.inf) -> Led:
        """Follow the hand to a target (3,) in base, in m.

        Args:
            target: where the hand is.
            seconds: processor time after which it stops; the same target again goes on.
        """
        until, walk = time.thread_time() + seconds, self._walk
        if not np.array_equal(target, self._target):
            self._target, self._end = np.array(target, float), walk
        while self._end is walk:
            if not walk.goes_on(until):
                return walk.led(more=True)
            way = self._target - self._hand
            # A point that lags behind is pulled the same way by a hand that goes a little further.
            step = max(_STEP, _LAG * float(np.linalg.norm(self._hand - walk.look.p)))
            if np.linalg.norm(way) <= step:
                self._end = copy(walk)
                self._end.begin(self._target, last=True)
            else:
                self._hand = self._hand + way * (step / np.linalg.norm(way))
                walk.begin(self._hand)
        return self._end.led(more=not self._end.goes_on(until))


class _Walk:
    """Steps of a point towards one goal after the other; `look` is where it is. A copy walks on its own."""

    def __init__(self, leader: Leader, look: Look, held: tuple[str, Array]) -> None:
        self.leader, self.look, self.held = leader, look, held
        self.singular, self.open = "", False
        self._pull, self._slack = np.zeros(len(look.q)), np.zeros(len(leader.bounds))
        self._part, self._within, self._gain, self._tries = 1.0, _THERE, _GAIN, 0

    def begin(self, goal: Array, last: bool = False) -> None:
        """Take a goal (3,), to which the point comes as near as it can if it is the last one."""
        self._goal, self._first, self._total = goal, self.look, np.zeros(len(self.look.q))
        self._within, self._gain, self._tries = (_THERE, _LAST_GAIN, _LAST_TRIES) if last else (_PASSED, _GAIN, _TRIES)

    def goes_on(self, until: float) -> bool:
        """Bring the point as near to the goal as it comes; return False if the time is up before."""
        while self._tries:
            way = float(np.linalg.norm(self._goal - self.look.p))
            if way < self._within:
                break
            if time.thread_time() > until:
                return False
            self._tries -= 1
            y = self._step(self._first, self._total, self._goal)
            if y is None:
                break
            self._total = self._total + y
            if way - np.linalg.norm(self._goal - self.look.p) < self._gain * min(way, _STEP):
                break
        self._tries = 0
        return True

    def led(self, more: bool) -> Led:
        """Return where it is and what is in its way."""
        singular = self.leader.nearest(self.look) if self.open else self.singular
        return Led(self.look.q, self.look.u, self.stops(), singular, more)

    def _step(self, first: Look, total: Array, goal: Array) -> Array | None:
        """Go on by one step that brings the point nearer, and return it (n,) in m; None if there is none."""
        leader, now = self.leader, self.look
        scale, miss = leader._scale, goal - now.p
        # The smallest motion of the whole way from `first`, by the mean of both ends: second order in its length.
        J, here, G = 0.5 * (first.J + now.J) * scale, now.J * scale, leader._G
        self.singular, self.open, self._pull = "", False, -here.T @ miss
        self._slack = np.maximum(0.0, np.array([b.slack(now.q) for b in leader.bounds])) / leader._size
        size, near = float(np.sum(J * J)), self._slack < _NEAR
        if size < _WEAK**2:  # nothing moves this point, or as good as nothing
            return None
        in_the_way, y = near & (G @ self._pull > 0), np.zeros(len(total))
        for _ in range(len(G) + 1):
            P = np.eye(len(total)) - np.linalg.pinv(G[in_the_way]) @ G[in_the_way]
            U, gains, _ = np.linalg.svd(here @ P)
            strong = U[:, : int(np.sum(gains > _WEAK))]
            if strong.shape[1] < 3:  # all ways, if they lead to where all are easy; else those that are easy
                y = np.asarray(P @ _least_motion(J @ P, miss, total, _DAMPINGS[0] * size), float)
                if not _against(near & ~in_the_way, G, y).any() and self._taken(y, goal, easy=True):
                    return y * self._part
            y = np.asarray(P @ _least_motion(strong.T @ J @ P, strong.T @ miss, total, _DAMPINGS[0] * size), float)
            more = _against(near & ~in_the_way, G, y)
            if not more.any():
                break
            in_the_way |= more
        if np.linalg.norm(strong.T @ miss) < self._within:
            return None
        for damping in _DAMPINGS[1:]:
            for _ in range(_HALVINGS):
                if self._taken(y, goal):
                    return y * self._part
                if not (self.open or self.singular):
                    break  # no nearer: another way is wanted, not a shorter one
                y = y * self._part / 2
            if self.open or self.singular:
                return None
            y = P @ _least_motion(strong.T @ here @ P, strong.T @ miss, 0 * total, damping * size)
        return None

    def _taken(self, y: Array, goal: Array, easy: bool = False) -> bool:
        """Take a step (n,) in m, or as much of it as is short and within limits, if it leads nearer.

        `easy`: and to where the point can be led in all directions.
        """
        leader, now = self.leader, self.look
        used = -(leader._G @ y)
        part = min(1.0, _STRIDE / max(np.abs(y).max(initial=0.0), 1e-15))
        self._part = float(np.min(self._slack[used > 0] / used[used > 0], initial=part))
        reached, why = leader._moved(now, leader._scale * (self._part * y), self.held)
        if reached is None:
            self.singular, self.open = why, not why
            return False
        self.singular, self.open = "", False
        if np.linalg.norm(goal - reached.p) >= np.linalg.norm(goal - now.p):
            return False
        if easy and np.linalg.svd(reached.J * leader._scale, compute_uv=False)[-1] <= _WEAK:
            return False
        self.look = reached
        return True

    def stops(self) -> tuple[Bound, ...]:
        """Return the bounds that the point is pulled against."""
        leader, out = self.leader, []
        for b, g, size in zip(leader.bounds, leader._G, leader._size, strict=True):
            if b.slack(self.look.q) / size < _NEAR and g @ self._pull > 1e-6 * np.linalg.norm(self._pull):
                out.append(b)
        return tuple(out)


def _against(bounds: np.ndarray, G: Array, y: Array) -> np.ndarray:
    """Return which of the bounds (b,) bool, with gradients G (b, n), a step y (n,) runs into."""
    return bounds & (G @ y < -1e-9 * np.abs(y).max(initial=0.0))


def _least_motion(J: Array, miss: Array, total: Array, damping: float) -> Array:
    """Return y (n,) that minimises |J y - miss|² + damping |total + y|²."""
    H = J.T @ J + damping * np.eye(J.shape[1])
    return np.asarray(np.linalg.solve(H, J.T @ miss - damping * total), float)


def _determinants(A: Array, B: Array) -> tuple[float, float]:
    if A.shape[0] == A.shape[1]:
        return float(np.linalg.det(A)), float(np.linalg.det(B))
    U, values, Vt = np.linalg.svd(A, full_matrices=False)
    r = int(np.sum(values > 1e-9 * values.max(initial=0.0)))
    return float(np.prod(values[:r])), float(np.linalg.det(U[:, :r].T @ B @ Vt[:r].T))
