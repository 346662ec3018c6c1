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
from twin.simulation.machine.plant import TICK
from twin.simulation.machine.settings import Settings


@dataclass(frozen=True)
class Arithmetic:
    """Compiled functions of one tick, for one robot and one set of gains.

    Attributes:
        share: fraction of a difference that the low-pass filter corrects in one tick.
        angle: motor value in rad or m per encoder count, as the software computes it.
        counts: (n,) counts of the DAC for an effort of 1 N m or 1 N of each motor.
        sense: function (counts, m, w) -> (2 n,): m, w'.
        aim: function (q_desired, q_desired before, r, q, qd) -> (3 n,): r', errors of joint values and of rates.
        drive: function (e, de, joint efforts, s) -> (2 n,): s', counts of the DAC before the software's checks.
    """

    share: float
    angle: float
    counts: Array
    sense: Callable[..., Array]
    aim: Callable[..., Array]
    drive: Callable[..., Array]

    @classmethod
    def of(cls, settings: Settings, mechanism: Mechanism) -> Arithmetic:
        """Compile the functions, or load them from the cache."""
        share = float(1 - np.exp(-2 * np.pi * settings.number.velocity_cutoff.value * TICK))
        turn = settings.number.counts_per_turn.value / (2 * np.pi)  # counts per rad
        angle = 1 / (int(turn) if settings.released.whole_counts else turn)
        motors, T = settings.of_motors(mechanism), mechanism.motor_matrix
        counts = np.array([m.counts_per_amp / m.torque_per_amp for m in motors])
        gains = np.array([[m.kp / m.gear, m.ki / m.gear, m.kd / m.gear] for m in motors]).T
        n = len(T)
        return cls(share, angle, counts, _sense(n, angle, share), _aim(n, share), _drive(T, gains, counts))


def _sense(n: int, angle: float, share: float) -> Callable[..., Array]:
    counts, before, w = _symbols(n, "counts before w")
    m = counts * angle
    return _compiled([counts, before, w], [m, _low_pass(m, before, w, share)])


def _aim(n: int, share: float) -> Callable[..., Array]:
    wanted, before, r, q, qd = _symbols(n, "wanted before r q qd")
    new = _low_pass(wanted, before, r, share)
    return _compiled([wanted, before, r, q, qd], [new, wanted - q, new - qd])


def _drive(T: Array, gains: Array, counts: Array) -> Callable[..., Array]:
    e, de, efforts, s = _symbols(len(T), "e de efforts s")
    kp, ki, kd = map(ca.DM, gains)
    new = s + e * TICK
    asked = (kp * e + ki * new + kd * de + ca.DM(T).T @ efforts) * ca.DM(counts)
    return _compiled([e, de, efforts, s], [new, ca.if_else(asked < 0, ca.ceil(asked), ca.floor(asked))])


def _low_pass(x: ca.SX, before: ca.SX, v: ca.SX, share: float) -> ca.SX:
    return v + share * ((x - before) / TICK - v)


def _symbols(n: int, names: str) -> list[ca.SX]:
    return [ca.SX.sym(name, n) for name in names.split()]


def _compiled(given: list[ca.SX], results: list[ca.SX]) -> Callable[..., Array]:
    function = ca.Function("arithmetic", given, [ca.densify(ca.vertcat(*results))])
    sizes = {f"in{i}": x.numel() for i, x in enumerate(given)}
    return Kernel([Stage(function, tuple(sizes), ("out",))], sizes, ["out"], single=True, exact=True).single()
