"""Find implausible numbers: joint limits in a wrong unit, and parts drawn at a wrong scale or place."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.core.findings import Finding, Kind
from twin.core.quantity import mm, moved
from twin.model.mechanism import Mechanism
from twin.reference.mating import LOOSE, Mate

LARGEST_PLAUSIBLE_TURN = 8 * np.pi
"""Range in rad of an angular joint above which its limits are probably in a wrong unit."""

LARGEST_PLAUSIBLE_SLIDE = 4.0
"""Range of a sliding joint, divided by the robot's size, above which its limits are probably in a wrong unit."""

_RANGE_IMPLAUSIBLE = Kind(
    "limit.implausible", "disagreement", "check the unit of its limits; omit the limits of a joint without end stops"
)
_PARTS_APART = Kind("cad.apart", "disagreement", "check scale and place of the shapes of both bodies")


def wide_limits(mechanism: Mechanism) -> list[Finding]:
    """Return a finding for each driven joint with an implausibly wide range."""
    size = _size(mechanism)
    findings = []
    for joint in mechanism.active:
        if joint.limits is None:
            continue
        low, high = joint.limits
        width = high - low
        most = LARGEST_PLAUSIBLE_TURN if joint.is_angle else LARGEST_PLAUSIBLE_SLIDE * size
        if most > 0 and width > most:
            text = f"joint {joint.name} has an implausibly wide range"
            range_width = moved(width, joint.is_angle)
            findings.append(_RANGE_IMPLAUSIBLE(joint.name, text, range_width, moved(most, joint.is_angle)))
    return findings


def _size(mechanism: Mechanism) -> float:
    """Return the diagonal in m of the box around all joint origins in the rest pose; 0 without joints."""
    places = []
    for joint in mechanism.joints:
        if joint.parent in mechanism.rest:
            T_base_joint = mechanism.rest[joint.parent] @ joint.T_parent_joint
            places.append(T_base_joint[:3, 3])
    if not places:
        return 0.0
    return float(np.linalg.norm(np.ptp(np.array(places), axis=0)))


def parts_apart(mates: Iterable[Mate]) -> list[Finding]:
    """Return a finding for each joint whose two parts do not touch in the CAD."""
    findings = []
    for mate in mates:
        if not mate.distance > LOOSE:  # NaN is no distance
            continue
        first, second = mate.parts
        text = f"the parts of joint '{mate.joint}', {first} and {second}, are apart in the CAD"
        findings.append(_PARTS_APART(mate.joint, text, mm(mate.distance), mm(LOOSE), when="as drawn"))
    return findings
