"""Loop unknowns of a mechanism whose active joints and tool pose are both given.

Joint values can belong to several tool poses: Newton's method from the rest poses may close the loops at another one,
although the determinants of the blocks have the signs of the rest poses there, too. With the tool held at the pose, the
limbs do not depend on each other, and the rest poses are far less often too far away for a start.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core.spatial import Array
from twin.kinematics.closed_loops import linear
from twin.kinematics.closed_loops.equations import LENGTH_SCALE, LoopEquations, stepped
from twin.kinematics.closed_loops.solver import LoopSolver

_LAST = 1e-5
"""Step size (m, rad) below which the iteration ends; the result is a start for Newton's method, which is exact."""

_STRIDE = 0.6
"""Maximum change (m, rad) of an unknown in one step."""

_STEPS = 30
"""Maximum number of steps."""


class HeldTool:
    """The least-squares solution of the loop equations and the tool pose, by Gauss-Newton steps from the rest poses."""

    def __init__(self, solver: LoopSolver) -> None:
        """Store the loop solver of a mechanism; the expressions are compiled when first used."""
        self._solver = solver

    def states(self, q: Array, Ts: Array) -> Array:
        """Return loop unknowns (k, m) near those at active joints q (k, n) and tool poses Ts (k, 4, 4).

        They close the loops only approximately, and may be in another assembly mode: they are seeds of
        `LoopSolver.forward_many`, which checks its results.
        """
        tool = Ts[:, :3].reshape(-1, 12)
        (states,) = self._kernel(np.ascontiguousarray(q.T), np.ascontiguousarray(tool.T))
        return np.ascontiguousarray(states.T)

    @cached_property
    def _kernel(self) -> Kernel:
        e = self._solver.equations
        keys = tuple(passive.key for passive in e.passive)
        home = [ca.SX(state) for state in self._solver.home]
        start = Stage(ca.Function("home", [], home), (), keys)
        states = [passive.state for passive in e.passive]
        end = Stage(ca.Function("held", states, [ca.densify(e.states)]), keys, ("states",))
        return Kernel([start, _step(e), end], {"q": e.q.numel(), "tool": 12}, ["states"])


def _step(e: LoopEquations) -> Stage:
    """Return the stage of Gauss-Newton steps; "tool" (12,) holds the first three rows of T_base_tool, row by row."""
    rows = ca.SX.sym("tool", 12)
    T_goal = ca.reshape(rows, 4, 3).T  # CasADi stacks columns
    frame = e.mechanism.frame(e.mechanism.tool)
    T_stepping = e.pose(frame.body, frame.T_body_frame, stepping=True)
    residual = ca.vertcat(e.residual, _misfit(e.T_base_tool, T_goal))
    derivative = ca.jacobian(_misfit(T_stepping, T_goal), e.steps)
    J = ca.vertcat(e.jacobian, ca.substitute(derivative, e.steps, 0))
    pattern = np.array(ca.DM(J.sparsity(), 1).full(), bool)
    step = linear.least_squares(J, -residual, pattern)
    size = linear.largest(step)
    states = stepped(e.passive, step * ca.fmin(1, _STRIDE / size))

    results = {**states, "error": size}
    outputs = [ca.densify(result) for result in results.values()]
    arguments = [e.q, rows, *(passive.state for passive in e.passive)]
    function = ca.Function("held", arguments, outputs, {"cse": True})
    return Stage(function, ("q", "tool", *states), tuple(results), _STEPS, _LAST)


def _misfit(T: ca.SX, T_goal: ca.SX) -> ca.SX:
    """Return the difference (12,) of two poses in m, that of rotations times `LENGTH_SCALE`."""
    shift = T[:3, 3] - T_goal[:3, 3]
    turn = ca.vec(T[:3, :3] - T_goal[:3, :3])
    return ca.vertcat(shift, LENGTH_SCALE * turn)
