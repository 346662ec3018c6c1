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

LEAST = 1e-3
"""Minimum assumed mass in kg: simulators reject smaller masses."""


def inertia_of(body: Body) -> Inertia:
    """Return the stated inertia of a body; if none is stated, the inertia of the bounding box filled with water."""
    if body.inertia is not None:
        return body.inertia
    corners = [m.vertices.min(axis=0) for m in body.meshes] + [m.vertices.max(axis=0) for m in body.meshes]
    low, high = (np.min(corners, axis=0), np.max(corners, axis=0)) if corners else (np.zeros(3), np.zeros(3))
    sides = np.maximum(high - low, 0.01)
    mass = max(DENSITY * float(np.prod(sides)), LEAST)
    return Inertia(mass, 0.5 * (low + high), np.diag(mass / 12 * (np.sum(sides**2) - sides**2)))


def partly_shown(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield a finding on bodies whose meshes do not show the whole body, so that its mass cannot be judged by them."""
    names = ", ".join(b.name for b in mechanism.bodies if b.meshes and not b.whole)
    if names:
        text = (
            f"{file}: the shapes of {names} are for display, or lack shapes that the import left out; masses are not "
            "judged by them"
        )
        yield info("export.partly_shown", names, text)


def unweighed(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield findings on bodies without a stated mass, except the base; `inertia_of` assumes masses for these bodies."""
    unknown = [b for b in mechanism.bodies if b.inertia is None and b.name != mechanism.base]
    for names, given in (
        ([b.name for b in unknown if b.meshes], "its bounding box filled with water"),
        ([b.name for b in unknown if not b.meshes], f"{LEAST * 1000:g} g, because it has no shape"),
    ):
        if names:
            yield warning(
                "export.mass_unknown",
                ", ".join(names),
                f"{file}: the mass of {', '.join(names)} is unknown, but the format requires one; the file assumes "
                f"{given}",
                suggestion="state a mass or the density of the parts, or fix the body to a body with mass",
            )
