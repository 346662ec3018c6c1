"""Edits that are found by reading a changed text again: for formats without statements, and for properties.

Each number of the text that belongs to the joint or link in question is changed a little, and the text is read again:
this shows what the number does, whatever the format is. The text of an edit was therefore read, and it agrees.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.comparison.compared_items import NumberEdit
from twin.comparison.file_numbers import FileNumber, numbers, text_of
from twin.comparison.side import RobotSide
from twin.comparison.xacro_lines import obstacle
from twin.core.errors import TwinError
from twin.core.spatial import Array

_MAX_READ_NUMBERS = 150
"""Maximum number of numbers of one text that are tried for one item."""

_MAX_READ_ATTRIBUTES = 12
"""Maximum number of attributes of one text that are tried where each reading closes loops."""

_MAX_REMEMBERED_TEXTS = 2000
"""Maximum number of changed texts of one file whose sides are kept."""

_RELATIVE_STEP = 1e-3
"""Relative change of a number that shows what it does; files in single precision round finer ones away."""

_MAX_STEPS = 8
"""Maximum number of steps to the value."""

_MAX_REMAINING_SHARE = 0.5
"""Part of the difference that may remain after the first step: a number must be able to remove the other half."""

_FIRST_STEP_VALUE = 0.1
"""Value in the unit of the file below which the first step is that of this value: of zero, no part is a step."""

_LATER_STEP_VALUE = 1e-3
"""The same for the further steps, and where several numbers change together."""

_SMALLEST_SLOPE = 1e-9
"""Change of the residual per change of a number below which the number moves nothing."""

_LARGEST_CHANGE = 1e6
"""Change of a number, in the unit of the file, that leads nowhere."""

_CONVERGED_SHARE = 0.01
"""Change of the residual, relative to the inaccuracy of the goal, after which the steps end."""

_ROUNDING_SHARE = 0.05
"""Largest change of the residual by rounding, relative to the inaccuracy of the goal."""

_MOST_DIGITS = 13
"""Number of decimals up to which a value is rounded: from 0 to 12, as many as are written."""

_VALUE_TOLERANCE = 1e-12
"""Difference of two values of a number that are the same."""

_QUARTER_TURN_ROUNDING = 1e-6
"""Inaccuracy of a quarter turn in rad or degrees that is written with few digits."""

_MULTIPLE_TOLERANCE = 1e-4
"""Part of a quarter turn up to which an angle is a multiple of it."""


_AXIS_TERM = re.compile(r"axis")
"""A direction, whose numbers are mostly 0, 1 and -1."""


@dataclass(frozen=True)
class EditGoal:
    """What an edit must achieve.

    Attributes:
        residual: a function of a side that returns what differs; zero is agreement.
        agrees: a function of a side that returns whether the two sides agree there, and nowhere less than before.
        differing_frames: a function of a side that returns how many further frames differ; fewer make an edit likelier.
        inaccuracy: size of a residual that is only inaccuracy.
    """

    residual: Callable[[RobotSide], Array]
    agrees: Callable[[RobotSide], bool]
    differing_frames: Callable[[RobotSide], int]
    inaccuracy: float


def with_memory(side: RobotSide) -> RobotSide:
    """Return the side with a `reread` that reads each text once: the edits of many items try the same ones."""
    reread = side.reread
    if reread is None:
        return side
    sides_of_texts: dict[bytes, RobotSide | TwinError] = {}

    def read_once(text: bytes) -> RobotSide:
        key = hashlib.sha256(text).digest()
        side_read_before = sides_of_texts.get(key)
        if side_read_before is None:
            try:
                side_read_before = reread(text)
            except TwinError as error:  # a text that cannot be read is not tried again either
                side_read_before = error
            if len(sides_of_texts) < _MAX_REMEMBERED_TEXTS:
                sides_of_texts[key] = side_read_before
        if isinstance(side_read_before, TwinError):
            raise side_read_before
        return side_read_before

    return replace(side, reread=read_once)


def _nothing_is_tried(_number: FileNumber, _value: float) -> bool:
    """Return that no number was tried before."""
    return False


@dataclass(frozen=True)
class EditedSide:
    """An edit of a number, and the side that was read with it."""

    edit: NumberEdit
    side: RobotSide


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
    data = text_of(side)
    if data is None:
        return []
    ranked: list[tuple[int, int, EditedSide]] = []
    before = goal.residual(side)
    for number in numbers(side, names, kind)[:_MAX_READ_NUMBERS]:
        old = _value(data, number)
        if is_tried(number, old):
            continue
        solved = _solved_number(side, data, number, goal, before)
        if solved is None:
            continue
        new = _text(solved.value)
        if float(new) == old:  # what the digits of a text do not show is no edit
            continue
        edit = _number_edit(side, data, number, new, file)
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
    data = text_of(side)
    if data is None:
        return []
    r = goal.residual(side)
    effective_numbers: list[FileNumber] = []
    slopes: list[Array] = []
    for number in numbers(side, names, kind)[:_MAX_READ_NUMBERS]:
        value = _value(data, number)
        step = _RELATIVE_STEP * max(abs(value), _LATER_STEP_VALUE)
        changed = _reread(side, data, [(number, value + step)])
        if changed is None:
            continue
        slope = (goal.residual(changed) - r) / step
        if np.abs(slope).max(initial=0.0) > _SMALLEST_SLOPE:
            effective_numbers.append(number)
            slopes.append(slope)
    if len(effective_numbers) < 2:
        return []
    J = np.array(slopes).T
    changes = -np.linalg.pinv(J, rcond=1e-9) @ r
    steepest = np.abs(J).max(axis=0)
    allowed = _ROUNDING_SHARE * goal.inaccuracy
    changes_of_numbers: list[tuple[FileNumber, float]] = []
    for k in np.flatnonzero(np.abs(changes) * steepest > allowed):
        value = _value(data, effective_numbers[k]) + float(changes[k])
        changes_of_numbers.append((effective_numbers[k], _fewest_digits(value, allowed / float(steepest[k]))))
    edited = _reread(side, data, changes_of_numbers)
    if edited is None or not goal.agrees(edited):
        return []
    edits_of_numbers = []
    for number, value in changes_of_numbers:
        edits_of_numbers.append(_number_edit(side, data, number, _text(value), file))
    return edits_of_numbers


def _number_edit(side: RobotSide, data: bytes, number: FileNumber, new: str, file: Callable[[str], str]) -> NumberEdit:
    """Return the edit of one number of a text, which was read and compared again with the new one."""
    old = _written(data, number)
    place = file(number.file or str(side.path))
    edit = NumberEdit(side.label, place, number.line, number.what, old, new, confirmed=True)
    return with_obstacle(side, edit, number.file)


def attribute_edits(
    side: RobotSide, names: Collection[str], goal: EditGoal, file: Callable[[str], str]
) -> list[NumberEdit]:
    """Return the edits of all numbers of one attribute that reach a goal, for attributes that place a joint.

    Arguments as in `edited_sides`.
    """
    data = text_of(side)
    if data is None:
        return []
    attributes: dict[tuple[int, str], list[FileNumber]] = {}
    for number in numbers(side, names, ""):
        attribute, _, _ = number.what.rpartition("[")
        attributes.setdefault((number.line, attribute), []).append(number)
    edits_of_side: list[NumberEdit] = []
    before = goal.residual(side)
    for (line, what), own_numbers in list(attributes.items())[:_MAX_READ_ATTRIBUTES]:
        values = _attribute_values(side, data, own_numbers, goal, before)
        if values is None:
            continue
        # as the file writes them, so that the text of the edit is found in the file
        written_values = [_written(data, number) for number in own_numbers]
        old = " ".join(written_values)
        new = " ".join(map(_text, values))
        source = own_numbers[0].file
        edit = NumberEdit(side.label, file(source or str(side.path)), line, what, old, new, confirmed=True)
        edits_of_side.append(with_obstacle(side, edit, source))
    return edits_of_side


def _attribute_values(
    side: RobotSide, data: bytes, attribute_numbers: Sequence[FileNumber], goal: EditGoal, before: Array
) -> list[float] | None:
    """Return the values of the numbers of an attribute with which a goal is reached; None if there are none."""
    numbers_before = [_value(data, number) for number in attribute_numbers]
    values = np.array(numbers_before)
    J = _attribute_derivatives(side, data, attribute_numbers, values, goal, before)
    if J is None:
        return None
    r = before
    for _ in range(_MAX_STEPS):
        # with the derivatives of the stated values: to close the loops again for new ones takes most of the time
        change = -np.linalg.pinv(J, rcond=1e-6) @ r
        if np.linalg.norm(r + J @ change) > _MAX_REMAINING_SHARE * np.linalg.norm(r):
            return None
        values = values + change
        edited = _reread_with(side, data, attribute_numbers, values)
        if edited is None:
            return None
        if goal.agrees(edited):
            return _fewest_decimals(side, data, attribute_numbers, goal, values)
        r = goal.residual(edited)
        # another shape: with this value the file has other joints
        if r.shape != before.shape or not np.linalg.norm(r) < np.linalg.norm(before):
            return None
    return None


def _attribute_derivatives(
    side: RobotSide, data: bytes, attribute_numbers: Sequence[FileNumber], values: Array, goal: EditGoal, before: Array
) -> Array | None:
    """Return the derivatives (rows, numbers) of the residual `before` by the values; None if a text cannot be read."""
    slopes = []
    for k in range(len(attribute_numbers)):
        step = _RELATIVE_STEP * max(abs(float(values[k])), _FIRST_STEP_VALUE)
        stepped = values.copy()
        stepped[k] += step
        changed = _reread_with(side, data, attribute_numbers, stepped)
        if changed is None:
            return None
        residual = goal.residual(changed)
        if residual.shape != before.shape:
            return None
        slopes.append((residual - before) / step)
    return np.array(slopes).T


def _fewest_decimals(
    side: RobotSide, data: bytes, attribute_numbers: Sequence[FileNumber], goal: EditGoal, values: Array
) -> list[float]:
    """Return the values with as few decimals as are needed, within a twentieth of the inaccuracy."""
    rounded = []
    for value in values.tolist():
        rounded.append(_fewest_digits(value, _ROUNDING_SHARE * goal.inaccuracy))
    edited = _reread_with(side, data, attribute_numbers, np.array(rounded))
    if edited is not None and goal.agrees(edited):
        return rounded
    return values.tolist()


def _reread_with(
    side: RobotSide, data: bytes, attribute_numbers: Sequence[FileNumber], values: Array
) -> RobotSide | None:
    """Return the side with other values of some numbers; None if the text can then not be read."""
    return _reread(side, data, list(zip(attribute_numbers, values.tolist(), strict=True)))


def _reread(side: RobotSide, data: bytes, changes: Sequence[tuple[FileNumber, float]]) -> RobotSide | None:
    """Return the side with other values of some numbers of its text; None if the text can then not be read."""
    assert side.reread is not None
    changed = data
    # from the last number, so that the places of those before it stay
    for number, value in sorted(changes, key=lambda change: -change[0].start):
        changed = changed[: number.start] + _text(value).encode() + changed[number.end :]
    try:
        return side.reread(changed)
    except TwinError:
        return None


def with_obstacle(side: RobotSide, edit: NumberEdit, file: str) -> NumberEdit:
    """Return an edit of an expanded xacro without its new number if its line in `file` does not state the number."""
    if side.text is None:
        return edit
    reason = obstacle(side.xacro_places, file, edit.line, edit.what, edit.old)
    if not reason:
        return edit
    return replace(edit, new="", confirmed=False, obstacle=reason)


def _fewest_digits(value: float, inaccuracy: float) -> float:
    """Return a value with as few decimals as an inaccuracy allows."""
    for digits in range(_MOST_DIGITS):
        rounded = round(value, digits) + 0.0  # 0.0 instead of -0.0
        if abs(rounded - value) <= inaccuracy:
            return rounded
    return value


def _text(value: float) -> str:
    """Return a value with the twelve digits that an edit states."""
    return f"{value:.12g}"


def _written(data: bytes, number: FileNumber) -> str:
    """Return a number as the text states it."""
    return data[number.start : number.end].decode()


def _value(data: bytes, number: FileNumber) -> float:
    """Return the value of a number in a text."""
    return float(_written(data, number))


@dataclass(frozen=True)
class _SolvedNumber:
    """A value of a number with which a goal is reached, and the side with it."""

    value: float
    side: RobotSide


def _solved_number(
    side: RobotSide, data: bytes, number: FileNumber, goal: EditGoal, before: Array
) -> _SolvedNumber | None:
    """Return the value of a number with which a goal is reached; None if there is none.

    By secant steps in the least-squares sense; where these lead nowhere, from the usual other values.
    """
    value = _value(data, number)
    step = _RELATIVE_STEP * max(abs(value), _FIRST_STEP_VALUE)
    r = before
    slope: Array | None = None
    edited: RobotSide | None = None
    for _ in range(_MAX_STEPS):
        changed = _reread(side, data, [(number, value + step)])
        if changed is None:
            return None
        r_changed = goal.residual(changed)
        if r_changed.shape != r.shape:
            return None
        slope = (r_changed - r) / step
        strength = float(slope @ slope)
        if strength < _SMALLEST_SLOPE**2:
            return None if edited is not None else _usual_value(side, data, number, goal)
        change = -float(slope @ r) / strength
        if edited is None and np.linalg.norm(r + slope * change) > _MAX_REMAINING_SHARE * np.linalg.norm(r):
            return _usual_value(side, data, number, goal)
        if not abs(change) < _LARGEST_CHANGE:  # true also for NaN
            return None
        value += change
        edited = _reread(side, data, [(number, value)])
        if edited is None:
            return None
        r = goal.residual(edited)
        if abs(change) * np.sqrt(strength) < _CONVERGED_SHARE * goal.inaccuracy:
            break
        step = _RELATIVE_STEP * max(min(abs(change), abs(value)), _LATER_STEP_VALUE)
    if edited is None or slope is None or not goal.agrees(edited):
        return _usual_value(side, data, number, goal)
    steepest = float(np.abs(slope).max())
    return _rounded(side, data, number, goal, value, steepest) or _SolvedNumber(value, edited)


def _usual_value(side: RobotSide, data: bytes, number: FileNumber, goal: EditGoal) -> _SolvedNumber | None:
    """Return the number with a lost sign, a quarter turn or zero if that reaches the goal: too far for small steps."""
    value = _value(data, number)
    for candidate in _usual_values(number, value):
        if abs(candidate - value) < _VALUE_TOLERANCE:
            continue
        edited = _reread(side, data, [(number, candidate)])
        if edited is not None and goal.agrees(edited):
            return _SolvedNumber(_fewest_digits(candidate, _QUARTER_TURN_ROUNDING), edited)
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


def _rounded(
    side: RobotSide, data: bytes, number: FileNumber, goal: EditGoal, value: float, slope: float
) -> _SolvedNumber | None:
    """Return the value with as few decimals as are needed; `slope` is the change of the residual by the value."""
    for digits in range(_MOST_DIGITS):
        rounded = round(value, digits) + 0.0
        # half of the tolerance would be a coincidence: one more digit must not matter
        if abs(rounded - value) * slope > _ROUNDING_SHARE * goal.inaccuracy:
            continue
        edited = _reread(side, data, [(number, rounded)])
        if edited is not None and goal.agrees(edited):
            return _SolvedNumber(rounded, edited)
    return None
