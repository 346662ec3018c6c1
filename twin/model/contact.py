"""The tables of movable objects in a scene, and of their contact with props and instruments."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.core.units import MM, linear_rgba
from twin.model.movable import Movable, ShapeName
from twin.schema import Identifier, Row, Sourced, Vector, at, error_at


class ObjectTable(Sourced):
    """A movable object. Instruments can grasp and push the object, but only during a task that names it.

    `size_mm` has two values for a ring (radius of the wire's centre line, radius of the wire), three for a box (edge
    lengths) and one for a ball (radius). At the start, the centre of the object is at `position_mm` in the world frame,
    and the axis of a ring is along `axis`.
    """

    shape: ShapeName
    size_mm: list[float] = Field(min_length=1, max_length=3)
    mass_g: float = Field(ge=0.001, le=10_000)
    friction: float = Field(
        ge=0, le=2, description="coefficient of sliding friction; in a contact, the larger of two coefficients applies"
    )
    position_mm: Vector
    axis: Vector = (0.0, 0.0, 1.0)
    color: str = Field("#999999", pattern="^#[0-9a-f]{6}$", description="sRGB")

    @model_validator(mode="after")
    def _whole(self) -> ObjectTable:
        count = {"ring": 2, "box": 3, "ball": 1}[self.shape]
        if len(self.size_mm) != count or min(self.size_mm) <= 0:
            lengths = f"{count} lengths"
            if count == 1:
                lengths = "1 length"
            raise at("size_mm", f"a {self.shape} needs {lengths} above 0; {self.size_mm} was given")
        if self.shape == "ring" and self.size_mm[0] <= self.size_mm[1]:
            raise at("size_mm", f"a ring needs a hole: the wire's radius {self.size_mm[1]:g} mm is not below "
                     f"{self.size_mm[0]:g} mm, the radius of its centre line")  # fmt: skip
        if not any(self.axis):
            raise at("axis", "the axis is a zero vector")
        length = math.hypot(*self.axis)
        if not 1e-6 <= length <= 1e6:  # squares of smaller or larger numbers lose digits
            raise at("axis", f"the axis has the length {length:g}; it must be 1e-6 to 1e6")
        return self


class ContactTable(Sourced):
    """Contact of movable objects with bodies of the props and with the instruments of the console.

    `solid` names the bodies of the props that objects can touch. `friction` is the friction coefficient of these bodies
    and of the instruments. `jaw_effort_n_mm` is the maximum torque of one jaw.
    """

    solid: list[Identifier] = Field(min_length=1)
    friction: float = Field(ge=0, le=2)
    jaw_effort_n_mm: float = Field(gt=0, le=1000)


def movable(name: str, table: ObjectTable) -> Movable:
    """Return the `Movable` that a table describes, in SI units."""
    axis = np.array(table.axis, float)
    R = spatial.frame_from_axes(axis, spatial.unit_across(axis))
    factor = 1.0
    if table.shape == "box":
        factor = 0.5  # the file has edges, `Movable` half edges
    size = []
    for length_mm in table.size_mm:
        size.append(length_mm * factor * MM)
    return Movable(
        name,
        table.shape,
        tuple(size),
        table.mass_g * 1e-3,
        table.friction,
        spatial.pose(R, np.array(table.position_mm) * MM),
        linear_rgba(table.color),
    )


def listed(objects: Mapping[str, ObjectTable], contact: ContactTable | None) -> Iterator[Parameter]:
    """Yield the numbers of all objects and of their contact as parameters with provenance."""
    for name, object_table in objects.items():
        rows: list[Row] = []
        for number, length_mm in enumerate(object_table.size_mm, 1):
            rows.append((f"size {number}", length_mm, "mm"))
        rows += [
            ("mass", object_table.mass_g, "g"),
            ("friction", object_table.friction, "1"),
            ("", object_table.position_mm, "mm"),
        ]
        yield from object_table.parameters(f"object {name}", rows)
    if contact is not None:
        numbers = (("friction", contact.friction, "1"), ("jaw effort", contact.jaw_effort_n_mm, "N mm"))
        yield from contact.parameters("contact", numbers)


def require_contact(path: Path, task: str, kind: str, contact: ContactTable | None) -> None:
    """Raise an error if a task of a kind with movable objects is in a scene without a section [contact]."""
    if contact is None:
        raise error_at(path, ("task", task), f"a task with `{kind}` requires a section [contact] in this file")


def check_ring(path: Path, keys: tuple[str | int, ...], name: str, objects: Mapping[str, ObjectTable]) -> None:
    """Raise an error if the object that a task names at `keys` is not in the scene, or is not a ring."""
    if name not in objects:
        raise error_at(path, keys, unknown("object", name, objects))
    shape = objects[name].shape
    if shape != "ring":
        raise error_at(path, keys, f"'{name}' is a {shape}; only a ring goes around a peg or a wire")
