"""Add a drive to each driven joint for which the file states no gains.

The gains of these drives are ASSUMED: they are computed from the inertia that the joint moves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.core import spatial
from twin.exchange.read.source import Findings, Imported
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism
from twin.model.transmission import Actuator

FREQUENCY = 5.0
"""Natural frequency in Hz of assumed drives. With critical damping, it determines their gains."""

NOTE = f"the file has no gains; these give {FREQUENCY:g} Hz and critical damping for the inertia moved at rest"
"""Note on each assumed drive, written to the description of the robot."""

_NOTHING = {"revolute": 1e-3, "prismatic": 1.0}
"""Inertia in kg m2 (revolute) or mass in kg (prismatic) assumed for the moved bodies if the file has no masses."""


def with_drives(imported: Imported) -> Imported:
    """Return the mechanism with a drive on every driven joint. Each added drive is reported and listed in `assumed`."""
    m, findings, assumed = imported.mechanism, Findings(imported.findings), set(imported.assumed)
    joints = []
    stated = {j.name: j.drive.max_effort for j in m.joints if j.drive} | imported.efforts
    for name in (n for n, e in stated.items() if e is not None and not e > 0):
        text = f"joint '{name}': maximum effort {stated[name]:g} is not imported: it must be positive."
        findings.warn("effort", text, name)
    efforts = {n: e for n, e in imported.efforts.items() if e > 0}
    m = replace(m, actuators=_motors(m, efforts, assumed, findings))
    for joint in m.joints:
        if joint.drive and joint.drive.max_effort is not None and not joint.drive.max_effort > 0:
            joint = replace(joint, drive=replace(joint.drive, max_effort=None))
        if joint.active and joint.drive is None and m.transmission_of(joint.name) is None:
            carried = _carried(m, joint) or _NOTHING[joint.type]
            rate = 2 * np.pi * FREQUENCY
            joint = replace(joint, drive=Drive(carried * rate**2, 2 * carried * rate, efforts.get(joint.name)))
            assumed.add(joint.name)
            text = (
                f"joint '{joint.name}' is driven, but the file states no gains: they are ASSUMED, with a natural "
                f"frequency of {FREQUENCY:g} Hz."
            )
            findings.warn("drive", text, joint.name)
        joints.append(joint)
    left = {n: e for n, e in efforts.items() if not m.joint(n).active}
    for name, effort in left.items():
        findings.warn("effort", f"joint '{name}': effort {effort:g} is not imported: the joint has no drive.", name)
    return replace(
        imported, mechanism=replace(m, joints=tuple(joints)), findings=findings, assumed=frozenset(assumed), efforts={}
    )


def _motors(m: Mechanism, efforts: dict[str, float], assumed: set[str], findings: Findings) -> tuple[Actuator, ...]:
    """Return the actuators, each with a drive. Missing gains are ASSUMED, from the inertia that the motor moves."""
    found = {a.name: a for a in m.actuators}
    rate = 2 * np.pi * FREQUENCY
    for t in m.transmissions:
        joints = [m.joint(n) for n in t.joints]
        inertias = np.array([_carried(m, j) or _NOTHING[j.type] for j in joints]) @ t.matrix**2  # other joints locked
        for name, carried in zip(t.actuators, inertias, strict=True):
            a = found[name]
            if a.stiffness is None:
                felt = carried + (a.rotor_inertia or 0.0)
                found[name] = replace(a, stiffness=float(felt * rate**2), damping=float(2 * felt * rate))
                assumed.add(name)
                text = (
                    f"the file states no gains for actuator '{name}': they are ASSUMED, with a natural frequency of "
                    f"{FREQUENCY:g} Hz."
                )
                findings.warn("drive", text, name)
        for joint in (n for n in t.joints if efforts.get(n)):
            if single := t.single(joint):
                name, ratio = single
                known = found[name].max_effort
                found[name] = replace(found[name], max_effort=known or efforts[joint] * abs(ratio))
            else:
                text = f"joint '{joint}': effort {efforts[joint]:g} is not imported: several motors move the joint."
                findings.warn("effort", text, joint)
    return tuple(found.values())


def _carried(m: Mechanism, joint: Joint) -> float:
    """Return the inertia in kg m2 of the bodies moved by a joint, about its axis; for a slide, their mass in kg."""
    beyond = {next(j.child for j in m.tree if j.name == joint.name)}
    for j in m.tree:
        if j.parent in beyond and j.name != joint.name:
            beyond.add(j.child)
    T = spatial.inverse(m.rest[joint.parent] @ joint.T_parent_joint)
    total = 0.0
    for body in m.bodies:
        if body.name not in beyond or body.inertia is None:
            continue
        if not joint.is_angle:
            total += body.inertia.mass
            continue
        at = T @ m.rest[body.name]
        x, y, _ = at[:3, :3] @ body.inertia.p_body_com + at[:3, 3]
        turned = at[:3, :3] @ body.inertia.I_com @ at[:3, :3].T
        total += float(turned[2, 2] + body.inertia.mass * (x * x + y * y))
    return total
