"""Control a scene from its console: step the World in real time, give one client control of the hands, make reports.

The hand states of a client are passed to the input device `GivenHands`. Silence, jumps and limits are reported in the
state and in the log. Web page and viewer both use `LiveConsole`; each has its own display and source of hand states.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from twin.core.atomic import Scratch
from twin.core.errors import TwinError, unknown
from twin.core.jobs import Call
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.kinematics.closed_loops.placing import LinkPoses
from twin.model.movable import Movable
from twin.model.trainer import MODEL
from twin.simulation import console_scene, contact_scene, operating_scene
from twin.simulation.condition import Condition
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.pivot import FULCRUMS, Fulcrum
from twin.simulation.controllers.trainer import Mode
from twin.simulation.devices.given import GivenHands, HandState
from twin.simulation.devices.together import Together
from twin.simulation.plants.tissue import clips_of
from twin.simulation.session import guiding, rings
from twin.simulation.session.camera_referee import CameraReferee
from twin.simulation.session.procedure_guide import ProcedureGuide
from twin.simulation.session.run import SAMPLE, head_of
from twin.simulation.session.tape import Tape
from twin.simulation.setup import Member, Setup
from twin.simulation.world import World
from twin.ui.session.console_state import ConsoleState, log_changes
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.feed import Feed
from twin.ui.session.force_peaks import ForcePeaks
from twin.ui.session.live_machines import LiveMachines
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.plan_mode import PlanMode
from twin.ui.session.recorder import Recorder
from twin.ui.session.world_feed import WorldFeed

_BUDGET, _CHUNK = 0.012, 4
"""Real time in s after which a call of `advance` stops stepping the World; number of steps between two checks of the
time."""

_OWED = 0.1
"""Maximum delay in s that the World makes up for by later steps; the rest of a longer delay is never made up for."""

_NICE = 10
"""Increase of the nice value of the process that makes a report; its lower priority keeps the World in real time."""

PlanStep = Literal["aim", "find", "accept", "cancel"]


class HeldError(TwinError):
    """Another client controls the hands, or the task has ended."""


class LiveConsole:
    """The robots of a scene, controlled by the scene's console in real time.

    Attributes:
        scene: the scene.
        world: the World.
        device: the input device, which receives the hand states of a client.
        owner: identifier of the client whose hands control the robots; None: no client.
        members: mechanism and equations of each robot, by name of the robot's place.
        task: the task; None: no task.
        objects: the movable objects of the World.
        referee: judge of a task with rings or a wire, of the camera task or of a procedure; None for other tasks.
        feed: source of the deformables: in a procedure the World, otherwise the loaded scene; None: no deformables.
        machines: connections to machines; None: there are none.
        planning: planning mode of the arms.
        shown: mechanism and equations of each displayed robot; contains `members` and the models of the machines.
        attempt: number of the present attempt, from 1.
        condition: condition of the experiment, which is stored in the session file.
        reading: the last state: controlled arms, arms at a limit, and the reason if nothing moves.
    """

    _device_type: type[GivenHands] = GivenHands

    def __init__(self, loaded: LoadedScene, exercise: Exercise = NO_TASK) -> None:
        """Create the World with the robots at the places of the scene.

        Raises:
            TwinError: the scene has no console, its robots do not match the console, or its props do not match the
                task.
            WorldError: a link is inside an organ at the start.
            OutputError: the session cannot be written.
        """
        scene, task = loaded.scene, exercise.task
        self.scene, self.table, self.task = scene, console_scene.console_of(scene), task
        self._make_report = exercise.report
        self._first = console_scene.settings(scene, exercise.fulcrum, task)
        self.device = self._device_type(console_scene.PEDALS, HANDS, self.table.scale, settings=self._first)
        self.machines = None if loaded.machines is None else LiveMachines(scene, loaded.machines, self.device)
        self.members = {n: Member(r.mechanism, r.kinematics(), LinkPoses(r.loops)) for n, r in loaded.robots.items()}
        self.planning = PlanMode(scene, self.members, lambda: self.world)
        on = scene.haptics is None or scene.haptics.on
        self.condition = exercise.condition or Condition(haptics=on)
        self._setup = Setup(scene, self.members, task, loaded.props, self.condition, loaded.organs)
        self.device.feel(self.condition.haptics)
        operates = self._setup.procedure is not None
        self.objects: Sequence[Movable] = clips_of(scene.tools) if operates else self._setup.objects
        judged = task is not None and bool(task.grasps or task.alignment or task.procedure)
        self._scratch, self._session = None, exercise.session
        if self._session is None and judged and self._make_report is not None:
            self._scratch = Scratch()
            self._session = Path(self._scratch.name) / "hands.session"
        self.owner: str | None = None
        self._places = {p.name: p for p in (*scene.places, *(scene.models if self.machines else ()))}
        self.shown = {n: self.members[n.removesuffix(MODEL)] for n in self._places}
        self._camera = scene.cameras[self.table.camera].robot
        self._report: tuple[int, Call] | None = None
        self.attempt = 0
        self._begin()
        self.feed: Feed | None = loaded.feed
        if operates:
            self.feed = WorldFeed(lambda: self.world, operating_scene.organ_of(self._setup))
        self.reading = self._read()

    # -- the task -------------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Make the World of a new attempt; if this fails, the present World remains."""
        path, attempt = self._session, self.attempt + 1
        if path is not None and attempt > 1:
            path = path.with_name(f"{path.stem}-{attempt}{path.suffix}")
        tape = None if path is None else Tape()
        setup, task, referee = self._setup, self.task, None
        if task is not None and task.transfers:
            pegs, robots = contact_scene.pegs(self.scene, setup.props, task), [*console_scene.hands_of(self.scene)]
            referee = rings.Referee(task, self.objects, pegs, robots, SAMPLE)
        elif task is not None and task.guide is not None:
            referee = guiding.Referee.of(setup, SAMPLE)
        elif task is not None and task.alignment is not None:
            referee = CameraReferee(self._camera, SAMPLE)
        elif task is not None and task.procedure is not None:
            referee = ProcedureGuide(setup, [f"{item.name}.on" for item in self.objects], console_scene.ORGANS)
        peaks, states, outbox, parts = ForcePeaks(HANDS), [], [], None
        if self.machines is not None:
            states, packets = self.machines.connect()
            outbox, parts = [packets], self.machines.parts
        device = Together([self.device, self.planning.plans, *states])
        watch = [block for block in (peaks, *outbox, referee, tape) if block is not None]
        world = console_scene.world(setup, device, records=False, watch=watch, parts=parts)
        recorder = None
        if path is not None and tape is not None:
            recorder = Recorder(path, head_of(setup, world, device), tape)
        self.world: World = world
        self._state, self._peaks = ConsoleState(setup, world), peaks
        self.referee, self.recorder, self.attempt = referee, recorder, attempt
        self._owed, self._rate, self._stopped, self._over = 0.0, 1.0, "", ""

    def restart(self, client: str) -> None:
        """Begin a new attempt, with objects, robots and measures as at the start of the first attempt.

        Raises:
            HeldError: another client controls the hands.
            TwinError: there is no task that can be judged, or the session file of the new attempt cannot be written.
        """
        self._require_task()
        self.require_free(client)
        old, ticks = self.recorder, self.world.tick
        self.planning.reset()
        for robot in {} if self.task is None or self.task.procedure is None else self.task.procedure.start:
            self.device.set(f"{robot}.tool", self._first[f"{robot}.tool"])
        self._begin()
        if old is not None:
            old.close(ticks)
        self.owner = None
        self.device.leave()
        self.device.feel(self.condition.haptics)
        self.reading = self._read()

    def end(self, client: str) -> None:
        """End the present attempt; nothing moves until the next attempt begins.

        Raises:
            HeldError: another client controls the hands.
            TwinError: there is no task that can be judged.
        """
        self._require_task()
        self.require_free(client)
        if not self._over:
            self._finish("The task was ended.")

    def _require_task(self) -> None:
        if self.referee is None:
            raise TwinError("there is no task to end or restart: start this program with --task")

    def _finish(self, why: str) -> None:
        """Stop the World, complete the session file, and begin to make the report."""
        self._over, self.owner = why, None
        self.planning.reset()
        self.device.leave()
        if self.recorder is None:
            return
        self.recorder.close(self.world.tick)
        if self._make_report is not None and self.recorder.path.is_file():
            if self._report is not None:
                self._report[1].close()
            files = str(self.recorder.path), str(self.scene.file)
            self._report = self.attempt, Call(self._make_report, *files, nice=_NICE)

    def report(self) -> tuple[int, bytes | None, str] | None:
        """Return the newest report: (number of the attempt, page as bytes, error); None if there is no report yet.

        While the report is being made, the page is None and the error is "". After a failure, the page is None and the
        error is the reason.
        """
        if self._report is None:
            return None
        attempt, call = self._report
        if not call.done:
            return attempt, None, ""
        try:
            return attempt, call.result(), ""
        except TwinError as error:
            return attempt, None, str(error)

    def close(self) -> None:
        """Complete the session file, and remove temporary files."""
        self.planning.close()
        if self.recorder is not None:
            self.recorder.close(self.world.tick)
        if self._report is not None:
            self._report[1].close()
        if self._scratch is not None:
            self._scratch.cleanup()
        if self.machines is not None:
            self.machines.close()

    # -- time -----------------------------------------------------------------------------------------

    def advance(self, passed: float) -> list[str]:
        """Step the World by the elapsed real time `passed` in s; log changes, and return messages for all clients.

        If this computer is too slow, the World runs slower than real time. After an error, the World remains stopped.
        """
        if not self._stopped and not self._over and passed > 0:
            self._step(passed)
            self._judge()
            self.planning.poll(self.arm(self.planning.hand) if self.planning.hand else "")
        old, self.reading = self.reading, self._read()
        return log_changes(old, self.reading, self.device.patience)

    def _judge(self) -> None:
        """End the attempt if the task is completed, or if the session file is full."""
        if self.referee is None:
            return
        if self.referee.complete:
            self._finish(self.referee.ending)
        elif self.recorder is not None and not self.recorder.running:
            self._finish("The task was ended: the session is no longer recorded.")

    def _step(self, passed: float) -> None:
        dt, end = self.world.dt, time.monotonic() + _BUDGET
        self._owed += passed
        wanted = done = int(self._owed / dt + 1e-6)
        try:
            while done > 0:
                n = min(done, self._chunk)
                self._before_steps(math.ceil(done / self._chunk))
                self.world.step(n)
                done -= n
                if time.monotonic() > end:
                    break
        except TwinError as error:
            self._stopped = str(error)
            logging.getLogger(__name__).error("the World has stopped: %s", error)
        self._after_steps(done > 0)
        self._owed = min(self._owed - (wanted - done) * dt, _OWED)
        share = min(1.0, passed) * 0.5
        self._rate += share * ((wanted - done) * dt / passed - self._rate)

    @property
    def _chunk(self) -> int:
        """Number of steps of the World in a group."""
        return _CHUNK

    def _before_steps(self, parts: int) -> None:
        """Prepare a group of steps of the World; `parts` is the number of remaining groups, including this one."""
        if self.machines is not None:
            self.machines.exchange.send()
            self.machines.exchange.receive()

    def _after_steps(self, behind: bool) -> None:
        """Do the work after the steps of a call of `advance`; `behind`: whether time was too short for all steps."""
        if self.machines is not None:
            self.machines.exchange.send()
        if self.recorder is not None:
            self.recorder.write(self.world.tick)

    # -- hands ----------------------------------------------------------------------------------------

    def give(self, client: str, right: HandState, left: HandState) -> None:
        """Accept the states of both hands from a client.

        Raises:
            HeldError: another client controls the hands, or the task has ended.
        """
        if self._over:
            raise HeldError(f"{self._over} Restart the task to move the instruments.")
        self.own(client)
        for state in (right, left):
            self.device.give(state)

    def own(self, client: str) -> None:
        """Give a client control of the hands.

        Raises:
            HeldError: another client controls the hands.
        """
        self.require_free(client)
        if self.owner != client:
            self.device.leave()
            self.owner = client

    @property
    def silent(self) -> bool:
        """Whether at least one hand is silent: no state of this hand has been received for `device.patience` s."""
        return any(self.device.silent(hand, self.world.t) for hand in (0, 1))

    def rescale(self, client: str, scale: float) -> None:
        """Set the motion scale.

        Raises:
            HeldError: another client controls the hands.
        """
        self.require_free(client)
        self.device.rescale(scale)

    def feel(self, client: str, on: bool) -> None:
        """Switch the forces on the hands on or off.

        Raises:
            HeldError: another client controls the hands.
        """
        self.require_free(client)
        self.device.feel(on)

    def choose_fulcrum(self, client: str, fulcrum: Fulcrum) -> None:
        """Choose which end of the instruments the hands control.

        Raises:
            HeldError: another client controls the hands.
            TwinError: the scene file has no instrument lengths (`instrument_mm`).
        """
        self.require_free(client)
        if not self.table.instrument_mm:
            raise TwinError(f"scene '{self.scene.name}' has no fulcrum: add instrument_mm to its section [console]")
        self.device.set(console_scene.FULCRUM, FULCRUMS.index(fulcrum))

    def take_tool(self, client: str, hand: str, tool: str) -> None:
        """Choose the tool of the arm that a hand ("right" or "left") controls now.

        Raises:
            HeldError: another client controls the hands.
            TwinError: the scene has no such tool, or the arm cannot carry it.
        """
        self.require_free(client)
        tools, robot = self.scene.tools, self.arm(hand)
        if tool not in tools:
            raise TwinError(f"scene '{self.scene.name}': {unknown('tool', tool, tools)}")
        if robot not in tools[tool].robots:
            raise TwinError(f"{robot} cannot carry '{tool}'; only {', '.join(tools[tool].robots)} can carry it")
        self.device.set(f"{robot}.tool", list(tools).index(tool))

    def train(self, client: str, mode: Mode) -> None:
        """Request a mode of the machines' trainer: teleoperation, rehearsal, check of the rehearsed motion, or replay.

        Raises:
            HeldError: another client controls the hands.
            TwinError: the scene has no machines, or a motion is being planned or made.
        """
        self.require_free(client)
        machines = self._require_machines()
        self.planning.require_off()
        machines.ask(mode)

    def press(self, client: str, button: str) -> None:
        """Press the button "start" or "stop" of all machines; every client may press "stop".

        Raises:
            HeldError: another client controls the hands.
            TwinError: the scene has no machines.
        """
        if button != "stop":
            self.require_free(client)
        self._require_machines().press(button)

    def _require_machines(self) -> LiveMachines:
        if self.machines is None:
            raise TwinError(
                f"scene '{self.scene.name}' has no machines: add a section [trainer] to {self.scene.file.name}"
            )
        return self.machines

    def plan(self, client: str, do: PlanStep, hand: str) -> None:
        """Do a step of planning mode for the arm of a hand ("right" or "left"); every client may cancel.

        "aim": let the hand move the target of the arm. "find": plan a motion to the target. "accept": let the arm make
        the planned motion. "cancel": end planning mode; an arm that moves stops where it is.

        Raises:
            HeldError: another client controls the hands, or the task has ended.
            TwinError: this step is not possible now.
        """
        if do == "cancel":
            return self.planning.cancel()
        if self._over:
            raise HeldError(f"{self._over} Restart the task to plan a motion.")
        self.require_free(client)
        if do == "aim":
            return self.planning.aim(hand, self.arm(hand))
        return self.planning.find() if do == "find" else self.planning.accept()

    def release(self, client: str) -> None:
        """End the control of the robots by this client, if this client controls them."""
        if self.owner == client:
            self.owner = None
            self.device.leave()

    def require_free(self, client: str) -> None:
        """Check that no other client controls the hands; a client whose hands are silent is ignored.

        Raises:
            HeldError: another client controls the hands.
        """
        if self.owner not in (None, client) and not self.silent:
            raise HeldError(f"{self.owner} controls the hands of the console; wait until it releases them")

    # -- state ----------------------------------------------------------------------------------------

    def arm(self, hand: str) -> str:
        """Return the name of the robot that a hand ("right" or "left") controls now."""
        arms = getattr(self.table, hand)
        return arms[int(self.world.signals["console.taps"][0]) % len(arms)]

    def tool(self, hand: str) -> Array:
        """Return the present pose (4, 4) in the World of the tool that a hand controls."""
        name = self.arm(hand)
        q, goal = self.world.signals[f"{name}.q"], self.world.signals[f"{name}.goal"].reshape(4, 4)
        return self._places[name].T_world_base @ self.members[name].kin.forward(q, goal)

    def moved(self, hand: str) -> Array:
        """Return the pose (4, 4), in the World, of the object that a hand moves: its tool, or the target of a plan."""
        if self.planning.phase != "aim" or self.planning.hand != hand:
            return self.tool(hand)
        name = self.planning.robot
        return self.place(name) @ self.world.signals[f"{name}.target"][1:].reshape(4, 4)

    def place(self, robot: str) -> Array:
        """Return T_world_base (4, 4) of a robot."""
        return self._places[robot].T_world_base

    def goal(self, hand: str) -> Array:
        """Return the commanded pose (4, 4) in the World of the tool that a hand controls."""
        name = self.arm(hand)
        return self._places[name].T_world_base @ self.world.signals[f"{name}.goal"].reshape(4, 4)

    @property
    def view(self) -> Array:
        """Pose (4, 4) of the endoscope's picture in the World: x right, y up, z out of the picture."""
        return self.world.signals[f"{self._camera}.view"].reshape(4, 4)

    def forces(self) -> dict[str, Array]:
        """Return, for each hand, the largest force (3,) in N since the last call, in {H}, the axes of the picture."""
        return self._peaks.take()

    @property
    def camera_at(self) -> Array:
        """Present pan, tilt, depth and roll (4,) of the camera; the depth is in m, the angles are in rad."""
        return self.world.signals[f"{self._camera}.at"]

    def _read(self) -> JsonObject:
        return {
            "owner": self.owner,
            "heard": self.device.heard,
            **self._state.read({hand: self.arm(hand) for hand in HANDS}),
            "rate": round(self._rate, 1),
            "stopped": self._stopped or None,
            "task": self._task(),
            "machines": None if self.machines is None else self.machines.state(self.world),
            "plan": self.planning.state(),
        }

    def deviations(self) -> dict[str, JsonObject]:
        """Return the deviation of each machine from its model; see `LiveMachines.deviations`."""
        return {} if self.machines is None else self.machines.deviations(self.world)

    def _task(self) -> JsonObject | None:
        """Return the scoreboard of a task that is judged; None for other tasks."""
        if self.referee is None or self.task is None:
            return None
        made = self.report()
        return {
            "title": self.task.title,
            "attempt": self.attempt,
            "over": self._over or None,
            "report": None if made is None else {"attempt": made[0], "ready": made[1] is not None, "problem": made[2]},
            **self.referee.content(),
        }
