"""Play the protocols of all robots of a scene in a World; measure clearances and deviations from ports.

The results are the minimum clearance of each pair of robots, and the distance of each robot's RCM or trocars from its
ports.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.quantity import mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.model.scene import Place, Scene
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, between
from twin.simulation.controllers.protocol_player import ProtocolPlayer
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.plants.tissue import Tissues
from twin.simulation.scene_stage import write_scene
from twin.simulation.world import Block, Placed, World
from twin.simulation.world.signal_kinds import ROBOT_Q

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
        for (first, second), clearance in self.by_pair.items():
            k = int(np.argmin(clearance.distance))
            pairs[f"{first}-{second}"] = {
                "least_mm": clearance.distance[k] / MM,
                "between": list(clearance.pair[k]),
                "t_s": float(self.t[k]),
            }
        robots = []
        for actor in self.actors:
            robots.append(
                {
                    "name": actor.place.name,
                    "protocol": actor.place.protocol_name,
                    "port": actor.place.port,
                    "duration_s": actor.trajectory.duration,
                }
            )
        parameters = []
        for parameter in self.scene.parameters:
            parameters.append(
                {
                    "name": parameter.name,
                    "value": parameter.shown,
                    "unit": parameter.unit,
                    "provenance": parameter.provenance,
                }
            )
        return {
            "scene": self.scene.name,
            "robots": robots,
            "clearance_mm": self.scene.clearance / MM,
            "pairs": pairs,
            "parameters": parameters,
        }

    def text(self) -> Iterator[Part]:
        """Yield a line per robot, the minimum clearance per pair, and the findings."""
        yield f"{self.scene.name} · {self.scene.title}\n"
        rows = []
        for actor in self.actors:
            place = actor.place
            rows.append((place.name, place.protocol_name, place.port, f"{actor.trajectory.duration:.1f} s"))
        yield TextTable(("robot", "protocol", "port", "duration"), rows)
        yield ""
        least = np.inf
        lines = []
        for (first, second), clearance in self.by_pair.items():
            k = int(np.argmin(clearance.distance))
            distance = clearance.distance[k]
            least = min(least, float(distance))
            # without the owners, which the first column has
            bodies = []
            for name in clearance.pair[k]:
                bodies.append(name.split("/")[1])
            where = " - ".join(bodies)
            lines.append((f"{first} - {second}", f"{distance / MM:.1f} mm", where, f"t = {self.t[k]:.1f} s"))
        yield TextTable(("pair", "minimum clearance", "between", ""), lines)
        yield ""
        yield from by_severity(self.findings)
        if self.by_pair and not self.findings:
            yield f"  no collision: minimum clearance {least / MM:.1f} mm (required {self.scene.clearance / MM:g} mm)"

    def write(self, folder: Path) -> None:
        """Write scene.csv (clearance of each pair over time) and usd/ (one stage with all robots in motion).

        Raises:
            TwinError: a robot has no stage with its baked motion.
        """
        head = ["t_s"]
        columns = [self.t]
        for (first, second), clearance in self.by_pair.items():
            head.append(f"{first}_{second}_mm")
            columns.append(clearance.distance / MM)
        # comments="": without it, numpy writes "# " before the head
        np.savetxt(folder / "scene.csv", np.column_stack(columns), "%.6g", ",", header=",".join(head), comments="")
        stages = {}
        for place in self.scene.places:
            source = assets.files(place.robot).usd
            motion = f"{place.robot}_{place.protocol}.usda"
            if not (source / motion).is_file():
                raise TwinError(f"{place.name} has no stage with this motion: run `twin build {place.robot}`")
            shutil.copytree(source, folder / "usd" / place.name)
            stages[place.name] = Path("..") / place.name / motion
        mechanisms = {actor.place.name: actor.mechanism for actor in self.actors}
        write_scene(self.scene, folder / "usd" / self.scene.name, stages, mechanisms, self.props, self.duration)


def _duration(actors: Sequence[Actor]) -> float:
    return max(actor.trajectory.duration for actor in actors)


def trocars_of(place: Place, mechanism: Mechanism, trajectory: Trajectory) -> dict[str, Array]:
    """Return {trocar: position (3,) in m in the robot's base}.

    The result for a robot without trocars is the first RCM of its motion, with the name "".

    Raises:
        TwinError: a trocar has no port, a port is for a trocar that does not exist, or the motion has no RCM.
    """
    if not mechanism.trocars:
        return {"": _first_rcm(place, trajectory)}
    positions = {}
    for name in place.ports:
        positions[name] = mechanism.trocar_at(name)
    lacking = []
    for name in mechanism.trocars:
        # the key `port` of a scene, which is the name "", is for the only trocar
        if "" not in positions and name not in positions:
            lacking.append(name)
    if lacking:
        raise TwinError(f"{place.name}: `ports` has no entry for trocar {', '.join(lacking)}")
    return positions


def _first_rcm(place: Place, trajectory: Trajectory) -> Array:
    """Return the first RCM (3,) of a motion in m in the robot's base; raise `TwinError` if a trocar has a port."""
    for phase in trajectory.phases:
        if phase.rcm is not None:
            break
    else:
        raise TwinError(f"{place.name}: protocol '{place.protocol_name}' has no RCM; a robot at a port needs one")
    for name in place.ports:
        if name:
            raise TwinError(f"{place.name} has no trocar '{name}': use the key `port`, not `ports`")
    return phase.rcm


def world(
    actors: Sequence[Actor], props: Mechanism | None = None, dt: float = 1e-3, organs: Tissues | None = None
) -> World:
    """Return a World in which every robot plays its protocol from t = 0 and then remains at rest."""
    robots = []
    controllers = []
    plants: list[Block] = []
    for actor in actors:
        name = actor.place.name
        robots.append(Placed(name, actor.mechanism, actor.place.T_world_base))
        controllers.append(ProtocolPlayer(name, actor.trajectory))
        plants.append(Kinematic(name, actor.trajectory.q[0], JointLimits.of(actor.mechanism)))
    placed_props = []
    if props is not None:
        placed_props.append(Placed(props.name, props))
    deformables = []
    if organs is not None:
        # after the plants that move the robots
        plants.append(organs)
        for tissue in organs.organs.tissues:
            deformables.append(tissue.deformable)
    return World(
        robots=robots, props=placed_props, deformables=deformables, controllers=controllers, plants=plants, dt=dt
    )


def play(
    scene: Scene,
    actors: Sequence[Actor],
    props: Mechanism | None,
    progress: Progress = silent,
) -> Played:
    """Play the protocols until the last robot has ended its motion; check clearances and distances from ports."""
    duration = _duration(actors)
    # whole ticks, so that the last one begins at the end of the motion
    ticks = max(int(duration * RATE), 1)
    moving = world(actors, props, duration / ticks)
    moving.step(ticks + 1)  # with the sample at the start
    recording = moving.recording()
    t = recording.t
    mechanisms: dict[str, Mechanism] = {}
    poses: dict[str, dict[str, Array]] = {}
    findings = []
    parts = len(actors) + 2
    for i, actor in enumerate(actors):
        name = actor.place.name
        progress(f"move {name}", i / parts)
        mechanisms[name] = actor.mechanism
        model = ReferenceModel(actor.mechanism)
        run = model.run(recording[ROBOT_Q.of(name)])
        poses[name] = {}
        for link, Ts in model.link_poses(run.x).items():
            poses[name][link] = actor.place.T_world_base @ Ts
        findings += _port(actor)
    if props is not None:
        mechanisms[props.name] = props
        poses[props.name] = {}
        for link, T in ReferenceModel(props).home().link_poses.items():
            poses[props.name][link] = np.broadcast_to(T, (len(t), 4, 4))
    progress("distances between the robots", len(actors) / parts)
    by_pair = between(mechanisms, poses, scene.touching)
    for clearance in by_pair.values():
        k = int(np.argmin(clearance.distance))
        if clearance.distance[k] < scene.clearance:
            findings.append(too_near(clearance, k, t, scene.clearance))
    return Played(scene, actors, props, t, by_pair, tuple(findings))


def too_near(measured: Clearance, k: int, t: Array, clearance: float) -> Finding:
    """Return a finding on the nearest bodies at sample k; if bodies overlap at the start, on these instead."""
    way_out = "move a base in scene.toml, or change a protocol"
    if measured.distance[0] <= 0:
        k = 0
        what = "overlap at the start"
        code = "scene.start"
        way_out = f"their distance is below {mm(clearance)} throughout both protocols: move a base in scene.toml"
        free = np.flatnonzero(measured.distance >= clearance)
        if len(free):
            way_out = (
                f"start the protocols from their poses at t = {t[free[0]]:.1f} s, the first time with a clearance of "
                f"{mm(clearance)}, "
                "or move a base in scene.toml"
            )
    elif measured.distance[k] <= 0:
        what = "collide"
        code = "scene.collision"
    else:
        what = "come too close"
        code = "scene.near"
    first, second = measured.pair[k]
    return disagreement(
        code,
        f"{first}, {second}",
        f"{first} and {second} {what}: minimum clearance",
        mm(float(measured.distance[k])),
        mm(clearance),
        way_out,
        when=f"t = {t[k]:.1f} s",
        word="required",
    )


def _port(actor: Actor) -> list[Finding]:
    """Return a finding for each trocar, or RCM, that is not at its port."""
    place = actor.place
    findings = []
    for trocar, p_world_port in place.p_world_ports.items():
        p_world_trocar = (place.T_world_base @ np.append(actor.trocars[trocar], 1.0))[:3]
        shift = p_world_port - p_world_trocar
        distance = float(np.linalg.norm(shift))
        if distance <= PORT_TOLERANCE:
            continue
        name = place.name
        if trocar:
            name = f"{name} with trocar '{trocar}'"
        shift_mm = ", ".join(f"{x / MM:.2f}" for x in shift)
        findings.append(
            disagreement(
                "scene.port",
                place.name,
                f"{name} misses its port '{place.ports[trocar]}'",
                mm(distance),
                mm(PORT_TOLERANCE),
                f"move its base by ({shift_mm}) mm",
                word="tolerance",
            )
        )
    return findings
