"""Simulate how a robot with its controller follows a planned motion, in ticks of 1 ms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.gravity_compensation import compensation
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import Physics
from twin.simulation.machine.servo import Servo
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


def follow(arm: Arm, settings: Settings, q: Array, qd: Array, plant: MotorPlant | None = None) -> Followed:
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
        plant = MotorPlant(arm, Physics.of(arm, settings.coulomb(mechanism)))
    servo = Servo(settings, mechanism, Arithmetic.of(settings, mechanism), "advanced", "soft")
    gravity = compensation(settings, mechanism)
    plant.reset(q[0])
    planned = np.concatenate([q, np.repeat(q[-1:], _AFTER, axis=0)])
    rates = np.concatenate([qd, np.zeros((_AFTER, q.shape[1]))])
    reached = []
    for desired, rate in zip(planned, rates, strict=True):
        error = mechanism.motors(desired - plant.q)
        error_rate = mechanism.motors(rate - plant.qd)
        counts = servo.counts_of(error, error_rate, gravity(plant.q))
        plant.advance(servo.torques(counts))
        reached.append(plant.q.copy())
        if servo.stop:
            break
    simulated = np.array(reached)
    difference = np.abs(simulated - planned[: len(simulated)])
    return Followed(simulated, difference.max(axis=0), servo.stop)
