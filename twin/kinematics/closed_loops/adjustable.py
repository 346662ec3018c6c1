"""The stages of a loop solver with distances of joints as further inputs: a design is changed without compilation.

A distance moves the frame of a joint on one body along a line, as `twin.model.joint_distance.with_distance` does.
Blocks of equations and pivots are those of the mechanism as drawn. A distance that opens a planar loop shows as a gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from twin.codegen import Stage
from twin.kinematics.closed_loops.equations import LoopEquations
from twin.kinematics.closed_loops.passive_limits import PassiveLimit, passive_limits, slacks
from twin.kinematics.closed_loops.solver import LoopSolver, end_stage, links_stage, newton_stage
from twin.model.joint_distance import Distance, line_of
from twin.model.mechanism import Mechanism

DISTANCES = "distances"
"""Name of the argument with the distances in m."""

_ZERO_COMPONENT = 1e-15
"""Component of a unit vector below which it is rounded to zero, so that fewer terms remain."""


class AdjustableLoops:
    """Stages of a loop solver whose distances of joints are inputs.

    Attributes:
        solver: the loop solver of the mechanism as drawn.
        distances: the distances, in the order of the argument `DISTANCES`.
        equations: the equations with these distances.
        newton: stages that solve the blocks, in order.
        end: stage that computes tool pose, gaps and states; see `LoopSolver.stages`.
        links: stage that computes the poses of all bodies, from "q", the states of the passive joints, and `DISTANCES`.
        limits, slacks: limits of passive joints, and the stage that computes their slacks in m or rad.
    """

    def __init__(self, solver: LoopSolver, distances: Sequence[Distance]) -> None:
        mechanism = solver.mechanism
        self.solver = solver
        self.distances = tuple(distances)
        values = ca.SX.sym(DISTANCES, len(self.distances))
        equations = LoopEquations(mechanism, errors=_frame_shifts(mechanism, self.distances, values))
        self.equations = equations

        arguments = {"q": equations.q}
        for passive in equations.passive:
            arguments[passive.key] = passive.state
        arguments[DISTANCES] = values
        self.newton: list[Stage] = []
        for number, (block, sample) in enumerate(zip(solver.blocks, solver.samples, strict=True)):
            self.newton.append(newton_stage(equations, number, block, sample, arguments))
        self.end = end_stage(equations, solver.signs, arguments)
        self.links = links_stage(equations, arguments)
        self.limits: tuple[PassiveLimit, ...] = passive_limits(mechanism)
        slack_column = ca.densify(slacks(equations, self.limits))
        function = ca.Function("slacks", list(arguments.values()), [slack_column], {"cse": True})
        self.slacks = Stage(function, tuple(arguments), ("slacks",))


def _frame_shifts(mechanism: Mechanism, distances: Sequence[Distance], values: ca.SX) -> dict[tuple[str, str], ca.SX]:
    """Return the errors of joint frames, as in `LoopEquations.errors`, by changed distances of values (k,) in m."""
    shifts: dict[tuple[str, str], ca.SX] = {}
    for index, distance in enumerate(distances):
        joint = mechanism.joint(distance.joint)
        side = "child"
        T_body_joint = joint.T_child_joint
        if joint.parent == distance.body:
            side = "parent"
            T_body_joint = joint.T_parent_joint
        direction = T_body_joint[:3, :3].T @ line_of(mechanism, distance)
        direction = np.where(np.abs(direction) < _ZERO_COMPONENT, 0.0, direction)
        shift = ca.SX(direction) * (values[index] - distance.distance)
        change = ca.vertcat(shift, ca.SX.zeros(3))
        before = shifts.get((joint.name, side))
        shifts[joint.name, side] = change if before is None else before + change
    return shifts
