"""Mirror a machine: a solid robot at the measured joint values, and a ghost at the desired joint values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from twin.api import Robot
from twin.core.errors import AssemblyError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.kinematics.closed_loops.placing import LinkPoses
from twin.model.trainer import MODEL
from twin.simulation.devices.machine_states import ANSWERS, LEVEL, MachineStates
from twin.simulation.machine.levels import Level
from twin.simulation.machine.state_packets import State
from twin.simulation.world import Block, Placed, Signals, World
from twin.simulation.world.signal_kinds import ROBOT_APART, ROBOT_DESIRED, ROBOT_MEASURED, ROBOT_Q, ROBOT_RUN

_TICK_DURATION = 1 / 60
"""Duration in s of a tick of the World."""

_MAX_JOINT_VALUE = 1e4
"""Largest joint value in rad or m that is shown (ASSUMED); at much larger values no pose can be computed."""


class StateSource(Protocol):
    """Source of the states of a machine: `StateReader` or `JointPackets`."""

    @property
    def newest(self) -> State | None: ...  # noqa: D102
    @property
    def answers(self) -> bool: ...  # noqa: D102
    @property
    def problem(self) -> str: ...  # noqa: D102
    def close(self) -> None: ...  # noqa: D102


class _Shown(Block):
    """Reads `<robot>.measured` and `<robot>.desired`; writes `<robot>.q`, `<robot>_model.q` and `<robot>.apart`."""

    def __init__(self, robot: str, q: Array) -> None:
        self._measured = ROBOT_MEASURED.of(robot)
        self._desired = ROBOT_DESIRED.of(robot)
        self._q = ROBOT_Q.of(robot)
        self._ghost = f"{robot}{MODEL}.q"
        self._difference_signal = ROBOT_APART.of(robot)
        self.outputs = {self._q: q, self._ghost: q, self._difference_signal: np.zeros(len(q))}

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        q = signals.now[self._measured]
        desired = signals.now[self._desired]
        return {self._q: q, self._ghost: desired, self._difference_signal: desired - q}


class Mirror:
    """A World with one robot that follows a machine.

    Attributes:
        robot: the robot.
        name: name, in the World, of the robot at the measured joint values.
        ghost: name, in the World, of the robot at the desired joint values.
        world: the World.
    """

    def __init__(self, robot: Robot, source: StateSource) -> None:
        """Start in the posture home."""
        self.robot = robot
        self._source = source
        self._shape_problem = ""
        self.name = robot.name
        self.ghost = robot.name + MODEL
        q = np.array(robot.mechanism.posture("home"), float)
        self._states = MachineStates(self.name, q)
        self._links = LinkPoses(robot.loops)
        self.world = World(
            robots=[Placed(n, robot.mechanism, np.eye(4), self._links) for n in (self.name, self.ghost)],
            devices=[self._states],
            plants=[_Shown(self.name, q)],
            dt=_TICK_DURATION,
            records=False,
        )
        tool = robot.mechanism.frame(robot.mechanism.tool)
        self._tool = (tool.body, tool.T_body_frame)
        self.links = self.world.link_poses()

    def step(self) -> None:
        """Move the robot to the measured joints of the machine's newest state, and the ghost to the desired joints.

        If the machine does not answer, or its joint values are impossible, robot and ghost do not move, and `problem`
        is the reason.
        """
        state = self._source.newest
        if not self._source.answers:
            state = None
        self._shape_problem = ""
        if state is not None:
            largest = float(np.abs([state.q, state.wanted]).max())
            if largest > _MAX_JOINT_VALUE:
                self._shape_problem = (
                    f"a joint value of the machine is {largest:g} rad or m (limit {_MAX_JOINT_VALUE:g}): check its unit"
                )
                state = None
        self._states.give(state)
        self.world.step()
        try:
            self.links = self.world.link_poses()
        except AssemblyError as error:
            self._shape_problem = f"{error}: check order and units of the machine's joints"

    @property
    def deviation(self) -> JsonObject:
        """Distance in m between the tips of robot and ghost ("tip"), and desired minus measured q (n,) ("joints")."""
        body, T = self._tool
        tips = [(self.links[n][body] @ T)[:3, 3] for n in (self.name, self.ghost)]
        return {
            "tip": float(np.linalg.norm(tips[1] - tips[0])),
            "joints": self.world.signals[ROBOT_APART.of(self.name)],
        }

    @property
    def level(self) -> str | None:
        """Run level of the machine; None: the machine does not answer."""
        run = self.world.signals[ROBOT_RUN.of(self.name)]
        if run[ANSWERS] <= 0.5:
            return None
        return Level(int(run[LEVEL])).name

    @property
    def problem(self) -> str:
        """Reason why the robot does not follow the machine; "" while the robot follows."""
        problem = self._shape_problem or self._source.problem
        if problem:
            return problem
        if self.level is None:
            return "no state of the machine arrives: start the machine"
        return ""

    def close(self) -> None:
        """End the connection."""
        self._source.close()
