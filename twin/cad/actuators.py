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
    known: set[str] = set()
    for spec in d.transmission:
        known.update(spec.variants)
    if variant and variant not in known:
        raise MechanismError(f"{d.name}: {unknown('variant of a transmission', variant, sorted(known))}")
    built = []
    for spec in d.transmission:
        matrix = spec.variants[variant].matrix if variant in spec.variants else spec.matrix
        built.append(Transmission(spec.name, tuple(spec.joints), tuple(spec.actuators), np.array(matrix, float)))
    return tuple(built)


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
