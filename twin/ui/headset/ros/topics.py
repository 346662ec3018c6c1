"""Topics and services of a console, as CRTK and the da Vinci Research Kit name them.

The hands are the robots MTMR and MTML; a robot of the scene has its own name in capital letters, such as PSM1. Poses of
handles and forces are in {H}, the axes of the endoscope's picture; poses of tools are in the base of their robot.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.errors import DeviceError, TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.exchange.formats.mcap import ros_messages as ros
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.tool_following import SCALE_RANGE
from twin.simulation.devices.packets import grip_angle, handle_pose
from twin.simulation.world import Signals
from twin.simulation.world.signal_kinds import ROBOT_COMMAND, ROBOT_ENCODER, ROBOT_FOLLOWS, ROBOT_GOAL
from twin.ui.headset.ros.hands import ROS_OWNER, RosHands
from twin.ui.headset.ros.operations import Float64, JointState, Joy, PoseStamped, checked_message
from twin.ui.headset.ros.servo_hands import ServoHands
from twin.ui.headset.ros.topic_table import InputTopic, OutputTopic, TopicTable
from twin.ui.session.live_console import HeldError, LiveConsole

_BUTTON_PRESSED = 1
"""Value of a pressed button in sensor_msgs/Joy."""


@dataclass(frozen=True)
class _Goal:
    """The pose (4, 4) of a tool that a client has requested."""

    client: str
    T_world_tool: Array


class ConsoleTopics(TopicTable):
    """Topics of the console of a scene.

    Attributes:
        hands: converter of messages to hand states.
    """

    def __init__(self, console: LiveConsole, forces: Callable[[], Mapping[str, Sequence[float]]]) -> None:
        """Set up the topics of a console; `forces` returns the newest force (3,) on each hand, in N, in {H}."""
        super().__init__(lambda: console.world.t)
        self._console = console
        self._forces = forces
        self.hands = RosHands(console.device, lambda: console.world.t, lambda: console.ended)
        self._servo_hands = ServoHands(console)
        self._goals: dict[str, _Goal] = {}  # the newest of each hand that no frame has used yet
        for number, hand in enumerate(HANDS):
            if hand in console.table.hands:
                self._add_hand(number, hand)
        self._add_console()
        for robot in console.members:
            self._add_robot(robot)
        self.outputs["/tf"] = OutputTopic("tf2_msgs/TFMessage", self._transforms)

    # -- topics -----------------------------------------------------------------------------------------

    def _add_hand(self, number: int, hand: str) -> None:
        name = f"/MTM{hand[0].upper()}"

        def pose(client: str, message: JsonObject) -> str:
            stamped_pose = checked_message(PoseStamped, message)
            return self.hands.pose(client, number, handle_pose(stamped_pose.p, stamped_pose.q_wxyz))

        def grip(client: str, message: JsonObject) -> str:
            self.hands.grip(client, number, grip_angle(checked_message(Float64, message).data))
            return ""

        def gripper(client: str, message: JsonObject) -> str:
            self.hands.grip(client, number, grip_angle(checked_message(JointState, message).position[0]))
            return ""

        def force() -> JsonObject:
            return ros.wrench_stamped(self.t, "picture", np.array(self._forces()[hand]))

        self.inputs[f"{name}/measured_cp"] = InputTopic("geometry_msgs/PoseStamped", pose, moves=True)
        self.inputs[f"{name}/gripper/measured_js"] = InputTopic("sensor_msgs/JointState", gripper)
        self.inputs[f"{name}/gripper/angle"] = InputTopic("std_msgs/Float64", grip)
        self.outputs[f"{name}/body/servo_cf"] = OutputTopic("geometry_msgs/WrenchStamped", force)

    def _add_console(self) -> None:
        def clutch(client: str, message: JsonObject) -> str:
            self.hands.press(client, clutch=checked_message(Joy, message).buttons[0] == _BUTTON_PRESSED)
            return ""

        def camera(client: str, message: JsonObject) -> str:
            self.hands.press(client, camera=checked_message(Joy, message).buttons[0] == _BUTTON_PRESSED)
            return ""

        def scale(client: str, message: JsonObject) -> str:
            value = checked_message(Float64, message).data
            low, high = SCALE_RANGE
            if not low <= value <= high:
                raise DeviceError(f"the scale {value:g} is outside {low:g} to {high:g}")
            owner = ROS_OWNER
            if self._servo_hands.client is not None:
                owner = self._servo_hands.client  # messages `servo_cp` move the tool
            try:
                self._console.rescale(owner, value)
            except TwinError as error:
                return str(error)
            return ""

        def scale_now() -> JsonObject:
            return {"data": float(self._console.reading["scale"])}

        self.inputs["/footpedals/clutch"] = InputTopic("sensor_msgs/Joy", clutch)
        self.inputs["/footpedals/camera"] = InputTopic("sensor_msgs/Joy", camera)
        self.inputs["/console/teleop/set_scale"] = InputTopic("std_msgs/Float64", scale)
        self.outputs["/console/teleop/scale"] = OutputTopic("std_msgs/Float64", scale_now)

    def _add_robot(self, robot: str) -> None:
        name = f"/{robot.upper()}"
        member = self._console.members[robot]
        joints = [joint.name for joint in member.mechanism.active]
        # As in the da Vinci Research Kit, the opening of a jaw is not a joint of the arm.
        jaw = np.asarray(member.kin.auxiliary, bool)
        arm = ~jaw
        arm_joints = [joint for joint, moves_arm in zip(joints, arm, strict=True) if moves_arm]
        jaw_joints = [joint for joint, moves_arm in zip(joints, arm, strict=True) if not moves_arm]

        def joint_states(signal: str, names: list[str], chosen: np.ndarray) -> Callable[[], JsonObject]:
            return lambda: ros.joint_state(self.t, names, self._signals[signal][chosen])

        def measured_cp() -> JsonObject:
            q = self._signals[ROBOT_ENCODER.of(robot)]
            goal = self._signals[ROBOT_GOAL.of(robot)].reshape(4, 4)
            return ros.pose_stamped(self.t, _base(robot), member.kin.forward(q, goal))

        def setpoint_cp() -> JsonObject:
            return ros.pose_stamped(self.t, _base(robot), self._signals[ROBOT_GOAL.of(robot)].reshape(4, 4))

        def state() -> JsonObject:
            return ros.operating_state(self.t, self._state(), self._follows(robot))

        joint_type = "sensor_msgs/JointState"
        pose_type = "geometry_msgs/PoseStamped"
        for kind, signal in (("measured", ROBOT_ENCODER.of(robot)), ("setpoint", ROBOT_COMMAND.of(robot))):
            self.outputs[f"{name}/{kind}_js"] = OutputTopic(joint_type, joint_states(signal, arm_joints, arm))
            if jaw_joints:
                self.outputs[f"{name}/jaw/{kind}_js"] = OutputTopic(joint_type, joint_states(signal, jaw_joints, jaw))
        self.outputs[f"{name}/measured_cp"] = OutputTopic(pose_type, measured_cp)
        self.outputs[f"{name}/setpoint_cp"] = OutputTopic(pose_type, setpoint_cp)
        self.outputs[f"{name}/operating_state"] = OutputTopic("crtk_msgs/OperatingState", state)
        if robot in (*self._console.table.right, *self._console.table.left):
            self.inputs[f"{name}/servo_cp"] = InputTopic(pose_type, self._servo(robot), moves=True)

    def _servo(self, robot: str) -> Callable[[str, JsonObject], str]:
        """Return the function that moves the tool of a robot to a pose in its base, by the hand that controls it."""

        def servo(client: str, message: JsonObject) -> str:
            stamped_pose = checked_message(PoseStamped, message)
            stamped_pose.require_frame(_base(robot))
            goal = handle_pose(stamped_pose.p, stamped_pose.q_wxyz)
            console = self._console
            if console.table.teleoperation is not None:
                return f"{robot} is moved by the pose of its hand while the pedal is pressed: send MTMR/measured_cp"
            for hand in console.table.hands:
                if console.arm(hand) == robot:
                    break
            else:
                return f"no hand controls {robot} now; tap the clutch to choose it"
            if any(self.hands.senders().values()):
                return "the poses of MTMR and MTML control the hands; end them first"
            if console.ended:
                return console.ended
            try:
                self._servo_hands.use(_servo_owner(client))
            except TwinError as error:
                return str(error)
            self._goals[hand] = _Goal(client, console.place(robot) @ goal)
            return ""

        return servo

    # -- values -----------------------------------------------------------------------------------------

    @property
    def _signals(self) -> Signals:
        return self._console.world.signals

    def _follows(self, robot: str) -> bool:
        name = ROBOT_FOLLOWS.of(robot)
        return name in self._signals and bool(self._signals[name][0])

    def _state(self) -> str:
        """Return the state of the robots in the words of CRTK."""
        reading = self._console.reading
        if reading["stopped"]:
            return "FAULT"
        if reading["silent"] or self._console.ended:
            return "PAUSED"
        return "ENABLED"

    def _transforms(self) -> JsonObject:
        poses: dict[str, Array] = {"picture": self._console.view}
        for robot, links in self._console.world.link_poses().items():
            if robot not in self._console.members:
                continue
            T_world_base = self._console.place(robot)
            poses[_base(robot)] = T_world_base
            for link, T_base_link in links.items():
                poses[f"{robot}/{link}"] = T_world_base @ T_base_link
        return ros.transforms(self.t, poses)

    def before_frame(self, passed: float) -> None:
        """Send the states of tools that `servo_cp` moves; `passed` is the time in s since the last call.

        Of several goals since the last frame, the newest counts. What was requested for an earlier goal and not sent
        yet is cancelled: the way to the new one begins where the instrument is.
        """
        for hand, goal in self._goals.items():
            self._servo_hands.handles[hand].cancel()
            with contextlib.suppress(HeldError):  # another client has taken the hands since
                self._servo_hands.move(_servo_owner(goal.client), hand, self._console.goal(hand), goal.T_world_tool)
        self._goals.clear()
        self._servo_hands.send(passed)

    def about(self) -> JsonObject:
        """Return the client of each hand, and the number of refused poses."""
        return {"from": self.hands.senders(), "ignored": self.hands.refused}

    def leave(self, client: str) -> None:
        """Forget a client that has disconnected: what it moves stops."""
        self.hands.leave(client)
        self._goals = {hand: goal for hand, goal in self._goals.items() if goal.client != client}
        if self._servo_hands.client == _servo_owner(client):
            self._servo_hands.release()


def _servo_owner(client: str) -> str:
    """Return the identifier of the owner of the hands while messages `servo_cp` of a client move a tool."""
    return f"{client} by servo_cp"


def _base(robot: str) -> str:
    """Return the name of the frame of a robot's base."""
    return f"{robot}/base"
