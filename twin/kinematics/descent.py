"""One compiled Levenberg-Marquardt iteration for a robot and a kind of task, and the loop that runs the iteration.

A step dx minimises |J dx + r|^2 + mu |dx|^2. The damping mu follows Nielsen's rule: it decreases if the linear model
predicts the decrease of the cost well; successive failed steps multiply mu by 2, 4, 8, ... Residual, Jacobian, step and
damping are one CasADi function, because separate NumPy calls would take five times as long.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.evaluator import Evaluator
from twin.formula.program import Program
from twin.kinematics import tasks

MAX_ITERATIONS = 120
"""Maximum number of steps tried from one start."""

_SMALLEST_MU = 1e-11
"""Minimum damping, relative to the largest squared column norm of the first Jacobian."""

_FIRST_MU = 1e-3
"""Damping of the first step, relative to the largest squared column norm of the first Jacobian."""

_SMALLEST_MU_FACTOR = 1 / 30
"""Smallest factor of mu after a step that the linear model predicts well; Nielsen's rule has 1/3."""

_SMALLEST_PROGRESS = 1e-12
"""Decrease of the cost, relative to the cost, below which a step makes no progress."""

_MAX_STUCK_STEPS = 3
"""Number of steps without progress after which the iteration ends."""

_SMALLEST_SQUARED_STEP = 1e-28
"""Squared norm of a rejected step below which it counts as one without progress."""

_LARGEST_MU = 1e12
"""Damping above which no step helps, however short."""

_SMALLEST_COLUMN_SIZE = 1e-12
"""Squared column norm that stands for 0: that of a task that no unknown changes."""

_SMALLEST_DECREASE = 1e-300
"""Decrease that stands for 0 in a quotient."""

TermKinds = tuple[tuple[str, tuple[int, ...]], ...]
"""(kind, rows) of each term of a task."""


def _moved_pose(x: ca.SX, twist: ca.SX) -> ca.SX:
    """Return a pose (16,) after a twist (6,)."""
    T = symbolic.unflat(x, 4, 4)
    return symbolic.flat(symbolic.retract(T, twist))


def _memory_sizes(state_size: int, unknown_count: int) -> dict[str, int]:
    """Return {quantity: count of its numbers} of the memory, which one call of an iteration hands to the next."""
    return {
        "state": state_size,
        "cost": 1,
        "squared residual": 1,  # of the task alone, without exceeded limits
        "mu": 1,
        "factor of mu": 1,
        "stuck steps": 1,
        "largest squared column norm": 1,
        "gradient": unknown_count,  # J^T r
        "normal matrix": unknown_count**2,  # J^T J
    }


class Iteration:
    """Compiled iteration for a robot and kinds of terms; the state is q (n,) or, without a forward equation, T (16,).

    If the unknowns are joints, they are projected onto their limits. If the unknown is the pose, an additional residual
    is used: it is zero within the joint limits and grows with the excess.
    """

    def __init__(self, program: Program, kinds: TermKinds) -> None:
        """Compile the iteration; `kinds` are the terms of the task."""
        joint_count = len(program.order)
        by_joints = program.has_forward
        self.state_size = joint_count if by_joints else 16
        unknown_count = joint_count if by_joints else 6
        self.unknown_count = unknown_count
        counts = []
        self.row_count = 0
        for kind, rows in kinds:
            counts.append(tasks.argument_count(kind, joint_count))
            self.row_count += joint_count if kind == "joints" else len(rows)

        sizes = _memory_sizes(self.state_size, unknown_count)
        self.memory_size = sum(sizes.values())
        self._memory_places = dict(zip(sizes, np.cumsum([0, *sizes.values()]).tolist(), strict=False))
        input_sizes = [sum(counts), self.row_count, unknown_count, joint_count, joint_count, joint_count]
        arguments = ca.SX.sym("z", self.memory_size + sum(input_sizes))
        memory = ca.vertsplit(arguments[: self.memory_size], [0, *np.cumsum(list(sizes.values()))])
        x, cost, squared_residual, mu, factor, stuck, largest_size, g, H = memory
        inputs = arguments[self.memory_size :]
        _, _, step_scale, _, low, high = ca.vertsplit(inputs, [0, *np.cumsum(input_sizes)])
        H = ca.reshape(H, unknown_count, unknown_count)
        at_limit = _held_at_limits(x, g, low, high) if by_joints else ca.SX.zeros(unknown_count)
        movable = 1 - at_limit
        damped = H * (movable @ movable.T) + ca.diag(mu * movable + at_limit)
        step = -_solve(damped, g * movable)
        if by_joints:
            x_new = ca.fmin(ca.fmax(x + step * step_scale, low), high)
        else:
            x_new = _moved_pose(x, step * step_scale)

        function = self._residual(program, kinds, inputs, input_sizes)
        r, J, squared_misfit, squared_joints = function(x_new, ca.SX.zeros(unknown_count), inputs)
        cost_new = ca.sumsqr(r)
        decrease = cost - cost_new
        predicted = ca.dot(step, mu * step - g * movable)
        ratio = decrease / ca.fmax(predicted, _SMALLEST_DECREASE)
        is_first = largest_size == 0
        is_better = (cost_new < cost) * (ca.sumsqr(J) + squared_joints < np.inf)  # false if any value is NaN
        largest_size_new = ca.if_else(is_first, ca.fmax(ca.mmax(ca.sum1(J * J)), _SMALLEST_COLUMN_SIZE), largest_size)
        # If mu were below the floor, rounding errors divided by mu would cause motion in directions that are free.
        shrunk = ca.fmax(mu * ca.fmax(_SMALLEST_MU_FACTOR, 1 - (2 * ratio - 1) ** 3), _SMALLEST_MU * largest_size)
        stuck_new = ca.if_else(decrease < _SMALLEST_PROGRESS * cost, stuck + 1, 0)
        # both lists in the order of `_memory_sizes`
        accepted = [
            x_new,
            cost_new,
            squared_misfit,
            ca.if_else(is_first, _FIRST_MU * largest_size_new, shrunk),
            2,
            ca.if_else(is_first, 0, stuck_new),
            largest_size_new,
            J.T @ r,
            ca.vec(J.T @ J),
        ]
        is_tiny = ca.sumsqr(step) < _SMALLEST_SQUARED_STEP
        rejected = [x, cost, squared_residual, mu * factor, 2 * factor, stuck + is_tiny, largest_size, g, ca.vec(H)]
        after = ca.if_else(is_better, ca.vertcat(*accepted), ca.vertcat(*rejected))
        self._evaluator = Evaluator("iteration", arguments, ca.cse(ca.vertcat(after, ca.sum1(movable))))

    def _residual(self, program: Program, kinds: TermKinds, inputs: ca.SX, input_sizes: list[int]) -> ca.Function:
        """Return a function of state, step and `inputs`: residual, Jacobian, and squares of task residual and joints.

        It has symbols of its own, so that the step of the iteration is not differentiated. `inputs` are those of
        `run`, of these sizes.
        """
        numbers, weights, step_scale, joint_scale, low, high = ca.vertsplit(inputs, [0, *np.cumsum(input_sizes)])
        state = ca.SX.sym("at", self.state_size)
        step = ca.SX.sym("by", self.unknown_count)
        T, q = program.around(state, step * step_scale)
        counts = []
        for kind, _ in kinds:
            counts.append(tasks.argument_count(kind, len(program.order)))
        terms = ca.vertsplit(numbers, [0, *np.cumsum(counts)])
        residuals: list[ca.SX] = []
        for (kind, rows), arguments in zip(kinds, terms, strict=True):
            residuals.append(tasks.residual(kind, rows, T, q, arguments))
        r = weights * ca.vertcat(*residuals)
        squared_misfit = ca.sumsqr(r)
        if not program.has_forward:
            excess = ca.fmin(q - low, 0) + ca.fmax(q - high, 0)
            r = ca.vertcat(r, joint_scale * excess)
        return ca.Function("rows", [state, step, inputs], [r, ca.jacobian(r, step), squared_misfit, ca.sumsqr(q)])

    def run(
        self, start: Array, inputs: Array, goal: float, history: list[float] | None = None
    ) -> tuple[Array, float, int]:
        """Iterate from `start`; return (state, norm of the task's residual, steps tried).

        `inputs` is the concatenation of six arrays: arguments of the terms, weights of the residuals, changes of the
        unknowns per unit of a step, weights of exceeded joint limits, lower limits, upper limits. The iteration stops
        when the norm of the whole residual (task and exceeded limits) is at most `goal`, after `MAX_ITERATIONS` steps,
        when limits hold all joints, at step number `_MAX_STUCK_STEPS` without progress since the last with progress, or
        when the damping exceeds `_LARGEST_MU`. If the residual at the start is not finite, the result is (start,
        infinity, 0). Otherwise, the norm of the task's residual at the start and after each step is appended to
        `history`.
        """
        cost = self._memory_places["cost"]
        squared_residual = self._memory_places["squared residual"]
        mu = self._memory_places["mu"]
        stuck = self._memory_places["stuck steps"]
        memory_and_inputs = np.zeros(self.memory_size + len(inputs))
        memory_and_inputs[: self.state_size] = start
        memory_and_inputs[self.memory_size :] = inputs
        # An infinite cost and a zero step: the first call only evaluates.
        memory_and_inputs[cost] = np.inf
        memory_and_inputs[mu] = 1.0
        results = self._evaluator.one(memory_and_inputs)
        if not np.isfinite(results[cost]):
            return start, np.inf, 0
        steps_tried = 0
        if history is not None:
            history.append(float(np.sqrt(results[squared_residual])))
        # the last number is that of the unknowns that are not held at a limit
        while steps_tried < MAX_ITERATIONS and results[cost] > goal**2 and results[-1]:
            memory_and_inputs[: self.memory_size] = results[:-1]
            results = self._evaluator.one(memory_and_inputs)
            steps_tried += 1
            if history is not None:
                history.append(float(np.sqrt(results[squared_residual])))
            if results[stuck] >= _MAX_STUCK_STEPS or results[mu] > _LARGEST_MU:
                break
        return results[: self.state_size], float(np.sqrt(results[squared_residual])), steps_tried


_ITERATIONS: WeakKeyDictionary[Program, dict[TermKinds, Iteration]] = WeakKeyDictionary()


def iteration(program: Program, kinds: TermKinds) -> Iteration:
    """Return the `Iteration` for a robot and kinds of terms; it is compiled when first requested."""
    of_program = _ITERATIONS.setdefault(program, {})
    if kinds not in of_program:
        of_program[kinds] = Iteration(program, kinds)
    return of_program[kinds]


def _held_at_limits(q: ca.SX, gradient: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    """Return 1 for each joint at a limit beyond which a step along the negative gradient would move it, else 0."""
    below = (q <= low) * (gradient > 0)
    above = (q >= high) * (gradient < 0)
    return below + above


def _solve(A: ca.SX, b: ca.SX) -> ca.SX:
    """Return A^-1 b for a positive definite matrix A, without branches."""
    D, LT, permutation = ca.ldl(A, False)
    return ca.ldl_solve(b, D, LT, permutation)
