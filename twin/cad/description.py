"""The robot's TOML file, `cad/<robot>/<robot>.toml`: the hand-written description of the CAD.

It states the faces to measure, joints between bodies, limits, drives, materials, and postures (named joint values).
Lengths and placements come from the STEP file, not from this file: `near_mm` and `direction` only identify a face.
Every number that is not measured has a provenance and a reason. "Drawn" coordinates are those of the STEP file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from twin.core.foreign.budget import read_bytes
from twin.core.foreign.once import Read
from twin.model.joint import JointType
from twin.schema import Identifier, LimitRange, Range, Sourced, Table, Vector, at, error_at, load_toml


class Feature(Table):
    """A face of the STEP file: its kind, a point near it, and its direction.

    `near_mm` is a point near the face (for a cylinder: near its axis) in drawn coordinates. Faces that are farther than
    `tolerance.gross_mm` from this point, or tilted by more than `tolerance.gross_deg` from `direction`, are ignored.
    """

    kind: Literal["cylinder", "plane", "sphere"]
    near_mm: Vector
    direction: Vector | None = None
    radius_mm: float | None = Field(default=None, gt=0)
    part: str | None = None

    @model_validator(mode="after")
    def _complete(self) -> Feature:
        if self.kind == "plane" and self.direction is None:
            raise at("kind", "a plane needs `direction`: the side to which its normal points")
        if self.kind == "cylinder" and self.direction is None:
            raise at("kind", "a cylinder needs `direction`: the direction of its axis")
        if self.kind != "plane" and self.radius_mm is None:
            raise at("kind", f"a {self.kind} needs `radius_mm`")
        if self.direction is not None and not any(self.direction):
            raise at("direction", "a direction must not be zero")
        return self


class FrameSpec(Table):
    """A frame on one body, measured on its features or, without exact geometry, given by numbers.

    Measured frame: `origin` is a sphere centre, the centroid of several sphere centres, or a point on a cylinder axis.
    Feature `at` selects this point of the axis: the intersection of the axis with a plane, or the point of the axis
    nearest to another axis or to a sphere centre. `z` is the direction of a feature, or the normal of three sphere
    centres in counter-clockwise order. x or y points towards a feature (`x_towards`, `y_towards`; for a list: towards
    the centroid of its features), or along a direction (`x_along`). `offset_mm` shifts the frame along its z by a
    distance that no face defines. `angles_deg` defines the directions that no face defines: if `z` is given, the
    direction of x; otherwise, all three axes.

    Given frame: `position_mm` and `angles_deg` (angles about z, y, x: R = Rz Ry Rx), in drawn coordinates.
    """

    origin: str | list[str] | None = None
    at: str | None = None
    z: str | list[str] | None = None
    x_towards: str | list[str] | None = None
    y_towards: str | list[str] | None = None
    x_along: str | None = None
    offset_mm: float = 0.0
    position_mm: Vector | None = None
    angles_deg: Vector | None = None

    @model_validator(mode="after")
    def _one_way(self) -> FrameSpec:
        for key in ("origin", "z", "x_towards", "y_towards"):
            value = getattr(self, key)
            if value == [] or (key == "z" and isinstance(value, list) and len(value) != 3):
                raise at(
                    key,
                    "three sphere centres are needed" if key == "z" else "the list is empty; name at least one feature",
                )
        turned = [self.x_towards, self.y_towards, self.x_along]
        if self.position_mm is not None:
            if self.origin or self.at or self.z or self.offset_mm or any(turned):
                raise at("position_mm", "a frame is either measured (`origin`, `z`, ...) or given (`position_mm`)")
        elif self.origin is None or (self.z is None and self.angles_deg is None):
            raise at((), "a measured frame needs `origin` and `z` (or `angles_deg`); a given frame needs `position_mm`")
        elif [*turned, self.angles_deg].count(None) != len(turned):  # all but one are missing
            ways = "`x_towards`, `y_towards`, `x_along`, `angles_deg`"
            raise at((), f"a measured frame needs exactly one of {ways}")
        return self

    def features(self, *keys: str) -> tuple[str, ...]:
        """Return the names of all features that the entries `keys` of the frame use, each name once."""
        names: list[str] = []
        for key in keys:
            value = getattr(self, key)
            if isinstance(value, list):
                names += value
            elif value:
                names.append(value)
        return tuple(dict.fromkeys(names))


class MassSpec(Sourced):
    """Mass, centre of mass, and inertia (xx, yy, zz, xy, xz, yz) about the centre of mass, in drawn coordinates."""

    mass_kg: float = Field(gt=0)
    com_mm: Vector
    inertia_kg_m2: tuple[float, float, float, float, float, float]


class BodySpec(Table):
    """A rigid body: the STEP node `node` (default: the node with the body's name), or mesh files with a declared unit.

    `mass` states the mass properties of the body. Without `mass`, the mass properties are computed from the densities
    and volumes of the body's parts. `whole` is false if the meshes show only a part of the body, or are for display
    only: its mass is then not judged by them.
    """

    node: str | None = None
    frame: str | None = None
    mass: MassSpec | None = None
    meshes: list[MeshSpec] = Field(default_factory=list)
    whole: bool = True


class MeshSpec(Table):
    """A mesh file and its unit (required). `up` is the axis that points up in the file; `color` is RGB or RGBA."""

    file: str
    unit: Literal["m", "cm", "mm", "um", "in"]
    up: Literal["z", "y"] = "z"
    color: tuple[float, float, float] | tuple[float, float, float, float] = (0.6, 0.6, 0.6)


class MaterialTable(Sourced):
    """Density and appearance of a material.

    `parts` are shell patterns; the material applies to parts whose names match a pattern. If several materials match a
    part, the last of these materials applies.

    `metallic` is 1 for bare metal, 0 for paint, plastic and glass; `roughness` is 0 for a mirror, 1 for chalk.
    """

    density_kg_m3: float = Field(gt=0)
    metallic: float = Field(0.0, ge=0, le=1)
    roughness: float = Field(0.5, ge=0, le=1)
    parts: list[str]


class LimitSpec(Sourced):
    """Limits shared by the named joints, in mm, mm/s, mm/s2, mm/s3 (prismatic) or deg, deg/s, deg/s2, deg/s3.

    `limits = "none"` states that the joints turn or slide without end, so that there are no soft limits either; an
    entry without limits says nothing about them. Joints with a limit on one side have -inf or inf on the other.
    """

    joints: list[Identifier]
    limits: Literal["none"] | None = None
    limits_mm: LimitRange | None = None
    limits_deg: LimitRange | None = None
    soft_limits_mm: Range | None = None
    soft_limits_deg: Range | None = None
    cone_deg: float | None = Field(default=None, gt=0, le=180)
    max_speed_mm_s: float | None = Field(default=None, gt=0)
    max_speed_deg_s: float | None = Field(default=None, gt=0)
    max_acceleration_mm_s2: float | None = Field(default=None, gt=0)
    max_acceleration_deg_s2: float | None = Field(default=None, gt=0)
    max_jerk_mm_s3: float | None = Field(default=None, gt=0)
    max_jerk_deg_s3: float | None = Field(default=None, gt=0)

    @field_validator("limits", mode="before")
    @classmethod
    def _has_a_unit(cls, limits: object) -> object:
        # Before pydantic's own check, whose message would only say that "none" is expected.
        if isinstance(limits, list):
            raise at((), "the unit is missing: write limits_deg or limits_mm")
        return limits

    @model_validator(mode="after")
    def _none_or_some(self) -> LimitSpec:
        for key in ("limits_mm", "limits_deg", "soft_limits_mm", "soft_limits_deg"):
            if self.limits == "none" and getattr(self, key) is not None:
                raise at(key, f'{key} is given beside limits = "none". Omit one of the two')
        return self

    @model_validator(mode="after")
    def _soft_within_hard(self) -> LimitSpec:
        for unit, hard, soft in (
            ("mm", self.limits_mm, self.soft_limits_mm),
            ("deg", self.limits_deg, self.soft_limits_deg),
        ):
            if not hard or not soft:
                continue
            excess = max(hard[0] - soft[0], soft[1] - hard[1])
            largest = max(abs(limit) for limit in hard if math.isfinite(limit))
            # Limits that were stored in single precision (in a USD stage) may differ in the last digits.
            if excess > 1e-6 * largest:
                raise at(
                    f"soft_limits_{unit}",
                    f"soft limits {soft[0]:g} .. {soft[1]:g} {unit} exceed the hard limits {hard[0]:g} .. {hard[1]:g} "
                    f"{unit}; beyond the hard limits they have no effect. Write "
                    f"[{max(soft[0], hard[0]):g}, {min(soft[1], hard[1]):g}], or omit the soft limits",
                )
        return self


class DriveSpec(Sourced):
    """Stiffness, damping and maximum effort of the position drives of the named joints, in SI units.

    N/m, N s/m and N for prismatic joints; N m/rad, N m s/rad and N m for revolute joints.
    """

    joints: list[Identifier]
    stiffness: float = Field(gt=0)
    damping: float = Field(ge=0)
    max_effort: float | None = Field(default=None, gt=0)


class JointSpec(Table):
    """A joint with a frame on each of its two bodies.

    A revolute, prismatic or cylindrical joint turns about or slides along the z axis of these frames.
    """

    name: Identifier
    type: JointType
    parent: Identifier
    child: Identifier
    active: bool = False
    on_parent: FrameSpec
    on_child: FrameSpec

    @property
    def sides(self) -> tuple[tuple[str, FrameSpec], tuple[str, FrameSpec]]:
        """(body, frame) of the parent, and (body, frame) of the child."""
        return (self.parent, self.on_parent), (self.child, self.on_child)


class NamedFrame(Table):
    """A named frame on a body."""

    body: Identifier
    at: FrameSpec


class NamedPoint(Table):
    """A named point: a sphere centre, a point on a cylinder axis (see `FrameSpec`), or given drawn coordinates."""

    body: Identifier
    origin: str | None = None
    at: str | None = None
    position_mm: Vector | None = None

    @model_validator(mode="after")
    def _one_way(self) -> NamedPoint:
        if (self.origin is None) == (self.position_mm is None) or (self.at and self.origin is None):
            raise at((), "a point is either measured (`origin`, optionally `at`) or given (`position_mm`)")
        return self


class CouplingSpec(Sourced):
    """A belt, gear or cable: the sum of ratio * coordinate over its joints is equal to `sum_deg` or `sum_mm`.

    The sum has the unit of the first joint. The ratio of a joint of the other kind is in m/rad or rad/m.
    """

    name: Identifier
    joints: list[Identifier] = Field(min_length=2)
    ratios: list[float]
    sum_deg: float | None = None
    sum_mm: float | None = None

    @model_validator(mode="after")
    def _one_unit(self) -> CouplingSpec:
        if (self.sum_deg is None) == (self.sum_mm is None):
            raise at((), "a coupling needs either `sum_deg` or `sum_mm`")
        return self


class ActuatorSpec(Sourced):
    """A motor that moves joints through a [[transmission]]; all numbers refer to the motor, not to the joints.

    Efforts, gains and inertia are in SI units: N m, N m/rad, N m s/rad, kg m2 for an angle; N, N/m, N s/m, kg for a
    length.
    """

    name: Identifier
    kind: Literal["angle", "length"] = "angle"
    limits_deg: Range | None = None
    limits_mm: Range | None = None
    max_speed_deg_s: float | None = Field(default=None, gt=0)
    max_speed_mm_s: float | None = Field(default=None, gt=0)
    max_effort: float | None = Field(default=None, gt=0)
    rotor_inertia: float | None = Field(default=None, gt=0)
    stiffness: float | None = Field(default=None, gt=0)
    damping: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _one_unit(self) -> ActuatorSpec:
        wrong = "deg"
        right = "mm"
        if self.kind == "angle":
            wrong = "mm"
            right = "deg"
        for key in (f"limits_{wrong}", f"max_speed_{wrong}_s"):
            if getattr(self, key) is not None:
                raise at(
                    key, f"the coordinate of this actuator is of kind {self.kind}; write {key.replace(wrong, right)}"
                )
        return self

    @property
    def limits(self) -> tuple[float, float] | None:
        """Minimum and maximum coordinate of the motor in deg or mm; None if unlimited."""
        # `_one_unit` has refused the one that is not of this kind.
        return self.limits_deg or self.limits_mm

    @property
    def max_speed(self) -> float | None:
        """Maximum speed of the motor in deg/s or mm/s; None if unlimited."""
        return self.max_speed_deg_s or self.max_speed_mm_s


class MatrixSpec(Sourced):
    """An alternative matrix of a transmission, of the same shape; `Robot.with_transmission` selects it."""

    matrix: list[list[float]]


class TransmissionSpec(Sourced):
    """Transmission from motors to active joints: q_joints = matrix @ m_actuators in rad or m, one row per joint.

    `matrix` is the default; `variants` are alternative matrices, by name.
    """

    name: Identifier
    joints: list[Identifier] = Field(min_length=1)
    actuators: list[Identifier] = Field(min_length=1)
    matrix: list[list[float]]
    variants: dict[Identifier, MatrixSpec] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _square(self) -> TransmissionSpec:
        row_lengths = list(map(len, self.matrix))
        n = len(self.joints)
        if row_lengths != [n] * n or len(self.actuators) != n:
            lengths = ", ".join(map(str, row_lengths)) or "-"
            raise at(
                "matrix",
                f"{n} joints, {len(self.actuators)} actuators, rows of length {lengths}; "
                "required: as many actuators as joints, and one row for each joint with one number for each actuator",
            )
        for name, variant in self.variants.items():
            if list(map(len, variant.matrix)) != row_lengths:
                raise at(f"variants.{name}", f"the matrix must have {n} rows of {n} numbers, as `matrix` has")
        return self


class PairGap(Sourced):
    """Minimum allowed distance on a rail: coordinate of prismatic joint `upper` minus coordinate of joint `lower`."""

    lower: Identifier
    upper: Identifier
    min_gap_mm: float = Field(gt=0)


class LengthSpec(Table):
    """A length between two features of one body; `parameter` is the name of this length in the equations."""

    body: Identifier
    between: tuple[Identifier, Identifier]
    parameter: str = Field(min_length=1)


class RequirementSpec(Sourced):
    """Required accuracy of the tool; the results of tolerance analyses are compared with this accuracy."""

    tool_um: float = Field(gt=0)


class CadTolerance(Table):
    """Maximum deviations: `gross_` between a face and its `Feature`, `meeting_` between the two frames of a joint."""

    gross_mm: float = Field(gt=0)
    gross_deg: float = Field(gt=0)
    meeting_um: float = Field(gt=0)
    meeting_deg: float = Field(gt=0)


class Description(Table):
    """The content of a robot's TOML file."""

    name: Identifier
    title: str
    source: str
    default_protocol: Identifier
    base: Identifier
    tool: Identifier = "tool"
    step: str | None = None
    tolerance: CadTolerance
    material: dict[Identifier, MaterialTable] = Field(default_factory=dict)
    body: dict[Identifier, BodySpec]
    feature: dict[Identifier, dict[Identifier, Feature]] = Field(default_factory=dict)
    joint: list[JointSpec]
    limit: list[LimitSpec] = Field(default_factory=list)
    drive: list[DriveSpec] = Field(default_factory=list)
    gap: list[PairGap] = Field(default_factory=list)
    actuator: list[ActuatorSpec] = Field(default_factory=list)
    transmission: list[TransmissionSpec] = Field(default_factory=list)
    coupling: list[CouplingSpec] = Field(default_factory=list)
    trocar: Annotated[Identifier | None, Field(description="joint that connects the trocar to the base")] = None
    trocars: Annotated[
        list[Identifier], Field(description="joints that connect the trocars to the base, if there are several")
    ] = Field(default_factory=list)
    length: list[LengthSpec] = Field(default_factory=list)
    requirement: RequirementSpec | None = None
    gravity_m_s2: Annotated[
        Vector | None, Field(description="gravitational acceleration in the base frame; default (0, 0, -9.81)")
    ] = None
    frame: dict[Identifier, NamedFrame]
    point: dict[Identifier, NamedPoint] = Field(default_factory=dict)
    posture: dict[Identifier, dict[str, float]] = Field(default_factory=dict)
    start: Annotated[
        dict[str, float], Field(description="joint values at which the pages open; without them, the posture home")
    ] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_list_of_trocars(self) -> Description:
        if self.trocar is not None and self.trocars:
            raise at(
                "trocars",
                f"`trocar` and `trocars` are both given: add '{self.trocar}' to `trocars` and delete `trocar`",
            )
        return self


def load(path: Path, read: Read = read_bytes) -> Description:
    """Return a robot description; `read` returns the bytes of the file.

    Raises:
        DescriptionError: the file is malformed; the message gives file, line, key, value and allowed values.
    """
    description = load_toml(path, Description, read)
    # Commands find a robot by the names of its folder and file.
    if description.name != path.stem:
        raise error_at(path, ("name",), f"'{description.name}' must be equal to the file name '{path.stem}'")
    return description
