"""Live source of a stream: the robots of a scene in a World, teleoperated by the hands of a surgeon at its console.

`LiveConsole` steps the World. One owner at a time controls the hands: a client of the page, UDP packets, or clients of
ROS systems. This module passes the messages of the page's clients to the console, and converts link poses to frames;
`hand_inputs` receives the hand states of the other owners.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import numpy as np

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.tool import TOOL_TEXTS
from twin.model.trainer import MODEL
from twin.simulation import console_scene
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.tool_following import SCALE_RANGE
from twin.simulation.controllers.trainer_states import TrainerMode
from twin.simulation.devices.packets import Packets
from twin.simulation.devices.received_hands import HandState
from twin.simulation.world.signal_kinds import ROBOT_Q
from twin.ui.access.responses import File
from twin.ui.access.rules import AccessRules
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import (
    ButtonMessage,
    ClientMessage,
    FormMessage,
    FulcrumMessage,
    HandsMessage,
    HapticsMessage,
    PlanMessage,
    RefusedError,
    ReleaseMessage,
    ScaleMessage,
    TaskMessage,
    ToolMessage,
    TrainingMessage,
)
from twin.ui.headset.deformable_packets import DeformablePackets
from twin.ui.headset.description import numbers
from twin.ui.headset.hand_inputs import receive_hands
from twin.ui.headset.mqtt import ScaleTopic
from twin.ui.headset.packet_socket import UDP_OWNER, PacketHands
from twin.ui.headset.plan_documents import PlanDocuments
from twin.ui.headset.pose_packing import PosePacker
from twin.ui.headset.ros.bridge import RosBridge
from twin.ui.headset.ros.hands import ROS_OWNER
from twin.ui.headset.ros.topics import ConsoleTopics
from twin.ui.headset.scene_frame import HEARTBEAT_TICKS, pack_scene
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.live_console import HeldError, LiveConsole
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.timeline import TICK_RATE

REPORT_PATH = "/report-{}.html"
"""URL path of the report of an attempt at a task; {} is the number of the attempt."""

_REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
"""Content-Security-Policy of a report, which has no scripts and contains its styles and pictures."""

DEVIATION_TICKS = TICK_RATE / 20
"""Number of ticks between two documents `deviations`."""


class ConsoleStream(LiveConsole):
    """Source of a stream: the robots of a scene, controlled by the scene's console.

    Attributes:
        replays: False: the source is no recorded session.
        is_single_robot: False: the stream is that of a scene, not of a single robot.
        version: version of the stream protocol.
        device: the input device, which receives the hand states of the owner.
        owner: identifier of the client whose hands control the robots; `UDP_OWNER` or `ROS_OWNER` if UDP packets or
            clients of ROS systems do; None: no owner.
        packets: receiver of UDP packets with hand states; None before `listen`.
        tablet: MQTT topic by which the motion scale is set; None before `connect`.
        ros: server for clients of ROS systems; None before `bridge`.
        topics: what this server reads and publishes; None before `bridge`.
        send: function that sends a document to all clients.
        files: reports of finished attempts, by path.
    """

    device: Packets
    _device_type = Packets

    replays = False
    is_single_robot = False
    version = wire.SCENE_VERSION

    def __init__(self, loaded: LoadedScene, exercise: Exercise = NO_TASK) -> None:
        """Create the World with the robots at the places of the scene.

        Raises:
            TwinError: the scene has no console, its robots do not match the console, or its props do not match the
                task.
            OutputError: the session cannot be written.
        """
        self.packets: PacketHands | None = None
        self.tablet: ScaleTopic | None = None
        self.ros: RosBridge | None = None
        self.topics: ConsoleTopics | None = None
        self._broker_connection: asyncio.Future[None] | None = None
        self.files: dict[str, File] = {}
        super().__init__(loaded, exercise)
        self.send: Callable[[JsonObject], object] = lambda document: None
        self._deformables = DeformablePackets(self.feed)
        self._deformables.send = lambda document: self.send(document)
        bodies: dict[str, list[str]] = {}
        bases: dict[str, Array] = {}
        for name, member in self.shown.items():
            bodies[name] = [body.name for body in member.mechanism.bodies]
            bases[name] = self._places[name].T_world_base
        self._plan_documents = PlanDocuments(self.planning, {name: bodies[name] for name in self.members})
        if self.objects:
            bodies[wire.OBJECTS_PREFIX] = [item.name for item in self.objects]
            bases[wire.OBJECTS_PREFIX] = np.eye(4)
        self._pose_packer = PosePacker(bodies, bases)
        self._tick = -1.0
        self._tick_of_frame = float(-HEARTBEAT_TICKS)
        self._tick_of_deviations = float(-DEVIATION_TICKS)
        self._seq = 0
        self._sent_row: Array | None = None
        self._links: dict[str, dict[str, Array]] = {}
        self._sent_fields: tuple[bytes, ...] = ()
        self._sent_forces = {hand: [0.0, 0.0, 0.0] for hand in HANDS}

    @property
    def about(self) -> JsonObject:
        """The data of the console for the file /scene.json."""
        table = self.table
        tools = []
        for name, tool in self.scene.tools.items():
            tools.append(
                {
                    "name": name,
                    "title": tool.title,
                    "kind": tool.kind,
                    "does": TOOL_TEXTS[tool.kind],
                    "jaw": tool.jaw_mm * MM,
                    "open": (tool.open_mm or 0.0) * MM,
                }
            )
        return {
            "hands": {"right": list(table.right), "left": list(table.left)},
            "camera": table.camera,
            "scale": list(SCALE_RANGE),
            "patience": self.device.patience,
            "fulcrum": bool(table.instrument_mm),
            "task": self.referee is not None,
            "jaws": {hand: self._has_jaw(hand) for hand in HANDS},
            "pedal": "clutch" if table.teleoperation is None else "enable",
            "first_scale": table.scale,
            "guided": self.guided or self.choice is not None,
            "called": console_scene.instrument_names(self.scene),
            "choice": None if self.choice is None else self.choice.about(),
            "questionnaires": self.questionnaires(),
            "marks": [[text, numbers(at)] for text, at in self.marks()],
            "tools": tools,
        }

    @property
    def about_machines(self) -> JsonObject | None:
        """The data of the machines for the file /scene.json; None without machines."""
        trainer = self.scene.trainer
        if self.machines is None or trainer is None:
            return None
        models = {}
        joints = {}
        for robot in trainer.robots:
            models[robot] = robot + MODEL
            joints[robot] = [[joint.name, joint.is_angle] for joint in self.members[robot].mechanism.active]
        return {
            "models": models,
            "joints": joints,
            "limit": trainer.cue.tol_mm * MM,
            "trains": True,
        }

    def _has_jaw(self, hand: str) -> bool:
        """Return whether the gripper of a hand moves a joint of an arm or the jaws of a tool."""
        if self.task is not None and not self.task.kind.console:
            return True
        arms = self.table.right if hand == "right" else self.table.left
        for arm in arms:
            has_auxiliary_joint = self.members[arm].kin.auxiliary.any()
            if has_auxiliary_joint:
                return True
        return False

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return self._pose_packer.links

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints, "<robot>/<joint>"."""
        names = []
        for robot, member in self.shown.items():
            for joint in member.mechanism.active:
                names.append(f"{robot}/{joint.name}")
        return tuple(names)

    def listen(self, host: str, port: int) -> None:
        """Receive the states of the hands by UDP at an address and a port (0: any free port).

        Raises:
            TwinError: the port is in use.
        """
        self.packets = PacketHands(self.device, host, port, self._warn)

    def connect(self, host: str, port: int, topic: str) -> None:
        """Receive the motion scale from an MQTT broker; call this function in an event loop.

        Raises:
            TwinError: the topic is invalid, or the package for MQTT is not installed.
        """
        self.tablet = ScaleTopic(host, port, topic, SCALE_RANGE, self.table.scale, self.device.rescale)
        self.tablet.reports.tell = self._warn
        self._broker_connection = asyncio.ensure_future(self.tablet.run())

    def bridge(self, rules: AccessRules) -> RosBridge:
        """Return the server for clients of ROS systems that the rules accept; the caller starts and closes it."""
        self.topics = ConsoleTopics(self, lambda: self._sent_forces)
        self.ros = RosBridge(self.topics, rules)
        return self.ros

    def close(self) -> None:
        """Close the UDP socket and the connection to the broker, complete the session file, remove temporary files."""
        if self.packets is not None:
            self.packets.socket.close()
            self.packets = None
        if self._broker_connection is not None:
            self._broker_connection.cancel()
        super().close()

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Advance to a tick; return a frame if something has moved or `HEARTBEAT_TICKS` ticks have passed, else None.

        `tick` is in units of 1 / RATE s and may have a fraction; `server_time` is the time of the frame in s on the
        monotonic clock.
        """
        passed = 0.0
        if self._tick >= 0:
            passed = (tick - self._tick) / TICK_RATE
        self._tick = tick
        if self.topics is not None:
            self.topics.before_frame(passed)
        scale = self.reading["scale"]
        for text in self.advance(passed):
            self._send_error(text)
        if self.tablet is not None and self.reading["scale"] != scale:
            self.tablet.show(self.reading["scale"])
        self._publish_report()
        self._send_forces()
        self._send_deviations(tick)
        for document in self._plan_documents.changed_documents():
            self.send(document)
        if self.ros is not None:
            self.ros.send()
        row = self.state_row()
        has_moved = self._sent_row is None or not np.array_equal(row, self._sent_row)
        if has_moved:
            self._sent_row = row
            self._update_poses()
        self._deformables.follow(lambda: self._links, passed, self.world.t)
        bends = self._deformables.packed
        if not has_moved and bends is self._sent_fields and tick - self._tick_of_frame < HEARTBEAT_TICKS:
            return None
        self._tick_of_frame = tick
        self._sent_fields = bends
        seq = self._seq
        self._seq += 1
        signals = self.world.signals
        robots = []
        for name in self._pose_packer.bodies:
            # the movable objects are sent as a robot without joints
            q = signals[ROBOT_Q.of(name)] if name in self.shown else np.zeros(0)
            robots.append(self._pose_packer.pack(name, seq, server_time, q))
        return pack_scene(seq, server_time, self.world.t, 0, robots, bends)

    def _send_forces(self) -> None:
        """Send the forces on the hands to all clients if a force has changed."""
        forces = {hand: [0.0, 0.0, 0.0] for hand in HANDS}  # a console with one hand has no force on the other one
        for hand, force in self.forces().items():
            forces[hand] = [round(float(component), 3) + 0.0 for component in force]  # + 0.0: no negative zero
        if forces != self._sent_forces:
            self._sent_forces = forces
            self.send({"type": "forces", **forces})

    def _send_deviations(self, tick: float) -> None:
        """Send the deviations of the machines from their models to all clients, 20 times a second."""
        if self.machines is None or tick < self._tick_of_deviations + DEVIATION_TICKS:
            return
        self._tick_of_deviations = tick
        robots = {}
        for name, deviation in self.deviations().items():
            robots[name] = {
                "tip": round(deviation["tip"], 7),
                "joints": np.round(deviation["joints"], 6).tolist(),
                "cue": round(deviation["cue"], 4),
            }
        self.send({"type": "deviations", "time": round(self.world.t, 3), "robots": robots})

    @property
    def _group_size(self) -> int:
        if self.owner in (UDP_OWNER, ROS_OWNER):
            return 1  # a force acts for one step
        return super()._group_size

    def _before_steps(self, parts: int) -> None:
        super()._before_steps(parts)
        self._receive_hands(parts)

    def _after_steps(self, behind: bool) -> None:
        if behind:  # use all packets at once, so that the delay does not grow
            self._receive_hands(1)
        super()._after_steps(behind)

    def _receive_hands(self, parts: int) -> None:
        """Receive hand states by UDP and from ROS clients; `parts` is the number of remaining groups of steps."""
        ros_hands = None
        if self.topics is not None:
            ros_hands = self.topics.hands
        receive_hands(self, self.packets, ros_hands, parts)

    def _update_poses(self) -> None:
        """Read the poses of links and movable objects."""
        self._links = self.world.link_poses()
        objects = {item.name: self._links[item.name][item.name] for item in self.objects}
        self._pose_packer.set_poses({**self._links, wire.OBJECTS_PREFIX: objects})

    def _publish_report(self) -> None:
        """Add the newest report to `files`."""
        report = self.report()
        if report is None:
            return
        number, html, _ = report
        path = REPORT_PATH.format(number)
        if html is not None and path not in self.files:
            self.files[path] = File(html, "text/html; charset=utf-8", policy=_REPORT_POLICY)

    # -- requests of clients --------------------------------------------------------------------------

    def holds(self, client: str) -> bool:
        """Return whether the hands of this client control the robots."""
        return self.owner == client

    def ask(self, client: str, message: ClientMessage) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, ReleaseMessage):
            self.release(client)
            return
        try:
            is_known = self._apply_to_console(client, message)
        except HeldError as error:
            raise RefusedError("held", str(error)) from None
        except TwinError as error:
            raise RefusedError("refused", str(error)) from None
        if not is_known:
            raise RefusedError("refused", "only the hands of the console control these robots: send `hands`")

    def _apply_to_console(self, client: str, message: ClientMessage) -> bool:
        """Apply a request to the console; return False if the request is not for a console."""
        match message:
            case HandsMessage():
                self._move_hands(client, message)
            case ScaleMessage():
                self.rescale(client, message.value)
            case TaskMessage(do="restart"):
                self.restart(client)
            case TaskMessage(do="start"):
                self.start_task(client, message.name)
            case TaskMessage():
                self.end(client)
            case FormMessage():
                self.answer(client, message.when, message.name, message.answers, message.weights)
            case HapticsMessage():
                self.feel(client, message.on)
            case FulcrumMessage():
                self.choose_fulcrum(client, message.mode)
            case TrainingMessage():
                self.train(client, TrainerMode[message.mode.upper()])
            case ButtonMessage():
                self.press(client, message.button)
            case PlanMessage():
                self.plan(client, message.do, message.hand)
            case ToolMessage():
                self.take_tool(client, message.hand, message.name)
            case _:
                return False
        return True

    def _move_hands(self, client: str, message: HandsMessage) -> None:
        states = []
        for k, hand in enumerate((message.right, message.left)):
            pose = wire.pose_of(hand.pose)
            states.append(HandState(k, message.clutch, message.camera, message.number, pose, hand.grip))
        self.give(client, *states)

    # -- documents ------------------------------------------------------------------------------------

    def welcome(self) -> list[JsonObject]:
        """Return the documents of planning mode, and why a task that was asked for is not shown."""
        documents = self._plan_documents.all_documents()
        if self.choice is not None and self.choice.problem:
            documents.append({"type": "error", "code": "failed", "message": self.choice.problem[:500]})
        return documents

    def state(self) -> JsonObject:
        """Return the document `state`: controlled arms, arms at a limit, and the reason if nothing moves."""
        document = wire.still(self.shown) | {"console": self.reading}
        machines = self.reading["machines"]
        if machines is not None:
            document["machines"] = machines
        return document

    def _read_state(self) -> JsonObject:
        reading = super()._read_state() | {"packets": None, "mqtt": None, "ros": None}
        if self.packets is not None:
            reading["packets"] = self.packets.state(self.world.t, self.world.signals)
        if self.tablet is not None:
            reading["mqtt"] = self.tablet.state
        if self.ros is not None:
            reading["ros"] = self.ros.state()
        return reading

    def _warn(self, text: str) -> None:
        """Write a message to the log, and send it to all clients."""
        logging.getLogger(__name__).warning("%s", text)
        self._send_error(text)

    def _send_error(self, text: str) -> None:
        """Send a message about an error to all clients."""
        self.send({"type": "error", "code": "failed", "message": text})
