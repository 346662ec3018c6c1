"""Symbolic rates of the passive joints in closed loops, from those of the active joints, for compilation.

The derivative of the closing conditions r(q, s) = 0 along a motion is A_q qd + A_s v = 0; v are the rates of the
passive joints, for a ball joint its angular velocity. Another derivative gives the accelerations of the passive joints,
A_s a = -A_q qdd - c, with c the derivative of A_q qd + A_s v while qd and v are constant. Each block of `LoopSolver` is
solved after those before it.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from twin.core.errors import MechanismError
from twin.kinematics.closed_loops.equations import STEPS
from twin.kinematics.closed_loops.solver import LoopSolver, block_solution

_KINDS = ("revolute", "prismatic", "spherical")
"""Types of the passive joints that the recursion along the tree knows."""


class LoopRates:
    """Rates of the passive joints of a mechanism with loops.

    Attributes:
        states: symbols (m,) of the states of the passive joints, as in `ClosedStates.states`.
        passive: for each passive joint of the tree, its name, the symbols of its state, and its rows in `rates`.
        gain: (k, n) rates of the passive joints per rate of each active joint.
        rates: (k,) rates of the passive joints in rad/s or m/s.
        drift: (k,) accelerations of the passive joints while the active joints do not accelerate.
    """

    def __init__(self, solver: LoopSolver, q: ca.SX, qd: ca.SX) -> None:
        """Derive the rates at active joints q (n,) and rates qd (n,), which are symbols.

        Raises:
            MechanismError: a passive joint has an unknown type, or no loop determines it.
        """
        equations = solver.equations
        self._solver = solver
        self.states = equations.states
        self.passive: list[tuple[str, Any, slice]] = []
        start = 0
        for passive in equations.passive:
            kind = passive.joint.type
            if kind not in _KINDS:
                raise MechanismError(
                    f"the passive joint {passive.name} is {kind}: the equations of motion know {', '.join(_KINDS)}"
                )
            end = start + STEPS[kind]
            self.passive.append((passive.name, passive.state, slice(start, end)))
            start = end
        self._count = start
        A_q = ca.substitute(ca.jacobian(equations.residual, equations.q), equations.q, q)
        self._A_s = ca.substitute(equations.jacobian, equations.q, q)
        columns = []
        for i in range(q.numel()):
            columns.append(self._solved(A_q[:, i]))
        self.gain = ca.horzcat(*columns)
        self.rates = self.gain @ qd
        # c: the derivative of A_q qd + A_s v along the motion, with v as symbols, which do not change
        v = ca.SX.sym("v", self._count)
        changes = []
        for (_, _, rows), passive in zip(self.passive, equations.passive, strict=True):
            stepped = passive.stepped(passive.step)
            per_step = ca.substitute(ca.jacobian(stepped, passive.step), passive.step, 0)
            changes.append(per_step @ v[rows])
        along = ca.vertcat(qd, *changes)
        c = ca.jtimes(A_q @ qd + self._A_s @ v, ca.vertcat(q, equations.states), along)
        self.drift = self._solved(ca.substitute(c, v, self.rates))

    def _solved(self, b: ca.SX) -> ca.SX:
        """Return x (k,) with A_s x = -b."""
        x: dict[int, ca.SX] = {}
        for block, sample in zip(self._solver.blocks, self._solver.samples, strict=True):
            rows = list(block.rows)
            right_side = b[rows]
            for column, value in x.items():
                right_side = right_side + self._A_s[rows, column] * value
            part = block_solution(self._A_s, block, sample, -right_side)
            x.update(zip(block.columns, ca.vertsplit(part), strict=True))
        for name, _, rows in self.passive:
            if not all(column in x for column in range(rows.start, rows.stop)):
                raise MechanismError(
                    f"no loop determines the passive joint {name}, which moves a mass: drive it, or make it fixed"
                )
        return ca.vertcat(*[x[column] for column in range(self._count)])
