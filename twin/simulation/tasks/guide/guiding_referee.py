"""Judge, sample by sample, how a ring is guided along a wire: steps, touches of the wire, drops, collisions, events.

A page shows the results of a `GuidingReferee` during the task; for a report, a second one judges the recorded signals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.spoken import spoken
from twin.core.units import MM, hex_digits
from twin.kinematics import Kinematics
from twin.model.movable import Movable
from twin.model.task import goal_of
from twin.simulation import console_scene, contact_scene
from twin.simulation.contact_scene import WireCourse
from twin.simulation.session.referee import BEGIN, InstrumentReferee, Runs
from twin.simulation.setup import Setup
from twin.simulation.tasks.guide.task import STEPS, GuideTable
from twin.simulation.tasks.transfer.ring_referee import crossing
from twin.simulation.world.signal_kinds import OBJECT_HOLDER, OBJECT_POSE, OBJECT_RUBS, ROBOT_Q

_TITLES = {
    "picked up": "Pick the ring up",
    "handed over": "Hand it over",
    "guided": "Guide it along the wire",
    "released": "Release it on the wire",
    "retracted": "Leave the dome",
}
"""Titles of the steps."""

_ENTRY_SHARE = 0.25
"""Fraction of the wire, from its free end, in which the ring must be put over the wire; ASSUMED.

Later, the largest fraction of the wire by which the ring may be moved on while the second arm does not hold it."""


@dataclass(frozen=True)
class GuideMeasures:
    """Measures of a task with a ring to guide.

    Attributes:
        steps: time in s at which each of `STEPS` was done; None: the step is not done. The last two steps count only if
            their result lasts until the end.
        passed: fraction (0 to 1) of the wire along which the second arm guided the ring; it counts from 0 again if the
            ring leaves the wire.
        touches: number of touches of the wire by the held ring.
        touching: total time in s of these touches.
        drops: number of times that the hands lost the ring before it was guided. Until the ring is picked up, a loss
            counts only if the ring is then away from its start; a failed grasp does not count.
        collisions: number of collisions of an instrument with a fixed part, or with the other instrument.
        time: time in s from the first moment in which an arm follows its hand until the last step is done; if a step is
            not done, until the end of the session.
        allowed: errors with their limits: (name, value, largest allowed value, unit).
    """

    steps: Mapping[str, float | None]
    passed: float
    touches: int
    touching: float
    drops: int
    collisions: int
    time: float
    allowed: Sequence[tuple[str, float, float, str]]

    @property
    def missed(self) -> list[str]:
        """Names of the steps that are not done."""
        missed = []
        for name, t in self.steps.items():
            if t is None:
                missed.append(name)
        return missed

    @property
    def exceeded(self) -> list[tuple[str, float, float, str]]:
        """Errors above their limits: (name, value, largest allowed value, unit)."""
        exceeded = []
        for row in self.allowed:
            _, value, largest, _ = row
            if value > largest:
                exceeded.append(row)
        return exceeded

    def rows(self) -> list[tuple[str, str]]:
        """Return the measures as names and values, in the order in which pages and reports show them."""
        steps_done = len(self.steps) - len(self.missed)
        return [
            ("Time", f"{self.time:.1f} s"),
            ("Steps done", f"{steps_done} of {len(self.steps)}"),
            ("Wire passed", f"{100 * self.passed:.0f} %"),
            ("Ring touched the wire", f"{self.touches} times, {self.touching:.1f} s"),
            ("Ring dropped", str(self.drops)),
            ("Instrument collisions", str(self.collisions)),
        ]

    def content(self) -> JsonObject:
        """Return the measures as plain data; keys end with their unit."""
        return {
            "time_s": self.time,
            "steps_s": dict(self.steps),
            "wire_passed": self.passed,
            "wire_touches": self.touches,
            "wire_touching_s": self.touching,
            "ring_dropped": self.drops,
            "instrument_collisions": self.collisions,
        }


class GuidingReferee(InstrumentReferee):
    """Judges, sample by sample, a running task in which a ring is guided along a wire.

    Signals: those of `InstrumentReferee`, `<ring>.pose`, `<ring>.holder`, `<ring>.rubs` and `<robot>.q`.
    """

    ending = "The ring was guided along the wire, and both instruments have left the dome."
    _touched = "a fixed part"

    def __init__(
        self,
        guide: GuideTable,
        ring: Movable,
        course: WireCourse,
        robots: Sequence[str],
        first: str,
        tools: Mapping[str, Callable[[Array], Array]],
        period: float,
        called: Mapping[str, str] | None = None,
    ) -> None:
        """Begin with no sample.

        Args:
            guide: the table of the task.
            ring: the ring.
            course: wire and dome.
            robots: the instruments, in the order of the numbers in `<ring>.holder`.
            first: the instrument that picks the ring up.
            tools: {instrument: function from joint values (n,) to its tool's position (3,) in the World}.
            period: time in s between two samples.
            called: what texts call each robot; None: its name.
        """
        super().__init__(robots, period, called)
        self._guide = guide
        self._ring = ring
        self.course = course
        self._tools = dict(tools)
        self._p_start = ring.T_world_object[:3, 3]
        self._first = list(robots).index(first)
        self._segments: list[tuple[Array, Array, float]] = []  # begin and end (3,) in m, length in m
        for a, b in pairwise(course.wire):
            length = float(np.linalg.norm(b - a))
            self._segments.append((a, b, length))
        self._wire_length = sum(length for _, _, length in self._segments)
        self._steps: dict[str, int | None] = dict.fromkeys(STEPS)
        self._rubs = Runs(self._few)
        self._rubbing = 0
        self._drops = 0
        self._passed = 0.0
        self._on_wire = False
        self._is_guided = False  # the second arm has moved the ring to its place on the wire
        self._last_held = -1  # last sample in which a hand held the ring
        self._holder = -1
        self._is_fallen = False  # no hand has held the ring since it fell
        self._must_pick_up = False  # the first arm has not held the ring since it fell

    def _see_task(self, k: int, now: Mapping[str, Array]) -> None:
        name = self._ring.name
        T = now[OBJECT_POSE.of(name)]
        self._holder = int(now[OBJECT_HOLDER.of(name)][0])
        if self._holder >= 0 and now[OBJECT_RUBS.of(name)][0] > 0.5:
            self._rubbing += 1
            if self._rubs.see(k, True):
                self._tell(k, "bad", f"{name} touched the wire")
        if self._steps["picked up"] is None:
            self._pick_up(k, T)
        elif self._steps["guided"] is None:
            self._follow(k, T)
        self._release(k, T)
        self._retract(k, now)
        if self._holder >= 0:
            self._last_held = k
            self._is_fallen = False

    def _pick_up(self, k: int, T: Array) -> None:
        """Judge whether the first arm has taken the ring away from its start; T (16,): pose of the ring."""
        p = T[3::4][:3]  # last column of the pose
        if float(np.linalg.norm(p - self._p_start)) <= self._guide.lifted_mm * MM:
            return
        if self._holder == self._first:
            self._do("picked up", k)
        elif self._last_held >= 0:
            self._see_fall(k)

    def _follow(self, k: int, T: Array) -> None:
        """Judge handing over and guiding."""
        self._see_fall(k)
        was_guided = self._is_guided
        self._is_guided = False
        if self._holder < 0:
            return
        if self._holder == self._first:
            self._must_pick_up = False
            return
        if self._steps["handed over"] is None and not self._must_pick_up:
            self._do("handed over", k)
        s = self._place(T)
        # where the ring may be when the second arm takes it: near the free end, or where this arm has brought it
        farthest = (self._passed + _ENTRY_SHARE) * self._wire_length
        if s is None:
            if self._on_wire and self._passed > _ENTRY_SHARE:
                self._tell(k, "bad", f"{self._ring.name} has left the wire")
            self._on_wire = False
            self._passed = 0.0
        # a ring comes onto the wire by its free end; one that another arm moved further along does not count
        elif was_guided or s <= farthest:
            self._on_wire = True
            self._is_guided = True
            self._passed = max(self._passed, s / self._wire_length)
            at_end = self._wire_length - s < self._guide.end_mm * MM
            if at_end and self._steps["handed over"] is not None:
                self._passed = 1.0
                self._do("guided", k)

    def _see_fall(self, k: int) -> None:
        """Count a drop if no hand holds the ring any more."""
        if self._is_fallen or not self._is_free(k):
            return
        self._is_fallen = True
        self._must_pick_up = True
        self._drops += 1
        text = f"{spoken(self._ring.name)} was dropped"
        if self._steps["handed over"] is None:
            text += f": {self.called[self._names[self._first]]} must pick it up again"
        self._tell(k, "bad", text)

    def _is_free(self, k: int) -> bool:
        """Return whether no hand has held the ring for some time."""
        return self._holder < 0 and k - self._last_held > self._few

    def _release(self, k: int, T: Array) -> None:
        """Judge whether the guided ring hangs on the wire without a hand."""
        if self._steps["guided"] is None:
            return
        if self._is_free(k) and self._place(T) is not None:  # a ring beside the wire has fallen
            self._do("released", k)
        else:
            self._undo("released")

    def _retract(self, k: int, now: Mapping[str, Array]) -> None:
        """Judge whether both tools have left the dome with nothing in their jaws."""
        if self._steps["released"] is not None and self._are_outside(now):
            self._do("retracted", k)
        else:
            self._undo("retracted")

    def _are_outside(self, now: Mapping[str, Array]) -> bool:
        """Return whether all tools are far enough outside of the dome."""
        for robot in self._names:
            p = self._tools[robot](now[ROBOT_Q.of(robot)])
            if self.course.outside(p) < self._guide.outside_mm * MM:
                return False
        return True

    def _place(self, T: Array) -> float | None:
        """Return the length in m of the wire from its free end to the ring; None: the wire is not inside the ring."""
        begin = 0.0
        for a, b, length in self._segments:
            fraction = crossing(T, self._ring.size[0], a, b)
            if fraction is not None:
                return begin + fraction * length
            begin += length
        return None

    def _do(self, step: str, k: int) -> None:
        if self._steps[step] is not None:
            return
        self._steps[step] = k
        text = f"{self._ring.name} is {step}"
        if step == STEPS[-1]:
            text = "both tools left the dome"
        self._tell(k, "good", text)

    def _undo(self, step: str) -> None:
        self._steps[step] = None

    @classmethod
    def of(cls, setup: Setup, period: float) -> GuidingReferee:
        """Return the referee of the task in `setup`."""
        guide = goal_of(setup.task, GuideTable)
        if setup.task is None or guide is None:
            raise TwinError(f"{setup.label} has no ring to guide")
        scene = setup.scene
        called = console_scene.instrument_names(scene)
        ring = next(item for item in scene.objects if item.name == guide.ring)
        tools = {}
        for name in called:
            tools[name] = _tool(setup.places[name].T_world_base, setup.members[name].kin)
        course = contact_scene.course(scene, setup.props, setup.task)
        first = getattr(scene.console, guide.first)[0]
        return cls(guide, ring, course, list(called), first, tools, period, called)

    @property
    def signals(self) -> list[str]:
        """Names of the signals that the referee reads."""
        ring = self._ring.name
        names = [*super().signals, OBJECT_POSE.of(ring), OBJECT_HOLDER.of(ring), OBJECT_RUBS.of(ring)]
        for robot in self._names:
            names.append(ROBOT_Q.of(robot))
        return names

    @property
    def complete(self) -> bool:
        """Whether all steps are done."""
        return None not in self._steps.values()

    def measures(self) -> GuideMeasures:
        """Return the measures of all samples so far."""
        times: dict[str, float | None] = {}
        for name, k in self._steps.items():
            times[name] = None if k is None else k * self.period
        end = None
        if self.complete:
            end = times[STEPS[-1]]
        touching = self._rubbing * self.period
        allowed = self._guide.allowed
        errors = (
            ("touches of the wire", touching, allowed.touch_s, "s"),
            ("drops of the ring", self._drops, allowed.drops, ""),
            ("collisions of instruments", self.collisions, allowed.collisions, ""),
        )
        return GuideMeasures(
            times,
            self._passed,
            self._rubs.count,
            touching,
            self._drops,
            self.collisions,
            self._duration(end),
            errors,
        )

    def content(self, last: int = 5) -> JsonObject:
        """Return the scoreboard as plain data: measures, steps, state of the ring, next step, the `last` events."""
        color = "#" + hex_digits(self._ring.color_rgba)
        steps = []
        for name, k in self._steps.items():
            steps.append([_TITLES[name], "open" if k is None else "done", ""])
        return {
            "rows": [list(row) for row in self.measures().rows()],
            "rings": [[self._ring.name, self._state(), color]],
            "stages": steps,
            "next": self._next(),
            "events": self._told(last),
        }

    def _next(self) -> str:
        """Return an instruction for the first step that is not done; "" if all are done."""
        if self._begun < 0:
            return BEGIN
        ring = spoken(self._ring.name)
        first = self.called[self._names[self._first]]
        others = [self.called[name] for name in self._names if name != self._names[self._first]]
        second = " or ".join(others)
        grasp = "bring its open jaws around it, and close them"
        if self._steps["picked up"] is None:
            return f"Pick the {ring} up with {first}: {grasp}"
        if self._steps["handed over"] is None:
            if self._must_pick_up:
                return f"The {ring} fell: pick it up again with {first}"
            return f"Grasp the {ring} with {second} too, then open the jaws of {first}"
        if self._steps["guided"] is None:
            if not self._on_wire:
                return f"Put the {ring} over the free end of the wire with {second}"
            return f"Guide the {ring} along the wire without touching it: {self._passed:.0%} passed"
        if self._steps["released"] is None:
            return f"Open the jaws: the {ring} stays on the wire"
        if self._steps["retracted"] is None:
            return "Draw both instruments out of the dome"
        return ""

    def _state(self) -> str:
        """Return the state of the ring as text: dropped, held, or its last step."""
        if self._is_fallen:
            return "dropped"
        if self._holder >= 0:
            return f"held by {self.called[self._names[self._holder]]}"
        state = "not picked up"
        for name, k in self._steps.items():
            if k is not None:
                state = name
        return state


def _tool(T_world_base: Array, kin: Kinematics) -> Callable[[Array], Array]:
    """Return the function from joint values (n,) to the position (3,) of the tool in the World."""
    return lambda q: (T_world_base @ kin.forward(q))[:3, 3]
