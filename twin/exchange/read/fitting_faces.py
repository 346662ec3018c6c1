"""Find fitting faces of different bodies in a STEP file: pin and bore, rail and bush, ball and socket.

Two faces also fit if their axes or centres differ by less than `NEAR_FIT`; the difference is then reported.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.cad.step import Face, Part
from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM

NEAR_FIT = (1.0 * MM, 2.0 * DEG)
"""Maximum distance in m between the axes or centres of two fitting faces, and maximum angle in rad between the axes."""

_COINCIDENCE = 0.01 * MM
"""Distance in m below which two axes or two centres count as coincident."""

_PARALLEL_ANGLE = 0.01 * DEG
"""Angle in rad below which two axes count as parallel."""

_MAX_CLEARANCE = (0.1 * MM, 0.1)
"""Maximum difference between the radii of a pin and its bore: in m, and as a fraction of the smaller radius.

The larger of the two limits applies.
"""

_MOVABLE_CLEARANCE = (0.001 * MM, 0.3 * MM)
"""Minimum and maximum difference in m between the two radii of a movable fit."""

_SAME_AXIS = (0.1 * MM, 0.1 * DEG)
"""Distance in m and angle in rad below which two faces of one body count as faces on the same axis."""


@dataclass(frozen=True, eq=False)  # == of arrays has no single truth value
class RoundFace:
    """A cylindrical or spherical face of a body.

    Attributes:
        part: the part to which the face belongs.
        reach: (start, end) of the cylinder along its axis, in m from `face.point`; (0, 0) for a sphere.
    """

    body: str
    part: Part
    face: Face
    reach: tuple[float, float] = (0.0, 0.0)

    @property
    def length(self) -> float:
        """Length in m along the axis; 0 for a sphere."""
        return self.reach[1] - self.reach[0]

    def outward(self) -> int:
        """Return 1 if the solid is inside the face (pin, ball), -1 if it is outside (bore, cup), 0 if undetermined."""
        corners = self.part.vertices[self.part.triangles]  # (n, 3, 3)
        offset = corners - self.face.point
        radial = offset - (offset @ self.face.direction)[..., None] * self.face.direction
        on_face = np.all(np.abs(np.linalg.norm(radial, axis=-1) - self.face.radius) < _COINCIDENCE, axis=1)
        # Not normalised: by their area, slivers with inexact normals count less.
        normal = np.cross(corners[on_face, 1] - corners[on_face, 0], corners[on_face, 2] - corners[on_face, 0])
        outwards = np.sum(normal * radial[on_face].mean(axis=1))
        return int(np.sign(outwards))


@dataclass(frozen=True, eq=False)
class FacePair:
    """A fit: two round faces of different bodies, such as a pin and its bore.

    Attributes:
        kind: "coaxial" or "concentric".
        overlap: length in m over which the two cylinders overlap along the axis; for spheres the smaller diameter.
        offset: distance in m between the axes at the middle of the overlap, or between the centres.
        tilt: angle in rad between the axes.
    """

    kind: Literal["coaxial", "concentric"]
    a: RoundFace
    b: RoundFace
    overlap: float
    offset: float
    tilt: float

    @property
    def clearance(self) -> float:
        """Absolute difference between the radii in m."""
        return abs(self.a.face.radius - self.b.face.radius)

    @property
    def near(self) -> bool:
        """Whether the two axes or centres are close, but do not coincide."""
        return self.offset >= _COINCIDENCE or self.tilt >= _PARALLEL_ANGLE

    @property
    def miss(self) -> float:
        """Maximum distance between the axes (in the overlap) or the centres, as a fraction of the smaller radius."""
        return (self.offset + 0.5 * self.tilt * self.overlap) / min(self.a.face.radius, self.b.face.radius)

    @property
    def confidence(self) -> Literal["high", "medium", "low"]:
        """Confidence that the faces fit: high for a `miss` up to 5 %, medium up to 20 %, else low."""
        if self.miss <= 0.05:
            return "high"
        if self.miss <= 0.2:
            return "medium"
        return "low"

    @property
    def radii(self) -> str:
        """Text with the radii and part names of both faces."""
        radius_a = self.a.face.radius / MM
        radius_b = self.b.face.radius / MM
        return f"radii {radius_a:.4g} mm on '{self.a.part.name}' and {radius_b:.4g} mm on '{self.b.part.name}'"

    def movable(self) -> bool:
        """Return whether one face is a pin or ball, and the other a bore or cup in which it can move."""
        smallest, largest = _MOVABLE_CLEARANCE
        if not smallest < self.clearance < largest:
            return False
        shaft = self.a
        bore = self.b
        if shaft.face.radius >= bore.face.radius:
            shaft, bore = bore, shaft
        return shaft.outward() > 0 > bore.outward()


def find_pairs(parts: Mapping[str, Sequence[Part]]) -> list[FacePair]:
    """Return the fits between bodies, in the order of the bodies.

    For each pair of bodies, fits with coincident axes or centres come first. Of several fits on one axis, only one is
    returned: coincident axes are preferred, then the minimum clearance. `parts` maps body names to the parts of the
    bodies, in the coordinates of the STEP.
    """
    cylinders = _rounds(parts, "cylinder")
    spheres = _rounds(parts, "sphere")
    candidates = [*_coaxial(cylinders), *_concentric(spheres)]
    # The best of several fits on one axis comes first, and the others are then left out.
    candidates.sort(key=lambda p: (p.near, p.clearance, -p.overlap))
    by_bodies: dict[tuple[str, str], list[FacePair]] = {}
    for pair in candidates:
        fits = by_bodies.setdefault((pair.a.body, pair.b.body), [])
        if _on_axis_of_one(pair, fits):
            continue
        # Faces that do not coincide count only if one is a pin (or ball) and the other a bore (or cup).
        if not pair.near or (pair.miss < 1 and pair.a.outward() * pair.b.outward() < 0):
            fits.append(pair)
    pairs: list[FacePair] = []
    for fits in by_bodies.values():
        pairs += fits
    order = list(parts)
    pairs.sort(key=lambda p: (order.index(p.a.body), order.index(p.b.body)))
    return pairs


def _on_axis_of_one(pair: FacePair, fits: Sequence[FacePair]) -> bool:
    """Return whether one of the fits of the same two bodies has the axes or centres of `pair`."""
    for fit in fits:
        if fit.kind != pair.kind:
            continue
        if same_axis(fit.a, pair.a) and same_axis(fit.b, pair.b):
            return True
    return False


def same_axis(first: RoundFace, second: RoundFace, tolerances: tuple[float, float] = _SAME_AXIS) -> bool:
    """Return whether two faces of one body have the same axis or centre.

    `tolerances` are a distance in m and an angle in rad.
    """
    # A sphere has no direction: its centre alone says where it is.
    if not np.any(first.face.direction):
        return float(np.linalg.norm(first.face.point - second.face.point)) < tolerances[0]
    tilt = float(np.linalg.norm(np.cross(first.face.direction, second.face.direction)))
    distance = float(spatial.point_to_line(second.face.point, first.face.point, first.face.direction))
    return tilt < tolerances[1] and distance < tolerances[0]


def _rounds(parts: Mapping[str, Sequence[Part]], kind: Literal["cylinder", "sphere"]) -> list[RoundFace]:
    """Return the round faces of one kind, in the order of the bodies and parts."""
    rounds = []
    for body, body_parts in parts.items():
        for part in body_parts:
            for face in part.faces:
                if face.kind != kind:
                    continue
                reach = (0.0, 0.0)
                if kind == "cylinder":
                    reach = _reach(part, face)
                rounds.append(RoundFace(body, part, face, reach))
    return rounds


def _reach(part: Part, face: Face) -> tuple[float, float]:
    """Return (start, end) of a cylindrical face along its axis, in m from `face.point`, from the part's vertices."""
    offset = part.vertices - face.point
    along = offset @ face.direction
    radius = np.linalg.norm(offset - along[:, None] * face.direction, axis=1)
    on_face = along[np.abs(radius - face.radius) < _COINCIDENCE]
    if not len(on_face):
        return 0.0, 0.0
    return float(on_face.min()), float(on_face.max())


def _coaxial(rounds: list[RoundFace]) -> Iterator[FacePair]:
    """Yield the coaxial fits of cylinders: each cylinder is compared with all later ones at once."""
    if not rounds:
        return
    max_distance, max_tilt = NEAR_FIT
    clearance_limit, clearance_share = _MAX_CLEARANCE
    points = np.zeros((len(rounds), 3))
    directions = np.zeros((len(rounds), 3))
    radii = np.zeros(len(rounds))
    half_lengths = np.zeros(len(rounds))
    for number, cylinder in enumerate(rounds):
        points[number] = cylinder.face.point
        directions[number] = cylinder.face.direction
        radii[number] = cylinder.face.radius
        half_lengths[number] = 0.5 * cylinder.length
    bodies = np.array([cylinder.body for cylinder in rounds])
    for number, first in enumerate(rounds):
        later = slice(number + 1, None)
        offset = points[later] - points[number]
        along = offset @ directions[number]
        distance = np.linalg.norm(offset - along[:, None] * directions[number], axis=1)
        tilt = np.linalg.norm(np.cross(directions[later], directions[number]), axis=1)
        # A point of a face is somewhere along it: up to there, a tilted axis departs from the other one.
        departure = tilt * (half_lengths[later] + half_lengths[number])
        clearance = np.abs(radii[later] - radii[number])
        fits = bodies[later] != first.body
        fits &= tilt < max_tilt
        fits &= distance < max_distance + departure
        fits &= clearance <= np.maximum(clearance_limit, clearance_share * np.minimum(radii[later], radii[number]))
        for offset_number in np.flatnonzero(fits):
            second = rounds[number + 1 + offset_number]
            low, high = shared(first, second)
            if high - low < _COINCIDENCE:
                continue
            middle = first.face.point + 0.5 * (low + high) * first.face.direction
            middle_distance = float(spatial.point_to_line(middle, second.face.point, second.face.direction))
            if middle_distance < max_distance:
                yield FacePair("coaxial", first, second, high - low, middle_distance, float(tilt[offset_number]))


def shared(first: RoundFace, second: RoundFace) -> tuple[float, float]:
    """Return the interval (start, end) in which two cylinders overlap along the axis of the first.

    Both ends are distances in m from `first.face.point`.
    """
    axis = first.face.direction
    offset = float((second.face.point - first.face.point) @ axis)
    start, end = second.reach
    # CAD programs choose the direction of a cylinder's axis freely.
    if not second.face.direction @ axis > 0:
        start, end = -end, -start
    return max(first.reach[0], offset + start), min(first.reach[1], offset + end)


def _concentric(rounds: list[RoundFace]) -> Iterator[FacePair]:
    """Yield the concentric fits of spheres."""
    max_distance, _ = NEAR_FIT
    clearance_limit, clearance_share = _MAX_CLEARANCE
    for number, first in enumerate(rounds):
        for second in rounds[number + 1 :]:
            if first.body == second.body:
                continue
            distance = float(np.linalg.norm(first.face.point - second.face.point))
            smaller = min(first.face.radius, second.face.radius)
            clearance = abs(first.face.radius - second.face.radius)
            if distance < max_distance and clearance <= max(clearance_limit, clearance_share * smaller):
                yield FacePair("concentric", first, second, 2 * smaller, distance, 0.0)


def perpendicular(parts: Sequence[Part], axis: Array) -> list[tuple[Part, Face]]:
    """Return (part, face) for each plane face of a body that is perpendicular to an axis."""
    planes = []
    for part in parts:
        for face in part.faces:
            if face.kind == "plane" and np.linalg.norm(np.cross(face.direction, axis)) < _PARALLEL_ANGLE:
                planes.append((part, face))
    return planes
