"""Check that the gains of a machine are stable: eigenvalues of the sampled control loop at a posture.

Near rest, and without Coulomb friction, limits and gravity, a tick is linear in joint values q, rates v, filtered motor
rates w and the integral s of the motor errors (A q: motor angles, h: duration of a tick, c: low-pass fraction):

    w' = w + c (A (q - q_before) / h - w)        s' = s - h A q
    (M + h V) v' = M v + h A^T (-kp A q - kd w' + ki s')        q' = q + h v'

A motion with an eigenvalue outside the unit circle grows from tick to tick. M is the mass matrix of
`twin.reference.dynamics`, not the compiled mass matrix of the plant.
"""

from __future__ import annotations

import numpy as np

from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.motor_plant import TICK
from twin.simulation.machine.settings import Settings

_MOST = 1 + 1e-6
"""Largest accepted magnitude of an eigenvalue; above it, a deviation grows by more than the factor e in 1000 s."""


def require_stable(arm: Arm, settings: Settings, q: Array) -> None:
    """Check that the gains make the control loop stable at joint values q (n,).

    Raises:
        MechanismError: the loop is unstable; the message has the joint, frequency, growth and gains.
    """
    values, vectors = np.linalg.eig(_tick(arm, settings, q))
    i = int(np.argmax(np.abs(values)))
    size = float(np.abs(values[i]))
    if size <= _MOST:
        return
    n = len(q)
    # Angles and lengths are comparable by their kinetic energy.
    weights = np.sqrt(np.diag(arm.dynamics().mass_matrix(q)))
    joint = int(np.argmax(np.abs(vectors[:n, i]) * weights))
    motor = settings.of_motors(arm.mechanism)[joint]
    hertz = abs(np.angle(values[i])) / (2 * np.pi * TICK)
    doubled = np.log(2) / np.log(size) * TICK
    raise MechanismError(
        f"the gains make {arm.mechanism.active[joint].name} oscillate with {hertz:.3g} Hz: a deviation doubles in "
        f"{doubled * 1e3:.3g} ms; reduce kp = {motor.kp:g}, kd = {motor.kd:g} or ki = {motor.ki:g} of {motor.name}"
    )


def _tick(arm: Arm, settings: Settings, q: Array) -> Array:
    """Return the matrix (4 n, 4 n) by which a tick multiplies the state (q, v, w, s)."""
    motors = settings.of_motors(arm.mechanism)
    kp = np.zeros((len(motors), len(motors)))
    kd = np.zeros_like(kp)
    ki = np.zeros_like(kp)
    for i, motor in enumerate(motors):
        kp[i, i] = motor.kp / motor.gear
        kd[i, i] = motor.kd / motor.gear
        ki[i, i] = motor.ki / motor.gear
    dynamics = arm.dynamics()
    M = dynamics.mass_matrix(q)
    V = np.diag(dynamics.friction)
    A = np.linalg.inv(arm.mechanism.motor_matrix)
    c = 1 - np.exp(-2 * np.pi * settings.number.velocity_cutoff.value * TICK)
    one = np.eye(len(q))
    none = np.zeros_like(one)
    # Rows (n, 4 n) of the matrix. A (q - q_before) / h is A v, because q = q_before + h v.
    w = np.hstack([none, c * A, (1 - c) * one, none])
    s = np.hstack([-TICK * A, none, none, one])
    torque = np.hstack([-kp @ A, none, none, none]) - kd @ w + ki @ s
    momentum = np.hstack([none, M, none, none]) + TICK * A.T @ torque
    v = np.linalg.solve(M + TICK * V, momentum)
    q_new = np.hstack([one, none, none, none]) + TICK * v
    return np.vstack([q_new, v, w, s]).astype(float)
