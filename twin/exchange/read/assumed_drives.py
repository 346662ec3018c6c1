"""Add a drive to each driven joint for which the file states no gains.

The gains of these drives are ASSUMED: they are computed from the inertia that the joint moves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.core import spatial
from twin.exchange.read.imported_robot import Findings, Imported
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism
from twin.model.transmission import Actuator

FREQUENCY = 5.0
"""Natural frequency in Hz of assumed drives. With critical damping, it determines their gains."""

_ANGULAR_FREQUENCY = 2 * np.pi * FREQUENCY
"""The same in rad/s."""

NOTE = f"the file has no gains; these give {FREQUENCY:g} Hz and critical damping for the inertia moved at rest"
"""Note on each assumed drive, written to the description of the robot."""

_INERTIA_WITHOUT_MASSES = {"revolute": 1e-3, "prismatic": 1.0}
"""Inertia in kg m2 (revolute) or mass in kg (prismatic) assumed for the moved bodies if the file has no masses."""


def with_drives(imported: Imported) -> Imported:
    """Return the mechanism with a drive on every driven joint. Each added drive is reported and listed in `assumed`.

    The efforts of `imported.efforts`, which are of joints without a drive, become those of the added drives or motors.
    Efforts that are not positive are reported, and left out.
    """
    mechanism = imported.mechanism
    findings = Findings(imported.findings)
    assumed = set(imported.assumed)
    _report_not_positive(imported, findings)
    efforts: dict[str, float] = {}
    for name, effort in imported.efforts.items():
        if effort > 0:
            efforts[name] = effort
    mechanism = replace(mechanism, actuators=_with_gains(mechanism, efforts, assumed, findings))
    joints = []
    for joint in mechanism.joints:
        if joint.drive and joint.drive.max_effort is not None and not joint.drive.max_effort > 0:
            joint = replace(joint, drive=replace(joint.drive, max_effort=None))
        if joint.active and joint.drive is None and mechanism.transmission_of(joint.name) is None:
            stiffness, damping = _gains(_inertia_moved_by(mechanism, joint))
            joint = replace(joint, drive=Drive(stiffness, damping, efforts.get(joint.name)))
            assumed.add(joint.name)
            text = (
                f"joint '{joint.name}' is driven, but the file states no gains: they are ASSUMED, with a natural "
                f"frequency of {FREQUENCY:g} Hz."
            )
            findings.warn("drive", text, joint.name)
        joints.append(joint)
    for name, effort in efforts.items():
        if not mechanism.joint(name).active:
            text = f"joint '{name}': effort {effort:g} is not imported: the joint has no drive."
            findings.warn("effort", text, name)
    mechanism = replace(mechanism, joints=tuple(joints))
    return replace(imported, mechanism=mechanism, findings=findings, assumed=frozenset(assumed), efforts={})


def _report_not_positive(imported: Imported, findings: Findings) -> None:
    """Add a warning for each effort of a joint that is not positive."""
    stated: list[tuple[str, float]] = []
    for joint in imported.mechanism.joints:
        if joint.drive and joint.drive.max_effort is not None:
            stated.append((joint.name, joint.drive.max_effort))
    stated += imported.efforts.items()
    for name, effort in stated:
        if not effort > 0:
            text = f"joint '{name}': maximum effort {effort:g} is not imported: it must be positive."
            findings.warn("effort", text, name)


def _gains(moved_inertia: float) -> tuple[float, float]:
    """Return (stiffness, damping) for an inertia in kg m2, or a mass in kg."""
    # A mass m on a spring and a damper: stiffness m w^2 gives the frequency w, and damping 2 m w is critical.
    return float(moved_inertia * _ANGULAR_FREQUENCY**2), float(2 * moved_inertia * _ANGULAR_FREQUENCY)


def _with_gains(
    mechanism: Mechanism, efforts: dict[str, float], assumed: set[str], findings: Findings
) -> tuple[Actuator, ...]:
    """Return the actuators, each with a drive. Missing gains are ASSUMED, from the inertia that the motor moves.

    A motor that alone moves a joint gets the effort of this joint in `efforts`. `assumed` gets the names of the motors
    with assumed gains, `findings` what is assumed and what is left out.
    """
    motors: dict[str, Actuator] = {}
    for actuator in mechanism.actuators:
        motors[actuator.name] = actuator
    for transmission in mechanism.transmissions:
        joint_inertias = []
        for name in transmission.joints:
            joint_inertias.append(_inertia_moved_by(mechanism, mechanism.joint(name)))
        # Joints move by the matrix times the motors: what each motor moves while the others are at rest.
        motor_inertias = np.array(joint_inertias) @ transmission.matrix**2
        for name, inertia in zip(transmission.actuators, motor_inertias, strict=True):
            motor = motors[name]
            if motor.stiffness is not None:
                continue
            stiffness, damping = _gains(inertia + (motor.rotor_inertia or 0.0))
            motors[name] = replace(motor, stiffness=stiffness, damping=damping)
            assumed.add(name)
            text = (
                f"the file states no gains for actuator '{name}': they are ASSUMED, with a natural frequency of "
                f"{FREQUENCY:g} Hz."
            )
            findings.warn("drive", text, name)
        for joint in transmission.joints:
            effort = efforts.get(joint)
            if not effort:
                continue
            only_motor = transmission.single(joint)
            if only_motor is None:
                text = f"joint '{joint}': effort {effort:g} is not imported: several motors move the joint."
                findings.warn("effort", text, joint)
                continue
            name, ratio = only_motor
            # An effort that the file states for the motor itself is kept.
            motor_effort = motors[name].max_effort or effort * abs(ratio)
            motors[name] = replace(motors[name], max_effort=motor_effort)
    return tuple(motors.values())


def _inertia_moved_by(mechanism: Mechanism, joint: Joint) -> float:
    """Return the inertia in kg m2 of the bodies moved by a joint, about its axis; for a slide, their mass in kg.

    If they have no mass, it is that of `_INERTIA_WITHOUT_MASSES`.
    """
    # The tree is sorted from the base outwards: a joint comes after the joint that carries its parent.
    moved_bodies: set[str] = set()
    for tree_joint in mechanism.tree:
        if tree_joint.name == joint.name or tree_joint.parent in moved_bodies:
            moved_bodies.add(tree_joint.child)
    T_joint_base = spatial.inverse(mechanism.rest[joint.parent] @ joint.T_parent_joint)
    total = 0.0
    for body in mechanism.bodies:
        if body.name not in moved_bodies or body.inertia is None:
            continue
        if not joint.is_angle:
            total += body.inertia.mass
            continue
        T_joint_body = T_joint_base @ mechanism.rest[body.name]
        R = T_joint_body[:3, :3]
        x, y, _ = R @ body.inertia.p_body_com + T_joint_body[:3, 3]
        I_joint = R @ body.inertia.I_com @ R.T
        total += float(I_joint[2, 2] + body.inertia.mass * (x * x + y * y))  # parallel axes
    return total or _INERTIA_WITHOUT_MASSES[joint.type]
