"""Joints that follow another one: what couplings of two joints say, each follower by a joint that follows none itself.

Formats and engines that let a joint mimic another one accept no chains: where a band turns a joint by the one before,
which follows a motor, both are stated to follow the motor.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class Following:
    """A joint with the coordinate multiplier * leader + offset.

    Attributes:
        joint: name of the joint that follows; it is not driven.
        leader: name of the joint that it follows, which follows no other.
        multiplier: of the leader's coordinate.
        offset: in m or rad.
    """

    joint: str
    leader: str
    multiplier: float
    offset: float


def following(mechanism: Mechanism, among: Container[str]) -> dict[str, Following]:
    """Return the joint that each coupling makes follow, by name of the coupling.

    Couplings of more than two joints are left out, and those that couple no further joint, as of two driven ones.

    Args:
        mechanism: the robot.
        among: names of joints that may follow and be followed; couplings of others are left out.
    """
    known = {j.name: (j.name, 1.0, 0.0) for j in mechanism.active}
    left = [c for c in mechanism.couplings if len(c.joints) == 2 and all(n in among for n in c.joints)]
    out: dict[str, Following] = {}
    while left:
        coupling = next((c for c in left if known.keys() & set(c.joints)), left[0])
        left.remove(coupling)
        before = next((n for n in coupling.joints if n in known), coupling.joints[1])
        (after,) = (n for n in coupling.joints if n != before)
        if after in known:
            continue
        leader, multiplier, offset = known.setdefault(before, (before, 1.0, 0.0))
        ratio = dict(zip(coupling.joints, coupling.ratios, strict=True))
        step = -ratio[before] / ratio[after]
        known[after] = leader, step * multiplier, step * offset + coupling.total / ratio[after]
        out[coupling.name] = Following(after, *known[after])
    return out
