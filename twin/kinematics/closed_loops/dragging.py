"""Interactive motion of a mechanism: single steps of its joints, and motions of all active joints along a line.

Each step stays in the assembly of the previous step; a step is halved if the loops do not close after it. An assembly
ends at two kinds of singularity: the loops no longer determine their passive joints (type II), or the active joints no
longer determine the tool (type I). A dragged point stops before both kinds. The motion of an active joint
(`Dragger.move_joints`) passes through type I singularities, like the motion of a real drive.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.kinematics.closed_loops.bounds import Bound
from twin.kinematics.closed_loops.equations import LENGTH_SCALE, STATE_SIZES, STEP_SIZES
from twin.kinematics.closed_loops.linearizer import LinearizedState, Linearizer
from twin.kinematics.closed_loops.passive_limits import PassiveLimit
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.model.mechanism import Mechanism

STRIDE = 4e-3
"""Maximum motion (m; rad times `LENGTH_SCALE`) of the active joints in a step."""

_PASSIVE_STRIDES = 10
"""Maximum motion of the passive joints in a step, in strides."""

_MAX_JUMP = 0.1
"""Maximum change of an unknown (m, rad) by Newton's method; a larger one may lead to another assembly."""

_JOINT_HALVINGS = 14
"""Maximum number of halvings of a step of the active joints."""

_MIN_LENGTH = 1e-12
"""Motion in m that stands for 0 in a quotient."""

_MAX_ROUNDING = 1e-12
"""Violation of a bound in m or rad that is only a rounding error."""

_SAME_FRACTION = 1e-9
"""Difference of the fractions of a motion at which it meets two bounds together."""

_MIN_DETERMINANT = 1e-300
"""Determinant that stands for 0 in a quotient."""

_MIN_SINGULAR_RATIO = 1e-9
"""Size of a singular value, relative to the largest, below which it counts as zero."""

_MIN_DETERMINANT_RATIO = 1e-3
"""Minimum determinant relative to its value in the rest poses; a smaller determinant counts as another assembly."""

_MAX_CORRECTIONS = 4
"""Maximum number of steps back to the limits of passive joints, after a step along them."""

_MIN_SLACK_CHANGE = 1e-9
"""Change of the slack of a passive joint per m of the active joints, below which they do not move this joint."""

REACHED_DISTANCE = 1e-7
"""Distance (m; rad times `LENGTH_SCALE`) from a limit at which the limit counts as reached."""

_ANGLE_STEPS = {
    "revolute": [True],
    "prismatic": [False],
    "cylindrical": [False, True],
    "spherical": [True] * 3,
    "free": [False] * 3 + [True] * 3,
}
"""Whether each number in a step of a passive joint is an angle, by type; see `STEP_SIZES`."""

Stop = Bound | PassiveLimit
"""What blocks a motion."""


@dataclass(frozen=True, eq=False)
class Dragged:
    """Result of a motion.

    Attributes:
        q, u: active joints (n,) and loop unknowns (m,) after the motion; see `ClosedStates.states`.
        stops: bounds of active joints and limits of passive joints that block the motion.
        singular: the matrix that becomes singular: that of a loop (such as "loop r13") or of the "tool". If the loops
            do not close after a step, however short: the loop nearest to a singularity, which is the probable cause.
            "" if neither stops the motion.
        more: whether the motion stopped only because its processor time was used up.
    """

    q: Array
    u: Array
    stops: tuple[Stop, ...] = ()
    singular: str = ""
    more: bool = False


class GrabbedPoint(NamedTuple):
    """A point of a body: (3,) in the frame of the body, in m."""

    body: str
    p_body: Array


class Dragger:
    """Motion of one mechanism by the active joints (`move_joints`), and the steps of a grabbed point (`grip.DragGrip`).

    Attributes:
        solver: loop solver of the mechanism.
        bounds: limits that the motion respects.
        linearize: function that computes the `LinearizedState` of a grabbed point.
        scale: (n,) joint units per m of a step: 1 for slides, 1 / `LENGTH_SCALE` for hinges.
    """

    def __init__(self, mechanism: Mechanism, bounds: Sequence[Bound] = ()) -> None:
        """Compile the loops; raise `AssemblyError` if the loops do not close in the rest poses."""
        self.solver = LoopSolver(mechanism)
        self.bounds = tuple(bounds)
        self.scale = np.ones(len(mechanism.active))  # joint units per m of a step
        for i, joint in enumerate(mechanism.active):
            if joint.is_angle:
                self.scale[i] = 1 / LENGTH_SCALE

        # Each gradient is divided by its largest entry, so that slacks are distances of joints.
        gradients = np.zeros((len(self.bounds), len(self.scale)))
        for i, bound in enumerate(self.bounds):
            gradients[i] = bound.weights * self.scale
        size = np.abs(gradients).max(axis=1, initial=0.0, keepdims=True)
        self._bound_gradients = gradients / np.where(size > 0, size, 1.0)
        self._gradient_sizes = size[:, 0]

        self._kinds: list[str] = []
        turns: list[bool] = []
        for passive in self.solver.equations.passive:
            kind = passive.joint.type
            self._kinds.append(kind)
            turns += _ANGLE_STEPS[kind]
        self._is_angle_step = np.array(turns, bool)

        self.linearize = Linearizer(self.solver)
        rest = np.concatenate([*self.solver.home, []])
        self.solver.close(self.solver.q, rest)  # compiles the kernel here and not in the first motion

        names = self.solver.equations.row_names
        self._loop_names: list[str] = []
        for block in self.solver.blocks:
            members: dict[str, None] = {}  # in their order, each once
            for row in block.rows:
                members[names[row]] = None
            self._loop_names.append(" ".join(members))

    # -- by the joints --------------------------------------------------------------------------------

    def move_joints(self, q: Array, u: Array, target: Array, cpu_seconds: float = np.inf) -> Dragged:
        """Move the active joints from q (n,) towards a target (n,); all joints arrive at the same time.

        Return the state reached, with the reason if a limit or a loop stops the motion before the target: a loop that
        becomes singular or, if the loops do not close, the one nearest to a singularity. The motion ends early, with
        `more` set, once it has used `cpu_seconds` of this thread's processor time.
        """
        q = np.asarray(q, float)
        target = np.asarray(target, float)
        motion = target - q
        part, stops = self._first_stops(q, motion)

        point = GrabbedPoint(self.solver.mechanism.base, np.zeros(3))  # no point is dragged; any point serves
        state = self.linearize(q, u, *point)
        fraction = 0.0  # of the motion that is done
        longest = np.abs(motion / self.scale).max(initial=0.0)
        stride = STRIDE / max(longest, _MIN_LENGTH)
        step = stride
        until = time.thread_time() + cpu_seconds
        while fraction < part:
            if time.thread_time() > until:
                return Dragged(state.q, state.u, more=True)
            ahead = min(fraction + step, part)
            # q + motion can differ from the target by a rounding error.
            goal = target
            if ahead < 1:
                goal = q + ahead * motion
            after, cause = self.stepped(state, goal - state.q, point, tool=False)
            passed: tuple[PassiveLimit, ...] = ()
            if after is not None:
                passed = self.passed_limits(state, after)
            if after is not None and not passed:
                state = after
                fraction = ahead
                step = min(stride, 2 * step)
                continue
            step /= 2
            if step < stride / 2**_JOINT_HALVINGS:
                if passed:
                    return Dragged(state.q, state.u, passed)
                return Dragged(state.q, state.u, (), cause or self.nearest_loop(state))
        return Dragged(state.q, state.u, tuple(stops))

    def _first_stops(self, q: Array, motion: Array) -> tuple[float, list[Bound]]:
        """Return (fraction of a motion (n,) from q (n,) up to the first bounds, these bounds); without any, (1, [])."""
        fractions: list[tuple[float, Bound]] = []
        for bound in self.bounds:
            change = float(bound.weights @ motion)
            slack = bound.slack(q)
            # An end within rounding of the bound does not violate the bound.
            if change < 0 and slack + change < -_MAX_ROUNDING:
                fractions.append((max(0.0, slack) / -change, bound))
        part = 1.0
        for fraction, _ in fractions:
            part = min(part, fraction)
        # bounds that the motion meets together
        first = []
        for fraction, bound in fractions:
            if fraction <= part + _SAME_FRACTION:
                first.append(bound)
        return part, first

    # -- limits ---------------------------------------------------------------------------------------

    def gradients_and_slacks(self, state: LinearizedState) -> tuple[Array, Array]:
        """Return (G (b, n), slack (b,)) in a state: for each stop, the gradient of its distance, and its distance.

        The largest entry of a gradient is 1. Distances are in m (rad times `LENGTH_SCALE`), at least 0.
        """
        slopes = state.slack_rates * self.scale
        size = np.abs(slopes).max(axis=1, initial=0.0)
        moving = size > _MIN_SLACK_CHANGE
        divisor = np.where(moving, size, 1.0)
        slopes = np.where(moving[:, None], slopes / divisor[:, None], 0.0)
        passive_slack = np.maximum(0.0, state.slacks) / divisor
        passive_slack = np.where(moving, passive_slack, np.inf)
        active_slack = np.maximum(0.0, self._bound_slacks(state.q)) / self._gradient_sizes
        return np.vstack([self._bound_gradients, slopes]), np.concatenate([active_slack, passive_slack])

    def _bound_slacks(self, q: Array) -> Array:
        """Return the distances (b,) of q (n,) from the bounds, in m or rad."""
        return np.array([bound.slack(q) for bound in self.bounds])

    def passed_limits(self, before: LinearizedState, after: LinearizedState) -> tuple[PassiveLimit, ...]:
        """Return the limits of passive joints that a step passes; beyond a limit, a joint may only move back."""
        beyond = after.slacks < _smallest_allowed_slacks(before)
        limits = []
        for i in np.flatnonzero(beyond):
            limits.append(self.linearize.limits[i])
        return tuple(limits)

    def brought_back(
        self, before: LinearizedState, after: LinearizedState, point: GrabbedPoint
    ) -> LinearizedState | None:
        """Return the state after a step, moved back to the limits of passive joints that the step passes; else None.

        Steps follow the tangent of such a limit, and leave it by an amount of second order.
        """
        floor = _smallest_allowed_slacks(before)
        state = after
        for _ in range(_MAX_CORRECTIONS):
            beyond = state.slacks < floor
            if not beyond.any():
                return state
            slopes = state.slack_rates[beyond] * self.scale
            missing = np.maximum(0.0, floor + ROUNDING - state.slacks)[beyond]

            # The way back must not pass the bounds that are reached: along them, the joints stay.
            slack = self._bound_slacks(state.q)
            reached = slack / self._gradient_sizes < REACHED_DISTANCE
            gradients = np.vstack([slopes, self._bound_gradients[reached]])
            slack_changes = np.append(missing, np.zeros(int(reached.sum())))
            motion = np.asarray(np.linalg.pinv(gradients) @ slack_changes, float)
            dq = self.scale * motion
            slack_after = self._bound_slacks(state.q + dq)
            if (slack_after < np.minimum(0.0, slack) - _MAX_ROUNDING).any():
                return None
            back, _ = self.stepped(state, dq, point)
            if back is None:
                return None
            state = back
        return None

    # -- one step -------------------------------------------------------------------------------------

    def stepped(
        self, state: LinearizedState, dq: Array, point: GrabbedPoint, tool: bool = True
    ) -> tuple[LinearizedState | None, str]:
        """Return (state after the step dq (n,), ""), or (None, cause) if the step is rejected.

        The cause is "loop NAME" or "tool" if this matrix becomes singular; "" if the step is too long or the loops do
        not close. Without `tool`, the matrix of the tool may become singular.
        """
        du = state.unknown_rates @ dq
        lengths = np.where(self._is_angle_step, LENGTH_SCALE, 1.0) * du
        if np.abs(lengths).max(initial=0.0) > _PASSIVE_STRIDES * STRIDE:
            return None, ""
        q = state.q + dq
        guess = self._with_step(state.u, du)
        u = self.solver.close(q, guess)
        # Newton's method may end far from its start, in another assembly.
        if u is None or np.abs(u - guess).max(initial=0.0) > _MAX_JUMP:
            return None, ""
        after = self.linearize(q, u, *point)
        sizes_at_rest = self._sizes_at_rest
        for name, (determinant, determinant_after) in self.determinants(state, after, tool).items():
            changes_sign = determinant * determinant_after <= 0
            # Close to a singularity, a step may lead only away from it.
            decreases = abs(determinant_after) < abs(determinant)
            is_small = abs(determinant_after) < _MIN_DETERMINANT_RATIO * sizes_at_rest[name]
            if changes_sign or (decreases and is_small):
                return None, name
        return after, ""

    def determinants(
        self, before: LinearizedState, after: LinearizedState, tool: bool
    ) -> dict[str, tuple[float, float]]:
        """Return the determinants {name: (before, after)} of loops and tool; their signs change only at singularities.

        Matrices that are not square are first projected onto the singular vectors of the matrix in state `before`.
        """
        determinants: dict[str, tuple[float, float]] = {}
        for name, matrix_before, matrix_after in zip(self._loop_names, before.loops, after.loops, strict=True):
            determinants[f"loop {name}"] = _determinants(matrix_before, matrix_after)
        n = len(after.q)
        if tool and n <= 6:  # a redundant arm can move while its tool is at rest
            matrix_before = before.tool * self.scale * LENGTH_SCALE
            matrix_after = after.tool * self.scale * LENGTH_SCALE
            determinants["tool"] = _determinants(matrix_before, matrix_after)
        return determinants

    def nearest_loop(self, state: LinearizedState) -> str:
        """Return the name of the loop nearest to a singularity, which is probably the loop that no longer closes."""
        sizes: dict[str, float] = {}
        for name, (determinant, _) in self.determinants(state, state, tool=False).items():
            at_rest = max(self._sizes_at_rest[name], _MIN_DETERMINANT)  # a loop may be singular in the rest poses
            sizes[name] = abs(determinant) / at_rest
        return min(sizes, key=sizes.__getitem__, default="")

    @cached_property
    def _sizes_at_rest(self) -> dict[str, float]:
        """Sizes {name: |determinant|} of loops and tool in the rest poses."""
        u = np.concatenate([*self.solver.home, []])
        state = self.linearize(self.solver.q, u, self.solver.mechanism.base, np.zeros(3))
        sizes: dict[str, float] = {}
        for name, (determinant, _) in self.determinants(state, state, tool=True).items():
            sizes[name] = abs(determinant)
        return sizes

    def _with_step(self, unknowns: Array, step: Array) -> Array:
        """Return the unknowns after a step; quaternions are rotated in their own frame."""
        after = unknowns.copy()
        start = 0  # of the state of a joint in the unknowns
        start_step = 0  # of its step in the step of all
        for kind in self._kinds:
            has_quat = kind in ("spherical", "free")
            end = start + STATE_SIZES[kind]
            end_step = start_step + STEP_SIZES[kind]
            count = STATE_SIZES[kind] - 4 if has_quat else STATE_SIZES[kind]  # of the numbers before a quaternion
            after[start : start + count] += step[start_step : start_step + count]
            if has_quat:
                half_turn = step[start_step + count : end_step] / 2
                quat_wxyz = _product_wxyz(unknowns[start + count : end], half_turn)
                after[start + count : end] = quat_wxyz / np.linalg.norm(quat_wxyz)
            start = end
            start_step = end_step
        return after


def _smallest_allowed_slacks(state: LinearizedState) -> Array:
    """Return the smallest slacks (c,) of passive joints that a step from this state may reach."""
    return np.where(state.slacks < -ROUNDING, state.slacks, -ROUNDING)


def _determinants(matrix: Array, matrix_after: Array) -> tuple[float, float]:
    """Return the determinants of two matrices, after a projection onto the singular vectors of A if not square."""
    if matrix.shape[0] == matrix.shape[1]:
        return float(np.linalg.det(matrix)), float(np.linalg.det(matrix_after))
    U, values, Vt = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.sum(values > _MIN_SINGULAR_RATIO * values.max(initial=0.0)))
    projection = U[:, :rank].T @ matrix_after @ Vt[:rank].T
    return float(np.prod(values[:rank])), float(np.linalg.det(projection))


def _product_wxyz(quat_wxyz: Array, half_turn: Array) -> Array:
    """Return quat_wxyz (4,) times the quaternion (1, half_turn), of a rotation by the small vector 2 half_turn (3,)."""
    w = quat_wxyz[0]
    v = quat_wxyz[1:]
    a, b, c = v
    x, y, z = half_turn
    cross = np.array([b * z - c * y, c * x - a * z, a * y - b * x])  # np.cross takes ten times as long
    return np.array([w - v @ half_turn, *(v + w * half_turn + cross)])
