"""The holes of a task in the World, and the goals of its simulated operator, from the protocol that the task names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core import assets
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.model.task import ConsoleTask, required_goal
from twin.planning.protocol import Protocol, load_protocol
from twin.simulation.devices.hand import Goal
from twin.simulation.setup import Setup
from twin.simulation.tasks.holes.task import HolesTable
from twin.simulation.trial import goals_of


@dataclass(frozen=True)
class Hole:
    """A hole in the World: its name, bottom (3,) in m, axis (3,) as a unit vector inwards, and a point before it.

    `before` (3,) in m is where the tip begins the insertion, on the axis and outside of the hole.
    """

    name: str
    bottom: Array
    before: Array
    axis: Array


@dataclass(frozen=True)
class HoleGoals:
    """What a task with holes requires of its robot.

    Attributes:
        robot: name of the robot in the scene.
        T_tool_tip: (4, 4) pose of the tip in the tool frame.
        start: (n,) joint values at the start of the protocol.
        goals: ends of the phases of the protocol, in order.
        holes: the holes, in order.
        contact: largest distance in m of the tip from axis and bottom of a touched hole.
    """

    robot: str
    T_tool_tip: Array
    start: Array
    goals: Sequence[Goal]
    holes: Sequence[Hole]
    contact: float


def hole_goals(setup: Setup, task: ConsoleTask) -> HoleGoals:
    """Return the holes of a task, from the protocol of its robot.

    Raises:
        TwinError: there is no such protocol, or the protocol has no insertion.
    """
    table = required_goal(task, HolesTable)
    place = setup.places[table.robot]
    member = setup.members[table.robot]
    protocol = _protocol(setup, table, place.robot)
    T_tool_tip = member.mechanism.frame_in_tool(protocol.frame)
    start_pose, goals = goals_of(protocol, T_tool_tip)
    shaft = np.asarray(protocol.shaft_axis, float)
    holes = []
    T_base_tool = start_pose  # at the start of the phase
    for goal in goals:
        if goal.inserts:
            T_world_before = place.T_world_base @ T_base_tool @ T_tool_tip
            T_world_end = place.T_world_base @ goal.T_base_tool @ T_tool_tip
            name = f"hole{len(holes) + 1}"
            holes.append(Hole(name, T_world_end[:3, 3], T_world_before[:3, 3], T_world_end[:3, :3] @ shaft))
        T_base_tool = goal.T_base_tool
    return HoleGoals(table.robot, T_tool_tip, member.kin.inverse(start_pose), goals, holes, table.contact)


def _protocol(setup: Setup, table: HolesTable, robot: str) -> Protocol:
    files = assets.files(robot)
    path = files.protocol(table.protocol)
    protocol = load_protocol(path, files.read)
    if protocol.robot != files.name:
        raise TwinError(
            f"{setup.label}: protocol '{table.protocol}' is written for '{protocol.robot}', not for '{files.name}'"
        )
    return protocol
