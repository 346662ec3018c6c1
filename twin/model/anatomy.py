"""Tables of a scene file that describe its organs: their CAD, their materials, and the links that can touch them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core.errors import TwinError, unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.model.surface import Surface
from twin.model.tissue import Pin, Tissue
from twin.schema import Identifier, Row, Sourced, Table, Vector, at

Direction = Literal["x", "-x", "y", "-y", "z", "-z"]
"""A direction of the world frame."""


_MOST_CELLS = 4
"""Maximum number of cells along an axis of an organ's grid."""


class PinTable(Table):
    """A box in the world frame, with two corners in mm; the nodes of the organ's grid inside the box are fixed."""

    name: Identifier
    low_mm: Vector
    high_mm: Vector

    @model_validator(mode="after")
    def _box(self) -> PinTable:
        if not np.less(self.low_mm, self.high_mm).all():
            raise at("low_mm", f"{list(self.low_mm)} is not below high_mm {list(self.high_mm)} in every direction")
        return self


class TissueTable(Sourced):
    """A soft organ. Its shape is the body of the same name in the file of the section [anatomy].

    The organ is an elastic solid of constant volume, simulated on a grid. `cells` are the numbers of cells along the
    three principal axes of the organ, the longest first; with `upright`, along the axes of the World. `edge_mm` is the
    maximum edge length of the surface triangles. `damping_s` in s is damping divided by stiffness (Rayleigh damping).
    """

    edge_mm: float = Field(ge=1, le=1000)
    cells: tuple[int, int, int]
    upright: bool = False
    young_kpa: float = Field(ge=0.1, le=1000)
    poisson: float = Field(ge=0, le=0.49)
    damping_s: float = Field(ge=0, le=1)
    density_kg_m3: float = Field(ge=100, le=5000)
    friction: float = Field(ge=0, le=2)
    pin: list[PinTable] = Field(min_length=1)

    @model_validator(mode="after")
    def _cells(self) -> TissueTable:
        if min(self.cells) < 1 or max(self.cells) > _MOST_CELLS:
            raise at("cells", f"{list(self.cells)} cells; each number must be 1 to {_MOST_CELLS}")
        return self


class AnatomyTable(Sourced):
    """The organs of a scene. `file` is a description file, like that of the props, with one body for each organ.

    `touching` names the links of instruments that can touch organs, each as "robot/body"; other links pass through
    organs. If the frame of the drawing is not the world frame, `axes` are the directions of the drawing's x, y and z in
    the world frame, such as ["-y", "x", "z"]; `origin_mm` is the origin of the drawing in the world frame; `scale` is a
    length in the world divided by the same length in the drawing.
    """

    file: str
    axes: tuple[Direction, Direction, Direction] = ("x", "y", "z")
    origin_mm: Vector = (0.0, 0.0, 0.0)
    scale: float = Field(1.0, ge=1e-3, le=1e3)
    touching: list[str] = Field(min_length=1)

    @model_validator(mode="after")
    def _links(self) -> AnatomyTable:
        for name in self.touching:
            if name.count("/") != 1:
                raise at("touching", f"'{name}' is not a link; write \"robot/body\"")
        if not np.isclose(np.linalg.det(self._R_world_drawing), 1.0):
            raise at("axes", f"{list(self.axes)} are not the axes of a right-handed frame; surfaces would be inverted")
        return self

    @property
    def _R_world_drawing(self) -> Array:  # noqa: N802
        """Rotation (3, 3) whose columns are the drawing's x, y and z in the World."""
        columns = []
        for axis in self.axes:
            unit = np.eye(3)["xyz".index(axis[-1])]
            if axis[0] == "-":
                unit = -unit
            columns.append(unit)
        return np.column_stack(columns)

    def to_world(self, p_drawing: Array) -> Array:
        """Return the points (n, 3) in the World for points (n, 3) in the drawing, all in m.

        The paper on the PA-10 virtual surgery robot maps points between its simulator and Blender in the same way: it
        swaps axes, reverses one axis, then shifts and scales the points (figures 13 to 15).
        """
        return p_drawing @ self._R_world_drawing.T * self.scale + np.array(self.origin_mm) * MM

    def to_drawing(self, p_world: Array) -> Array:
        """Return the points (n, 3) in the drawing for points (n, 3) in the World, all in m: inverse of `to_world`."""
        return (p_world - np.array(self.origin_mm) * MM) @ self._R_world_drawing / self.scale


def tissues(
    file: Path,
    frame_table: AnatomyTable,
    tables: Mapping[str, TissueTable],
    anatomy: Mechanism,
    poses: Mapping[str, Array],
) -> tuple[Tissue, ...]:
    """Return the organs of a scene, in the World.

    `frame_table` describes the frame of the drawing; `tables` is {name of the organ's body in `anatomy`: material};
    `poses` is {body: T_drawing_body (4, 4)}. Error messages name the scene file `file`.

    Raises:
        TwinError: a body is missing, or its surface is open, inverted or too fine.
    """
    bodies = {body.name: body for body in anatomy.bodies}
    organs = []
    for name, table in tables.items():
        if name not in bodies:
            raise TwinError(f"{file}: tissue: {unknown('body of the anatomy', name, bodies)}")
        parts = bodies[name].meshes
        if len(parts) != 1:
            raise TwinError(f"{file}: tissue '{name}' has {len(parts)} parts; draw it as one solid")
        T = poses[name]
        vertices = frame_table.to_world(parts[0].vertices @ T[:3, :3].T + T[:3, 3])
        try:
            surface = Surface(name, vertices, parts[0].triangles, table.edge_mm * MM)
        except TwinError as error:
            raise TwinError(f"{file}: {error}") from None
        pins = []
        for pin in table.pin:
            pins.append(Pin(pin.name, np.array(pin.low_mm) * MM, np.array(pin.high_mm) * MM))
        tissue = Tissue(
            name, surface, table.cells, table.young_kpa * 1e3, table.poisson, table.damping_s, table.density_kg_m3,
            table.friction, tuple(pins), parts[0].color_rgba, table.upright,
        )  # fmt: skip
        organs.append(tissue)
    return tuple(organs)


def listed(tables: Mapping[str, TissueTable]) -> Iterator[Parameter]:
    """Yield the numbers of the organs as parameters with provenance."""
    for name, table in tables.items():
        rows: list[Row] = [
            ("edge", table.edge_mm, "mm"),
            ("Young's modulus", table.young_kpa, "kPa"),
            ("Poisson's ratio", table.poisson, "1"),
            ("damping", table.damping_s, "s"),
            ("density", table.density_kg_m3, "kg/m3"),
            ("friction", table.friction, "1"),
        ]
        for axis, count in enumerate(table.cells, 1):
            rows.append((f"cells {axis}", count, "1"))
        yield from table.parameters(f"tissue {name}", rows)
        for pin in table.pin:
            corners = (("low", pin.low_mm, "mm"), ("high", pin.high_mm, "mm"))
            yield from table.parameters(f"tissue {name} pin {pin.name}", corners)
