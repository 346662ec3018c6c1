"""A checked protocol, immutable, in SI."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from twin.core.errors import ProtocolError
from twin.core.findings import Finding
from twin.core.provenance import Parameter, Provenance
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.planning.protocol.course import RotationOrder
from twin.planning.protocol.phase import Phase, trocar_of
from twin.planning.protocol.waypoint import Waypoint

Direction = Literal["x", "y", "z", "turn_x", "turn_y", "turn_z"]
"""Direction of motion of a frame: along or about an axis of base."""

Solver = Literal["passes", "toppra"]
"""Solver of the timing: our own passes (`planning.topp`), or the package toppra (`planning.toppra_solver`)."""

SOLVERS: tuple[Solver, ...] = ("passes", "toppra")

DIRECTIONS: tuple[Direction, ...] = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
"""All directions, in the order of the rows of a twist."""


@dataclass(frozen=True)
class Limits:
    """Limits of the moved frame in m/s, m/s2, m/s3 and rad/s, rad/s2, rad/s3; jerk limits may be infinite."""

    tip_speed: float
    tip_acceleration: float
    rotation_speed: float
    rotation_acceleration: float
    provenance: Provenance
    note: str
    tip_jerk: float = inf
    rotation_jerk: float = inf


@dataclass(frozen=True)
class TrajectoryTolerances:
    """Tolerances of a trajectory in m; `waypoint_angle` in rad."""

    rcm: float
    rcm_alarm: float
    straightness: float
    waypoint: float
    waypoint_angle: float
    provenance: Provenance
    note: str


@dataclass(frozen=True)
class PatientPlace:
    """Place of a patient: `body` of cad/patients, with its `port` at the RCM of the protocol.

    The patient is rotated by `turn` (rad) about z of base. `replaces` names links that are not displayed together with
    the patient. `trocar` names the trocar at the port, if there are several.
    """

    body: str
    port: str
    turn: float
    replaces: tuple[str, ...]
    provenance: Provenance
    note: str
    trocar: str = ""


@dataclass(frozen=True)
class Protocol:
    """A checked protocol in SI.

    Attributes:
        name, title, source: name and title of the protocol, and the source of its numbers.
        robot: name of the robot.
        frame: name of the moved frame.
        shaft_axis: (3,) unit vector in the moved frame, from the platform to the tip.
        start: name of the first waypoint.
        waypoints: {name: waypoint}.
        phases: phases in order.
        limits: {type of phases: limits}, for all types in use.
        tolerances: tolerances of the finished trajectory.
        rotation: axes of the three angles of a waypoint, in order, such as "zyx".
        trocars: {name: position (3,) in m, in base}; the name "" means the only trocar of the mechanism. A trocar of
            the mechanism without an entry has its drawn position.
        rcm: RCM (3,) in m, in base, if it is registered from the start (instrument already in the patient), else None.
        free: directions of the moved frame that waypoints do not prescribe and the mechanism determines. None: the
            directions in which the robot cannot move; every waypoint must be a pose that the robot can assume.
        patient: place of the patient, or None; if None, `no_patient` may give the reason.
        timing: the solver that computes the timing.
        findings: warnings from reading the file.
    """

    name: str
    title: str
    source: str
    robot: str
    frame: str
    shaft_axis: Array
    start: str
    waypoints: Mapping[str, Waypoint]
    phases: tuple[Phase, ...]
    limits: Mapping[str, Limits]
    tolerances: TrajectoryTolerances
    rotation: RotationOrder = "zyx"
    trocars: Mapping[str, Array] = field(default_factory=dict)
    rcm: Array | None = None
    free: frozenset[Direction] | None = None
    patient: PatientPlace | None = None
    no_patient: str = ""
    timing: Solver = "passes"
    findings: tuple[Finding, ...] = field(default=())

    @property
    def first_rcm(self) -> Array | None:
        """The first RCM (3,) that the motion needs, in m, in base.

        If the protocol has an unnamed trocar or an RCM, its position is returned. Otherwise, the position follows from
        the first phase that names a trocar (position of the trocar) or is an insertion (waypoint at its start). None if
        the protocol has no RCM, or if only the mechanism defines the position of its trocar.
        """
        if "" in self.trocars or self.rcm is not None:
            return self.trocars.get("", self.rcm)
        name = self.start  # of the waypoint at which a phase begins; "" if it begins at none
        for phase in self.phases:
            trocar = trocar_of(phase)
            if trocar:
                return self.trocars[trocar]
            if phase.registers_rcm:
                waypoint = self.waypoints.get(name)
                if waypoint is None:
                    return None
                return waypoint.position
            name = getattr(phase, "to", name)
        return None

    def places_of(self, trocars: Sequence[str]) -> dict[str, Array]:
        """Return {name: position (3,) in m, in base} of the mechanism's trocars, as assigned by the protocol.

        Args:
            trocars: names of the mechanism's trocars.

        Raises:
            ProtocolError: a named trocar of the protocol is neither in the mechanism nor used by phases or patient;
                or the protocol has an unnamed trocar, but the mechanism does not have exactly one trocar.
        """
        in_mechanism = ", ".join(trocars)
        if "" in self.trocars and len(trocars) != 1:
            problem = "none: the RCM is the point where an insertion begins; remove trocar_mm"
            if trocars:
                problem = f"trocars {in_mechanism}: give their positions by name in [trocars_mm]"
            raise ProtocolError(
                f"protocol '{self.name}' has a trocar (trocar_mm), but the mechanism of {self.robot} has {problem}"
            )
        used_trocars = {trocar_of(phase) for phase in self.phases}
        if self.patient is not None:
            used_trocars.add(self.patient.trocar)
        places = {}
        for name, position in self.trocars.items():
            if not name:  # trocar_mm, without a name
                places[trocars[0]] = position
            elif name in trocars:
                places[name] = position
            elif name not in used_trocars:
                raise ProtocolError(
                    f"protocol '{self.name}' has a trocar '{name}' ([trocars_mm]), but no phase names it, and the "
                    f"mechanism of {self.robot} has {in_mechanism or 'none'}: correct or remove this entry"
                )
        return places

    def parameters(self) -> tuple[Parameter, ...]:
        """Return every number that affects the motion, with its provenance."""
        parameters: list[Parameter] = []
        for waypoint in self.waypoints.values():
            parameters += _of_waypoint(waypoint, self.rotation)
        for phase in self.phases:
            parameters += phase.parameters()
        if self.rcm is not None:
            note = "RCM registered from the start; see the protocol file"
            parameters += _of_position("rcm", self.rcm, "ASSUMED", note)
        for name, position in self.trocars.items():
            label = "trocar"
            if name:
                label = f"trocar_{name}"
            parameters += _of_position(label, position, "ASSUMED", "position of the trocar; see the protocol file")
        for kind, limits in self.limits.items():
            parameters += _of_limits(kind, limits)
        parameters += _of_tolerances(self.tolerances)
        return tuple(parameters)


_FACTORS = {"mm": MM, "mm/s": MM, "mm/s2": MM, "mm/s3": MM, "deg": DEG, "deg/s": DEG, "deg/s2": DEG, "deg/s3": DEG}
"""{unit of a parameter: its size in SI units}."""


def _parameter(name: str, value: float, unit: str, provenance: Provenance, note: str) -> Parameter:
    """Return a parameter with a value in SI units."""
    return Parameter(name, value, unit, value / _FACTORS[unit], provenance, note)


def _of_position(name: str, position: Array, provenance: Provenance, note: str) -> Iterator[Parameter]:
    """Yield the coordinates of a position (3,) in m."""
    for axis, coordinate in zip("xyz", position, strict=True):
        yield _parameter(f"{name}_{axis}", float(coordinate), "mm", provenance, note)


def _of_waypoint(waypoint: Waypoint, order: RotationOrder) -> Iterator[Parameter]:
    """Yield the numbers of a waypoint: joint values, or angles about the axes of `order` with a position or a depth."""
    name = waypoint.name
    provenance = waypoint.provenance
    note = waypoint.note
    for joint, value in (waypoint.joints or {}).items():
        unit, _ = display_unit(joint in waypoint.angle_joints)
        yield _parameter(f"{name}_{joint}", value, unit, provenance, note)
    if waypoint.joints is None:
        labels = [f"about_{axis}" for axis in order]
        if order == "zyx":  # the angles of the papers whose poses were copied
            labels = ["psi", "theta", "phi"]
        for label, angle in zip(labels, waypoint.angles, strict=True):
            yield _parameter(f"{name}_{label}", float(angle), "deg", provenance, note)
    if waypoint.position is not None:
        yield from _of_position(name, waypoint.position, provenance, note)
    if waypoint.depth is not None:
        yield _parameter(f"{name}_depth", waypoint.depth, "mm", provenance, note)


def _of_limits(kind: str, limits: Limits) -> Iterator[Parameter]:
    """Yield the limits of the phases of type `kind`; an infinite jerk is not a number of the protocol."""
    for label, value, unit in (
        ("tip_speed", limits.tip_speed, "mm/s"),
        ("tip_acceleration", limits.tip_acceleration, "mm/s2"),
        ("rotation_speed", limits.rotation_speed, "deg/s"),
        ("rotation_acceleration", limits.rotation_acceleration, "deg/s2"),
        ("tip_jerk", limits.tip_jerk, "mm/s3"),
        ("rotation_jerk", limits.rotation_jerk, "deg/s3"),
    ):
        if value < inf:
            yield _parameter(f"{kind}_{label}", value, unit, limits.provenance, limits.note)


def _of_tolerances(tolerances: TrajectoryTolerances) -> Iterator[Parameter]:
    """Yield the tolerances of the finished trajectory."""
    for label, value, unit in (
        ("rcm", tolerances.rcm, "mm"),
        ("rcm_alarm", tolerances.rcm_alarm, "mm"),
        ("straightness", tolerances.straightness, "mm"),
        ("waypoint", tolerances.waypoint, "mm"),
        ("waypoint_angle", tolerances.waypoint_angle, "deg"),
    ):
        yield _parameter(f"tolerance_{label}", value, unit, tolerances.provenance, tolerances.note)
