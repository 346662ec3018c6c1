"""Source of a stream: a robot that shows the joint values of a machine; clients cannot move it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.simulation.world.signal_kinds import ROBOT_Q
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import ClientMessage, RefusedError, ReleaseMessage
from twin.ui.headset.console_stream import DEVIATION_TICKS
from twin.ui.headset.pose_packing import PosePacker
from twin.ui.headset.scene_frame import HEARTBEAT_TICKS, pack_scene
from twin.ui.session.mirror import Mirror


class MirroredMachine:
    """Source of a stream: a robot at the measured joint values of a machine, and a ghost at the desired joint values.

    Attributes:
        mirror: robot with the measured and desired joint values of the machine.
        send: function that sends a document to all clients.
    """

    replays = False
    is_single_robot = False
    version = wire.SCENE_VERSION

    def __init__(self, mirror: Mirror) -> None:
        """Show the robot of a mirror."""
        self.mirror = mirror
        self.send: Callable[[JsonObject], object] = lambda document: None
        names = [body.name for body in mirror.robot.mechanism.bodies]
        robots = (mirror.name, mirror.ghost)
        self._pose_packer = PosePacker(dict.fromkeys(robots, names), dict.fromkeys(robots, np.eye(4)))
        self._seq = 0
        self._tick_of_frame = float(-HEARTBEAT_TICKS)
        self._tick_of_deviations = float(-DEVIATION_TICKS)
        self._sent_row: Array | None = None

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, "<robot>/<link>"."""
        return self._pose_packer.links

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints, "<robot>/<joint>"."""
        names = []
        for robot in self._pose_packer.bodies:
            for joint in self.mirror.robot.mechanism.active:
                names.append(f"{robot}/{joint.name}")
        return tuple(names)

    @property
    def about_machines(self) -> JsonObject:
        """The data of the machine for the file /scene.json."""
        mirror = self.mirror
        joints = [[joint.name, joint.is_angle] for joint in mirror.robot.mechanism.active]
        return {"models": {mirror.name: mirror.ghost}, "joints": {mirror.name: joints}, "limit": None, "trains": False}

    def close(self) -> None:
        """End the connection to the machine."""
        self.mirror.close()

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Read the newest state; return a frame if a joint has moved or after `HEARTBEAT_TICKS` ticks, else None."""
        mirror = self.mirror
        mirror.step()
        if tick >= self._tick_of_deviations + DEVIATION_TICKS:
            self._tick_of_deviations = tick
            deviation = mirror.deviation
            joints = np.round(deviation["joints"], 6).tolist()
            robots = {mirror.name: {"tip": round(deviation["tip"], 7), "joints": joints, "cue": 0.0}}
            self.send({"type": "deviations", "time": round(server_time, 3), "robots": robots})
        signals = mirror.world.signals
        values = [signals[ROBOT_Q.of(name)] for name in self._pose_packer.bodies]
        row = np.concatenate(values)
        if (
            self._sent_row is not None
            and np.array_equal(row, self._sent_row)
            and tick - self._tick_of_frame < HEARTBEAT_TICKS
        ):
            return None
        self._sent_row = row
        self._tick_of_frame = tick
        seq = self._seq
        self._seq += 1
        self._pose_packer.set_poses(mirror.links)
        parts = []
        for name, q in zip(self._pose_packer.bodies, values, strict=True):
            parts.append(self._pose_packer.pack(name, seq, server_time, q))
        return pack_scene(seq, server_time, 0.0, 0, parts, ())

    def state(self) -> JsonObject:
        """Return the document `state`: run level of the machine, and the reason if the robot does not follow."""
        mirror = self.mirror
        machine = {"level": mirror.level, "phase": "follow", "why": None, "problem": mirror.problem or None}
        machines = {"view": "real", "mode": "", "robots": {mirror.name: machine}}
        return wire.still(self._pose_packer.bodies) | {"machines": machines}

    def welcome(self) -> list[JsonObject]:
        """Return no documents: a new client needs only the state."""
        return []

    def holds(self, client: str) -> bool:
        """Return False, because clients cannot grab a mirrored robot."""
        return False

    def release(self, client: str) -> None:
        """Do nothing, because clients cannot grab a mirrored robot."""

    def ask(self, client: str, message: ClientMessage) -> None:
        """Refuse every request except a release.

        Raises:
            RefusedError: a robot that follows a machine cannot be moved.
        """
        if not isinstance(message, ReleaseMessage):
            raise RefusedError("refused", f"{self.mirror.name} follows its machine and cannot be moved here")
