"""How a page judges and guides a procedure by hand: its stages, the next step, and events.

The simulated surgeon works in a World of its own, see `procedure_run`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import MM
from twin.model.task import ConsoleTask
from twin.model.tool import Kind
from twin.simulation import console_scene, operating_scene
from twin.simulation.console_scene import hands_of, instrument_names
from twin.simulation.plants.tissue import clips_of
from twin.simulation.plants.tissue.operating import Grasped
from twin.simulation.session.referee import BEGIN, Event
from twin.simulation.session.task_play import Play
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure.procedure_checks import ClosedClip, ProcedureCheck, ProcedureReferee
from twin.simulation.world.signal_kinds import CLIP_ON, ROBOT_CARRIES, ROBOT_HOLDS


class _ProcedurePlay(Play):
    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> ProcedureGuide:
        switches = [CLIP_ON.of(clip.name) for clip in clips_of(setup.scene.tools)]
        return ProcedureGuide(setup, switches, console_scene.ORGANS)

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        return operating_scene.about(setup)


_TITLES = {
    "expose": "Expose the organ",
    "show": "Show the vessel",
    "clip": "Clip it",
    "cut": "Cut between the clips",
    "remove": "Take the organ out",
    "organs": "Spare other organs",
    "vessels": "Spare other vessels",
}
"""Titles of the checks."""

_TEXT_INTERVAL = 0.2
"""Simulated time in s between two updates of the text."""

_TIME_OUTSIDE = 0.5
"""Time in s for which the organ must be outside before the procedure is complete; ASSUMED."""


class ProcedureGuide(ProcedureReferee):
    """A referee that also shows the next step to the person.

    Attributes:
        complete: whether the organ is free and has been outside for some time.
        events: all events so far, in order of time.
    """

    def __init__(self, setup: Setup, clips: Sequence[str], period: float) -> None:
        """Begin with no sample, see `ProcedureReferee`; a console of the scene moves the robots."""
        super().__init__(setup, clips, period, by_hand=True)
        self.complete = False
        self.events: list[Event] = []
        self._tools = list(setup.scene.tools.values())
        self._hands = hands_of(setup.scene)
        self._called = instrument_names(setup.scene)
        self._carried = dict.fromkeys(self.robots, -1)
        self._holds: dict[str, int] = dict.fromkeys(self.robots, Grasped.NOTHING)
        self._told_states: dict[str, str] = {}
        self._out_since: float | None = None
        self._content: JsonObject = {}
        self._next_update = 0.0

    def see(self, now: Mapping[str, Array], t: float) -> None:
        """Check a sample at t in s, and add its events."""
        clips = len(self.closed)
        free_before = int(self.freed.sum())
        super().see(now, t)
        for clip in self.closed[clips:]:
            self._tell_clip(clip)
        free = int(self.freed.sum())
        if free > free_before:
            self._tell("good", f"{free} of {len(self.freed)} cells of the bed are free")
        for robot in self.robots:
            self._see_robot(robot, now)
        if not self.removed:  # an organ that slips back has to be taken out again
            self._out_since = None
        elif self._out_since is None:
            self._out_since = t
        self.complete = self._out_since is not None and t - self._out_since >= _TIME_OUTSIDE
        # the texts are for people, who read no faster; the last state is always shown
        if t >= self._next_update or self.complete:
            self._next_update = t + _TEXT_INTERVAL
            self._update_content(now)

    def _tell_clip(self, clip: ClosedClip) -> None:
        if clip.on < 0:
            self._tell("bad", "a clip was closed beside all vessels")
            return
        name = self._vessels[clip.on].name
        if not clip.closes:
            self._tell("bad", f"a clip was closed on {clip.cover:.0%} of the width of the {spoken(name)}")
        elif name == self.procedure.vessel:
            self._tell("good", f"a clip closes the {spoken(name)}")
        else:
            self._tell("bad", f"a clip closes the {spoken(name)}")

    def _see_robot(self, robot: str, now: Mapping[str, Array]) -> None:
        """Read the tool of a robot and what it holds; add an event if it has grasped or released something."""
        before = self._holds[robot]
        holds = round(float(now[ROBOT_HOLDS.of(robot)][0]))
        self._carried[robot] = round(float(now[ROBOT_CARRIES.of(robot)][0]))
        self._holds[robot] = holds
        if holds == before:
            return
        if holds == Grasped.NOTHING:
            self._tell("plain", f"{self._called[robot]} has released the {self._held_name(before)}")
        else:
            self._tell("plain", f"{self._called[robot]} holds the {self._held_name(holds)}")

    def content(self) -> JsonObject:
        """Return the scoreboard as plain data: measures, stages with their state, the next step, the last events."""
        return self._content or {"rows": [], "rings": [], "events": [], "stages": [], "next": ""}

    @property
    def ending(self) -> str:
        """Text that states whether the organ is out, and which checks failed."""
        missed = []
        for check in self.checks():
            if not check.done:
                missed.append(_TITLES[check.name])
        result = "All checks are passed."
        if missed:
            result = f"Not passed: {', '.join(missed)}."
        return f"The {spoken(self.procedure.organ)} is out. {result}"

    def _update_content(self, now: Mapping[str, Array]) -> None:
        checks = self.checks()
        stages = []
        for check in checks:
            state = _state(check)
            self._tell_change(check, state)
            self._told_states[check.name] = state
            stages.append([_TITLES[check.name], state, check.text])
        clips_left = self.clips - len(self.closed)
        measures = self.measures()
        rows = [
            ["Time", f"{self._clock:.1f} s"],
            ["Clips left", f"{clips_left} of {self.clips}"],
            ["Energy into the bed", f"{self.energy.sum():.0f} J"],
            ["Largest pull of a grasper", f"{measures.largest_pull:.1f} N"],
        ]
        for robot, path in measures.paths.items():
            rows.append([f"Path of {self._called[robot]}", f"{path / MM:.0f} mm"])
        self._content = {
            "rows": rows,
            "rings": [],
            "stages": stages,
            "next": self._hint(checks),
            "events": [[round(event.t, 1), event.tone, event.text] for event in self.events[-5:]],
        }

    def _tell_change(self, check: ProcedureCheck, state: str) -> None:
        """Add an event if the state of a check is not the one before."""
        before = self._told_states.get(check.name)
        if before is None:
            # at the start, a check that applies to the whole session is passed, which is no news
            whole_session = check.t is None and check.done
            before = state if whole_session else "open"
        if state == before:
            return
        if check.done:
            self._tell("good", f"{_TITLES[check.name]}: passed")
        else:
            self._tell("bad", f"{_TITLES[check.name]}: {check.text}")

    def _tell(self, tone: Literal["good", "plain", "bad"], text: str) -> None:
        self.events.append(Event(self._clock, tone, text))

    @property
    def _clock(self) -> float:
        """Time in s since the first moment in which a robot followed its hand; 0 before it."""
        return 0.0 if self.begun is None else self.t - self.begun

    def _held_name(self, number: int) -> str:
        if number == Grasped.ORGAN:
            return spoken(self.procedure.organ)
        return spoken(self._vessels[number - 1].name)

    # -- what to do next ---------------------------------------------------------------------------------------

    def _hint(self, checks: Sequence[ProcedureCheck]) -> str:
        """Return an instruction for the next step of the first stage that is not done."""
        if self.begun is None:
            return BEGIN
        procedure = self.procedure
        states = {check.name: _state(check) for check in checks}
        holder = self._holder()
        if states["expose"] == "open" and holder is None:
            return self._with("grasper", f"bring its tip to the {spoken(procedure.organ)}; open its jaws, close them")
        if states["expose"] == "open" and holder is not None:
            lifted = f"{self.lift / MM:.0f} of {procedure.lift_mm:g} mm"
            return f"Lift the {spoken(procedure.organ)} with {self._called[holder]}: {lifted}"
        if states["show"] == "open":
            part = f"now {self.seen:.0%}, at least {procedure.seen:.0%}"
            until = f"until the endoscope sees enough of the {spoken(procedure.vessel)}"
            return f"Hold the camera pedal and move both hands {until}: {part}"
        if states["clip"] == "open":
            where = "near the organ" if self.on_vessel >= procedure.clips_kept else "away from the organ"
            required = procedure.clips_kept + procedure.clips_taken
            count = f"{self.on_vessel} of {required} clips"
            vessel = spoken(procedure.vessel)
            return self._with("clip_applier", f"bring the {vessel} between its jaws, {where}, and close them: {count}")
        if not self.cut:
            vessel = spoken(procedure.vessel)
            return self._with(
                "scissors", f"bring the {vessel} between its blades, between the clips; open them, close them"
            )
        if not self.freed.all():
            free = int(self.freed.sum())
            count = f"{free} of {len(self.freed)} cells are free"
            return self._with("cautery", f"touch a yellow mark of the bed with its tip, and switch it on: {count}")
        if holder is None:
            return self._with("grasper", f"grasp the {spoken(procedure.organ)}")
        pull = f"Pull the {spoken(procedure.organ)} out with {self._called[holder]}"
        return f"{pull}: {self.out / MM:.0f} mm from a port, at most {procedure.out_mm:g} mm"

    def _with(self, kind: Kind, do: str) -> str:
        """Return the instruction `do` for the robot with a kind of tool; without one, how to choose the tool."""
        for robot in self.robots:
            tool = self._tools[self._carried[robot]]
            if tool.kind == kind:
                return f"{tool.title}, {self._hands[robot]} hand: {do}"
        title = next(tool.title for tool in self._tools if tool.kind == kind)
        robot = self._free_robot()
        return (
            f"Choose {title} for the {self._hands[robot]} hand, and draw its tip back to at most "
            f"{self.procedure.change_mm:g} mm from the port"
        )

    def _holder(self) -> str | None:
        """Return the first robot that holds the organ; None if there is none."""
        for robot in self.robots:
            if self._holds[robot] == Grasped.ORGAN:
                return robot
        return None

    def _free_robot(self) -> str:
        """Return the first robot that holds nothing; if there is none, the first robot."""
        for robot in self.robots:
            if self._holds[robot] == Grasped.NOTHING:
                return robot
        return self.robots[0]


def _state(check: ProcedureCheck) -> Literal["done", "open", "failed"]:
    if check.done:
        return "done"
    if check.lost:
        return "failed"
    return "open"


PLAY = _ProcedurePlay()
