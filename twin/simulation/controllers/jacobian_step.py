"""Joint steps towards a desired tool pose, from the Jacobian, within joint and speed limits.

Algorithm 2.1 of the SHER 3.0 simulation paper minimises C = J(q) qd - (X_des - X_curr) by sequential least squares
programming. As printed, C is a vector, and a displacement is subtracted from a rate. Both solvers here minimise the
plausible meaning, |J dq - gain (X_des - X_curr)|^2 for a joint step dq = qd dt. The rotation in X_des - X_curr is a
rotation vector in base; 1 rad is equivalent to the characteristic length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError
from twin.core.spatial import Array, length
from twin.formula import symbolic
from twin.formula.evaluator import Evaluator
from twin.kinematics import Kinematics
from twin.simulation.limits import JointLimits
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import ROBOT_COMMAND, ROBOT_ENCODER, ROBOT_RATE

Solver = Literal["slsqp", "damped"]

_RELATIVE_DAMPING = 1e-4
"""Damping relative to the size of the weighted Jacobian.

The damping limits the steps near singularities; elsewhere, its effect is far below the tracking errors.
"""


@dataclass(frozen=True)
class JointStep:
    """Result of one joint step.

    Attributes:
        q: (n,) joint values after the step.
        dq: (n,) the step.
        residual: remaining pose error after the step, to first order, in m (rotations times the characteristic length).
        saturated: (n,) bool, whether each joint is at a limit.
    """

    q: Array
    dq: Array
    residual: float
    saturated: np.ndarray


def pose_error(T: Array, T_desired: Array) -> Array:
    """Return the pose error (6,) from T to T_desired: translation in m and rotation vector in rad, both in base."""
    return _pose_error().one(np.concatenate([T.ravel(), T_desired.ravel()]))


@cache
def _pose_error() -> Evaluator:
    """Return the function (T (16), T_desired (16)) -> pose error (6)."""
    z = ca.SX.sym("z", 32)
    T = symbolic.unflat(z[:16], 4, 4)
    T_desired = symbolic.unflat(z[16:], 4, 4)
    turn = symbolic.log_so3(T_desired[:3, :3] @ T[:3, :3].T)
    return Evaluator("pose_error", z, ca.vertcat(T_desired[:3, 3] - T[:3, 3], turn))


def step(
    kin: Kinematics,
    q: Array,
    T_desired: Array,
    dt: float,
    limits: JointLimits,
    solver: Solver = "damped",
    seed: Array | None = None,
) -> JointStep:
    """Return the joint values after one step towards a desired pose.

    Args:
        kin: the equations, with a forward equation.
        q: (n,) current joint values in m or rad.
        T_desired: (4, 4) desired tool pose in base.
        dt: duration of the step in s.
        limits: limits of the joints.
        solver: "slsqp" as in the paper, or "damped" least squares.
        seed: (4, 4) tool pose near the current tool pose; with a seed, iterative forward equations are a thousand times
            faster. None: no seed.

    Raises:
        KinematicsError: a value is not finite, or there is no Jacobian at q.
    """
    q = np.asarray(q, float)
    if not (np.isfinite(q).all() and np.isfinite(T_desired).all() and dt > 0):
        raise KinematicsError(f"joints, desired pose and dt = {dt} must be finite numbers, and dt above 0")
    weight = np.array([1.0, 1.0, 1.0, *3 * [kin.characteristic_length]])
    T = kin.forward(q, seed)
    if kin.closed_forward:
        J = kin.jacobian(q=q)
    else:
        J = kin.jacobian(T)
    J = weight[:, None] * J
    e = weight * pose_error(T, T_desired)
    lower, upper = limits.steps(q, dt)
    # Columns in m of tool motion, so that lengths and angles are damped equally.
    scale = np.where(kin.revolute, 1.0 / kin.characteristic_length, 1.0)
    solve = _slsqp if solver == "slsqp" else _damped
    dq = scale * solve(J * scale, e, lower / scale, upper / scale)
    dq = np.minimum(np.maximum(dq, lower), upper)
    at_limit = (dq <= lower) | (dq >= upper)
    return JointStep(q + dq, dq, length(J @ dq - e), at_limit)


class ToolToJoints(Block):
    """Reads tool rates `<robot>.rate` (n,) and `<robot>.encoder`; writes joint values `<robot>.command` (n,).

    Each rate moves the tool for `ticks` steps along a straight line, starting at the tool's pose when the rate arrives.
    A rate of zero leaves the command unchanged.
    """

    def __init__(
        self, robot: str, kin: Kinematics, q: Array, limits: JointLimits, ticks: int, solver: Solver = "damped"
    ) -> None:
        """Start at joint values q (n,); a new rate arrives every `ticks` steps."""
        self.robot = robot
        self.kin = kin
        self.limits = limits
        self.ticks = ticks
        self.solver: Solver = solver
        self._T_base_tool = kin.forward(q)
        self._start_coordinates = np.zeros(0)  # coordinates of the tool when the rate arrived
        self._count = 0
        self.outputs = {ROBOT_COMMAND.of(robot): q}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Make the next step along the line."""
        ticks_done = self._count % self.ticks
        self._count += 1
        rate = signals[ROBOT_RATE.of(self.robot)]
        if not rate.any():
            return {}
        q = signals[ROBOT_ENCODER.of(self.robot)]
        kin = self.kin
        if ticks_done == 0:
            self._T_base_tool = kin.forward(q, self._T_base_tool)
            self._start_coordinates = kin.program.coordinates_of_pose.one(self._T_base_tool.ravel())
        displacement = rate * (self.ticks * dt) * (ticks_done + 1) / self.ticks
        T = kin.program.pose_of_coordinates.one(self._start_coordinates + displacement)
        result = step(kin, q, T, dt, self.limits, self.solver, seed=self._T_base_tool)
        return {ROBOT_COMMAND.of(self.robot): result.q}


def _damped(J: Array, e: Array, lower: Array, upper: Array) -> Array:
    """Return the x that minimises |J x - e|^2 + damping^2 |x|^2 within bounds."""
    n = J.shape[1]
    mu = _RELATIVE_DAMPING * length(J.ravel()) / np.sqrt(n)
    A = J.T @ J + mu**2 * np.eye(n)
    b = J.T @ e
    x = np.linalg.solve(A, b)
    if (x >= lower).all() and (x <= upper).all():
        return x
    error_size = max(float(np.abs(e).max()), 1e-15)  # scale the problem: the solver's tolerances are absolute
    x = _bounded(n).one(np.concatenate([A.ravel(), b / error_size, lower / error_size, upper / error_size]))
    return error_size * x


@cache
def _bounded(n: int) -> Evaluator:
    """Return the function (A (n, n), b (n), lower (n), upper (n)) -> x that minimises x^T A x / 2 - b^T x in bounds.

    DAQP, an active-set solver that comes with CasADi, takes about 15 µs; SciPy's `lsq_linear` takes 300 µs.
    """
    z = ca.MX.sym("z", n * (n + 3))
    A = ca.reshape(z[: n * n], n, n)
    b, lower, upper = ca.vertsplit(z[n * n :], n)
    options = {"daqp": {"primal_tol": 1e-10, "dual_tol": 1e-14}}
    solver = ca.conic("bounded", "daqp", {"h": ca.Sparsity.dense(n, n)}, options)
    return Evaluator("bounded", z, solver(h=A, g=-b, lbx=lower, ubx=upper)["x"])


def _slsqp(J: Array, e: Array, lower: Array, upper: Array) -> Array:
    """Return the x that minimises |J x - e|^2 within bounds, by sequential least squares programming."""
    from scipy.optimize import minimize

    # scale the problem: the solver's absolute tolerance exceeds (1 um)^2
    error_size = max(float(np.abs(e).max()), 1e-15)
    target = e / error_size

    def cost(x: Array) -> tuple[float, Array]:
        r = J @ x - target
        return float(r @ r), 2 * J.T @ r

    result = minimize(
        cost,
        np.clip(np.zeros(J.shape[1]), lower / error_size, upper / error_size),
        jac=True,
        method="SLSQP",
        bounds=np.column_stack([lower, upper]) / error_size,
        options={"ftol": 1e-14, "maxiter": 100},
    )
    return error_size * result.x
