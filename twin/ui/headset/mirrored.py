"""Source of a stream: a robot that shows the joint values of a machine; clients cannot move it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.ui.headset import protocol as wire
from twin.ui.headset.operation import DEVIATIONS
from twin.ui.headset.posed import Posed
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.scene_frame import pack_scene
from twin.ui.session.mirror import Mirror
from twin.ui.session.timeline import HEARTBEAT


class Mirrored:
    """Source of a stream: a robot at the measured joint values of a machine, and a ghost at the desired joint values.

    Attributes:
        mirror: robot with the measured and desired joint values of the machine.
        send: function that sends a document to all clients.
    """

    replays, alone, version = False, False, wire.VERSION

    def __init__(self, mirror: Mirror) -> None:
        """Show the robot of a mirror."""
        self.mirror = mirror
        self.send: Callable[[JsonObject], object] = lambda document: None
        names = [b.name for b in mirror.robot.mechanism.bodies]
        robots = (mirror.name, mirror.ghost)
        self._posed = Posed(dict.fromkeys(robots, names), dict.fromkeys(robots, np.eye(4)))
        self._seq, self._sent, self._told = 0, float(-HEARTBEAT), float(-DEVIATIONS)
        self._shown: Array | None = None

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return self._posed.links

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints, "<robot>/<joint>"."""
        return tuple(f"{n}/{j.name}" for n in self._posed.bodies for j in self.mirror.robot.mechanism.active)

    @property
    def about_machines(self) -> JsonObject:
        """The data of the machine for the file /scene.json."""
        m = self.mirror
        joints = [[j.name, j.is_angle] for j in m.robot.mechanism.active]
        return {"models": {m.name: m.ghost}, "joints": {m.name: joints}, "limit": None, "trains": False}

    def close(self) -> None:
        """End the connection to the machine."""
        self.mirror.close()

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Read the newest state; return a frame if a joint has moved or `HEARTBEAT` ticks have passed, else None."""
        mirror = self.mirror
        mirror.step()
        if tick >= self._told + DEVIATIONS:
            self._told, apart = tick, mirror.deviation
            joints = np.round(apart["joints"], 6).tolist()
            robots = {mirror.name: {"tip": round(apart["tip"], 7), "joints": joints, "cue": 0.0}}
            self.send({"type": "deviations", "time": round(server_time, 3), "robots": robots})
        signals = mirror.world.signals
        values = [signals[f"{n}.q"] for n in self._posed.bodies]
        row = np.concatenate(values)
        if self._shown is not None and np.array_equal(row, self._shown) and tick - self._sent < HEARTBEAT:
            return None
        self._shown, self._sent = row, tick
        self._seq += 1
        self._posed.look(mirror.links)
        parts = [
            self._posed.pack(n, self._seq - 1, server_time, q) for n, q in zip(self._posed.bodies, values, strict=True)
        ]
        return pack_scene(self._seq - 1, server_time, 0.0, 0, parts, ())

    def state(self) -> JsonObject:
        """Return the document `state`: run level of the machine, and the reason if the robot does not follow."""
        m = self.mirror
        one = {"level": m.level, "phase": "follow", "why": None, "problem": m.problem or None}
        return wire.still(self._posed.bodies) | {"machines": {"view": "real", "mode": "", "robots": {m.name: one}}}

    def welcome(self) -> list[JsonObject]:
        """Return no documents: a new client needs only the state."""
        return []

    def holds(self, client: str) -> bool:
        """Return False, because clients cannot grab a mirrored robot."""
        return False

    def release(self, client: str) -> None:
        """Do nothing, because clients cannot grab a mirrored robot."""

    def ask(self, client: str, message: wire.Message) -> None:
        """Refuse every request except a release.

        Raises:
            RefusedError: a robot that follows a machine cannot be moved.
        """
        if not isinstance(message, wire.ReleaseMessage):
            raise RefusedError("refused", f"{self.mirror.name} follows its machine and cannot be moved here")
