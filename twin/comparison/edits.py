"""The numbers of a file whose edit removes one convention or difference.

For each number that moves the joint or frame in question, the value is searched with which the two sides agree there,
while all other conventions and differences stay as they were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.comparison.changed_text import value_text
from twin.comparison.compared_items import ComparedItem, NumberEdit
from twin.comparison.dh_statements import CellStatement
from twin.comparison.edit_case import EditCase, Statement
from twin.comparison.edit_goal import EditGoal
from twin.comparison.file_numbers import FileNumber
from twin.comparison.file_statements import statements
from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import leaf_frame_gaps
from twin.comparison.line_gaps import FitSolution
from twin.comparison.matching import Matching
from twin.comparison.paths import relative_path
from twin.comparison.rereading import edits_of_one_number
from twin.comparison.side import RobotSide, plain_name
from twin.comparison.solved_value import solved_values
from twin.comparison.statements import NumberStatement, place_statements_of
from twin.comparison.unknowns import Unknowns
from twin.comparison.xacro_lines import with_obstacle
from twin.core.spatial import Array

_MAX_EDITS = 6
"""Maximum number of edits that are told for one item and one side."""

_VALUE_TOLERANCE = 1e-12
"""Difference of a number of a text and a value of a table, relative to 1 or the number, that is only rounding."""


def with_edits(
    problem: FitProblem, matching: Matching, solution: FitSolution, items: Sequence[ComparedItem]
) -> list[ComparedItem]:
    """Return the items, each with the edits of either side that remove it; for robots with loops, without edits."""
    if problem.first.has_loops:
        return list(items)
    statements_of_sides = [statements(problem.first), statements(problem.second)]
    moved_tools = []
    for gap in leaf_frame_gaps(problem, solution.unknowns):
        if gap.differs(problem):
            moved_tools.append(gap.joint)
    common = _common_edits(problem, matching, items, statements_of_sides)
    items_with_edits = []
    for item in items:
        unknowns = _unknowns_without(problem, solution.unknowns, item)
        if unknowns is None:
            items_with_edits.append(item.with_edits(()))
            continue
        other_tools = moved_tools
        if item.kind == "tool frame":
            # after an edit, this tool must agree; the others may stay moved
            joint = problem.second.index(item.joint)
            other_tools = [tool for tool in moved_tools if tool != joint]
        edits: list[NumberEdit] = []
        for edited in (0, 1):
            case = EditCase(problem, matching, unknowns, edited, other_tools)
            edits += _edits_of_item(case, item, common[edited], statements_of_sides[edited])
        items_with_edits.append(item.with_edits(edits))
    return items_with_edits


def _edits_of_item(
    case: EditCase,
    item: ComparedItem,
    common: Sequence[NumberEdit],
    statements_of_side: Sequence[NumberStatement | CellStatement],
) -> list[NumberEdit]:
    """Return the edits of one side that remove an item: those of all items, of statements, else of other numbers."""
    edits = list(common)
    for edit in _edits_of_statements(case, statements_of_side):
        if edit not in common:
            edits.append(edit)
    if not edits:
        edits = _edits_by_rereading(case, [item], statements_of_side)
    return edits


def _common_edits(
    problem: FitProblem,
    matching: Matching,
    items: Sequence[ComparedItem],
    statements_of_sides: Sequence[Sequence[NumberStatement | CellStatement]],
) -> list[list[NumberEdit]]:
    """Return for each side the edits that remove all items at once: one wrong number is likelier than two."""
    geometric = [item for item in items if item.moves_geometry]
    if len(geometric) < 2:
        return [[], []]
    edits_of_sides = []
    for edited in (0, 1):
        # without any convention, so that an edit must remove all items
        case = EditCase(problem, matching, problem.unchanged, edited, ())
        edits = _edits_of_statements(case, statements_of_sides[edited], with_places=False)
        # To read a text again for each of its numbers takes long. Where numbers of it are statements, these were tried,
        # and its other numbers are only tried for single items.
        if not edits and not statements_of_sides[edited]:
            edits = _edits_by_rereading(case, geometric, ())
        edits_of_sides.append(edits)
    return edits_of_sides


def _edits_by_rereading(
    case: EditCase, items: Sequence[ComparedItem], statements_of_side: Sequence[NumberStatement | CellStatement]
) -> list[NumberEdit]:
    """Return the edits of one number of a text that is read again, for numbers that are no statements.

    The statements were tried before: to read the text again with each of their values takes most of the time.
    """
    by_line: dict[int, list[NumberStatement | CellStatement]] = {}
    for statement in statements_of_side:
        if statement.applied(case.side, statement.values) is not None:
            by_line.setdefault(statement.line, []).append(statement)

    def is_tried(number: FileNumber, value: float) -> bool:
        on_line = by_line.get(number.line, ())
        return any(_is_number_of(statement, number, value) for statement in on_line)

    def agrees(side: RobotSide) -> bool:
        return len(side.axes) == len(case.side.axes) and case.agrees(side)

    names: set[str] = set()
    for item in items:
        names |= _names_of_item(case, item)
    goal = EditGoal(case.residual, agrees, case.differing_frames, case.problem.tolerance)
    return edits_of_one_number(case.side, names, "", goal, relative_path, is_tried)[:_MAX_EDITS]


def _is_number_of(statement: NumberStatement | CellStatement, number: FileNumber, value: float) -> bool:
    """Return whether a number of a text, on the line of a statement, is one of the numbers of this statement."""
    if isinstance(statement, CellStatement):
        # other numbers of a row, as in pi/2, are no values of it
        return abs(value - statement.values[0]) <= _VALUE_TOLERANCE * max(abs(value), 1.0)
    if number.file and number.file != statement.file:
        return False
    attribute = number.what.rpartition("[")[0]
    return attribute.endswith(statement.what)


def _names_of_item(case: EditCase, item: ComparedItem) -> set[str]:
    """Return the plain names of the joint, its links and the frames that an item is about, in the edited side."""
    problem = case.problem
    side = case.side
    names = {item.link}
    axes_of_side = problem.second.axes if case.edited_side_index else problem.axes
    for axis, second in zip(axes_of_side, problem.second.axes, strict=True):
        is_of_item = second.name == item.joint
        if item.kind == "base frame":
            is_of_item = axis.parent == 0
        if not is_of_item:
            continue
        names.add(axis.name)
        names.update(side.groups[axis.child].bodies)
        names.update(side.groups[axis.parent].bodies)
        if item.kind == "tool frame":
            names.add(side.tool)
            for frame, (group, _) in side.frames.items():
                if group == axis.child:
                    names.add(frame)
    names.discard("")  # an item about no single link has this one
    return set(map(plain_name, names))


def _unknowns_without(problem: FitProblem, unknowns: Unknowns, item: ComparedItem) -> Unknowns | None:
    """Return the unknowns without the change of an item; None if no number of a file is that change."""
    if item.kind == "base frame":
        return replace(unknowns, base=np.zeros(6))
    if item.kind == "tool frame":  # no unknown stands for a tool
        return unknowns
    if item.kind not in ("zero", "sign", "link"):
        return None
    joint = problem.second.index(item.joint)
    if item.kind == "zero":
        zeros = unknowns.zeros.copy()
        zeros[joint] = 0.0
        return replace(unknowns, zeros=zeros)
    if item.kind == "sign":
        signs = unknowns.signs.copy()
        signs[joint] = 1.0
        return replace(unknowns, signs=signs)
    assert unknowns.deviations is not None
    rows = []
    still_deviating = []
    for k, deviation in enumerate(unknowns.deviating):
        if deviation.joint != joint:
            rows.append(k)
            still_deviating.append(deviation)
    return replace(unknowns, deviating=tuple(still_deviating), deviations=unknowns.deviations[rows])


def _edits_of_statements(
    case: EditCase, statements_of_side: Sequence[NumberStatement | CellStatement], *, with_places: bool = True
) -> list[NumberEdit]:
    """Return the edits of one side that make it agree: of one number, else of one attribute, else of one place.

    Without `with_places`, places are not tried.
    """
    side = case.side
    before = case.residual(side)
    ranked_edits: list[tuple[int, NumberEdit]] = []
    for statement in statements_of_side:
        for k in range(len(statement.values)):
            values = solved_values(case, statement, [k], before)
            if values is not None:
                ranked_edits.append(
                    (_differing_frames(case, statement, values), _number_edit(side, statement, k, values))
                )
    has_edit_of_one_number = bool(ranked_edits)
    edited_statements: set[tuple[str, int, str]] = set()
    for _, edit in ranked_edits:
        what, _, _ = edit.what.partition("[")
        edited_statements.add((edit.file, edit.line, what))
    for statement in statements_of_side:
        # another axis changes two numbers, and may be likelier than one angle that turns all links behind the joint
        if has_edit_of_one_number and statement.role != "axis":
            continue
        if len(statement.values) > 1 and (statement.file, statement.line, statement.what) not in edited_statements:
            ranked_edits += _edit_of_all_numbers(case, statement, before)
    if not ranked_edits and with_places:
        for place in place_statements_of(statements_of_side):
            ranked_edits += _edit_of_all_numbers(case, place, before)
    # frames of inner links that agree as well, and a round number, make an edit likelier
    ranked_edits.sort(key=lambda pair: (pair[0], len(pair[1].new)))
    # a value that changes less than its text shows is no edit
    changes = []
    for _, edit in ranked_edits:
        if edit.old != edit.new:
            changes.append(edit)
    return changes[:_MAX_EDITS]


def _edit_of_all_numbers(case: EditCase, statement: Statement, before: Array) -> list[tuple[int, NumberEdit]]:
    """Return the edit of all numbers of a statement, with the number of frames that still differ; [] without one."""
    values = solved_values(case, statement, list(range(len(statement.values))), before)
    if values is None:
        return []
    return [(_differing_frames(case, statement, values), _number_edit(case.side, statement, None, values))]


def _differing_frames(case: EditCase, statement: Statement, values: Array) -> int:
    """Return the number of frames of inner links that still differ after an edit."""
    side = statement.applied(case.side, values.tolist())
    assert side is not None
    return case.differing_frames(side)


def _number_edit(side: RobotSide, statement: Statement, column: int | None, values: Array) -> NumberEdit:
    """Return the edit of one number of a statement or, without a column, of all."""
    what = statement.what
    old = " ".join(map(value_text, statement.values))
    new = " ".join(map(value_text, values))
    if column is not None and len(statement.values) == 1:
        column = None
    if column is not None:
        what = f"{statement.what}[{column}]"
        old = value_text(statement.values[column])
        new = value_text(values[column])
    edit = NumberEdit(side.label, relative_path(statement.file), statement.line, what, old, new)
    return with_obstacle(side, edit, statement.file)
