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
    phases = tuple(
        Free(p.name, p.to, clearance, seed, scene) if isinstance(p, (Joints, Positioning, Home)) else p
        for p in protocol.phases
    )
    phases = tuple(replace(p, scene=scene or p.scene) if isinstance(p, Free) else p for p in phases)
    types = {p.type for p in changed} | ({"free"} & set(protocol.limits))
    used = [protocol.limits[kind] for kind in sorted(types)]
    text = f"{len(changed)} phases go around obstacles: {', '.join(p.name for p in changed)}"
    found = [info("trajectory.avoiding", "", text)] if changed else []
    return replace(
        protocol,
        phases=phases,
        limits={**protocol.limits, "free": _strictest(used)},
        findings=(*protocol.findings, *found),
    )


def _strictest(used: Sequence[Limits]) -> Limits:
    """Return the minimum of each limit over `used`."""
    numbers = [f.name for f in fields(Limits) if isinstance(getattr(used[0], f.name), (int, float))]
    return replace(used[0], **{name: min(getattr(limits, name) for limits in used) for name in numbers})
