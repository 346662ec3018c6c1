"""The plant of a procedure: organs, vessels and tools of a scene, independent of the device that moves the robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.deformable import Deformable
from twin.model.mechanism import Mechanism
from twin.model.movable import Movable
from twin.model.scene import Place, Scene
from twin.model.task import ConsoleTask, goal_of
from twin.model.tissue import Tissue
from twin.simulation import tissue_scene
from twin.simulation.plants.tissue import Links, Operating, OperatingRobot, Sight, clips_of
from twin.simulation.plants.tissue.organs import PERIOD
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.task import ProcedureTable

_TIP = "instrument_tip"
"""Name of the frame at the tip of an instrument, z out of it."""

_LAST = {"provenance", "note"}
"""Fields of a tool that are hashed after all its other fields."""


@dataclass(frozen=True)
class OperatingField:
    """The operating field: a plant that simulates organs and tools; the deformables and objects moved by the plant."""

    plant: Operating
    deformables: Sequence[Deformable]
    objects: Sequence[Movable]


def procedure_of(scene: Scene, task: ConsoleTask | None) -> ProcedureTable:
    """Return the procedure of a task.

    Raises:
        TwinError: the task is not a procedure, or there is no task.
    """
    procedure = goal_of(task, ProcedureTable)
    if procedure is None:
        named = "there is no task" if task is None else f"task '{task.name}' is not a procedure"
        raise TwinError(f"{scene.name}: {named}; choose a task that has a section [task.NAME.procedure]")
    return procedure


def port_of(place: Place) -> Array:
    """Return the position (3,) of the port of a robot that has only one trocar, in m in the World."""
    return next(iter(place.p_world_ports.values()))


def bound(place: Place, mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with its trocar at the port of `place`; without a trocar, the mechanism is unchanged."""
    if not mechanism.trocars:
        return mechanism
    T = place.T_world_base
    return mechanism.with_trocar((port_of(place) - T[:3, 3]) @ T[:3, :3])


def robots_of(setup: Setup) -> list[Place]:
    """Return the robots of a procedure: those with a tool, then the robot of the camera.

    Raises:
        TwinError: the task is not a procedure, or there is no task.
    """
    procedure = procedure_of(setup.scene, setup.task)
    camera_robot = setup.scene.cameras[procedure.camera].robot
    robots = []
    for name in procedure.start:
        if name != camera_robot:
            robots.append(setup.places[name])
    robots.append(setup.places[camera_robot])
    return robots


def organ_of(setup: Setup) -> Tissue:
    """Return the organ that the procedure removes.

    Raises:
        TwinError: the task is not a procedure, or its organ is missing.
    """
    procedure = procedure_of(setup.scene, setup.task)
    for organ in setup.organs:
        if organ.name == procedure.organ:
            return organ
    raise TwinError(f"the procedure needs the organ '{procedure.organ}': give the organs of the scene")


def field(setup: Setup, q: Mapping[str, Array], period: float = PERIOD) -> OperatingField:
    """Return the operating field of a procedure.

    Args:
        setup: a scene with organs, its robots, and a task with a procedure.
        q: (n,) joint values of each robot at the start.
        period: time in s between two steps of the organs.

    Raises:
        TwinError: the task is not a procedure, a robot has no link in `touching` of [anatomy], or an organ is missing.
        WorldError: a link is inside an organ at the start.
    """
    scene = setup.scene
    procedure = procedure_of(scene, setup.task)
    places = robots_of(setup)
    if len(places) != len(procedure.start) + 1:
        raise TwinError(f"{setup.label}: the robot of the camera cannot carry a tool")
    organ_of(setup)  # raises an error if the organ is missing
    touching = tissue_scene.touching(scene)
    links: dict[str, Links] = {}
    for place in places:
        name = place.name
        if name not in touching:
            raise TwinError(f"{setup.label}: '{name}' has no link in `touching` of [anatomy]")
        mechanism = bound(place, setup.members[name].mechanism)
        links[name] = Links(name, mechanism, place.T_world_base, touching[name], q[name])
    instruments = []
    for place in places[:-1]:  # the last one has the camera
        tip = setup.members[place.name].mechanism.frame(_TIP)
        first_tool = procedure.start[place.name]
        instruments.append(OperatingRobot(links[place.name], tip, port_of(place), first_tool))
    camera = scene.cameras[procedure.camera]
    camera_frame = setup.members[camera.robot].mechanism.frame(camera.frame)
    camera_links = links[camera.robot]

    def camera_pose() -> Array:
        return camera_links.pose(camera_frame.body) @ camera_frame.T_body_frame @ camera.in_frame

    sight = Sight(camera_pose, camera.view_deg * DEG)
    plant = Operating(
        setup.organs, [*links.values()], instruments, scene.vessels, scene.tools, procedure, sight, period
    )
    deformables = []
    for tissue in (*setup.organs, *scene.vessels):
        deformables.append(tissue.deformable)
    return OperatingField(plant, deformables, clips_of(scene.tools))


def about(setup: Setup) -> list[object]:
    """Return the inputs of `field` except the robots, as plain data for a hash."""
    scene = setup.scene
    procedure = procedure_of(scene, setup.task)
    camera = scene.cameras[procedure.camera]
    inputs: list[object] = [procedure.model_dump()]
    inputs.append([camera.robot, camera.frame, plain(camera.in_frame), camera.view_deg])
    tools = {}
    for name, tool in scene.tools.items():
        tools[name] = tool.model_dump(exclude=_LAST) | tool.model_dump(include=_LAST)
    inputs.append([tools, tissue_scene.touching(scene)])
    for organ in setup.organs:
        nodes = plain(organ.nodes)
        vertices = len(organ.surface.vertices)
        inputs.append([organ.name, nodes, vertices, organ.young, organ.poisson, organ.damping, organ.friction])
    for vessel in scene.vessels:
        inputs.append([vessel.name, plain(vessel.points), vessel.organ, plain(vessel.radius), vessel.young])
    return inputs


def plain(numbers: ArrayLike) -> object:
    """Return a number, or an array as lists, rounded to 1e-9, so that a hash does not depend on the processor."""
    rounded = np.round(np.asarray(numbers, float), 9)
    return (rounded + 0.0).tolist()  # -0.0 becomes 0.0
