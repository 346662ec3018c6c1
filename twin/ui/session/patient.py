"""The patient of a protocol, with operating table: shapes from cad/patients, placed so that the port is at the RCM."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from twin.api import Robot
from twin.core import assets, spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.body import Body, Frame, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.schema import Identifier, Origin, Table, Vector, error_at, load_toml

_ROUND, _HIGH = 40, 20
"""Numbers of facets of an ellipsoid: around its axis, and from pole to pole."""


class PartTable(Table):
    """A part of a patient: an ellipsoid, a dome (the upper half of an ellipsoid) or a box.

    `size_mm` is the extent along the axes of the part. If `floor` is true, a box is extended down to the floor, and a
    dome is placed on the floor. A part with a `port` is omitted if the protocol uses another port.
    """

    name: Identifier
    shape: Literal["ellipsoid", "dome", "box"]
    size_mm: tuple[float, float, float]
    centre_mm: Vector
    angles_deg: Vector = (0.0, 0.0, 0.0)
    color: tuple[float, float, float] | tuple[float, float, float, float]
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
        return {b.name: np.eye(4) for b in self.mechanism.bodies}


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
    known = sorted(p.stem for p in folder.glob("*.toml"))
    if place.body not in known:
        raise TwinError(f"protocol '{protocol.name}': {unknown('patient', place.body, known)}")
    table = read_patient(folder / f"{place.body}.toml")
    if place.port not in table.port:
        raise TwinError(f"protocol '{protocol.name}', patient {table.name}: {unknown('port', place.port, table.port)}")
    for link in place.replaces:
        robot.mechanism.body(link)
    rcm, trocars = protocol.first_rcm, robot.mechanism.trocars
    if place.trocar and place.trocar in protocol.trocars:
        rcm = protocol.trocars[place.trocar]
    elif trocars:
        rcm = robot.mechanism.with_trocars(protocol.places_of(trocars)).trocar_at(place.trocar)
    elif place.trocar:
        raise TwinError(f"protocol '{protocol.name}', [patient]: {unknown('trocar', place.trocar, protocol.trocars)}")
    if rcm is None:
        raise TwinError(
            f"protocol '{protocol.name}' has a patient but no RCM at which to place it: add an insertion, or remove "
            "[patient]"
        )
    port = table.port[place.port]
    R = spatial.rotation_z(place.turn)
    T = spatial.pose(R, rcm - R @ (np.array(port.position_mm) * MM))
    meshes = tuple(_mesh(p, T, floor) for p in table.part if p.port in (None, place.port))
    return Patient(
        _fixed(table.name, meshes),
        np.asarray(rcm, float),
        0.5 * port.diameter_mm * MM,
        frozenset(port.opens),
        frozenset(p.name for p in table.part if p.port == place.port),
        place.replaces,
        f"{table.title}, {table.provenance}: {table.note} Place, {place.provenance}: {place.note}",
    )


def none_there(robot: Robot, protocol: Protocol) -> str:
    """Return a text that states why a protocol has no patient, and which protocols of the robot have a patient."""
    why = protocol.no_patient or "its file has no section [patient]"
    out = f"{protocol.name}: no patient: {why}"
    names = [] if robot.files is None else [n for n in robot.files.protocols() if robot.protocol(n).patient is not None]
    others = [n for n in names if n != protocol.name and n not in why]
    return out.rstrip(".") + "." + (f" With a patient: {', '.join(others)}." if others else "")


def read_patient(path: Path) -> PatientFile:
    """Return the validated content of a file in cad/patients.

    Raises:
        DescriptionError: the file is invalid; the message has file, line, key, value and the allowed values.
    """
    table = load_toml(path, PatientFile)
    names = [p.name for p in table.part]
    for k, part in enumerate(table.part):
        if names.count(part.name) > 1:
            raise error_at(path, ("part", k, "name"), f"two parts are named '{part.name}'")
        if min(part.size_mm) <= 0:
            raise error_at(path, ("part", k, "size_mm"), f"{list(part.size_mm)} is not above 0")
        if part.port is not None and part.port not in table.port:
            raise error_at(path, ("part", k, "port"), unknown("port", part.port, table.port))
    for name, port in table.port.items():
        for opened in port.opens:
            if opened not in names:
                raise error_at(path, ("port", name, "opens"), unknown("part", opened, names))
    return table


def floor_of(mechanism: Mechanism, poses: Mapping[str, Array]) -> float:
    """Return the height in m, in the base frame, of the lowest point of a robot at link poses T_base_body."""
    heights = [
        float((v.vertices @ poses[b.name][2, :3]).min() + poses[b.name][2, 3])
        for b in mechanism.bodies
        for v in b.meshes
        if len(v.vertices)
    ]
    return round(min(heights, default=0.0), 6)


def _fixed(name: str, meshes: tuple[Mesh, ...]) -> Mechanism:
    """Return a mechanism with a body for each mesh; all bodies are fixed to the first body."""
    base, *others = (Body(m.name, (m,)) for m in meshes)
    joints = tuple(Joint(f"at_{b.name}", "fixed", base.name, b.name) for b in others)
    return Mechanism(name, base.name, (base, *others), joints, (Frame("tool", base.name, np.eye(4)),))


def _mesh(part: PartTable, T_base_patient: Array, floor: float) -> Mesh:
    """Return the mesh of a part in the base frame; `floor` is the height in m of the floor in this frame."""
    x, y, z = (0.5 * s * MM for s in part.size_mm)
    about_x, about_y = (
        spatial.exp_so3([part.angles_deg[2] * DEG, 0, 0]),
        spatial.exp_so3([0, part.angles_deg[1] * DEG, 0]),
    )
    R = spatial.rotation_z(part.angles_deg[0] * DEG) @ about_y @ about_x
    T = T_base_patient @ spatial.pose(R, np.array(part.centre_mm) * MM)
    if part.floor and part.shape == "dome":
        T[2, 3] = floor
    if part.floor and part.shape == "box":
        top = T[2, 3] + z
        z = max(0.5 * (top - floor), 1 * MM)
        T[2, 3] = top - z
    points, triangles = _box() if part.shape == "box" else _ball(part.shape == "dome")
    vertices = points * (x, y, z) @ T[:3, :3].T + T[:3, 3]
    r, g, b, a = (*part.color, 1.0)[:4]
    return Mesh(part.name, vertices, triangles, (r, g, b, a))


def _ball(half: bool) -> tuple[Array, np.ndarray]:
    """Return (points (n, 3), triangles (m, 3)) of a ball of radius 1, or of its closed upper half."""
    rows = _HIGH // 2 if half else _HIGH
    span = pi / 2 if half else pi
    points = [(0.0, 0.0, 1.0)]
    for i in range(1, rows + half):
        t = span * i / rows
        points += [
            (sin(t) * cos(2 * pi * k / _ROUND), sin(t) * sin(2 * pi * k / _ROUND), cos(t)) for k in range(_ROUND)
        ]
    points.append((0.0, 0.0, 0.0 if half else -1.0))
    last, k = len(points) - 1, np.arange(_ROUND)
    after = (k + 1) % _ROUND
    faces = [np.column_stack([0 * k, 1 + k, 1 + after])]
    rings = rows - 1 + half
    for i in range(rings - 1):
        a, b = 1 + i * _ROUND, 1 + (i + 1) * _ROUND
        faces += [np.column_stack([a + k, b + k, b + after]), np.column_stack([a + k, b + after, a + after])]
    a = 1 + (rings - 1) * _ROUND
    faces.append(np.column_stack([a + k, 0 * k + last, a + after]))
    return np.array(points), np.concatenate(faces).astype(np.int32)


def _box() -> tuple[Array, np.ndarray]:
    """Return (points (8, 3), triangles (12, 3)) of a cube with edges of length 2."""
    points = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return points, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
