"""A World in which the instruments of a scene perform a procedure on its organs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence

import numpy as np

from twin.simulation import operating_scene
from twin.simulation.console_scene import start
from twin.simulation.controllers.pose_to_joints import PoseToJoints
from twin.simulation.controllers.tip_target import TipTarget
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.setup import Setup
from twin.simulation.world import Block, Placed, World

TICK = 4e-3
"""Duration of a tick in s; the organs are stepped in every second tick."""


def world(setup: Setup, device: Block, records: bool = True, watch: Sequence[Block] = ()) -> World:
    """Return a World in which a device moves the tips of the robots of a procedure through their ports.

    Args:
        setup: a scene with organs, its robots, and a task with a procedure.
        device: block that writes `<robot>.target` of each robot, and, for robots with tools, the signals that
            `Operating` reads.
        records: whether every tick is recorded; see `World`.
        watch: blocks without outputs that read all signals at the end of a tick.

    Raises:
        TwinError: the task is not a procedure, a robot has no link in `touching` of [anatomy], or an organ is missing.
        WorldError: a link is inside an organ at the start.
    """
    q_start = {}
    robots = []
    controllers: list[Block] = []
    plants: list[Block] = []
    for place in operating_scene.robots_of(setup):
        name = place.name
        member = setup.members[name]
        limits = JointLimits.of(member.mechanism)
        q = start(place, member.mechanism)
        q_start[name] = q
        T_world_tool = place.T_world_base @ member.kin.forward(q)
        port = operating_scene.port_of(place)
        robots.append(Placed(name, operating_scene.bound(place, member.mechanism), place.T_world_base))
        controllers.append(TipTarget(name, place.T_world_base, port, T_world_tool))
        controllers.append(PoseToJoints(name, member.kin, q, limits))
        plants.append(Kinematic(name, q, limits))
    operated = operating_scene.field(setup, q_start)
    return World(
        robots=robots,
        deformables=operated.deformables,
        objects=operated.objects,
        devices=[device],
        controllers=controllers,
        plants=[*plants, operated.plant, *watch],
        dt=TICK,
        records=records,
    )


def identity(setup: Setup) -> str:
    """Return the hash "sha256:..." of inputs of `world`: robots, organs, vessels, tools and the procedure.

    Of a robot, names, base, start, port, limits and named frames are included; its equations, joint frames and shapes
    are not. Of an organ, nodes, count of vertices and material are included; its elements and the places of its
    vertices are not. Nor is the version of the program. Numbers are rounded to 1e-9, so that the hash does not depend
    on the processor.
    """
    plain = operating_scene.plain
    about: list[object] = [setup.scene.name, *operating_scene.about(setup)]
    for place in operating_scene.robots_of(setup):
        mechanism = setup.members[place.name].mechanism
        about.append([place.name, place.robot, plain(place.T_world_base), plain(start(place, mechanism))])
        # JSON has no infinite numbers: a joint without a limit has the largest ones
        about.append([plain(operating_scene.port_of(place)), plain(np.nan_to_num(mechanism.limits))])
        about.append([[frame.name, frame.body, plain(frame.T_body_frame)] for frame in mechanism.frames])
    return "sha256:" + hashlib.sha256(json.dumps(about).encode()).hexdigest()
