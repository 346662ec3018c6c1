"""What a link weighs in formats that cannot leave a mass out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.core.findings import Finding
from twin.model.mechanism import Body, Inertia, Mechanism

DENSITY = 1000.0
"""kg/m3 of a body that nobody weighed: its bounding box full of water."""

LEAST = 1e-3
"""kg and, as the side of a cube in tens of metres, size: less makes engines refuse the body."""


def inertia_of(body: Body) -> Inertia:
    """Return the body's inertia or, if it is unknown, that of its bounding box full of water."""
    if body.inertia is not None:
        return body.inertia
    corners = [m.vertices.min(axis=0) for m in body.meshes] + [m.vertices.max(axis=0) for m in body.meshes]
    low, high = (np.min(corners, axis=0), np.max(corners, axis=0)) if corners else (np.zeros(3), np.zeros(3))
    sides = np.maximum(high - low, 0.01)
    mass = max(DENSITY * float(np.prod(sides)), LEAST)
    return Inertia(mass, 0.5 * (low + high), np.diag(mass / 12 * (np.sum(sides**2) - sides**2)))


def unweighed(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield findings that name the bodies whose mass `inertia_of` had to make up; the base needs none."""
    unknown = [b for b in mechanism.bodies if b.inertia is None and b.name != mechanism.base]
    for names, given in (
        ([b.name for b in unknown if b.meshes], "its bounding box full of water"),
        ([b.name for b in unknown if not b.meshes], f"{LEAST * 1000:g} g, since it has no shape either"),
    ):
        if names:
            yield Finding(
                "export.mass_unknown",
                "warning",
                f"{file}: no mass is known of {', '.join(names)}; the file assumes {given}, because the format wants "
                "a mass",
                where=", ".join(names),
                suggestion="give them a mass or their parts a density in the robot's description, or join them rigidly "
                "to a body that has one",
            )
