"""Simulate how a robot with its controller follows a planned motion, in ticks of 1 ms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.plant import Physics, Plant
from twin.simulation.machine.servo import Servo, compensation
from twin.simulation.machine.settings import Settings

_AFTER = 200
"""Number of simulated ticks after the end of the motion, while the arm comes to rest."""


@dataclass(frozen=True)
class Followed:
    """Simulated motion of a robot that follows a planned motion.

    Attributes:
        q: (k, n) joint values at every tick, in rad or m.
        error: (n,) largest difference between each joint value and its planned value, in rad or m.
        stop: reason why the controller stopped the arm; "" without a stop.
    """

    q: Array
    error: Array
    stop: str


def follow(arm: Arm, settings: Settings, q: Array, qd: Array, plant: Plant | None = None) -> Followed:
    """Simulate a robot that starts at rest and follows a planned motion, which is sampled every millisecond.

    Args:
        arm: the robot with its masses.
        settings: gains, limits of the DAC and gravity compensation of the controller, and friction of the robot's
            joints.
        q: (k, n) planned joint values.
        qd: (k, n) planned rates.
        plant: a compiled plant of the robot; None: a new one, with the friction of the settings.
    """
    mechanism = arm.mechanism
    if plant is None:
        plant = Plant(arm, Physics.of(arm, settings.coulomb(mechanism)))
    servo = Servo(settings, mechanism, Arithmetic.of(settings, mechanism), "advanced", "soft")
    gravity = compensation(settings, mechanism)
    plant.reset(q[0])
    rest = ((q[-1], np.zeros(q.shape[1])) for _ in range(_AFTER))
    out = []
    for wanted, rate in (*zip(q, qd, strict=True), *rest):
        error, change = mechanism.motors(wanted - plant.q), mechanism.motors(rate - plant.qd)
        counts = servo.counts_of(error, change, gravity(plant.q))
        plant.advance(servo.torques(counts))
        out.append(plant.q.copy())
        if servo.stop:
            break
    was = np.array(out)
    planned = np.concatenate([q, np.repeat(q[-1:], _AFTER, axis=0)])[: len(was)]
    return Followed(was, np.abs(was - planned).max(axis=0), servo.stop)
