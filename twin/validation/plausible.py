"""Numbers that contradict nothing and still cannot be meant: limits of another unit, parts of another scale."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from twin.core.findings import Finding
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.reference.mating import LOOSE, Mate

TURNS = 8 * np.pi
"""Range of an angle, in rad, above which its limits limit nothing: they are of another unit."""

SIZES = 4.0
"""Range of a slide over the size of the robot, above which the same holds."""


def wide_limits(mechanism: Mechanism) -> list[Finding]:
    """Return driven joints whose range is out of all proportion to the robot."""
    size = _size(mechanism)
    out = []
    for joint in mechanism.active:
        if joint.limits is None:
            continue
        way = joint.limits[1] - joint.limits[0]
        most = TURNS if joint.is_angle else SIZES * size
        unit, scale = ("deg", DEG) if joint.is_angle else ("mm", MM)
        if most > 0 and way > most:
            out.append(
                Finding(
                    "limit.implausible",
                    "disagreement",
                    f"joint {joint.name} may move {way / scale:.6g} {unit}, where "
                    + (
                        f"four turns are {most / scale:g} {unit}"
                        if joint.is_angle
                        else f"the robot is {size / MM:.4g} mm wide"
                    ),
                    where=joint.name,
                    size=way / scale,
                    unit=unit,
                    limit=most / scale,
                    suggestion="check the unit of its limits; a joint without an end has none",
                )
            )
    return out


def _size(mechanism: Mechanism) -> float:
    """Return the diagonal in m of the box around all joints as drawn."""
    places = [
        (mechanism.rest[j.parent] @ j.T_parent_joint)[:3, 3] for j in mechanism.joints if j.parent in mechanism.rest
    ]
    return float(np.linalg.norm(np.ptp(np.array(places), axis=0))) if places else 0.0


def apart(mates: Iterable[Mate]) -> list[Finding]:
    """Return joints whose parts, as drawn, do not touch each other."""
    return [
        Finding(
            "cad.apart",
            "disagreement",
            f"the parts of joint '{m.joint}', {m.parts[0]} and {m.parts[1]}, are {m.apart / MM:.3g} mm apart as drawn",
            where=m.joint,
            when="as drawn",
            size=m.apart / MM,
            unit="mm",
            limit=LOOSE / MM,
            suggestion="check scale and place of the shapes of both bodies",
        )
        for m in mates
        if m.apart > LOOSE
    ]
