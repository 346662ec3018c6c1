"""The actuators and transmissions of a description, converted to SI."""

from __future__ import annotations

import numpy as np

from twin.cad.description import ActuatorSpec, Description
from twin.core.units import DEG, MM
from twin.model.transmission import Actuator, Transmission


def actuators(d: Description) -> tuple[Actuator, ...]:
    """Return the motors of a description, with limits in SI units."""
    return tuple(map(_actuator, d.actuator))


def transmissions(d: Description) -> tuple[Transmission, ...]:
    """Return the transmissions of a description."""
    return tuple(
        Transmission(t.name, tuple(t.joints), tuple(t.actuators), np.array(t.matrix, float)) for t in d.transmission
    )


def _actuator(a: ActuatorSpec) -> Actuator:
    unit = DEG if a.kind == "angle" else MM
    limits, speed = a.limits_deg or a.limits_mm, a.max_speed_deg_s or a.max_speed_mm_s
    return Actuator(
        a.name,
        a.kind,
        limits and (limits[0] * unit, limits[1] * unit),
        speed and speed * unit,
        a.max_effort,
        a.rotor_inertia,
        a.stiffness,
        a.damping,
    )
