"""Assume masses of links without a stated mass, for formats that require a mass."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.findings import Finding, info, warning
from twin.model.body import Body
from twin.model.inertia import Inertia
from twin.model.mechanism import Mechanism

DENSITY = 1000.0
"""Density of water in kg/m3, assumed for the bounding box of a body without a stated mass."""

MIN_MASS = 1e-3
"""Minimum assumed mass in kg: simulators reject smaller masses."""

_MIN_SIDE = 0.01
"""Minimum side in m of a bounding box: a flat or missing shape would have no volume, and so no mass."""

_MASS_WITHOUT_SHAPE = max(DENSITY * _MIN_SIDE**3, MIN_MASS)
"""Mass in kg that is assumed for a body without a shape: a cube with sides `_MIN_SIDE`."""


def inertia_of(body: Body) -> Inertia:
    """Return the stated inertia of a body; if none is stated, the inertia of the bounding box filled with water."""
    if body.inertia is not None:
        return body.inertia
    low = np.zeros(3)
    high = np.zeros(3)
    if body.meshes:
        vertices = np.concatenate([mesh.vertices for mesh in body.meshes])
        low = vertices.min(axis=0)
        high = vertices.max(axis=0)
    sides = np.maximum(high - low, _MIN_SIDE)
    mass = max(DENSITY * float(np.prod(sides)), MIN_MASS)
    # A box with sides a, b, c has the moments m / 12 (b2 + c2), m / 12 (a2 + c2), m / 12 (a2 + b2).
    moments = mass / 12 * (np.sum(sides**2) - sides**2)
    return Inertia(mass, 0.5 * (low + high), np.diag(moments))


def partly_shown(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield a finding on bodies whose meshes do not show the whole body, so that its mass cannot be judged by them."""
    partial = []
    for body in mechanism.bodies:
        if body.meshes and not body.whole:
            partial.append(body.name)
    names = ", ".join(partial)
    if names:
        text = (
            f"{file}: the shapes of {names} are for display, or lack shapes that the import left out; masses are not "
            "judged by them"
        )
        yield info("export.partly_shown", names, text)


def unweighed(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield findings on bodies without a stated mass, except the base; `inertia_of` assumes masses for these bodies."""
    with_shape = []
    without_shape = []
    for body in mechanism.bodies:
        if body.inertia is None and body.name != mechanism.base:
            if body.meshes:
                with_shape.append(body.name)
            else:
                without_shape.append(body.name)
    for names, assumed in (
        (", ".join(with_shape), "its bounding box filled with water"),
        (", ".join(without_shape), f"{_MASS_WITHOUT_SHAPE * 1000:g} g, because it has no shape"),
    ):
        if names:
            text = f"{file}: the mass of {names} is unknown, but the format requires one; the file assumes {assumed}"
            advice = "state a mass or the density of the parts, or fix the body to a body with mass"
            yield warning("export.mass_unknown", names, text, suggestion=advice)
