"""Find implausible numbers: joint limits in a wrong unit, and parts drawn at a wrong scale or place."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.core.findings import Finding, Kind
from twin.core.quantity import mm, moved
from twin.model.mechanism import Mechanism
from twin.reference.mating import LOOSE, Mate

TURNS = 8 * np.pi
"""Range in rad of an angular joint above which its limits are probably in a wrong unit."""

SIZES = 4.0
"""Range of a sliding joint, divided by the robot's size, above which its limits are probably in a wrong unit."""

_IMPLAUSIBLE = Kind(
    "limit.implausible", "disagreement", "check the unit of its limits; omit the limits of a joint without end stops"
)
_APART = Kind("cad.apart", "disagreement", "check scale and place of the shapes of both bodies")


def wide_limits(mechanism: Mechanism) -> list[Finding]:
    """Return a finding for each driven joint with an implausibly wide range."""
    size = _size(mechanism)
    out = []
    for joint in mechanism.active:
        if joint.limits is None:
            continue
        way = joint.limits[1] - joint.limits[0]
        most = TURNS if joint.is_angle else SIZES * size
        if most > 0 and way > most:
            out.append(
                _IMPLAUSIBLE(
                    joint.name,
                    f"joint {joint.name} has an implausibly wide range",
                    moved(way, joint.is_angle),
                    moved(most, joint.is_angle),
                )
            )
    return out


def _size(mechanism: Mechanism) -> float:
    """Return the diagonal in m of the box around all joint origins in the rest pose; 0 without joints."""
    places = [
        (mechanism.rest[j.parent] @ j.T_parent_joint)[:3, 3] for j in mechanism.joints if j.parent in mechanism.rest
    ]
    return float(np.linalg.norm(np.ptp(np.array(places), axis=0))) if places else 0.0


def apart(mates: Iterable[Mate]) -> list[Finding]:
    """Return a finding for each joint whose two parts do not touch in the CAD."""
    return [
        _APART(
            m.joint,
            f"the parts of joint '{m.joint}', {m.parts[0]} and {m.parts[1]}, are apart in the CAD",
            mm(m.apart),
            mm(LOOSE),
            when="as drawn",
        )
        for m in mates
        if m.apart > LOOSE
    ]
