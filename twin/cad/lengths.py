"""Lengths within one body that are also parameters of the equations, measured between two faces of the body.

If a pin is misplaced, the two sides of a joint do not meet; these lengths show which of the two bodies is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.cad.build import CadModel
from twin.cad.features import Measured
from twin.core import spatial
from twin.core.errors import CadError

_PARALLEL = 1e-3
"""Maximum sine of the angle between two axes that count as parallel."""


@dataclass(frozen=True)
class Length:
    """A measured length.

    `body` has both features `between`; `parameter` is the name of the length in the equations; `value` is in m.
    """

    body: str
    between: tuple[str, str]
    parameter: str
    value: float


def measure(cad: CadModel) -> tuple[Length, ...]:
    """Return the lengths that the description declares.

    Raises:
        CadError: two axes are not parallel, so that their distance is undefined.
    """
    out = []
    for spec in cad.description.length:
        a, b = (cad.measured[spec.body][name] for name in spec.between)
        out.append(Length(spec.body, spec.between, spec.parameter, _distance(spec.body, a, b)))
    return tuple(out)


def _distance(body: str, a: Measured, b: Measured) -> float:
    """Return the distance in m between two faces: points (spheres), axes (cylinders) or planes."""
    if b.face.kind == "plane" and a.face.kind != "plane":
        a, b = b, a
    offset = b.face.point - a.face.point
    if "sphere" not in (a.face.kind, b.face.kind):
        aligned = a.face.kind == b.face.kind  # two axes, or two normals; otherwise an axis and a plane
        sine = float(np.linalg.norm(np.cross(a.direction, b.direction)))
        if (sine if aligned else abs(float(a.direction @ b.direction))) > _PARALLEL:
            raise CadError(
                f"length on '{body}': '{a.name}' and '{b.name}' are not parallel, so that their distance is undefined"
            )
    if a.face.kind == "plane":
        return abs(float(offset @ a.direction))
    if a.face.kind == "sphere" and b.face.kind == "sphere":
        return float(np.linalg.norm(offset))
    line, point = (a, b) if a.face.kind == "cylinder" else (b, a)
    return float(spatial.point_to_line(point.face.point, line.face.point, line.direction))
