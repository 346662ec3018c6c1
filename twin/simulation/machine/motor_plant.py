"""Simulate motors, cables and links of a machine: compute the joint state from motor torques, in compiled ticks.

    (M(q) + T^-T J T^-1) qdd + b(q, qd) + V qd + f(qd) = T^-T motor torque

T is the matrix of the transmission (q = T m), J the rotor inertias, V the viscous friction, f the Coulomb friction. One
tick is one step of the implicit Euler method for the viscous friction, and of the semi-implicit Euler method for the
other terms. The friction f of a joint is the effort that brings the joint to rest within the tick, but at most the
Coulomb friction in `Physics.coulomb`; therefore, a joint can stick. The efforts f are computed by three sweeps over the
joints, with loops by 20 (projected Gauss-Seidel; J. J. Moreau, Unilateral contact and dry friction in finite freedom
dynamics, Springer 1988).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twin.codegen import Kernel, Stage
from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.kinematics.closed_loops.solver import LoopSolver
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.equations_of_motion import motion

TICK = 1e-3
"""Duration of a tick in s."""

SWEEPS = 3
"""Number of sweeps over the joints for the Coulomb friction."""

LOOP_SWEEPS = 20
"""The same for a mechanism with loops, whose joints are strongly coupled."""

_LEAST_FACTOR = 1e-3
"""Smallest factor of a mass: 0 would make the mass matrix singular."""


@dataclass(frozen=True)
class Physics:
    """Parameters of a plant with n motors and joints, and m bodies.

    Attributes:
        factors: (m,) factors of the bodies' masses and inertia tensors, in the order of the tree's joints.
        rotors: (n,) inertias of the rotors at the motors, kg m2 or kg.
        viscous: (n,) viscous friction at the joints, N m s/rad or N s/m.
        coulomb: (n,) Coulomb friction at the joints, N m or N.
        fall: (3,) gravitational acceleration in m/s2, in the axes of base, so that it depends on the tilt of the base.
        stops: (2, n) minimum and maximum joint values at the hard stops, which have no rebound; infinite: no stop.
    """

    factors: Array
    rotors: Array
    viscous: Array
    coulomb: Array
    fall: Array
    stops: Array

    @classmethod
    def of(cls, arm: Arm, coulomb: ArrayLike = 0.0) -> Physics:
        """Return the parameters in the robot's files; `coulomb`: Coulomb friction (n,) in N m or N."""
        mechanism = arm.mechanism
        n = len(arm.friction)
        rotors = np.zeros(n)
        for actuator in mechanism.actuators:
            if actuator.name in mechanism.motor_names and actuator.rotor_inertia is not None:
                rotors[mechanism.motor_names.index(actuator.name)] = actuator.rotor_inertia
        return cls(
            factors=np.ones(len(mechanism.tree)),
            rotors=rotors,
            viscous=arm.friction.copy(),
            coulomb=np.broadcast_to(np.asarray(coulomb, float), n).copy(),
            fall=np.array(mechanism.gravity, float),
            stops=mechanism.limits.T.copy(),
        )

    def changed(self, mass: float = 1.0, friction: float = 1.0, tilt: float = 0.0) -> Physics:
        """Return a copy: masses times `mass`, friction times `friction`, base tilted by `tilt` rad about its x axis."""
        fall = spatial.exp_so3([-tilt, 0.0, 0.0]) @ self.fall
        scaled = {"viscous": friction * self.viscous, "coulomb": friction * self.coulomb}
        return replace(self, factors=mass * self.factors, fall=fall, **scaled)

    def checked(self, arm: Arm) -> Array:
        """Return all parameters as one vector.

        Raises:
            MechanismError: a number is not finite (hard stops: NaN), a mass factor is below 0.001, a friction or rotor
                inertia is negative, a shape is wrong, or a minimum of the hard stops is above the maximum.
        """
        active_names = [joint.name for joint in arm.mechanism.active]
        tree_names = [joint.name for joint in arm.mechanism.tree]
        parts = {
            "factor of the mass": (tree_names, self.factors, _LEAST_FACTOR),
            "rotor inertia": (active_names, self.rotors, 0.0),
            "viscous friction": (active_names, self.viscous, 0.0),
            "Coulomb friction": (active_names, self.coulomb, 0.0),
        }
        for what, (names, values, least) in parts.items():
            if np.shape(values) != (len(names),):
                raise MechanismError(
                    f"plant: the {what} has shape {np.shape(values)}; it must have shape ({len(names)},)"
                )
            for name, value in zip(names, values, strict=True):
                if not (np.isfinite(value) and value >= least):
                    raise MechanismError(f"plant: the {what} of {name} is {value:g}; it must be at least {least:g}")
        if not np.isfinite(self.fall).all():
            raise MechanismError(f"plant: the gravitational acceleration is {self.fall}; it must be finite")
        expected = (2, len(active_names))
        if np.shape(self.stops) != expected:
            raise MechanismError(
                f"plant: the hard stops have shape {np.shape(self.stops)}; they must have shape {expected}"
            )
        for name, low, high in zip(active_names, *self.stops, strict=True):
            if not low <= high:
                raise MechanismError(
                    f"plant: the hard stops of {name} are {low:g} and {high:g}; the first must be the lower one"
                )
        return np.concatenate([self.factors, self.rotors, self.viscous, self.coulomb, self.fall, *self.stops])


class MotorPlant:
    """Simulates a robot that moves under motor torques.

    Attributes:
        q, qd: (n,) joint values in rad or m, and rates.
        physics: parameters; change them with `set`.
        jams: number of ticks in which a linkage with closed loops jammed (see `loop_plant`).
    """

    jams = 0

    def __init__(self, arm: Arm, physics: Physics | None = None) -> None:
        """Compile the equations of a robot, or load them from the cache.

        Raises:
            MechanismError: the mechanism has loops (see `loop_plant`), or a parameter is impossible.
        """
        if arm.mechanism.loops:
            raise MechanismError(f"{arm.mechanism.name} has loops: use a LoopPlant")
        self._arm = arm
        self.set(physics or Physics.of(arm))
        self._step = tick_kernel(arm).single()
        self._count = len(arm.mechanism.active)
        self._state = np.zeros(2 * self._count)

    def another(self, physics: Physics | None = None) -> Self:
        """Return a plant of the same robot (and cables), at joint values 0 and at rest, without compiling again.

        Raises:
            MechanismError: a parameter is impossible.
        """
        plant = copy(self)
        plant._state = np.zeros_like(self._state)
        plant.set(physics or self.physics)
        return plant

    @property
    def q(self) -> Array:
        """Joint values (n,) of the links."""
        return self._state[: self._count]

    @property
    def qd(self) -> Array:
        """Rates (n,) of the links."""
        return self._state[self._count : 2 * self._count]

    @property
    def encoded(self) -> Array:
        """Joint values (n,) that the encoders of the motors measure: without cables, those of the joints."""
        return self.q

    def set(self, physics: Physics) -> None:
        """Use other parameters from the next tick on.

        Raises:
            MechanismError: a parameter is impossible.
        """
        self._parameters = physics.checked(self._arm)
        self.physics = physics

    def reset(self, q: ArrayLike, qd: ArrayLike = 0.0) -> None:
        """Set joint values (n,) and rates (n,)."""
        rates = np.broadcast_to(np.asarray(qd, float), self._count)
        self._state = np.concatenate([np.asarray(q, float), rates])

    def advance(self, torques: Array) -> None:
        """Advance by one tick under motor torques (n,) in N m or N."""
        self._state = self._step(self._state, torques, self._parameters)


def tick_kernel(arm: Arm, solver: LoopSolver | None = None) -> Kernel:
    """Return the compiled tick: (state, motor torques (n,), parameters) -> new joint values and rates (2 n,).

    The state has joint values and rates (2 n,), then the states of the passive joints, which `solver` closes; without
    loops, there are none.
    """
    equations = motion(arm.mechanism, solver)
    h = TICK
    count = len(arm.mechanism.active)
    rotors = ca.SX.sym("rotors", count)
    V = ca.SX.sym("V", count)
    C = ca.SX.sym("C", count)
    low = ca.SX.sym("low", count)
    high = ca.SX.sym("high", count)
    torques = ca.SX.sym("torques", count)
    T_inverse = ca.DM(np.linalg.inv(arm.mechanism.motor_matrix))
    # h V: the viscous friction acts on the new rates (implicit Euler method).
    M = equations.M + T_inverse.T @ ca.diag(rotors) @ T_inverse + ca.diag(h * V)
    M_inverse = symmetric_inverse(M)
    v = equations.qd + h * (M_inverse @ (T_inverse.T @ torques - equations.b - V * equations.qd))
    at_rest = M @ (-v) / h  # efforts after which all joints are at rest
    sticks = ca.SX(1)
    for i in range(count):
        sticks = sticks * (ca.fabs(at_rest[i]) <= C[i])
    v = with_coulomb_friction(v, M_inverse, C, SWEEPS if solver is None else LOOP_SWEEPS)
    if solver is not None:
        # The joints of a parallel robot are so strongly coupled that the sweeps alone would let it creep on its brakes.
        v = ca.if_else(sticks, ca.SX.zeros(count), v)
    q = equations.q + h * v
    # A joint that reaches a hard stop stays there at rest, without rebound.
    inside = ca.fmax(ca.fmin(q, high), low)
    rates = []
    for i in range(count):
        at_stop = ca.fabs(q[i] - inside[i]) > 0
        rates.append(ca.if_else(at_stop, 0, v[i]))
    new_state = ca.densify(ca.vertcat(inside, *rates))
    # The kernel has one vector of states and one of parameters, in the order of `Physics.checked`.
    states = (equations.q, equations.qd, equations.states)
    symbols = ca.vertcat(*states, equations.factors, rotors, V, C, equations.fall, low, high)
    return kernel_of_tick(new_state, symbols, 2 * count + equations.states.numel(), torques)


def with_coulomb_friction(v: ca.SX, inverse: ca.SX, limits: ca.SX, sweeps: int) -> ca.SX:
    """Return the rates v (n,) after Coulomb friction up to `limits` (n,), from the inverse (n, n) of the inertia."""
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
