"""Rules for what was read, in any format: open loops, limits without zero, masses that do not fit a link's shape."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twin.checking.check_finding import CheckFinding
from twin.core.quantity import mm
from twin.exchange.read.imported_robot import Imported
from twin.model.body import Body
from twin.model.mechanism import Mechanism

_SMALLEST_SHAPE = 0.01
"""Diagonal in m of the box of a link, from which its masses are compared with it; smaller shapes are markers."""

_SMALLEST_WEIGHED_SHAPE = 0.05
"""Diagonal in m from which the mass is compared: authors draw cubes of 1 cm for cameras, and balls for points."""

_MAX_CENTRE_DISTANCE = 1.0
"""Distance of a centre of mass from the box of its link, in diagonals of the box, from which it is implausible."""

_MAX_GYRATION_RADIUS = 2.0
"""Largest radius of gyration in diagonals of the box; 0.5 is the limit for a body inside the box."""

_MIN_GYRATION_RADIUS = 1e-3
"""Smallest radius of gyration in diagonals of the box; a solid cube has 0.24."""

_MIN_EDGE = 0.05
"""Smallest edge of the box that counts, in diagonals: the shape of a sheet may have no thickness."""

_MAX_DENSITY = 23_000.0
"""Density in kg/m3 of the box of a link; that of osmium, the densest metal, is 22 590."""


def check_open_loops(imported: Imported, file: str) -> Iterator[CheckFinding]:
    """Yield the loops that stay open, as the closing of the import tells them."""
    for finding in imported.findings:
        if finding.code == "import.gap":
            yield CheckFinding("loops/open", file, f"loop '{finding.where}'", finding.message)


def check_limits_contain_zero(mechanism: Mechanism, file: str) -> Iterator[CheckFinding]:
    """Yield the joints whose limits exclude zero."""
    for joint in mechanism.active:
        if joint.limits is None:
            continue
        low, high = joint.limits
        if low > 0 or high < 0:
            unit = "rad" if joint.is_angle else "m"
            text = f"joint '{joint.name}': limits {low:g} .. {high:g} {unit}: 0 is outside"
            yield CheckFinding("limits/zero", file, f"joint '{joint.name}'", text)


def check_masses(mechanism: Mechanism, file: str) -> Iterator[CheckFinding]:
    """Yield centres, moments and densities that do not fit the box around the shapes of a link."""
    for body in mechanism.bodies:
        box = _box(body)
        inertia = body.inertia
        if box is None or inertia is None or inertia.mass <= 0:  # other rules name masses that are not positive
            continue
        low, high = box
        diagonal = float(np.linalg.norm(high - low))
        if diagonal < _SMALLEST_SHAPE:
            continue
        subject = f"link '{body.name}'"
        centre = inertia.p_body_com
        outside = np.maximum(np.maximum(low - centre, centre - high), 0.0)
        distance = float(np.linalg.norm(outside))
        if distance > _MAX_CENTRE_DISTANCE * diagonal:
            text = f"{subject}: the centre of mass is {mm(distance)} outside of its shape of {mm(diagonal)}"
            yield CheckFinding("inertia/centre", file, subject, text)
        # the eigenvalues are in ascending order
        largest = float(np.linalg.eigvalsh(inertia.I_com)[-1])
        radius = float(np.sqrt(max(largest, 0.0) / inertia.mass))
        if radius > _MAX_GYRATION_RADIUS * diagonal or radius < _MIN_GYRATION_RADIUS * diagonal:
            text = f"{subject}: the radius of gyration is {mm(radius)}, the size of its shape {mm(diagonal)}"
            yield CheckFinding("inertia/size", file, subject, text)
        edges = np.maximum(high - low, _MIN_EDGE * diagonal)
        density = inertia.mass / float(np.prod(edges))
        if density > _MAX_DENSITY and diagonal >= _SMALLEST_WEIGHED_SHAPE:
            text = f"{subject}: {inertia.mass:g} kg in a box of {density:,.0f} kg/m3 (limit {_MAX_DENSITY:,.0f})"
            yield CheckFinding("inertia/density", file, subject, text)


def _box(body: Body) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the corners (3,) in m of the box around a body's shapes, in its frame; None if they do not show it."""
    if not body.meshes or not body.whole:
        return None
    lows: list[np.ndarray] = []
    highs: list[np.ndarray] = []
    for mesh in body.meshes:
        if len(mesh.vertices):
            lows.append(mesh.vertices.min(axis=0))
            highs.append(mesh.vertices.max(axis=0))
    if not lows:
        return None
    return np.min(lows, axis=0), np.max(highs, axis=0)
