"""A World in which the instruments of a scene perform a procedure on its organs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.mechanism import Mechanism
from twin.model.procedure import ProcedureTable
from twin.model.scene import Place, Scene, Task
from twin.model.tissue import Tissue
from twin.simulation import tissue_scene
from twin.simulation.console_scene import Member, start
from twin.simulation.controllers.reaching import PoseToJoints
from twin.simulation.controllers.tip_target import TipTarget
from twin.simulation.limits import Limits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.plants.tissue import Instrument, Links, Operating, Sight, clips_of
from twin.simulation.world import Block, Placed, World

TICK = 4e-3
"""Duration of a tick in s; organs step every second tick."""

_TIP = "instrument_tip"
"""Name of the frame at the tip of an instrument, z out of it."""


def procedure_of(scene: Scene, task: Task) -> ProcedureTable:
    """Return the procedure of a task.

    Raises:
        TwinError: the task is another one.
    """
    if task.procedure is None:
        raise TwinError(f"{scene.name}: task '{task.name}' is no procedure; it is performed at a console")
    return task.procedure


def port_of(place: Place) -> Array:
    """Return the port (3,) of a robot's only trocar in the World in m."""
    return next(iter(place.p_world_ports.values()))


def bound(place: Place, mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with its trocar in its port."""
    if not mechanism.trocars:
        return mechanism
    T = place.T_world_base
    return mechanism.with_trocar((port_of(place) - T[:3, 3]) @ T[:3, :3])


def robots_of(scene: Scene, procedure: ProcedureTable) -> list[Place]:
    """Return the robots of a procedure: those with a tool, then the robot of the camera."""
    places = {p.name: p for p in scene.places}
    camera = scene.cameras[procedure.camera].robot
    return [places[n] for n in (*(n for n in procedure.start if n != camera), camera)]


def world(
    scene: Scene,
    members: Mapping[str, Member],
    task: Task,
    drawn: Mechanism | None,
    device: Block,
    records: bool = True,
    watch: Sequence[Block] = (),
) -> World:
    """Return a World in which a device leads the tips of the robots of a procedure through their ports.

    Args:
        scene: a scene with organs.
        members: robots by the names of their places.
        task: a task with a procedure.
        drawn: mechanism whose bodies are the organs.
        device: block that writes `<robot>.target` of each robot, and what `Operating` reads of those with tools.
        records: whether every tick is recorded; see `World`.
        watch: blocks without outputs that read all signals at the end of a tick.

    Raises:
        TwinError: the task is no procedure, a robot is not among those that touch organs, or an organ cannot be built.
        WorldError: a link is inside an organ at the start.
    """
    procedure = procedure_of(scene, task)
    places = robots_of(scene, procedure)
    if len(places) != len(procedure.start) + 1:
        raise TwinError(f"{scene.file}: task '{task.name}': the robot of the camera cannot carry a tool")
    touching = tissue_scene.touching(scene)
    q, limits, plants, controllers = {}, {}, list[Block](), list[Block]()
    links: dict[str, Links] = {}
    for place in places:
        name, member = place.name, members[place.name]
        q[name], limits[name] = start(place, member.mechanism), Limits.of(member.mechanism)
        if name not in touching:
            raise TwinError(f"{scene.file}: task '{task.name}': '{name}' has no link in `touching` of [anatomy]")
        links[name] = Links(name, bound(place, member.mechanism), place.T_world_base, touching[name], q[name])
        T = place.T_world_base @ member.kin.forward(q[name])
        controllers.append(TipTarget(name, place.T_world_base, port_of(place), T))
        controllers.append(PoseToJoints(name, member.kin, q[name], limits[name]))
        plants.append(Kinematic(name, q[name], limits[name]))
    instruments = [
        Instrument(links[p.name], members[p.name].mechanism.frame(_TIP), port_of(p), procedure.start[p.name])
        for p in places[:-1]
    ]
    camera = scene.cameras[procedure.camera]
    frame, seeing = members[camera.robot].mechanism.frame(camera.frame), links[camera.robot]
    sight = Sight(lambda: seeing.pose(frame.body) @ frame.T_body_frame @ camera.in_frame, camera.view_deg * DEG)
    organs = tissue_scene.tissues(scene, drawn)
    plant = Operating(organs, [*links.values()], instruments, scene.vessels, scene.tools, procedure, sight)
    return World(
        robots=[Placed(p.name, bound(p, members[p.name].mechanism), p.T_world_base) for p in places],
        deformables=[*(t.deformable for t in organs), *(v.deformable for v in scene.vessels)],
        objects=clips_of(scene.tools),
        devices=[device],
        controllers=controllers,
        plants=[*plants, plant, *watch],
        dt=TICK,
        records=records,
    )


def identity(scene: Scene, members: Mapping[str, Member], task: Task, organs: Sequence[Tissue]) -> str:
    """Return the hash "sha256:..." of the inputs of `world`: robots, organs, vessels, tools and the procedure.

    The equations and the version of the program are not included. Numbers are rounded to 1e-9, so that the hash does
    not depend on the processor.
    """

    def plain(x: Any) -> Any:
        return (np.round(np.asarray(x, float), 9) + 0.0).tolist()

    procedure = procedure_of(scene, task)
    camera = scene.cameras[procedure.camera]
    about: list[Any] = [scene.name, procedure.model_dump(), [camera.robot, camera.frame, plain(camera.in_frame)]]
    about.append([camera.view_deg, {n: t.model_dump() for n, t in scene.tools.items()}])
    for place in robots_of(scene, procedure):
        mechanism = members[place.name].mechanism
        about.append([place.name, place.robot, plain(place.T_world_base), plain(start(place, mechanism))])
        about.append([plain(port_of(place)), plain(np.nan_to_num(mechanism.limits)), [*tissue_scene.touching(scene)]])
        about.append([[f.name, f.body, plain(f.T_body_frame)] for f in mechanism.frames])
    about += [
        [t.name, plain(t.nodes), len(t.surface.vertices), t.young, t.poisson, t.damping, t.friction] for t in organs
    ]
    about += [[v.name, plain(v.points), v.organ, plain(v.radius), v.young] for v in scene.vessels]
    return "sha256:" + hashlib.sha256(json.dumps(about).encode()).hexdigest()
