"""Joints that follow another joint (the leader) through couplings; no leader is itself a follower.

In file formats and engines, a mimic joint must not follow another mimic joint. If joint c follows joint b, and b
follows a driven joint a, both b and c are therefore returned as followers of a.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

from twin.model.mechanism import Coupling, Mechanism


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
    # {joint: how it follows its leader}; a leader follows itself
    following_of = {joint.name: _self_following(joint.name) for joint in mechanism.active}
    pending = []
    for coupling in mechanism.couplings:
        if len(coupling.joints) != 2:
            continue
        first, second = coupling.joints
        if first in among and second in among:
            pending.append(coupling)
    followers: dict[str, Following] = {}
    while pending:
        coupling = _next_coupling(pending, following_of)
        pending.remove(coupling)
        first, second = coupling.joints
        first_ratio, second_ratio = coupling.ratios
        if first in following_of:
            before = first
            after = second
            step = -first_ratio / second_ratio
            shift = coupling.total / second_ratio
        else:
            before = second
            after = first
            step = -second_ratio / first_ratio
            shift = coupling.total / first_ratio
        if after in following_of:
            continue  # both are known already: the coupling is a condition between their leaders
        # A follower of a follower gets the leader's leader, as formats forbid chains of mimic joints.
        previous = following_of.setdefault(before, _self_following(before))
        follower = Following(after, previous.leader, step * previous.multiplier, step * previous.offset + shift)
        following_of[after] = follower
        followers[coupling.name] = follower
    return followers


def _self_following(name: str) -> Following:
    """Return a leader as a joint that follows itself."""
    return Following(name, name, 1.0, 0.0)


def _next_coupling(pending: list[Coupling], following_of: Mapping[str, Following]) -> Coupling:
    """Return the first coupling with a known joint; without any, the first one, whose second joint then leads."""
    for coupling in pending:
        first, second = coupling.joints
        if first in following_of or second in following_of:
            return coupling
    return pending[0]
