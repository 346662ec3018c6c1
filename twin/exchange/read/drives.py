"""Drives for driven joints that the file gives none: ASSUMED, from the inertia that they carry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.core import spatial
from twin.exchange.read.source import Imported, warning
from twin.model.mechanism import Drive, Joint, Mechanism

FREQUENCY = 5.0
"""Natural frequency in Hz of an assumed drive, critically damped."""

NOTE = f"no gains in the file: {FREQUENCY:g} Hz, critically damped, on the inertia beyond the joint as it rests"
"""Where the numbers of an assumed drive come from."""

_NOTHING = {"revolute": 1e-3, "prismatic": 1.0}
"""Inertia in kg m2 or kg that is taken where the file has no masses."""


def with_drives(imported: Imported) -> Imported:
    """Return the mechanism with a drive on every driven joint; those that the file lacks are told and listed."""
    m, findings, assumed = imported.mechanism, list(imported.findings), set(imported.assumed)
    joints = []
    for joint in m.joints:
        if joint.active and joint.drive is None:
            carried = _carried(m, joint) or _NOTHING[joint.type]
            rate = 2 * np.pi * FREQUENCY
            effort = imported.efforts.get(joint.name)
            joint = replace(joint, drive=Drive(carried * rate**2, 2 * carried * rate, effort))
            assumed.add(joint.name)
            text = f"joint '{joint.name}' is driven without gains in the file: its drive is ASSUMED ({FREQUENCY:g} Hz)."
            findings.append(warning("drive", text, joint.name))
        joints.append(joint)
    left = {n: e for n, e in imported.efforts.items() if e and not m.joint(n).active}
    for name, effort in left.items():
        findings.append(warning("effort", f"joint '{name}': effort {effort:g} is not kept: no drive there.", name))
    return replace(
        imported, mechanism=replace(m, joints=tuple(joints)), findings=findings, assumed=frozenset(assumed), efforts={}
    )


def _carried(m: Mechanism, joint: Joint) -> float:
    """Return the inertia in kg m2 about, or the mass in kg along, the axis of all bodies beyond a joint in the tree."""
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
