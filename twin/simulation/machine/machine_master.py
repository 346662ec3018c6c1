"""Move the tool of a machine to goal poses by packets with small increments, as the machine's master.

The machine adds the increments to the pose that its tool has when the pedal goes down. Therefore the pedal goes down
first; the increments begin when a state says that the machine is in PEDAL_DN, from its desired joint values. Near a
singularity a joint moves many times as fast as the tool: the master slows down as soon as a joint needs more than a
part of its speed limit. If the machine holds a target as out of reach, or packets get lost, the master waits until the
machine has answered all packets, and begins again from the pose that the machine has.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.core.errors import DescriptionError, KinematicsError
from twin.core.spatial import Array
from twin.simulation.controllers.packet_smoother import PacketSmoother
from twin.simulation.controllers.trainer_states import TrainerLimits
from twin.simulation.machine.itp import ahead, number_of, pack
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import MachineLink
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.settings import NAME
from twin.simulation.machine.state_packets import State

_PEDAL_UP = np.array([0.0, 0, 0, 1, 0, 0, 0, 0, 0])
_PEDAL_DOWN = np.array([0.0, 0, 0, 1, 0, 0, 0, 0, 1])
"""Values (9,) of packets without motion (`itp.FIELDS`), with the pedal up and down."""

_FINAL_PACKETS = 100
"""Number of packets with the pedal up that are sent after a motion; then another master may take the machine."""

_SETTLING_PACKETS = 100
"""Number of packets without motion after which the pose that has been sent is compared with that of the machine."""

_NO_ROTATION = 1e-8
"""Half angle in rad per packet below which a packet counts as one without motion."""

_POSE_TOLERANCE = 5e-6
"""Difference in m or rad of these poses up to which nothing is corrected; the increments are whole micrometres."""

_SPEED_SHARE = 0.7
"""Part of the speed limit of a joint above which the tool becomes slower."""

_SLOWER = 0.97
_FASTER = 1.003
"""Factors of the tool's speed in each packet above and below this part: 20 ms and 0.2 s to half and double."""

_SLOWEST = 0.02
"""Minimum of these factors together: slower, the increments would be rounded to nothing."""


class MachineMaster:
    """Sends the packets of one machine.

    Attributes:
        link: connection to the machine.
        parts: compiled parts of a machine of this robot, for its equations and settings.
    """

    def __init__(self, link: MachineLink, parts: Parts) -> None:
        """Begin without a goal.

        Raises:
            DescriptionError: the machine file does not say how fast the tool may be moved.
        """
        number = parts.settings.number
        if number.tool_speed is None or number.tool_turn is None:
            raise DescriptionError(
                f"{parts.arm.mechanism.name}: {NAME} needs [number.tool_speed] and [number.tool_turn], the largest "
                "speeds of a tool that is moved to goals"
            )
        unused = (0.0, 0.0, 0.0, 0.0, 0.0)
        limits = TrainerLimits(number.tool_speed.value, number.tool_turn.value, *unused)
        self.link = link
        self.parts = parts
        self._limits = limits
        self._smoother = PacketSmoother(limits, number.grasp_step.value, TICK)
        speed_limits = []
        for joint in parts.arm.mechanism.active:
            speed_limits.append(joint.max_speed or np.inf)
        self._largest_steps = _SPEED_SHARE * TICK * np.array(speed_limits)  # (n,) of the joints in a tick, rad or m
        self._auxiliary = np.flatnonzero(parts.kin.auxiliary)[:1]
        self._pace = 1.0  # part of the limits that is used
        self._q_sent: Array | None = None  # joint values that belong to the pose after the last packet
        self._last_pose: Array | None = None  # from which a robot with loops finds the next one
        self._goal: Array | None = None  # T_base_tool
        self._opening_goal: float | None = None  # of the jaws, in rad; None: as it is
        self._has_begun = False  # whether increments are sent
        self._held_before = 0  # targets that the machine had held when the increments began
        self._held_goal: Array | None = None  # on whose way the machine held a target
        self._packets_still = 0  # without motion, since the last one with motion
        self._packets_up = _FINAL_PACKETS  # with the pedal up, since the end of the motion
        self._packets_sent = 0
        self._last_moving_packet = 0  # number of the last packet with motion

    @property
    def leads(self) -> bool:
        """Whether there is a goal."""
        return self._goal is not None

    def lead(self, T_base_tool: Array, jaw: float | None = None) -> None:
        """Press the pedal, and move the tool to a pose (4, 4), and the jaws, if any, to an opening in rad."""
        self._goal = np.array(T_base_tool, float)
        if jaw is not None:
            self._opening_goal = jaw

    def rest(self) -> None:
        """Release the pedal: the machine stops where it is."""
        if self._goal is not None:
            self._packets_up = 0
        self._goal = None
        self._opening_goal = None
        self._has_begun = False
        self._held_goal = None

    @property
    def held(self) -> bool:
        """Whether the machine holds the goal as out of reach; another goal is tried."""
        return self._goal is not None and self._held_goal is not None and np.array_equal(self._goal, self._held_goal)

    def tool(self, q: Array) -> Array:
        """Return the pose (4, 4) of the tool at joint values q (n,) of the machine.

        Raises:
            KinematicsError: no pose belongs to the joint values.
        """
        kin = self.parts.kin
        if not self.parts.arm.mechanism.loops:
            return kin.forward(q)
        if self._last_pose is None:
            self._last_pose = kin.forward(self.parts.home)
        self._last_pose = kin.forward(q, self._last_pose)
        return self._last_pose

    def step(self, ticks: int) -> None:
        """Send the packets of a number of ticks."""
        for _ in range(ticks):
            values = self._values()
            if values is None:
                return
            self._packets_sent += 1
            settings = self.parts.settings
            self.link.send(pack(number_of(self._packets_sent), settings.arm, values, settings.packet_version))

    def _values(self) -> Array | None:
        """Return the values (9,) of the next packet; None: there is nothing to say.

        Without a goal, the pedal is up. With one, the pedal goes down, the increments begin when the machine is in
        PEDAL_DN, and they pause while the machine holds a target.
        """
        if self._goal is None:
            if self._packets_up >= _FINAL_PACKETS:
                return None
            self._packets_up += 1
            return _PEDAL_UP
        state = self.link.state
        if state is None or state.level == Level.INIT:
            self._has_begun = False
            return _PEDAL_UP
        if state.level == Level.E_STOP:
            self.rest()
            return _PEDAL_UP
        if state.level == Level.PEDAL_UP or not state.pedal:
            self._has_begun = False
            return _PEDAL_DOWN
        if not self._has_begun and not self._begin(state):
            return _PEDAL_DOWN
        disagrees = state.held > self._held_before  # the machine has not moved by all increments that were sent
        if disagrees and self._held_goal is None:
            self._held_goal = self._goal.copy()
        if self._packets_still >= _SETTLING_PACKETS:
            self._follow_up(state)
        if disagrees or self.held:
            self._packets_still += 1
            return _PEDAL_DOWN
        self._held_goal = None
        return self._increments(self._goal)

    def _increments(self, goal: Array) -> Array:
        """Return the values (9,) of a packet on the way to a goal (4, 4)."""
        jaw = self._smoother.opening if self._opening_goal is None else self._opening_goal
        values = self._smoother.values(goal, jaw)
        self._keep_pace()
        if values[:3].any() or values[7] or np.abs(values[4:7]).max() > _NO_ROTATION:
            self._last_moving_packet = self._packets_sent + 1
            self._packets_still = 0
        else:
            self._packets_still += 1
        return values

    def _keep_pace(self) -> None:
        """Make the next packets slower if a joint needs more than its share of speed, otherwise faster again."""
        before = self._q_sent
        try:
            self._q_sent = self.parts.kin.inverse(self._smoother.sent, before)
        except KinematicsError:
            self._q_sent = None  # the machine will hold this target
        if self._q_sent is None or before is None:
            return
        moving = ~self.parts.kin.auxiliary
        steps = np.abs(self._q_sent - before)[moving] / self._largest_steps[moving]
        factor = _SLOWER if steps.max() > 1 else _FASTER
        self._pace = min(max(self._pace * factor, _SLOWEST), 1.0)
        speed = self._pace * self._limits.speed
        turn = self._pace * self._limits.turn
        self._smoother.set_limits(replace(self._limits, speed=speed, turn=turn))

    def _begin(self, state: State) -> bool:
        """Begin the increments at the pose of the machine's desired joint values; return whether this is possible."""
        try:
            T = self.tool(state.wanted)
        except KinematicsError:
            return False
        self._smoother.begin(T, float(state.wanted[self._auxiliary].sum()))
        self._has_begun = True
        self._q_sent = None
        self._held_before = state.held
        self._packets_still = 0
        return True

    def _follow_up(self, state: State) -> None:
        """Begin again from the machine's pose if, after all packets, it is not the pose that was sent."""
        if ahead(state.sequence, number_of(self._last_moving_packet)) < 0:
            return
        try:
            T = self.tool(state.wanted)
        except KinematicsError:
            return
        if state.held > self._held_before or np.abs(T - self._smoother.sent).max() > _POSE_TOLERANCE:
            self._begin(state)
