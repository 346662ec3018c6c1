"""Joint steps towards a desired pose, from the Jacobian, within joint and rate limits.

Algorithm 2.1 of the SHER 3.0 simulation paper minimises C = J(q) qd - (X_des - X_curr) by sequential least
squares programming. As printed C is a vector, and a rate less a displacement. What can be meant, and what both
solvers here minimise, is |J dq - gain (X_des - X_curr)|^2 for a joint step dq = qd dt, with the rotation of
X_des - X_curr as a rotation vector in base, and a radian weighed as much as the characteristic length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.kinematics import Kinematics

Solver = Literal["slsqp", "damped"]

_DAMPING = 1e-4
"""Damping relative to the weighed Jacobian's size: far below any tracking error, bounded at a singularity."""


@dataclass(frozen=True)
class Limits:
    """Joint limits: lower, upper (n,) in m or rad, max_speed (n,) in m/s or rad/s; infinite where there is none."""

    lower: Array
    upper: Array
    max_speed: Array


@dataclass(frozen=True)
class Step:
    """One tick.

    Attributes:
        q: (n,) joints after it.
        dq: (n,) the step.
        residual: what of the pose error is left to first order, in m (rotations by the characteristic length).
        saturated: (n,) bool, which joints stand at a limit of theirs.
    """

    q: Array
    dq: Array
    residual: float
    saturated: np.ndarray


def pose_error(T: Array, T_desired: Array) -> Array:
    """Return (6,): translation in m and rotation vector in rad, both in base, that lead from T to T_desired."""
    turn = spatial.log_so3(T_desired[:3, :3] @ T[:3, :3].T)
    return np.concatenate([T_desired[:3, 3] - T[:3, 3], turn])


def step(
    kin: Kinematics,
    q: Array,
    T_desired: Array,
    dt: float,
    limits: Limits,
    solver: Solver = "damped",
    gain: float = 1.0,
    seed: Array | None = None,
) -> Step:
    """Return the joints one tick nearer to a desired pose.

    Args:
        kin: the equations; they need a forward equation.
        q: (n,) present joints in m or rad.
        T_desired: (4, 4).
        dt: length of the tick in s.
        limits: what the joints may do.
        solver: "slsqp" as the paper, or "damped" least squares.
        gain: part of the error to take back in this tick, (0, 1].
        seed: (4, 4) a pose near the present one: a thousand times faster where forward equations are iterated.

    Raises:
        KinematicsError: a value is not finite, or no Jacobian exists there.
    """
    q = np.asarray(q, float)
    if not (np.isfinite(q).all() and np.isfinite(T_desired).all() and dt > 0):
        raise KinematicsError(f"joints, desired pose and dt = {dt} must be finite numbers, dt above 0")
    weight = np.array([1.0, 1.0, 1.0, *3 * [kin.characteristic_length]])
    T = kin.forward(q, seed)
    J = weight[:, None] * (kin.jacobian(q=q) if kin.closed_forward else kin.jacobian(T))
    e = gain * weight * pose_error(T, T_desired)
    reach = limits.max_speed * dt
    # A joint that stands outside its limits may only come back.
    lower = np.clip(limits.lower - q, -reach, reach)
    upper = np.clip(limits.upper - q, -reach, reach)
    # Columns in metres of tool motion, so that slides and turns are damped alike.
    scale = np.where(kin.revolute, 1.0 / kin.characteristic_length, 1.0)
    solve = _slsqp if solver == "slsqp" else _damped
    dq = np.clip(scale * solve(J * scale, e, lower / scale, upper / scale), lower, upper)
    at_limit = (dq <= lower) | (dq >= upper)
    return Step(q + dq, dq, float(np.linalg.norm(J @ dq - e)), at_limit)


def _damped(J: Array, e: Array, lower: Array, upper: Array) -> Array:
    """Return the x that minimises |J x - e|^2 + damping^2 |x|^2 between bounds."""
    n = J.shape[1]
    mu = _DAMPING * np.linalg.norm(J) / np.sqrt(n)
    x = np.linalg.solve(J.T @ J + mu**2 * np.eye(n), J.T @ e)
    if (x >= lower).all() and (x <= upper).all():
        return x
    from scipy.optimize import lsq_linear

    fixed = upper - lower < 1e-15
    if fixed.all():
        return lower
    free = ~fixed
    A = np.vstack([J[:, free], mu * np.eye(free.sum())])
    b = np.concatenate([e - J[:, fixed] @ lower[fixed], np.zeros(free.sum())])
    size = max(float(np.abs(b).max()), 1e-15)  # the solver's tolerances are absolute
    x = lower.copy()
    x[free] = size * lsq_linear(A, b / size, (lower[free] / size, upper[free] / size), method="bvls").x
    return x


def _slsqp(J: Array, e: Array, lower: Array, upper: Array) -> Array:
    """Return the x that minimises |J x - e|^2 between bounds, by sequential least squares programming."""
    from scipy.optimize import minimize

    size = max(float(np.abs(e).max()), 1e-15)  # the stopping rule is absolute: 1 um squared is below it
    target = e / size

    def cost(x: Array) -> tuple[float, Array]:
        r = J @ x - target
        return float(r @ r), 2 * J.T @ r

    found = minimize(
        cost,
        np.clip(np.zeros(J.shape[1]), lower / size, upper / size),
        jac=True,
        method="SLSQP",
        bounds=np.column_stack([lower, upper]) / size,
        options={"ftol": 1e-14, "maxiter": 100},
    )
    return size * found.x
