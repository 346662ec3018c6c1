"""What a URDF cannot hold of a mechanism, and which of its joints a closure YAML holds instead."""

from __future__ import annotations

import math
from collections.abc import Iterator

from twin.core.findings import Finding, Kind, info, warning
from twin.exchange.formats.urdf.write.joints import NO_LIMIT
from twin.exchange.write.assumed_masses import partly_shown, unweighed
from twin.exchange.write.omissions import left_out, limits_left_out, motors_left_out
from twin.model.joint import Joint
from twin.model.mechanism import EARTH, Coupling, Mechanism
from twin.model.mimic_joints import Following, following
from twin.usd.write.spanning import spanning

_TRANSMISSION = Kind("export.urdf_transmission", "warning", "use MJCF or USD if motors matter")
_LOOPS = Kind("export.urdf_loops", "warning", "use MJCF or USD where programs do not read the closure YAML")


def urdf_findings(mechanism: Mechanism, name: str = "") -> list[Finding]:
    """Return findings on data that URDF cannot hold; the URDF file contains the findings as comments.

    `name` is the name of the URDF and of its closure YAML without suffix, by default that of the robot.
    """
    name = name or mechanism.name
    file = f"{name}.urdf"
    findings = [*unweighed(mechanism, file), *partly_shown(mechanism, file)]
    findings += motors_left_out(mechanism, file, "limits", "rotor_inertia", "stiffness")
    for transmission in mechanism.transmissions:
        if not all(map(transmission.single, transmission.joints)):
            text = (
                f"{file}: URDF cannot hold the matrix of transmission {transmission.name} ({transmission.equations}), "
                "only the names of its joints and actuators"
            )
            findings.append(_TRANSMISSION(transmission.name, text))
    cut_names = []
    cut_joints = []
    for joint in loop_joints(mechanism):
        cut_names.append(joint.name)
        cut_joints.append(f"{joint.name} ({joint.type}, {joint.parent} to {joint.child})")
    if cut_joints:
        text = (
            f"{file}: URDF cannot close loops; {name}.yaml closes them, at {', '.join(cut_joints)}. Programs "
            "that do not read it have correct link poses only with the values of the passive joints from the tracks"
        )
        findings.append(_LOOPS(", ".join(cut_names), text))
    for coupling in couplings_without_mimic(mechanism):
        terms = []
        for joint_name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
            terms.append(f"{ratio:g} {joint_name}")
        text = (
            f"{file}: URDF cannot hold coupling {coupling.name}: {' + '.join(terms)} = {coupling.total:g}; it is in "
            f"{name}.yaml"
        )
        findings.append(warning("export.urdf_coupling", coupling.name, text))
    findings += left_out(mechanism, file, "soft_limits", "max_acceleration", "max_jerk", "cone")
    findings += limits_left_out(mechanism, file)
    findings += _limits_on_one_side(mechanism, file)
    if mechanism.gravity != EARTH:
        vector = ", ".join(map("{:g}".format, mechanism.gravity))
        text = f"{file}: the format cannot hold gravity, which is ({vector}) m/s2; set it in the simulator"
        findings.append(info("export.left_out", "gravity", text))
    if mechanism.frames or mechanism.points:
        names = ", ".join(part.name for part in (*mechanism.frames, *mechanism.points))
        findings.append(info("export.left_out", names, f"{file}: URDF cannot hold the frames and points {names}"))
    return findings


def _limits_on_one_side(mechanism: Mechanism, file: str) -> Iterator[Finding]:
    """Yield a finding for each joint with only a lower or only an upper limit."""
    for joint in mechanism.joints:
        low, high = joint.limits or (-math.inf, math.inf)
        if math.isfinite(low) == math.isfinite(high):
            continue
        side = "an upper" if math.isfinite(low) else "a lower"
        unit = "rad" if joint.is_angle else "m"
        text = f"{file}: URDF requires both limits: joint {joint.name} has none on one side, and gets {side} limit of "
        number = NO_LIMIT if math.isfinite(low) else -NO_LIMIT
        yield info("export.left_out", joint.name, f"{text}{number:g} {unit}")


def mimics(mechanism: Mechanism) -> dict[str, Following]:
    """Return {coupling: its leader and follower} for couplings of two joints of the tree; URDF can hold no others."""
    one_coordinate_joints = set()
    for joint in spanning(mechanism).tree:
        if joint.type in ("revolute", "prismatic"):
            one_coordinate_joints.add(joint.name)
    return following(mechanism, one_coordinate_joints)


def couplings_without_mimic(mechanism: Mechanism) -> list[Coupling]:
    """Return the couplings that are no mimics of URDF."""
    with_mimic = mimics(mechanism)
    return [coupling for coupling in mechanism.couplings if coupling.name not in with_mimic]


def loop_joints(mechanism: Mechanism) -> list[Joint]:
    """Return the joints that close loops; a free joint closes none."""
    return [joint for joint in spanning(mechanism).cut if joint.type != "free"]
