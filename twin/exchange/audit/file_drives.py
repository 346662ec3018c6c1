"""Limits, drives and motors of joints, as a file states them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from twin.exchange.audit.new_names import with_new_keys
from twin.exchange.audit.poses import Array


class JointDynamics(NamedTuple):
    """What resists the motion of a joint by itself, without a drive; all zero for a joint that moves freely.

    Attributes:
        stiffness: of its springs, in N/m or N m/rad.
        damping: of its dampers, in N s/m or N m s/rad.
        friction: dry friction in N or N m.
        inertia: of its rotors, in kg or kg m2.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    inertia: float = 0.0


@dataclass(frozen=True)
class FileDrive:
    """Limits and drive of a joint; None: the file does not state the value.

    Attributes:
        limits: (lower, upper) in m or rad; infinite without a limit.
        driven: whether an actuator moves the joint.
        stiffness: stiffness of the position drive in N/m or N m/rad.
        damping: damping of the position drive in N s/m or N m s/rad.
        effort: maximum effort in N or N m.
        speed: maximum speed in m/s or rad/s.
        joint_dynamics: springs, dampers, dry friction and rotors at the joint itself.
        law: "force" if the drive's gains give a force, "acceleration" if they give an acceleration.
        breaks: force in N at which the joint breaks; infinite if it never breaks.
        cone: half angles in rad of the cone of a ball joint, about the two directions across its axis; infinite without
            a cone.
        cone_axis: unit vector (3,) of the axis of this cone, in the frame of the parent; None without a cone.
        soft: range (lower, upper) in m or rad in which a safety controller keeps the joint; the limits without one.
        acceleration: maximum acceleration in m/s2 or rad/s2.
        jerk: maximum jerk in m/s3 or rad/s3.
        control: range (lower, upper) in m or rad of the positions that a control can ask for; the limits where a format
            does not restrict it.
    """

    limits: tuple[float, float] | None = None
    driven: bool | None = None
    stiffness: float | None = None
    damping: float | None = None
    effort: float | None = None
    speed: float | None = None
    joint_dynamics: JointDynamics | None = None
    law: str | None = None
    breaks: float | None = None
    cone: tuple[float, float] | None = None
    cone_axis: Array | None = None
    soft: tuple[float, float] | None = None
    control: tuple[float, float] | None = None
    acceleration: float | None = None
    jerk: float | None = None


@dataclass(frozen=True)
class FileMotor:
    """A motor with a transmission to joints; SI units, on the motor's side. None: the file does not state the value.

    Attributes:
        row: {joint: factor}; the motor's coordinate is the sum of factor times joint coordinate.
        kind: "angle" or "length", the kind of the motor's coordinate.
        limits: (lower, upper) in m or rad; infinite without a limit.
        effort: maximum effort in N or N m; infinite without a limit.
        speed: maximum speed in m/s or rad/s; infinite without a limit.
        inertia: inertia of the rotor in kg m2, or its mass in kg; 0 without a rotor.
        stiffness: stiffness of the position drive in N/m or N m/rad; 0 without a drive.
        damping: damping of the position drive in N s/m or N m s/rad; 0 without a drive.
        law: what the gains give, as in `FileDrive`.
    """

    row: Mapping[str, float] | None = None
    kind: str | None = None
    limits: tuple[float, float] | None = None
    effort: float | None = None
    speed: float | None = None
    inertia: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    law: str | None = None

    def renamed(self, joints: Mapping[str, str]) -> FileMotor:
        """Return the motor after renaming joints by {old: new}."""
        if self.row is None:
            return self
        return replace(self, row=with_new_keys(self.row, joints))


def drive_of_motors(motors: Mapping[str, FileMotor], joint: str) -> tuple[float, float] | None:
    """Return (stiffness, damping) at a joint due to the drives of its motors; None if no motor moves the joint.

    All other joints are assumed to be fixed. Each motor contributes its stiffness and damping, both multiplied by the
    square of the motor's factor for the joint.
    """
    stiffness = 0.0
    damping = 0.0
    has_motor = False
    for motor in motors.values():
        if motor.row and joint in motor.row:
            # Virtual work: the motor turns by factor * q, and its effort acts at the joint multiplied by the factor
            # again.
            factor = motor.row[joint]
            stiffness += factor * factor * (motor.stiffness or 0.0)
            damping += factor * factor * (motor.damping or 0.0)
            has_motor = True
    if not has_motor:
        return None
    return stiffness, damping
