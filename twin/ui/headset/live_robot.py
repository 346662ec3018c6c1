"""A live robot: playback, dragging, readings; only completely solved states are sent.

All data are in the base frame of the robot. The module `live` owns the clock and advances its time. All methods are
called in the event loop. Jobs run one at a time in the worker thread; their results are applied between two ticks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twin.api import Robot
from twin.core.errors import TwinError, unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.model.scene import Place
from twin.reference.states import Assembly
from twin.ui.headset import description
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.changed_distances import ChangedDistances
from twin.ui.headset.client_hold import ClientHold, hold_of, move_of
from twin.ui.headset.client_messages import (
    DistanceMessage,
    DragMessage,
    GrabMessage,
    PostureMessage,
    RefusedError,
    ReleaseMessage,
    RobotMessage,
    UndoMessage,
    VariantMessage,
    WorkspaceMessage,
)
from twin.ui.headset.displayed_state import DisplayedState
from twin.ui.headset.ghost import Ghost
from twin.ui.headset.reachable_points import ReachablePoints
from twin.ui.headset.solver_thread import SolverThread
from twin.ui.headset.state_document import reading_entries, trocar_entries
from twin.ui.headset.streamed_playback import StreamedPlayback, path_document
from twin.ui.session import readings
from twin.ui.session.driven_machine import DrivenMachine
from twin.ui.session.movable_robot import MAX_UNDOS, MovableRobot, MoveResult, start_of
from twin.ui.session.patient import Patient
from twin.ui.session.readings import RobotReading
from twin.ui.session.timeline import TICK_RATE, Clock, Planner, Playback, protocols_of
from twin.ui.session.trocars import rcm_at

READING_TICKS = 6
"""Number of ticks between two readings."""


class LiveRobot:
    """A robot that plays protocols and is moved by clients; see `ask`, `poll` and `state`.

    Attributes:
        movable: state of the robot while it does not play; only jobs of the worker thread change it.
        clock: clock of the playback; all robots of a scene share this clock.
        patients: patients by protocol name.
        send: function that sends a document to all clients.
        planned: function called when a protocol has been planned.
        is_at_opening_state: whether the robot is still where the page opens (`start` of its description), not in its
            protocol.
    """

    def __init__(
        self,
        robot: Robot,
        source: str,
        protocol: str | None = None,
        plans: bool = True,
        clock: Clock | None = None,
        place: Place | None = None,
        machine: DrivenMachine | None = None,
    ) -> None:
        """Create the robot and, if `plans` is True, start planning the protocol.

        Args:
            robot: the robot.
            source: argument of `twin.load`, for processes that load the robot again.
            protocol: the initial protocol; None: the robot's default protocol.
            plans: whether the robot plans and plays protocols.
            clock: clock of the playback; None: a new clock.
            place: the robot's place in a scene, which has its own surroundings. None: there is no scene, and the
                patients of the robot's protocols can be shown.
            machine: a machine that follows the tool while a client drags the robot, and that the robot follows while
                no client holds it; None: none. This object closes it.
        """
        self._machine = machine
        self.robot = robot
        self.source = source
        self.place = place
        self.send: Callable[[JsonObject], object] = lambda document: None
        self.planned: Callable[[], object] = lambda: None
        self.movable = MovableRobot(robot)
        self.is_at_opening_state = bool(start_of(robot))
        self.links = tuple(b.name for b in self.movable.mechanism.bodies)
        self.clock = Clock() if clock is None else clock
        self._worker = SolverThread(
            lambda e: self._send_failure(f"internal error, {type(e).__name__}: {e}. Please report it.")
        )
        self._ghost = Ghost(self.movable)
        self._workspace = ReachablePoints(self.movable, source)
        self._distances = ChangedDistances(self.movable)
        self._hold: ClientHold | None = None
        self._dragged_hold: ClientHold | None = None  # the last hold with a drag: the machine follows it
        self._undo_states: list[Array] = []  # joint values at the begin of each grab, the newest last
        self._protocols = protocols_of(robot, protocol)
        self._planner: Planner | None = None
        self._streamed: StreamedPlayback | None = None
        self._sample: int | None = None
        self._planned_name = ""
        self._reading: RobotReading | None = None
        self._planning_error = ""
        self._tick = -1.0
        self._tick_of_reading = -float(READING_TICKS)
        self._tick_of_move = -1.0
        self._waiting_move: Callable[[], MoveResult] | None = None
        self._shown = self._displayed_state(self.movable.assembly, None)
        self.patients: dict[str, Patient] = {}
        if place is None:
            self.patients = description.patients_of(robot, self.movable, self._protocols)
        self.description = description.describe(robot, self.movable, self._protocols, self.patients, place)
        self.description["distances"] = self._distances.describe()
        first = self._first_protocol(protocol)
        if first is not None and plans:
            self._plan(first)

    def _first_protocol(self, protocol: str | None) -> str | None:
        """Return the name of the initial protocol, or of the default one; None if there is neither."""
        for name, source in self._protocols.items():
            if source == protocol:
                return name
        for about in self.description["protocols"]:
            if about["is_default"]:
                return about["name"]
        return None

    def close(self) -> None:
        """End all processes and threads."""
        if self._planner is not None:
            self._planner.close()
            self._planner = None
        self._workspace.close()
        self._worker.close()
        if self._machine is not None:
            self._machine.close()

    # -- time -----------------------------------------------------------------------------------------

    def poll(self, tick: float) -> None:
        """Apply a finished plan and a waiting request for a move at the start of a tick."""
        self._tick = tick
        if self._planner is not None and self._planner.done:
            self._receive_plan()
        if self._waiting_move is not None:
            self._move(self._waiting_move)

    def advance_machine(self, passed: float) -> None:
        """Let a machine follow the tool while a client drags the robot; otherwise, show the robot where it stands.

        `passed` is the time in s since the last call. While a protocol is shown, the machine rests; after a grab, it
        rests until the first drag.
        """
        machine = self._machine
        if machine is None:
            return
        hold = self._hold
        if hold is not None and hold is not self._dragged_hold:
            machine.advance(passed, None, True)
            return
        if hold is not None:
            tool = self.movable.mechanism.frame(self.movable.mechanism.tool)
            T_base_body = wire.pose_of(self._shown.poses[self.links.index(tool.body)])
            machine.advance(passed, T_base_body @ tool.T_body_frame, True)
            return
        machine.advance(passed, None, False)
        at = machine.elsewhere(np.array(self._shown.q, float))
        if at is not None and self._sample is None and not self._worker.waits("move"):
            self._move(lambda: self.movable.move_joints(at))

    def update_readings(self) -> None:
        """Update the readings every `READING_TICKS` ticks, and send new workspace points."""
        if self._tick - self._tick_of_reading >= READING_TICKS:
            self._tick_of_reading = self._tick
            self._ask_readings()
        for document in self._workspace.poll():
            self.send(document)

    def pose_of(self, link: str) -> Array:
        """Return T_world_link (4, 4) of a link as it is displayed."""
        T_base_link = wire.pose_of(self._shown.poses[self.links.index(link)])
        if self.place is None:
            return T_base_link
        return self.place.T_world_base @ T_base_link

    @property
    def content_key(self) -> tuple[object, ...]:
        """Key of the present frame's content; frames with equal keys have the same poses, flags and protocol time."""
        return self._shown, self.flags, self.clip_time

    def frame(self, seq: int, server_time: float) -> bytes:
        """Return a frame of the present state as bytes."""
        shown = self._shown
        body = wire.pack_body(shown.poses, shown.q, shown.ghost)
        return wire.pack(seq, server_time, self.clip_time, self.flags, body, len(shown.poses), len(shown.q))

    @property
    def duration(self) -> float:
        """Duration of the protocol in s; 0 without a protocol."""
        if self._streamed is None:
            return 0.0
        return self._streamed.playback.duration

    @property
    def missing_protocol_reason(self) -> str:
        """Reason why there is no protocol to play; "" if there is a protocol."""
        if self._streamed is not None:
            return ""
        if self._planner is not None:
            return "the protocol is being planned"
        return self._planning_error or "none is loaded"

    @property
    def name(self) -> str:
        """Name of the robot's place in the scene; without a scene, the robot's own name."""
        if self.place is None:
            return self.robot.name
        return self.place.name

    @property
    def name_in_messages(self) -> str:
        """Name of the robot in messages: the name of its place in a scene, else "the robot"."""
        if self.place is None:
            return "the robot"
        return self.place.name

    @property
    def clip_time(self) -> float:
        """Protocol time in s of the displayed sample; if no sample is displayed, the clock's time."""
        if self._streamed is None or self._sample is None:
            return self.clock.time
        return float(self._streamed.playback.t[self._sample])

    @property
    def flags(self) -> int:
        """Flags of the present frame: `wire.GHOST_FLAG`, `wire.PLAYING_FLAG`, `wire.REFUSED_FLAG`, `wire.HELD_FLAG`."""
        shown = self._shown
        return (
            wire.GHOST_FLAG * (shown.ghost is not None)
            | wire.PLAYING_FLAG * self.clock.playing
            | wire.REFUSED_FLAG * bool(shown.reason or self._machine_problem)
            | wire.HELD_FLAG * (self._hold is not None)
        )

    # -- requests of clients --------------------------------------------------------------------------

    @property
    def holder(self) -> str | None:
        """Identifier of the client that holds the robot; None: no client."""
        if self._hold is None:
            return None
        return self._hold.client

    def ask(self, client: str, message: RobotMessage) -> None:
        """Handle a request of a client.

        Raises:
            RefusedError: the request is refused; nothing has changed.
        """
        if isinstance(message, DragMessage):
            self._drag(client, message)
        elif isinstance(message, ReleaseMessage):
            self.release(client)
        elif isinstance(message, VariantMessage):
            self._choose_variant(message.name)
        elif isinstance(message, DistanceMessage):
            self.require_free_for(client)
            self._change_distance(message)
            self.end_hold(client)
        elif isinstance(message, WorkspaceMessage):
            self._workspace.ask(message.on)
        elif isinstance(message, GrabMessage):
            self.require_free_for(client)
            self._grab(client, message)
        elif isinstance(message, PostureMessage):
            self.require_free_for(client)
            self._go_to_posture(message.name)
            self.end_hold(client)
        elif isinstance(message, UndoMessage):
            self.require_free_for(client)
            self._undo()
            self.end_hold(client)
        else:
            self.require_free_for(client)
            if message.name not in self._protocols:
                raise RefusedError("unknown", unknown("protocol", message.name, self._protocols))
            self.is_at_opening_state = False
            self._plan(message.name)
            self.end_hold(client)

    def require_free_for(self, client: str) -> None:
        """Check that no other client holds the robot.

        Raises:
            RefusedError: another client holds the robot.
        """
        if self._hold is not None and self._hold.client != client:
            raise RefusedError("held", f"{self._hold.client} holds {self.name_in_messages}")

    def end_hold(self, client: str) -> None:
        """Release the robot if this client holds it, without clearing the message about the last refused request."""
        if self.holder == client:
            self._hold = None

    def release(self, client: str) -> None:
        """Release the robot if this client holds it, and clear the message about the last refused request."""
        if self.holder == client:
            self._hold = None
            self._shown = replace(self._shown, reason="")
            self._worker.ask("let go", self.movable.clear_message, lambda _: None)

    def _grab(self, client: str, message: GrabMessage) -> None:
        hold = hold_of(client, message, self.movable)
        self._undo_states = [*self._undo_states[1 - MAX_UNDOS :], np.array(self._shown.q, float)]
        self._leave_protocol()
        if hold.target != "tool":
            self._worker.ask("prepare", self.movable.solver.prepare, lambda _: None)
        self._hold = hold
        if self._machine is not None:
            self._machine.grabbed()

    def _leave_protocol(self) -> None:
        """Stop playing, and set the robot to the present pose of the protocol."""
        self.clock.playing = False
        self._waiting_move = None
        self._worker.drop("look", "move")
        if self._streamed is None or self._sample is None:
            return
        # the job runs later, when these attributes may have changed
        streamed = self._streamed
        k = self._sample
        movable = self.movable
        self._sample = None

        def job() -> None:
            movable.show(movable.model.state(streamed.playback.x[k]), streamed.playback.Ts_base_tool[k])

        self._worker.ask("settle", job, lambda _: None)

    def _drag(self, client: str, message: DragMessage) -> None:
        self.require_free_for(client)
        if self._hold is None:
            raise RefusedError("not_held", "grab first, then drag")
        self._move(move_of(self._hold, message, self.movable))
        self._dragged_hold = self._hold

    def _require_no_machine(self, request: str) -> None:
        """Check that no machine leads the robot, which then stands where the machine stands unless a client holds it.

        Raises:
            RefusedError: there is a machine.
        """
        if self._machine is not None:
            robot = self.name_in_messages
            text = f"{robot} stands where its machine stands, and {request} moves no machine: drag the tool instead"
            raise RefusedError("refused", text)

    def _go_to_posture(self, name: str) -> None:
        if name not in self.movable.postures:
            raise RefusedError("unknown", unknown("posture", name, self.movable.postures))
        self._require_no_machine("a posture")
        self._leave_protocol()
        self._move(lambda: self.movable.go_to_posture(name))

    def _undo(self) -> None:
        """Move to the joint values at the begin of the last grab that moved the robot."""
        self._require_no_machine("undo")
        q_now = np.array(self._shown.q, float)
        while self._undo_states and np.abs(self._undo_states[-1] - q_now).max(initial=0.0) < 1e-9:
            self._undo_states.pop()
        if not self._undo_states:
            raise RefusedError("refused", f"nothing to undo: {self.name_in_messages} has not been moved by a grab")
        q = self._undo_states.pop()
        self._leave_protocol()
        self._move(lambda: self.movable.move_joints(q))

    def _choose_variant(self, name: str | None) -> None:
        if name is not None and name not in self.description["variants"]:
            raise RefusedError("unknown", unknown("variant", name, self.description["variants"]))
        self._ghost.forget(name)

        def done(error: str) -> None:
            if error and self._ghost.variant == name:
                self._ghost.variant = None
                self._send_failure(error)
            self._refresh_ghost()

        self._worker.ask("variant", lambda: self._ghost.choose(name), done)

    def _change_distance(self, message: DistanceMessage) -> None:
        index = message.index
        if index is not None and index >= len(self._distances):
            text = f"there is no distance {index}: {self.name_in_messages} has {len(self._distances)}, counted from 0"
            raise RefusedError("unknown", text)
        self._leave_protocol()

        def job() -> DisplayedState:
            reason = self._distances.change(index, message.value)
            return self._displayed_state(self.movable.assembly, self._ghost.present_pose(), reason)

        def done(shown: DisplayedState) -> None:
            self._sample = None
            self._show(shown)

        self._worker.ask("distance", job, done)

    def _send_failure(self, text: str) -> None:
        self.send({"type": "error", "code": "failed", "message": text[:500]})

    # -- jobs and their results -----------------------------------------------------------------------

    def _move(self, move: Callable[[], MoveResult]) -> None:
        """Execute the newest request for a move of the robot, at most one per tick, and display the result."""
        if self._tick_of_move == self._tick:  # only one solution is displayed per tick
            self._waiting_move = move
            return
        self._tick_of_move = self._tick
        self._waiting_move = None
        hold = self._hold

        def job() -> tuple[DisplayedState, bool]:
            result = move()
            # a move that continues has not been refused
            reason = "" if result.more else result.reason
            return self._displayed_state(self.movable.assembly, self._ghost.present_pose(), reason), result.more

        def done(result: tuple[DisplayedState, bool]) -> None:
            shown, more = result
            if hold is not None and self._hold is not hold:  # already released: ignore the refused target
                shown = replace(shown, reason="")
            elif more and self._waiting_move is None and self._sample is None:
                self._waiting_move = move
            if self._sample is None:
                self._show(shown)

        self._worker.ask("move", job, done)

    def _displayed_state(self, assembly: Assembly, ghost: Array | None, reason: str = "") -> DisplayedState:
        poses = wire.sevens(np.stack([assembly.link_poses[n] for n in self.links]))
        return DisplayedState(poses, assembly.q, ghost, reason)

    def _show(self, shown: DisplayedState) -> None:
        """Display a state, with each quaternion's sign chosen for continuity with the previously displayed state."""
        self._shown = shown.continued_from(self._shown)

    def _refresh_ghost(self) -> None:
        """Display the present state again, because the ghost has changed."""
        if self._sample is not None:
            self.show_protocol_sample()
        else:
            self._move(lambda: self.movable.last_move)

    def show_protocol_sample(self) -> None:
        """Display the sample of the protocol at the clock's time."""
        streamed = self._streamed
        if streamed is None:
            return
        self.is_at_opening_state = False
        k = int(np.clip(round(self.clock.time * TICK_RATE), 0, len(streamed.playback.t) - 1))
        self._waiting_move = None
        self._worker.drop("move")
        if self.movable.edited:  # the stored link poses are those of the robot as it was loaded
            self._sample = None
            playback = streamed.playback
            self._move(lambda: self.movable.follow_sample(playback.x[k], playback.Ts_base_tool[k]))
            return
        self._sample = k
        self._show(DisplayedState(streamed.poses[k], streamed.playback.q[k], self._ghost.pose_at_sample(k)))

    def _ask_readings(self) -> None:
        if self._worker.waits("look"):
            return
        # the job runs later, when these attributes may have changed
        streamed = self._streamed
        sample = self._sample
        time = self.clock.time
        movable = self.movable

        def job() -> RobotReading:
            if streamed is None:
                return readings.read(movable)
            if sample is not None:
                movable.show(movable.model.state(streamed.playback.x[sample]), streamed.playback.Ts_base_tool[sample])
            return readings.read(movable, rcm_at(streamed.playback, time))

        def done(reading: RobotReading) -> None:
            self._reading = reading

        self._worker.ask("look", job, done)
        if self._ghost.has_unprocessed_samples:
            self._worker.ask("ghost", self._ghost.process_samples, self._continue_ghost)

    def _continue_ghost(self, is_incomplete: bool) -> None:
        if not is_incomplete:
            return
        if self._ghost.has_unprocessed_samples:
            self._worker.ask("ghost", self._ghost.process_samples, self._continue_ghost)
        elif self._ghost.is_nowhere_solved:
            text = (
                f"{self._ghost.variant}: these equations give no tool pose at any joint values of the protocol; the "
                "ghost is not shown"
            )
            self._send_failure(text)
        if self._sample is not None:
            self.show_protocol_sample()

    # -- protocols ------------------------------------------------------------------------------------

    def _plan(self, name: str) -> None:
        if self._planner is not None:
            self._planner.close()
        self.clock.playing = False
        self._planned_name = name
        self._planning_error = ""
        self._planner = Planner(self.source, self._protocols[name])

    def _receive_plan(self) -> None:
        assert self._planner is not None
        answer = self._planner.answer
        self._planner.close()
        self._planner = None
        if not isinstance(answer, Playback):
            self._planning_error = str(answer)
            self._send_failure(f"{self._planned_name}: {answer}")
            return
        playback = answer
        movable = self.movable

        def job() -> StreamedPlayback | TwinError:
            protocol = self.robot.protocol(self._protocols[playback.protocol])
            bound = self.robot.bound(protocol)
            if bound is not movable.robot:
                try:
                    movable.bind(bound)
                except TwinError as error:  # a changed design may not fit these trocars
                    return error
            movable.use_tool_frame_of(protocol)
            links = movable.model.link_poses(playback.x)
            poses = np.stack([wire.sevens(links[name]) for name in self.links], axis=1)
            self._ghost.follow(playback)
            return StreamedPlayback(playback, poses)

        def done(streamed: StreamedPlayback | TwinError) -> None:
            if isinstance(streamed, TwinError):
                self._planning_error = str(streamed)
                self._send_failure(f"{playback.protocol}: {streamed}")
                return
            self._streamed = streamed
            self.send(path_document(streamed))
            self.planned()

        self._worker.ask("plan", job, done)

    def welcome(self) -> list[JsonObject]:
        """Return the documents for a new client: tip path and workspace."""
        return [path_document(self._streamed), *self._workspace.sent]

    def state(self) -> JsonObject:
        """Return the robot's part of the document `state`."""
        playback = None
        protocol = None
        phases: list[list[object]] = []
        phase = None
        if self._streamed is not None:
            playback = self._streamed.playback
            protocol = playback.protocol
            phases = [list(phase) for phase in playback.phases]
            if self._sample is not None:
                phase = playback.phase(self.clip_time)
        shown = self._shown
        distance_to_ghost = shown.ghost_to_tool_distance(self.links, self.description["tool"])
        trocars = trocar_entries(self.movable, playback, self.clock.time)
        return {
            "time": self.clip_time,
            "duration": self.duration,
            "protocol": protocol,
            "phases": phases,
            "phase": phase,
            "planning": self._planned_name if self._planner is not None else None,
            "holder": self.holder,
            "reason": shown.reason or self._planning_error or self._machine_problem or None,
            **reading_entries(self._reading, distance_to_ghost),
            "rcm": trocars[0]["at"] if trocars else None,
            "trocars": trocars,
            "variant": self._ghost.variant,
            "distances": [[index, value] for index, value in sorted(self._distances.values.items())],
            "workspace": self._workspace.on,
            "postures": list(self.movable.postures),
            **({} if self._machine is None else {"machine": self._machine.state()}),
        }

    @property
    def _machine_problem(self) -> str:
        """Reason why the machine does not follow the robot that a client holds; "" if it does, or there is none."""
        if self._machine is None or self._hold is None:
            return ""
        return self._machine.problem
