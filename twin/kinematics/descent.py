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

_MU_FLOOR = 1e-11
"""Minimum damping, relative to the largest squared column norm of the first Jacobian."""

_FIRST_MU = 1e-3
"""Damping of the first step, relative to the largest squared column norm of the first Jacobian."""

_SMALLEST_FACTOR = 1 / 30
"""Smallest factor of mu after a step that the linear model predicts well; Nielsen's rule has 1/3."""

_NO_PROGRESS = 1e-12
"""Decrease of the cost, relative to the cost, below which a step makes no progress."""

_STUCK = 3
"""Number of steps without progress after which the iteration ends."""

_TINY_STEP = 1e-28
"""Squared norm of a rejected step below which it counts as one without progress."""

_LARGEST_MU = 1e12
"""Damping above which no step helps, however short."""

_SMALLEST_SIZE = 1e-12
"""Squared column norm that stands for 0: that of a task that no unknown changes."""

_SMALLEST = 1e-300
"""Decrease that stands for 0 in a quotient."""

Kinds = tuple[tuple[str, tuple[int, ...]], ...]
"""(kind, rows) of each term of a task."""


class Iteration:
    """Compiled iteration for a robot and kinds of terms; the state is q (n,) or, without a forward equation, T (16,).

    If the unknowns are joints, they are projected onto their limits. If the unknown is the pose, an additional residual
    is used: it is zero within the joint limits and grows with the excess.
    """

    def __init__(self, program: Program, kinds: Kinds) -> None:
        """Compile the iteration; `kinds` are the terms of the task."""
        n = len(program.order)
        joints = program.has_forward
        self.state = n if joints else 16
        self.d = n if joints else 6
        d = self.d
        counts = [tasks.count(kind, n) for kind, _ in kinds]
        self.rows = 0
        for kind, rows in kinds:
            self.rows += n if kind == "joints" else len(rows)

        # The memory is what one call hands to the next: state, cost, squared residual of the task, mu, factor of mu,
        # steps without progress, largest squared column norm, gradient J^T r, and J^T J.
        sizes = [self.state, 1, 1, 1, 1, 1, 1, d, d**2]
        self.memory = sum(sizes)
        inputs = [sum(counts), self.rows, d, n, n, n]
        z = ca.SX.sym("z", self.memory + sum(inputs))
        x, cost, _, mu, grow, stuck, size, g, H, _, _, column, _, low, high = ca.vertsplit(
            z, [0, *np.cumsum([*sizes, *inputs])]
        )
        H = ca.reshape(H, d, d)
        held = ca.SX.zeros(d)
        if joints:
            # A joint at a limit stays there if the gradient points beyond the limit.
            below = (x <= low) * (g > 0)
            above = (x >= high) * (g < 0)
            held = below + above
        free = 1 - held
        damped = H * (free @ free.T) + ca.diag(mu * free + held)
        step = -_solve(damped, g * free)
        if joints:
            new = ca.fmin(ca.fmax(x + step * column, low), high)
        else:
            T = symbolic.unflat(x, 4, 4)
            new = symbolic.flat(symbolic.retract(T, step * column))

        fixed = z[self.memory :]
        function = self._residual(program, kinds, fixed, inputs)
        r, J, miss, length = function(new, ca.SX.zeros(d), fixed)
        cost_new = ca.sumsqr(r)
        decrease = cost - cost_new
        predicted = ca.dot(step, mu * step - g * free)
        ratio = decrease / ca.fmax(predicted, _SMALLEST)
        first = size == 0
        better = (cost_new < cost) * (ca.sumsqr(J) + length < np.inf)  # false if any value is NaN
        size_new = ca.if_else(first, ca.fmax(ca.mmax(ca.sum1(J * J)), _SMALLEST_SIZE), size)
        # If mu were below the floor, rounding errors divided by mu would cause motion in directions that are free.
        shrunk = ca.fmax(mu * ca.fmax(_SMALLEST_FACTOR, 1 - (2 * ratio - 1) ** 3), _MU_FLOOR * size)
        stuck_new = ca.if_else(decrease < _NO_PROGRESS * cost, stuck + 1, 0)
        accepted = [
            new,
            cost_new,
            miss,
            ca.if_else(first, _FIRST_MU * size_new, shrunk),
            2,
            ca.if_else(first, 0, stuck_new),
            size_new,
            J.T @ r,
            ca.vec(J.T @ J),
        ]
        tiny = ca.sumsqr(step) < _TINY_STEP
        kept = ca.vertsplit(z[: self.state + 2], [0, self.state, self.state + 1, self.state + 2])
        rejected = [*kept, mu * grow, 2 * grow, stuck + tiny, size, g, ca.vec(H)]
        after = ca.if_else(better, ca.vertcat(*accepted), ca.vertcat(*rejected))
        self._evaluator = Evaluator("iteration", z, ca.cse(ca.vertcat(after, ca.sum1(free))))

    def _residual(self, program: Program, kinds: Kinds, fixed: ca.SX, sizes: list[int]) -> ca.Function:
        """Return a function of state, step and `fixed`: residual, Jacobian, and squares of task residual and joints.

        It has symbols of its own, so that the step of the iteration is not differentiated. `fixed` are the inputs of
        `run`, of these sizes.
        """
        numbers, w, column, joint_scale, low, high = ca.vertsplit(fixed, [0, *np.cumsum(sizes)])
        at = ca.SX.sym("at", self.state)
        by = ca.SX.sym("by", self.d)
        T, q = program.around(at, by * column)
        counts = [tasks.count(kind, len(program.order)) for kind, _ in kinds]
        terms = ca.vertsplit(numbers, [0, *np.cumsum(counts)])
        residuals: list[ca.SX] = []
        for (kind, rows), arguments in zip(kinds, terms, strict=True):
            residuals.append(tasks.residual(kind, rows, T, q, arguments))
        r = w * ca.vertcat(*residuals)
        miss = ca.sumsqr(r)
        if not program.has_forward:
            excess = ca.fmin(q - low, 0) + ca.fmax(q - high, 0)
            r = ca.vertcat(r, joint_scale * excess)
        return ca.Function("rows", [at, by, fixed], [r, ca.jacobian(r, by), miss, ca.sumsqr(q)])

    def run(
        self, start: Array, inputs: Array, goal: float, history: list[float] | None = None
    ) -> tuple[Array, float, int]:
        """Iterate from `start`; return (state, norm of the task's residual, steps tried).

        `inputs` is the concatenation of six arrays: arguments of the terms, weights of the residuals, changes of the
        unknowns per unit of a step, weights of exceeded joint limits, lower limits, upper limits. The iteration stops
        when the norm of the whole residual (task and exceeded limits) is at most `goal`, after `MAX_ITERATIONS` steps,
        when limits hold all joints, at the step `_STUCK` without progress since the last with progress, or when the
        damping exceeds `_LARGEST_MU`. If the residual at the start is not finite, the result is (start, infinity, 0).
        Otherwise, the norm of the task's residual at the start and after each step is appended to `history`.
        """
        # places in the memory, see `__init__`
        cost = self.state
        squared_residual = cost + 1
        mu = cost + 2
        stuck = cost + 4
        z = np.zeros(self.memory + len(inputs))
        z[: self.state] = start
        z[self.memory :] = inputs
        # An infinite cost and a zero step: the first call only evaluates.
        z[cost] = np.inf
        z[mu] = 1.0
        after = self._evaluator.one(z)
        if not np.isfinite(after[cost]):
            return start, np.inf, 0
        tried = 0
        if history is not None:
            history.append(float(np.sqrt(after[squared_residual])))
        # the last number is that of the unknowns that are not held at a limit
        while tried < MAX_ITERATIONS and after[cost] > goal**2 and after[-1]:
            z[: self.memory] = after[:-1]
            after = self._evaluator.one(z)
            tried += 1
            if history is not None:
                history.append(float(np.sqrt(after[squared_residual])))
            if after[stuck] >= _STUCK or after[mu] > _LARGEST_MU:
                break
        return after[: self.state], float(np.sqrt(after[squared_residual])), tried


_ITERATIONS: WeakKeyDictionary[Program, dict[Kinds, Iteration]] = WeakKeyDictionary()


def iteration(program: Program, kinds: Kinds) -> Iteration:
    """Return the `Iteration` for a robot and kinds of terms; it is compiled when first requested."""
    of_program = _ITERATIONS.setdefault(program, {})
    if kinds not in of_program:
        of_program[kinds] = Iteration(program, kinds)
    return of_program[kinds]


def _solve(A: ca.SX, b: ca.SX) -> ca.SX:
    """Return A^-1 b for a positive definite matrix A, without branches."""
    D, LT, permutation = ca.ldl(A, False)
    return ca.ldl_solve(b, D, LT, permutation)
