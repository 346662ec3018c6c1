"""Parts that are drawn and not measured: belts, motors, cables, drapes, a tissue bed, a person for scale.

A file `scenery.toml` beside the description of a robot or a scene names them. They are for the eye: no kinematics, no
check of collisions, no mass and no export reads them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from twin.core import assets
from twin.core.errors import unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body, Finish, Mesh
from twin.schema import Identifier, Origin, Positive, Table, Vector, error_at, load_toml
from twin.ui.session.drawn_solids import SolidTable, check_solid, placed_surface
from twin.ui.session.drawn_surfaces import box, rod

SCENERY_FILE = "scenery.toml"

Pattern = Literal["plain", "tissue"]
"""Pattern on a surface: none, or the blotches and vessels of tissue."""

_BELT_THICKNESS = 1.5 * MM
"""Thickness of a belt."""

_BELT_COLOR = (0.02, 0.02, 0.022, 1.0)
_PULLEY_COLOR = (0.45, 0.48, 0.52, 1.0)
# linear red, green, blue and opacity; motors have the colour of belts


class DrawnTable(SolidTable):
    """A solid in the frame of the body `link` of a robot, or of the world of a scene."""

    link: Identifier | None = None
    pattern: Pattern = "plain"


class BeltTable(Table):
    """A toothed belt around two pulleys, in the frame of the body `link`.

    Attributes:
        from_mm: centre of the first pulley.
        to_mm: centre of the second pulley.
        axis: direction of the axes of both pulleys, at right angles to the belt.
        radius_mm: radius of the pulleys.
        width_mm: width of the belt along the axes.
        motor_mm: diameter and length of the motor on the first pulley's axis, in the direction of `axis`.
    """

    name: Identifier
    link: Identifier
    from_mm: Vector
    to_mm: Vector
    axis: Vector
    radius_mm: Positive
    width_mm: Positive
    motor_mm: tuple[float, float] | None = None


class CableEnd(Table):
    """An end of a cable, at a point in the frame of a body."""

    link: Identifier
    at_mm: Vector


class DrawnCable(Table):
    """A cable between two bodies that hangs down as far as its length allows.

    A cable that is shorter than the distance of its ends is drawn straight.
    """

    name: Identifier
    ends: tuple[CableEnd, CableEnd]
    length_mm: Positive
    diameter_mm: Positive
    color: tuple[float, float, float]


class FinishTable(Table):
    """Another colour, and a pattern, for a body of the props of a scene."""

    body: Identifier
    color: tuple[float, float, float]
    pattern: Pattern = "plain"


class SceneryFile(Table):
    """Content of a file `scenery.toml`."""

    title: str
    provenance: Origin
    note: str = Field(min_length=1)
    part: list[DrawnTable] = Field(default_factory=list)
    belt: list[BeltTable] = Field(default_factory=list)
    cable: list[DrawnCable] = Field(default_factory=list)
    finish: list[FinishTable] = Field(default_factory=list)


@dataclass(frozen=True)
class DrawnParts:
    """What is drawn beside the measured bodies of one robot or scene.

    Attributes:
        meshes: meshes by (name of the body, pattern), in m in the frame of the body; a scene's have the body "".
        cables: cables between bodies of the robot.
        finishes: colours of the props of a scene.
        note: text that says what is drawn, and that it is not measured.
    """

    meshes: dict[tuple[str, Pattern], list[Mesh]]
    cables: tuple[DrawnCable, ...]
    finishes: tuple[FinishTable, ...]
    note: str

    def bodies(self) -> list[tuple[str, Pattern, Body]]:
        """Return (name of the body that carries it, pattern, drawn body) for every drawn body."""
        rows = []
        for k, ((link, pattern), meshes) in enumerate(self.meshes.items()):
            rows.append((link, pattern, Body(f"drawn{k}", tuple(meshes))))
        return rows


def drawn_parts(description: Path, bodies: Iterable[str], props: Iterable[str] = ()) -> DrawnParts | None:
    """Return what is drawn beside a robot or a scene; None if its folder has no file `scenery.toml`.

    Args:
        description: path of the description file of the robot, or of the scene file.
        bodies: names of the bodies that can carry parts; none for a scene.
        props: names of the bodies of the scene's props.

    Raises:
        DescriptionError: the file is invalid; the message has file, line, key, value and the allowed values.
    """
    path = description.parent / SCENERY_FILE
    if not path.is_file():
        return None
    return read_drawn(path, bodies, props)


def person() -> DrawnParts:
    """Return an adult who stands at the origin and looks along x, to compare sizes with."""
    return read_drawn(assets.data_folder() / "cad" / "people" / "standing.toml", ())


def read_drawn(path: Path, bodies: Iterable[str], props: Iterable[str] = ()) -> DrawnParts:
    """Return the content of a file, checked; arguments and errors as of `drawn_parts`."""
    table = load_toml(path, SceneryFile)
    _check_links(path, table, list(bodies))
    _check_finishes(path, table, list(props))
    meshes: dict[tuple[str, Pattern], list[Mesh]] = {}
    for number, part in enumerate(table.part):
        check_solid(path, ("part", number), part)
        points, triangles = placed_surface(part)
        # a colour without opacity is opaque
        r, g, b, a = (*part.color, 1.0)[:4]
        mesh = Mesh(part.name, points, triangles, (r, g, b, a), Finish("", 0.0, 0.6))
        meshes.setdefault((part.link or "", part.pattern), []).append(mesh)
    for number, belt in enumerate(table.belt):
        _check_belt(path, number, belt)
        meshes.setdefault((belt.link, "plain"), []).extend(_belt(belt))
    note = f"{table.title}, drawn and not measured ({table.provenance}): {table.note}"
    return DrawnParts(meshes, tuple(table.cable), tuple(table.finish), note)


def _check_links(path: Path, table: SceneryFile, bodies: list[str]) -> None:
    """Raise an error if a name occurs twice, or if something refers to a body that does not exist."""
    names: set[str] = set()
    for section in ("part", "belt", "cable"):
        for number, item in enumerate(getattr(table, section)):
            if item.name in names:
                raise error_at(path, (section, number, "name"), f"'{item.name}' is the name of two drawn parts")
            names.add(item.name)
            if section == "cable":
                links = [end.link for end in item.ends]
            else:
                links = [item.link]
            for link in links:
                # a scene has no bodies that could carry a part: its parts are in the world
                if bodies and link is None:
                    raise error_at(
                        path, (section, number), f"'{item.name}' needs the key link: the body that carries it"
                    )
                if link is not None and link not in bodies:
                    raise error_at(path, (section, number), unknown("body", link, bodies))


def _check_finishes(path: Path, table: SceneryFile, props: list[str]) -> None:
    """Raise an error if a finish is of a body that the props do not have."""
    for k, finish in enumerate(table.finish):
        if finish.body not in props:
            raise error_at(path, ("finish", k, "body"), unknown("body of the props", finish.body, props))


def _check_belt(path: Path, number: int, belt: BeltTable) -> None:
    along = np.subtract(belt.to_mm, belt.from_mm)
    axis = np.array(belt.axis)
    if np.linalg.norm(axis) < 1e-9 or np.linalg.norm(along) < 2 * belt.radius_mm:
        text = f"the pulleys of '{belt.name}' are closer than their diameter, or axis is zero"
        raise error_at(path, ("belt", number, "to_mm"), text)
    if abs(along @ axis) > 1e-6 * np.linalg.norm(along) * np.linalg.norm(axis):
        raise error_at(path, ("belt", number, "axis"), f"{list(belt.axis)} is not at right angles to the belt")


def _belt(belt: BeltTable) -> list[Mesh]:
    """Return the meshes of two strands, two pulleys and the motor."""
    start = np.array(belt.from_mm) * MM
    end = np.array(belt.to_mm) * MM
    axis = np.array(belt.axis) / np.linalg.norm(belt.axis)
    radius = belt.radius_mm * MM
    width = belt.width_mm * MM
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    across = np.cross(axis, along)
    R = np.column_stack([along, axis, across])
    meshes = []
    for number, side in enumerate((-1, 1)):
        # the strand lies on the pulley: its outer face is at the radius
        middle = 0.5 * (start + end) + side * (radius - 0.5 * _BELT_THICKNESS) * across
        points, triangles = box(np.array([length, width, _BELT_THICKNESS]))
        meshes.append(
            Mesh(f"{belt.name}_strand{number}", points @ R.T + middle, triangles, _BELT_COLOR, Finish("", 0.0, 0.8))
        )
    for number, centre in enumerate((start, end)):
        ends = np.array([centre - 0.5 * width * axis, centre + 0.5 * width * axis])
        meshes.append(_rod(f"{belt.name}_pulley{number}", ends, 2 * (radius - _BELT_THICKNESS), _PULLEY_COLOR))
    if belt.motor_mm is not None:
        diameter, extent = (value * MM for value in belt.motor_mm)
        face = start + 0.5 * width * axis
        meshes.append(_rod(f"{belt.name}_motor", np.array([face, face + extent * axis]), diameter, _BELT_COLOR))
    return meshes


def _rod(name: str, ends: Array, diameter: float, color: tuple[float, float, float, float]) -> Mesh:
    points, triangles = rod(ends, diameter)
    return Mesh(name, points, triangles, color, Finish("", 0.6, 0.4))


def hanging(start: Array, end: Array, length: float, count: int = 13) -> Array:
    """Return points (count, 3) of a cable of a length in m that hangs between two points: a parabola.

    The sag is that of a shallow parabola of this length, at most half of the length.
    """
    chord = float(np.linalg.norm(end - start))
    sag = 0.0
    if length > chord:
        # a shallow parabola is 8 sag² / (3 chord) longer than its chord; the second term lets slack ones hang lower
        excess = length - chord
        sag = min(float(np.sqrt(3 / 8 * chord * excess)) + 0.25 * excess, 0.5 * length)
    t = np.linspace(0, 1, count)[:, None]
    up = np.array([0.0, 0.0, 1.0])
    return (1 - t) * start + t * end - 4 * t * (1 - t) * sag * up
