"""Lengths measured between two faces of one body that are also parameters of the equations.

If a pin is misplaced, the two frames of its joint do not coincide; these lengths show which of the two bodies is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.cad.build import CadModel
from twin.cad.features import MeasuredFeature
from twin.core import spatial
from twin.core.errors import CadError

_PARALLEL = 1e-3
"""Maximum sine of the angle between the axes of a declared length."""

_ALIGNED = 0.02
"""Maximum sine of the angle between two directions that count as parallel in `pair`."""


@dataclass(frozen=True)
class Length:
    """A measured length.

    `between` are two features of `body`; `parameter` is the name of the length in the equations; `value` is in m.
    """

    body: str
    between: tuple[str, str]
    parameter: str
    value: float


def measure(cad: CadModel) -> tuple[Length, ...]:
    """Return the measured values of the lengths that the description declares.

    Raises:
        CadError: two axes are not parallel, so that their distance is undefined.
    """
    lengths = []
    for spec in cad.description.length:
        first, second = spec.between
        own = cad.measured[spec.body]
        distance = _distance(spec.body, own[first], own[second])
        lengths.append(Length(spec.body, spec.between, spec.parameter, distance))
    return tuple(lengths)


def _distance(body: str, a: MeasuredFeature, b: MeasuredFeature) -> float:
    """Return the distance in m between two faces: of a sphere, the centre is used; of a cylinder, the axis."""
    angle, distance = pair(a, b)
    tilt = np.sin(angle)
    if {a.face.kind, b.face.kind} == {"plane", "cylinder"}:
        tilt = np.cos(angle)  # the direction of a plane is its normal
    if tilt > _PARALLEL:
        raise CadError(
            f"length on '{body}': '{a.name}' and '{b.name}' are not parallel, so that their distance is undefined"
        )
    return distance


def pair(a: MeasuredFeature, b: MeasuredFeature) -> tuple[float, float]:
    """Return (angle in rad, distance in m) between two faces; an undefined value is NaN."""
    offset = b.face.point - a.face.point
    kinds = {a.face.kind, b.face.kind}
    if "sphere" in kinds:
        return np.nan, _from_centre(a, b)
    cross = np.cross(a.direction, b.direction)
    sine = float(np.linalg.norm(cross))
    cosine = abs(float(a.direction @ b.direction))
    angle = float(np.arctan2(sine, cosine))
    if kinds == {"plane", "cylinder"}:
        if not cosine < _ALIGNED:
            return angle, np.nan
        plane = a if a.face.kind == "plane" else b
        return angle, abs(float(offset @ plane.direction))
    if kinds == {"plane"}:
        if not sine < _ALIGNED:
            return angle, np.nan
        return angle, abs(float(offset @ a.direction))
    if sine < _ALIGNED:
        return angle, float(spatial.point_to_line(b.face.point, a.face.point, a.direction))
    return angle, abs(float(offset @ cross)) / sine  # between skew axes, along their common normal


def _from_centre(a: MeasuredFeature, b: MeasuredFeature) -> float:
    """Return the distance in m between two faces of which one at least is a sphere: from its centre."""
    offset = b.face.point - a.face.point
    sphere = a
    other = b
    if b.face.kind == "sphere":
        sphere = b
        other = a
    if other.face.kind == "sphere":
        return float(np.linalg.norm(offset))
    if other.face.kind == "plane":
        return abs(float(offset @ other.direction))
    return float(spatial.point_to_line(sphere.face.point, other.face.point, other.direction))
