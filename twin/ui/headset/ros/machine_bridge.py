"""A process beside a machine that serves it to ROS clients: rosbridge on one side, the machine's packets on the other.

The process is the machine's master, as any other program may be; the ticks of the machine do not wait for it. Topics
have the names of CRTK: `twin machine ROBOT --ros`; poses of the tool are in the robot's base.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import numpy as np

from twin.api.machine import machine_parts
from twin.api.robot_loading import load
from twin.core.errors import DeviceError, TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.exchange.formats.mcap import ros_messages as ros
from twin.simulation.devices.packets import grip_angle, handle_pose
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import Address, MachineLink
from twin.simulation.machine.machine_master import MachineMaster
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.state_packets import State
from twin.ui.access.rules import AccessRules
from twin.ui.headset.ros.bridge import RosBridge
from twin.ui.headset.ros.operations import JointState, PoseStamped, StateCommand, checked_message
from twin.ui.headset.ros.topic_table import InputTopic, OutputTopic, TopicTable

ROUND_RATE = 250.0
"""Rounds per second; each sends the packets of its ticks and the newest messages."""


def run(line: Connection, robot: str, address: Address, host: str, port: int, url: str) -> None:
    """Serve a machine until the parent process closes the connection.

    Lines of text for the terminal are sent to the parent as ("said", text): the address of the server, once it listens,
    and the address with a new token for each client if clients need one. ("failed", reason): the server cannot listen.

    Args:
        line: connection to the parent process.
        robot: name or folder of the machine's robot.
        address: where the machine runs.
        host: host name or address on which the server listens.
        port: port on which the server listens.
        url: address of the server for clients.
    """
    try:
        asyncio.run(_serve(line, robot, address, host, port, url))
    except (TwinError, OSError) as error:
        line.send(("failed", str(error)))


async def _serve(line: Connection, robot: str, address: Address, host: str, port: int, url: str) -> None:
    loaded = load(robot)
    parts = machine_parts(loaded)
    link = MachineLink(address, len(parts.home))
    try:
        topics = MachineTopics(loaded.name, MachineMaster(link, parts))

        def announce(token: str) -> None:
            line.send(("said", f"rosbridge for the next ROS client, once: {url}/?token={token}"))

        rules = AccessRules(host, port, False, announce)
        bridge = RosBridge(topics, rules)
        await bridge.start(host, port)
        try:
            if not rules.needs_token:
                line.send(("said", f"rosbridge for ROS clients: {url}"))
            await _rounds(line, topics, bridge)
        finally:
            await bridge.close()
    finally:
        link.close()


async def _rounds(line: Connection, topics: MachineTopics, bridge: RosBridge) -> None:
    """Pass messages between the clients and the machine, until the parent process has closed its end or ended."""
    begun = time.monotonic()
    sent = 0
    while not line.poll():
        await asyncio.sleep(1 / ROUND_RATE)
        due = int((time.monotonic() - begun) / TICK)
        # After a pause, packets are left out: if they were sent late and faster, so would the tool move.
        topics.advance(min(due - sent, topics.master.link.room))
        sent = due
        bridge.send()


_STOP_BUTTON_TICKS = 500
"""Number of ticks within which the stop button has stopped the machine."""

GOAL_TIMEOUT = 0.25
"""Time in s without a goal after which the client no longer leads the machine, and the pedal goes up."""

_CRTK_STATES = {
    Level.E_STOP: "DISABLED",
    Level.INIT: "ENABLED",
    Level.PEDAL_UP: "PAUSED",
    Level.PEDAL_DN: "ENABLED",
}
"""States of the robot in the words of CRTK; in E_STOP after a run, and without a client that asked for it, FAULT."""


class MachineTopics(TopicTable):
    """Topics of one machine.

    Attributes:
        master: sends the packets of the machine.
    """

    def __init__(self, robot: str, master: MachineMaster) -> None:
        """Set up the topics of a machine of this robot."""
        super().__init__(self._time)
        self.master = master
        self._client: str | None = None  # who leads the machine
        self._heard = -np.inf  # time in s of the client's last goal, by the monotonic clock
        self._stopped = False  # whether a client has pressed the stop button
        self._stop_tick = 0  # tick of the machine when it did
        self._ran = False  # whether the machine has been on
        self._goal: Array | None = None
        name = f"/{robot.upper()}"
        self._base = f"{robot}/base"
        joints = [joint.name for joint in master.parts.arm.mechanism.active]
        jaw = np.asarray(master.parts.kin.auxiliary, bool)
        self._jaw = ""  # the joint of the jaws
        kinds = {"": ~jaw}
        if jaw.any():  # as in the da Vinci Research Kit, the opening of a jaw is not a joint of the arm
            kinds["jaw/"] = jaw
            self._jaw = joints[int(np.flatnonzero(jaw)[0])]
            self.inputs[f"{name}/jaw/servo_jp"] = InputTopic("sensor_msgs/JointState", self._servo_jaw, moves=True)
        for part, chosen in kinds.items():
            names = [joint for joint, belongs in zip(joints, chosen, strict=True) if belongs]
            for kind, field in (("measured", "q"), ("setpoint", "wanted")):
                make = self._joint_states(field, names, chosen)
                self.outputs[f"{name}/{part}{kind}_js"] = OutputTopic("sensor_msgs/JointState", make)
        for kind, field in (("measured", "q"), ("setpoint", "wanted")):
            self.outputs[f"{name}/{kind}_cp"] = OutputTopic("geometry_msgs/PoseStamped", self._pose(field))
        self.outputs[f"{name}/operating_state"] = OutputTopic("crtk_msgs/OperatingState", self._operating_state)
        self.outputs["/tf"] = OutputTopic("tf2_msgs/TFMessage", self._transforms)
        self.inputs[f"{name}/servo_cp"] = InputTopic("geometry_msgs/PoseStamped", self._servo, moves=True)
        self.inputs[f"{name}/state_command"] = InputTopic("crtk_msgs/StringStamped", self._command)
        self._tool_frame = f"{robot}/tool"

    def advance(self, ticks: int) -> None:
        """Send the packets of a number of ticks; a client silent for longer than `GOAL_TIMEOUT` no longer leads."""
        if self._client is not None and time.monotonic() - self._heard > GOAL_TIMEOUT:
            self.leave(self._client)
        state = self.master.link.state
        if state is not None and state.level != Level.E_STOP:
            self._ran = True
            if state.tick > self._stop_tick + _STOP_BUTTON_TICKS:
                self._stopped = False  # started again since
        self.master.step(ticks)

    def about(self) -> JsonObject:
        """Return the client that leads the machine; None: no client."""
        return {"from": self._client}

    def leave(self, client: str) -> None:
        """Release the pedal if this client leads the machine."""
        if client == self._client:
            self._client = None
            self._goal = None
            self.master.rest()

    # -- inputs -----------------------------------------------------------------------------------------

    def _servo(self, client: str, message: JsonObject) -> str:
        stamped_pose = checked_message(PoseStamped, message)
        stamped_pose.require_frame(self._base)
        goal = handle_pose(stamped_pose.p, stamped_pose.q_wxyz)
        refusal = self._take(client)
        if refusal:
            return refusal
        self._goal = goal
        self.master.lead(goal)
        if self.master.held:
            return "the machine holds this goal as out of reach: send one within the limits of its joints"
        return ""

    def _servo_jaw(self, client: str, message: JsonObject) -> str:
        opening = grip_angle(checked_message(JointState, message).value_of(self._jaw))
        refusal = self._take(client)
        if refusal:
            return refusal
        if self._goal is None:
            state = self.master.link.state
            if state is None:
                return "the machine does not answer"
            self._goal = self.master.tool(state.wanted).copy()
        self.master.lead(self._goal, opening)
        if self.master.held:
            return (
                "the jaws do not move while the machine holds the tool's goal as out of reach: send one within the "
                "limits of its joints"
            )
        return ""

    def _take(self, client: str) -> str:
        """Let a client lead the machine; return why it may not, or ""."""
        if self._client not in (None, client):
            return f"{self._client} moves the machine until it has been silent for {GOAL_TIMEOUT:g} s"
        problem = self.master.link.problem
        if problem:
            return problem
        state = self.master.link.state
        if state is None or state.level == Level.E_STOP:
            return "the machine is in E_STOP: send enable to state_command"
        self._client = client
        self._heard = time.monotonic()
        return ""

    def _command(self, client: str, message: JsonObject) -> str:
        command = checked_message(StateCommand, message).string
        if command == "pause":
            if self._client not in (None, client):
                return f"{self._client} moves the machine; it may also be stopped with disable"
            self.leave(client)
        elif command == "disable":  # any client may stop the machine
            newest = self.master.link.reader.newest
            if newest is not None:
                self._stop_tick = newest.tick
            self._stopped = True
            self.master.link.reader.press("stop")
        else:
            self.master.link.reader.press("start")
        return ""

    # -- outputs ----------------------------------------------------------------------------------------

    def _time(self) -> float:
        state = self.master.link.reader.newest
        if state is None:
            return 0.0
        return state.t

    @property
    def _state(self) -> State:
        """The newest state of the machine.

        Raises:
            DeviceError: the machine does not answer.
        """
        state = self.master.link.state
        if state is None:
            raise DeviceError(self.master.link.problem or "the machine does not answer")
        return state

    def _joint_states(self, field: str, names: list[str], chosen: np.ndarray) -> Callable[[], JsonObject]:
        return lambda: ros.joint_state(self.t, names, getattr(self._state, field)[chosen])

    def _pose(self, field: str) -> Callable[[], JsonObject]:
        return lambda: ros.pose_stamped(self.t, self._base, self.master.tool(getattr(self._state, field)))

    def _operating_state(self) -> JsonObject:
        state = self.master.link.state
        if state is None:
            return ros.operating_state(self.t, "FAULT", is_busy=False, is_homed=False)
        word = _CRTK_STATES[state.level]
        if state.level == Level.E_STOP and self._ran and not self._stopped:
            word = "FAULT"
        moves = self.master.leads and not self.master.held and state.level == Level.PEDAL_DN
        homed = state.level in (Level.PEDAL_UP, Level.PEDAL_DN)
        return ros.operating_state(self.t, word, is_busy=state.level == Level.INIT or moves, is_homed=homed)

    def _transforms(self) -> JsonObject:
        poses = {self._base: np.eye(4), self._tool_frame: self.master.tool(self._state.q)}
        return ros.transforms(self.t, poses)
