"""All robots of a scene at once: where their links are, how near they come, whether each stays in its port."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.model.scene import Place, Scene
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, between

RATE = 10.0
"""Hz at which distances are measured."""

PORT_TOLERANCE = 0.1e-3
"""How far in m a robot's RCM may lie from the port that it is said to work through."""


@dataclass(frozen=True)
class Actor:
    """A robot of the scene with what it is and does; `trocars` (3,) in its base, by name as in its `place`."""

    place: Place
    mechanism: Mechanism
    trajectory: Trajectory
    trocars: Mapping[str, Array]


@dataclass(frozen=True)
class Played:
    """What playing a scene gave.

    Attributes:
        t: (k,) s.
        by_pair: minimum clearances of each pair of owners.
        findings: collisions, and ports that are missed.
    """

    t: Array
    by_pair: Mapping[tuple[str, str], Clearance]
    findings: tuple[Finding, ...]


def trocars_of(place: Place, mechanism: Mechanism, trajectory: Trajectory) -> dict[str, Array]:
    """Return where a robot's trocars are, (3,) in its base: the mechanism's, else the first RCM of its motion.

    Raises:
        TwinError: the robot has not the trocars that its place gives ports for.
    """
    if mechanism.trocars:
        at = {n: mechanism.trocar_at(n) for n in place.ports}
        if lacking := [n for n in mechanism.trocars if "" not in at and n not in at]:
            raise TwinError(f"{place.name}: ports gives no port for trocar {', '.join(lacking)}")
        return at
    rcm = next((p.rcm for p in trajectory.phases if p.rcm is not None), None)
    if rcm is None:
        raise TwinError(f"{place.name}: protocol '{place.protocol}' registers no RCM: it works through no port")
    if unheld := [n for n in place.ports if n]:
        raise TwinError(f"{place.name} has no trocar '{unheld[0]}': give its port as port, not in ports")
    return {"": rcm}


def play(
    scene: Scene,
    actors: list[Actor],
    props: Mechanism | None,
    progress: Callable[[str, float], None] = lambda label, fraction: None,
) -> Played:
    """Move all robots at once from t = 0, each resting when it is done, and measure."""
    duration = max(a.trajectory.duration for a in actors)
    t = np.linspace(0.0, duration, int(duration * RATE) + 1)
    mechanisms: dict[str, Mechanism] = {}
    poses: dict[str, dict[str, Array]] = {}
    findings = []
    for i, a in enumerate(actors):
        progress(f"move {a.place.name}", i / (len(actors) + 2))
        at = np.minimum(t, a.trajectory.duration)
        model = ReferenceModel(a.mechanism)
        run = a.trajectory.on(model, at)
        mechanisms[a.place.name] = a.mechanism
        poses[a.place.name] = {n: a.place.T_world_base @ T for n, T in model.link_poses(run.x).items()}
        findings += _port(a)
    if props is not None:
        still = ReferenceModel(props).home().link_poses
        mechanisms[props.name] = props
        poses[props.name] = {n: np.broadcast_to(T, (len(t), 4, 4)) for n, T in still.items()}
    progress("distances between the robots", len(actors) / (len(actors) + 2))
    by_pair = between(mechanisms, poses, scene.touching)
    for found in by_pair.values():
        k = int(np.argmin(found.distance))
        if found.distance[k] < scene.clearance:
            findings.append(too_near(found, k, t, scene.clearance))
    return Played(t, by_pair, tuple(findings))


def too_near(found: Clearance, k: int, t: Array, clearance: float) -> Finding:
    """Say where a pair comes nearest; of one that starts in collision, from when on it is free."""
    a, b = found.pair[k]
    least, start = float(found.distance[k]), float(found.distance[0])
    what, code = f"come within {least / MM:.1f} mm", "scene.near"
    way_out = "move a base in scene.toml, or change a protocol"
    if least <= 0:
        what, code = "run through each other", "scene.collision"
    if start <= 0:
        a, b = found.pair[0]
        k, least, what, code = 0, start, "stand in each other at the start", "scene.start"
        free = np.flatnonzero(found.distance >= clearance)
        way_out = f"nowhere along the protocols are they {clearance / MM:g} mm apart: move a base in scene.toml"
        if len(free):
            way_out = (
                f"the nearest start that keeps {clearance / MM:g} mm is where the protocols are at t = "
                f"{t[free[0]]:.1f} s: begin there, or move a base in scene.toml"
            )
    return Finding(
        code,
        "disagreement",
        f"{a} and {b} {what}; {clearance / MM:g} mm must be kept",
        where=f"{a}, {b}",
        when=f"t = {t[k]:.1f} s",
        size=least / MM,
        unit="mm",
        limit=clearance / MM,
        suggestion=way_out,
    )


def _port(a: Actor) -> list[Finding]:
    out = []
    for trocar, p_world_port in a.place.p_world_ports.items():
        shift = p_world_port - (a.place.T_world_base @ np.append(a.trocars[trocar], 1.0))[:3]
        missed = float(np.linalg.norm(shift))
        if missed <= PORT_TOLERANCE:
            continue
        through = f" with trocar '{trocar}'" if trocar else ""
        out.append(
            Finding(
                "scene.port",
                "disagreement",
                f"{a.place.name} works{through} {missed / MM:.1f} mm beside its port '{a.place.ports[trocar]}'",
                where=a.place.name,
                size=missed / MM,
                unit="mm",
                limit=PORT_TOLERANCE / MM,
                suggestion="move its base by (" + ", ".join(f"{x / MM:.2f}" for x in shift) + ") mm",
            )
        )
    return out
