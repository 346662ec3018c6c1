"""The scene file: which robots stand where, through which ports they work, what stands around."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from twin.core import spatial
from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.schema import Identifier, Origin, Table, Vector, error_at, load_toml


class PortTable(Table):
    """A trocar in the patient, in world."""

    position_mm: Vector
    provenance: Origin
    note: str = Field(min_length=1)


class RobotTable(Table):
    """A robot: its base frame in world, upright, turned by `yaw_deg` about z."""

    name: Identifier
    protocol: Identifier
    port: Identifier
    position_mm: Vector
    yaw_deg: float
    provenance: Origin
    note: str = Field(min_length=1)


class CameraTable(Table):
    """A camera on a frame of a robot, looking along the frame's z with its -y up."""

    robot: Identifier
    frame: Identifier
    view_deg: float = Field(gt=1, lt=170)
    provenance: Origin
    note: str = Field(min_length=1)


class SceneTable(Table):
    """The whole file. `props` is a description like a robot's, without driven joints; its base stands in world."""

    name: Identifier
    title: str
    source: str
    props: str | None = None
    clearance_mm: float = Field(gt=0)
    touching: list[tuple[str, str]] = Field(default_factory=list)
    port: dict[Identifier, PortTable]
    robot: list[RobotTable] = Field(min_length=1)
    camera: dict[Identifier, CameraTable] = Field(default_factory=dict)


@dataclass(frozen=True)
class Place:
    """A robot in a scene: T_world_base (4, 4), and the port (3,) in world it works through."""

    name: str
    protocol: str
    T_world_base: Array
    port: str
    p_world_port: Array


@dataclass(frozen=True)
class Scene:
    """A checked scene.

    Attributes:
        name, title, source: what it is.
        file: where it was read.
        props: description of what stands around, or None.
        places: the robots.
        clearance: minimum clearance in m that must be kept.
        touching: pairs of "owner/body" that touch by design.
        cameras: by name.
        parameters: every number with its provenance.
    """

    name: str
    title: str
    source: str
    file: Path
    props: Path | None
    places: tuple[Place, ...]
    clearance: float
    touching: frozenset[frozenset[str]]
    cameras: dict[str, CameraTable]
    parameters: tuple[Parameter, ...]


def load_scene(path: Path) -> Scene:
    """Return the scene in a TOML file.

    Raises:
        DescriptionError: file, line, key, value and what would be right.
    """
    table = load_toml(path, SceneTable)
    names = [r.name for r in table.robot]
    for k, robot in enumerate(table.robot):
        if robot.port not in table.port:
            raise error_at(path, ("robot", k, "port"), unknown("port", robot.port, table.port))
        if names.count(robot.name) > 1:
            raise error_at(path, ("robot", k, "name"), f"'{robot.name}' stands there twice")
    for name, camera in table.camera.items():
        if camera.robot not in names:
            raise error_at(path, ("camera", name, "robot"), unknown("robot", camera.robot, names))
    props = None if table.props is None else path.parent / table.props
    if props is not None and not props.is_file():
        raise error_at(path, ("props",), f"there is no file {props.name} beside it")
    return Scene(
        table.name,
        table.title,
        table.source,
        path,
        props,
        tuple(_place(r, table) for r in table.robot),
        table.clearance_mm * MM,
        frozenset(frozenset(p) for p in table.touching),
        dict(table.camera),
        tuple(_parameters(table)),
    )


def _place(r: RobotTable, table: SceneTable) -> Place:
    T = spatial.pose(spatial.rotation_z(r.yaw_deg * DEG), np.array(r.position_mm) * MM)
    return Place(r.name, r.protocol, T, r.port, np.array(table.port[r.port].position_mm) * MM)


def _parameters(table: SceneTable) -> list[Parameter]:
    out = []
    for name, port in table.port.items():
        for axis, v in zip("xyz", port.position_mm, strict=True):
            out.append(Parameter(f"port {name} {axis}", v * MM, "mm", v, port.provenance, port.note))
    for r in table.robot:
        for axis, v in zip("xyz", r.position_mm, strict=True):
            out.append(Parameter(f"{r.name} {axis}", v * MM, "mm", v, r.provenance, r.note))
        out.append(Parameter(f"{r.name} yaw", r.yaw_deg * DEG, "deg", r.yaw_deg, r.provenance, r.note))
    return out
