"""Live source of a stream: the robots of a scene in a World, teleoperated by the hands of a client.

Messages of the client become states of the input device `GivenHands`. This module steps the World in real time,
converts its poses to frames, and reports silence, jumps and limits in the state document and in the log.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twin.api import Robot
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.scene import Scene
from twin.simulation import console_scene
from twin.simulation.console_scene import HANDS, Member
from twin.simulation.controllers.camera import Drag
from twin.simulation.controllers.following import SCALE
from twin.simulation.controllers.pedals import CAMERA, FREE
from twin.simulation.devices.given import GivenHands, HandState
from twin.ui.headset import protocol as wire
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.scene_frame import pack_scene
from twin.ui.session.timeline import RATE

HEARTBEAT = 6
"""Number of ticks after which a frame is sent even if nothing has moved."""

_BUDGET, _CHUNK = 0.012, 4
"""Maximum real time in s for steps of the World per frame; number of steps between two checks of this time."""

_OWED = 0.1
"""Maximum delay in s of the World; a larger delay is dropped, so that the World runs slower than real time."""

_WALL = (0.5 * MM, 1 * DEG)
"""Minimum distance in m and angle in rad between goal and tool at which a joint limit is reported."""


class Operation:
    """Source of a stream: the robots of a scene, controlled by its console.

    Attributes:
        world: the World, stepped in real time.
        device: the input device, which receives the hands of a client.
        owner: identifier of the client whose hands control the robots; None: no client.
        send: function that sends a document to all clients.
    """

    replays, alone, version = False, False, wire.VERSION

    def __init__(self, scene: Scene, robots: Mapping[str, Robot]) -> None:
        """Create the World with the robots at the places of the scene.

        Raises:
            TwinError: the scene has no console, or the console does not match its robots.
        """
        if scene.console is None:
            raise TwinError(f"scene '{scene.name}' has no console: add the table [console] to {scene.file.name}")
        self.scene, self._table, self._robots = scene, scene.console, robots
        self.device = GivenHands(console_scene.PEDALS, HANDS, self._table.scale)
        members = {n: Member(r.mechanism, r.kinematics()) for n, r in robots.items()}
        self.world = console_scene.world(scene, members, self.device, records=False)
        self.owner: str | None = None
        self.send: Callable[[dict[str, Any]], object] = lambda document: None
        self._members = members
        self._places = {p.name: p for p in scene.places}
        self._bodies = {n: [b.name for b in m.mechanism.bodies] for n, m in members.items()}
        self._tick, self._sent, self._seq = -1.0, float(-HEARTBEAT), 0
        self._owed, self._rate, self._stopped = 0.0, 1.0, ""
        self._shown: Array | None = None
        self._sevens: dict[str, Array] = {}
        self._state = self._read()

    @property
    def about(self) -> dict[str, Any]:
        """Data of the console in scene.json."""
        table = self._table
        return {
            "hands": {hand: list(getattr(table, hand)) for hand in HANDS},
            "camera": table.camera,
            "scale": list(SCALE),
            "patience": self.device.patience,
        }

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return tuple(f"{robot}/{name}" for robot, names in self._bodies.items() for name in names)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints, "<robot>/<joint>"."""
        return tuple(f"{n}/{j.name}" for n, m in self._members.items() for j in m.mechanism.active)

    def close(self) -> None:
        """Do nothing, because there are no processes or threads to end."""

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Advance to a tick of 1 / RATE s, which may be a fraction; return a frame if a joint moved or after `HEARTBEAT` ticks, else None."""
        passed = (tick - self._tick) / RATE if self._tick >= 0 else 0.0
        self._tick = tick
        self._advance(passed)
        self._tell(self._read())
        row = np.concatenate([self.world.signals[f"{n}.q"] for n in self._members])
        moved = self._shown is None or not np.array_equal(row, self._shown)
        if not moved and tick - self._sent < HEARTBEAT:
            return None
        if moved:
            self._shown = row
            self._look()
        self._sent = tick
        self._seq += 1
        robots = [self._pack(name, server_time) for name in self._members]
        return pack_scene(self._seq - 1, server_time, self.world.t, 0, robots, ())

    def _advance(self, passed: float) -> None:
        if self._stopped or not passed > 0:
            return
        dt, end = self.world.dt, time.monotonic() + _BUDGET
        self._owed += passed
        wanted = done = int(self._owed / dt + 1e-6)
        try:
            while done > 0:
                n = min(done, _CHUNK)
                self.world.step(n)
                done -= n
                if time.monotonic() > end:
                    break
        except TwinError as error:
            self._stopped = str(error)
            logging.getLogger(__name__).error("the World has stopped: %s", error)
        self._owed = min(self._owed - (wanted - done) * dt, _OWED)
        share = min(1.0, passed) * 0.5
        self._rate += share * ((wanted - done) * dt / passed - self._rate)

    def _look(self) -> None:
        frame = self.world.frame()
        for name, bodies in self._bodies.items():
            T_base_world = spatial.inverse(self._places[name].T_world_base)
            poses = wire.sevens(T_base_world @ np.stack([frame.link_poses[name][b] for b in bodies]))
            self._sevens[name] = wire.near_signs(poses, self._sevens.get(name))

    def _pack(self, name: str, server_time: float) -> bytes:
        poses, q = self._sevens[name], self.world.signals[f"{name}.q"]
        return wire.pack(self._seq - 1, server_time, 0.0, 0, wire.pack_body(poses, q, None), len(poses), len(q))

    # -- requests of clients --------------------------------------------------------------------------

    def holds(self, client: str) -> bool:
        """Return whether the hands of this client control the robots."""
        return self.owner == client

    def release(self, client: str) -> None:
        """End the control by this client's hands, if this client has control."""
        if self.owner == client:
            self.owner = None
            self.device.leave()

    def ask(self, client: str, message: wire.Message) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, wire.Hands):
            return self._hands(client, message)
        if isinstance(message, wire.Release):
            return self.release(client)
        if isinstance(message, wire.Scale):
            self._leave_to(client)
            return self.device.rescale(message.value)
        raise RefusedError("refused", "these robots are led by the hands of the console alone: send `hands`")

    def _leave_to(self, client: str) -> None:
        if self.owner not in (None, client) and not self._silent:
            raise RefusedError("held", f"{self.owner} has the hands of the console; wait until it lets go")

    def _own(self, client: str) -> None:
        self._leave_to(client)
        if self.owner != client:
            self.device.leave()
            self.owner = client

    @property
    def _silent(self) -> bool:
        return any(self.device.silent(hand, self.world.t) for hand in (0, 1))

    def _hands(self, client: str, message: wire.Hands) -> None:
        self._own(client)
        for k, hand in enumerate((message.right, message.left)):
            pose = wire.pose_of(hand.pose)
            self.device.give(HandState(k, message.clutch, message.camera, message.number, pose, hand.grip))

    # -- documents ------------------------------------------------------------------------------------

    def welcome(self) -> list[dict[str, Any]]:
        """Return no documents: a new client needs only the state."""
        return []

    def state(self) -> dict[str, Any]:
        """Return the document `state`: controlled arms, arms at a limit, and the reason if nothing moves."""
        return {
            "type": "state",
            "playing": False,
            "time": 0.0,
            "duration": 0.0,
            "speed": 1.0,
            "loop": False,
            "robots": [{"name": n, "reason": None} for n in self._members],
            "console": self._state,
        }

    def _read(self) -> dict[str, Any]:
        signals = self.world.signals
        mode = float(signals["console.mode"][0])
        silent = bool(signals[f"{console_scene.PEDALS}.silent"][0])
        taps = int(signals["console.taps"][0])
        hands = {}
        for hand in HANDS:
            arms = getattr(self._table, hand)
            arm = arms[taps % len(arms)]
            follows = bool(signals[f"{arm}.follows"][0])
            wall = self._wall(arm) if follows else None
            jumps = int(sum(signals[f"{a}.jumps"][0] for a in arms))
            hands[hand] = {"robot": arm, "follows": follows, "wall": wall, "jumps": jumps}
        return {
            "owner": self.owner,
            "heard": self.device.heard,
            "silent": silent,
            "mode": "nothing" if mode == FREE else "camera" if mode == CAMERA else "instruments",
            "scale": float(signals[f"{console_scene.PEDALS}.scale"][0]),
            "hands": hands,
            "camera": self._camera_wall() if mode == CAMERA else None,
            "rate": round(self._rate, 1),
            "stopped": self._stopped or None,
        }

    def _wall(self, name: str) -> str | None:
        """Return a text on the joint limit that prevents an arm from reaching its goal; None if there is none."""
        member, signals = self._members[name], self.world.signals
        q, goal = signals[f"{name}.q"], signals[f"{name}.goal"].reshape(4, 4)
        T = member.kin.forward(q, goal)
        way = float(np.linalg.norm(goal[:3, 3] - T[:3, 3]))
        if way < _WALL[0] and float(spatial.rotation_angle(goal[:3, :3] @ T[:3, :3].T)) < _WALL[1]:
            return None
        for k, joint in enumerate(member.mechanism.active):
            low, high = joint.limits or (-np.inf, np.inf)
            if not member.kin.auxiliary[k] and (q[k] - low < 1e-6 or high - q[k] < 1e-6):
                shown, unit = (q[k] / DEG, "°") if joint.is_angle else (q[k] / MM, " mm")
                return f"{joint.name} is at its limit, {shown:.0f}{unit}"
        return None

    def _camera_wall(self) -> str | None:
        robot = self.scene.cameras[self._table.camera].robot
        at, drag = self.world.signals[f"{robot}.at"], Drag()
        names, units = ("pan", "tilt", "depth", "roll"), (DEG, DEG, MM, DEG)
        for k, (name, unit) in enumerate(zip(names, units, strict=True)):
            if at[k] - drag.lower[k] < 1e-9 or drag.upper[k] - at[k] < 1e-9:
                return f"{name} is at its limit, {at[k] / unit:.0f}{'°' if unit == DEG else ' mm'}"
        return None

    def _tell(self, new: dict[str, Any]) -> None:
        """Set the new state; log silence, jumps and limits, and also send jumps to all clients."""
        old, self._state = self._state, new
        log = logging.getLogger(__name__)
        if new["silent"] and not old["silent"]:
            log.warning("nothing was heard of the hands for %g s: nothing moves", self.device.patience)
        for hand, now in new["hands"].items():
            before = old["hands"][hand]
            if now["jumps"] > before["jumps"]:
                text = f"the {hand} hand jumped: {now['robot']} stands, and follows from there"
                log.warning("%s", text)
                self.send({"type": "error", "code": "failed", "message": text})
            if now["wall"] and now["wall"] != before["wall"]:
                log.warning("%s: %s", now["robot"], now["wall"])
