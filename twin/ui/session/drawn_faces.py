"""The faces of a STEP file as one surface: which face a ray meets, and the bodies whose faces a description names."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.cad import description
from twin.cad.build import parts_by_body
from twin.cad.description import CadTolerance, Description
from twin.cad.features import find
from twin.cad.step import Face, Part, StepModel, read_step
from twin.core.errors import CadError, TwinError
from twin.core.foreign.text import read_text
from twin.core.spatial import Array
from twin.core.units import MM
from twin.exchange.formats.step.read import bodies
from twin.exchange.read.imported_robot import Findings, Names

_DEFAULT_TOLERANCE = CadTolerance(gross_mm=1, gross_deg=1, meeting_um=1, meeting_deg=0.001)
"""Section [tolerance] of a new description."""

_MIN_DETERMINANT = 1e-30
"""Determinant in m2 below which a ray is in the plane of a triangle, or the triangle has no area."""


@dataclass(frozen=True, eq=False)  # == of arrays has no single truth value
class DrawnFace:
    """A face of a STEP file and its triangles.

    Attributes:
        body: name of the body, as in the description.
        part: the solid of the face.
        index: index of the face in `part.drawn`.
        triangles: (m, 3) indices of the face's triangles in `part.vertices`.
    """

    body: str
    part: Part
    index: int
    triangles: np.ndarray

    @property
    def geometry(self) -> Face | None:
        """The analytic face; None: a face without axis or centre."""
        return self.part.drawn[self.index]

    def normal_sum(self) -> Array:
        """Return the sum (3,) of the outward normals of the triangles, weighted by twice their areas in m2."""
        return self._normals().sum(axis=0)

    def is_hollow(self) -> bool:
        """Return whether the solid is around a round face (a bore or socket), not inside it (a pin or ball)."""
        face = self.geometry
        assert face is not None
        away = self.part.vertices[self.triangles].mean(axis=1) - face.point
        away -= (away @ face.direction)[:, None] * face.direction
        return float(np.sum(self._normals() * away)) < 0

    def _normals(self) -> Array:
        """Return the outward normals (m, 3) of the triangles; their lengths are twice the areas in m2."""
        a, b, c = np.moveaxis(self.part.vertices[self.triangles], 1, 0)
        return np.cross(b - a, c - a)


class StepDrawing:
    """A STEP file in which faces are picked.

    Attributes:
        path: the STEP file.
        parts: the parts of each body, by name of the body.
        tolerance: gross tolerances of the description.
        source: the description beside the STEP that names the bodies; None: the bodies are the nodes of the assembly.
        note: why the description beside the STEP is not used; "" if it is, or if there is none.
        placement_error: error in m of the placements in the STEP, see `StepModel`.
    """

    def __init__(self, path: Path) -> None:
        """Read a STEP file.

        Raises:
            CadError: the file is missing, is not a STEP file, is damaged, or has no solids.
            BudgetError: the file exceeds a limit.
        """
        step = read_step(path)
        self.path = path
        self.placement_error = step.placement_error
        self.source: Path | None = None
        self.note = ""
        self.tolerance = _DEFAULT_TOLERANCE
        self._description: Description | None = None
        self.parts = _parts_by_node(step)
        beside = _description_beside(path)
        if beside is not None:
            self._use_description(beside, step)
        self._names_of_body: dict[str, dict[str, Face]] = {}
        self._placed_parts: list[tuple[str, Part]] = []
        corners = []
        owner = []
        for body, parts in self.parts.items():
            for part in parts:
                corners.append(part.vertices[part.triangles])
                owner.append(np.full(len(part.triangles), len(self._placed_parts)))
                self._placed_parts.append((body, part))
        self._corners = np.concatenate(corners)
        self._part_of_triangle = np.concatenate(owner)
        self._first_triangle_of_part = np.searchsorted(self._part_of_triangle, np.arange(len(self._placed_parts)))

    def _use_description(self, beside: Path, step: StepModel) -> None:
        """Name the bodies as a description does; if it cannot be used, note why."""
        try:
            loaded = description.load(beside)
            named = parts_by_body(loaded, step)
        except TwinError as error:
            self.note = f"{beside.name} is not used, the names are those of the STEP: {error}"
            return
        used_parts: set[int] = set()
        parts: dict[str, list[Part]] = {}
        for body, body_parts in named.items():
            used_parts.update(id(part) for part in body_parts)
            if body_parts:
                parts[body] = body_parts
        # parts that no body of the description has are shown, too
        for node, body_parts in self.parts.items():
            remaining_parts = [part for part in body_parts if id(part) not in used_parts]
            if remaining_parts:
                parts.setdefault(node, []).extend(remaining_parts)
        self.parts = parts
        self.tolerance = loaded.tolerance
        self.source = beside
        self._description = loaded

    @property
    def box(self) -> Array:
        """Lowest and highest corner (2, 3) in m of everything that is drawn."""
        return np.array([self._corners.min(axis=(0, 1)), self._corners.max(axis=(0, 1))])

    def placed_parts(self) -> Iterator[tuple[str, Part]]:
        """Yield (name of the body, part) for each part."""
        yield from self._placed_parts

    def meet(self, origin: Array, direction: Array, visible_parts: Collection[int] | None = None) -> DrawnFace | None:
        """Return the face that a ray meets first; None if it meets none.

        Args:
            origin: (3,) start of the ray in m, in drawn coordinates.
            direction: (3,) direction of the ray.
            visible_parts: numbers, in the order of `placed_parts`, of the parts that the ray can meet; None: all.
        """
        chosen = np.arange(len(self._part_of_triangle))
        if visible_parts is not None:
            chosen = np.flatnonzero(np.isin(self._part_of_triangle, list(visible_parts)))
        first = _first_triangle(self._corners[chosen], origin, direction)
        if first is None:
            return None
        triangle = int(chosen[first])
        at = int(self._part_of_triangle[triangle])
        body, part = self._placed_parts[at]
        index = int(part.face_of_triangle[triangle - self._first_triangle_of_part[at]])
        face_triangles = part.triangles[part.face_of_triangle == index]
        return DrawnFace(body, part, index, face_triangles)

    def names_in(self, body: str) -> dict[str, Face]:
        """Return the faces that the description already names on a body, by name.

        A feature that is not found has no entry.
        """
        if self._description is None:
            return {}
        if body not in self._names_of_body:
            faces: dict[str, Face] = {}
            for name, spec in self._description.feature.get(body, {}).items():
                try:
                    faces[name] = find(body, name, spec, self.parts[body], self.tolerance).face
                except CadError:  # `twin build` reports it
                    continue
            self._names_of_body[body] = faces
        return self._names_of_body[body]

    def taken_names(self, body: str) -> set[str]:
        """Return the names of the features that the description has for a body, also of those not found."""
        if self._description is None:
            return set()
        return set(self._description.feature.get(body, {}))


def _parts_by_node(step: StepModel) -> dict[str, list[Part]]:
    """Return the parts of each body of `twin new`: the nodes of the assembly, with names of a description."""
    by_node = bodies(step.parts)
    names = Names("body", by_node, Findings())
    return {names[node]: parts for node, parts in by_node.items()}


def _description_beside(path: Path) -> Path | None:
    """Return the description in the folder of a STEP file that names this file as its STEP; None if there is none."""
    for candidate in sorted(path.parent.glob("*.toml")):
        try:
            text = read_text(candidate, "TOML", errors="replace")
        except (OSError, TwinError):
            continue
        for line in text.splitlines():
            key, _, value = line.partition("=")
            if key.strip() == "step" and value.partition("#")[0].strip().strip("\"'") == path.name:
                return candidate
    return None


def _first_triangle(corners: Array, origin: Array, direction: Array) -> int | None:
    """Return the index of the triangle (of (n, 3, 3) corners in m) that a ray meets first; None if it meets none.

    Both sides of a triangle count, because both are drawn. Source: Möller and Trumbore, Fast, Minimum Storage
    Ray/Triangle Intersection, Journal of Graphics Tools 2 (1997).
    """
    a = corners[:, 0]
    ab = corners[:, 1] - a
    ac = corners[:, 2] - a
    p = np.cross(direction, ac)
    determinant = np.einsum("ij,ij->i", ab, p)
    crosses = np.abs(determinant) > _MIN_DETERMINANT
    scale = 1.0 / np.where(crosses, determinant, 1.0)
    from_a = origin - a
    # barycentric coordinates of the point in which the ray meets the plane of each triangle
    u = np.einsum("ij,ij->i", from_a, p) * scale
    q = np.cross(from_a, ab)
    v = q @ direction * scale
    distance = np.einsum("ij,ij->i", ac, q) * scale
    is_met = crosses & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    if not is_met.any():
        return None
    return int(np.argmin(np.where(is_met, distance, np.inf)))


def in_mm(point: Array) -> tuple[float, float, float]:
    """Return a point (3,) in m as three numbers in mm, rounded to 0.1 µm."""
    x, y, z = (np.round(point / MM, 4) + 0.0).tolist()
    return x, y, z
