"""Live source of a stream: the robots of a scene in a World, teleoperated by the hands of a client.

The World and its hands are a `LiveConsole`; here messages become hands, and poses become frames.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twin.api import Robot
from twin.core import spatial
from twin.core.spatial import Array
from twin.model.scene import Scene
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.following import SCALE
from twin.simulation.devices.given import HandState
from twin.ui.headset import protocol as wire
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.scene_frame import pack_scene
from twin.ui.session.console import HeldError, LiveConsole
from twin.ui.session.timeline import RATE

HEARTBEAT = 6
"""Number of ticks after which a frame is sent even if nothing has moved."""


class Operation(LiveConsole):
    """Source of a stream: the robots of a scene, controlled by its console.

    Attributes:
        send: function that sends a document to all clients.
    """

    replays, alone, version = False, False, wire.VERSION

    def __init__(self, scene: Scene, robots: Mapping[str, Robot]) -> None:
        super().__init__(scene, robots)
        self.send: Callable[[dict[str, Any]], object] = lambda document: None
        self._bodies = {n: [b.name for b in m.mechanism.bodies] for n, m in self.members.items()}
        self._tick, self._sent, self._seq = -1, -HEARTBEAT, 0
        self._shown: Array | None = None
        self._sevens: dict[str, Array] = {}

    @property
    def about(self) -> dict[str, Any]:
        """Data of the console in scene.json."""
        table = self.table
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
        return tuple(f"{n}/{j.name}" for n, m in self.members.items() for j in m.mechanism.active)

    def close(self) -> None:
        """Do nothing, because there are no processes or threads to end."""

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: int, server_time: float) -> bytes | None:
        """Advance to a tick of 1 / RATE s; return a frame if a joint moved or after `HEARTBEAT` ticks, else None."""
        passed = (tick - self._tick) / RATE if self._tick >= 0 else 0.0
        self._tick = tick
        for text in self.advance(passed):
            self.send({"type": "error", "code": "failed", "message": text})
        row = np.concatenate([self.world.signals[f"{n}.q"] for n in self.members])
        moved = self._shown is None or not np.array_equal(row, self._shown)
        if not moved and tick - self._sent < HEARTBEAT:
            return None
        if moved:
            self._shown = row
            self._look()
        self._sent = tick
        self._seq += 1
        robots = [self._pack(name, server_time) for name in self.members]
        return pack_scene(self._seq - 1, server_time, self.world.t, 0, robots, ())

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

    def ask(self, client: str, message: wire.Message) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, wire.Release):
            return self.release(client)
        try:
            if isinstance(message, wire.Hands):
                return self._hands(client, message)
            if isinstance(message, wire.Scale):
                return self.rescale(client, message.value)
        except HeldError as error:
            raise RefusedError("held", str(error)) from None
        raise RefusedError("refused", "these robots are led by the hands of the console alone: send `hands`")

    def _hands(self, client: str, message: wire.Hands) -> None:
        states = [
            HandState(k, message.clutch, message.camera, message.number, wire.pose_of(hand.pose), hand.grip)
            for k, hand in enumerate((message.right, message.left))
        ]
        self.give(client, *states)

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
            "robots": [{"name": n, "reason": None} for n in self.members],
            "console": self.reading,
        }
