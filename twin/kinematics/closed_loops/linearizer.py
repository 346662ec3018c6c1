"""Evaluate a closed mechanism: the position of a point of a body, the tool pose, and the Jacobians of both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core.spatial import Array
from twin.kinematics.closed_loops.equations import LENGTH_SCALE
from twin.kinematics.closed_loops.passive_limits import passive_limits, slacks
from twin.kinematics.closed_loops.solver import LoopSolver

_RANK_RATIO = 1e-9
"""Singular values below this fraction of the largest one count as zero."""


@dataclass(frozen=True, eq=False)
class LinearizedState:
    """Point, tool and Jacobians in one state with closed loops.

    Attributes:
        q, u: active joints (n,); loop unknowns (m,) in the order of `ClosedStates.states`.
        p: position (3,) of the point in base, in m.
        J: (3, n) velocity of the point per rate of each active joint.
        unknown_rates: (steps, n) rates of the loop unknowns per rate of each active joint. A row is one coordinate of a
            step of the unknowns, see `LoopEquations`.
        loops: Jacobian of each loop with respect to its unknowns; with full rank, the loop determines these unknowns.
        tool: (6, n) tool twist per rate of each active joint, rotations times `LENGTH_SCALE`.
        slacks: (c,) slacks of the limits of passive joints, see `passive_limits`.
        slack_rates: (c, n) change of each slack per change of each active joint.
    """

    q: Array
    u: Array
    p: Array
    J: Array
    unknown_rates: Array
    loops: tuple[Array, ...]
    tool: Array
    slacks: Array
    slack_rates: Array


class Linearizer:
    """Function object that computes a `LinearizedState`; loops and tool are compiled once, each body when first used.

    Attributes:
        limits: the limits of passive joints, in the order of `LinearizedState.slacks`.
    """

    def __init__(self, solver: LoopSolver) -> None:
        """Compile the functions of the loops and the tool."""
        equations = solver.equations
        self._equations = equations
        rows: list[int] = []
        columns: list[int] = []
        self._block_slices: list[tuple[slice, slice]] = []
        for block in solver.blocks:
            block_rows = slice(len(rows), len(rows) + len(block.rows))
            block_columns = slice(len(columns), len(columns) + len(block.columns))
            self._block_slices.append((block_rows, block_columns))
            rows += block.rows
            columns += block.columns
        self._columns = np.array(columns, int)
        self._square = all(block.is_square for block in solver.blocks)
        self._active_count = equations.q.numel()
        self._step_count = equations.steps.numel()
        self._loop_rows = len(rows)
        self.limits = passive_limits(equations.mechanism)

        # The rates of q and of all unknowns together; the loops then relate the second to the first.
        z = ca.vertcat(equations.q, equations.steps)
        tool = equations.mechanism.frame(equations.mechanism.tool)
        T = equations.pose(tool.body, tool.T_body_frame, stepping=True)
        turn = ca.SX(3, z.numel())
        for i in range(3):
            axis = T[:3, i]
            turn = turn + ca.skew(axis) @ ca.jacobian(axis, z) / 2  # w = (x × dx + y × dy + z × dz) / 2
        velocity = ca.jacobian(T[:3, 3], z)
        twist = ca.substitute(ca.vertcat(velocity, LENGTH_SCALE * turn), equations.steps, 0)
        loops = ca.SX(0, z.numel())
        if rows:
            loops = ca.horzcat(ca.jacobian(equations.residual, equations.q), equations.jacobian)[rows, :]
        slack = slacks(equations, self.limits, stepping=True)
        slack_rows = ca.substitute(ca.horzcat(slack, ca.jacobian(slack, z)), equations.steps, 0)
        # The first column has the values of the slacks; twist and loops have none.
        no_values = ca.SX(6 + len(rows), 1)
        twist_and_loops = ca.horzcat(no_values, ca.vertcat(twist, loops))
        self._common = self._compiled("loops", ca.vertcat(twist_and_loops, slack_rows))
        self._bodies: dict[str, Callable[..., Array]] = {}

    def __call__(self, q: Array, u: Array, body: str, p_body: Array) -> LinearizedState:
        """Return the `LinearizedState` at q (n,) and loop unknowns u (m,), for a point (3,) in the body frame in m."""
        active_count = self._active_count
        loop_rows = self._loop_rows
        if body not in self._bodies:
            self._bodies[body] = self._point(body)
        values = self._common(q, u).reshape(6 + loop_rows + len(self.limits), -1)
        point = self._bodies[body](q, u, p_body).reshape(3, -1)
        loops = values[6 : 6 + loop_rows, 1:]
        loops_of_unknowns = loops[:, active_count + self._columns]
        answers = np.zeros((self._step_count, active_count))
        if loop_rows:
            answers[self._columns] = -_smallest_solution(loops_of_unknowns, loops[:, :active_count], self._square)
        limits = values[6 + loop_rows :]
        return LinearizedState(
            q=q,
            u=u,
            p=point[:, 0],
            J=_per_active_rate(point[:, 1:], answers),
            unknown_rates=answers,
            loops=tuple(loops_of_unknowns[part] for part in self._block_slices),
            tool=_per_active_rate(values[:6, 1:], answers),
            slacks=limits[:, 0],
            slack_rates=_per_active_rate(limits[:, 1:], answers),
        )

    def _point(self, body: str) -> Callable[..., Array]:
        """Return the compiled function of q, u and a point (3,) of a body: its position, and the Jacobian."""
        e = self._equations
        p_body = ca.SX.sym("p", 3)
        p_base = (e.pose(body, stepping=True) @ ca.vertcat(p_body, 1))[:3]
        J = ca.jacobian(p_base, ca.vertcat(e.q, e.steps))
        rows = ca.substitute(ca.horzcat(p_base, J), e.steps, 0)
        return self._compiled("point", rows, p=p_body)

    def _compiled(self, name: str, rows: ca.SX, **further_inputs: ca.SX) -> Callable[..., Array]:
        """Return a compiled function of q, u and further inputs; its outputs are stacked in one matrix."""
        e = self._equations
        symbols = {"q": e.q, "u": e.states, **further_inputs}
        inputs = {}
        for key, symbol in symbols.items():
            inputs[key] = symbol.numel()
        stacked = ca.densify(ca.vec(rows.T))
        function = ca.Function(name, list(symbols.values()), [stacked], {"cse": True})
        stage = Stage(function, tuple(inputs), ("seen",))
        return Kernel([stage], inputs, ["seen"], single=True).single()


def _smallest_solution(matrix: Array, right_side: Array, square: bool) -> Array:
    """Return X with A X = B; for a singular A or one that is not square, the smallest X in the least-squares sense."""
    if square:
        try:
            return np.asarray(np.linalg.solve(matrix, right_side), float)
        except np.linalg.LinAlgError:  # exactly singular: the smallest solution, as for other matrices
            pass
    return np.asarray(np.linalg.pinv(matrix, rcond=_RANK_RATIO) @ right_side, float)


def _per_active_rate(J: Array, answers: Array) -> Array:
    """Return a Jacobian per rate of q (r, n) from that per rates of q and of the unknowns (r, n + steps)."""
    n = answers.shape[1]
    return J[:, :n] + J[:, n:] @ answers
