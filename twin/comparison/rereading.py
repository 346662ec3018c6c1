"""Edits of numbers of a text that are found by reading the changed text again; see `edit_goal`."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from twin.comparison.changed_text import ChangeableText, changeable_text, fewest_decimals, value_text
from twin.comparison.compared_items import NumberEdit
from twin.comparison.edit_goal import SMALLEST_SLOPE, EditGoal, later_step
from twin.comparison.file_numbers import FileNumber
from twin.comparison.number_search import NumberSearch
from twin.comparison.side import RobotSide
from twin.comparison.xacro_lines import with_obstacle
from twin.core.spatial import Array

_MAX_READ_NUMBERS = 150
"""Maximum number of numbers of one text that are tried for one item."""

_RANK_RATIO = 1e-9
"""Smallest singular value, relative to the largest one, of directions in which a step may go."""


@dataclass(frozen=True)
class EditedSide:
    """An edit of a number, and the side that was read with it."""

    edit: NumberEdit
    side: RobotSide


def _nothing_is_tried(_number: FileNumber, _value: float) -> bool:
    """Return that no number was tried before."""
    return False


def edits_of_one_number(
    side: RobotSide,
    names: Collection[str],
    kind: str,
    goal: EditGoal,
    file: Callable[[str], str],
    is_tried: Callable[[FileNumber, float], bool] = _nothing_is_tried,
) -> list[NumberEdit]:
    """Return the edits of one number that reach a goal, the likeliest first; see `edited_sides`."""
    number_edits = []
    for edited in edited_sides(side, names, kind, goal, file, is_tried):
        number_edits.append(edited.edit)
    return number_edits


def edited_sides(
    side: RobotSide,
    names: Collection[str],
    kind: str,
    goal: EditGoal,
    file: Callable[[str], str],
    is_tried: Callable[[FileNumber, float], bool] = _nothing_is_tried,
) -> list[EditedSide]:
    """Return the edits of one number that reach a goal, each with its side, the likeliest first.

    Args:
        side: the side whose text is edited.
        names: plain names of the elements or prims whose numbers are tried.
        kind: kind of properties that the numbers state, or "" for what places joints and links.
        goal: what an edit must achieve.
        file: function of a path that returns it as it is told.
        is_tried: whether a number with its value need not be tried: no value of it reaches the goal.
    """
    text = changeable_text(side)
    if text is None:
        return []
    ranked: list[tuple[int, int, EditedSide]] = []
    before = goal.residual(side)
    for number in text.numbers(names, kind)[:_MAX_READ_NUMBERS]:
        old = text.value(number)
        if is_tried(number, old):
            continue
        solved = NumberSearch(text, number, goal).solved(before)
        if solved is None:
            continue
        new = value_text(solved.value)
        if float(new) == old:  # what the digits of a text do not show is no edit
            continue
        edit = _number_edit(text, number, new, file)
        ranked.append((goal.differing_frames(solved.side), len(new), EditedSide(edit, solved.side)))
    # few moved frames, and a round number, make an edit likelier
    ranked.sort(key=lambda entry: entry[:2])
    return [edited for _, _, edited in ranked]


def edits_together(
    side: RobotSide, names: Collection[str], kind: str, goal: EditGoal, file: Callable[[str], str]
) -> list[NumberEdit]:
    """Return edits of several numbers that reach a goal only together; [] if there are none.

    Arguments as in `edited_sides`. The numbers are the solution of a linear system: one step from the stated values.
    """
    text = changeable_text(side)
    if text is None:
        return []
    r = goal.residual(side)
    effective_numbers: list[FileNumber] = []
    slopes: list[Array] = []
    for number in text.numbers(names, kind)[:_MAX_READ_NUMBERS]:
        value = text.value(number)
        step = later_step(value)
        changed = text.with_values([(number, value + step)])
        if changed is None:
            continue
        slope = (goal.residual(changed) - r) / step
        if np.abs(slope).max(initial=0.0) > SMALLEST_SLOPE:
            effective_numbers.append(number)
            slopes.append(slope)
    if len(effective_numbers) < 2:
        return []
    J = np.array(slopes).T
    changes = -np.linalg.pinv(J, rcond=_RANK_RATIO) @ r
    steepest = np.abs(J).max(axis=0)
    changed_numbers: list[tuple[FileNumber, float]] = []
    for k in np.flatnonzero(np.abs(changes) * steepest > goal.rounding):
        value = text.value(effective_numbers[k]) + float(changes[k])
        changed_numbers.append((effective_numbers[k], fewest_decimals(value, goal.rounding / float(steepest[k]))))
    edited = text.with_values(changed_numbers)
    if edited is None or not goal.agrees(edited):
        return []
    edits_of_numbers = []
    for number, value in changed_numbers:
        edits_of_numbers.append(_number_edit(text, number, value_text(value), file))
    return edits_of_numbers


def _number_edit(text: ChangeableText, number: FileNumber, new: str, file: Callable[[str], str]) -> NumberEdit:
    """Return the edit of one number of a text, which was read and compared again with the new one."""
    side = text.side
    place = file(number.file or str(side.path))
    edit = NumberEdit(side.label, place, number.line, number.what, text.written(number), new, confirmed=True)
    return with_obstacle(side, edit, number.file)
