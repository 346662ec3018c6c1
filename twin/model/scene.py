"""The scene file: positions of robots, their ports, cameras, a console with its tasks, movable objects, and props."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG, MM, linear
from twin.model import alignment, anatomy, procedure, tool, vessel
from twin.model.alignment import Alignment
from twin.model.anatomy import AnatomyTable, TissueTable
from twin.model.movable import Movable, ShapeName
from twin.model.procedure import ProcedureTable
from twin.model.tool import ToolTable
from twin.model.vessel import Vessel, VesselTable
from twin.schema import Identifier, Origin, Table, Vector, at, error_at, load_toml


class PortTable(Table):
    """A port: the position in mm of a trocar in the patient, in the world frame."""

    position_mm: Vector
    provenance: Origin
    note: str = Field(min_length=1)


class RobotTable(Table):
    """A robot in the scene: base position in the world frame, yaw about the vertical z axis, and ports of its trocars.

    `protocol` is optional if the scene has a console. `robot` is the name of the built-in robot if `name` differs: a
    scene may have two robots of one kind. `start` holds joint values in deg or mm at which console control starts;
    other joints start as in the posture home.
    """

    name: Identifier
    robot: Identifier | None = None
    start: dict[Identifier, float] = Field(default_factory=dict)
    protocol: Identifier | None = None
    port: Identifier | None = None
    ports: dict[Identifier, Identifier] = Field(default_factory=dict)
    position_mm: Vector
    yaw_deg: float
    provenance: Origin
    note: str = Field(min_length=1)

    @model_validator(mode="after")
    def _one_way(self) -> RobotTable:
        if (self.port is None) == (not self.ports):
            raise at("port", 'give `port` for a robot with one trocar, or `ports = { TROCAR = "PORT" }` for several')
        return self


class StereoTable(Table):
    """Two lenses side by side: the distance between them, and the distance at which their lines of sight meet."""

    baseline_mm: float = Field(gt=0, le=200)
    converge_mm: float = Field(gt=0, le=10_000)


class CameraTable(Table):
    """A camera on a robot frame: it looks along the frame's z axis, with -y up, rotated by `roll_deg` about z.

    With `stereo`, it has two lenses, one on each side of the frame's origin at half the baseline.
    """

    robot: Identifier
    frame: Identifier
    roll_deg: float = 0.0
    view_deg: float = Field(gt=1, lt=170)
    stereo: StereoTable | None = None
    provenance: Origin
    note: str = Field(min_length=1)

    @property
    def in_frame(self) -> Array:
        """Pose (4, 4) of the camera in its frame: a rotation by the roll angle about z."""
        return spatial.pose(spatial.rotation_z(self.roll_deg * DEG))


class CameraRangeTable(Table):
    """Ranges of a console's camera about its port, each (lowest, highest)."""

    pan_deg: tuple[float, float]
    tilt_deg: tuple[float, float]
    depth_mm: tuple[float, float]
    roll_deg: tuple[float, float]

    @model_validator(mode="after")
    def _in_order(self) -> CameraRangeTable:
        for key in ("pan_deg", "tilt_deg", "depth_mm", "roll_deg"):
            low, high = getattr(self, key)
            if not low < high:
                raise at(key, f"the lowest value, {low:g}, must be below the highest, {high:g}")
        return self


class ConsoleTable(Table):
    """A surgeon's console: robots of each hand, in the order of selection by clutch taps, and the shared camera.

    `tip` is the frame of these robots that touches targets and whose path is measured; default: the tool frame.
    `instrument_mm` is the length of a robot's instrument from its tip to its outer end: such a hand can also lead the
    outer end. `through` names robots whose shaft, the z axis of the tool, is kept in the port by the controller,
    because no mechanism does it. `camera_range` replaces the range of the da Vinci's endoscope.
    """

    right: list[Identifier] = Field(min_length=1)
    left: list[Identifier] = Field(min_length=1)
    camera: Identifier
    tip: Identifier | None = None
    scale: float = Field(ge=0.05, le=1)
    through: list[Identifier] = Field(default_factory=list)
    instrument_mm: dict[Identifier, Annotated[float, Field(ge=50, le=1000)]] = Field(default_factory=dict)
    camera_range: CameraRangeTable | None = None
    provenance: Origin
    note: str = Field(min_length=1)

    @model_validator(mode="after")
    def _lengths(self) -> ConsoleTable:
        for name in self.through:
            if name not in self.instrument_mm:
                raise at("through", f"'{name}' needs the length of its instrument in `instrument_mm`")
        return self


class ObjectTable(Table):
    """A movable object. Instruments grasp and push it in tasks that name it.

    `size_mm` of a ring: the radius of its wire's centre line, and the radius of the wire; of a box: its three edges; of
    a ball: its radius. At the start, its centre is at `position_mm` in the world frame, and the axis of a ring is along
    `axis`.
    """

    shape: ShapeName
    size_mm: list[float] = Field(min_length=1, max_length=3)
    mass_g: float = Field(ge=0.001, le=10_000)
    friction: float = Field(
        ge=0, le=2, description="coefficient of sliding friction; in a contact, the larger one applies"
    )
    position_mm: Vector
    axis: Vector = (0.0, 0.0, 1.0)
    color: str = Field("#999999", pattern="^#[0-9a-f]{6}$", description="sRGB")
    provenance: Origin
    note: str = Field(min_length=1)

    @model_validator(mode="after")
    def _whole(self) -> ObjectTable:
        count = {"ring": 2, "box": 3, "ball": 1}[self.shape]
        if len(self.size_mm) != count or min(self.size_mm) <= 0:
            lengths = "1 length" if count == 1 else f"{count} lengths"
            raise at("size_mm", f"a {self.shape} needs {lengths} above 0; {self.size_mm} was given")
        if self.shape == "ring" and self.size_mm[0] <= self.size_mm[1]:
            raise at("size_mm", f"a ring needs a hole: the wire's radius {self.size_mm[1]:g} mm is not below "
                     f"{self.size_mm[0]:g} mm, the radius of its centre line")  # fmt: skip
        if not np.linalg.norm(self.axis) > 0:
            raise at("axis", "the axis is a zero vector")
        return self


class ContactTable(Table):
    """Contact of movable objects with bodies of the props and with the instruments of the console.

    `solid` names the bodies of the props. `jaw_effort_n_mm` is the largest torque of one jaw. `friction` is the
    coefficient of these bodies and of the instruments.
    """

    solid: list[Identifier] = Field(min_length=1)
    friction: float = Field(ge=0, le=2)
    jaw_effort_n_mm: float = Field(gt=0, le=1000)
    provenance: Origin
    note: str = Field(min_length=1)


class HapticsTable(Table):
    """Forces on the hands: stiffness and damping of all surfaces; forces are clipped at `largest_n`.

    `device_damping_ns_m` is the damping of the device with the fingers that hold it, which makes the sampled surface
    passive. `on` is the switch at the start.
    """

    stiffness_n_m: float = Field(gt=0, le=10_000)
    damping_ns_m: float = Field(ge=0, le=1000)
    largest_n: float = Field(gt=0, le=50)
    device_damping_ns_m: float = Field(gt=0, le=1000)
    on: bool = True
    provenance: Origin
    note: str = Field(min_length=1)


class TransferTable(Table):
    """A ring to bring to a peg: names of the object and of the part of a solid body that is the peg."""

    ring: Identifier
    peg: Identifier


class TargetTable(Table):
    """A target: the points in the world frame, in mm, that the tips of the hands must touch at the same time."""

    name: Identifier
    right_mm: Vector | None = None
    left_mm: Vector | None = None

    @model_validator(mode="after")
    def _someone(self) -> TargetTable:
        if self.right_mm is None and self.left_mm is None:
            raise at("name", "a target needs `right_mm`, `left_mm`, or both")
        return self


class AlignTable(Table):
    """A green rectangle on a plate, and a grey line in the middle of the picture; the camera is to align them.

    The rectangle's middle is at `position_mm` in the world frame; `facing` points out of the plate; `roll_deg` turns
    the rectangle about `facing`, from its upper side being horizontal. `line` is the length of the line divided by the
    height of the picture. The task is done if, at the end, the upper side of the rectangle is within `tolerance_deg`
    of the line, and its ends are within `tolerance_line` times the length of the line from the line's ends.
    """

    position_mm: Vector
    facing: Vector
    roll_deg: float = Field(gt=-45, lt=45)
    size_mm: tuple[float, float]
    plate_mm: tuple[float, float]
    color: str = Field("#20a040", pattern="^#[0-9a-f]{6}$", description="sRGB; green exceeds red and blue")
    line: float = Field(ge=0.1, le=0.95)
    tolerance_deg: float = Field(gt=0, le=10)
    tolerance_line: float = Field(gt=0, le=0.5)

    @model_validator(mode="after")
    def _whole(self) -> AlignTable:
        if not np.linalg.norm(self.facing[:2]) > 0:
            raise at("facing", f"{list(self.facing)} is vertical: the plate then has no upper side")
        if min(self.size_mm) <= 0:
            raise at("size_mm", f"width and height must be above 0 mm; {list(self.size_mm)} was given")
        if min(p - s for p, s in zip(self.plate_mm, self.size_mm, strict=True)) <= 0:
            raise at("plate_mm", f"the plate {list(self.plate_mm)} must be larger than the rectangle")
        red, green, blue = (int(self.color[k : k + 2], 16) for k in (1, 3, 5))
        if green < 1.5 * max(red, blue):
            raise at("color", f"{self.color} is not green enough to be found in the picture: green must be at least "
                     "1.5 times red and blue")  # fmt: skip
        return self


class TaskTable(Table):
    """A task: targets to touch in this order, rings to bring to pegs, a camera to align, or a surgical procedure.

    A target is touched when all its tips have been within the tolerance for `hold_s`, without interruption. A ring is
    transferred when it lies around its peg and nothing holds it. For `align`, see `AlignTable`; for `procedure`, which
    needs no console, `ProcedureTable`.
    """

    title: str = Field(min_length=1)
    tolerance_mm: float | None = Field(None, gt=0)
    hold_s: float | None = Field(None, ge=0, le=10)
    target: list[TargetTable] = Field(default_factory=list)
    transfer: list[TransferTable] = Field(default_factory=list)
    align: AlignTable | None = None
    procedure: ProcedureTable | None = None
    provenance: Origin
    note: str = Field(min_length=1)

    @model_validator(mode="after")
    def _one_kind(self) -> TaskTable:
        kinds = [name for name in ("target", "transfer", "align", "procedure") if getattr(self, name)]
        if len(kinds) != 1:
            found = " and ".join(f"`{k}`" for k in kinds) or "none of them"
            raise at(
                "title",
                "a task needs a goal: `target` or `transfer` with at least one entry, `align` or `procedure`; it has "
                f"{found}",
            )
        for key in ("tolerance_mm", "hold_s"):
            if (getattr(self, key) is None) == bool(self.target):
                raise at("title" if self.target else key, f"a task with `{kinds[0]}` "
                         f"{'needs' if self.target else 'takes no'} `{key}`")  # fmt: skip
        return self


class SceneTable(Table):
    """The scene file. `props` names a description like that of a robot, in the world frame, without driven joints."""

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
    object: dict[Identifier, ObjectTable] = Field(default_factory=dict)
    contact: ContactTable | None = None
    haptics: HapticsTable | None = None
    anatomy: AnatomyTable | None = None
    tissue: dict[Identifier, TissueTable] = Field(default_factory=dict)
    vessel: dict[Identifier, VesselTable] = Field(default_factory=dict)
    tool: dict[Identifier, ToolTable] = Field(default_factory=dict)
    task: dict[Identifier, TaskTable] = Field(default_factory=dict)


@dataclass(frozen=True)
class Target:
    """A target of a task: its name and, by hand ("right", "left"), the point (3,) in m in the world frame."""

    name: str
    p_world: Mapping[str, Array]


@dataclass(frozen=True)
class Transfer:
    """A ring, by name, to bring to a peg, which is a part of a body in the props."""

    ring: str
    peg: str


@dataclass(frozen=True)
class Task:
    """A task; it has targets, transfers, an alignment or a procedure. All but the last are for a console.

    Attributes:
        name, title: name and title.
        tolerance: largest distance in m of a tip from its point during a touch.
        hold: time in s for which all tips of a target must be within the tolerance.
        targets: the targets, in order.
        transfers: rings to bring to pegs.
        alignment: what the camera is to align, or None.
        procedure: the procedure, or None.
    """

    name: str
    title: str
    tolerance: float
    hold: float
    targets: tuple[Target, ...]
    transfers: tuple[Transfer, ...] = ()
    alignment: Alignment | None = None
    procedure: ProcedureTable | None = None


@dataclass(frozen=True)
class Place:
    """A robot in a scene: T_world_base (4, 4), and its ports by trocar, each (3,) in m in the world frame.

    The trocar name "" means the robot's only trocar or, without trocars, the first RCM of the protocol. `robot` is the
    name of the built-in robot; `start` holds joint values in deg or mm at which console control starts.
    """

    name: str
    robot: str
    protocol: str
    T_world_base: Array
    ports: Mapping[str, str]
    p_world_ports: Mapping[str, Array]
    start: Mapping[str, float]

    @property
    def port(self) -> str:
        """Names of the ports, separated by commas."""
        return ", ".join(self.ports.values())


@dataclass(frozen=True)
class Scene:
    """A checked scene.

    Attributes:
        name, title, source: name, title and source document.
        file: the scene file.
        props: description file of the props, or None.
        places: the robots with their positions and ports.
        clearance: required minimum clearance in m.
        touching: pairs of "owner/body" that touch by design.
        cameras: cameras by name.
        console: the surgeon's console, or None.
        objects: the movable objects.
        contact: contact of the objects, or None.
        haptics: numbers of the forces on the hands; None: the defaults.
        anatomy: where the organs are drawn and what touches them, or None.
        tissues: material of the organs by name.
        vessels: the vessels.
        tools: tools that the instruments can carry, by name.
        tasks: tasks, by name.
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
    console: ConsoleTable | None
    objects: tuple[Movable, ...]
    contact: ContactTable | None
    haptics: HapticsTable | None
    anatomy: AnatomyTable | None
    tissues: Mapping[str, TissueTable]
    vessels: tuple[Vessel, ...]
    tools: Mapping[str, ToolTable]
    tasks: Mapping[str, Task]
    parameters: tuple[Parameter, ...]

    @property
    def plays(self) -> bool:
        """Whether every robot has a protocol."""
        return all(p.protocol for p in self.places)

    def require_protocols(self) -> None:
        """Raise if a robot has no protocol to play.

        Raises:
            TwinError: a robot has no protocol; the message names it and the command that opens the console.
        """
        if not self.plays:
            lacking = ", ".join(p.name for p in self.places if not p.protocol)
            raise TwinError(
                f"scene '{self.name}' cannot be played: {lacking} have no protocol in {self.file.name}. "
                f"Operate it from its console: `twin serve {self.name}` or `twin view {self.name}`"
            )


def load_scene(path: Path) -> Scene:
    """Return the checked scene from a TOML file.

    Raises:
        DescriptionError: the file is malformed; the message gives file, line, key, value and allowed values.
    """
    table = load_toml(path, SceneTable)
    names = [r.name for r in table.robot]
    for k, robot in enumerate(table.robot):
        if robot.protocol is None and table.console is None:
            raise error_at(
                path, ("robot", k), "protocol is missing: a robot without a protocol needs a [console] in the scene"
            )
        for trocar, port in _ports(robot).items():
            if port not in table.port:
                keys = ("robot", k, "ports", trocar) if trocar else ("robot", k, "port")
                raise error_at(path, keys, unknown("port", port, table.port))
        if names.count(robot.name) > 1:
            raise error_at(path, ("robot", k, "name"), f"'{robot.name}' is listed twice")
    for name, camera in table.camera.items():
        if camera.robot not in names:
            raise error_at(path, ("camera", name, "robot"), unknown("robot", camera.robot, names))
    if (console := table.console) is not None:
        _console(path, console, table, names)
    for name, task in table.task.items() if console is None else ():
        if task.procedure is None:
            raise error_at(path, ("task", name), "a task needs a console: add the table [console]")
    for name, task in table.task.items():
        _transfers(path, name, task, table)
    props = None if table.props is None else path.parent / table.props
    if props is not None and not props.is_file():
        raise error_at(path, ("props",), f"there is no file {props.name} in the folder of the scene")
    _organs(path, table, names)
    _tools(path, table, names)
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
        table.console,
        tuple(_object(name, o) for name, o in table.object.items()),
        table.contact,
        table.haptics,
        table.anatomy,
        dict(table.tissue),
        tuple(vessel.vessel(name, v, _rgba(v.color)) for name, v in table.vessel.items()),
        dict(table.tool),
        {name: _task(name, task) for name, task in table.task.items()},
        tuple(_parameters(table)),
    )


def _place(r: RobotTable, table: SceneTable) -> Place:
    T = spatial.pose(spatial.rotation_z(r.yaw_deg * DEG), np.array(r.position_mm) * MM)
    ports = _ports(r)
    at = {t: np.array(table.port[p].position_mm) * MM for t, p in ports.items()}
    return Place(r.name, r.robot or r.name, r.protocol or "", T, ports, at, dict(r.start))


def _task(name: str, task: TaskTable) -> Task:
    targets = []
    for target in task.target:
        points = {"right": target.right_mm, "left": target.left_mm}
        targets.append(Target(target.name, {h: np.array(p) * MM for h, p in points.items() if p is not None}))
    transfers = tuple(Transfer(t.ring, t.peg) for t in task.transfer)
    return Task(
        name,
        task.title,
        (task.tolerance_mm or 0.0) * MM,
        task.hold_s or 0.0,
        tuple(targets),
        transfers,
        None if task.align is None else _alignment(task.align),
        task.procedure,
    )


def _alignment(a: AlignTable) -> Alignment:
    return Alignment(
        alignment.frame(np.array(a.position_mm) * MM, np.array(a.facing, float), a.roll_deg * DEG),
        (a.size_mm[0] * MM, a.size_mm[1] * MM),
        (a.plate_mm[0] * MM, a.plate_mm[1] * MM),
        _rgba(a.color),
        a.line,
        a.tolerance_deg * DEG,
        a.tolerance_line,
    )


def _transfers(path: Path, name: str, task: TaskTable, table: SceneTable) -> None:
    if task.transfer and table.contact is None:
        raise error_at(path, ("task", name), "a task with `transfer` needs the table [contact]")
    for k, transfer in enumerate(task.transfer):
        keys = ("task", name, "transfer", k, "ring")
        if transfer.ring not in table.object:
            raise error_at(path, keys, unknown("object", transfer.ring, table.object))
        if (shape := table.object[transfer.ring].shape) != "ring":
            raise error_at(path, keys, f"'{transfer.ring}' is a {shape}; only a ring goes around a peg")
        if transfer.ring in [t.ring for t in task.transfer[:k]]:
            raise error_at(path, keys, f"'{transfer.ring}' is listed twice")


def _organs(path: Path, table: SceneTable, names: list[str]) -> None:
    """Raise if organs and anatomy do not belong together, or a link is of an unknown robot."""
    if (table.anatomy is None) != (not table.tissue):
        key = "tissue" if table.anatomy is None else "anatomy"
        raise error_at(path, (key,), "organs need both the table [anatomy] and one table [tissue.NAME] for each organ")
    if table.anatomy is None:
        return
    if not (path.parent / table.anatomy.file).is_file():
        raise error_at(path, ("anatomy", "file"), f"there is no file {table.anatomy.file}")
    for name in table.anatomy.touching:
        if name.split("/")[0] not in names:
            raise error_at(path, ("anatomy", "touching"), unknown("robot", name.split("/")[0], names))


def _tools(path: Path, table: SceneTable, names: list[str]) -> None:
    """Raise if a vessel, a tool or a procedure names something that the scene does not have."""
    for name, v in table.vessel.items():
        if v.organ is not None and v.organ not in table.tissue:
            raise error_at(path, ("vessel", name, "organ"), unknown("tissue", v.organ, table.tissue))
    for name, t in table.tool.items():
        for robot in t.robots:
            if robot not in names:
                raise error_at(path, ("tool", name, "robots"), unknown("robot", robot, names))
    for name, task in table.task.items():
        if (p := task.procedure) is None:
            continue
        keys = ("task", name, "procedure")
        for key, what, value, known in (
            ("organ", "tissue", p.organ, table.tissue),
            ("vessel", "vessel", p.vessel, table.vessel),
            ("camera", "camera", p.camera, table.camera),
            *(("spare", "tissue", organ, table.tissue) for organ in p.spare),
            *(("start", "robot", robot, names) for robot in p.start),
            *(("start", "tool", first, table.tool) for first in p.start.values()),
        ):
            if value not in known:
                raise error_at(path, (*keys, key), unknown(what, value, known))
        for robot, first in p.start.items():
            if robot not in table.tool[first].robots:
                raise error_at(
                    path,
                    (*keys, "start"),
                    f"{robot} cannot carry '{first}', a tool of {', '.join(table.tool[first].robots)}",
                )


def _object(name: str, o: ObjectTable) -> Movable:
    axis = np.array(o.axis, float)
    R = spatial.frame_from_axes(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    factor = 0.5 if o.shape == "box" else 1.0
    return Movable(
        name,
        o.shape,
        tuple(v * factor * MM for v in o.size_mm),
        o.mass_g * 1e-3,
        o.friction,
        spatial.pose(R, np.array(o.position_mm) * MM),
        _rgba(o.color),
    )


def _rgba(color: str) -> tuple[float, float, float, float]:
    """Return the linear colour of an sRGB text such as "#20a040"."""
    red, green, blue = (linear(int(color[k : k + 2], 16) / 255) for k in (1, 3, 5))
    return red, green, blue, 1.0


def _console(path: Path, console: ConsoleTable, table: SceneTable, names: list[str]) -> None:
    if console.camera not in table.camera:
        raise error_at(path, ("console", "camera"), unknown("camera", console.camera, table.camera))
    seen = [table.camera[console.camera].robot]
    for hand in ("right", "left"):
        for name in getattr(console, hand):
            if name not in names:
                raise error_at(path, ("console", hand), unknown("robot", name, names))
            if name in seen:
                raise error_at(
                    path, ("console", hand), f"a hand or the camera already moves '{name}'; name each robot once"
                )
            seen.append(name)
    for name in console.instrument_mm:
        if name not in (*console.right, *console.left):
            raise error_at(
                path,
                ("console", "instrument_mm", name),
                unknown("robot of a hand", name, [*console.right, *console.left]),
            )


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
        for joint, value in r.start.items():
            out.append(Parameter(f"{r.name} start {joint}", value, "deg or mm", value, r.provenance, r.note))
        out.append(Parameter(f"{r.name} yaw", r.yaw_deg * DEG, "deg", r.yaw_deg, r.provenance, r.note))
    if (console := table.console) is not None:
        out.append(Parameter("console scale", console.scale, "1", console.scale, console.provenance, console.note))
        for name, v in console.instrument_mm.items():
            out.append(Parameter(f"console instrument {name}", v * MM, "mm", v, console.provenance, console.note))
    for name, o in table.object.items():
        origin = (o.provenance, o.note)
        for k, v in enumerate(o.size_mm, 1):
            out.append(Parameter(f"object {name} size {k}", v * MM, "mm", v, *origin))
        out.append(Parameter(f"object {name} mass", o.mass_g * 1e-3, "g", o.mass_g, *origin))
        out.append(Parameter(f"object {name} friction", o.friction, "1", o.friction, *origin))
        for axis, v in zip("xyz", o.position_mm, strict=True):
            out.append(Parameter(f"object {name} {axis}", v * MM, "mm", v, *origin))
    if (c := table.contact) is not None:
        out.append(Parameter("contact friction", c.friction, "1", c.friction, c.provenance, c.note))
        effort = c.jaw_effort_n_mm
        out.append(Parameter("contact jaw effort", effort * MM, "N mm", effort, c.provenance, c.note))
    if (h := table.haptics) is not None:
        for what, v, unit in (
            ("stiffness", h.stiffness_n_m, "N/m"),
            ("damping", h.damping_ns_m, "N s/m"),
            ("largest force", h.largest_n, "N"),
            ("device damping", h.device_damping_ns_m, "N s/m"),
        ):
            out.append(Parameter(f"haptics {what}", v, unit, v, h.provenance, h.note))
    out += anatomy.parameters(table.tissue)
    for name, v in table.vessel.items():
        out += vessel.parameters(name, v)
    for name, t in table.tool.items():
        out += tool.parameters(name, t)
    for name, task in table.task.items():
        origin = (task.provenance, task.note)
        if task.tolerance_mm is not None and task.hold_s is not None:
            out.append(Parameter(f"task {name} tolerance", task.tolerance_mm * MM, "mm", task.tolerance_mm, *origin))
            out.append(Parameter(f"task {name} hold", task.hold_s, "s", task.hold_s, *origin))
        if (a := task.align) is not None:
            out += _align_parameters(name, a, *origin)
        if (p := task.procedure) is not None:
            out += procedure.parameters(name, p, *origin)
        for target in task.target:
            for hand, point in (("right", target.right_mm), ("left", target.left_mm)):
                for axis, v in zip("xyz", point or (), strict=False):
                    out.append(Parameter(f"task {name} {target.name} {hand} {axis}", v * MM, "mm", v, *origin))
    return out


def _align_parameters(name: str, a: AlignTable, provenance: Origin, note: str) -> Iterator[Parameter]:
    lengths = {f"rectangle {axis}": v for axis, v in zip("xyz", a.position_mm, strict=True)}
    for what, size in (("rectangle", a.size_mm), ("plate", a.plate_mm)):
        lengths |= {f"{what} width": size[0], f"{what} height": size[1]}
    for what, v in lengths.items():
        yield Parameter(f"task {name} {what}", v * MM, "mm", v, provenance, note)
    for axis, v in zip("xyz", a.facing, strict=True):
        yield Parameter(f"task {name} facing {axis}", v, "1", v, provenance, note)
    for what, v in (("roll", a.roll_deg), ("tolerance", a.tolerance_deg)):
        yield Parameter(f"task {name} {what}", v * DEG, "deg", v, provenance, note)
    for what, v in (("line", a.line), ("tolerance of the line", a.tolerance_line)):
        yield Parameter(f"task {name} {what}", v, "1", v, provenance, note)
