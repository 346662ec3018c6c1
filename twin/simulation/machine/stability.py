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
from twin.simulation.machine.plant import TICK
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
    joint = int(np.argmax(np.abs(vectors[:n, i]) * np.sqrt(np.diag(arm.dynamics().mass_matrix(q)))))
    motor = settings.of_motors(arm.mechanism)[joint]
    hertz, doubled = abs(np.angle(values[i])) / (2 * np.pi * TICK), np.log(2) / np.log(size) * TICK
    raise MechanismError(
        f"the gains make {arm.mechanism.active[joint].name} oscillate with {hertz:.3g} Hz: a deviation doubles in "
        f"{doubled * 1e3:.3g} ms; reduce kp = {motor.kp:g}, kd = {motor.kd:g} or ki = {motor.ki:g} of {motor.name}"
    )


def _tick(arm: Arm, settings: Settings, q: Array) -> Array:
    """Return the matrix (4 n, 4 n) by which a tick multiplies the state (q, v, w, s)."""
    motors, n = settings.of_motors(arm.mechanism), len(q)
    kp, kd, ki = (np.diag([getattr(m, k) / m.gear for m in motors]) for k in ("kp", "kd", "ki"))
    dynamics, A = arm.dynamics(), np.linalg.inv(arm.mechanism.motor_matrix)
    M = dynamics.mass_matrix(q)
    c = 1 - np.exp(-2 * np.pi * settings.number.velocity_cutoff.value * TICK)
    one, none = np.eye(n), np.zeros((n, n))
    # A (q - q_before) / h is A v, because q = q_before + h v
    w = np.hstack([none, c * A, (1 - c) * one, none])
    s = np.hstack([-TICK * A, none, none, one])
    torque = np.hstack([-kp @ A, none, none, none]) - kd @ w + ki @ s
    rate = np.linalg.solve(
        M + TICK * np.diag(dynamics.friction), np.hstack([none, M, none, none]) + TICK * A.T @ torque
    )
    return np.vstack([np.hstack([one, none, none, none]) + TICK * rate, rate, w, s]).astype(float)
