"""Edits that make two sides agree in a property: limits, speeds, efforts, masses, centres, inertias, couplings."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from twin.comparison.compared_items import NumberEdit
from twin.comparison.edit_goal import EditGoal
from twin.comparison.evidence import CENTRE_TOLERANCE, LIMIT_TOLERANCE, RELATIVE_TOLERANCE
from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import frame_gaps
from twin.comparison.line_gaps import FitSolution, line_gap
from twin.comparison.matching import Matching
from twin.comparison.paths import relative_path
from twin.comparison.properties import BODY_KINDS, Properties, PropertyRow, compare_properties
from twin.comparison.property_differences import property_difference
from twin.comparison.rereading import EditedSide, edited_sides, edits_together
from twin.comparison.side import RobotSide, plain_name
from twin.core.spatial import Array

_MAX_SEARCHED_ROWS = 12
"""Maximum number of rows for which edits are searched: robots that differ in more are not one edit apart."""

_MAX_ALTERNATIVES = 2
"""Maximum number of edits of one side that are told for a row."""

_SMALLEST_DIFFERENCE = 1e-9
"""Smallest difference in SI units whose part is an inaccuracy."""


def with_property_edits(
    problem: FitProblem, matching: Matching, solution: FitSolution, properties: Properties
) -> Properties:
    """Return the properties, each row that disagrees with the edits of either side.

    A wrong mass moves the centre of mass of welded bodies, and changes their inertia: where the edit of a mass makes
    these agree as well, it is their edit.
    """
    search = _PropertyEdits(problem, matching, solution, properties)
    rows = []
    searched = 0
    for row in properties.rows:
        if row.stated and row.index >= 0 and searched < _MAX_SEARCHED_ROWS:
            searched += 1  # in the order of the rows: masses come before the centres that they move
            row = search.with_edits(row)
        rows.append(row)
    return replace(properties, rows=tuple(rows))


_RowKey = tuple[str, int]
"""Kind and index of a row."""


def _disagreeing_rows(properties: Properties) -> set[_RowKey]:
    """Return the rows in which the sides disagree."""
    keys = set()
    for row in properties.rows:
        if row.stated:
            keys.add((row.kind, row.index))
    return keys


class _PropertyEdits:
    """The search of edits for one row after another; the edits of a row may remove later ones as well."""

    def __init__(self, problem: FitProblem, matching: Matching, solution: FitSolution, properties: Properties) -> None:
        self._problem = problem
        self._matching = matching
        self._solution = solution
        self._disagreeing = _disagreeing_rows(properties)
        self._removed_by: dict[_RowKey, list[NumberEdit]] = {}  # edits of rows before that remove a row

    def with_edits(self, row: PropertyRow) -> PropertyRow:
        """Return a row with its edits."""
        edits: list[NumberEdit] = []
        together = False
        for edited in (0, 1):
            side = (self._problem.first, self._problem.second)[edited]
            earlier_edits = self._removed_by.get((row.kind, row.index), ())
            edits_of_side = []
            for edit in earlier_edits:
                if edit.side == side.label:
                    edits_of_side.append(edit)
            if edits_of_side:
                edits += edits_of_side
                continue
            goal = self._row_goal(row, edited)
            names = _names_of_row(self._problem, row, edited)
            alternatives = edited_sides(side, names, row.kind, goal, relative_path)[:_MAX_ALTERNATIVES]
            for alternative in alternatives:
                edits.append(alternative.edit)
                self._note_removed_rows(row, alternative, edited)
            if not alternatives and not self._has_welded_wrong_mass(side, row, names):
                several = edits_together(side, names, row.kind, goal, relative_path)
                edits += several
                together = together or bool(several)
        return replace(row, edits=tuple(edits), together=together)

    def _note_removed_rows(self, row: PropertyRow, alternative: EditedSide, edited: int) -> None:
        """Keep the edit for each other row that it makes agree."""
        after = compare_properties(self._problem_with(alternative.side, edited), self._solution)
        removed = self._disagreeing - _disagreeing_rows(after) - {(row.kind, row.index)}
        for removed_row in removed:
            self._removed_by.setdefault(removed_row, []).append(alternative.edit)

    def _has_welded_wrong_mass(self, side: RobotSide, row: PropertyRow, names: Collection[str]) -> bool:
        """Return whether a row is about welded bodies whose mass differs: it must be right before numbers are found."""
        if row.kind not in ("centres of mass", "inertias") or ("masses", row.index) not in self._disagreeing:
            return False
        if side.mechanism is None:
            return len(names) > 1
        with_mass = 0
        for body in side.mechanism.bodies:
            if body.inertia is not None and plain_name(body.name) in names:
                with_mass += 1
        return with_mass > 1

    def _problem_with(self, side: RobotSide, edited: int) -> FitProblem:
        """Return the pair with another side instead of the edited one, 0 for the first."""
        sides = [self._problem.first, self._problem.second]
        sides[edited] = side
        return FitProblem(sides[0], sides[1], self._matching, self._problem.tolerance)

    def _row_goal(self, row: PropertyRow, edited: int) -> EditGoal:
        """Return what an edit must achieve: this row agrees, and no other row than before disagrees."""
        solution = self._solution
        unedited = (self._problem.first, self._problem.second)[edited]

        def residual(side: RobotSide) -> Array:
            return property_difference(self._problem_with(side, edited), solution, row.kind, row.index)

        def agrees(side: RobotSide) -> bool:
            if len(side.axes) != len(unedited.axes):
                return False
            # the reader leaves out what no body can have: its other bodies would then agree by chance
            if not set(side.notes) <= set(unedited.notes):
                return False
            pair = self._problem_with(side, edited)
            # the lines are as they were: also those that differ, beside this row
            before = line_gap(self._problem_with(unedited, edited), solution.unknowns)
            after = line_gap(pair, solution.unknowns)
            if after.distances.max() > before.distances.max() + pair.tolerance:
                return False
            if after.angles.max() > before.angles.max() + pair.angle_tolerance:
                return False
            remaining = _disagreeing_rows(compare_properties(pair, solution))
            return (row.kind, row.index) not in remaining and remaining <= self._disagreeing

        def moved(side: RobotSide) -> int:
            # an edit that makes other rows and frames agree as well is likelier
            pair = self._problem_with(side, edited)
            count = 0
            for gap in frame_gaps(pair, solution.unknowns):
                count += gap.differs(pair)
            for other_row in compare_properties(pair, solution).rows:
                count += other_row.stated
            return count

        return EditGoal(residual, agrees, moved, _inaccuracy(row.kind, residual(unedited)))


def _inaccuracy(kind: str, start: Array) -> float:
    """Return the size of a difference that is only inaccuracy, for a row that differs by `start`."""
    if kind == "limits":
        return LIMIT_TOLERANCE
    if kind == "centres of mass":
        return CENTRE_TOLERANCE
    if not start.size:
        return RELATIVE_TOLERANCE
    return RELATIVE_TOLERANCE * max(float(abs(start).max()), _SMALLEST_DIFFERENCE)


def _names_of_row(problem: FitProblem, row: PropertyRow, edited: int) -> set[str]:
    """Return the plain names of the joint or the bodies of a row in one side."""
    side = (problem.first, problem.second)[edited]
    axes = (problem.axes, problem.second.axes)[edited]
    if row.kind not in BODY_KINDS:
        return {plain_name(axes[row.index].name)}
    group = row.index  # of the first side, whichever side is edited
    if edited == 1:
        group = 0
        for i, axis in enumerate(problem.axes):
            if axis.child == row.index and not axis.closes_loop:
                group = axes[i].child
    return set(map(plain_name, side.groups[group].bodies))
