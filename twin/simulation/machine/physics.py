"""Parameters of a simulated plant: masses, rotors, friction, gravity and hard stops; duration of its ticks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.core.spatial import Array
from twin.simulation.dynamics.arm import Arm

TICK = 1e-3
"""Duration in s of a tick of machine, model and control software."""

_LEAST_MASS_FACTOR = 1e-3
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
        return replace(
            self,
            factors=mass * self.factors,
            viscous=friction * self.viscous,
            coulomb=friction * self.coulomb,
            fall=spatial.exp_so3([-tilt, 0.0, 0.0]) @ self.fall,
        )

    def checked(self, arm: Arm) -> Array:
        """Return all parameters as one vector, in the order of the attributes; the compiled ticks read this order.

        Raises:
            MechanismError: a number is not finite (hard stops: NaN), a mass factor is below 0.001, a friction or rotor
                inertia is negative, a shape is wrong, or a minimum of the hard stops is above the maximum.
        """
        active_names = [joint.name for joint in arm.mechanism.active]
        tree_names = [joint.name for joint in arm.mechanism.tree]
        limited = {
            "factor of the mass": (tree_names, self.factors, _LEAST_MASS_FACTOR),
            "rotor inertia": (active_names, self.rotors, 0.0),
            "viscous friction": (active_names, self.viscous, 0.0),
            "Coulomb friction": (active_names, self.coulomb, 0.0),
        }
        for quantity, (names, values, least) in limited.items():
            if np.shape(values) != (len(names),):
                raise MechanismError(
                    f"plant: the {quantity} has shape {np.shape(values)}; it must have shape ({len(names)},)"
                )
            for name, value in zip(names, values, strict=True):
                if not (np.isfinite(value) and value >= least):
                    raise MechanismError(f"plant: the {quantity} of {name} is {value:g}; it must be at least {least:g}")
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
