"""Live source of a stream: one robot, or the robots of a scene with a common clock, and deformables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from twin.core.errors import unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.ui.headset import protocol as wire
from twin.ui.headset.bends import Bends
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.scene_frame import pack_scene
from twin.ui.headset.twin import Twin
from twin.ui.session.feed import Feed
from twin.ui.session.timeline import HEARTBEAT, RATE, Clock


class Live:
    """Source of a stream: robots that all clients can play and move.

    A single robot without a scene and without deformables is sent in version 1 of the stream protocol, everything else
    in version 2.

    Attributes:
        twins: the robots by name, in the order of their parts in a frame.
        clock: clock of all robots.
        send: function that sends a document to all clients.
    """

    replays = False

    def __init__(self, twins: Sequence[Twin], clock: Clock, feed: Feed | None = None) -> None:
        """Create the source for robots that use this clock."""
        self.twins = {t.name: t for t in twins}
        self.clock, self.feed, self._bends = clock, feed, Bends(feed)
        self.send: Callable[[JsonObject], object] = lambda document: None
        self._bends.send = lambda document: self.send(document)
        self.alone = feed is None and len(twins) == 1 and twins[0].place is None
        self._tick, self._sent, self._seq = -1, -HEARTBEAT, 0
        self._told: tuple[Any, ...] = ()
        for twin in twins:
            twin.send = self._sender(twin)
            twin.planned = self._planned
        self._measure()

    @property
    def version(self) -> int:
        """Version of the stream protocol."""
        return wire.ALONE if self.alone else wire.VERSION

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links: "<link>" in version 1 of the stream protocol, "<robot>/<link>" in version 2."""
        return self._names({n: t.links for n, t in self.twins.items()})

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints: "<joint>" in version 1 of the stream protocol, "<robot>/<joint>" in version 2."""
        return self._names({n: t.robot.joints for n, t in self.twins.items()})

    def _names(self, of: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
        return tuple(n if self.alone else f"{robot}/{n}" for robot, names in of.items() for n in names)

    def close(self) -> None:
        """End all processes and threads."""
        for twin in self.twins.values():
            twin.close()

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Advance to a tick; return a frame if something changed or `HEARTBEAT` ticks have passed, else None.

        Args:
            tick: number of the tick, from 0; a tick takes 1 / RATE s; ticks may be skipped.
            server_time: time of the frame in s on the monotonic clock.
        """
        passed = (tick - self._tick) / RATE if self._tick >= 0 else 0.0
        self._tick = tick
        twins = tuple(self.twins.values())
        for twin in twins:
            twin.poll(tick)
        if self.clock.advance(passed):
            self._stand()
        for twin in twins:
            twin.look()
        self._bends.follow(self._links, passed, self.clock.time)
        key = (*(t.content_key for t in twins), self._bends.packed)
        if key == self._told and tick - self._sent < HEARTBEAT:
            return None
        self._told, self._sent = key, tick
        self._seq += 1
        robots = [t.frame(self._seq - 1, server_time) for t in twins]
        if self.alone:
            return robots[0]
        flags = wire.PLAYING * self.clock.playing | wire.HELD * any(t.holder for t in twins)
        return pack_scene(self._seq - 1, server_time, self.clock.time, flags, robots, self._bends.packed)

    def _links(self) -> dict[str, dict[str, Array]]:
        return {r: {n: self.twins[r].pose_of(n) for n in names} for r, names in self._bends.needs.items()}

    def _planned(self) -> None:
        """Restart all robots, because the protocol of one robot has changed."""
        self._measure()
        self.clock.seek(0.0)
        self._bends.at(0.0)
        for twin in self.twins.values():
            if twin.holder is None:
                twin.stand()

    def _measure(self) -> None:
        durations = [t.duration for t in self.twins.values()]
        self.clock.duration = max([*durations, 0.0 if self.feed is None else self.feed.duration])

    def _stand(self) -> None:
        """Move all robots to the clock's time; a robot whose protocol has ended stays at the end."""
        for twin in self.twins.values():
            twin.stand()
        self._bends.at(self.clock.time)

    # -- requests of clients --------------------------------------------------------------------------

    def holds(self, client: str) -> bool:
        """Return whether a client has grabbed at least one robot."""
        return any(t.holder == client for t in self.twins.values())

    def release(self, client: str) -> None:
        """Release all grabs of a client."""
        for twin in self.twins.values():
            twin.release(client)

    def ask(self, client: str, message: wire.Message) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, wire.RobotMessage):
            if isinstance(message, wire.ReleaseMessage) and message.robot is None:
                return self.release(client)
            return self._of(client, message).ask(client, message)
        if not isinstance(message, wire.SpeedMessage | wire.LoopMessage | wire.SeekMessage | wire.PlayMessage):
            raise RefusedError("refused", f"`{message.type}` is for a console: this server has no console")
        for twin in self.twins.values():
            twin.leave_to(client)
        if isinstance(message, wire.SpeedMessage):
            self.clock.speed = message.value
        elif isinstance(message, wire.LoopMessage):
            self.clock.loop = message.on
        else:
            self._time(message)
            for twin in self.twins.values():
                twin.let_go(client)
        return None

    def _of(self, client: str, message: wire.RobotMessage) -> Twin:
        """Return the robot to which a request applies.

        Without a robot's name, a drag applies to the only robot that the client holds; other requests need the name if
        there are several robots.
        """
        if message.robot is not None:
            if message.robot not in self.twins:
                raise RefusedError("unknown", unknown("robot", message.robot, self.twins))
            return self.twins[message.robot]
        meant = list(self.twins.values())
        if isinstance(message, wire.DragMessage) and len(meant) > 1:
            meant = [t for t in meant if t.holder == client]
            if not meant:
                raise RefusedError("not_held", "grab first, then drag")
        if len(meant) > 1:
            names = ", ".join(t.name for t in meant)
            raise RefusedError(
                "invalid", f"robot: required, as the message could be for several robots; name one of {names}"
            )
        return meant[0]

    def _time(self, message: wire.SeekMessage | wire.PlayMessage) -> None:
        if not self.clock.duration > 0:
            why = [(n, t.why_not) for n, t in self.twins.items()]
            text = why[0][1] if self.alone else "; ".join(f"{n}: {w}" for n, w in why)
            raise RefusedError("refused", f"no protocol is planned yet: {text}")
        if isinstance(message, wire.SeekMessage):
            self.clock.seek(message.t)
        elif message.on:
            self.clock.play()
        else:
            self.clock.playing = False
            return
        self._stand()

    # -- documents ------------------------------------------------------------------------------------

    def _sender(self, twin: Twin) -> Callable[[JsonObject], object]:
        return lambda document: self.send(self._signed(twin, document))

    def _signed(self, twin: Twin, document: JsonObject) -> JsonObject:
        return document if self.alone else {**document, "robot": twin.name}

    def welcome(self) -> list[JsonObject]:
        """Return the documents for a new client: tip paths and workspaces."""
        return [self._signed(t, d) for t in self.twins.values() for d in t.welcome()]

    def state(self) -> JsonObject:
        """Return the document `state`: the clock, and the state of each robot."""
        clock = self.clock
        shared = {
            "type": "state",
            "playing": clock.playing,
            "time": clock.time,
            "duration": clock.duration,
            "speed": clock.speed,
            "loop": clock.loop,
        }
        if self.alone:
            return shared | next(iter(self.twins.values())).state()
        return {**shared, "robots": [{"name": n, **t.state()} for n, t in self.twins.items()]}
