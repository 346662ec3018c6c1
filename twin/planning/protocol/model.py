"""A checked protocol, immutable, in SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
            if phase.registers:
                waypoint = self.waypoints.get(name)
                return None if waypoint is None else waypoint.position
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
        used = {trocar_of(phase) for phase in self.phases}
        if self.patient is not None:
            used.add(self.patient.trocar)
        places = {}
        for name, position in self.trocars.items():
            if not name:  # trocar_mm, without a name
                places[trocars[0]] = position
            elif name in trocars:
                places[name] = position
            elif name not in used:
                raise ProtocolError(
                    f"protocol '{self.name}' has a trocar '{name}' ([trocars_mm]), but no phase names it, and the "
                    f"mechanism of {self.robot} has {in_mechanism or 'none'}: correct or remove this entry"
                )
        return places

    def parameters(self) -> tuple[Parameter, ...]:
        """Return every number that affects the motion, with its provenance."""
        parameters: list[Parameter] = []

        def add(name: str, value: float, unit: str, factor: float, provenance: Provenance, note: str) -> None:
            parameters.append(Parameter(name, value, unit, value / factor, provenance, note))

        for w in self.waypoints.values():
            zyx = self.rotation == "zyx"
            labels = ("psi", "theta", "phi") if zyx else tuple(f"about_{axis}" for axis in self.rotation)
            for joint, value in (w.joints or {}).items():
                unit, factor = display_unit(joint in w.angle_joints)
                add(f"{w.name}_{joint}", value, unit, factor, w.provenance, w.note)
            for label, angle in zip(labels, w.angles if w.joints is None else (), strict=w.joints is None):
                add(f"{w.name}_{label}", float(angle), "deg", DEG, w.provenance, w.note)
            for label, p in zip("xyz", w.position if w.position is not None else (), strict=False):
                add(f"{w.name}_{label}", float(p), "mm", MM, w.provenance, w.note)
            if w.depth is not None:
                add(f"{w.name}_depth", w.depth, "mm", MM, w.provenance, w.note)
        parameters += [parameter for phase in self.phases for parameter in phase.parameters()]
        for label, p in zip("xyz", self.rcm if self.rcm is not None else (), strict=False):
            add(f"rcm_{label}", float(p), "mm", MM, "ASSUMED", "RCM registered from the start; see the protocol file")
        for name, place in self.trocars.items():
            for label, p in zip("xyz", place, strict=True):
                shown = f"trocar_{name}_{label}" if name else f"trocar_{label}"
                add(shown, float(p), "mm", MM, "ASSUMED", "position of the trocar; see the protocol file")
        for kind, l in self.limits.items():  # noqa: E741
            add(f"{kind}_tip_speed", l.tip_speed, "mm/s", MM, l.provenance, l.note)
            add(f"{kind}_tip_acceleration", l.tip_acceleration, "mm/s2", MM, l.provenance, l.note)
            add(f"{kind}_rotation_speed", l.rotation_speed, "deg/s", DEG, l.provenance, l.note)
            add(f"{kind}_rotation_acceleration", l.rotation_acceleration, "deg/s2", DEG, l.provenance, l.note)
            for name, jerk, unit, factor in (
                ("tip", l.tip_jerk, "mm/s3", MM),
                ("rotation", l.rotation_jerk, "deg/s3", DEG),
            ):
                if jerk < inf:
                    add(f"{kind}_{name}_jerk", jerk, unit, factor, l.provenance, l.note)
        t = self.tolerances
        for name in ("rcm", "rcm_alarm", "straightness", "waypoint"):
            add(f"tolerance_{name}", getattr(t, name), "mm", MM, t.provenance, t.note)
        add("tolerance_waypoint_angle", t.waypoint_angle, "deg", DEG, t.provenance, t.note)
        return tuple(parameters)
