"""Pick faces of a STEP file, and write the TOML by which a robot's description names them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from twin.cad.description import Feature
from twin.cad.face_feature import naming_feature
from twin.cad.step import Face
from twin.core.errors import CadError, TwinError
from twin.core.spatial import Array
from twin.core.toml_text import one_line, rows
from twin.core.units import DEG, MM
from twin.ui.session.drawn_faces import DrawnFace, StepDrawing, in_mm

_TOML_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass
class PickedFace:
    """A picked face.

    Attributes:
        drawn: the face.
        name: its name in the TOML.
        feature: the feature that names the face; None: the face cannot be named.
        reason: why the face cannot be named; "" if it can.
        known_as: names that the description already has for this face.
    """

    drawn: DrawnFace
    name: str
    feature: Feature | None
    reason: str
    known_as: tuple[str, ...]

    @property
    def kind(self) -> str:
        """Kind of the face in words, such as "cylinder (bore)"."""
        face = self.drawn.geometry
        if face is None:
            return "free-form face"
        if face.kind == "cylinder":
            return f"cylinder ({_round_name(self.drawn, 'bore', 'pin')})"
        if face.kind == "sphere":
            return f"sphere ({_round_name(self.drawn, 'socket', 'ball')})"
        return face.kind

    def axis(self) -> tuple[Array, Array] | None:
        """Return (point, unit direction), each (3,) in m, of the axis of a cylinder, cone or torus; None: no axis.

        The direction is that of the TOML, if the face has one.
        """
        face = self.drawn.geometry
        if face is None or face.kind not in ("cylinder", "cone", "torus"):
            return None
        return face.point, _toml_direction(self.drawn, face)

    def facts(self) -> list[tuple[str, str]]:
        """Return (what, value) of the face's geometry, as text with units."""
        face = self.drawn.geometry
        rows = [("kind", self.kind), ("body", self.drawn.body), ("part", self.drawn.part.name)]
        if self.known_as:
            rows.append(("in the TOML", ", ".join(self.known_as)))
        if face is None:
            return rows
        place = f"({_numbers(in_mm(face.point))}) mm"
        towards = _toml_direction(self.drawn, face)
        direction = f"({_numbers(towards.tolist())})"
        if face.kind == "plane":
            rows += [("outward normal", direction), ("middle of the face", place)]
        elif face.kind == "sphere":
            rows += [("radius", _millimetres(face.radius)), ("centre", place)]
        elif face.kind == "cone":
            angle = f"{face.half_angle / DEG:.6g}°"
            rows += [("half angle", angle), ("axis", direction), ("apex", place)]
        else:
            rows += [("radius", _millimetres(face.radius)), ("axis", direction), ("centre", place)]
        return rows


class FacePicker:
    """The picked faces of a STEP file, in the order in which they were picked.

    Attributes:
        drawing: the STEP file.
        picked: the picked faces.
        current: the face that was picked last; None: none.
    """

    def __init__(self, drawing: StepDrawing) -> None:
        self.drawing = drawing
        self.picked: list[PickedFace] = []
        self.current: PickedFace | None = None

    def pick(self, origin: Array, direction: Array, visible_parts: Collection[int] | None = None) -> PickedFace | None:
        """Pick the face that a ray meets first, and make it the current one; a face picked before stays one entry.

        The arguments are those of `StepDrawing.meet`. Return None if the ray meets no face; then nothing changes.
        """
        face_met = self.drawing.meet(origin, direction, visible_parts)
        if face_met is None:
            return None
        for old in self.picked:
            # a second click on a face selects its entry again
            if old.drawn.part is face_met.part and old.drawn.index == face_met.index:
                self.current = old
                return old
        self.current = self._picked_face(face_met)
        self.picked.append(self.current)
        return self.current

    def _picked_face(self, face_met: DrawnFace) -> PickedFace:
        face = face_met.geometry
        if face is None:
            reason = "a free-form face has neither axis nor centre; pick a plane, a cylinder or a sphere"
            return PickedFace(face_met, self._free_name(face_met.body, "surface"), None, reason, ())
        named = []
        for name, named_face in self.drawing.names_in(face_met.body).items():
            if named_face is face:
                named.append(name)
        body = face_met.body
        parts = self.drawing.parts[body]
        direction = _toml_direction(face_met, face)
        try:
            feature = naming_feature(body, face, direction, face_met.part.name, parts, self.drawing.tolerance)
        # the geometry of the face is not unique on the body: the reason is shown, and the face has no TOML
        except CadError as error:
            return PickedFace(face_met, self._free_name(body, face.kind), None, str(error), tuple(named))
        name = self._free_name(body, _suggested_name(face_met, face))
        return PickedFace(face_met, name, feature, "", tuple(named))

    def _free_name(self, body: str, word: str) -> str:
        """Return WORD_NUMBER with the least number that neither the description nor a picked face of the body has."""
        taken_names = set(self.drawing.taken_names(body))
        for face in self.picked:
            if face.drawn.body == body:
                taken_names.add(face.name)
        number = 1
        while f"{word}_{number}" in taken_names:
            number += 1
        return f"{word}_{number}"

    def rename(self, name: str) -> None:
        """Give the current face another name.

        Raises:
            TwinError: no face is picked, or the name is not allowed or not free.
        """
        if self.current is None:
            raise TwinError("no face is picked: click one, then name it")
        if not _TOML_NAME.fullmatch(name):
            raise TwinError(f"'{name}' is no name: use lower-case letters, digits and underscores, a letter first")
        body = self.current.drawn.body
        for picked_face in self.picked:
            if picked_face is not self.current and picked_face.drawn.body == body and picked_face.name == name:
                raise TwinError(f"another picked face of body '{body}' is called '{name}': choose another name")
        if name in self.drawing.taken_names(body):
            raise TwinError(f"the description has a feature '{name}' of body '{body}': choose another name")
        self.current.name = name

    def drop(self) -> None:
        """Remove the current face from the list; the last of the others becomes the current one."""
        if self.current is None:
            return
        self.picked.remove(self.current)
        self.current = None
        if self.picked:
            self.current = self.picked[-1]

    def clear(self) -> None:
        """Remove all faces from the list."""
        self.picked.clear()
        self.current = None

    def toml(self) -> str:
        """Return the tables [feature.BODY] of all picked faces, in the order of the bodies; "" if none can be named."""
        lines: list[str] = []
        for body in self.drawing.parts:
            faces = [face for face in self.picked if face.drawn.body == body and face.feature is not None]
            if not faces:
                continue
            if lines:
                lines.append("")
            lines.append(f"[feature.{body}]")
            for face in faces:
                assert face.feature is not None
                values = rows(face.feature.model_dump(exclude_none=True))
                lines.append(f"{face.name} = {{ {', '.join(values)} }} # {one_line(face.kind)}")
        return "".join(f"{line}\n" for line in lines)


def _toml_direction(face_met: DrawnFace, face: Face) -> Array:
    """Return the direction (3,) of a face with a definite sign.

    The normal of a plane points out of the solid. An axis points along the positive coordinate axis that it is nearest
    to.
    """
    direction = face.direction
    if face.kind == "plane":
        towards = float(direction @ face_met.normal_sum())
    else:
        # rounded, so that of two equal components the first counts whatever the rounding errors are
        largest = np.argmax(np.round(np.abs(direction), 9))
        towards = float(direction[largest])
    if towards < 0:
        return -direction
    return direction


def _suggested_name(face_met: DrawnFace, face: Face) -> str:
    """Return a word for the name of a face."""
    if face.kind == "cylinder":
        return _round_name(face_met, "bore", "pin")
    if face.kind == "sphere":
        return _round_name(face_met, "socket", "ball")
    return "face"


def _round_name(face_met: DrawnFace, hollow: str, solid: str) -> str:
    if face_met.is_hollow():
        return hollow
    return solid


def _numbers(values: Iterable[float]) -> str:
    # adding 0.0 turns -0.0 into 0.0
    return ", ".join(f"{value + 0.0:.6g}" for value in values)


def _millimetres(length: float) -> str:
    return f"{length / MM:.6g} mm"
