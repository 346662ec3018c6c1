"""Judge of a task with holes: which holes the tip touched and when, presses of the pedal, path of the tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics import Kinematics
from twin.simulation.session.referee import Event, Tone
from twin.simulation.tasks.holes.geometry import Hole, HoleGoals
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import HAND_PEDAL, ROBOT_Q

_NONE = -1
"""Number of a hole, or of a sample, where there is none."""


class HoleJudge:
    """Judges the tip and the pedal sample by sample.

    A hole is touched if the tip is at most `contact` from its axis and, along the axis, at most `contact` from its
    bottom. Only the next hole of the order counts; a touch of a later hole is a wrong touch. The instrument is not
    stopped by the phantom: neither its shaft nor the way by which the tip came is judged.

    Attributes:
        touched: time in s of the touch of each hole, in order; shorter than `holes` until all are touched.
        presses: number of presses of the pedal.
        path: length in m of the tip's path since the first press.
        wrong: number of touches of a hole that is not the next one.
        contact: whether the tip touches a hole now.
        nearest: smallest distance in m of the tip from the bottom of the next hole since the last touch.
        events: touches and wrong touches, in order of time.
    """

    def __init__(self, holes: Sequence[Hole], contact: float, period: float) -> None:
        """Begin with no sample; samples follow `period` s after each other."""
        self.holes = tuple(holes)
        self.limit = contact
        self.period = period
        self.touched: list[float] = []
        self.presses = 0
        self.path = 0.0
        self.wrong = 0
        self.contact = False
        self.nearest = np.inf
        self.events: list[Event] = []
        self._bottoms = np.array([hole.bottom for hole in self.holes])
        self._axes = np.array([hole.axis for hole in self.holes])
        self._samples = 0
        self._first_press = _NONE  # sample of the first press
        self._was_pressed = False
        self._last_tip = np.zeros(3)
        self._touched_hole = _NONE  # the hole that the tip touches

    @property
    def complete(self) -> bool:
        """Whether all holes are touched."""
        return len(self.touched) == len(self.holes)

    @property
    def time(self) -> float:
        """Time in s from the first press of the pedal to the last hole, or until now; 0 before the first press."""
        if self._first_press == _NONE:
            return 0.0
        end = (self._samples - 1) * self.period
        if self.complete:
            end = self.touched[-1]
        return end - self._first_press * self.period

    def see(self, tip: Array, pressed: bool) -> None:
        """Judge the next sample: position (3,) of the tip in m in the World, and whether the pedal is pressed."""
        if self.complete:
            return
        t = self._samples * self.period
        if pressed and not self._was_pressed:
            self.presses += 1
            if self._first_press == _NONE:
                self._first_press = self._samples
        self._was_pressed = pressed
        if self._first_press != _NONE and self._samples > self._first_press:
            self.path += float(np.linalg.norm(tip - self._last_tip))
        self._last_tip = np.array(tip)  # a copy: the caller may use its array again
        self._samples += 1
        next_hole = len(self.touched)
        hole = self._hole_at(tip)
        self.contact = hole != _NONE
        self.nearest = min(self.nearest, float(np.linalg.norm(tip - self._bottoms[next_hole])))
        if hole == next_hole:
            self.touched.append(t)
            self.nearest = np.inf  # from here on, the distance to the hole after this one
            self._tell(t, "good", f"hole {hole + 1} touched")
        # holes that were touched before do no harm, and a tip that stays in a later hole counts once
        elif hole not in (_NONE, self._touched_hole) and hole > next_hole:
            self.wrong += 1
            self._tell(t, "bad", f"hole {hole + 1} is not the next hole")
        self._touched_hole = hole

    def _hole_at(self, tip: Array) -> int:
        """Return the number of the hole whose bottom the tip touches; `_NONE` if it touches none."""
        offsets = tip - self._bottoms
        along = np.einsum("ij,ij->i", offsets, self._axes)
        beside = np.linalg.norm(offsets - along[:, None] * self._axes, axis=1)
        touches = np.flatnonzero((beside <= self.limit) & (np.abs(along) <= self.limit))
        if len(touches):
            return int(touches[0])
        return _NONE

    def _tell(self, t: float, tone: Tone, text: str) -> None:
        self.events.append(Event(t, tone, text))

    def measures(self) -> dict[str, float]:
        """Return {name with unit: value} of the measures of Table 1 of the paper, and of the holes."""
        return {
            "time_s": self.time,
            "clutches": float(self.presses),
            "path_mm": self.path / MM,
            "holes_touched": float(len(self.touched)),
            "wrong_holes": float(self.wrong),
        }


class HoleReferee(Block):
    """Judges the task while a person performs it; reads `<robot>.q` and `<hand>.pedal`, and writes no signal."""

    outputs: Mapping[str, ArrayLike] = {}
    ending = "All holes are touched."

    def __init__(self, goals: HoleGoals, hand: str, kin: Kinematics, T_world_base: Array, period: float) -> None:
        """Begin with no sample; the tip is computed from the robot's equations every `period` s."""
        self.period = period
        self.judge = HoleJudge(goals.holes, goals.contact, period)
        self._q = ROBOT_Q.of(goals.robot)
        self._pedal = HAND_PEDAL.of(hand)
        self._kin = kin
        self._T_world_base = T_world_base
        self._T_tool_tip = goals.T_tool_tip
        self._T = kin.forward(goals.start)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, Array]:
        """Judge the signals at the end of this tick."""
        self._T = self._kin.forward(signals[self._q], self._T)
        T_world_tip = self._T_world_base @ self._T @ self._T_tool_tip
        self.judge.see(T_world_tip[:3, 3], bool(signals.now[self._pedal][0] > 0.5))
        return {}

    @property
    def complete(self) -> bool:
        """Whether all holes are touched."""
        return self.judge.complete

    def trial_measures(self) -> dict[str, float | None]:
        """Return {name with unit: value} so far; time, presses and path are None unless all holes are touched."""
        values: dict[str, float | None] = dict(self.judge.measures())
        if not self.complete:
            for name in ("time_s", "clutches", "path_mm"):
                values[name] = None
        return values

    def content(self) -> JsonObject:
        """Return the scoreboard as plain data; `contact` (whether the tip touches a hole) is for sound."""
        judge = self.judge
        touched_count = len(judge.touched)
        instruction = None
        if not judge.complete:
            instruction = f"Next: hole {touched_count + 1}"
        rows = [
            ["Holes", f"{touched_count} of {len(judge.holes)}"],
            ["Time", f"{judge.time:.1f} s"],
            ["Clutch presses", str(judge.presses)],
            ["Path", f"{judge.path / MM:.1f} mm"],
            ["Wrong holes", str(judge.wrong)],
        ]
        events = [[round(event.t, 1), event.tone, event.text] for event in judge.events[-4:]]
        content: JsonObject = {"rows": rows, "events": events, "contact": judge.contact, "done": touched_count}
        content["rings"] = []
        if instruction is not None:
            content["next"] = instruction
        return content
