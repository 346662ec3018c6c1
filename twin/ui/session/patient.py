"""The patient of a protocol, with operating table: shapes from cad/patients, placed so that the port is at the RCM."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from twin.api import Robot
from twin.core import assets, spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.body import Body, Frame, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.schema import Identifier, Origin, Table, Vector, error_at, load_toml
from twin.ui.session.drawn_solids import SolidTable, check_solid, placed_surface, pose_of, surface_of


class PartTable(SolidTable):
    """A part of a patient, in the patient's frame.

    If `floor` is true, a box is extended down to the floor, and a dome is placed on the floor. A part with a `port` is
    omitted if the protocol uses another port.
    """

    floor: bool = False
    port: Identifier | None = None


class PatientPortTable(Table):
    """A port for instruments: a sphere of `diameter_mm`, in which instruments may penetrate the parts in `opens`."""

    position_mm: Vector
    diameter_mm: float = Field(gt=0)
    opens: list[Identifier]
    note: str = Field(min_length=1)


class PatientFile(Table):
    """Content of a file in cad/patients."""

    name: Identifier
    title: str
    provenance: Origin
    note: str = Field(min_length=1)
    port: dict[Identifier, PatientPortTable]
    part: list[PartTable] = Field(min_length=1)


@dataclass(frozen=True)
class Patient:
    """A placed patient, for a robot and a protocol.

    Attributes:
        mechanism: one fixed body for each part; the body has the name of the part, and its mesh is in m in the base
            frame.
        port: position (3,) of the port, which is the RCM, in m in the base frame.
        port_radius: radius of the port in m.
        opens: names of parts that inserted instruments may penetrate at the port.
        access: names of the parts that belong to the port; instruments may be inside these parts before insertion.
        replaces: links of the robot that are hidden while the patient is shown.
        assumed: text on the source of the patient's shape, and on what is assumed about shape and position.
    """

    mechanism: Mechanism
    port: Array
    port_radius: float
    opens: frozenset[str]
    access: frozenset[str]
    replaces: tuple[str, ...]
    assumed: str

    @property
    def poses(self) -> dict[str, Array]:
        """Poses T_base_body (4, 4) of the parts, by name."""
        return {body.name: np.eye(4) for body in self.mechanism.bodies}


def patient_of(robot: Robot, protocol: Protocol, floor: float) -> Patient | None:
    """Return the patient of a protocol; None for a protocol without a patient.

    `floor` is the height of the floor in m in the base frame.

    Raises:
        TwinError: the patient, port or trocar, or a link that the patient replaces, does not exist; or the protocol has
            no RCM.
    """
    place = protocol.patient
    if place is None:
        return None
    folder = assets.data_folder() / "cad" / "patients"
    file_names = sorted(path.stem for path in folder.glob("*.toml"))
    if place.body not in file_names:
        raise TwinError(f"protocol '{protocol.name}': {unknown('patient', place.body, file_names)}")
    table = read_patient(folder / f"{place.body}.toml")
    if place.port not in table.port:
        raise TwinError(f"protocol '{protocol.name}', patient {table.name}: {unknown('port', place.port, table.port)}")
    for link in place.replaces:
        robot.mechanism.body(link)  # raises an error if there is no such link
    rcm = _rcm_of(robot, protocol, place.trocar)
    port = table.port[place.port]
    # the patient is turned, and then moved so that its port is at the RCM
    R = spatial.rotation_z(place.turn)
    T = spatial.pose(R, rcm - R @ (np.array(port.position_mm) * MM))
    meshes = []
    access = set()
    for part in table.part:
        # a part of another port is omitted
        if part.port is None or part.port == place.port:
            meshes.append(_mesh(part, T, floor))
        if part.port == place.port:
            access.add(part.name)
    return Patient(
        mechanism=_fixed(table.name, meshes),
        port=np.asarray(rcm, float),
        port_radius=0.5 * port.diameter_mm * MM,
        opens=frozenset(port.opens),
        access=frozenset(access),
        replaces=place.replaces,
        assumed=f"{table.title}, {table.provenance}: {table.note} Place, {place.provenance}: {place.note}",
    )


def _rcm_of(robot: Robot, protocol: Protocol, trocar: str) -> Array:
    """Return the RCM (3,) in m in the base frame at which a patient is placed; `trocar` "": the first RCM.

    Raises:
        TwinError: there is no such trocar, or no RCM.
    """
    trocars = robot.mechanism.trocars
    if trocar and trocar in protocol.trocars:
        rcm = protocol.trocars[trocar]
    elif trocars:
        rcm = robot.mechanism.with_trocars(protocol.places_of(trocars)).trocar_at(trocar)
    elif trocar:
        raise TwinError(f"protocol '{protocol.name}', [patient]: {unknown('trocar', trocar, protocol.trocars)}")
    else:
        rcm = protocol.first_rcm
    if rcm is None:
        raise TwinError(
            f"protocol '{protocol.name}' has a patient but no RCM at which to place it: add an insertion, or remove "
            "[patient]"
        )
    return rcm


def none_there(robot: Robot, protocol: Protocol) -> str:
    """Return a text that states why a protocol has no patient, and which protocols of the robot have a patient."""
    why = protocol.no_patient or "its file has no section [patient]"
    text = f"{protocol.name}: no patient: {why}".rstrip(".") + "."
    others = []
    if robot.files is not None:
        for name in robot.files.protocols():
            # every protocol is read, so that a malformed one is reported
            has_patient = robot.protocol(name).patient is not None
            if has_patient and name != protocol.name and name not in why:
                others.append(name)
    if others:
        text += f" With a patient: {', '.join(others)}."
    return text


def read_patient(path: Path) -> PatientFile:
    """Return the validated content of a file in cad/patients.

    Raises:
        DescriptionError: the file is invalid; the message has file, line, key, value and the allowed values.
    """
    table = load_toml(path, PatientFile)
    names = [part.name for part in table.part]
    for number, part in enumerate(table.part):
        if names.count(part.name) > 1:
            raise error_at(path, ("part", number, "name"), f"two parts are named '{part.name}'")
        check_solid(path, ("part", number), part)
        if part.floor and part.shape not in ("box", "dome"):
            raise error_at(
                path, ("part", number, "floor"), f"a {part.shape} cannot be on the floor: only a box or a dome can"
            )
        if part.port is not None and part.port not in table.port:
            raise error_at(path, ("part", number, "port"), unknown("port", part.port, table.port))
    for name, port in table.port.items():
        for opened in port.opens:
            if opened not in names:
                raise error_at(path, ("port", name, "opens"), unknown("part", opened, names))
    return table


def floor_of(mechanism: Mechanism, poses: Mapping[str, Array]) -> float:
    """Return the height in m, in the base frame, of the lowest point of a robot at link poses T_base_body."""
    heights = []
    for body in mechanism.bodies:
        T = poses[body.name]
        for mesh in body.meshes:
            if len(mesh.vertices):
                lowest = (mesh.vertices @ T[2, :3]).min()
                heights.append(float(lowest + T[2, 3]))
    # to 1 µm, so that rounding errors do not move the floor
    return round(min(heights, default=0.0), 6)


def _fixed(name: str, meshes: Sequence[Mesh]) -> Mechanism:
    """Return a mechanism with a body for each mesh; all bodies are fixed to the first body."""
    bodies = tuple(Body(mesh.name, (mesh,)) for mesh in meshes)
    base = bodies[0].name
    joints = tuple(Joint(f"at_{body.name}", "fixed", base, body.name) for body in bodies[1:])
    return Mechanism(name, base, bodies, joints, (Frame("tool", base, np.eye(4)),))


def _mesh(part: PartTable, T_base_patient: Array, floor: float) -> Mesh:
    """Return the mesh of a part in the base frame; `floor` is the height in m of the floor in this frame."""
    if part.shape == "limb":
        points, triangles = placed_surface(part)
        T = T_base_patient
    else:
        points, triangles = surface_of(part)
        T = T_base_patient @ pose_of(part)
    if part.floor and part.shape == "dome":
        T[2, 3] = floor
    if part.floor and part.shape == "box":
        half = float(points[:, 2].max())
        top = T[2, 3] + half
        # also a box whose top is below the floor keeps a volume
        half_above_floor = max(0.5 * (top - floor), 1 * MM)
        points = points * [1, 1, half_above_floor / half]
        T[2, 3] = top - half_above_floor
    vertices = points @ T[:3, :3].T + T[:3, 3]
    r, g, b, a = (*part.color, 1.0)[:4]
    return Mesh(part.name, vertices, triangles, (r, g, b, a))
