"""The value of one number of a text with which an edit reaches its goal."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from twin.comparison.changed_text import MAX_DECIMALS, ChangeableText, fewest_decimals, with_decimals
from twin.comparison.edit_goal import MAX_STEPS, SMALLEST_SLOPE, EditGoal, first_step, later_step, leaves_too_much
from twin.comparison.file_numbers import FileNumber
from twin.comparison.side import RobotSide
from twin.core.spatial import Array

_LARGEST_CHANGE = 1e6
"""Change of a number, in the unit of the file, that leads nowhere."""

_VALUE_TOLERANCE = 1e-12
"""Difference of two values of a number that are the same."""

_QUARTER_TURN_ROUNDING = 1e-6
"""Inaccuracy of a quarter turn in rad or degrees that is written with few digits."""

_MULTIPLE_TOLERANCE = 1e-4
"""Part of a quarter turn up to which an angle is a multiple of it."""

_AXIS_TERM = re.compile(r"axis")
"""A direction, whose numbers are mostly 0, 1 and -1."""


@dataclass(frozen=True)
class SolvedNumber:
    """A value of a number with which a goal is reached, and the side with it."""

    value: float
    side: RobotSide


@dataclass(frozen=True)
class NumberSearch:
    """The search of the value of a number of a text with which a goal is reached."""

    text: ChangeableText
    number: FileNumber
    goal: EditGoal

    def solved(self, before: Array) -> SolvedNumber | None:
        """Return the value that reaches the goal, None if there is none; `before` is the residual without an edit.

        By secant steps in the least-squares sense; where these lead nowhere, from the usual other values.
        """
        goal = self.goal
        value = self.text.value(self.number)
        step = first_step(value)
        r = before
        slope: Array | None = None
        edited: RobotSide | None = None
        for _ in range(MAX_STEPS):
            changed = self._side_with(value + step)
            if changed is None:
                return None
            r_changed = goal.residual(changed)
            if r_changed.shape != r.shape:
                return None
            slope = (r_changed - r) / step
            strength = float(slope @ slope)
            if strength < SMALLEST_SLOPE**2:
                return None if edited is not None else self._usual_value()
            change = -float(slope @ r) / strength
            if edited is None and leaves_too_much(r + slope * change, r):
                return self._usual_value()
            if not abs(change) < _LARGEST_CHANGE:  # true also for NaN
                return None
            value += change
            edited = self._side_with(value)
            if edited is None:
                return None
            r = goal.residual(edited)
            if abs(change) * np.sqrt(strength) < goal.converged_change:
                break
            step = later_step(min(abs(change), abs(value)))
        if edited is None or slope is None or not goal.agrees(edited):
            return self._usual_value()
        return self._rounded(value, float(np.abs(slope).max())) or SolvedNumber(value, edited)

    def _side_with(self, value: float) -> RobotSide | None:
        """Return the side with a value of the number; None if the text can then not be read."""
        return self.text.with_values([(self.number, value)])

    def _usual_value(self) -> SolvedNumber | None:
        """Return a lost sign, a quarter turn or zero if that reaches the goal: too far for small steps."""
        value = self.text.value(self.number)
        for candidate in _usual_values(self.number, value):
            if abs(candidate - value) < _VALUE_TOLERANCE:
                continue
            edited = self._side_with(candidate)
            if edited is not None and self.goal.agrees(edited):
                return SolvedNumber(fewest_decimals(candidate, _QUARTER_TURN_ROUNDING), edited)
        return None

    def _rounded(self, value: float, slope: float) -> SolvedNumber | None:
        """Return the value with as few decimals as needed; `slope` is the change of the residual by the value."""
        for decimals in range(MAX_DECIMALS + 1):
            rounded = with_decimals(value, decimals)
            if abs(rounded - value) * slope > self.goal.rounding:
                continue
            edited = self._side_with(rounded)
            if edited is not None and self.goal.agrees(edited):
                return SolvedNumber(rounded, edited)
        return None


def _usual_values(number: FileNumber, value: float) -> list[float]:
    """Return what is usually meant instead of a wrong value: the other sign, quarter turns in degrees or rad."""
    if _AXIS_TERM.search(number.what):
        return [-value, 0.0, 1.0, -1.0]
    usual = [-value]
    for quarter in (90.0, 0.5 * np.pi):
        # only from one multiple of a quarter turn to another, or all numbers would be tried
        if abs(value / quarter - round(value / quarter)) >= _MULTIPLE_TOLERANCE:
            continue
        for turns in (-2, -1, 1, 2):
            usual.append(value + turns * quarter)
    return usual
