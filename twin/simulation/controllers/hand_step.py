"""Compute one tick of the control law that moves a tool by a hand, by one compiled function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.evaluator import Evaluator, attach
from twin.formula.symbol import from_sx, to_sx
from twin.simulation.controllers.console_equations import Console

Law = Callable[..., Any]

_RIGID_ERROR = 1e-6
"""Largest error of the rotation matrix of a valid pose."""

_SCALE_INDEX = 96
"""Index of the scale in the input, after six poses."""


@dataclass(frozen=True)
class HandPace:
    """Maximum speed of a tool, and threshold for jumps of a hand; ASSUMED: no values are published for any console.

    Attributes:
        speed, turn: maximum speeds of the tool, in m/s and rad/s.
        jump, twist: largest hand motion in one tick, in m and rad; a larger motion is a jump: the hand is coupled anew.
    """

    speed: float = 0.5
    turn: float = 10.0
    jump: float = 0.03
    twist: float = 0.5


class HandStep:
    """Equations (2) and (1) of the console and the speed limits of the tool, for one hand and one tool.

    Attributes:
        rigid: whether the hand's pose was a rigid pose in the last call.
        jumped: whether the hand moved more than `HandPace.jump` or turned more than `HandPace.twist` in the last call.
        wanted: (4, 4) tool pose in {RB} by the equations, without speed limits.
        goal: (4, 4) tool pose in {RB} after the tick: from the previous goal towards `wanted`, within the limits.
        last: (4, 4) pose of the handle one tick earlier; the caller writes into this array.
    """

    def __init__(self, laws: Console, pace: HandPace, dt: float) -> None:
        """Compile the control law for ticks of dt in s."""
        law, slow_step = _compile(laws.laws["eq2"], laws.laws["eq1"], pace, dt)
        # The attributes below are views into the inputs and outputs of the compiled functions.
        z = np.zeros(_SCALE_INDEX + 1)
        result, self._compute = attach(law.function, z)
        self._test_values = result[:3]
        self._wanted_view = result[3:].reshape(4, 4)
        self._hand, self.last, self._goal, self._W_0, self._P_0, self._T = z[:_SCALE_INDEX].reshape(6, 4, 4)
        self._scale = z[_SCALE_INDEX:]
        pair, self._slow_step = slow_step.bind()
        self._from, self._to = pair.reshape(2, 4, 4)
        self.rigid = False
        self.jumped = False
        self.wanted = self._goal.copy()
        self.goal = self.wanted

    def couple(self, W_0: Array, P_0: Array, T: Array, scale: float) -> None:
        """Couple the hand at W_0 with the tool at P_0, for the pose T of {H} in {RB}, each (4, 4), and a scale."""
        self._W_0[...] = W_0
        self._P_0[...] = P_0
        self._T[...] = T
        self._scale[...] = scale

    def __call__(self, hand: Array, goal: Array) -> None:
        """Compute one tick; all poses are (4, 4).

        Args:
            hand: pose of the handle in {H}.
            goal: goal of the tool in {RB} one tick earlier.
        """
        self._hand[...] = hand
        self._goal[...] = goal
        self._compute()
        rigid, jumped, in_one_step = self._test_values.tolist()
        self.rigid = rigid > 0
        self.jumped = jumped > 0
        self.wanted = self._wanted_view.copy()
        if in_one_step:
            self.goal = self.wanted
        else:
            self._from[...] = goal
            self._to[...] = self.wanted
            self.goal = self._slow_step().reshape(4, 4)


@cache
def _compile(eq2: Law, eq1: Law, pace: HandPace, dt: float) -> tuple[Evaluator, Evaluator]:
    """Return two functions: the control law with the tests of its input, and a speed-limited step towards a goal.

    The second function is separate because it is slower than the first and seldom needed.
    """
    z = ca.SX.sym("z", _SCALE_INDEX + 1)
    pair = ca.SX.sym("pair", 32)
    hand, last, goal, W_0, P_0, T = (symbolic.unflat(z[16 * i : 16 * i + 16], 4, 4) for i in range(6))
    dW = eq2(from_sx(W_0), from_sx(hand), from_sx(T), from_sx(z[_SCALE_INDEX]))
    target = to_sx(eq1(dW, from_sx(P_0)))
    largest_step = pace.speed * dt
    largest_turn = pace.turn * dt
    is_near = ca.sumsqr(target[:3, 3] - goal[:3, 3]) <= largest_step**2
    in_one_step = ca.logic_and(is_near, _squared_chord(goal, target) <= _squared_chord_of(largest_turn))
    law = ca.vertcat(_is_rigid(hand), _has_jumped(last, hand, pace), in_one_step, symbolic.flat(target))
    start = symbolic.unflat(pair[:16], 4, 4)
    end = symbolic.unflat(pair[16:], 4, 4)
    slow_step = symbolic.flat(_towards(start, end, largest_step, largest_turn))
    return Evaluator("hand_step", z, law), Evaluator("towards", pair, slow_step)


def _is_rigid(T: ca.SX) -> ca.SX:
    """Return whether a pose (4, 4) is rigid; false for NaN."""
    R = T[:3, :3]
    is_orthonormal = ca.norm_inf(ca.vec(R.T @ R - ca.SX.eye(3))) < _RIGID_ERROR
    is_rotation = ca.logic_and(is_orthonormal, ca.det(R) > 0)
    is_finite = ca.sumsqr(T[:3, 3]) < np.inf  # false for NaN
    has_last_row = ca.sumsqr(T[3, :] - ca.SX([0, 0, 0, 1]).T) == 0
    return ca.logic_and(ca.logic_and(is_rotation, is_finite), has_last_row)


def _has_jumped(last: ca.SX, hand: ca.SX, pace: HandPace) -> ca.SX:
    is_far = ca.sumsqr(hand[:3, 3] - last[:3, 3]) > pace.jump**2
    return ca.logic_or(is_far, _squared_chord(last, hand) > _squared_chord_of(pace.twist))


def _squared_chord(T: ca.SX, T_other: ca.SX) -> ca.SX:
    """Return 4 (1 - cos angle) for the angle between two poses, as |R1 - R2|^2 (Frobenius): faster than by a log."""
    return ca.sumsqr(ca.vec(T_other[:3, :3] - T[:3, :3]))


def _squared_chord_of(angle: float) -> float:
    """Return 4 (1 - cos angle) for an angle in rad; it grows with the angle up to a half turn."""
    return float(4 * (1 - np.cos(min(angle, np.pi))))


def _towards(T: ca.SX, target: ca.SX, largest_step: float, largest_turn: float) -> ca.SX:
    """Return the pose after a step of at most `largest_step` in m and `largest_turn` in rad from T towards `target`."""
    step = target[:3, 3] - T[:3, 3]
    length = symbolic.norm(step)
    is_far = length > largest_step
    part = largest_step / ca.if_else(is_far, length, 1)
    p = ca.if_else(is_far, T[:3, 3] + step * part, target[:3, 3])
    is_small = _squared_chord(T, target) <= _squared_chord_of(largest_turn)
    rotation = symbolic.log_so3(target[:3, :3] @ T[:3, :3].T)
    angle = ca.if_else(is_small, 1, symbolic.norm(rotation))
    R_step = symbolic.exp_so3(rotation * (largest_turn / angle))
    R = ca.if_else(is_small, target[:3, :3], R_step @ T[:3, :3])
    return symbolic.pose(R, p)
