"""Interactive motion of a mechanism: move a point of a body, or the active joints, along a straight line.

The line to the target is followed in steps of fixed length, independent of speed. If the last step of a call is
shorter, the next call computes this step again, so that the result does not depend on the number of calls. Each step
stays in the assembly of the previous step and slides along limits; a step is halved if the loops do not close after it.
An assembly ends at two kinds of singularity: the loops no longer determine their passive joints (type II), or the
active joints no longer determine the tool (type I). A dragged point stops before both kinds. The motion of an active
joint (`Dragger.joints`) passes through type I singularities, like the motion of a real drive.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.kinematics.closed_loops.equations import LENGTH_SCALE, STATES, STEPS
from twin.kinematics.closed_loops.passive_limits import PassiveLimit
from twin.kinematics.closed_loops.sight import Look, Sight
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.mechanism import Mechanism

_STEP = 1e-3
"""Step length in m along the line to the target."""

_LAG = 0.05
"""Step length as a fraction of the distance from the point to its intermediate goal; the minimum is `_STEP`."""

_STRIDE = 4e-3
"""Maximum motion (m; rad times `LENGTH_SCALE`) of the active joints in a step; ten times as much for passive joints."""

_THERE, _PASSED = 1e-10, 1e-7
"""Distances in m below which the target (`_THERE`) or an intermediate goal (`_PASSED`) counts as reached."""

_GAIN, _LAST_GAIN = 1e-3, 1e-5
"""Minimum relative decrease of the distance to an intermediate goal, and to the target, in one step.

A motion ends after a step with a smaller decrease. A point that slides along limits at distance d from the target
approaches the target slowly: the last length x of its path reduces the distance by only x²/2d, which is 1 µm over the
last 45 µm at d = 1 mm.
"""

_DAMPINGS = (1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e2)
"""Damping values relative to the squared norm of the Jacobian; a step uses the first value with which it succeeds."""

_WEAK = 0.05
"""Minimum singular value (motion of the point per motion of the joints); the point is not moved in directions with a
smaller value."""

_HALVINGS = 7
"""Maximum number of halvings of a step, if the loops do not close or the step reaches another assembly."""

_TRIES, _LAST_TRIES = 4, 25
"""Maximum number of steps to an intermediate goal, and to the target."""

_LEFT = 1e-3
"""Minimum determinant relative to its value in the rest poses; a smaller determinant counts as another assembly."""

_BACK = 4
"""Maximum number of steps back to the limits of passive joints, after a step along them."""

_ALIKE = 1e-6
"""Difference of two gradients, whose largest entry is 1, below which only the first of two stops is named."""

_STILL = 1e-9
"""Change of the slack of a passive joint per m of the active joints, below which they do not move this joint."""

_NEAR = 1e-7
"""Distance (m; rad times `LENGTH_SCALE`) from a limit at which the limit counts as reached."""


@dataclass(frozen=True)
class Bound:
    """A limit of active joints: weights @ q must be at least `least`.

    Attributes:
        name: name of the joint, of the pair of joints, or of the motor.
        kind: "lower" or "upper" (limit of a joint), "gap" (between two joints on a rail), or "motor" (limit of the
            actuator of a transmission).
        weights: (n,) coefficients of q.
        least: the bound, in m or rad.
    """

    name: str
    kind: str
    weights: Array
    least: float

    def slack(self, q: Array) -> float:
        """Return the distance of q (n,) from the bound, in m or rad; negative if q violates the bound."""
        return float(self.weights @ q - self.least)


Stop = Bound | PassiveLimit
"""What blocks a motion."""


@dataclass(frozen=True, eq=False)
class Dragged:
    """Result of a motion.

    Attributes:
        q, u: active joints (n,) and loop unknowns (m,) after the motion; see `Closed.states`.
        stops: bounds of active joints and limits of passive joints that block the motion.
        singular: the matrix that becomes singular: that of a loop (such as "loop r13") or of the "tool"; "" if the
            motion meets no singularity.
        more: whether the motion stopped only because its processor time was used up.
    """

    q: Array
    u: Array
    stops: tuple[Stop, ...] = ()
    singular: str = ""
    more: bool = False


def bounds_of(mechanism: Mechanism, gaps: Sequence[tuple[str, str, float]] = ()) -> tuple[Bound, ...]:
    """Return the bounds: hard limits of active joints and their motors, and minimum distances on a rail.

    `gaps` are (lower joint, upper joint, minimum distance in m) for pairs of joints on one rail.
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


class Dragger:
    """Motion of one mechanism by a grabbed point (`take`) or by the active joints (`joints`).

    Attributes:
        solver: loop solver of the mechanism.
        bounds: limits that the motion respects.
    """

    def __init__(self, mechanism: Mechanism, bounds: Sequence[Bound] = ()) -> None:
        """Compile the loops; raise `AssemblyError` if the loops do not close in the rest poses."""
        self.solver, self.bounds = LoopSolver(mechanism), tuple(bounds)
        angle = np.array([j.is_angle for j in mechanism.active], bool)
        self._scale = np.where(angle, 1 / LENGTH_SCALE, 1.0)  # joint units per m of a step
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
        """Return a grip on a point of a body; the grip moves the point along straight lines by minimum joint motion.

        u (m,) contains the loop unknowns that close the loops at q (n,). `p_body` (3,) is the point in the body frame,
        in m.
        """
        p_body = np.asarray(p_body, float)
        return Grip(self, self.look(q, u, body, p_body), (body, p_body))

    # -- by the joints --------------------------------------------------------------------------------

    def joints(self, q: Array, u: Array, target: Array, seconds: float = np.inf) -> Dragged:
        """Move the active joints from q (n,) towards a target (n,); all joints arrive at the same time.

        Return the state reached, with the reason if a limit or a loop stops the motion before the target.
        """
        q, held = np.asarray(q, float), (self.solver.mechanism.base, np.zeros(3))
        way = np.asarray(target, float) - q
        stops = [b for b in self.bounds if b.weights @ way < 0 and b.slack(q) + b.weights @ way < -1e-12]
        part = min((max(0.0, b.slack(q)) / -(b.weights @ way) for b in stops), default=1.0)
        stops = [b for b in stops if max(0.0, b.slack(q)) / -(b.weights @ way) <= part + 1e-9]
        now, s, stride = self.look(q, u, *held), 0.0, _STRIDE / max(np.abs(way / self._scale).max(initial=0.0), 1e-12)
        step, until = stride, time.thread_time() + seconds
        while s < part:
            if time.thread_time() > until:
                return Dragged(now.q, now.u, more=True)
            ahead = min(s + step, part)
            goal = np.asarray(target, float) if ahead == 1 else q + ahead * way
            further, why = self._moved(now, goal - now.q, held, tool=False)
            passed = () if further is None else self.passed(now, further)
            if further is not None and not passed:
                now, s, step = further, ahead, min(stride, 2 * step)
                continue
            step /= 2
            if step < stride / 2**14:
                return Dragged(now.q, now.u, passed, "" if passed else why or self.nearest(now))
        return Dragged(now.q, now.u, tuple(stops))

    # -- limits ---------------------------------------------------------------------------------------

    def held(self, look: Look) -> tuple[Array, Array]:
        """Return (G (b, n), slack (b,)) in a state: for each stop, the gradient of its distance, and its distance.

        The largest entry of a gradient is 1. Distances are in m (rad times `LENGTH_SCALE`), at least 0.
        """
        slopes = look.slopes * self._scale
        size = np.abs(slopes).max(axis=1, initial=0.0)
        moving = size > _STILL
        slopes = np.where(moving[:, None], slopes / np.where(moving, size, 1.0)[:, None], 0.0)
        left = np.where(moving, np.maximum(0.0, look.slacks) / np.where(moving, size, 1.0), np.inf)
        slack = np.maximum(0.0, np.array([b.slack(look.q) for b in self.bounds])) / self._size
        return np.vstack([self._G, slopes]), np.concatenate([slack, left])

    def passed(self, before: Look, look: Look) -> tuple[PassiveLimit, ...]:
        """Return the limits of passive joints that a step passes; beyond a limit, a joint may only move back."""
        beyond = look.slacks < _floor(before)
        return tuple(limit for limit, out in zip(self.look.limits, beyond, strict=True) if out)

    def brought_back(self, before: Look, look: Look, held: tuple[str, Array]) -> Look | None:
        """Return the state after a step, moved back to the limits of passive joints that the step passes; else None.

        Steps follow the tangent of such a limit, and leave it by an amount of second order.
        """
        for _ in range(_BACK):
            out = look.slacks < _floor(before)
            if not out.any():
                return look
            slopes = look.slopes[out] * self._scale
            missing = np.maximum(0.0, _floor(before) + ROUNDING - look.slacks)[out]
            slack = np.array([b.slack(look.q) for b in self.bounds])
            at = slack / self._size < _NEAR  # the way back must not pass these limits
            ways = np.vstack([slopes, self._G[at]])
            wanted = np.append(missing, np.zeros(int(at.sum())))
            dq = self._scale * np.asarray(np.linalg.pinv(ways) @ wanted, float)
            after = np.array([b.slack(look.q + dq) for b in self.bounds])
            if (after < np.minimum(0.0, slack) - 1e-12).any():
                return None
            further, _ = self._moved(look, dq, held)
            if further is None:
                return None
            look = further
        return None

    # -- one step -------------------------------------------------------------------------------------

    def _moved(self, look: Look, dq: Array, held: tuple[str, Array], tool: bool = True) -> tuple[Look | None, str]:
        """Return (state after the step dq (n,), ""), or (None, cause) if the step is rejected.

        The cause is "loop NAME" or "tool" if this matrix becomes singular; "" if the step is too long or the loops do
        not close.
        """
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
        """Return the determinants {name: (before, now)} of loops and tool; their signs change only at singularities.

        Matrices that are not square are first projected onto the singular vectors of the matrix in state `before`.
        """
        out = {}
        for name, A, B in zip(self._loops, before.loops, look.loops, strict=True):
            out[f"loop {name}"] = _determinants(A, B)
        n = len(look.q)
        if tool and n <= 6:  # a redundant arm can move while its tool is at rest
            out["tool"] = _determinants(
                before.tool * self._scale * LENGTH_SCALE, look.tool * self._scale * LENGTH_SCALE
            )
        return out

    def nearest(self, look: Look) -> str:
        """Return the name of the loop nearest to a singularity, which is probably the loop that no longer closes."""
        left = {n: abs(v[0]) / max(self._as_drawn[n], 1e-300) for n, v in self.determinants(look, look, False).items()}
        return min(left, key=left.__getitem__, default="")

    @cached_property
    def _as_drawn(self) -> dict[str, float]:
        u = np.concatenate([*self.solver.home, []])
        look = self.look(self.solver.q, u, self.solver.mechanism.base, np.zeros(3))
        return {n: abs(v[0]) for n, v in self.determinants(look, look, True).items()}

    def _stepped(self, u: Array, du: Array) -> Array:
        """Return the unknowns after a step du; quaternions are rotated in their own frame."""
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
    """A grabbed point. Its final position does not depend on intermediate targets on the line to the last target."""

    def __init__(self, dragger: Dragger, look: Look, held: tuple[str, Array]) -> None:
        self._walk, self._hand = _Walk(dragger, look, held), look.p
        self._target, self._end = look.p, self._walk

    def to(self, target: Array, seconds: float = np.inf) -> Dragged:
        """Move the point towards a target.

        `target` (3,) is in base, in m. After `seconds` of processor time the motion stops; call again with the same
        target to continue.
        """
        until, walk = time.thread_time() + seconds, self._walk
        if not np.array_equal(target, self._target):
            self._target, self._end = np.array(target, float), walk
        while self._end is walk:
            if not walk.goes_on(until):
                return walk.result(more=True)
            way = self._target - self._hand
            # If the point lags far behind the goal, a longer step of the goal hardly changes the direction to it.
            step = max(_STEP, _LAG * float(np.linalg.norm(self._hand - walk.look.p)))
            if np.linalg.norm(way) <= step:
                self._end = copy(walk)
                self._end.begin(self._target, last=True)
            else:
                self._hand = self._hand + way * (step / np.linalg.norm(way))
                walk.begin(self._hand)
        return self._end.result(more=not self._end.goes_on(until))


class _Walk:
    """Steps of a point towards a sequence of goals; `look` is the current state. A copy can continue independently."""

    def __init__(self, dragger: Dragger, look: Look, held: tuple[str, Array]) -> None:
        self.dragger, self.look, self.held = dragger, look, held
        self.singular, self.open, self._passed = "", False, False
        self._pull = np.zeros(len(look.q))
        self._G, self._slack = dragger.held(look)
        self._part, self._within, self._gain, self._tries = 1.0, _THERE, _GAIN, 0

    def begin(self, goal: Array, last: bool = False) -> None:
        """Start moving to a goal (3,); with `last`, the point approaches the goal as closely as possible."""
        self._goal, self._first, self._total = goal, self.look, np.zeros(len(self.look.q))
        self._within, self._gain, self._tries = (_THERE, _LAST_GAIN, _LAST_TRIES) if last else (_PASSED, _GAIN, _TRIES)

    def goes_on(self, until: float) -> bool:
        """Move the point as near to the goal as possible; return False if processor time exceeds `until`."""
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

    def result(self, more: bool) -> Dragged:
        """Return the state and the bounds that block the point."""
        singular = self.dragger.nearest(self.look) if self.open else self.singular
        return Dragged(self.look.q, self.look.u, self.stops(), singular, more)

    def _step(self, first: Look, total: Array, goal: Array) -> Array | None:
        """Move one step nearer to the goal; return the joint motion (n,), scaled to m; None if no step is found."""
        dragger, now = self.dragger, self.look
        scale, miss = dragger._scale, goal - now.p
        # The total joint motion from `first` is minimised. With the mean Jacobian of both ends, the error of this
        # minimum is of second order.
        J, here = 0.5 * (first.J + now.J) * scale, now.J * scale
        G, self._slack = dragger.held(now)
        self._G = G
        self.singular, self.open, self._passed, self._pull = "", False, False, -here.T @ miss
        size, near = float(np.sum(J * J)), self._slack < _NEAR
        if size < _WEAK**2:  # no joint moves this point noticeably
            return None
        in_the_way, y = near & (G @ self._pull > 0), np.zeros(len(total))
        for _ in range(len(G) + 1):
            P = np.eye(len(total)) - np.linalg.pinv(G[in_the_way]) @ G[in_the_way]
            U, gains, _ = np.linalg.svd(here @ P)
            strong = U[:, : int(np.sum(gains > _WEAK))]
            if strong.shape[1] < 3:  # try all directions first; accept only if all are strong afterwards
                y = np.asarray(P @ _least_motion(J @ P, miss, total, _DAMPINGS[0] * size), float)
                if not (near & ~in_the_way & _towards(G, y)).any() and self._taken(y, goal, easy=True):
                    return y * self._part
            y = np.asarray(P @ _least_motion(strong.T @ J @ P, strong.T @ miss, total, _DAMPINGS[0] * size), float)
            more = near & ~in_the_way & _towards(G, y)
            if not more.any():
                break
            in_the_way |= more
        if np.linalg.norm(strong.T @ miss) < self._within:
            return None
        for damping in _DAMPINGS[1:]:
            for _ in range(_HALVINGS):
                if self._taken(y, goal):
                    return y * self._part
                if not (self.open or self.singular or self._passed):
                    break  # the step makes no progress: change its direction, not its length
                y = y * self._part / 2
            if self.open or self.singular or self._passed:
                return None
            y = P @ _least_motion(strong.T @ here @ P, strong.T @ miss, 0 * total, damping * size)
        return None

    def _taken(self, y: Array, goal: Array, easy: bool = False) -> bool:
        """Shorten the step y (n,) in m to the limits, and do the step if the distance to the goal then decreases.

        Return whether the step was done. With `easy`, only states in which the point can move in all directions are
        accepted.
        """
        dragger, now = self.dragger, self.look
        used = -(self._G @ y)
        part = min(1.0, _STRIDE / max(np.abs(y).max(initial=0.0), 1e-15))
        towards = _towards(self._G, y)
        self._part = float(np.min(self._slack[towards] / used[towards], initial=part))
        reached, why = dragger._moved(now, dragger._scale * (self._part * y), self.held)
        if reached is None:
            self.singular, self.open, self._passed = why, not why, False
            return False
        self.singular, self.open = "", False
        reached = dragger.brought_back(now, reached, self.held)
        self._passed = reached is None
        if reached is None:
            return False
        if np.linalg.norm(goal - reached.p) >= np.linalg.norm(goal - now.p):
            return False
        if easy and np.linalg.svd(reached.J * dragger._scale, compute_uv=False)[-1] <= _WEAK:
            return False
        self.look = reached
        return True

    def stops(self) -> tuple[Stop, ...]:
        """Return the bounds and limits that block the point."""
        dragger = self.dragger
        out: list[Stop] = []
        known: list[Array] = []
        G, slack = dragger.held(self.look)
        for stop, g, left in zip((*dragger.bounds, *dragger.look.limits), G, slack, strict=True):
            blocks = left < _NEAR and g @ self._pull > 1e-6 * np.linalg.norm(self._pull)
            # Pins of a parallelogram reach their limits together with the joint that moves them: name that joint only.
            if blocks and not any(np.abs(g - other).max() < _ALIKE for other in known):
                out.append(stop)
                known.append(g)
        return tuple(out)


def _floor(look: Look) -> Array:
    """Return the smallest slacks (c,) of passive joints that a step from this state may reach."""
    return np.where(look.slacks < -ROUNDING, look.slacks, -ROUNDING)


def _towards(G: Array, y: Array) -> np.ndarray:
    """Return (b,) bool: whether the step y (n,) moves towards a bound, by more than a rounding error of the step.

    G (b, n) contains the gradients of the distances from the bounds.
    """
    return G @ y < -1e-9 * np.abs(y).max(initial=0.0)


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
