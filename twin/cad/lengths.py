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

_PARALLEL_SINE = 1e-3
"""Maximum sine of the angle between the axes of a declared length."""

_ALIGNED_SINE = 0.02
"""Maximum sine of the angle between two directions that count as parallel in `angle_and_distance`."""


@dataclass(frozen=True)
class Length:
    """A measured length.

    `between` are two features of `body`; `parameter` is the name of the length in the equations; `value` is in m.
    """

    body: str
    between: tuple[str, str]
    parameter: str
    value: float


def measured_lengths(cad: CadModel) -> tuple[Length, ...]:
    """Return the measured values of the lengths that the description declares.

    Raises:
        CadError: two axes are not parallel, so that their distance is undefined.
    """
    lengths = []
    for spec in cad.description.length:
        first, second = spec.between
        features = cad.measured[spec.body]
        distance = _distance(spec.body, features[first], features[second])
        lengths.append(Length(spec.body, spec.between, spec.parameter, distance))
    return tuple(lengths)


def _distance(body: str, first: MeasuredFeature, second: MeasuredFeature) -> float:
    """Return the distance in m between two faces: of a sphere, the centre is used; of a cylinder, the axis."""
    angle, distance = angle_and_distance(first, second)
    tilt = np.sin(angle)
    if {first.face.kind, second.face.kind} == {"plane", "cylinder"}:
        tilt = np.cos(angle)  # the direction of a plane is its normal
    if tilt > _PARALLEL_SINE:
        text = f"'{first.name}' and '{second.name}' are not parallel, so that their distance is undefined"
        raise CadError(f"length on '{body}': {text}")
    return distance


def angle_and_distance(first: MeasuredFeature, second: MeasuredFeature) -> tuple[float, float]:
    """Return (angle in rad, distance in m) between two faces; an undefined value is NaN."""
    offset = second.face.point - first.face.point
    kinds = {first.face.kind, second.face.kind}
    if "sphere" in kinds:
        return np.nan, _from_centre(first, second)
    cross = np.cross(first.direction, second.direction)
    sine = float(np.linalg.norm(cross))
    cosine = abs(float(first.direction @ second.direction))
    angle = float(np.arctan2(sine, cosine))
    if kinds == {"plane", "cylinder"}:
        # The axis must lie along the plane: a distance of an axis that meets the plane is undefined.
        if not cosine < _ALIGNED_SINE:
            return angle, np.nan
        plane = first if first.face.kind == "plane" else second
        return angle, abs(float(offset @ plane.direction))
    if kinds == {"plane"}:
        if not sine < _ALIGNED_SINE:
            return angle, np.nan
        return angle, abs(float(offset @ first.direction))
    if sine < _ALIGNED_SINE:
        return angle, float(spatial.point_to_line(second.face.point, first.face.point, first.direction))
    return angle, abs(float(offset @ cross)) / sine  # between skew axes, along their common normal


def _from_centre(first: MeasuredFeature, second: MeasuredFeature) -> float:
    """Return the distance in m between two faces of which one at least is a sphere: from its centre."""
    offset = second.face.point - first.face.point
    sphere = first
    other_face = second
    if second.face.kind == "sphere":
        sphere = second
        other_face = first
    if other_face.face.kind == "sphere":
        return float(np.linalg.norm(offset))
    if other_face.face.kind == "plane":
        return abs(float(offset @ other_face.direction))
    return float(spatial.point_to_line(sphere.face.point, other_face.face.point, other_face.direction))
