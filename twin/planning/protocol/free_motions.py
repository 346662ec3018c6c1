"""Replace the motions of a protocol outside the patient by free motions, which go around obstacles."""

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


def with_free_motions(protocol: Protocol, scene: str = "", clearance: float = 0.005, seed: int = 0) -> Protocol:
    """Return the protocol with `free` phases instead of `joints`, `positioning` and `home` phases; waypoints are kept.

    Phases of the type `free` keep their clearance and seed; their scene is `scene`, if it is given. All free phases
    have the strictest limits of the replaced types and of `free`.

    Args:
        protocol: the protocol.
        scene: name or path of a scene with the robot; "": only the robot's own bodies are avoided.
        clearance: minimum distance in m.
        seed: seed of the random search.

    Raises:
        ProtocolError: the clearance is not a positive number, the seed is negative, or the protocol has no phase of
            these three types and none of the type `free`.
    """
    if not 0 < clearance < float("inf"):
        raise ProtocolError(
            f"{protocol.name}: the clearance to avoid obstacles is {clearance:g} m; give a finite number above 0"
        )
    if seed < 0:
        raise ProtocolError(f"{protocol.name}: the seed of the search is {seed}; give at least 0")
    phases = []
    replaced_names = []
    types = set()  # of the phases whose limits the free phases must keep
    for phase in protocol.phases:
        if isinstance(phase, (Joints, Positioning, Home)):
            replaced_names.append(phase.name)
            types.add(phase.type)
            phase = Free(phase.name, phase.to, clearance, seed, scene)
        elif isinstance(phase, Free):
            types.add(phase.type)
            phase = replace(phase, scene=scene or phase.scene)
        phases.append(phase)
    if not types:
        raise ProtocolError(
            f"{protocol.name}: no phase can go around obstacles; give one the type joints, positioning, home or free"
        )
    if "free" in protocol.limits:
        types.add("free")
    # sorted: of equal limits, the first one's provenance and note are kept
    strictest = _strictest([protocol.limits[kind] for kind in sorted(types)])
    findings = list(protocol.findings)
    if replaced_names:
        names = ", ".join(replaced_names)
        subject = f"{len(replaced_names)} phases go"
        if len(replaced_names) == 1:
            subject = "1 phase goes"
        findings.append(info("trajectory.avoiding", "", f"{subject} around obstacles: {names}"))
    return replace(
        protocol,
        phases=tuple(phases),
        limits={**protocol.limits, "free": strictest},
        findings=tuple(findings),
    )


def _strictest(limits_of_phases: Sequence[Limits]) -> Limits:
    """Return the minimum of each limit; provenance and note are those of the first limits."""
    smallest = {}
    for limit in fields(Limits):
        values = [getattr(limits, limit.name) for limits in limits_of_phases]
        if isinstance(values[0], (int, float)):
            smallest[limit.name] = min(values)
    return replace(limits_of_phases[0], **smallest)
