"""The protocol file as pydantic tables: which keys there are, their units and their kinds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from twin.planning.protocol.model import Direction, PhaseType, RcmMode, RotationOrder
from twin.schema import Identifier, Origin, Table, Vector, at

_Positive = Annotated[float, Field(gt=0)]
_Depth = Annotated[float, Field(ge=0)]
_Text = Annotated[str, Field(min_length=1)]
_Trocar = Annotated[
    Identifier | None, Field(description="the one of [trocars_mm] that the shaft is in; needed if there are several")
]
_JointValue = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*_(deg|mm)$")]


class WaypointTable(Table):
    """A pose of the moved frame (`position_mm`), an attitude about the RCM (`depth_mm`), or values of `joints`."""

    angles_deg: Vector | None = None
    position_mm: Vector | None = None
    depth_mm: _Depth | None = None
    joints: Annotated[
        dict[_JointValue, float] | None,
        Field(description="values of driven joints, as in a posture: NAME_deg or NAME_mm; others are as drawn"),
    ] = None
    label: str = ""
    provenance: Origin
    note: _Text


class LimitsTable(Table):
    """Limits of one phase type: speed, acceleration and, if given, jerk of the moved frame's origin and rotation."""

    tip_speed_mm_s: _Positive
    tip_acceleration_mm_s2: _Positive
    rotation_speed_deg_s: _Positive
    rotation_acceleration_deg_s2: _Positive
    tip_jerk_mm_s3: _Positive | None = None
    rotation_jerk_deg_s3: _Positive | None = None
    provenance: Origin
    note: _Text


class TolerancesTable(Table):
    """What the finished trajectory is judged with."""

    rcm_mm: _Positive
    rcm_alarm_mm: _Positive
    straightness_mm: _Positive
    waypoint_mm: _Positive
    waypoint_deg: _Positive
    provenance: Origin
    note: _Text

    @model_validator(mode="after")
    def _alarm_above_tolerance(self) -> TolerancesTable:
        if self.rcm_alarm_mm < self.rcm_mm:
            raise at("rcm_alarm_mm", f"limits are swapped: the alarm is below rcm_mm {self.rcm_mm:g}")
        return self


class PatientTable(Table):
    """Who lies there: `body` of cad/patients, its `port` where the RCM is, turned by `turn_deg` about z of the base.

    Links that the patient `replaces` (a phantom) are not shown together with it.
    """

    body: Identifier
    port: Identifier
    turn_deg: float = 0.0
    trocar: Annotated[Identifier | None, Field(description="the one at the port, if there are several")] = None
    replaces: list[Identifier] = Field(default_factory=list)
    provenance: Origin
    note: _Text


class _PhaseTable(Table):
    name: Identifier


class PositioningTable(_PhaseTable):
    """Straight to a waypoint, outside the patient."""

    type: Literal["positioning"]
    to: Identifier


class JointsTable(_PhaseTable):
    """By the driven joints to the joint values of a waypoint, outside the patient."""

    type: Literal["joints"]
    to: Identifier


class AuxiliaryTable(_PhaseTable):
    """Auxiliary joints, which do not move the tool (a jaw), to `joints`: NAME_deg or NAME_mm; the tool stands still."""

    type: Literal["auxiliary"]
    joints: dict[_JointValue, float]


class InsertionTable(_PhaseTable):
    """Straight along the shaft; `to` names the waypoint that should be met at its end."""

    type: Literal["insertion"]
    depth_mm: _Positive
    to: Identifier | None = None
    trocar: _Trocar = None


class PivotTable(_PhaseTable):
    """About the RCM."""

    type: Literal["pivot"]
    to: Identifier
    rcm: RcmMode
    trocar: _Trocar = None


class CircleTable(_PhaseTable):
    """Full circles of the tip; the shaft stays on the RCM if there is one."""

    type: Literal["circle"]
    centre_mm: Vector
    normal: Vector = (0.0, 0.0, 1.0)
    turns: Annotated[int, Field(ge=1)] = 1
    trocar: _Trocar = None

    @model_validator(mode="after")
    def _has_an_axis(self) -> CircleTable:
        if not any(self.normal):
            raise at("normal", "the axis of a circle is not zero")
        return self


class RetractionTable(_PhaseTable):
    """Straight back along the shaft until `depth_mm` is left inside."""

    type: Literal["retraction"]
    depth_mm: _Depth = 0.0
    trocar: _Trocar = None


class HomeTable(_PhaseTable):
    """Back to the home waypoint."""

    type: Literal["home"]


PhaseTable = Annotated[
    PositioningTable
    | JointsTable
    | AuxiliaryTable
    | InsertionTable
    | PivotTable
    | CircleTable
    | RetractionTable
    | HomeTable,
    Field(discriminator="type"),
]


class ProtocolTable(Table):
    """The whole file."""

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
        Field(description="places of several trocars, by the name of the joint that holds each"),
    ] = Field(default_factory=dict)
    rcm_mm: Vector | None = None
    free: Annotated[
        list[Direction] | None,
        Field(description="directions that no waypoint decides: the moved frame follows the mechanism there"),
    ] = None
    patient: PatientTable | None = None
    no_patient: _Text | None = None
    tolerances: TolerancesTable
    limits: dict[PhaseType, LimitsTable]
    waypoints: Annotated[dict[Identifier, WaypointTable], Field(min_length=1)]
    phases: Annotated[list[PhaseTable], Field(min_length=1)]

    @model_validator(mode="after")
    def _one_answer(self) -> ProtocolTable:
        if self.patient is not None and self.no_patient is not None:
            raise at("no_patient", "says why there is no patient, and [patient] places one: keep one of them")
        if self.trocar_mm is not None and self.trocars_mm:
            raise at("trocar_mm", "places the only trocar, and [trocars_mm] places several: keep one of them")
        return self
