"""Guide a person who performs a procedure by hand: state of each stage, next step, and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import MM
from twin.model.tool import Kind
from twin.simulation.console_scene import hands_of
from twin.simulation.session.procedure_checks import Check, ProcedureReferee
from twin.simulation.session.referee import Event
from twin.simulation.setup import Setup

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

_SAID = 0.2
"""Simulated time in s between two updates of the text."""

_OUT = 0.5
"""Time in s for which the organ must be outside before the procedure is complete; ASSUMED."""


class ProcedureGuide(ProcedureReferee):
    """A referee that also shows the next step to the person.

    Attributes:
        complete: whether the organ is free and has been outside for some time.
        events: all events so far, in order of time.
    """

    def __init__(self, setup: Setup, clips: Sequence[str], period: float) -> None:
        """Begin with no sample, see `ProcedureReferee`; a console of the scene moves the robots."""
        super().__init__(setup, clips, period)
        self.complete, self.events = False, list[Event]()
        self._tools, self._hands = [*setup.scene.tools.values()], hands_of(setup.scene)
        self._carried = dict.fromkeys(self.robots, -1)
        self._holds, self._told = dict.fromkeys(self.robots, -1), dict[str, str]()
        self._out_since: float | None = None
        self._content: JsonObject = {}
        self._next = 0.0

    def see(self, now: Mapping[str, Array], t: float) -> None:
        """Check a sample at t in s, and add its events."""
        clips, freed = len(self.closed), int(self.freed.sum())
        super().see(now, t)
        for clip in self.closed[clips:]:
            name = self._vessels[clip.on].name if clip.on >= 0 else ""
            if not name:
                self._tell("bad", "a clip was closed beside all vessels")
            elif not clip.closes:
                self._tell("bad", f"a clip was closed on {clip.cover:.0%} of the width of the {spoken(name)}")
            else:
                self._tell("good" if name == self.procedure.vessel else "bad", f"a clip closes the {spoken(name)}")
        if (free := int(self.freed.sum())) > freed:
            self._tell("good", f"{free} of {len(self.freed)} cells of the bed are free")
        for n in self.robots:
            holds, before = round(float(now[f"{n}.holds"][0])), self._holds[n]
            self._carried[n], self._holds[n] = round(float(now[f"{n}.carries"][0])), holds
            if holds != before:
                what = self._held(holds if holds >= 0 else before)
                self._tell("plain", f"{n} {'holds' if holds >= 0 else 'has released'} the {what}")
        out_since = self._out_since if self._out_since is not None else t
        self._out_since = out_since if self.removed else None
        self.complete = self.removed and t - out_since >= _OUT
        if t >= self._next or self.complete:
            self._next = t + _SAID
            self._say(now)

    def content(self) -> JsonObject:
        """Return the scoreboard as plain data: measures, stages with their state, the next step, the last events."""
        return self._content or {"rows": [], "rings": [], "events": [], "stages": [], "next": ""}

    @property
    def ending(self) -> str:
        """Text that states whether the organ is out, and which checks failed."""
        missed = [_TITLES[c.name] for c in self.checks() if not c.done]
        said = f"Not passed: {', '.join(missed)}." if missed else "All checks are passed."
        return f"The {spoken(self.procedure.organ)} is out. {said}"

    def _say(self, now: Mapping[str, Array]) -> None:
        checks = self.checks()
        for c in checks:
            state = _state(c)
            if state != self._told.get(c.name, "open" if c.t is not None or not c.done else state):
                self._tell("good" if c.done else "bad", f"{_TITLES[c.name]}: {'passed' if c.done else c.text}")
            self._told[c.name] = state
        rows = [["Time", f"{self.t:.1f} s"], ["Clips left", f"{self.clips - len(self.closed)} of {self.clips}"]]
        rows.append(["Energy into the bed", f"{self.energy.sum():.0f} J"])
        m = self.measures()
        rows.append(["Largest pull of a grasper", f"{m.largest_pull:.1f} N"])
        rows += [[f"Path of {n}", f"{path / MM:.0f} mm"] for n, path in m.paths.items()]
        self._content = {
            "rows": rows,
            "rings": [],
            "stages": [[_TITLES[c.name], _state(c), c.text] for c in checks],
            "next": self._hint(checks),
            "events": [[round(e.t, 1), e.tone, e.text] for e in self.events[-5:]],
        }

    def _tell(self, tone: Literal["good", "plain", "bad"], text: str) -> None:
        self.events.append(Event(self.t, tone, text))

    def _held(self, number: int) -> str:
        return spoken(self.procedure.organ if number == 0 else self._vessels[number - 1].name)

    # -- what to do next ---------------------------------------------------------------------------------------

    def _hint(self, checks: Sequence[Check]) -> str:
        """Return an instruction for the next step of the first stage that is not done."""
        p, states = self.procedure, {c.name: _state(c) for c in checks}
        holder = next((n for n in self.robots if self._holds[n] == 0), None)
        if states["expose"] == "open" and holder is None:
            return self._with("grasper", f"bring its tip to the {spoken(p.organ)}; open its jaws, close them")
        if states["expose"] == "open":
            return f"Lift the {spoken(p.organ)} with {holder}: {self.lift / MM:.0f} of {p.lift_mm:g} mm"
        if states["show"] == "open":
            part = f"now {self.seen:.0%}, at least {p.seen:.0%}"
            until = f"until the endoscope sees enough of the {spoken(p.vessel)}"
            return f"Hold the camera pedal and move both hands {until}: {part}"
        if states["clip"] == "open":
            where = "near the organ" if self.on_vessel >= p.clips_kept else "away from the organ"
            count = f"{self.on_vessel} of {p.clips_kept + p.clips_taken} clips"
            return self._with(
                "clip_applier", f"bring the {spoken(p.vessel)} between its jaws, {where}, and close them: {count}"
            )
        if not self.cut:
            return self._with(
                "scissors", f"bring the {spoken(p.vessel)} between its blades, between the clips; open them, close them"
            )
        if not self.freed.all():
            count = f"{int(self.freed.sum())} of {len(self.freed)} cells are free"
            return self._with("cautery", f"touch a yellow mark of the bed with its tip, and switch it on: {count}")
        if holder is None:
            return self._with("grasper", f"grasp the {spoken(p.organ)}")
        return (
            f"Pull the {spoken(p.organ)} out with {holder}: {self.out / MM:.0f} mm from a port, at most {p.out_mm:g} mm"
        )

    def _with(self, kind: Kind, do: str) -> str:
        """Return the instruction `do` for the robot with a kind of tool; without one, how to choose the tool."""
        carrier = next((n for n in self.robots if self._tools[self._carried[n]].kind == kind), None)
        if carrier is not None:
            return f"{self._tools[self._carried[carrier]].title} of {carrier}, {self._hands[carrier]} hand: {do}"
        title = next(t.title for t in self._tools if t.kind == kind)
        free = next((n for n in self.robots if self._holds[n] < 0), self.robots[0])
        return (
            f"Choose {title} for {free}, {self._hands[free]} hand, and draw its tip back to at most "
            f"{self.procedure.change_mm:g} mm from the port"
        )


def _state(c: Check) -> Literal["done", "open", "failed"]:
    return "done" if c.done else "failed" if c.lost else "open"
