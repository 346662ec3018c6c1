"""The actuators and transmissions of a description, converted to SI."""

from __future__ import annotations

import numpy as np

from twin.cad.description import ActuatorSpec, Description
from twin.core.errors import MechanismError, unknown
from twin.core.units import DEG, MM
from twin.model.transmission import Actuator, Transmission


def actuators(description: Description) -> tuple[Actuator, ...]:
    """Return the motors of a description, with limits in SI units."""
    return tuple(map(_actuator, description.actuator))


def transmissions(description: Description, variant: str = "") -> tuple[Transmission, ...]:
    """Return the transmissions of a description; a transmission with a matrix named `variant` uses that matrix.

    Raises:
        MechanismError: no transmission has this variant.
    """
    variants: set[str] = set()
    for spec in description.transmission:
        variants.update(spec.variants)
    if variant and variant not in variants:
        raise MechanismError(f"{description.name}: {unknown('variant of a transmission', variant, sorted(variants))}")
    built = []
    for spec in description.transmission:
        matrix = spec.matrix
        # A variant may concern some of the transmissions only; the others keep their own matrix.
        if variant in spec.variants:
            matrix = spec.variants[variant].matrix
        built.append(Transmission(spec.name, tuple(spec.joints), tuple(spec.actuators), np.array(matrix, float)))
    return tuple(built)


def _actuator(spec: ActuatorSpec) -> Actuator:
    unit = DEG if spec.kind == "angle" else MM
    limits: tuple[float, float] | None = None
    if spec.limits is not None:
        low, high = spec.limits
        limits = (low * unit, high * unit)
    max_speed: float | None = None
    if spec.max_speed is not None:
        max_speed = spec.max_speed * unit
    return Actuator(
        spec.name,
        spec.kind,
        limits,
        max_speed,
        spec.max_effort,
        spec.rotor_inertia,
        spec.stiffness,
        spec.damping,
    )
