"""One robot live: it plays, it is taken by the hand, it is measured. What is sent is whole samples, never a mixture.

Everything here runs on the event loop except what is called a job: those run one after the other in the worker, and
what they find is taken over between two ticks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from twin.api import Robot
from twin.core.errors import unknown
from twin.core.spatial import Array
from twin.reference.states import Assembly
from twin.ui.headset import description
from twin.ui.headset import protocol as wire
from twin.ui.headset.ghost import Ghost
from twin.ui.headset.hold import Hold, hold_of, lead
from twin.ui.headset.protocol import RefusedError
from twin.ui.headset.reach import Reach
from twin.ui.headset.track import Shown, Track, apart, measured, path, protocols_of, trocars
from twin.ui.headset.worker import Worker
from twin.ui.session import instruments
from twin.ui.session.desk import Desk, Moved
from twin.ui.session.instruments import Reading
from twin.ui.session.planner import Planner
from twin.ui.session.timeline import RATE, Clock, Playback
from twin.ui.session.trocars import rcm_at

LOOK = 6
"""Ticks between two looks at the instruments."""

HEARTBEAT = 6
"""Ticks after which a frame is sent though nothing has moved."""


class Twin:
    """A robot that clients play and move; see `ask`, `tick` and `state`.

    Attributes:
        desk: where it stands while it is not playing; only jobs touch it.
        clock: of the protocol.
        patients: by the protocols that have one.
        send: called with every document for all clients.
    """

    replays = False

    def __init__(self, robot: Robot, source: str, protocol: str | None = None, plans: bool = True) -> None:
        """Load what there is; begin to plan the protocol, the robot's default without one, unless `plans` is false."""
        self.robot, self.source = robot, source
        self.send: Callable[[dict[str, Any]], object] = lambda document: None
        self.desk = Desk(robot)
        self.links = tuple(b.name for b in self.desk.mechanism.bodies)
        self.clock = Clock()
        self._worker = Worker(lambda e: self._failure(f"internal error, {type(e).__name__}: {e}. Please report it."))
        self._ghost, self._reach = Ghost(robot, self.desk), Reach(self.desk, source)
        self._hold: Hold | None = None
        self._protocols = protocols_of(robot, protocol)
        self._planner: Planner | None = None
        self._track: Track | None = None
        self._sample: int | None = None
        self._wanted = ""
        self._reading: Reading | None = None
        self._failed = ""
        self._tick, self._looked, self._sent, self._seq = -1, -LOOK, -HEARTBEAT, 0
        self._told: tuple[Any, ...] = ()
        self._moved, self._wish = -1, None
        self._shown = self._of(self.desk.assembly, None)
        self.patients = description.patients_of(robot, self.desk, self._protocols)
        self.description = description.describe(robot, self.desk, self._protocols, self.patients)
        first = next((n for n, p in self._protocols.items() if p == protocol), None)
        if first is None:
            first = next((p["name"] for p in self.description["protocols"] if p["is_default"]), None)
        if first is not None and plans:
            self._plan(first)

    def close(self) -> None:
        """Leave no process and no thread behind."""
        if self._planner is not None:
            self._planner.close()
            self._planner = None
        self._reach.close()
        self._worker.close()

    # -- time -----------------------------------------------------------------------------------------

    def frame(self, tick: int, server_time: float) -> bytes | None:
        """Let time go on to a tick, 1 / RATE s each; return a frame if something is to be seen or a while has passed.

        Args:
            tick: counts from 0; those that are left out are jumped over.
            server_time: s of the monotonic clock for which the frame is due.
        """
        passed = (tick - self._tick) / RATE if self._tick >= 0 else 0.0
        self._tick = tick
        if self._planner is not None and self._planner.done:
            self._take_plan()
        if self._wish is not None:
            self._move(self._wish)
        if self.clock.advance(passed):
            self._stand()
        if tick - self._looked >= LOOK:
            self._looked = tick
            self._look()
        for document in self._reach.poll():
            self.send(document)
        told = (self._shown, self.flags, self.clip_time)
        if told == self._told and tick - self._sent < HEARTBEAT:
            return None
        self._told, self._sent = told, tick
        shown = self._shown
        body = wire.pack_body(shown.poses, shown.q, shown.ghost)
        self._seq += 1
        return wire.pack(self._seq - 1, server_time, told[2], told[1], body, len(shown.poses), len(shown.q))

    @property
    def clip_time(self) -> float:
        """Time in the protocol of what is shown, in s."""
        if self._track is None or self._sample is None:
            return self.clock.time
        return float(self._track.playback.t[self._sample])

    @property
    def flags(self) -> int:
        """Flags of the present frame, see `wire.GHOST` and its like."""
        shown = self._shown
        return (
            wire.GHOST * (shown.ghost is not None)
            | wire.PLAYING * self.clock.playing
            | wire.REFUSED * bool(shown.reason)
            | wire.HELD * (self._hold is not None)
        )

    # -- what clients ask for -------------------------------------------------------------------------

    @property
    def holder(self) -> str | None:
        """Who holds the robot, or None."""
        return None if self._hold is None else self._hold.client

    def ask(self, client: str, message: wire.Message) -> None:
        """Do what a client asks for.

        Raises:
            RefusedError: it cannot be done; nothing has changed.
        """
        if isinstance(message, wire.Drag):
            return self._drag(client, message)
        if isinstance(message, wire.Release):
            return self.release(client)
        if isinstance(message, wire.Variant):
            return self._variant(message.name)
        if isinstance(message, wire.Workspace):
            return self._reach.ask(message.on)
        if self._hold is not None and self._hold.client != client:
            raise RefusedError("held", f"{self._hold.client} holds the robot")
        if isinstance(message, wire.Grab):
            return self._grab(client, message)
        if isinstance(message, wire.Speed):
            self.clock.speed = message.value
            return None
        if isinstance(message, wire.Loop):
            self.clock.loop = message.on
            return None
        if isinstance(message, wire.Posture):
            self._posture(message.name)
        elif isinstance(message, wire.Protocol):
            if message.name not in self._protocols:
                raise RefusedError("unknown", unknown("protocol", message.name, self._protocols))
            self._plan(message.name)
        else:
            self._time(message)
        self._hold = None  # whoever holds it and asks for something else lets go
        return None

    def release(self, client: str) -> None:
        """Let go, if it is this client who holds the robot."""
        if self._hold is not None and self._hold.client == client:
            self._hold = None
            self._shown = replace(self._shown, reason="")
            self._worker.ask("let go", self.desk.let_go, lambda _: None)

    def _time(self, message: wire.Message) -> None:
        if self._track is None:
            wait = "it is being planned" if self._planner is not None else self._failed or "none is loaded"
            raise RefusedError("refused", f"there is no protocol to play yet: {wait}")
        if isinstance(message, wire.Seek):
            self.clock.seek(message.t)
        elif isinstance(message, wire.Play) and message.on:
            self.clock.play()
        else:
            self.clock.playing = False
            return
        self._stand()

    def _grab(self, client: str, message: wire.Grab) -> None:
        hold = hold_of(client, message, self.desk)
        self._leave_track()
        if hold.target != "tool":
            self._worker.ask("prepare", self.desk.hand.prepare, lambda _: None)
        self._hold = hold

    def _leave_track(self) -> None:
        """Stop playing; the desk stands where the protocol was."""
        self.clock.playing, self._wish = False, None
        self._worker.drop("look", "move")
        if self._track is None or self._sample is None:
            return
        track, k, desk = self._track, self._sample, self.desk
        self._sample = None

        def job() -> None:
            desk.show(desk.model.state(track.playback.x[k]), track.playback.Ts_base_tool[k])

        self._worker.ask("settle", job, lambda _: None)

    def _drag(self, client: str, message: wire.Drag) -> None:
        hold = self._hold
        if hold is not None and hold.client != client:
            raise RefusedError("held", f"{hold.client} holds the robot")
        if hold is None:
            raise RefusedError("not_held", "grab first, then drag")
        self._move(lead(hold, message, self.desk))

    def _posture(self, name: str) -> None:
        if name not in self.desk.postures:
            raise RefusedError("unknown", unknown("posture", name, self.desk.postures))
        self._leave_track()
        self._move(lambda: self.desk.go(name))

    def _variant(self, name: str | None) -> None:
        if name is not None and name not in self.description["variants"]:
            raise RefusedError("unknown", unknown("variant", name, self.description["variants"]))
        self._ghost.forget(name)

        def done(error: str) -> None:
            if error and self._ghost.name == name:
                self._ghost.name = None
                self._failure(error)
            self._again()

        self._worker.ask("variant", lambda: self._ghost.choose(name), done)

    def _failure(self, text: str) -> None:
        self.send({"type": "error", "code": "failed", "message": text[:500]})

    # -- jobs and what they find ----------------------------------------------------------------------

    def _move(self, move: Callable[[], Moved]) -> None:
        """Let the desk move, once a tick; the newest wish counts, and what comes of it is shown."""
        if self._moved == self._tick:  # what is solved twice a tick is seen once
            self._wish = move
            return
        self._moved, self._wish = self._tick, None
        hold = self._hold

        def job() -> tuple[Shown, bool]:
            moved = move()
            reason = "" if moved.more else moved.reason
            return self._of(self.desk.assembly, self._ghost.here(), reason), moved.more

        def done(found: tuple[Shown, bool]) -> None:
            shown, more = found
            if hold is not None and self._hold is not hold:  # let go meanwhile: nobody wants what was refused
                shown = replace(shown, reason="")
            elif more and self._wish is None and self._sample is None:
                self._wish = move
            if self._sample is None:
                self._show(shown)

        self._worker.ask("move", job, done)

    def _of(self, assembly: Assembly, ghost: Array | None, reason: str = "") -> Shown:
        poses = wire.sevens(np.stack([assembly.link_poses[n] for n in self.links]))
        return Shown(poses, assembly.q, ghost, reason)

    def _show(self, shown: Shown) -> None:
        """Show a sample, its quaternions with the signs of the one before."""
        last = getattr(self, "_shown", shown)
        ghost = shown.ghost
        if ghost is not None and last.ghost is not None:
            ghost = wire.near_signs(ghost[None], last.ghost[None])[0]
        self._shown = Shown(wire.near_signs(shown.poses, last.poses), shown.q, ghost, shown.reason)

    def _again(self) -> None:
        """Show what is shown once more, with another ghost or none."""
        if self._sample is not None:
            self._stand()
        else:
            self._move(lambda: self.desk.moved)

    def _stand(self) -> None:
        """Show the sample of the protocol at the clock's time."""
        track = self._track
        if track is None:
            return
        k = int(np.clip(round(self.clock.time * RATE), 0, len(track.playback.t) - 1))
        self._sample, self._wish = k, None
        self._worker.drop("move")
        self._show(Shown(track.poses[k], track.playback.q[k], self._ghost.at(k)))

    def _look(self) -> None:
        track, k, time = self._track, self._sample, self.clock.time
        if self._worker.waits("look"):
            return
        desk = self.desk

        def job() -> Reading:
            if track is not None and k is not None:
                desk.show(desk.model.state(track.playback.x[k]), track.playback.Ts_base_tool[k])
            return instruments.read(desk, None if track is None else rcm_at(track.playback, time))

        def done(reading: Reading) -> None:
            self._reading = reading

        self._worker.ask("look", job, done)
        if self._ghost.wanting:
            self._worker.ask("ghost", self._ghost.more, self._more_ghost)

    def _more_ghost(self, more: bool) -> None:
        if not more:
            return
        if self._ghost.wanting:
            self._worker.ask("ghost", self._ghost.more, self._more_ghost)
        elif self._ghost.nowhere:
            text = f"{self._ghost.name}: these equations have no tool pose at the joints of the protocol: no ghost"
            self._failure(text)
        if self._sample is not None:
            self._stand()

    # -- protocols ------------------------------------------------------------------------------------

    def _plan(self, name: str) -> None:
        if self._planner is not None:
            self._planner.close()
        self.clock.playing = False
        self._wanted, self._failed = name, ""
        self._planner = Planner(self.source, self._protocols[name])

    def _take_plan(self) -> None:
        assert self._planner is not None
        answer = self._planner.answer
        self._planner.close()
        self._planner = None
        if not isinstance(answer, Playback):
            self._failed = str(answer)
            self._failure(f"{self._wanted}: {answer}")
            return
        playback, desk = answer, self.desk

        def job() -> Track:
            protocol = (robot := self.robot).protocol(self._protocols[playback.protocol])
            if (bound := robot.bound(protocol)) is not desk.robot:
                desk.bind(bound)
            desk.speak_of(protocol)
            links = desk.model.link_poses(playback.x)
            poses = np.stack([wire.sevens(links[n]) for n in self.links], axis=1)
            self._ghost.follow(playback)
            return Track(playback, poses)

        def done(track: Track) -> None:
            self._track = track
            self.clock.duration = track.playback.duration
            self.clock.seek(0.0)
            self.send(path(track))
            if self._hold is None:
                self._stand()

        self._worker.ask("plan", job, done)

    def welcome(self) -> list[dict[str, Any]]:
        """Return what a client must be told that comes now: path and workspace."""
        return [path(self._track), *self._reach.sent]

    def state(self) -> dict[str, Any]:
        """Return everything that is shown besides the robot itself."""
        playback = None if self._track is None else self._track.playback
        shown = self._shown
        inside = trocars(self.desk, playback, self.clock.time)
        return {
            "type": "state",
            "playing": self.clock.playing,
            "time": self.clip_time,
            "duration": self.clock.duration,
            "speed": self.clock.speed,
            "loop": self.clock.loop,
            "protocol": None if playback is None else playback.protocol,
            "phases": [] if playback is None else [list(p) for p in playback.phases],
            "phase": None if playback is None or self._sample is None else playback.phase(self.clip_time),
            "planning": self._wanted if self._planner is not None else None,
            "holder": self.holder,
            "reason": shown.reason or self._failed or None,
            **measured(self._reading, apart(shown, self.links, self.description["tool"])),
            "rcm": inside[0]["at"] if inside else None,
            "trocars": inside,
            "variant": self._ghost.name,
            "workspace": self._reach.on,
            "postures": list(self.desk.postures),
        }
