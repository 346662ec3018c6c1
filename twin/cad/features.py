"""Measure on the CAD: find the face of each feature, and compute frames from faces.

All results are in drawn coordinates (coordinates of the STEP file), in m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.cad.description import CadTolerance, Feature, FrameSpec, NamedPoint
from twin.cad.step import Face, Part
from twin.core import spatial
from twin.core.errors import CadError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_RADIUS_TOLERANCE = 0.005 * MM
"""Difference of radii in m above which a face does not match a feature's radius."""

_EQUALLY_NEAR = 0.001 * MM
"""Two faces are equally near to `near_mm` if their distances differ by less than this value in m."""

_PARALLEL_SINE = 1e-6
"""Maximum sine of the angle between the directions of two faces with one plane or axis."""

_WEIGHT_ALONG = 1e-3
"""Weight of the distance along a plane or an axis, which has no ends of its own."""

_NO_DIRECTION = 1e-12
"""Length of a direction (of a cross product in m2) up to which it is none: the points are on one line."""

_SMALLEST_CROSSING_SINE = 0.1
"""Minimum sine of the angle at which an axis meets a plane or passes another axis at a definite point."""

_LENGTH_OF_RADIAN = 10 * MM
"""Length in m that counts as much as a tilt of 1 rad in a message about the nearest face."""

_MAX_LISTED_RADII = 12
"""Largest number of radii of other faces that a message lists."""


@dataclass(frozen=True)
class MeasuredFeature:
    """A measured feature: its face, its unit direction with the sign of the description, and the name of its part."""

    name: str
    face: Face
    direction: Array
    part: str


class _Candidate(NamedTuple):
    """A face with the kind and radius of a feature: its distance in m and its tilt in rad, and the name of its part."""

    distance: float
    tilt: float
    face: Face
    part: str


def find(body: str, name: str, spec: Feature, parts: Sequence[Part], tolerance: CadTolerance) -> MeasuredFeature:
    """Return the face of a body that `spec` identifies.

    Among the faces of the body with the kind and radius of `spec`, the face nearest to `spec.near_mm` is returned.

    Raises:
        CadError: the body has no face of this kind and radius, or no such face is within the gross tolerance; the
            message gives the nearest face and its distance.
    """
    label = f"feature '{name}' of body '{body}'"
    if spec.part is not None:
        parts_of_name = [part for part in parts if part.name == spec.part]
        if not parts_of_name:
            raise CadError(f"{label}: {unknown('part', spec.part, [part.name for part in parts])}")
        parts = parts_of_name
    near_point = np.array(spec.near_mm) * MM
    candidates = _candidates(label, spec, parts, near_point)
    best = _nearest(label, spec, candidates, tolerance)
    direction = best.face.direction
    # CAD programs choose the sign of a face's axis freely: that of the description counts.
    if spec.direction is not None and direction @ np.array(spec.direction) < 0:
        direction = -direction
    return MeasuredFeature(name, best.face, direction, best.part)


def _candidates(label: str, spec: Feature, parts: Sequence[Part], near_point: Array) -> list[_Candidate]:
    """Return the faces of the kind and radius of `spec`, with their distances from `near_point` (3,) in m.

    Raises:
        CadError: there is none; the message begins with `label` and names the radii of the other faces.
    """
    stated_direction = None
    if spec.direction is not None:
        stated_direction = (np.array(spec.direction) / np.linalg.norm(spec.direction)).tolist()
    candidates: list[_Candidate] = []
    other_radii: list[float] = []
    for part in parts:
        for face in part.faces:
            if face.kind != spec.kind:
                continue
            if spec.radius_mm is not None and abs(face.radius - spec.radius_mm * MM) > _RADIUS_TOLERANCE:
                other_radii.append(face.radius / MM)
                continue
            tilt = 0.0
            if stated_direction is not None:
                tilt = _tilt(stated_direction, face.direction.tolist())
            candidates.append(_Candidate(_distance(face, near_point), tilt, face, part.name))
    if candidates:
        return candidates
    text = f"{label}: the body has no {spec.kind}"
    if spec.radius_mm:
        text += f" of radius {spec.radius_mm:g} mm"
    if other_radii:
        different = sorted(set(np.round(other_radii, 4)))
        radii = ", ".join(map("{:g}".format, different[:_MAX_LISTED_RADII]))
        text += f"; radii found: {radii} mm"
    raise CadError(text)


def _nearest(label: str, spec: Feature, candidates: Sequence[_Candidate], tolerance: CadTolerance) -> _Candidate:
    """Return the nearest candidate within the gross tolerance.

    Raises:
        CadError: none is within the tolerance, or two different faces are equally near; `label` begins the message.
    """
    near_enough = []
    for candidate in candidates:
        if candidate.distance <= tolerance.gross_mm * MM and candidate.tilt <= tolerance.gross_deg * DEG:
            near_enough.append(candidate)
    if not near_enough:
        nearest = min(candidates, key=lambda candidate: candidate.distance + candidate.tilt * _LENGTH_OF_RADIAN)
        raise CadError(
            f"{label}: the nearest {spec.kind} (on '{nearest.part}', at {_mm_text(nearest.face.point)} mm) is "
            f"{nearest.distance / MM:.3f} mm and {nearest.tilt / DEG:.2f}° away; gross tolerance "
            f"{tolerance.gross_mm:g} mm, {tolerance.gross_deg:g}°. Correct near_mm, the drawing, or tolerance.gross_mm."
        )
    best, *others = sorted(near_enough, key=lambda candidate: candidate.distance)
    for other in others:
        if other.distance - best.distance < _EQUALLY_NEAR and not _are_same(best.face, other.face):
            place = f"'{best.part}' at {_mm_text(best.face.point)} mm"
            other_place = f"'{other.part}' at {_mm_text(other.face.point)} mm"
            raise CadError(
                f"{label}: two {spec.kind} faces are equally near, on {place} and on {other_place}. Move near_mm "
                "towards the intended face, or name its `part`."
            )
    return best


def _tilt(first: Sequence[float], second: Sequence[float]) -> float:
    """Return the angle in rad between two axes (3,), ignoring their signs."""
    # Plain numbers: numpy is slower for vectors of three, and a STEP file has thousands of faces.
    ax, ay, az = first
    bx, by, bz = second
    sine = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    cosine = ax * bx + ay * by + az * bz
    return math.atan2(sine, abs(cosine))


def _are_same(first: Face, second: Face) -> bool:
    """Return whether two faces of one kind have the same plane, axis or centre."""
    if first.kind == "sphere":
        return float(np.linalg.norm(first.point - second.point)) < _EQUALLY_NEAR
    if float(np.linalg.norm(np.cross(first.direction, second.direction))) > _PARALLEL_SINE:
        return False
    if first.kind == "plane":
        return abs(float((first.point - second.point) @ first.direction)) < _EQUALLY_NEAR
    return float(spatial.point_to_line(second.point, first.point, first.direction)) < _EQUALLY_NEAR


def _distance(face: Face, near_point: Array) -> float:
    """Return the distance in m from `near_point` to a sphere's centre, a cylinder's axis, or a plane.

    For planes and cylinders, the distance from `near_point` to the middle of the face, measured along the plane or
    axis, is added with the weight `_WEIGHT_ALONG`. As a result, the nearer of two bores on one axis is chosen.
    """
    x, y, z = (near_point - face.point).tolist()
    if face.kind == "sphere":
        return math.hypot(x, y, z)
    a, b, c = face.direction.tolist()
    along = x * a + y * b + z * c
    across = math.hypot(x - along * a, y - along * b, z - along * c)
    if face.kind == "plane":
        return abs(along) + _WEIGHT_ALONG * across
    return across + _WEIGHT_ALONG * abs(along)


def centre(names: str | list[str], features: Mapping[str, MeasuredFeature], at: str | None = None) -> Array:
    """Return the point (3,) in m of a feature, or the centroid of several features.

    The feature `at` selects the point on the axis of a cylinder: the intersection of the axis with a plane, or the
    point nearest to another axis or to a sphere centre.
    """
    if isinstance(names, list):
        return np.mean([centre(name, features) for name in names], axis=0)
    feature = _feature(names, features)
    face = feature.face
    if at is None or face.kind != "cylinder":
        return face.point
    other_face = _feature(at, features).face
    axis = face.direction
    if other_face.kind == "plane":
        slope = axis @ other_face.direction
        if abs(slope) < _SMALLEST_CROSSING_SINE:
            raise CadError(
                f"the axis of '{names}' does not meet the plane '{at}', because they are parallel; name another `at`"
            )
        return face.point + axis * ((other_face.point - face.point) @ other_face.direction) / slope
    if other_face.kind == "sphere":
        return face.point + axis * (axis @ (other_face.point - face.point))
    other_axis = other_face.direction
    across = other_axis - axis * (axis @ other_axis)
    if np.linalg.norm(across) < _SMALLEST_CROSSING_SINE:
        raise CadError(f"the axes of '{names}' and '{at}' are parallel: no point is nearest; name another `at`")
    # Nearest point to a second line: move along the axis until the connecting vector is perpendicular to both lines.
    to_other = other_face.point - face.point
    cosine = axis @ other_axis
    numerator = (to_other @ axis) - (to_other @ other_axis) * cosine
    return face.point + axis * numerator / (1 - cosine**2)


def point(spec: NamedPoint, features: Mapping[str, MeasuredFeature]) -> Array:
    """Return a named point (3,) in m."""
    if spec.position_mm is not None:
        return np.array(spec.position_mm) * MM
    assert spec.origin is not None
    return centre(spec.origin, features, spec.at)


def frame(spec: FrameSpec, features: Mapping[str, MeasuredFeature]) -> Array:
    """Return the frame (4, 4) that a spec defines.

    Raises:
        CadError: a feature is unknown, or the directions do not define a frame.
    """
    psi, theta, phi = np.array(spec.angles_deg or (0.0, 0.0, 0.0)) * DEG
    ex, ey, ez = np.eye(3)
    R_stated = spatial.exp_so3(psi * ez) @ spatial.exp_so3(theta * ey) @ spatial.exp_so3(phi * ex)
    if spec.position_mm is not None:
        return spatial.pose(R_stated, np.array(spec.position_mm) * MM)
    assert spec.origin is not None
    R = R_stated
    p = centre(spec.origin, features, spec.at)
    if spec.z is not None:
        R = _measured_rotation(spec, spec.z, p, R_stated, features)
    return spatial.pose(R, p + R[:, 2] * (spec.offset_mm * MM))


def _measured_rotation(
    spec: FrameSpec, along: str | list[str], origin: Array, R_stated: Array, features: Mapping[str, MeasuredFeature]
) -> Array:
    """Return the rotation (3, 3) of a frame at p (3,) whose z axis is measured on the features `along`.

    Its x axis is that of the stated rotation, made perpendicular to z, if no feature gives x or y.
    """
    if isinstance(along, list):
        a, b, c = [centre(name, features) for name in along]
        z = np.cross(b - a, c - a)
    else:
        z = _feature(along, features).direction
    if np.linalg.norm(z) < _NO_DIRECTION:
        raise CadError(
            f"z = {along!r} defines no direction: use a cylinder, a plane, or three sphere centres not on one line"
        )
    z = z / np.linalg.norm(z)
    try:
        if spec.y_towards is not None:
            y = centre(spec.y_towards, features) - origin
            return spatial.frame_from_axes(z, np.cross(y, z))
        if spec.x_towards is not None:
            x = centre(spec.x_towards, features) - origin
        elif spec.x_along is not None:
            x = _feature(spec.x_along, features).direction
        else:
            x = R_stated[:, 0]
        return spatial.frame_from_axes(z, x)
    except ValueError:
        raise CadError(
            f"the frame at {spec.origin!r}: its x or y direction is parallel to z; name another feature for it"
        ) from None


def _feature(name: str, features: Mapping[str, MeasuredFeature]) -> MeasuredFeature:
    if name not in features:
        raise CadError(unknown("feature", name, features))
    return features[name]


def _mm_text(p: Array) -> str:
    x, y, z = p / MM
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
