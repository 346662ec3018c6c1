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

_FLAT = 1e-9
"""Singular values below this fraction of the largest one count as zero."""


@dataclass(frozen=True, eq=False)
class Look:
    """Point, tool and Jacobians in one state with closed loops.

    Attributes:
        q, u: active joints (n,); loop unknowns (m,) in the order of `Closed.states`.
        p: position (3,) of the point in base, in m.
        J: (3, n) velocity of the point per rate of each active joint.
        answers: (steps, n) rates of the loop unknowns per rate of each active joint. A row is one coordinate of a step
            of the unknowns, see `Equations`.
        loops: Jacobian of each loop with respect to its unknowns; with full rank, the loop determines these unknowns.
        tool: (6, n) tool twist per rate of each active joint, rotations times `LENGTH_SCALE`.
        slacks: (c,) slacks of the limits of passive joints, see `passive_limits`.
        slopes: (c, n) change of each slack per change of each active joint.
    """

    q: Array
    u: Array
    p: Array
    J: Array
    answers: Array
    loops: tuple[Array, ...]
    tool: Array
    slacks: Array
    slopes: Array


class Sight:
    """Function object that computes a `Look`; loops and tool are compiled once, each body when first used.

    Attributes:
        limits: the limits of passive joints, in the order of `Look.slacks`.
    """

    def __init__(self, solver: LoopSolver) -> None:
        """Compile the functions of the loops and the tool."""
        e = self._equations = solver.equations
        rows = [r for b in solver.blocks for r in b.rows]
        self._columns = np.array([c for b in solver.blocks for c in b.columns], int)
        self._square = all(b.square for b in solver.blocks)
        self._parts, i, j = [], 0, 0
        for b in solver.blocks:
            self._parts.append((slice(i, i + len(b.rows)), slice(j, j + len(b.columns))))
            i, j = i + len(b.rows), j + len(b.columns)
        self._n, self._k, self._m = e.q.numel(), e.steps.numel(), len(rows)
        self.limits = passive_limits(e.mechanism)
        tool = e.mechanism.frame(e.mechanism.tool)
        T, z = e.pose(tool.body, tool.T_body_frame, stepping=True), ca.vertcat(e.q, e.steps)
        turn = sum((ca.skew(T[:3, i]) @ ca.jacobian(T[:3, i], z) / 2 for i in range(3)), ca.SX(3, z.numel()))
        twist = ca.substitute(ca.vertcat(ca.jacobian(T[:3, 3], z), LENGTH_SCALE * turn), e.steps, 0)
        A = ca.horzcat(ca.jacobian(e.residual, e.q), e.jacobian)[rows, :] if rows else ca.SX(0, z.numel())
        left = slacks(e, self.limits, stepping=True)
        held = ca.substitute(ca.horzcat(left, ca.jacobian(left, z)), e.steps, 0)
        moved = ca.horzcat(ca.SX(6 + len(rows), 1), ca.vertcat(twist, A))
        self._common = self._compiled("loops", ca.vertcat(moved, held))
        self._bodies: dict[str, Callable[..., Array]] = {}

    def __call__(self, q: Array, u: Array, body: str, p_body: Array) -> Look:
        """Return the `Look` at q (n,) and loop unknowns u (m,), for a point (3,) in the body frame in m."""
        n = self._n
        if body not in self._bodies:
            self._bodies[body] = self._point(body)
        seen = self._common(q, u).reshape(6 + self._m + len(self.limits), -1)
        tool, A, limits = seen[:6, 1:], seen[6 : 6 + self._m, 1:], seen[6 + self._m :]
        point = self._bodies[body](q, u, p_body).reshape(3, -1)
        held = A[:, n + self._columns]
        answers = np.zeros((self._k, n))
        if self._m:
            answers[self._columns] = -_solved(held, A[:, :n], self._square)
        loops = tuple(held[part] for part in self._parts)
        J, left = point[:, 1:], limits[:, 1:]
        return Look(
            q,
            u,
            point[:, 0],
            J[:, :n] + J[:, n:] @ answers,
            answers,
            loops,
            tool[:, :n] + tool[:, n:] @ answers,
            limits[:, 0],
            left[:, :n] + left[:, n:] @ answers,
        )

    def _point(self, body: str) -> Callable[..., Array]:
        e, p_body = self._equations, ca.SX.sym("p", 3)
        point = (e.pose(body, stepping=True) @ ca.vertcat(p_body, 1))[:3]
        J = ca.jacobian(point, ca.vertcat(e.q, e.steps))
        return self._compiled("point", ca.substitute(ca.horzcat(point, J), e.steps, 0), p=p_body)

    def _compiled(self, name: str, rows: ca.SX, **more: ca.SX) -> Callable[..., Array]:
        """Return a compiled function of q, u and further inputs; its outputs are stacked in one matrix."""
        e = self._equations
        look = ca.Function(name, [e.q, e.states, *more.values()], [ca.densify(ca.vec(rows.T))], {"cse": True})
        inputs = {"q": e.q.numel(), "u": e.states.numel(), **{n: x.numel() for n, x in more.items()}}
        return Kernel([Stage(look, tuple(inputs), ("seen",))], inputs, ["seen"], single=True).single()


def _solved(A: Array, B: Array, square: bool) -> Array:
    if square:
        try:
            return np.asarray(np.linalg.solve(A, B), float)
        except np.linalg.LinAlgError:
            pass
    return np.asarray(np.linalg.pinv(A, rcond=_FLAT) @ B, float)
