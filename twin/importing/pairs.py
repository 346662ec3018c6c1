"""Faces of two bodies of a STEP that fit each other: a pin in its bore, a rail in its bush, a ball in its socket."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.cad.step import Face, Part
from twin.spatial import Array
from twin.units import DEG, MM

_APART = 0.01 * MM
"""Largest distance of two axes or centres that count as one."""

_TILT = 0.01 * DEG

_CLEARANCE = (0.1 * MM, 0.1)
"""Largest difference of the radii of a pin and its bore: m, and share of the radius, the larger."""


@dataclass(frozen=True)
class Round:
    """A cylinder or sphere of a body: its face, its part, and how far it reaches along its axis in m (0, 0: a ball)."""

    body: str
    part: str
    face: Face
    reach: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Pair:
    """Two round faces of two bodies that fit: "coaxial" or "concentric"; `overlap` is the shared length in m."""

    kind: Literal["coaxial", "concentric"]
    a: Round
    b: Round
    overlap: float

    @property
    def clearance(self) -> float:
        """Difference of the radii in m."""
        return abs(self.a.face.radius - self.b.face.radius)


def find_pairs(parts: Mapping[str, Sequence[Part]]) -> list[Pair]:
    """Return every fit between two bodies; of several on one axis, the one with the least clearance.

    Args:
        parts: the parts of each body, in drawn coordinates.
    """
    return [*_coaxial(list(_cylinders(parts))), *_concentric(list(_spheres(parts)))]


def _cylinders(parts: Mapping[str, Sequence[Part]]) -> Iterator[Round]:
    for body, own in parts.items():
        for part in own:
            for face in part.faces:
                if face.kind == "cylinder":
                    yield Round(body, part.name, face, _reach(part, face))


def _spheres(parts: Mapping[str, Sequence[Part]]) -> Iterator[Round]:
    for body, own in parts.items():
        for part in own:
            yield from (Round(body, part.name, f) for f in part.faces if f.kind == "sphere")


def _reach(part: Part, face: Face) -> tuple[float, float]:
    """Return from where to where along the axis, from the face's point, the part has points on the cylinder."""
    offset = part.vertices - face.point
    along = offset @ face.direction
    radius = np.linalg.norm(offset - along[:, None] * face.direction, axis=1)
    on = along[np.abs(radius - face.radius) < _APART]
    return (float(on.min()), float(on.max())) if len(on) else (0.0, 0.0)


def _coaxial(rounds: list[Round]) -> list[Pair]:
    if not rounds:
        return []
    P = np.array([r.face.point for r in rounds])
    D = np.array([r.face.direction for r in rounds])
    radius = np.array([r.face.radius for r in rounds])
    body = np.array([r.body for r in rounds])
    best: dict[tuple, Pair] = {}
    for i, a in enumerate(rounds):
        offset = P[i + 1 :] - P[i]
        along = offset @ D[i]
        apart = np.linalg.norm(offset - along[:, None] * D[i], axis=1)
        tilt = np.linalg.norm(np.cross(D[i + 1 :], D[i]), axis=1)
        loose = np.maximum(_CLEARANCE[0], _CLEARANCE[1] * np.minimum(radius[i + 1 :], radius[i]))
        fits = (body[i + 1 :] != a.body) & (apart < _APART) & (tilt < _TILT)
        fits &= np.abs(radius[i + 1 :] - radius[i]) <= loose
        for k in np.flatnonzero(fits):
            b = rounds[i + 1 + k]
            turned = b.reach if b.face.direction @ a.face.direction > 0 else (-b.reach[1], -b.reach[0])
            low, high = (float(along[k]) + t for t in turned)
            overlap = min(a.reach[1], high) - max(a.reach[0], low)
            if overlap < _APART:
                continue
            pair = Pair("coaxial", a, b, overlap)
            key = (a.body, b.body, *_line(a.face))
            if key not in best or (pair.clearance, -overlap) < (best[key].clearance, -best[key].overlap):
                best[key] = pair
    return list(best.values())


def _line(face: Face) -> tuple[float, ...]:
    """Return numbers that are equal for faces on one axis: its direction, one sign, and its point nearest to zero."""
    d = face.direction
    first = next(v for v in d if abs(v) > 1e-6)
    foot = face.point - d * (face.point @ d)
    return (*np.round(d * np.sign(first), 3), *np.round(foot / MM, 1))


def _concentric(rounds: list[Round]) -> list[Pair]:
    best: dict[tuple, Pair] = {}
    for i, a in enumerate(rounds):
        for b in rounds[i + 1 :]:
            near = np.linalg.norm(a.face.point - b.face.point) < _APART
            loose = max(_CLEARANCE[0], _CLEARANCE[1] * min(a.face.radius, b.face.radius))
            if a.body == b.body or not near or abs(a.face.radius - b.face.radius) > loose:
                continue
            pair = Pair("concentric", a, b, 2 * min(a.face.radius, b.face.radius))
            key = (a.body, b.body, *np.round(a.face.point / MM, 1))
            if key not in best or pair.clearance < best[key].clearance:
                best[key] = pair
    return list(best.values())


def perpendicular(parts: Sequence[Part], axis: Array) -> Iterator[tuple[Part, Face]]:
    """Yield the planes of a body across an axis, with their parts."""
    for part in parts:
        for face in part.faces:
            if face.kind == "plane" and np.linalg.norm(np.cross(face.direction, axis)) < _TILT:
                yield part, face
