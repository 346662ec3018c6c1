"""The actuators and transmissions of a description, converted to SI."""

from __future__ import annotations

import numpy as np

from twin.cad.description import ActuatorSpec, Description
from twin.core.errors import MechanismError, unknown
from twin.core.units import DEG, MM
from twin.model.transmission import Actuator, Transmission


def actuators(d: Description) -> tuple[Actuator, ...]:
    """Return the motors of a description, with limits in SI units."""
    return tuple(map(_actuator, d.actuator))


def transmissions(d: Description, variant: str = "") -> tuple[Transmission, ...]:
    """Return the transmissions of a description; a transmission with a matrix named `variant` uses that matrix.

    Raises:
        MechanismError: no transmission has this variant.
    """
    known = sorted({name for t in d.transmission for name in t.variants})
    if variant and variant not in known:
        raise MechanismError(f"{d.name}: {unknown('variant of a transmission', variant, known)}")
    matrices = [t.variants[variant].matrix if variant in t.variants else t.matrix for t in d.transmission]
    return tuple(
        Transmission(t.name, tuple(t.joints), tuple(t.actuators), np.array(matrix, float))
        for t, matrix in zip(d.transmission, matrices, strict=True)
    )


def _actuator(a: ActuatorSpec) -> Actuator:
    unit = DEG if a.kind == "angle" else MM
    return Actuator(
        a.name,
        a.kind,
        a.limits and (a.limits[0] * unit, a.limits[1] * unit),
        a.max_speed and a.max_speed * unit,
        a.max_effort,
        a.rotor_inertia,
        a.stiffness,
        a.damping,
    )
