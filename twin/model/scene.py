"""The scene file: which robots stand where, through which ports they work, what stands around."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.errors import unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.schema import Identifier, Origin, Table, Vector, at, error_at, load_toml


class PortTable(Table):
    """A trocar in the patient, in world."""

    position_mm: Vector
    provenance: Origin
    note: str = Field(min_length=1)


class RobotTable(Table):
    """A robot: its base frame in world, upright, turned by `yaw_deg` about z; the port of its trocar, or of each."""

    name: Identifier
    protocol: Identifier
    port: Identifier | None = None
    ports: dict[Identifier, Identifier] = Field(default_factory=dict)
    position_mm: Vector
    yaw_deg: float
    provenance: Origin
    note: str = Field(min_length=1)

    @model_validator(mode="after")
    def _one_way(self) -> RobotTable:
        if (self.port is None) == (not self.ports):
            raise at("port", 'give the `port` of its only trocar, or `ports = { TROCAR = "PORT" }` of several')
        return self


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
    """A robot in a scene: T_world_base (4, 4), and by trocar the ports that it works through, (3,) in world.

    The trocar "" is the only one, or the first RCM of the protocol.
    """

    name: str
    protocol: str
    T_world_base: Array
    ports: Mapping[str, str]
    p_world_ports: Mapping[str, Array]

    @property
    def port(self) -> str:
        """The name of its port, or the names of several."""
        return ", ".join(self.ports.values())


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
        for trocar, port in _ports(robot).items():
            if port not in table.port:
                keys = ("robot", k, "ports", trocar) if trocar else ("robot", k, "port")
                raise error_at(path, keys, unknown("port", port, table.port))
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
    ports = _ports(r)
    return Place(r.name, r.protocol, T, ports, {t: np.array(table.port[p].position_mm) * MM for t, p in ports.items()})


def _ports(r: RobotTable) -> dict[str, str]:
    return dict(r.ports) if r.port is None else {"": r.port}


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
