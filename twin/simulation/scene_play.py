"""Play the protocols of all robots of a scene in a World; measure clearances and deviations from ports.

The results are the minimum clearance of each pair of robots, and the distance of each robot's RCM or trocars from its
ports.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.model.scene import Place, Scene
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, between
from twin.simulation.controllers.protocol import ProtocolPlayer
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.plants.tissue import Tissues
from twin.simulation.scene_stage import write_scene
from twin.simulation.world import Block, Placed, World

RATE = 10.0
"""Rate in Hz at which clearances are measured."""

PORT_TOLERANCE = 0.1e-3
"""Largest accepted distance in m of a robot's RCM from its port."""


@dataclass(frozen=True)
class Actor:
    """A robot of the scene with its trajectory; `trocars` is {trocar: position (3,) in m in the robot's base}."""

    place: Place
    mechanism: Mechanism
    trajectory: Trajectory
    trocars: Mapping[str, Array]


@dataclass(frozen=True)
class Played(Result):
    """Result of playing a scene.

    Attributes:
        scene, actors, props: the scene, its robots, and its props (None: no props).
        t: (k,) times in s at which clearances are measured.
        by_pair: {(owner, owner): minimum clearance at each time}; the owners are robots and props.
        findings: findings on collisions, clearances below the required one, and robots whose RCM is not at their port.
    """

    scene: Scene
    actors: Sequence[Actor]
    props: Mechanism | None
    t: Array
    by_pair: Mapping[tuple[str, str], Clearance]
    findings: tuple[Finding, ...]

    kind = "scene"

    @property
    def duration(self) -> float:
        """Time in s at which the last robot ends its motion."""
        return _duration(self.actors)

    def content(self) -> JsonObject:
        """Return minimum clearances by pair; keys end with their unit."""
        pairs = {}
        for (a, b), c in self.by_pair.items():
            k = int(np.argmin(c.distance))
            pairs[f"{a}-{b}"] = {"least_mm": c.distance[k] / MM, "between": list(c.pair[k]), "t_s": float(self.t[k])}
        return {
            "scene": self.scene.name,
            "robots": [
                {
                    "name": a.place.name,
                    "protocol": a.place.protocol_name,
                    "port": a.place.port,
                    "duration_s": a.trajectory.duration,
                }
                for a in self.actors
            ],
            "clearance_mm": self.scene.clearance / MM,
            "pairs": pairs,
            "parameters": [
                {"name": p.name, "value": p.shown, "unit": p.unit, "provenance": p.provenance}
                for p in self.scene.parameters
            ],
        }

    def text(self) -> Iterator[Part]:
        """Yield a line per robot, the minimum clearance per pair, and the findings."""
        yield f"{self.scene.name} · {self.scene.title}\n"
        rows = [
            (a.place.name, a.place.protocol_name, a.place.port, f"{a.trajectory.duration:.1f} s") for a in self.actors
        ]
        yield TextTable(("robot", "protocol", "port", "duration"), rows)
        yield ""
        lines = []
        for (a, b), c in self.by_pair.items():
            k = int(np.argmin(c.distance))
            near = " - ".join(name.split("/")[1] for name in c.pair[k])
            lines.append((f"{a} - {b}", f"{c.distance[k] / MM:.1f} mm", near, f"t = {self.t[k]:.1f} s"))
        yield TextTable(("pair", "minimum clearance", "between", ""), lines)
        yield ""
        yield from by_severity(self.findings)
        if self.by_pair and not self.findings:
            least = min(float(c.distance.min()) for c in self.by_pair.values())
            yield f"  no collision: minimum clearance {least / MM:.1f} mm (required {self.scene.clearance / MM:g} mm)"

    def write(self, folder: Path) -> None:
        """Write scene.csv (clearance of each pair over time) and usd/ (one stage with all robots in motion).

        Raises:
            TwinError: a robot has no stage with its baked motion.
        """
        head = ",".join(["t_s", *(f"{a}_{b}_mm" for a, b in self.by_pair)])
        body = np.column_stack([self.t, *(c.distance / MM for c in self.by_pair.values())])
        np.savetxt(folder / "scene.csv", body, "%.6g", ",", header=head, comments="")
        stages = {}
        for place in self.scene.places:
            own, motion = assets.files(place.robot).usd, f"{place.robot}_{place.protocol}.usda"
            if not (own / motion).is_file():
                raise TwinError(f"{place.name} has no stage with this motion: run `twin build {place.robot}`")
            shutil.copytree(own, folder / "usd" / place.name)
            stages[place.name] = Path("..") / place.name / motion
        mechanisms = {a.place.name: a.mechanism for a in self.actors}
        write_scene(self.scene, folder / "usd" / self.scene.name, stages, mechanisms, self.props, self.duration)


def _duration(actors: Sequence[Actor]) -> float:
    return max(a.trajectory.duration for a in actors)


def trocars_of(place: Place, mechanism: Mechanism, trajectory: Trajectory) -> dict[str, Array]:
    """Return {trocar: position (3,) in m in the robot's base}.

    The result for a robot without trocars is the first RCM of its motion, with the name "".

    Raises:
        TwinError: a trocar has no port, a port is for a trocar that does not exist, or the motion has no RCM.
    """
    if mechanism.trocars:
        at = {n: mechanism.trocar_at(n) for n in place.ports}
        if lacking := [n for n in mechanism.trocars if "" not in at and n not in at]:
            raise TwinError(f"{place.name}: `ports` has no entry for trocar {', '.join(lacking)}")
        return at
    rcm = next((p.rcm for p in trajectory.phases if p.rcm is not None), None)
    if rcm is None:
        raise TwinError(f"{place.name}: protocol '{place.protocol_name}' has no RCM; a robot at a port needs one")
    if unheld := [n for n in place.ports if n]:
        raise TwinError(f"{place.name} has no trocar '{unheld[0]}': use the key `port`, not `ports`")
    return {"": rcm}


def world(
    actors: Sequence[Actor], props: Mechanism | None = None, dt: float = 1e-3, organs: Tissues | None = None
) -> World:
    """Return a World in which every robot plays its protocol from t = 0 and then remains at rest."""
    plants: list[Block] = [Kinematic(a.place.name, a.trajectory.q[0], JointLimits.of(a.mechanism)) for a in actors]
    return World(
        robots=[Placed(a.place.name, a.mechanism, a.place.T_world_base) for a in actors],
        props=() if props is None else [Placed(props.name, props)],
        deformables=() if organs is None else [t.deformable for t in organs.organs.tissues],
        controllers=[ProtocolPlayer(a.place.name, a.trajectory) for a in actors],
        plants=plants if organs is None else [*plants, organs],
        dt=dt,
    )


def play(
    scene: Scene,
    actors: Sequence[Actor],
    props: Mechanism | None,
    progress: Callable[[str, float], None] = lambda label, fraction: None,
) -> Played:
    """Play the protocols until the last robot has ended its motion; check clearances and distances from ports."""
    duration = _duration(actors)
    ticks = max(int(duration * RATE), 1)
    moving = world(actors, props, duration / ticks)
    moving.step(ticks + 1)
    recording = moving.recording()
    t = recording.t
    mechanisms: dict[str, Mechanism] = {}
    poses: dict[str, dict[str, Array]] = {}
    findings = []
    for i, a in enumerate(actors):
        progress(f"move {a.place.name}", i / (len(actors) + 2))
        model = ReferenceModel(a.mechanism)
        run = model.run(recording[f"{a.place.name}.q"])
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
    return Played(scene, actors, props, t, by_pair, tuple(findings))


def too_near(found: Clearance, k: int, t: Array, clearance: float) -> Finding:
    """Return a finding on the nearest bodies at sample k; if bodies overlap at the start, on these instead."""
    a, b = found.pair[k]
    least, start = float(found.distance[k]), float(found.distance[0])
    what, code = "come too close", "scene.near"
    way_out = "move a base in scene.toml, or change a protocol"
    if least <= 0:
        what, code = "collide", "scene.collision"
    if start <= 0:
        a, b = found.pair[0]
        k, least, what, code = 0, start, "overlap at the start", "scene.start"
        free = np.flatnonzero(found.distance >= clearance)
        way_out = f"their distance is below {mm(clearance)} throughout both protocols: move a base in scene.toml"
        if len(free):
            way_out = (
                f"start the protocols from their poses at t = {t[free[0]]:.1f} s, the first time with a clearance of "
                f"{mm(clearance)}, "
                "or move a base in scene.toml"
            )
    return disagreement(
        code,
        f"{a}, {b}",
        f"{a} and {b} {what}: minimum clearance",
        mm(least),
        mm(clearance),
        way_out,
        when=f"t = {t[k]:.1f} s",
        word="required",
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
            disagreement(
                "scene.port",
                a.place.name,
                f"{a.place.name}{through} misses its port '{a.place.ports[trocar]}'",
                mm(missed),
                mm(PORT_TOLERANCE),
                "move its base by (" + ", ".join(f"{x / MM:.2f}" for x in shift) + ") mm",
                word="tolerance",
            )
        )
    return out
