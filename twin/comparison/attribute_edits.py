"""Edits of all numbers of one attribute, found by reading a changed text again; see `edit_goal`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from twin.comparison.changed_text import ChangeableText, changeable_text, fewest_decimals, value_text
from twin.comparison.compared_items import NumberEdit
from twin.comparison.edit_goal import MAX_STEPS, EditGoal, first_step, leaves_too_much
from twin.comparison.file_numbers import FileNumber
from twin.comparison.side import RobotSide
from twin.comparison.xacro_lines import with_obstacle
from twin.core.spatial import Array

_MAX_READ_ATTRIBUTES = 12
"""Maximum number of attributes of one text that are tried: each reading closes loops."""

_RANK_RATIO = 1e-6
"""Smallest singular value, relative to the largest one, of directions in which a step may go."""


def attribute_edits(
    side: RobotSide, names: Collection[str], goal: EditGoal, file: Callable[[str], str]
) -> list[NumberEdit]:
    """Return the edits of all numbers of one attribute that reach a goal, for attributes that place a joint.

    Arguments as in `rereading.edited_sides`.
    """
    text = changeable_text(side)
    if text is None:
        return []
    attributes: dict[tuple[int, str], list[FileNumber]] = {}
    for number in text.numbers(names, ""):
        attribute, _, _ = number.what.rpartition("[")
        attributes.setdefault((number.line, attribute), []).append(number)
    edits_of_side: list[NumberEdit] = []
    before = goal.residual(side)
    for (line, what), own_numbers in list(attributes.items())[:_MAX_READ_ATTRIBUTES]:
        values = _AttributeSearch(text, own_numbers, goal).solved(before)
        if values is None:
            continue
        # as the file writes them, so that the text of the edit is found in the file
        written_values = [text.written(number) for number in own_numbers]
        old = " ".join(written_values)
        new = " ".join(map(value_text, values))
        source = own_numbers[0].file
        edit = NumberEdit(side.label, file(source or str(side.path)), line, what, old, new, confirmed=True)
        edits_of_side.append(with_obstacle(side, edit, source))
    return edits_of_side


@dataclass(frozen=True)
class _AttributeSearch:
    """The search of the values of the numbers of an attribute with which a goal is reached."""

    text: ChangeableText
    numbers: Sequence[FileNumber]
    goal: EditGoal

    def solved(self, before: Array) -> list[float] | None:
        """Return the values that reach the goal, None if there are none; `before` is the residual without edits."""
        goal = self.goal
        values_before = [self.text.value(number) for number in self.numbers]
        values = np.array(values_before)
        J = self._derivatives(values, before)
        if J is None:
            return None
        r = before
        for _ in range(MAX_STEPS):
            # with the derivatives of the stated values: to close the loops again for new ones takes most of the time
            change = -np.linalg.pinv(J, rcond=_RANK_RATIO) @ r
            if leaves_too_much(r + J @ change, r):
                return None
            values = values + change
            edited = self._side_with(values)
            if edited is None:
                return None
            if goal.agrees(edited):
                return self._with_fewest_decimals(values)
            r = goal.residual(edited)
            # another shape: with this value the file has other joints
            if r.shape != before.shape or not np.linalg.norm(r) < np.linalg.norm(before):
                return None
        return None

    def _derivatives(self, values: Array, before: Array) -> Array | None:
        """Return the derivatives (rows, numbers) of the residual `before`; None if a text cannot be read."""
        slopes = []
        for k in range(len(self.numbers)):
            step = first_step(float(values[k]))
            stepped = values.copy()
            stepped[k] += step
            changed = self._side_with(stepped)
            if changed is None:
                return None
            residual = self.goal.residual(changed)
            if residual.shape != before.shape:
                return None
            slopes.append((residual - before) / step)
        return np.array(slopes).T

    def _with_fewest_decimals(self, values: Array) -> list[float]:
        """Return the values with as few decimals as are needed."""
        rounded = []
        for value in values.tolist():
            rounded.append(fewest_decimals(value, self.goal.rounding))
        edited = self._side_with(np.array(rounded))
        if edited is not None and self.goal.agrees(edited):
            return rounded
        return values.tolist()

    def _side_with(self, values: Array) -> RobotSide | None:
        """Return the side with these values; None if the text can then not be read."""
        return self.text.with_values(list(zip(self.numbers, values.tolist(), strict=True)))
