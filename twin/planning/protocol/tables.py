"""Tables of the protocol file in pydantic: keys, units and types."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Union

from pydantic import Field, model_validator

from twin.planning.protocol.course import RotationOrder
from twin.planning.protocol.model import Direction, Solver
from twin.planning.protocol.phase_table import JointKey, PhaseTable
from twin.planning.protocol.phases import TABLES
from twin.schema import Identifier, NotNegative, Origin, Positive, Table, Vector, at

_Text = Annotated[str, Field(min_length=1)]


class WaypointTable(Table):
    """A pose of the moved frame (`position_mm`), an orientation about the RCM (`depth_mm`), or values of `joints`."""

    angles_deg: Vector | None = None
    position_mm: Vector | None = None
    depth_mm: NotNegative | None = None
    joints: Annotated[
        dict[JointKey, float] | None,
        Field(description="values of driven joints, as in a posture: NAME_deg or NAME_mm; other joints are as drawn"),
    ] = None
    label: str = ""
    provenance: Origin
    note: _Text


class LimitsTable(Table):
    """Limits of one phase type: speed, acceleration and, if given, jerk of the moved frame's origin and rotation."""

    tip_speed_mm_s: Positive
    tip_acceleration_mm_s2: Positive
    rotation_speed_deg_s: Positive
    rotation_acceleration_deg_s2: Positive
    tip_jerk_mm_s3: Positive | None = None
    rotation_jerk_deg_s3: Positive | None = None
    provenance: Origin
    note: _Text


class TolerancesTable(Table):
    """Tolerances of the finished trajectory."""

    rcm_mm: Positive
    rcm_alarm_mm: Positive
    straightness_mm: Positive
    waypoint_mm: Positive
    waypoint_deg: Positive
    provenance: Origin
    note: _Text

    @model_validator(mode="after")
    def _alarm_above_tolerance(self) -> TolerancesTable:
        if self.rcm_alarm_mm < self.rcm_mm:
            raise at("rcm_alarm_mm", f"limits are swapped: the alarm is below rcm_mm {self.rcm_mm:g}")
        return self


class PatientTable(Table):
    """The patient: `body` of cad/patients, with its `port` at the RCM, rotated by `turn_deg` about z of the base.

    The links in `replaces` (such as a phantom) are not shown together with the patient.
    """

    body: Identifier
    port: Identifier
    turn_deg: float = 0.0
    trocar: Annotated[
        Identifier | None, Field(description="name of the trocar at the port, if the robot has several trocars")
    ] = None
    replaces: list[Identifier] = Field(default_factory=list)
    provenance: Origin
    note: _Text


if TYPE_CHECKING:
    PhaseType = str
    AnyPhaseTable = PhaseTable
else:  # the types found in `phases`
    PhaseType = Literal[tuple(TABLES)]
    AnyPhaseTable = Annotated[Union[tuple(TABLES.values())], Field(discriminator="type")]  # noqa: UP007


class ProtocolTable(Table):
    """The protocol file."""

    name: Identifier
    title: _Text
    source: _Text
    robot: Identifier
    frame: Identifier
    shaft_axis: Vector
    rotation: RotationOrder
    start: Identifier
    home: Identifier | None = None
    trocar_mm: Vector | None = None
    trocars_mm: Annotated[
        dict[Identifier, Vector],
        Field(description="positions of several trocars, by name of the joint between the base and the trocar"),
    ] = Field(default_factory=dict)
    rcm_mm: Vector | None = None
    free: Annotated[
        list[Direction] | None,
        Field(description="directions that waypoints do not prescribe; the mechanism determines them"),
    ] = None
    patient: PatientTable | None = None
    no_patient: _Text | None = None
    timing: Annotated[
        Solver,
        Field(description="solver of the timing: passes (our own, the default) or toppra (the package of this name)"),
    ] = "passes"
    tolerances: TolerancesTable
    limits: dict[PhaseType, LimitsTable]
    waypoints: Annotated[dict[Identifier, WaypointTable], Field(min_length=1)]
    phases: Annotated[list[AnyPhaseTable], Field(min_length=1)]

    @model_validator(mode="after")
    def _one_answer(self) -> ProtocolTable:
        if self.patient is not None and self.no_patient is not None:
            raise at(
                "no_patient",
                "a reason for having no patient is given, but also a section [patient]: remove one of them",
            )
        if self.trocar_mm is not None and self.trocars_mm:
            text = (
                "trocar_mm gives the position of the only trocar, but [trocars_mm] those of several: remove one of them"
            )
            raise at("trocar_mm", text)
        return self
