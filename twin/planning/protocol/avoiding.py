"""A protocol whose motions outside the patient go around obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from twin.core.errors import ProtocolError
from twin.core.findings import info
from twin.planning.protocol.model import Limits, Protocol
from twin.planning.protocol.phases.free import Free
from twin.planning.protocol.phases.home import Home
from twin.planning.protocol.phases.joints import Joints
from twin.planning.protocol.phases.positioning import Positioning


def avoiding(protocol: Protocol, scene: str = "", clearance: float = 0.005, seed: int = 0) -> Protocol:
    """Return the protocol with `free` phases instead of `joints`, `positioning` and `home` phases; waypoints are kept.

    Args:
        protocol: the protocol.
        scene: name or path of a scene with the robot; "": only the robot's own bodies are avoided.
        clearance: minimum distance in m.
        seed: seed of the random search.

    Raises:
        ProtocolError: the clearance is not a positive number, the seed is negative, or the protocol has no phase of
            these three types.
    """
    if not 0 < clearance < float("inf"):
        raise ProtocolError(
            f"{protocol.name}: the clearance to avoid obstacles is {clearance:g} m; give a finite number above 0"
        )
    if seed < 0:
        raise ProtocolError(f"{protocol.name}: the seed of the search is {seed}; give at least 0")
    changed = [p for p in protocol.phases if isinstance(p, (Joints, Positioning, Home))]
    if not changed and not any(isinstance(p, Free) for p in protocol.phases):
        raise ProtocolError(
            f"{protocol.name}: no phase can go around obstacles; give one the type joints, positioning, home or free"
        )
    phases = []
    for phase in protocol.phases:
        if isinstance(phase, (Joints, Positioning, Home)):
            phase = Free(phase.name, phase.to, clearance, seed, scene)
        elif isinstance(phase, Free):
            phase = replace(phase, scene=scene or phase.scene)
        phases.append(phase)
    types = {phase.type for phase in changed}
    if "free" in protocol.limits:
        types.add("free")
    strictest = _strictest([protocol.limits[kind] for kind in sorted(types)])
    findings = list(protocol.findings)
    if changed:
        names = ", ".join(phase.name for phase in changed)
        findings.append(info("trajectory.avoiding", "", f"{len(changed)} phases go around obstacles: {names}"))
    return replace(
        protocol,
        phases=tuple(phases),
        limits={**protocol.limits, "free": strictest},
        findings=tuple(findings),
    )


def _strictest(used: Sequence[Limits]) -> Limits:
    """Return the minimum of each limit over `used`."""
    smallest = {}
    for limit in fields(Limits):
        values = [getattr(limits, limit.name) for limits in used]
        if isinstance(values[0], (int, float)):
            smallest[limit.name] = min(values)
    return replace(used[0], **smallest)
