"""The scene file: positions of robots, their ports, cameras, a console with its tasks, movable objects, and props."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, create_model, model_validator

from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, MM, linear_rgba
from twin.model import anatomy, console, contact, task, tool, trainer, vessel
from twin.model.anatomy import AnatomyTable, TissueTable
from twin.model.console import CameraTable, ConsoleTable, HapticsTable
from twin.model.contact import ContactTable, ObjectTable
from twin.model.movable import Movable
from twin.model.task import ConsoleTask, TaskTable
from twin.model.tool import ToolTable
from twin.model.trainer import MODEL, TrainerTable
from twin.model.vessel import Vessel, VesselTable
from twin.schema import Identifier, Row, Sourced, Table, Vector, at, error_at, load_toml

ProtocolSource = Annotated[str, Field(pattern=r"^([a-z][a-z0-9_]*|.+\.toml)$")]
"""Name of a protocol, or path of its file."""


class PortTable(Sourced):
    """A port: the position in mm of a trocar in the patient, in the world frame."""

    position_mm: Vector


class RobotTable(Sourced):
    """A robot in the scene: base position in the world frame, yaw about the vertical z axis, and ports of its trocars.

    `protocol` is the name of a protocol of the robot, or the path of a protocol file relative to the folder of the
    scene; `protocol` is optional if the scene has a console. `robot` is the name of the built-in robot; default:
    `name`. Two equal robots need different values of `name`. `start` gives joint values in deg or mm at the start of
    console control; joints that are not in `start` start as in the posture home.
    """

    name: Identifier
    robot: Identifier | None = None
    start: dict[Identifier, float] = Field(default_factory=dict)
    protocol: ProtocolSource | None = None
    port: Identifier | None = None
    ports: dict[Identifier, Identifier] = Field(default_factory=dict)
    position_mm: Vector
    yaw_deg: float

    @model_validator(mode="after")
    def _one_way(self) -> RobotTable:
        if (self.port is None) == (not self.ports):
            raise at("port", 'give `port` for a robot with one trocar, or `ports = { TROCAR = "PORT" }` for several')
        return self


class BlockTable(Table):
    """A device, controller, plant or hazard of the World: the file or entry point to use, and its settings."""

    use: Identifier
    settings: dict[Identifier, float | int | str | bool | list[float]] = Field(default_factory=dict)


class SceneTable(Table):
    """The content of a scene file. `props` is the file that describes the props; no joint of the props is driven."""

    name: Identifier
    title: str
    source: str
    props: str | None = None
    clearance_mm: float = Field(gt=0)
    touching: list[tuple[str, str]] = Field(default_factory=list)
    port: dict[Identifier, PortTable]
    robot: list[RobotTable] = Field(min_length=1)
    camera: dict[Identifier, CameraTable] = Field(default_factory=dict)
    console: ConsoleTable | None = None
    trainer: TrainerTable | None = None
    object: dict[Identifier, ObjectTable] = Field(default_factory=dict)
    contact: ContactTable | None = None
    haptics: HapticsTable | None = None
    anatomy: AnatomyTable | None = None
    tissue: dict[Identifier, TissueTable] = Field(default_factory=dict)
    vessel: dict[Identifier, VesselTable] = Field(default_factory=dict)
    tool: dict[Identifier, ToolTable] = Field(default_factory=dict)
    task: dict[Identifier, TaskTable] = Field(default_factory=dict)
    device: dict[Identifier, BlockTable] = Field(default_factory=dict)
    controller: dict[Identifier, BlockTable] = Field(default_factory=dict)
    plant: dict[Identifier, BlockTable] = Field(default_factory=dict)
    hazard: dict[Identifier, BlockTable] = Field(default_factory=dict)


@cache
def scene_table() -> type[SceneTable]:
    """Return the table of a scene file, in which tasks of all kinds are accepted."""
    tasks = (dict[Identifier, task.task_table()], Field(default_factory=dict))
    return create_model("SceneTable", __base__=SceneTable, __doc__=SceneTable.__doc__, task=tasks)


@dataclass(frozen=True)
class Place:
    """A robot in a scene: T_world_base (4, 4), and {trocar: position (3,) of its port in the world frame, in m}.

    The trocar name "" means the robot's only trocar or, without trocars, the first RCM of the protocol. `robot` is the
    name of the built-in robot; `protocol` is the name of one of its protocols, or the path of a file; `start` gives
    joint values in deg or mm at the start of console control.
    """

    name: str
    robot: str
    protocol: str
    T_world_base: Array
    ports: Mapping[str, str]
    p_world_ports: Mapping[str, Array]
    start: Mapping[str, float]

    @property
    def protocol_name(self) -> str:
        """Name of the protocol; for a file, its name without suffix."""
        if self.protocol.endswith(".toml"):
            return Path(self.protocol).stem
        return self.protocol

    @property
    def port(self) -> str:
        """Names of the ports, separated by commas."""
        return ", ".join(self.ports.values())


@dataclass(frozen=True)
class Scene:
    """A checked scene.

    `clearance` is the required minimum clearance in m. `touching` has pairs of bodies, each as "owner/body", that touch
    by design and are not checked for clearance. `parameters` has every number with its provenance. An optional part
    that the file does not describe is None or empty; if `haptics` is None, the default forces on the hands apply.
    `blocks` has the blocks that the file adds to the World of the console, by folder of `twin/simulation` and name.
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
    console: ConsoleTable | None
    trainer: TrainerTable | None
    objects: tuple[Movable, ...]
    contact: ContactTable | None
    haptics: HapticsTable | None
    anatomy: AnatomyTable | None
    tissues: Mapping[str, TissueTable]
    vessels: tuple[Vessel, ...]
    tools: Mapping[str, ToolTable]
    tasks: Mapping[str, ConsoleTask]
    parameters: tuple[Parameter, ...]
    blocks: Mapping[str, Mapping[str, BlockTable]]

    @property
    def has_protocols(self) -> bool:
        """Whether every robot has a protocol."""
        return not self._without_protocol()

    def _without_protocol(self) -> list[str]:
        """Return the names of the robots without a protocol."""
        return [place.name for place in self.places if not place.protocol]

    @property
    def models(self) -> tuple[Place, ...]:
        """The `Place` of the model of each machine: the machine's `Place` with `MODEL` added to its name."""
        if self.trainer is None:
            return ()
        models = []
        for place in self.places:
            if place.name in self.trainer.robots:
                models.append(replace(place, name=place.name + MODEL))
        return tuple(models)

    def require_protocols(self) -> None:
        """Raise if a robot has no protocol to play.

        Raises:
            TwinError: a robot has no protocol; the message names it and the command that opens the console.
        """
        lacking = self._without_protocol()
        if lacking:
            raise TwinError(
                f"scene '{self.name}' cannot be played: {self.file.name} has no protocol for {', '.join(lacking)}. "
                f"Operate it from its console: `twin serve {self.name}` or `twin view {self.name}`"
            )


def load_scene(path: Path) -> Scene:
    """Return the checked scene from a TOML file.

    Raises:
        DescriptionError: the file is malformed; the message gives file, line, key, value and allowed values.
    """
    table = load_toml(path, scene_table())
    names = [robot.name for robot in table.robot]
    _robots(path, table, names)
    for k, pair in enumerate(table.touching):
        _check_touching_pair(path, k, pair, names)
    for name, camera in table.camera.items():
        if camera.robot not in names:
            raise error_at(path, ("camera", name, "robot"), unknown("robot", camera.robot, names))
    if table.console is not None:
        console.check(path, table.console, table.camera, names)
    trainer.check(path, table.trainer, table.console, names)
    for name, task_table in table.task.items():
        if table.console is None and task_table.kind.console:
            raise error_at(path, ("task", name), "a task needs a console: add a section [console]")
    if table.console is None:
        for section in ("device", "controller", "plant", "hazard"):
            for name in getattr(table, section):
                text = "blocks belong to the World of a console: add a section [console], or remove this section"
                raise error_at(path, (section, name), text)
    props = None
    if table.props is not None:
        props = path.parent / table.props
        if not props.is_file():
            raise error_at(path, ("props",), f"there is no file {props.name} in the folder of the scene")
    _organs(path, table, names)
    _tools(path, table, names)
    for name, task_table in table.task.items():  # the goal of a procedure names tools, which are checked before
        task_table.kind.check(path, name, task_table.value, table, names)
    places = []
    for robot in table.robot:
        places.append(_place(robot, table, path.parent))
    objects = []
    for name, object_table in table.object.items():
        objects.append(contact.movable(name, object_table))
    vessels = []
    for name, vessel_table in table.vessel.items():
        vessels.append(_vessel(path, name, vessel_table))
    tasks = {}
    for name, task_table in table.task.items():
        tasks[name] = task.task_of(name, task_table)
    return Scene(
        table.name,
        table.title,
        table.source,
        path,
        props,
        tuple(places),
        table.clearance_mm * MM,
        frozenset(map(frozenset, table.touching)),
        dict(table.camera),
        table.console,
        table.trainer,
        tuple(objects),
        table.contact,
        table.haptics,
        table.anatomy,
        dict(table.tissue),
        tuple(vessels),
        dict(table.tool),
        tasks,
        tuple(_parameters(table)),
        {"devices": table.device, "controllers": table.controller, "plants": table.plant, "hazards": table.hazard},
    )


def _robots(path: Path, table: SceneTable, names: list[str]) -> None:
    """Raise an error if a robot has no protocol, an unknown file or port, or the name of another robot."""
    for place, robot in enumerate(table.robot):
        if robot.protocol is None and table.console is None:
            message = "this robot has no protocol: add the key protocol, or a section [console]"
            raise error_at(path, ("robot", place), message)
        protocol = robot.protocol or ""
        if protocol.endswith(".toml") and not (path.parent / protocol).is_file():
            raise error_at(
                path, ("robot", place, "protocol"), f"there is no file {protocol} in the folder of the scene"
            )
        for trocar, port in _ports(robot).items():
            if port not in table.port:
                keys: tuple[str | int, ...] = ("robot", place, "port")
                if trocar:
                    keys = ("robot", place, "ports", trocar)
                raise error_at(path, keys, unknown("port", port, table.port))
        if names.count(robot.name) > 1:
            raise error_at(
                path, ("robot", place, "name"), f"'{robot.name}' is listed twice; give each robot its own name"
            )


def _place(robot: RobotTable, table: SceneTable, folder: Path) -> Place:
    """Return the `Place` that a table describes, in SI units; `folder` is that of the scene file."""
    R = spatial.rotation_z(robot.yaw_deg * DEG)
    T_world_base = spatial.pose(R, np.array(robot.position_mm) * MM)
    ports = _ports(robot)
    positions = {}
    for trocar, port in ports.items():
        positions[trocar] = np.array(table.port[port].position_mm) * MM
    protocol = robot.protocol or ""
    if protocol.endswith(".toml"):
        protocol = str(folder / protocol)
    model = robot.robot or robot.name
    return Place(robot.name, model, protocol, T_world_base, ports, positions, dict(robot.start))


def _check_touching_pair(path: Path, place: int, pair: tuple[str, str], names: list[str]) -> None:
    """Raise an error if an entry of `touching` is not two different bodies, or if neither body belongs to a robot."""
    for full in pair:
        if full.count("/") != 1:
            raise error_at(path, ("touching", place), f"'{full}' is not a body; write \"owner/body\"")
    if pair[0] == pair[1]:
        raise error_at(path, ("touching", place), f"give two different bodies; both are '{pair[0]}'")
    first = pair[0].split("/")[0]
    second = pair[1].split("/")[0]
    if first not in names and second not in names:
        raise error_at(path, ("touching", place), unknown("robot", first, names))


def _vessel(path: Path, name: str, table: VesselTable) -> Vessel:
    """Return the `Vessel` that a table describes; an error names the scene file `path` and the key."""
    try:
        return vessel.vessel(name, table, linear_rgba(table.color))
    except TwinError as error:
        raise error_at(path, ("vessel", name, "line_mm"), str(error)) from None


def _organs(path: Path, table: SceneTable, names: list[str]) -> None:
    """Check the sections [anatomy] and [tissue] of a scene.

    Raise an error if only one of the sections is present, if the file of the organs is missing, or if a link in
    `touching` names an unknown robot.
    """
    if (table.anatomy is None) != (not table.tissue):
        missing_section = "anatomy"
        if table.anatomy is None:
            missing_section = "tissue"
        raise error_at(
            path, (missing_section,), "organs need both a section [anatomy] and a section [tissue.NAME] for each organ"
        )
    if table.anatomy is None:
        return
    if not (path.parent / table.anatomy.file).is_file():
        raise error_at(path, ("anatomy", "file"), f"there is no file {table.anatomy.file}")
    for name in table.anatomy.touching:
        robot = name.split("/")[0]
        if robot not in names:
            raise error_at(path, ("anatomy", "touching"), unknown("robot", robot, names))


def _tools(path: Path, table: SceneTable, names: list[str]) -> None:
    """Raise an error if a vessel or a tool names something that the scene does not have."""
    for name, vessel_table in table.vessel.items():
        if vessel_table.organ is not None and vessel_table.organ not in table.tissue:
            raise error_at(path, ("vessel", name, "organ"), unknown("tissue", vessel_table.organ, table.tissue))
    for name, tool_table in table.tool.items():
        for robot in tool_table.robots:
            if robot not in names:
                raise error_at(path, ("tool", name, "robots"), unknown("robot", robot, names))


def _ports(table: RobotTable) -> dict[str, str]:
    """Return {trocar: name of its port} of a robot."""
    if table.port is None:
        return dict(table.ports)
    return {"": table.port}  # "" is the only trocar or the first RCM, see `Place`


def _parameters(table: SceneTable) -> Iterator[Parameter]:
    """Yield every number of a scene file, with its provenance."""
    for name, port in table.port.items():
        yield from port.parameters(f"port {name}", [("", port.position_mm, "mm")])
    for robot in table.robot:
        rows: list[Row] = [("", robot.position_mm, "mm")]
        for joint, value in robot.start.items():
            rows.append((f"start {joint}", value, "deg or mm"))
        rows.append(("yaw", robot.yaw_deg, "deg"))
        yield from robot.parameters(robot.name, rows)
    yield from console.listed(table.console, table.haptics)
    yield from trainer.listed(table.trainer)
    yield from contact.listed(table.object, table.contact)
    yield from anatomy.listed(table.tissue)
    for name, vessel_table in table.vessel.items():
        yield from vessel.listed(name, vessel_table)
    for name, tool_table in table.tool.items():
        yield from tool.listed(name, tool_table)
    for name, task_table in table.task.items():
        yield from task.listed(name, task_table)
