"""A simulated trial: an operator moves a robot to goals in a World, with the measures of a user study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.core.errors import TwinError
from twin.core.progress import Progress
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.planning.phase_path import build
from twin.planning.protocol import Protocol
from twin.simulation.controllers.jacobian_step import Solver, ToolToJoints, pose_error
from twin.simulation.controllers.teleoperation import HandToTool, Teleoperation
from twin.simulation.devices.hand import Goal, ScriptedHand
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.world import Block, Hazard, Recording, World
from twin.simulation.world.signal_kinds import HAND_GOAL, HAND_HANDLE, HAND_PEDAL, ROBOT_Q

INNER = 5
"""Number of joint velocity ticks (1 kHz) per tick of the teleoperation (200 Hz); ASSUMED."""


_NEAR = 0.1e-3
"""Largest distance in m of the tool from the end pose of an insertion at which it counts as reached; ASSUMED."""

_THROUGH = 0.05e-3
"""The same for the other phases, through which the tool only passes; ASSUMED."""


def goals_of(protocol: Protocol, T_tool_tip: Array) -> tuple[Array, list[Goal]]:
    """Return the tool pose (4, 4) at the start of a protocol, and the ends of its phases as goals, in order.

    Args:
        protocol: the protocol.
        T_tool_tip: (4, 4) pose of the protocol's frame in the tool frame.

    Raises:
        TwinError: the protocol has no insertion.
    """
    paths = build(protocol, T_tool_tip)
    goals = []
    insertions = 0
    for path in paths:
        end = path.motion(np.array([1.0])).Ts_base_tool[0]
        inserts = path.phase.type == "insertion"
        insertions += inserts
        goals.append(Goal(path.phase.name, end, _NEAR if inserts else _THROUGH, inserts))
    if not insertions:
        raise TwinError(f"protocol '{protocol.name}' has no insertion, which the trial needs")
    start = paths[0].motion(np.array([0.0])).Ts_base_tool[0]
    return start, goals


@dataclass
class Record:
    """Record of a trial, one row per tick of the teleoperation.

    Attributes:
        t: (k,) times in s.
        handle: (k, n) handle positions in the coordinates of the equations.
        pedal: (k,) bool, whether the pedal is pressed.
        q: (k, n) joint values in m or rad.
        Ts_base_tool: (k, 4, 4) tool poses.
        spans: {goal: (first row, last row)} of each goal that was started.
        missed: name of the goal that the operator gave up, after which the trial ends; "": none was given up.
    """

    t: Array
    handle: Array
    pedal: np.ndarray
    q: Array
    Ts_base_tool: Array
    spans: dict[str, tuple[int, int]] = field(default_factory=dict)
    missed: str = ""


def world(
    kin: Kinematics,
    q: Array,
    limits: JointLimits,
    controller: Teleoperation,
    device: Block,
    solver: Solver = "damped",
    hazards: Sequence[Hazard] = (),
) -> World:
    """Return a World with one robot that is controlled by a simulated or recorded hand.

    Args:
        kin: the robot's equations; their name is the name of the robot.
        q: (n,) joint values at the start.
        limits: limits of the joints.
        controller: the teleoperation; its dt is `INNER` ticks.
        device: block that writes `hand.handle` and `hand.pedal`.
        solver: solver of the joint step.
        hazards: hazards of this World.
    """
    name = kin.formula.name
    controllers = (
        HandToTool(name, "hand", kin, q, controller),
        ToolToJoints(name, kin, q, limits, INNER, solver),
    )
    plants = (Kinematic(name, q, limits),)
    return World(
        devices=(device,),
        controllers=controllers,
        plants=plants,
        hazards=hazards,
        dt=controller.dt / INNER,
    )


def operate(
    kin: Kinematics,
    q: Array,
    limits: JointLimits,
    controller: Teleoperation,
    goals: Sequence[Goal],
    seed: int = 0,
    solver: Solver = "damped",
    progress: Progress | None = None,
) -> Record:
    """Simulate one trial from joint values q (n,) through all goals; return its record.

    Raises:
        KinematicsError: a goal pose cannot be expressed in the robot's coordinates.
    """
    device = ScriptedHand(kin.formula.name, kin, goals, controller.gains.scale, controller.dt, seed, progress)
    recording = world(kin, np.asarray(q, float), limits, controller, device, solver).run()
    if progress is not None:
        progress("measure", 1.0)
    return record_of(recording, kin, goals, device.missed)


def record_of(recording: Recording, kin: Kinematics, goals: Sequence[Goal], missed: str = "") -> Record:
    """Convert a recording of a World from `world` to a `Record`; each row is the last tick of a teleoperation tick."""
    last_ticks = slice(INNER - 1, None, INNER)
    goal = recording[HAND_GOAL.name][last_ticks, 0]
    joints = recording[ROBOT_Q.of(kin.formula.name)][last_ticks]
    # Each pose is the start of the search for the next one.
    poses: list[Array] = []
    pose: Array | None = None
    for q in joints:
        pose = kin.forward(q, pose)
        poses.append(pose)
    spans = {}
    for number, target in enumerate(goals):
        rows = np.flatnonzero(goal == number)
        if len(rows):
            spans[target.name] = (int(rows[0]), int(rows[-1]))
    return Record(
        t=np.arange(len(goal), dtype=float) * (INNER * recording.dt),
        handle=recording[HAND_HANDLE.name][last_ticks],
        pedal=recording[HAND_PEDAL.name][last_ticks, 0] > 0.5,
        q=joints,
        Ts_base_tool=np.array(poses),
        spans=spans,
        missed=missed,
    )


@dataclass(frozen=True)
class Measures:
    """Measures of one trial, as in the SHER 3.0 simulation paper.

    Attributes:
        time: time in s from the first press of the pedal to the end.
        presses: number of presses of the pedal.
        path: length in m of the tip's path, including tremor.
        contacts: for each insertion, whether the tip touched: its distance from the axis, and its distance from the
            end along the axis, were both at most `contact` (see `measure`); a tip beyond the end counts as well.
        nearest: for each insertion, minimum distance in m of the tip from the end.
        aside: for each insertion, maximum distance in m of the tip from the axis.
    """

    time: float
    presses: int
    path: float
    contacts: dict[str, bool]
    nearest: dict[str, float]
    aside: dict[str, float]

    @property
    def success(self) -> bool:
        """Whether the tip touched in every insertion."""
        return bool(self.contacts) and all(self.contacts.values())


def measure(
    record: Record, goals: Sequence[Goal], T_tool_tip: Array, shaft: Array, contact: float = 0.5e-3
) -> Measures:
    """Return the measures of a record.

    Args:
        record: record of the trial.
        goals: the goals.
        T_tool_tip: (4, 4) pose of the tip in the tool frame.
        shaft: (3,) unit vector along the shaft, out of the tip, in the tip frame.
        contact: maximum distance in m at which the tip counts as touching, see `Measures.contacts`; ASSUMED: 0.5 mm,
            for a goal like a hole of 1 mm diameter with a foil behind it.
    """
    tip = (record.Ts_base_tool @ T_tool_tip)[:, :3, 3]
    # with a released pedal before the first row, so that a pedal that is down from the start counts as pressed
    pedal = np.concatenate([[False], record.pedal]).astype(int)
    pressed = np.flatnonzero(np.diff(pedal) == 1)
    contacts: dict[str, bool] = {}
    nearest: dict[str, float] = {}
    aside: dict[str, float] = {}
    for goal in goals:
        if not goal.inserts:
            continue
        if goal.name not in record.spans:  # the trial ended before this goal
            contacts[goal.name] = False
            continue
        first, last = record.spans[goal.name]
        T_base_end = goal.T_base_tool @ T_tool_tip
        offsets = tip[first : last + 1] - T_base_end[:3, 3]
        axis = T_base_end[:3, :3] @ shaft
        along = offsets @ axis
        beside = np.linalg.norm(offsets - along[:, None] * axis, axis=1)
        # without an upper limit of `along`: a tip beyond the end has come through it
        touches = (beside <= contact) & (along >= -contact)
        contacts[goal.name] = bool(touches.any())
        nearest[goal.name] = float(np.linalg.norm(offsets, axis=1).min())
        aside[goal.name] = float(beside.max())
    start = record.t[0]
    if len(pressed):
        start = record.t[pressed[0]]
    path = float(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum())
    return Measures(float(record.t[-1] - start), len(pressed), path, contacts, nearest, aside)


def remaining(record: Record, goals: Sequence[Goal]) -> Array:
    """Return the distance (k,) in m from the tool to its current goal; NaN without a goal."""
    distances = np.full(len(record.t), np.nan)
    for goal in goals:
        first, last = record.spans.get(goal.name, (0, -1))  # an empty range for a goal that was not started
        for k in range(first, last + 1):
            error = pose_error(record.Ts_base_tool[k], goal.T_base_tool)
            distances[k] = np.linalg.norm(error[:3])
    return distances
