"""Check that the gains of a machine are stable: eigenvalues of the sampled control loop at a posture.

Near rest, and without Coulomb friction, limits and gravity, a tick is linear in joint values q, rates v, filtered motor
rates w and the integral s of the motor errors (A q: motor angles, h: duration of a tick, c: low-pass fraction,
V: diagonal matrix of the viscous friction at the joints):

    w' = w + c (A (q - q_before) / h - w)        s' = s - h A q
    (M + h V) v' = M v + h A^T (-kp A q - kd w' + ki s')        q' = q + h v'

kp, kd and ki are the gains of `settings.Motor`, which are stated at the output of the gear, divided by the gear ratio.
A motion with an eigenvalue outside the unit circle grows from tick to tick. M is the mass matrix of
`twin.reference.dynamics`, not the compiled mass matrix of the plant.
"""

from __future__ import annotations

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.settings import Motor, Settings

_LARGEST_EIGENVALUE = 1 + 1e-6
"""Largest accepted magnitude of an eigenvalue; above it, a deviation grows by more than the factor e in 1000 s."""


def require_stable(arm: Arm, settings: Settings, q: Array) -> None:
    """Check that the gains make the control loop stable at joint values q (n,).

    Raises:
        MechanismError: the loop is unstable; the message has the joint, frequency, growth, and the gains of a motor
            that moves the joint.
    """
    values, vectors = np.linalg.eig(_tick(arm, settings, q))
    i = int(np.argmax(np.abs(values)))
    magnitude = float(np.abs(values[i]))
    if magnitude <= _LARGEST_EIGENVALUE:
        return
    n = len(q)
    motion = vectors[:, i]
    # Angles and lengths are comparable by their kinetic energy.
    weights = np.sqrt(np.diag(arm.dynamics().mass_matrix(q)))
    joint = int(np.argmax(np.abs(motion[:n]) * weights))
    motor = _motor_of(joint, arm, settings, motion)
    frequency = abs(np.angle(values[i])) / (2 * np.pi * TICK)
    doubling_time = np.log(2) / np.log(magnitude) * TICK
    name = arm.mechanism.active[joint].name
    gains = f"kp = {motor.kp:g}, kd = {motor.kd:g} or ki = {motor.ki:g} of {motor.name}"
    raise MechanismError(
        f"the gains make {name} oscillate with {frequency:.3g} Hz: a deviation doubles in "
        f"{doubling_time * 1e3:.3g} ms; reduce {gains}"
    )


def _motor_of(joint: int, arm: Arm, settings: Settings, motion: Array) -> Motor:
    """Return the motor of a joint; of several, which a transmission couples, the one that moves the most energy.

    `motion` (4 n,) is the complex state (q, v, w, s) of the motion that grows.
    """
    mechanism = arm.mechanism
    unit = np.zeros(len(mechanism.active))
    unit[joint] = 1.0
    moving = np.flatnonzero(mechanism.motors(unit))
    _, _, torque = _motor_rows(arm, settings)
    motor_angles = np.linalg.solve(mechanism.motor_matrix, motion[: len(unit)])
    energies = np.abs(torque @ motion) * np.abs(motor_angles)
    strongest = moving[int(np.argmax(energies[moving]))]
    return settings.of_motors(mechanism)[strongest]


def _motor_rows(arm: Arm, settings: Settings) -> tuple[Array, Array, Array]:
    """Return the rows (n, 4 n) that give w, s and the torques of the motors of a tick from the state (q, v, w, s)."""
    motors = settings.of_motors(arm.mechanism)
    kp = np.zeros((len(motors), len(motors)))
    kd = np.zeros_like(kp)
    ki = np.zeros_like(kp)
    for i, motor in enumerate(motors):
        kp[i, i] = motor.kp / motor.gear
        kd[i, i] = motor.kd / motor.gear
        ki[i, i] = motor.ki / motor.gear
    A = np.asarray(np.linalg.inv(arm.mechanism.motor_matrix), np.float64)
    c = 1 - np.exp(-2 * np.pi * settings.number.velocity_cutoff.value * TICK)
    identity = np.eye(len(motors))
    zeros = np.zeros_like(identity)
    # A (q - q_before) / h is A v, because q = q_before + h v.
    w = np.hstack([zeros, c * A, (1 - c) * identity, zeros])
    s = np.hstack([-TICK * A, zeros, zeros, identity])
    torque = np.hstack([-kp @ A, zeros, zeros, zeros]) - kd @ w + ki @ s
    return w, s, torque


def _tick(arm: Arm, settings: Settings, q: Array) -> Array:
    """Return the matrix (4 n, 4 n) by which a tick multiplies the state (q, v, w, s)."""
    dynamics = arm.dynamics()
    M = dynamics.mass_matrix(q)
    V = np.diag(dynamics.friction)
    A = np.linalg.inv(arm.mechanism.motor_matrix)
    identity = np.eye(len(q))
    zeros = np.zeros_like(identity)
    w, s, torque = _motor_rows(arm, settings)
    momentum = np.hstack([zeros, M, zeros, zeros]) + TICK * A.T @ torque
    v = np.linalg.solve(M + TICK * V, momentum)
    q_new = np.hstack([identity, zeros, zeros, zeros]) + TICK * v
    return np.vstack([q_new, v, w, s]).astype(float)
