"""Simulate motors that pull their links by cables that stretch and have play, with Coulomb friction at both ends.

    (T^-T J T^-1) pdd + V pd + f_p(pd) = T^-T motor torque - c        c = K g(p - q) + D (pd - qd)
    M(q) qdd + b(q, qd) + f_q(qd) = c

p = T m are the joint values that the motors would give without cables; encoders on the motors measure them, so that
the control software does not see how far the links q are behind. g is the stretch of a cable: 0 within its play, and
beyond it the difference to the nearest limit of the play; K is the stiffness, D the damping, which acts only while the
cable pulls. The other symbols are those of `tick_kernel`. One tick is one step of the implicit Euler method for viscous
friction and cables, and of the semi-implicit Euler method for the other terms. Coulomb friction is computed as in
`tick_kernel`, for links and motors. Cables that are stiff and without play give the motion of `MotorPlant`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twin.codegen import Kernel
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm
from twin.simulation.machine.equations_of_motion import motion
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import TICK, Physics
from twin.simulation.machine.tick_kernel import SWEEPS, kernel_of_tick, symmetric_inverse, with_coulomb_friction


@dataclass(frozen=True)
class Cables:
    """Cables between n motors and their joints, in the units of the joints.

    Attributes:
        stiffness: (n,) N m/rad or N/m.
        play: (n,) half of the play, rad or m: a link moves by this in both directions before its cable pulls.
        damping: (n,) N m s/rad or N s/m, while the cable pulls.
        coulomb: (n,) Coulomb friction at the links, N m or N; the rest of a joint's friction acts at its motor.
    """

    stiffness: Array
    play: Array
    damping: Array
    coulomb: Array

    def checked(self, arm: Arm) -> Array:
        """Return all numbers as one vector (4 n,).

        Raises:
            MechanismError: a number is not finite or negative, or a stiffness is 0.
        """
        joints = arm.mechanism.active
        for quantity in ("stiffness", "play", "damping", "coulomb"):
            values = getattr(self, quantity)
            if np.shape(values) != (len(joints),):
                raise MechanismError(
                    f"cables: {quantity} has shape {np.shape(values)}; it must have shape ({len(joints)},)"
                )
            for joint, value in zip(joints, values, strict=True):
                is_in_range = value >= 0
                limit = "at least 0"
                if quantity == "stiffness":
                    is_in_range = value > 0
                    limit = "above 0"
                if not (np.isfinite(value) and is_in_range):
                    raise MechanismError(f"cables: the {quantity} of {joint.name} is {value:g}; it must be {limit}")
        return np.concatenate([self.stiffness, self.play, self.damping, self.coulomb])


class CablePlant(MotorPlant):
    """Simulates a robot whose links follow its motors by cables.

    Attributes:
        q, qd: (n,) joint values of the links in rad or m, and rates.
        encoded: (n,) joint values that the encoders of the motors measure.
        cables: the cables.
    """

    def __init__(self, arm: Arm, physics: Physics, cables: Cables) -> None:
        """Compile the equations of a robot, or load them from the cache.

        Raises:
            MechanismError: the mechanism has loops, or a parameter is impossible.
        """
        self.cables = cables
        self._arm = arm
        self.set(physics)
        self._step = _kernel(arm).single()
        self._count = len(arm.mechanism.active)
        self._state = np.zeros(4 * self._count)

    @property
    def encoded(self) -> Array:
        """Joint values (n,) that the encoders of the motors measure."""
        n = self._count
        return self._state[2 * n : 3 * n]

    def set(self, physics: Physics) -> None:
        """Use other parameters from the next tick on.

        Raises:
            MechanismError: a parameter is impossible.
        """
        self._parameters = np.concatenate([physics.checked(self._arm), self.cables.checked(self._arm)])
        self.physics = physics

    def reset(self, q: ArrayLike, qd: ArrayLike = 0.0) -> None:
        """Set joint values (n,) and rates (n,); the cables are in the middle of their play."""
        n = self._count
        rates = np.broadcast_to(np.asarray(qd, float), n)
        values = np.asarray(q, float)
        self._state = np.concatenate([values, rates, values, rates])


def _kernel(arm: Arm) -> Kernel:
    """Return the compiled tick: (state (4 n,), motor torques (n,), parameters) -> new state.

    The state has joint values and rates of the links, then those of the motors; the parameters are those of
    `Physics.checked`, then those of `Cables.checked`.
    """
    equations = motion(arm.mechanism)
    h = TICK
    count = len(arm.mechanism.active)
    names = ("rotors", "V", "C", "low", "high", "K", "play", "D", "C_links")
    rotors, V, C, low, high, K, play, D, C_links = [ca.SX.sym(name, count) for name in names]
    p = ca.SX.sym("p", count)
    pd = ca.SX.sym("pd", count)
    torques = ca.SX.sym("torques", count)
    T_inverse = ca.DM(np.linalg.inv(arm.mechanism.motor_matrix))
    lag = p - equations.q
    stretch = ca.sign(lag) * ca.fmax(ca.fabs(lag) - play, 0)
    is_pulling = ca.fabs(lag) > play
    force = K * stretch
    # A step of the velocities changes the force of a cable by h K + D, as long as the cable pulls.
    force_per_rate = ca.if_else(is_pulling, h * K + D, 0)
    coupling = ca.diag(h * force_per_rate)
    M_rotors = T_inverse.T @ ca.diag(rotors) @ T_inverse
    # of links and motors, with the implicit terms
    inertia = ca.blockcat(
        [[equations.M + coupling, -coupling], [-coupling, M_rotors + ca.diag(h * (force_per_rate + V))]]
    )
    # momentum after the step without Coulomb friction
    link_momentum = equations.M @ equations.qd + h * (force - equations.b)
    motor_momentum = M_rotors @ pd + h * (T_inverse.T @ torques - force)
    inverse = symmetric_inverse(inertia)
    v = inverse @ ca.vertcat(link_momentum, motor_momentum)
    # the friction of a joint that does not act at its link acts at its motor
    limits = ca.vertcat(C_links, ca.fmax(C - C_links, 0))
    v = with_coulomb_friction(v, inverse, limits, SWEEPS)
    q = equations.q + h * v[:count]
    # A link that reaches a hard stop stays there at rest, without rebound.
    inside = ca.fmax(ca.fmin(q, high), low)
    rates = ca.if_else(ca.fabs(q - inside) > 0, 0, v[:count])
    new_state = ca.densify(ca.vertcat(inside, rates, p + h * v[count:], v[count:]))
    # one vector of states and one of parameters, in the order of `Physics.checked` and `Cables.checked`
    states = (equations.q, equations.qd, p, pd)
    physics = (equations.factors, rotors, V, C, equations.fall, low, high)
    symbols = ca.vertcat(*states, *physics, K, play, D, C_links)
    return kernel_of_tick(new_state, symbols, 4 * count, torques)
