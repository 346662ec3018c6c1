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

_RATE = 2 * np.pi * FREQUENCY

NOTE = f"the file has no gains; these give {FREQUENCY:g} Hz and critical damping for the inertia moved at rest"
"""Note on each assumed drive, written to the description of the robot."""

_NOTHING = {"revolute": 1e-3, "prismatic": 1.0}
"""Inertia in kg m2 (revolute) or mass in kg (prismatic) assumed for the moved bodies if the file has no masses."""


def with_drives(imported: Imported) -> Imported:
    """Return the mechanism with a drive on every driven joint. Each added drive is reported and listed in `assumed`."""
    m = imported.mechanism
    findings = Findings(imported.findings)
    assumed = set(imported.assumed)
    stated: dict[str, float | None] = {}
    for joint in m.joints:
        if joint.drive:
            stated[joint.name] = joint.drive.max_effort
    stated |= imported.efforts
    for name, effort in stated.items():
        if effort is not None and not effort > 0:
            text = f"joint '{name}': maximum effort {effort:g} is not imported: it must be positive."
            findings.warn("effort", text, name)
    efforts: dict[str, float] = {}
    for name, effort in imported.efforts.items():
        if effort > 0:
            efforts[name] = effort
    m = replace(m, actuators=_motors(m, efforts, assumed, findings))
    joints = []
    for joint in m.joints:
        if joint.drive and joint.drive.max_effort is not None and not joint.drive.max_effort > 0:
            joint = replace(joint, drive=replace(joint.drive, max_effort=None))
        if joint.active and joint.drive is None and m.transmission_of(joint.name) is None:
            carried = _carried(m, joint) or _NOTHING[joint.type]
            # A mass m on a spring and a damper: stiffness m w^2 gives the frequency w, and damping 2 m w is critical.
            drive = Drive(carried * _RATE**2, 2 * carried * _RATE, efforts.get(joint.name))
            joint = replace(joint, drive=drive)
            assumed.add(joint.name)
            text = (
                f"joint '{joint.name}' is driven, but the file states no gains: they are ASSUMED, with a natural "
                f"frequency of {FREQUENCY:g} Hz."
            )
            findings.warn("drive", text, joint.name)
        joints.append(joint)
    for name, effort in efforts.items():
        if not m.joint(name).active:
            text = f"joint '{name}': effort {effort:g} is not imported: the joint has no drive."
            findings.warn("effort", text, name)
    mechanism = replace(m, joints=tuple(joints))
    return replace(imported, mechanism=mechanism, findings=findings, assumed=frozenset(assumed), efforts={})


def _motors(
    mechanism: Mechanism, efforts: dict[str, float], assumed: set[str], findings: Findings
) -> tuple[Actuator, ...]:
    """Return the actuators, each with a drive. Missing gains are ASSUMED, from the inertia that the motor moves."""
    motors: dict[str, Actuator] = {}
    for actuator in mechanism.actuators:
        motors[actuator.name] = actuator
    for transmission in mechanism.transmissions:
        carried_by_joints: list[float] = []
        for name in transmission.joints:
            joint = mechanism.joint(name)
            carried_by_joints.append(_carried(mechanism, joint) or _NOTHING[joint.type])
        inertias = (
            np.array(carried_by_joints) @ transmission.matrix**2
        )  # what each motor moves, with the other joints locked
        for name, carried in zip(transmission.actuators, inertias, strict=True):
            motor = motors[name]
            if motor.stiffness is not None:
                continue
            moved_inertia = carried + (motor.rotor_inertia or 0.0)
            motors[name] = replace(
                motor, stiffness=float(moved_inertia * _RATE**2), damping=float(2 * moved_inertia * _RATE)
            )
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
            single = transmission.single(joint)
            if single is None:
                text = f"joint '{joint}': effort {effort:g} is not imported: several motors move the joint."
                findings.warn("effort", text, joint)
                continue
            name, ratio = single
            # An effort that the file states for the motor itself is kept.
            motor_effort = motors[name].max_effort or effort * abs(ratio)
            motors[name] = replace(motors[name], max_effort=motor_effort)
    return tuple(motors.values())


def _carried(mechanism: Mechanism, joint: Joint) -> float:
    """Return the inertia in kg m2 of the bodies moved by a joint, about its axis; for a slide, their mass in kg."""
    # The tree is sorted from the base outwards: a joint comes after the joint that carries its parent.
    moved_bodies: set[str] = set()
    for tree_joint in mechanism.tree:
        if tree_joint.name == joint.name or tree_joint.parent in moved_bodies:
            moved_bodies.add(tree_joint.child)
    T = spatial.inverse(mechanism.rest[joint.parent] @ joint.T_parent_joint)
    total = 0.0
    for body in mechanism.bodies:
        if body.name not in moved_bodies or body.inertia is None:
            continue
        if not joint.is_angle:
            total += body.inertia.mass
            continue
        at = T @ mechanism.rest[body.name]
        x, y, _ = at[:3, :3] @ body.inertia.p_body_com + at[:3, 3]
        turned = at[:3, :3] @ body.inertia.I_com @ at[:3, :3].T
        total += float(turned[2, 2] + body.inertia.mass * (x * x + y * y))
    return total
