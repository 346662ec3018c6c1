"""Joints that follow another joint (the leader) through couplings; no leader is itself a follower.

In file formats and engines, a mimic joint must not follow another mimic joint. If joint c follows joint b, and b
follows a driven joint a, both b and c are therefore returned as followers of a.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class Following:
    """A joint whose coordinate is multiplier * (coordinate of the leader) + offset.

    `joint` is not driven; `leader` follows no other joint; `offset` is in m or rad.
    """

    joint: str
    leader: str
    multiplier: float
    offset: float


def following(mechanism: Mechanism, among: Container[str]) -> dict[str, Following]:
    """Return {name of a coupling: follower that results from this coupling}.

    A coupling is omitted if it has more than two joints, or if no follower results (for example, if both are driven).
    `among` has the names of joints that may lead or follow; couplings with other joints are omitted.
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
