"""Live source of a stream: one robot, or the robots of a scene with a common clock, and deformables."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from twin.core.errors import unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import (
    ClientMessage,
    DragMessage,
    LoopMessage,
    PlayMessage,
    RefusedError,
    ReleaseMessage,
    RobotMessage,
    SeekMessage,
    SpeedMessage,
)
from twin.ui.headset.deformable_packets import DeformablePackets
from twin.ui.headset.live_robot import LiveRobot
from twin.ui.headset.scene_frame import HEARTBEAT_TICKS, pack_scene
from twin.ui.session.deformable_feed import Feed
from twin.ui.session.timeline import TICK_RATE, Clock


class LiveScene:
    """Source of a stream: robots that all clients can play and move.

    A single robot without a scene and without deformables is sent in version 1 of the stream protocol, everything else
    in version 2.

    Attributes:
        twins: the robots by name, in the order of their parts in a frame.
        clock: clock of all robots.
        send: function that sends a document to all clients.
    """

    replays = False

    def __init__(self, twins: Sequence[LiveRobot], clock: Clock, feed: Feed | None = None) -> None:
        """Create the source for robots that use this clock."""
        self.twins = {t.name: t for t in twins}
        self.clock = clock
        self.feed = feed
        self._deformables = DeformablePackets(feed)
        self.send: Callable[[JsonObject], object] = lambda document: None
        self._deformables.send = lambda document: self.send(document)
        self.is_single_robot = feed is None and len(twins) == 1 and twins[0].place is None
        self._tick = -1.0
        self._tick_of_frame = -float(HEARTBEAT_TICKS)
        self._seq = 0
        self._sent_key: tuple[object, ...] = ()
        for twin in twins:
            twin.send = self._document_sender(twin)
            twin.planned = self._restart_robots
        self._update_duration()

    @property
    def version(self) -> int:
        """Version of the stream protocol."""
        if self.is_single_robot:
            return wire.ROBOT_VERSION
        return wire.SCENE_VERSION

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links: "<link>" in version 1 of the stream protocol, "<robot>/<link>" in version 2."""
        names: list[str] = []
        for robot, twin in self.twins.items():
            names += self._full_names(robot, twin.links)
        return tuple(names)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all active joints: "<joint>" in version 1 of the stream protocol, "<robot>/<joint>" in version 2."""
        names: list[str] = []
        for robot, twin in self.twins.items():
            names += self._full_names(robot, twin.robot.joints)
        return tuple(names)

    def _full_names(self, robot: str, names: Sequence[str]) -> Sequence[str]:
        if self.is_single_robot:
            return names
        return [f"{robot}/{name}" for name in names]

    def close(self) -> None:
        """End all processes and threads."""
        for twin in self.twins.values():
            twin.close()

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: float, server_time: float) -> bytes | None:
        """Advance to a tick; return a frame if something changed or `HEARTBEAT_TICKS` ticks have passed, else None.

        Args:
            tick: number of the tick, from 0; a tick takes 1 / RATE s; ticks may be skipped.
            server_time: time of the frame in s on the monotonic clock.
        """
        passed = (tick - self._tick) / TICK_RATE if self._tick >= 0 else 0.0
        self._tick = tick
        twins = tuple(self.twins.values())
        for twin in twins:
            twin.poll(tick)
            twin.advance_machine(passed)
        if self.clock.advance(passed):
            self._show_protocol_samples()
        for twin in twins:
            twin.update_readings()
        self._deformables.follow(self._links, passed, self.clock.time)
        contents = [twin.content_key for twin in twins]
        key = (*contents, self._deformables.packed)
        if key == self._sent_key and tick - self._tick_of_frame < HEARTBEAT_TICKS:
            return None
        self._sent_key = key
        self._tick_of_frame = tick
        seq = self._seq
        self._seq += 1
        robots = []
        is_held = False
        for twin in twins:
            robots.append(twin.frame(seq, server_time))
            is_held = is_held or twin.holder is not None
        if self.is_single_robot:
            return robots[0]
        flags = wire.PLAYING_FLAG * self.clock.playing | wire.HELD_FLAG * is_held
        return pack_scene(seq, server_time, self.clock.time, flags, robots, self._deformables.packed)

    def _links(self) -> dict[str, dict[str, Array]]:
        """Return T_world_link (4, 4) of the links that bend the deformables, by robot and link."""
        poses = {}
        for robot, names in self._deformables.needs.items():
            twin = self.twins[robot]
            poses[robot] = {name: twin.pose_of(name) for name in names}
        return poses

    def _restart_robots(self) -> None:
        """Restart all robots, because the protocol of one robot has changed; one at its `start` stays there."""
        self._update_duration()
        self.clock.seek(0.0)
        self._deformables.at(0.0)
        for twin in self.twins.values():
            if twin.holder is None and not twin.is_at_opening_state:
                twin.show_protocol_sample()

    def _update_duration(self) -> None:
        """Set the clock's duration to that of the longest protocol or deformation."""
        durations = [twin.duration for twin in self.twins.values()]
        durations.append(0.0 if self.feed is None else self.feed.duration)
        self.clock.duration = max(durations)

    def _show_protocol_samples(self) -> None:
        """Move all robots to the clock's time; a robot whose protocol has ended stays at the end."""
        for twin in self.twins.values():
            twin.show_protocol_sample()
        self._deformables.at(self.clock.time)

    # -- requests of clients --------------------------------------------------------------------------

    def holds(self, client: str) -> bool:
        """Return whether a client has grabbed at least one robot."""
        return client in [twin.holder for twin in self.twins.values()]

    def release(self, client: str) -> None:
        """Release all grabs of a client."""
        for twin in self.twins.values():
            twin.release(client)

    def ask(self, client: str, message: ClientMessage) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, RobotMessage):
            if isinstance(message, ReleaseMessage) and message.robot is None:
                self.release(client)
            else:
                self._robot_of(client, message).ask(client, message)
            return
        if not isinstance(message, SpeedMessage | LoopMessage | SeekMessage | PlayMessage):
            raise RefusedError("refused", f"`{message.type}` is for a console: this server has no console")
        for twin in self.twins.values():
            twin.require_free_for(client)
        if isinstance(message, SpeedMessage):
            self.clock.speed = message.value
        elif isinstance(message, LoopMessage):
            self.clock.loop = message.on
        else:
            self._move_clock(message)
            for twin in self.twins.values():
                twin.end_hold(client)

    def _robot_of(self, client: str, message: RobotMessage) -> LiveRobot:
        """Return the robot to which a request applies.

        Without a robot's name, a drag applies to the only robot that the client holds; other requests need the name if
        there are several robots.
        """
        if message.robot is not None:
            if message.robot not in self.twins:
                raise RefusedError("unknown", unknown("robot", message.robot, self.twins))
            return self.twins[message.robot]
        twins = list(self.twins.values())
        if isinstance(message, DragMessage) and len(twins) > 1:
            twins = [twin for twin in twins if twin.holder == client]
            if not twins:
                raise RefusedError("not_held", "grab first, then drag")
        if len(twins) > 1:
            names = ", ".join(twin.name for twin in twins)
            raise RefusedError(
                "invalid", f"robot: required, as the message could be for several robots; name one of {names}"
            )
        return twins[0]

    def _move_clock(self, message: SeekMessage | PlayMessage) -> None:
        if not self.clock.duration > 0:
            reasons = []
            for name, twin in self.twins.items():
                reasons.append(
                    twin.missing_protocol_reason if self.is_single_robot else f"{name}: {twin.missing_protocol_reason}"
                )
            raise RefusedError("refused", f"no protocol is planned yet: {'; '.join(reasons)}")
        if isinstance(message, SeekMessage):
            self.clock.seek(message.t)
        elif message.on:
            self.clock.play()
        else:
            self.clock.playing = False
            return
        self._show_protocol_samples()

    # -- documents ------------------------------------------------------------------------------------

    def _document_sender(self, twin: LiveRobot) -> Callable[[JsonObject], object]:
        return lambda document: self.send(self._with_robot_name(twin, document))

    def _with_robot_name(self, twin: LiveRobot, document: JsonObject) -> JsonObject:
        """Return a document of a robot with the robot's name, which version 1 of the stream protocol lacks."""
        if self.is_single_robot:
            return document
        return {**document, "robot": twin.name}

    def welcome(self) -> list[JsonObject]:
        """Return the documents for a new client: tip paths and workspaces."""
        documents = []
        for twin in self.twins.values():
            for document in twin.welcome():
                documents.append(self._with_robot_name(twin, document))
        return documents

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
        robots = []
        for name, twin in self.twins.items():
            if self.is_single_robot:
                return shared | twin.state()
            robots.append({"name": name, **twin.state()})
        return {**shared, "robots": robots}
