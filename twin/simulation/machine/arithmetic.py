"""Compiled arithmetic of one tick of the control software, for n motors and joints.

    low-pass    v' = v + c ((x - x_before) / h - v); c: fraction of a difference corrected in one tick, h: the tick
    sense       m = counts times angle of a count; w' = low-pass of m
    aim         r' = low-pass of q_desired; errors of joint values and rates: q_desired - q and r' - qd
    drive       s' = s + h e; counts = ((kp e + ki s' + kd de) + T^T efforts) times counts per N m, rounded towards 0

Here m are the motor values; v, w and r are the filtered rates of x, m and q_desired; e and de are the errors of motor
value and motor rate, and s is the integral of e. T is the matrix of the transmission (q = T m). Each operation is
rounded separately, as in numpy: the results are exactly those of numpy, in a fifth of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.settings import Settings


@dataclass(frozen=True)
class Arithmetic:
    """Compiled functions of one tick, for one robot and one set of gains.

    Attributes:
        share: fraction of a difference that the low-pass filter corrects in one tick.
        angle: motor value in rad or m per encoder count, as the software computes it.
        counts_per_effort: (n,) counts of the DAC for an effort of 1 N m or 1 N of each motor.
        sense: function (counts, m, w) -> (2 n,): m, w'.
        aim: function (q_desired, q_desired before, r, q, qd) -> (3 n,): r', errors of joint values and of rates.
        drive: function (e, de, joint efforts, s) -> (2 n,): s', counts of the DAC before the software's checks.
    """

    share: float
    angle: float
    counts_per_effort: Array
    sense: Callable[..., Array]
    aim: Callable[..., Array]
    drive: Callable[..., Array]

    @classmethod
    def of(cls, settings: Settings, mechanism: Mechanism) -> Arithmetic:
        """Compile the functions, or load them from the cache."""
        share = float(1 - np.exp(-2 * np.pi * settings.number.velocity_cutoff.value * TICK))
        counts_per_rad = settings.number.counts_per_turn.value / (2 * np.pi)
        if settings.released.whole_counts:
            counts_per_rad = int(counts_per_rad)
        angle = 1 / counts_per_rad
        motors = settings.of_motors(mechanism)
        n = len(motors)
        counts_per_effort = np.zeros(n)
        gains = np.zeros((3, n))
        for i, motor in enumerate(motors):
            counts_per_effort[i] = motor.counts_per_amp / motor.torque_per_amp
            gains[:, i] = motor.kp / motor.gear, motor.ki / motor.gear, motor.kd / motor.gear
        sense = _sense(n, angle, share)
        aim = _aim(n, share)
        drive = _drive(mechanism.motor_matrix, gains, counts_per_effort)
        return cls(share, angle, counts_per_effort, sense, aim, drive)


def _sense(n: int, angle: float, share: float) -> Callable[..., Array]:
    """Return `Arithmetic.sense`, compiled."""
    counts, before, w = _symbols(n, "counts before w")
    m = counts * angle
    return _compiled([counts, before, w], [m, _low_pass(m, before, w, share)])


def _aim(n: int, share: float) -> Callable[..., Array]:
    """Return `Arithmetic.aim`, compiled."""
    desired, before, r, q, qd = _symbols(n, "wanted before r q qd")
    rate = _low_pass(desired, before, r, share)
    return _compiled([desired, before, r, q, qd], [rate, desired - q, rate - qd])


def _drive(T: Array, gains: Array, counts_per_effort: Array) -> Callable[..., Array]:
    """Return `Arithmetic.drive`, compiled; `gains` (3, n): kp, ki, kd at the motors."""
    e, de, efforts, s = _symbols(len(T), "e de efforts s")
    kp, ki, kd = map(ca.DM, gains)
    integral = s + e * TICK
    torques = kp * e + ki * integral + kd * de + ca.DM(T).T @ efforts
    command = torques * ca.DM(counts_per_effort)
    # The DAC takes whole numbers; the conversion of C rounds towards 0.
    counts_of_dac = ca.if_else(command < 0, ca.ceil(command), ca.floor(command))
    return _compiled([e, de, efforts, s], [integral, counts_of_dac])


def _low_pass(x: ca.SX, before: ca.SX, v: ca.SX, share: float) -> ca.SX:
    """Return the filtered rate after a tick, from the values x and x before it, and the filtered rate v before it."""
    return v + share * ((x - before) / TICK - v)


def _symbols(n: int, names: str) -> list[ca.SX]:
    return [ca.SX.sym(name, n) for name in names.split()]


def _compiled(arguments: list[ca.SX], results: list[ca.SX]) -> Callable[..., Array]:
    """Return the compiled function of the arguments, whose result has all results in one vector."""
    output = ca.densify(ca.vertcat(*results))
    function = ca.Function("arithmetic", arguments, [output])
    sizes = {f"in{i}": x.numel() for i, x in enumerate(arguments)}
    stage = Stage(function, tuple(sizes), ("out",))
    # exact: each operation is rounded separately, without fused multiply-add.
    return Kernel([stage], sizes, ["out"], single=True, exact=True).single()
