"""A World in which the instruments of a scene perform a procedure on its organs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.simulation import operating_scene
from twin.simulation.console_scene import start
from twin.simulation.controllers.reaching import PoseToJoints
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
    places = operating_scene.robots_of(setup)
    members, q, limits, plants, controllers = setup.members, {}, {}, list[Block](), list[Block]()
    for place in places:
        name, member = place.name, members[place.name]
        q[name], limits[name] = start(place, member.mechanism), JointLimits.of(member.mechanism)
        T = place.T_world_base @ member.kin.forward(q[name])
        controllers.append(TipTarget(name, place.T_world_base, operating_scene.port_of(place), T))
        controllers.append(PoseToJoints(name, member.kin, q[name], limits[name]))
        plants.append(Kinematic(name, q[name], limits[name]))
    operated = operating_scene.field(setup, q)
    return World(
        robots=[Placed(p.name, operating_scene.bound(p, members[p.name].mechanism), p.T_world_base) for p in places],
        deformables=operated.deformables,
        objects=operated.objects,
        devices=[device],
        controllers=controllers,
        plants=[*plants, operated.plant, *watch],
        dt=TICK,
        records=records,
    )


def identity(setup: Setup) -> str:
    """Return the hash "sha256:..." of the inputs of `world`: robots, organs, vessels, tools and the procedure.

    The equations and the version of the program are not included. Numbers are rounded to 1e-9, so that the hash does
    not depend on the processor.
    """
    plain = operating_scene.plain
    about: list[Any] = [setup.scene.name, *operating_scene.about(setup)]
    for place in operating_scene.robots_of(setup):
        mechanism = setup.members[place.name].mechanism
        about.append([place.name, place.robot, plain(place.T_world_base), plain(start(place, mechanism))])
        about.append([plain(operating_scene.port_of(place)), plain(np.nan_to_num(mechanism.limits))])
        about.append([[f.name, f.body, plain(f.T_body_frame)] for f in mechanism.frames])
    return "sha256:" + hashlib.sha256(json.dumps(about).encode()).hexdigest()
