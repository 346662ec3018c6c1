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
from twin.kinematics.closed_loops.linearizer import LinearizedState, Linearizer
from twin.kinematics.closed_loops.passive_limits import PassiveLimit
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.mechanism import Mechanism

_STEP = 1e-3
"""Step length in m along the line to the target."""

_LAG = 0.05
"""Step length as a fraction of the distance from the point to its intermediate goal; the minimum is `_STEP`."""

_STRIDE = 4e-3
"""Maximum motion (m; rad times `LENGTH_SCALE`) of the active joints in a step; ten times as much for passive joints."""

_THERE = 1e-10
"""Distance in m below which the target counts as reached."""

_PASSED = 1e-7
"""Distance in m below which an intermediate goal counts as reached."""

_GAIN = 1e-3
_LAST_GAIN = 1e-5
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

_TRIES = 4
_LAST_TRIES = 25
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

_UNLIMITED = (-np.inf, np.inf)

_TURNS = {
    "revolute": [True],
    "prismatic": [False],
    "cylindrical": [False, True],
    "spherical": [True] * 3,
    "free": [False] * 3 + [True] * 3,
}
"""Whether each number in a step of a passive joint is an angle, by type; see `STEPS`."""


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
        q, u: active joints (n,) and loop unknowns (m,) after the motion; see `ClosedStates.states`.
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
    eye = np.eye(len(mechanism.active))
    index = {joint.name: i for i, joint in enumerate(mechanism.active)}
    bounds: list[Bound] = []
    for joint in mechanism.active:
        axis = eye[index[joint.name]]
        low, high = joint.limits or _UNLIMITED
        if np.isfinite(low):
            bounds.append(Bound(joint.name, "lower", axis, low))
        if np.isfinite(high):
            bounds.append(Bound(joint.name, "upper", -axis, -high))

    # The motor of a directly driven joint has the joint's name; the limits of this joint are bounds already.
    for name, row in zip(mechanism.motor_names, mechanism.motors(eye).T, strict=True):
        if name in index:
            continue
        low, high = mechanism.actuator(name).limits or _UNLIMITED
        if np.isfinite(low):
            bounds.append(Bound(name, "motor", row, low))
        if np.isfinite(high):
            bounds.append(Bound(name, "motor", -row, -high))

    for lower, upper, least in gaps:
        weights = eye[index[upper]] - eye[index[lower]]
        bounds.append(Bound(f"{lower} {upper}", "gap", weights, least))
    return tuple(bounds)


class Dragger:
    """Motion of one mechanism by a grabbed point (`take`) or by the active joints (`joints`).

    Attributes:
        solver: loop solver of the mechanism.
        bounds: limits that the motion respects.
    """

    def __init__(self, mechanism: Mechanism, bounds: Sequence[Bound] = ()) -> None:
        """Compile the loops; raise `AssemblyError` if the loops do not close in the rest poses."""
        self.solver = LoopSolver(mechanism)
        self.bounds = tuple(bounds)
        self._scale = np.ones(len(mechanism.active))  # joint units per m of a step
        for i, joint in enumerate(mechanism.active):
            if joint.is_angle:
                self._scale[i] = 1 / LENGTH_SCALE

        # Each gradient is divided by its largest entry, so that slacks are distances of joints.
        gradients = np.zeros((len(self.bounds), len(self._scale)))
        for i, bound in enumerate(self.bounds):
            gradients[i] = bound.weights * self._scale
        size = np.abs(gradients).max(axis=1, initial=0.0, keepdims=True)
        self._G = gradients / np.where(size > 0, size, 1.0)
        self._size = size[:, 0]

        self._kinds: list[str] = []
        turns: list[bool] = []
        for passive in self.solver.equations.passive:
            kind = passive.joint.type
            self._kinds.append(kind)
            turns += _TURNS[kind]
        self._turns = np.array(turns, bool)

        self.look = Linearizer(self.solver)
        rest = np.concatenate([*self.solver.home, []])
        self.solver.close(self.solver.q, rest)  # compiles the kernel here and not in the first motion

        names = self.solver.equations.row_names
        self._loops: list[str] = []
        for block in self.solver.blocks:
            members: dict[str, None] = {}  # in their order, each once
            for row in block.rows:
                members[names[row]] = None
            self._loops.append(" ".join(members))

    # -- by a point -----------------------------------------------------------------------------------

    def take(self, q: Array, u: Array, body: str, p_body: Array) -> DragGrip:
        """Return a grip on a point of a body; the grip moves the point along straight lines by minimum joint motion.

        u (m,) contains the loop unknowns that close the loops at q (n,). `p_body` (3,) is the point in the body frame,
        in m.
        """
        p_body = np.asarray(p_body, float)
        look = self.look(q, u, body, p_body)
        return DragGrip(self, look, (body, p_body))

    # -- by the joints --------------------------------------------------------------------------------

    def joints(self, q: Array, u: Array, target: Array, seconds: float = np.inf) -> Dragged:
        """Move the active joints from q (n,) towards a target (n,); all joints arrive at the same time.

        Return the state reached, with the reason if a limit or a loop stops the motion before the target.
        """
        q = np.asarray(q, float)
        target = np.asarray(target, float)
        motion = target - q
        part, stops = self._first_stops(q, motion)

        held = (self.solver.mechanism.base, np.zeros(3))  # no point is dragged; any point serves
        now = self.look(q, u, *held)
        s = 0.0
        longest = np.abs(motion / self._scale).max(initial=0.0)
        stride = _STRIDE / max(longest, 1e-12)
        step = stride
        until = time.thread_time() + seconds
        while s < part:
            if time.thread_time() > until:
                return Dragged(now.q, now.u, more=True)
            ahead = min(s + step, part)
            # q + motion can differ from the target by a rounding error.
            goal = target
            if ahead < 1:
                goal = q + ahead * motion
            further, cause = self._moved(now, goal - now.q, held, tool=False)
            passed: tuple[PassiveLimit, ...] = ()
            if further is not None:
                passed = self.passed(now, further)
            if further is not None and not passed:
                now = further
                s = ahead
                step = min(stride, 2 * step)
                continue
            step /= 2
            if step < stride / 2**14:
                if passed:
                    return Dragged(now.q, now.u, passed)
                return Dragged(now.q, now.u, (), cause or self.nearest(now))
        return Dragged(now.q, now.u, tuple(stops))

    def _first_stops(self, q: Array, motion: Array) -> tuple[float, list[Bound]]:
        """Return (fraction of a motion (n,) from q (n,) up to the first bounds, these bounds); without any, (1, [])."""
        fractions: list[tuple[float, Bound]] = []
        for bound in self.bounds:
            change = float(bound.weights @ motion)
            slack = bound.slack(q)
            # An end within rounding of the bound does not violate the bound.
            if change < 0 and slack + change < -1e-12:
                fractions.append((max(0.0, slack) / -change, bound))
        part = 1.0
        for fraction, _ in fractions:
            part = min(part, fraction)
        # bounds that the motion meets together
        first = []
        for fraction, bound in fractions:
            if fraction <= part + 1e-9:
                first.append(bound)
        return part, first

    # -- limits ---------------------------------------------------------------------------------------

    def held(self, look: LinearizedState) -> tuple[Array, Array]:
        """Return (G (b, n), slack (b,)) in a state: for each stop, the gradient of its distance, and its distance.

        The largest entry of a gradient is 1. Distances are in m (rad times `LENGTH_SCALE`), at least 0.
        """
        slopes = look.slopes * self._scale
        size = np.abs(slopes).max(axis=1, initial=0.0)
        moving = size > _STILL
        divisor = np.where(moving, size, 1.0)
        slopes = np.where(moving[:, None], slopes / divisor[:, None], 0.0)
        passive_slack = np.maximum(0.0, look.slacks) / divisor
        passive_slack = np.where(moving, passive_slack, np.inf)
        active_slack = np.maximum(0.0, self._slacks(look.q)) / self._size
        return np.vstack([self._G, slopes]), np.concatenate([active_slack, passive_slack])

    def _slacks(self, q: Array) -> Array:
        """Return the distances (b,) of q (n,) from the bounds, in m or rad."""
        return np.array([bound.slack(q) for bound in self.bounds])

    def passed(self, before: LinearizedState, look: LinearizedState) -> tuple[PassiveLimit, ...]:
        """Return the limits of passive joints that a step passes; beyond a limit, a joint may only move back."""
        beyond = look.slacks < _floor(before)
        limits = []
        for i in np.flatnonzero(beyond):
            limits.append(self.look.limits[i])
        return tuple(limits)

    def brought_back(
        self, before: LinearizedState, look: LinearizedState, held: tuple[str, Array]
    ) -> LinearizedState | None:
        """Return the state after a step, moved back to the limits of passive joints that the step passes; else None.

        Steps follow the tangent of such a limit, and leave it by an amount of second order.
        """
        floor = _floor(before)
        for _ in range(_BACK):
            beyond = look.slacks < floor
            if not beyond.any():
                return look
            slopes = look.slopes[beyond] * self._scale
            missing = np.maximum(0.0, floor + ROUNDING - look.slacks)[beyond]

            # The way back must not pass the bounds that are reached: along them, the joints stay.
            slack = self._slacks(look.q)
            reached = slack / self._size < _NEAR
            gradients = np.vstack([slopes, self._G[reached]])
            wanted = np.append(missing, np.zeros(int(reached.sum())))
            motion = np.asarray(np.linalg.pinv(gradients) @ wanted, float)
            dq = self._scale * motion
            after = self._slacks(look.q + dq)
            if (after < np.minimum(0.0, slack) - 1e-12).any():
                return None
            further, _ = self._moved(look, dq, held)
            if further is None:
                return None
            look = further
        return None

    # -- one step -------------------------------------------------------------------------------------

    def _moved(
        self, look: LinearizedState, dq: Array, held: tuple[str, Array], tool: bool = True
    ) -> tuple[LinearizedState | None, str]:
        """Return (state after the step dq (n,), ""), or (None, cause) if the step is rejected.

        The cause is "loop NAME" or "tool" if this matrix becomes singular; "" if the step is too long or the loops do
        not close.
        """
        du = look.answers @ dq
        lengths = np.where(self._turns, LENGTH_SCALE, 1.0) * du
        if np.abs(lengths).max(initial=0.0) > 10 * _STRIDE:
            return None, ""
        q = look.q + dq
        guess = self._stepped(look.u, du)
        u = self.solver.close(q, guess)
        # Newton's method may end far from its start, in another assembly.
        if u is None or np.abs(u - guess).max(initial=0.0) > 0.1:
            return None, ""
        new = self.look(q, u, *held)
        drawn = self._as_drawn
        for name, (before, after) in self.determinants(look, new, tool).items():
            changes_sign = before * after <= 0
            # Close to a singularity, a step may lead only away from it.
            decreases = abs(after) < abs(before) and abs(after) < _LEFT * drawn[name]
            if changes_sign or decreases:
                return None, name
        return new, ""

    def determinants(
        self, before: LinearizedState, look: LinearizedState, tool: bool
    ) -> dict[str, tuple[float, float]]:
        """Return the determinants {name: (before, now)} of loops and tool; their signs change only at singularities.

        Matrices that are not square are first projected onto the singular vectors of the matrix in state `before`.
        """
        determinants: dict[str, tuple[float, float]] = {}
        for name, A, B in zip(self._loops, before.loops, look.loops, strict=True):
            determinants[f"loop {name}"] = _determinants(A, B)
        n = len(look.q)
        if tool and n <= 6:  # a redundant arm can move while its tool is at rest
            A = before.tool * self._scale * LENGTH_SCALE
            B = look.tool * self._scale * LENGTH_SCALE
            determinants["tool"] = _determinants(A, B)
        return determinants

    def nearest(self, look: LinearizedState) -> str:
        """Return the name of the loop nearest to a singularity, which is probably the loop that no longer closes."""
        sizes: dict[str, float] = {}
        for name, (determinant, _) in self.determinants(look, look, False).items():
            drawn = max(self._as_drawn[name], 1e-300)  # a loop may be singular in the rest poses
            sizes[name] = abs(determinant) / drawn
        return min(sizes, key=sizes.__getitem__, default="")

    @cached_property
    def _as_drawn(self) -> dict[str, float]:
        """Sizes {name: |determinant|} of loops and tool in the rest poses."""
        u = np.concatenate([*self.solver.home, []])
        look = self.look(self.solver.q, u, self.solver.mechanism.base, np.zeros(3))
        sizes: dict[str, float] = {}
        for name, (determinant, _) in self.determinants(look, look, True).items():
            sizes[name] = abs(determinant)
        return sizes

    def _stepped(self, u: Array, du: Array) -> Array:
        """Return the unknowns after a step du; quaternions are rotated in their own frame."""
        stepped = u.copy()
        i = 0
        j = 0
        for kind in self._kinds:
            has_quat = kind in ("spherical", "free")
            end = i + STATES[kind]
            lengths = STATES[kind]
            if has_quat:
                lengths -= 4
            stepped[i : i + lengths] += du[j : j + lengths]
            if has_quat:
                turn = du[j + lengths : j + STEPS[kind]] / 2
                quat_wxyz = _product_wxyz(u[i + lengths : end], turn)
                stepped[i + lengths : end] = quat_wxyz / np.linalg.norm(quat_wxyz)
            i = end
            j += STEPS[kind]
        return stepped


class DragGrip:
    """A grabbed point. Its final position does not depend on intermediate targets on the line to the last target."""

    def __init__(self, dragger: Dragger, look: LinearizedState, held: tuple[str, Array]) -> None:
        self._walk = _Walk(dragger, look, held)
        self._hand = look.p
        self._target = look.p
        self._end = self._walk

    def to(self, target: Array, seconds: float = np.inf) -> Dragged:
        """Move the point towards a target.

        `target` (3,) is in base, in m. After `seconds` of processor time the motion stops; call again with the same
        target to continue.
        """
        until = time.thread_time() + seconds
        walk = self._walk
        if not np.array_equal(target, self._target):
            # The last step to the former target is dropped, because its length depends on that target.
            self._target = np.array(target, float)
            self._end = walk
        while self._end is walk:
            if not walk.goes_on(until):
                return walk.result(more=True)
            line = self._target - self._hand
            distance = np.linalg.norm(line)
            # If the point lags far behind the goal, a longer step of the goal hardly changes the direction to it.
            lag = float(np.linalg.norm(self._hand - walk.look.p))
            step = max(_STEP, _LAG * lag)
            if distance <= step:
                self._end = copy(walk)
                self._end.begin(self._target, last=True)
            else:
                self._hand = self._hand + line * (step / distance)
                walk.begin(self._hand)
        finished = self._end.goes_on(until)
        return self._end.result(more=not finished)


class _Walk:
    """Steps of a point towards a sequence of goals; `look` is the current state. A copy can continue independently."""

    def __init__(self, dragger: Dragger, look: LinearizedState, held: tuple[str, Array]) -> None:
        self.dragger = dragger
        self.look = look
        self.held = held
        self.singular = ""
        self.open = False
        self._passed = False
        self._pull = np.zeros(len(look.q))
        self._G, self._slack = dragger.held(look)
        self._part = 1.0
        self._within = _THERE
        self._gain = _GAIN
        self._tries = 0

    def begin(self, goal: Array, last: bool = False) -> None:
        """Start moving to a goal (3,); with `last`, the point approaches the goal as closely as possible."""
        self._goal = goal
        self._first = self.look
        self._total = np.zeros(len(self.look.q))
        if last:
            self._within = _THERE
            self._gain = _LAST_GAIN
            self._tries = _LAST_TRIES
        else:
            self._within = _PASSED
            self._gain = _GAIN
            self._tries = _TRIES

    def goes_on(self, until: float) -> bool:
        """Move the point as near to the goal as possible; return False if processor time exceeds `until`."""
        while self._tries:
            distance = float(np.linalg.norm(self._goal - self.look.p))
            if distance < self._within:
                break
            if time.thread_time() > until:
                return False
            self._tries -= 1
            y = self._step(self._first, self._total, self._goal)
            if y is None:
                break
            self._total = self._total + y
            decrease = distance - np.linalg.norm(self._goal - self.look.p)
            if decrease < self._gain * min(distance, _STEP):
                break
        self._tries = 0
        return True

    def result(self, more: bool) -> Dragged:
        """Return the state and the bounds that block the point."""
        singular = self.singular
        if self.open:
            singular = self.dragger.nearest(self.look)
        return Dragged(self.look.q, self.look.u, self.stops(), singular, more)

    def _step(self, first: LinearizedState, total: Array, goal: Array) -> Array | None:
        """Move one step nearer to the goal; return the joint motion (n,), scaled to m; None if no step is found."""
        dragger = self.dragger
        now = self.look
        scale = dragger._scale
        miss = goal - now.p
        # The total joint motion from `first` is minimised. With the mean Jacobian of both ends, the error of this
        # minimum is of second order.
        J_mean = 0.5 * (first.J + now.J) * scale
        J_now = now.J * scale
        self._G, self._slack = dragger.held(now)
        self.singular = ""
        self.open = False
        self._passed = False
        self._pull = -J_now.T @ miss
        size = float(np.sum(J_mean * J_mean))
        if size < _WEAK**2:  # no joint moves this point noticeably
            return None

        G = self._G
        near = self._slack < _NEAR
        active = near & (G @ self._pull > 0)
        damping = _DAMPINGS[0] * size
        y = np.zeros(len(total))
        # The step slides along the bounds in `active`; each pass adds the reached bounds that the step would pass.
        # Each pass adds at least one, so that the loop ends.
        while True:
            P = np.eye(len(total)) - np.linalg.pinv(G[active]) @ G[active]
            U, gains, _ = np.linalg.svd(J_now @ P)
            strong = U[:, : int(np.sum(gains > _WEAK))]
            if strong.shape[1] < 3:  # try all directions first; accept only if all are strong afterwards
                y = np.asarray(P @ _least_motion(J_mean @ P, miss, total, damping), float)
                blocked = near & ~active & _towards(G, y)
                if not blocked.any() and self._taken(y, goal, easy=True):
                    return y * self._part
            y = np.asarray(P @ _least_motion(strong.T @ J_mean @ P, strong.T @ miss, total, damping), float)
            blocked = near & ~active & _towards(G, y)
            if not blocked.any():
                break
            active |= blocked
        if np.linalg.norm(strong.T @ miss) < self._within:
            return None

        for relative_damping in _DAMPINGS[1:]:
            for _ in range(_HALVINGS):
                if self._taken(y, goal):
                    return y * self._part
                if not self._rejected:
                    break  # the step makes no progress: change its direction, not its length
                y = y * self._part / 2
            if self._rejected:
                return None
            # Without the total motion, a large damping turns the step towards steepest descent.
            y = P @ _least_motion(strong.T @ J_now @ P, strong.T @ miss, 0 * total, relative_damping * size)
        return None

    @property
    def _rejected(self) -> bool:
        """Whether the mechanism could not do the last step: a loop stays open, is singular, or passes a limit."""
        return bool(self.open or self.singular or self._passed)

    def _taken(self, y: Array, goal: Array, easy: bool = False) -> bool:
        """Shorten the step y (n,) in m to the limits, and do the step if the distance to the goal then decreases.

        Return whether the step was done. With `easy`, only states in which the point can move in all directions are
        accepted.
        """
        dragger = self.dragger
        now = self.look
        used = -(self._G @ y)
        longest = max(np.abs(y).max(initial=0.0), 1e-15)
        part = min(1.0, _STRIDE / longest)
        towards = _towards(self._G, y)
        self._part = float(np.min(self._slack[towards] / used[towards], initial=part))
        reached, cause = dragger._moved(now, dragger._scale * (self._part * y), self.held)
        if reached is None:
            self.singular = cause
            self.open = not cause
            self._passed = False
            return False
        self.singular = ""
        self.open = False
        reached = dragger.brought_back(now, reached, self.held)
        self._passed = reached is None
        if reached is None:
            return False
        if np.linalg.norm(goal - reached.p) >= np.linalg.norm(goal - now.p):
            return False
        if easy:
            gains = np.linalg.svd(reached.J * dragger._scale, compute_uv=False)
            if gains[-1] <= _WEAK:
                return False
        self.look = reached
        return True

    def stops(self) -> tuple[Stop, ...]:
        """Return the bounds and limits that block the point."""
        dragger = self.dragger
        stops: list[Stop] = []
        gradients: list[Array] = []
        threshold = 1e-6 * np.linalg.norm(self._pull)
        G, slack = dragger.held(self.look)
        candidates = (*dragger.bounds, *dragger.look.limits)
        for stop, gradient, distance in zip(candidates, G, slack, strict=True):
            blocks = distance < _NEAR and gradient @ self._pull > threshold
            if not blocks:
                continue
            # Pins of a parallelogram reach their limits together with the joint that moves them: name that joint only.
            for other in gradients:
                if np.abs(gradient - other).max() < _ALIKE:
                    break
            else:
                stops.append(stop)
                gradients.append(gradient)
        return tuple(stops)


def _floor(look: LinearizedState) -> Array:
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
    g = J.T @ miss - damping * total
    return np.asarray(np.linalg.solve(H, g), float)


def _determinants(A: Array, B: Array) -> tuple[float, float]:
    """Return the determinants of two matrices, after a projection onto the singular vectors of A if not square."""
    if A.shape[0] == A.shape[1]:
        return float(np.linalg.det(A)), float(np.linalg.det(B))
    U, values, Vt = np.linalg.svd(A, full_matrices=False)
    rank = int(np.sum(values > 1e-9 * values.max(initial=0.0)))
    projection = U[:, :rank].T @ B @ Vt[:rank].T
    return float(np.prod(values[:rank])), float(np.linalg.det(projection))


def _product_wxyz(quat_wxyz: Array, turn: Array) -> Array:
    """Return quat_wxyz (4,) times the quaternion (1, turn), of a rotation by the small vector 2 turn (3,)."""
    w = quat_wxyz[0]
    v = quat_wxyz[1:]
    a, b, c = v
    x, y, z = turn
    cross = np.array([b * z - c * y, c * x - a * z, a * y - b * x])  # np.cross takes ten times as long
    return np.array([w - v @ turn, *(v + w * turn + cross)])
