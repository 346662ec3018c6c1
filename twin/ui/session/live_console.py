"""Control a scene from its console: step the World in real time, give one client control of the hands, make reports.

The hand states of a client are passed to the device `ReceivedHands`. Silence, jumps and limits are reported in the
state and in the log. Web page and viewer both use `LiveConsole`; each has its own display and source of hand states.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import TwinError, unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.kinematics.closed_loops.placing import LinkPoses
from twin.model.movable import Movable
from twin.model.trainer import MODEL
from twin.simulation import console_scene, operating_scene
from twin.simulation.condition import Condition
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.instrument_pivot import FULCRUMS, Fulcrum
from twin.simulation.controllers.trainer_states import TrainerMode
from twin.simulation.devices.combined_devices import CombinedDevices
from twin.simulation.devices.machine_states import MachineStates
from twin.simulation.devices.received_hands import HandState, ReceivedHands
from twin.simulation.plants.tissue import clips_of
from twin.simulation.session.session_run import SAMPLE, head_of
from twin.simulation.session.tape import Tape
from twin.simulation.session.task_play import LiveReferee, MeasuringReferee, play_of
from twin.simulation.setup import Member, Setup
from twin.simulation.world import Block, World
from twin.simulation.world.signal_kinds import (
    CAMERA_AT,
    CAMERA_VIEW,
    CONSOLE_TAPS,
    OBJECT_POSE,
    ROBOT_GOAL,
    ROBOT_Q,
    ROBOT_TARGET,
    ROBOT_TOOL,
)
from twin.ui.session.attempt_report import AttemptReport
from twin.ui.session.console_state import ConsoleState, ForcePeaks, log_changes
from twin.ui.session.deformable_feed import Feed
from twin.ui.session.exercise import NO_TASK, Exercise
from twin.ui.session.live_machines import LiveMachines
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.organ_feeds import WorldFeed
from twin.ui.session.plan_mode import PlanMode
from twin.ui.session.recorder import Recorder
from twin.ui.session.task_choice import EXERCISE_OPTIONS, judged

if TYPE_CHECKING:
    from twin.ui.session.forms import When

_STEPPING_TIME = 0.012
"""Real time in s after which a call of `advance` stops stepping the World."""

_STEPS_PER_CHECK = 4
"""Number of steps of the World between two checks of the time."""

_MAX_DELAY = 0.1
"""Maximum delay in s that the World makes up for by later steps; the rest of a longer delay is never made up for."""

_RATE_MEAN_TIME = 2.0
"""Real time in s over which the displayed rate of the World is a mean, so that it does not flicker."""

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
        guided: whether other content follows at the same address.
        choice: tasks that a page can start; None: the server shows only this exercise.
        reading: the last state: controlled arms, arms at a limit, and the reason if nothing moves.
    """

    _device_type: type[ReceivedHands] = ReceivedHands

    def __init__(self, loaded: LoadedScene, exercise: Exercise = NO_TASK) -> None:
        """Create the World with the robots at the places of the scene.

        Raises:
            TwinError: the scene has no console, its robots do not match the console, or its props do not match the
                task.
            WorldError: a link is inside an organ at the start.
            OutputError: the session cannot be written.
        """
        scene = loaded.scene
        task = exercise.task
        self.scene = scene
        self.table = console_scene.console_of(scene)
        self.task = task
        self._attempt_report = AttemptReport(exercise.report)
        self._trials = exercise.trials
        self._forms = exercise.forms
        self._tell_end = exercise.ended
        self.guided = exercise.guided
        self.choice = exercise.choice
        self._trial_problem = ""
        self._first_settings = console_scene.settings(scene, exercise.fulcrum, task)
        self.device = self._device_type(
            console_scene.PEDALS,
            HANDS,
            self.table.scale,
            settings=self._first_settings,
            moving=[HANDS.index(hand) for hand in self.table.hands],
        )
        self.machines: LiveMachines | None = None
        if loaded.machines is not None:
            self.machines = LiveMachines(scene, loaded.machines, self.device)
        self.members: dict[str, Member] = {}
        for name, robot in loaded.robots.items():
            self.members[name] = Member(robot.mechanism, robot.kinematics(), LinkPoses(robot.loops))
        self.planning = PlanMode(scene, self.members, lambda: self.world)
        haptics_on = scene.haptics is None or scene.haptics.on
        self.condition = exercise.condition or Condition(haptics=haptics_on)
        self._setup = Setup(scene, self.members, task, loaded.props, self.condition, loaded.organs)
        self.device.feel(self.condition.haptics)
        is_procedure = self._setup.procedure is not None
        self.objects: Sequence[Movable] = clips_of(scene.tools) if is_procedure else self._setup.objects
        is_judged = task is not None and task.kind.judged
        self._temporary_folder = None
        self._session = exercise.session
        # A report is made from a session file: without a file of the user, a temporary one is recorded.
        if self._session is None and is_judged and self._attempt_report.wanted:
            self._temporary_folder = Scratch()
            self._session = Path(self._temporary_folder.name) / "hands.session"
        self.owner: str | None = None
        places = list(scene.places)
        if self.machines is not None:  # beside each machine, its model is shown
            places += scene.models
        self._places = {place.name: place for place in places}
        self.shown: dict[str, Member] = {}
        for name in self._places:
            self.shown[name] = self.members[name.removesuffix(MODEL)]
        self._camera_robot = scene.cameras[self.table.camera].robot
        self.attempt = 0
        self._begin_attempt()
        self.feed: Feed | None = loaded.feed
        if is_procedure:
            self.feed = WorldFeed(lambda: self.world, operating_scene.organ_of(self._setup))
        self.reading = self._read_state()

    def state_row(self) -> Array:
        """Return the joint values of all displayed robots, and the poses of the movable objects, in one row."""
        signals = self.world.signals
        values = [signals[ROBOT_Q.of(name)] for name in self.shown]
        values += [signals[OBJECT_POSE.of(item.name)] for item in self.objects]
        return np.concatenate(values)

    # -- the task -------------------------------------------------------------------------------------

    def _begin_attempt(self) -> None:
        """Make the World of a new attempt; if this fails, the present World remains."""
        path = self._session
        attempt = self.attempt + 1
        if path is not None and attempt > 1:
            path = path.with_name(f"{path.stem}-{attempt}{path.suffix}")
        tape = None
        if path is not None:
            tape = Tape()
        referee = self._new_referee()
        if self._trials is not None and not isinstance(referee, MeasuringReferee):
            raise TwinError(f"scene '{self.scene.name}': only a task with `holes` has a table of trials; omit --trials")
        peaks = ForcePeaks(self.table.hands)
        watch: list[Block] = [peaks]
        states: list[MachineStates] = []
        parts = None
        if self.machines is not None:
            states, packets = self.machines.connect()
            watch.append(packets)
            parts = self.machines.parts
        if referee is not None:
            assert isinstance(referee, Block), "a referee is a block"
            watch.append(referee)
        if tape is not None:  # the last block: it records what all others have written
            watch.append(tape)
        device = CombinedDevices([self.device, self.planning.plans, *states])
        world = console_scene.world(self._setup, device, records=False, watch=watch, parts=parts)
        recorder = None
        if path is not None and tape is not None:
            recorder = Recorder(path, head_of(self._setup, world, device), tape)
        # An error above leaves the present attempt as it is, except the exchange with the machines.
        self.world: World = world
        self._console_state = ConsoleState(self._setup, world)
        self._force_peaks = peaks
        self.referee = referee
        self.recorder = recorder
        self.attempt = attempt
        self._delay = 0.0
        self._mean_rate = 1.0
        self._world_error = ""
        self._end_text = ""

    def _new_referee(self) -> LiveReferee | None:
        """Return the judge of a new attempt at the task; None for a task without one."""
        if self.task is None:
            return None
        return play_of(self.task).referee(self._setup, self.task, SAMPLE)

    def answer(
        self, client: str, when: When, name: str, answers: Sequence[float | None], weights: Sequence[float] | None
    ) -> None:
        """Store the answers to the questionnaire that is asked now; see `QuestionnaireForms.answer`.

        Raises:
            HeldError: another client controls the hands.
            TwinError: this questionnaire is not asked now, an answer is not allowed, or the table cannot be written.
        """
        if self._forms is None:
            raise TwinError("this console asks no questionnaires: start the program with --before or --after")
        self.require_free(client)
        self._forms.answer(when, name, answers, weights)
        self.reading = self._read_state()

    @property
    def asks(self) -> bool:
        """Whether a questionnaire is to be answered now; until then, no hand moves a robot."""
        return self._forms is not None and bool(self._forms.due)

    def questionnaires(self) -> list[JsonObject]:
        """Return the questionnaires of this console for the page."""
        if self._forms is None:
            return []
        return self._forms.about()

    def marks(self) -> Sequence[tuple[str, Array]]:
        """Return short texts to show in the picture of a task, each with its position (3,) in m in the World."""
        if self.task is None:
            return ()
        return play_of(self.task).marks(self._setup, self.task)

    def restart(self, client: str) -> None:
        """Begin a new attempt, with objects, robots and measures as at the start of the first attempt.

        Raises:
            HeldError: another client controls the hands.
            TwinError: there is no task that can be judged, or the session file of the new attempt cannot be written.
        """
        self._require_task()
        self.require_free(client)
        old_recorder = self.recorder
        old_ticks = self.world.tick
        self.planning.reset()
        procedure = self._setup.procedure
        if procedure is not None:
            for robot in procedure.start:
                self.device.set(ROBOT_TOOL.of(robot), self._first_settings[ROBOT_TOOL.of(robot)])
        self._begin_attempt()
        if self._forms is not None:
            self._forms.restart()
        if old_recorder is not None:
            old_recorder.close(old_ticks)
        self.owner = None
        self.device.leave()
        self.device.feel(self.condition.haptics)
        self.reading = self._read_state()

    def start_task(self, client: str, name: str | None) -> None:
        """End this content, so that the server shows another task; None: no task, the hands only move the robots.

        Raises:
            HeldError: another client controls the hands.
            TwinError: there is no such task, or the server shows only this exercise.
        """
        if self.choice is None:
            raise TwinError(f"this server shows only one exercise: {self._single_exercise_reason}")
        self.require_free(client)
        self.choice.ask(name)
        self.reading = self._read_state()

    @property
    def _single_exercise_reason(self) -> str:
        """Reason why a page cannot start another task, and the way out."""
        if self.scene.trainer is not None:
            return f"scene '{self.scene.name}' has the machines of a trainer, so that its page cannot start a task"
        if not judged(self.scene.tasks):
            return f"scene '{self.scene.name}' has no task that a page judges"
        options = ", ".join(f"--{option}" for option in EXERCISE_OPTIONS)
        return f"to choose a task on the page, start it without all of {options}"

    def end(self, client: str) -> None:
        """End the present attempt; nothing moves until the next attempt begins.

        Raises:
            HeldError: another client controls the hands.
            TwinError: there is no task that can be judged.
        """
        self._require_task()
        self.require_free(client)
        if not self._end_text:
            self._finish_attempt("The task was ended.")

    def _require_task(self) -> None:
        if self.referee is None:
            raise TwinError("there is no task to end or restart: start one on the page, or this program with --task")

    def _finish_attempt(self, reason: str) -> None:
        """Stop the World, complete the session file, and begin to make the report."""
        self._end_text = reason
        self.owner = None
        self.planning.reset()
        self.device.leave()
        self._add_trial()
        if self._tell_end is not None:
            self._tell_end()
        if self.recorder is None:
            return
        self.recorder.close(self.world.tick)
        self._attempt_report.begin(self.attempt, self.recorder.path, self.scene.file)

    def _add_trial(self) -> None:
        """Add a row for this attempt to the table of trials; a failure is shown, and nothing else stops."""
        if self._trials is None or not isinstance(self.referee, MeasuringReferee):
            return
        self._trial_problem = ""
        try:
            self._trials.add(self.referee.trial_measures())
            if self._forms is not None:
                self._forms.finish()
        except TwinError as error:
            self._trial_problem = str(error)
            logging.getLogger(__name__).error("this attempt is not in the table of trials: %s", error)

    @property
    def ended(self) -> str:
        """Why the World is at rest: an error, or the end of the task; "" while it runs."""
        if self._world_error:
            return f"The World has stopped: {self._world_error}"
        if self._end_text:
            return f"{self._end_text} Restart the task to move the instruments."
        return ""

    def report(self) -> tuple[int, bytes | None, str] | None:
        """Return the newest report: (number of the attempt, page as bytes, error); None if there is no report yet.

        While the report is being made, the page is None and the error is "". After a failure, the page is None and the
        error is the reason.
        """
        return self._attempt_report.newest()

    def close(self) -> None:
        """Complete the session file, and remove temporary files."""
        self.planning.close()
        if self.recorder is not None:
            self.recorder.close(self.world.tick)
        self._attempt_report.close()
        if self._temporary_folder is not None:
            self._temporary_folder.cleanup()
        if self.machines is not None:
            self.machines.close()

    # -- time -----------------------------------------------------------------------------------------

    def advance(self, passed: float) -> list[str]:
        """Step the World by the elapsed real time `passed` in s; log changes, and return messages for all clients.

        If this computer is too slow, the World runs slower than real time. After an error, the World remains stopped.
        """
        if not self._world_error and not self._end_text and passed > 0:
            self._step_world(passed)
            self._end_judged_attempt()
            arm = ""
            if self.planning.hand:
                arm = self.arm(self.planning.hand)
            self.planning.poll(arm)
        old_reading = self.reading
        self.reading = self._read_state()
        return log_changes(old_reading, self.reading, self.device.patience)

    def _end_judged_attempt(self) -> None:
        """End the attempt if the task is completed, or if the session file is full."""
        if self.referee is None:
            return
        if self.referee.complete:
            self._finish_attempt(self.referee.ending)
        elif self.recorder is not None and not self.recorder.running:
            self._finish_attempt("The task was ended: the session is no longer recorded.")

    def _step_world(self, passed: float) -> None:
        dt = self.world.dt
        end = time.monotonic() + _STEPPING_TIME
        self._delay += passed
        step_count = int(self._delay / dt + 1e-6)  # a whole number of steps may be a rounding error too small
        remaining = step_count
        try:
            while remaining > 0:
                steps = min(remaining, self._group_size)
                self._before_steps(math.ceil(remaining / self._group_size))
                self.world.step(steps)
                remaining -= steps
                if time.monotonic() > end:
                    break
        except TwinError as error:
            self._world_error = str(error)
            logging.getLogger(__name__).error("the World has stopped: %s", error)
        self._after_steps(remaining > 0)
        simulated = (step_count - remaining) * dt
        self._delay = min(self._delay - simulated, _MAX_DELAY)
        weight = min(1.0, passed) / _RATE_MEAN_TIME
        self._mean_rate += weight * (simulated / passed - self._mean_rate)

    @property
    def _group_size(self) -> int:
        """Number of steps of the World in a group."""
        return _STEPS_PER_CHECK

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
            HeldError: another client controls the hands, the task has ended, or a questionnaire is due.
        """
        if self._end_text:
            raise HeldError(f"{self._end_text} Restart the task to move the instruments.")
        if self.asks:
            raise HeldError("Answer the questionnaire on the page first; then the hands move the instruments.")
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
        """Whether a hand that moves a robot is silent: no state of it has been received for `device.patience` s."""
        return self.device.any_silent(self.world.t)

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
        tools = self.scene.tools
        robot = self.arm(hand)
        if tool not in tools:
            raise TwinError(f"scene '{self.scene.name}': {unknown('tool', tool, tools)}")
        carriers = tools[tool].robots
        if robot not in carriers:
            raise TwinError(f"{robot} cannot carry '{tool}'; only {', '.join(carriers)} can carry it")
        self.device.set(ROBOT_TOOL.of(robot), list(tools).index(tool))

    def train(self, client: str, mode: TrainerMode) -> None:
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
        if self._end_text:
            raise HeldError(f"{self._end_text} Restart the task to plan a motion.")
        self.require_free(client)
        if self.table.teleoperation is not None:
            raise TwinError(f"{self.scene.name}: a robot that a hand moves by rates makes no planned motions")
        if do == "aim":
            return self.planning.aim(hand, self.arm(hand))
        if do == "find":
            return self.planning.find()
        return self.planning.accept()

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
        taps = int(self.world.signals[CONSOLE_TAPS.name][0])  # each tap of the clutch chooses the next arm
        return arms[taps % len(arms)]

    def tool(self, hand: str) -> Array:
        """Return the present pose (4, 4) in the World of the tool that a hand controls."""
        name = self.arm(hand)
        q = self.world.signals[ROBOT_Q.of(name)]
        goal = self.world.signals[ROBOT_GOAL.of(name)].reshape(4, 4)
        T_base_tool = self.members[name].kin.forward(q, goal)
        return self._places[name].T_world_base @ T_base_tool

    def moved(self, hand: str) -> Array:
        """Return the pose (4, 4), in the World, of the object that a hand moves: its tool, or the target of a plan."""
        if self.planning.phase != "aim" or self.planning.hand != hand:
            return self.tool(hand)
        name = self.planning.robot
        # The first value of the signal says whether there is a target.
        target = self.world.signals[ROBOT_TARGET.of(name)][1:].reshape(4, 4)
        return self.place(name) @ target

    def place(self, robot: str) -> Array:
        """Return T_world_base (4, 4) of a robot."""
        return self._places[robot].T_world_base

    def goal(self, hand: str) -> Array:
        """Return the commanded pose (4, 4) in the World of the tool that a hand controls."""
        name = self.arm(hand)
        return self._places[name].T_world_base @ self.world.signals[ROBOT_GOAL.of(name)].reshape(4, 4)

    @property
    def view(self) -> Array:
        """Pose (4, 4) of the endoscope's picture in the World: x right, y up, z out of the picture."""
        return self.world.signals[CAMERA_VIEW.of(self._camera_robot)].reshape(4, 4)

    def forces(self) -> dict[str, Array]:
        """Return, for each hand, the largest force (3,) in N since the last call, in {H}, the axes of the picture."""
        return self._force_peaks.take()

    @property
    def camera_at(self) -> Array:
        """Present pan, tilt, depth and roll (4,) of the camera; the depth is in m, the angles are in rad."""
        return self.world.signals[CAMERA_AT.of(self._camera_robot)]

    def _read_state(self) -> JsonObject:
        arms = {hand: self.arm(hand) for hand in self.table.hands}
        machines = None
        if self.machines is not None:
            machines = self.machines.state(self.world)
        form = None
        if self._forms is not None:
            form = self._forms.state()
        return {
            "owner": self.owner,
            "heard": self.device.heard,
            **self._console_state.read(arms),
            "rate": round(self._mean_rate, 1),
            "stopped": self._world_error or None,
            "task": self._scoreboard(),
            "leaving": self.choice is not None and self.choice.asked,
            "machines": machines,
            "form": form,
            "plan": self.planning.state(),
        }

    def deviations(self) -> dict[str, JsonObject]:
        """Return the deviation of each machine from its model; see `LiveMachines.deviations`."""
        if self.machines is None:
            return {}
        return self.machines.deviations(self.world)

    def _scoreboard(self) -> JsonObject | None:
        """Return the scoreboard of a task that is judged; None for other tasks."""
        if self.referee is None or self.task is None:
            return None
        newest = self.report()
        report = None
        if newest is not None:
            attempt, page, problem = newest
            report = {"attempt": attempt, "ready": page is not None, "problem": problem}
        trials = None
        if self._trials is not None:
            trials = {"file": self._trials.path.name, "number": self._trials.trial, "problem": self._trial_problem}
        return {
            "title": self.task.title,
            "trials": trials,
            "attempt": self.attempt,
            "over": self._end_text or None,
            "report": report,
            **self.referee.content(),
        }
