"""Name a face in a description: the `Feature` by which `features.find` finds this face again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.cad.description import CadTolerance, Feature
from twin.cad.features import find
from twin.cad.step import MEASURED, Face, Part
from twin.core.errors import CadError
from twin.core.spatial import Array
from twin.core.units import MM

_SAME_GEOMETRY = 1e-9
"""Difference in m of points, and between components of directions, up to which two faces have the same geometry."""


def feature_of(face: Face, towards: Array, part: str | None) -> Feature:
    """Return the feature that names a face.

    Args:
        face: face of a kind of `MEASURED`.
        towards: (3,) the feature's direction is that of the face, with the sign that points to this side.
        part: name of the part of the face; None: a face of any part of the body.
    """
    signed_direction = face.direction
    if face.direction @ towards < 0:
        signed_direction = -face.direction
    # Rounded, because a feature is only searched for at its place; the measured face has all digits.
    x, y, z = (np.round(signed_direction, 9) + 0.0).tolist()  # + 0.0 turns -0.0 into 0.0
    near_x, near_y, near_z = (np.round(face.point / MM, 4) + 0.0).tolist()
    stated_direction: tuple[float, float, float] | None = None
    if any((x, y, z)):  # a sphere has no direction
        stated_direction = (x, y, z)
    radius: float | None = None
    if face.radius:
        radius = round(face.radius / MM, 6)
    return Feature(
        kind=face.kind,  # pyright: ignore[reportArgumentType] - a face's kind is one of these
        near_mm=(near_x, near_y, near_z),
        direction=stated_direction,
        radius_mm=radius,
        part=part,
    )


def naming_feature(
    body: str, face: Face, towards: Array, part: str, parts: Sequence[Part], tolerance: CadTolerance
) -> Feature:
    """Return a feature by which `find` finds a face among the parts of its body, or one with the same geometry.

    The name of the part is in the feature only if the face is not found without it. `towards` is as in `feature_of`.

    Raises:
        CadError: the face is of a kind that a description cannot name, or another face is found in its place.
    """
    if face.kind not in MEASURED:
        raise CadError(f"a {face.kind} cannot be named: a description names planes, cylinders and spheres")
    reason = "another face of its body has the same kind and radius at the same place"
    for part_name in (None, part):
        spec = feature_of(face, towards, part_name)
        try:
            measured_feature = find(body, "picked", spec, parts, tolerance)
        except CadError as error:
            reason = str(error)
            continue
        if measured_feature.face is face or _is_alike(measured_feature.face, face):
            return spec
    raise CadError(f"the {face.kind} on '{part}' of body '{body}' cannot be named: {reason}")


def _is_alike(first: Face, second: Face) -> bool:
    """Return whether two faces of one kind have the same point, radius and axis: either gives the same frame."""
    if (
        float(np.abs(first.point - second.point).max()) > _SAME_GEOMETRY
        or abs(first.radius - second.radius) > _SAME_GEOMETRY
    ):
        return False
    return float(np.abs(np.cross(first.direction, second.direction)).max()) <= _SAME_GEOMETRY
