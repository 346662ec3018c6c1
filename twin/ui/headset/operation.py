"""Live source of a stream: the robots of a scene in a World, teleoperated by the hands of a client or by UDP packets.

`LiveConsole` steps the World. One owner at a time, a client or UDP, controls the hands. This module converts the
owner's messages or packets to states of the input device `Packets`, and link poses to frames.
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
from twin.model.tool import DOES
from twin.model.trainer import MODEL
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.following import SCALE
from twin.simulation.controllers.trainer import Mode
from twin.simulation.devices.given import HandState
from twin.simulation.devices.packets import Packets
from twin.ui.access.responses import File
from twin.ui.headset import protocol as wire
from twin.ui.headset.bends import Bends
from twin.ui.headset.mqtt import ScaleTopic
from twin.ui.headset.packet_socket import UDP, PacketHands
from twin.ui.headset.plan_documents import PlanDocuments
from twin.ui.headset.posed import Posed
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.scene_frame import pack_scene
from twin.ui.session.console import HeldError, LiveConsole
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.timeline import HEARTBEAT, RATE

REPORT = "/report-{}.html"
"""URL path of the report of an attempt at a task; {} is the number of the attempt."""

_PAPER = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
"""Content-Security-Policy of a report, which has no scripts and contains its styles and pictures."""

DEVIATIONS = RATE / 20
"""Number of ticks between two documents `deviations`."""


class Operation(LiveConsole):
    """Source of a stream: the robots of a scene, controlled by the scene's console.

    Attributes:
        device: the input device, which receives the hand states of a client or of UDP packets.
        owner: identifier of the client whose hands control the robots; `UDP` if UDP packets do; None: no owner.
        packets: receiver of UDP packets with hand states; None before `listen`.
        tablet: MQTT topic by which the motion scale is set; None before `connect`.
        send: function that sends a document to all clients.
        files: reports of finished attempts, by path.
    """

    device: Packets
    _device_type = Packets

    replays, alone, version = False, False, wire.VERSION

    def __init__(self, loaded: LoadedScene, exercise: Exercise = NO_TASK) -> None:
        """Create the World with the robots at the places of the scene.

        Raises:
            TwinError: the scene has no console, its robots do not match the console, or its props do not match the
                task.
            OutputError: the session cannot be written.
        """
        self.packets: PacketHands | None = None
        self.tablet: ScaleTopic | None = None
        self._connection: asyncio.Future[None] | None = None
        self.files: dict[str, File] = {}
        super().__init__(loaded, exercise)
        self.send: Callable[[JsonObject], object] = lambda document: None
        self._bends = Bends(self.feed)
        self._bends.send = lambda document: self.send(document)
        bodies = {n: [b.name for b in m.mechanism.bodies] for n, m in self.shown.items()}
        bases = {n: self._places[n].T_world_base for n in self.shown}
        objects = {wire.OBJECTS: [item.name for item in self.objects]} if self.objects else {}
        self._posed = Posed(bodies | objects, bases | {wire.OBJECTS: np.eye(4)})
        self._tick, self._sent, self._seq = -1.0, float(-HEARTBEAT), 0
        self._shown: Array | None = None
        self._links: dict[str, dict[str, Array]] = {}
        self._told: tuple[bytes, ...] = ()
        self._forces = {hand: [0.0, 0.0, 0.0] for hand in HANDS}
        self._curve = -DEVIATIONS
        self._plans = PlanDocuments(self.planning, {n: bodies[n] for n in self.members})

    @property
    def about(self) -> JsonObject:
        """The data of the console for the file /scene.json."""
        table, tools = self.table, self.scene.tools
        return {
            "hands": {hand: list(getattr(table, hand)) for hand in HANDS},
            "camera": table.camera,
            "scale": list(SCALE),
            "patience": self.device.patience,
            "fulcrum": bool(table.instrument_mm),
            "task": self.referee is not None,
            "jaws": {hand: self._has_jaw(hand) for hand in HANDS},
            "tools": [{"name": n, "title": t.title, "kind": t.kind, "does": DOES[t.kind]} for n, t in tools.items()],
        }

    @property
    def about_machines(self) -> JsonObject | None:
        """The data of the machines for the file /scene.json; None without machines."""
        if self.machines is None or (t := self.scene.trainer) is None:
            return None
        joints = {n: [[j.name, j.is_angle] for j in self.members[n].mechanism.active] for n in t.robots}
        return {
            "models": {n: n + MODEL for n in t.robots},
            "joints": joints,
            "limit": t.cue.tol_mm * MM,
            "trains": True,
        }

    def _has_jaw(self, hand: str) -> bool:
        """Return whether the gripper of a hand moves a joint of an arm or the jaws of a tool."""
        if self.task is not None and self.task.procedure is not None:
            return True
        return any(self.members[n].kin.auxiliary.any() for n in getattr(self.table, hand))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return self._posed.links

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints, "<robot>/<joint>"."""
        return tuple(f"{n}/{j.name}" for n, m in self.shown.items() for j in m.mechanism.active)

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
        self.tablet = ScaleTopic(host, port, topic, SCALE, self.table.scale, self.device.rescale)
        self.tablet.reports.tell = self._warn
        self._connection = asyncio.ensure_future(self.tablet.run())

    def close(self) -> None:
        """Close the UDP socket and the connection to the broker, complete the session file, remove temporary files."""
        if self.packets is not None:
            self.packets.socket.close()
            self.packets = None
        if self._connection is not None:
            self._connection.cancel()
        super().close()

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Advance to a tick; return a frame if something has moved or `HEARTBEAT` ticks have passed, else None.

        `tick` is in units of 1 / RATE s and may have a fraction; `server_time` is the time of the frame in s on the
        monotonic clock.
        """
        passed = (tick - self._tick) / RATE if self._tick >= 0 else 0.0
        self._tick = tick
        scale = self.reading["scale"]
        for text in self.advance(passed):
            self._send(text)
        if self.tablet is not None and self.reading["scale"] != scale:
            self.tablet.show(self.reading["scale"])
        self._publish()
        self._send_forces()
        self._send_deviations(tick)
        for document in self._plans.news():
            self.send(document)
        poses = [self.world.signals[f"{item.name}.pose"] for item in self.objects]
        row = np.concatenate([*(self.world.signals[f"{n}.q"] for n in self.shown), *poses])
        moved = self._shown is None or not np.array_equal(row, self._shown)
        if moved:
            self._shown = row
            self._look()
        self._bends.follow(lambda: self._links, passed, self.world.t)
        bent = self._bends.packed is not self._told
        if not moved and not bent and tick - self._sent < HEARTBEAT:
            return None
        self._sent, self._told = tick, self._bends.packed
        self._seq += 1
        robots = [self._pack(name, server_time) for name in self._posed.bodies]
        return pack_scene(self._seq - 1, server_time, self.world.t, 0, robots, self._bends.packed)

    def _send_forces(self) -> None:
        """Send the forces on the hands to all clients if a force has changed."""
        forces = {hand: [round(float(x), 3) + 0.0 for x in force] for hand, force in self.forces().items()}
        if forces != self._forces:
            self._forces = forces
            self.send({"type": "forces", **forces})

    def _send_deviations(self, tick: float) -> None:
        """Send the deviations of the machines from their models to all clients, 20 times a second."""
        if self.machines is None or tick < self._curve + DEVIATIONS:
            return
        self._curve = tick
        robots = {
            name: {"tip": round(d["tip"], 7), "joints": np.round(d["joints"], 6).tolist(), "cue": round(d["cue"], 4)}
            for name, d in self.deviations().items()
        }
        self.send({"type": "deviations", "time": round(self.world.t, 3), "robots": robots})

    @property
    def _chunk(self) -> int:
        return 1 if self.owner == UDP else super()._chunk  # a force acts for one step

    def _before_steps(self, parts: int) -> None:
        super()._before_steps(parts)
        if self.packets is not None:
            self._exchange(self.packets, parts)

    def _after_steps(self, behind: bool) -> None:
        if behind and self.packets is not None:  # use all packets at once, so that the delay does not grow
            self._exchange(self.packets, 1)
        super()._after_steps(behind)

    def _exchange(self, packets: PacketHands, parts: int) -> None:
        """Receive packets for the next steps of the World, and send the forces."""
        t, udp = self.world.t, self.owner == UDP
        packets.socket.holder = None if udp or self.silent else self.owner
        if packets.socket.pump(t, parts):
            self.own(UDP)
        elif udp and packets.silent(t):
            self.release(UDP)
        if self.owner == UDP:
            packets.answer([self.world.signals[f"{hand}.force"] for hand in HANDS], t)

    def _look(self) -> None:
        self._links = links = self.world.link_poses()
        self._posed.look({**links, wire.OBJECTS: {item.name: links[item.name][item.name] for item in self.objects}})

    def _publish(self) -> None:
        """Add the newest report to `files`."""
        if (made := self.report()) is not None and made[1] is not None and REPORT.format(made[0]) not in self.files:
            self.files[REPORT.format(made[0])] = File(made[1], "text/html; charset=utf-8", policy=_PAPER)

    def _pack(self, name: str, server_time: float) -> bytes:
        q = self.world.signals[f"{name}.q"] if name in self.shown else np.zeros(0)
        return self._posed.pack(name, self._seq - 1, server_time, q)

    # -- requests of clients --------------------------------------------------------------------------

    def holds(self, client: str) -> bool:
        """Return whether the hands of this client control the robots."""
        return self.owner == client

    def ask(self, client: str, message: wire.Message) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, wire.ReleaseMessage):
            return self.release(client)
        try:
            if isinstance(message, wire.HandsMessage):
                return self._hands(client, message)
            if isinstance(message, wire.ScaleMessage):
                return self.rescale(client, message.value)
            if isinstance(message, wire.TaskMessage):
                return (self.restart if message.do == "restart" else self.end)(client)
            if isinstance(message, wire.HapticsMessage):
                return self.feel(client, message.on)
            if isinstance(message, wire.FulcrumMessage):
                return self.choose_fulcrum(client, message.mode)
            if isinstance(message, wire.TrainingMessage):
                return self.train(client, Mode[message.mode.upper()])
            if isinstance(message, wire.ButtonMessage):
                return self.press(client, message.button)
            if isinstance(message, wire.PlanMessage):
                return self.plan(client, message.do, message.hand)
            if isinstance(message, wire.ToolMessage):
                return self.take_tool(client, message.hand, message.name)
        except HeldError as error:
            raise RefusedError("held", str(error)) from None
        except TwinError as error:
            raise RefusedError("refused", str(error)) from None
        raise RefusedError("refused", "only the hands of the console control these robots: send `hands`")

    def _hands(self, client: str, message: wire.HandsMessage) -> None:
        states = [
            HandState(k, message.clutch, message.camera, message.number, wire.pose_of(hand.pose), hand.grip)
            for k, hand in enumerate((message.right, message.left))
        ]
        self.give(client, *states)

    # -- documents ------------------------------------------------------------------------------------

    def welcome(self) -> list[JsonObject]:
        """Return the documents of planning mode; none while planning mode is off."""
        return self._plans.all()

    def state(self) -> JsonObject:
        """Return the document `state`: controlled arms, arms at a limit, and the reason if nothing moves."""
        machines = self.reading["machines"]
        more = {} if machines is None else {"machines": machines}
        return wire.still(self.shown) | {"console": self.reading} | more

    def _read(self) -> JsonObject:
        packets = None if self.packets is None else self.packets.state(self.world.t, self.world.signals)
        return super()._read() | {"packets": packets, "mqtt": None if self.tablet is None else self.tablet.state}

    def _warn(self, text: str) -> None:
        """Write a message to the log, and send it to all clients."""
        logging.getLogger(__name__).warning("%s", text)
        self._send(text)

    def _send(self, text: str) -> None:
        self.send({"type": "error", "code": "failed", "message": text})
