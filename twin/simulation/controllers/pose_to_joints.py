"""Compute joint values for a commanded tool pose, tick by tick, within joint and speed limits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula.evaluator import attach
from twin.kinematics import Kinematics
from twin.kinematics.compiled import POSE_TOL
from twin.simulation.controllers.jacobian_step import step
from twin.simulation.limits import JointLimits
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_COMMAND, ROBOT_ENCODER, ROBOT_GOAL, ROBOT_JAW

_LARGEST_STEP = 0.05
"""Largest joint step in rad or m per tick for which the closed-form inverse is used.

A larger step may belong to another working mode.
"""


class PoseToJoints(Block):
    """Reads `<robot>.goal` (16,), the tool pose in base, and `<robot>.encoder`; writes `<robot>.command` (n,).

    The closed-form inverse is used if its result is within the limits and near the current joint values. Otherwise, a
    Jacobian step is made as far as the limits allow. A joint that does not move the tool follows `<robot>.jaw` in rad;
    without this signal, the joint is at rest.
    """

    def __init__(self, robot: str, kin: Kinematics, q: Array, limits: JointLimits) -> None:
        """Start at joint values q (n,)."""
        self.robot = robot
        self.kin = kin
        self.limits = limits
        self._T_base_tool = kin.forward(q)
        self._command = ROBOT_COMMAND.of(robot)
        self._auxiliary = np.flatnonzero(kin.auxiliary)
        self._near_inverse = None
        if kin.closed_inverse:
            self._near_inverse = _near_inverse(kin, limits)
        self.outputs = {self._command: q}

    def attach(self, signals: Signals, memory: Mapping[str, Array]) -> None:
        """Compile the step, which reads its signals directly from their memory."""
        self._output = memory[self._command]
        self._goal = signals.now[ROBOT_GOAL.of(self.robot)]
        self._encoder = signals.now[ROBOT_ENCODER.of(self.robot)]
        self._has_no_jaw_signal = ROBOT_JAW.of(self.robot) not in signals
        if self._has_no_jaw_signal:
            self._jaw = np.zeros(len(self._auxiliary))
        else:
            self._jaw = signals.now[ROBOT_JAW.of(self.robot)]
        self._tick = np.zeros(1)  # duration of a tick in s
        self._last_inputs = (b"", b"", b"")
        self._inverse = None
        if self._near_inverse:
            self._inverse_q, self._inverse = attach(
                self._near_inverse, self._tick, self._goal, self._encoder, self._jaw
            )

    def step(self, signals: Signals, t: float, dt: float) -> None:
        """Make one step towards the goal."""
        goal = self._goal
        q = self._encoder
        auxiliary = self._jaw
        if self._has_no_jaw_signal:
            auxiliary[...] = q[self._auxiliary]
        inputs = goal.tobytes(), q.tobytes(), auxiliary.tobytes()
        if inputs == self._last_inputs and self._inverse:
            return  # unchanged input: the command is unchanged
        self._last_inputs = inputs
        self._tick[0] = dt
        if self._inverse:
            self._inverse()
            if not math.isnan(self._inverse_q[0]):
                self._output[...] = self._inverse_q
                return
        if not self.kin.closed_forward:
            self._T_base_tool = self.kin.forward(q, self._T_base_tool)
        command = step(self.kin, q, goal.reshape(4, 4), dt, self.limits, seed=self._T_base_tool).q
        command[self._auxiliary] = auxiliary  # the inverse leaves these joints at rest
        self._output[...] = command


def _near_inverse(kin: Kinematics, limits: JointLimits) -> ca.Function:
    """Return the function that computes the next q (n) by the closed-form inverse.

    Its arguments are dt in s, the goal pose (16), q (n), and the next coordinates of the auxiliary joints. Of angles
    that differ by full turns, the nearest to q is used. All results are NaN in these cases: the pose is not rigid, the
    pose is out of reach, or a joint that moves the tool would exceed a limit or the step `_LARGEST_STEP`.
    """
    n = len(kin.joints)
    auxiliary = np.flatnonzero(kin.auxiliary).tolist()
    dt = ca.SX.sym("dt", 1)
    goal = ca.SX.sym("goal", 16)
    q = ca.SX.sym("q", n)
    auxiliary_values = ca.SX.sym("rest", len(auxiliary))
    inverse = kin.program.inverse.function(goal)
    next_q = inverse[:n]
    pose_error = inverse[n]
    turns_per_rad = ca.DM(np.where(kin.revolute, 1 / (2 * np.pi), 0.0))
    full_turns = ca.floor((next_q - q) * turns_per_rad + 0.5)
    next_q -= 2 * np.pi * full_turns
    next_q = ca.if_else(ca.DM(kin.auxiliary.astype(float)), q, next_q)
    lower, upper = limits.steps_of(q, dt)
    step = next_q - q
    # Comparisons with NaN (no inverse) are false.
    is_above_lower = step >= ca.fmax(lower, -_LARGEST_STEP)
    is_below_upper = step <= ca.fmin(upper, _LARGEST_STEP)
    is_valid = ca.logic_and(ca.mmin(ca.vertcat(is_above_lower, is_below_upper)), pose_error <= POSE_TOL)
    next_q[auxiliary] = auxiliary_values
    result = ca.densify(ca.if_else(is_valid, next_q, np.nan))
    return ca.Function("near_inverse", [dt, goal, q, auxiliary_values], [result])
