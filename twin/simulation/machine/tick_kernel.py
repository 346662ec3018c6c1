"""Compile one tick of a plant: joint values and rates after it, from motor torques and the parameters of the plant.

    (M(q) + T^-T J T^-1) qdd + b(q, qd) + V qd + f(qd) = T^-T motor torque

T is the matrix of the transmission (q = T m), J the rotor inertias, V the viscous friction, f the Coulomb friction. One
tick is one step of the implicit Euler method for the viscous friction, and of the semi-implicit Euler method for the
other terms, with the duration h of the tick:

    v' = v + h (M + T^-T J T^-1 + h V)^-1 (T^-T motor torque - b - V v)      rates without Coulomb friction
    v" = v' + h (M + T^-T J T^-1 + h V)^-1 (-f)                              with it
    q' = q + h v", or a hard stop, at which the joint is at rest

The friction f of a joint is the effort that brings the joint to rest within the tick, but at most the Coulomb friction
in `Physics.coulomb`; therefore, a joint can stick. The efforts f are computed by sweeps over the joints (projected
Gauss-Seidel; J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, Springer 1988): by `SWEEPS`,
with loops by `LOOP_SWEEPS`.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from twin.codegen import Kernel, Stage
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.equations_of_motion import motion
from twin.simulation.machine.physics import TICK

SWEEPS = 3
"""Number of sweeps over the joints for the Coulomb friction."""

LOOP_SWEEPS = 20
"""Number of these sweeps for a mechanism with loops, whose joints are strongly coupled."""


def tick_kernel(arm: Arm, solver: LoopSolver | None = None) -> Kernel:
    """Return the compiled tick: (state, motor torques (n,), parameters) -> new joint values and rates (2 n,).

    The state has joint values and rates (2 n,), then the states of the passive joints, which `solver` closes; without
    loops, there are none. The parameters are those of `Physics.checked`.
    """
    equations = motion(arm.mechanism, solver)
    count = len(arm.mechanism.active)
    rotors = ca.SX.sym("rotors", count)
    V = ca.SX.sym("V", count)
    C = ca.SX.sym("C", count)
    low = ca.SX.sym("low", count)
    high = ca.SX.sym("high", count)
    torques = ca.SX.sym("torques", count)
    T_inverse = ca.DM(np.linalg.inv(arm.mechanism.motor_matrix))
    # TICK * V: the viscous friction acts on the new rates (implicit Euler method).
    inertia = equations.M + T_inverse.T @ ca.diag(rotors) @ T_inverse + ca.diag(TICK * V)
    inverse = symmetric_inverse(inertia)
    efforts = T_inverse.T @ torques - equations.b - V * equations.qd
    frictionless = equations.qd + TICK * (inverse @ efforts)
    if solver is None:
        v = with_coulomb_friction(frictionless, inverse, C, SWEEPS)
    else:
        v = with_coulomb_friction(frictionless, inverse, C, LOOP_SWEEPS)
        # The joints of a parallel robot are so strongly coupled that the sweeps alone would let it creep on its brakes.
        v = ca.if_else(_sticks(frictionless, inertia, C), ca.SX.zeros(count), v)
    q, v = _stopped(equations.q + TICK * v, v, low, high)
    new_state = ca.densify(ca.vertcat(q, v))
    # The kernel has one vector of states and one of parameters, in the order of `Physics.checked`.
    states = (equations.q, equations.qd, equations.states)
    symbols = ca.vertcat(*states, equations.factors, rotors, V, C, equations.fall, low, high)
    return kernel_of_tick(new_state, symbols, 2 * count + equations.states.numel(), torques)


def _sticks(v: ca.SX, inertia: ca.SX, limits: ca.SX) -> ca.SX:
    """Return 1 if Coulomb friction up to `limits` (n,) can bring all joints with rates v (n,) to rest, otherwise 0."""
    stopping_efforts = inertia @ (-v) / TICK
    sticks = ca.SX(1)
    for i in range(v.numel()):
        sticks = sticks * (ca.fabs(stopping_efforts[i]) <= limits[i])
    return sticks


def _stopped(q: ca.SX, v: ca.SX, low: ca.SX, high: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return joint values and rates (n,) with hard stops: a joint that reaches one stays there at rest, no rebound."""
    inside = ca.fmax(ca.fmin(q, high), low)
    rates = []
    for i in range(v.numel()):
        is_at_stop = ca.fabs(q[i] - inside[i]) > 0
        rates.append(ca.if_else(is_at_stop, 0, v[i]))
    return inside, ca.vertcat(*rates)


def with_coulomb_friction(v: ca.SX, inverse: ca.SX, limits: ca.SX, sweeps: int) -> ca.SX:
    """Return the rates after Coulomb friction, from the rates v (n,) without it.

    Args:
        v: (n,) rates, in rad/s or m/s.
        inverse: (n, n) inverse of the inertia.
        limits: (n,) Coulomb friction in N m or N.
        sweeps: number of passes over all coordinates.
    """
    friction = [ca.SX(0)] * v.numel()
    for _ in range(sweeps):
        for i in range(v.numel()):
            stopping = friction[i] - v[i] / (TICK * inverse[i, i])  # effort after which coordinate i is at rest
            effort = ca.fmax(ca.fmin(stopping, limits[i]), -limits[i])
            v = v + TICK * inverse[:, i] * (effort - friction[i])
            friction[i] = effort
    return v


def kernel_of_tick(new_state: ca.SX, symbols: ca.SX, size: int, torques: ca.SX) -> Kernel:
    """Return the kernel of a new state as a function of `symbols`: `size` symbols of the state, then parameters."""
    state = ca.SX.sym("state", size)
    parameters = ca.SX.sym("parameters", symbols.numel() - size)
    new_state = ca.substitute(new_state, symbols, ca.vertcat(state, parameters))
    step = ca.Function("tick", [state, torques, parameters], [new_state], {"cse": True})
    sizes = {"state": size, "torques": torques.numel(), "parameters": parameters.numel()}
    return Kernel([Stage(step, tuple(sizes), ("new",))], sizes, ["new"], single=True)


def symmetric_inverse(M: ca.SX) -> ca.SX:
    """Return the inverse of a symmetric positive definite matrix, from its factors L D L^T and without branches."""
    n = M.shape[0]
    L = ca.SX.eye(n)
    D = [ca.SX(0)] * n
    for j in range(n):
        known = ca.SX(0)
        for k in range(j):
            known = known + L[j, k] ** 2 * D[k]
        D[j] = M[j, j] - known
        for i in range(j + 1, n):
            known = ca.SX(0)
            for k in range(j):
                known = known + L[i, k] * L[j, k] * D[k]
            L[i, j] = (M[i, j] - known) / D[j]
    # the inverse of L, row by row
    lower = ca.SX.eye(n)
    for j in range(n):
        for i in range(j + 1, n):
            known = ca.SX(0)
            for k in range(j, i):
                known = known + L[i, k] * lower[k, j]
            lower[i, j] = -known
    return lower.T @ ca.diag(1 / ca.vertcat(*D)) @ lower
