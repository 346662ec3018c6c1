"""Edits that make two sides agree in a property: limits, speeds, efforts, masses, centres, inertias, couplings."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

from twin.comparison import rereading
from twin.comparison.edits import short
from twin.comparison.evidence import CENTRE, LIMIT, RELATIVE
from twin.comparison.fit import FitSolution, Problem
from twin.comparison.frames import gaps
from twin.comparison.items import NumberEdit
from twin.comparison.matching import Matching
from twin.comparison.properties import Properties, PropertyRow, compare, difference
from twin.comparison.rereading import EditGoal
from twin.comparison.side import RobotSide, plain
from twin.core.spatial import Array

_MOST = 12
"""Maximum number of rows for which edits are searched: robots that differ in more are not one edit apart."""


def with_property_edits(
    problem: Problem, matching: Matching, solution: FitSolution, properties: Properties
) -> Properties:
    """Return the properties, each row that disagrees with the edits of either side."""
    rows = []
    searched = 0
    for row in properties.rows:
        if row.stated and row.index >= 0 and searched < _MOST:
            searched += 1
            row = _with_edits(problem, matching, solution, properties, row)
        rows.append(row)
    return replace(properties, rows=tuple(rows))


def _with_edits(
    problem: Problem, matching: Matching, solution: FitSolution, properties: Properties, row: PropertyRow
) -> PropertyRow:
    known = {(other.kind, other.index) for other in properties.rows if other.stated}
    edits: list[NumberEdit] = []
    together = False
    for edited in (0, 1):
        sides = (problem.first, problem.second)

        def paired(side: RobotSide, edited: int = edited, sides: tuple[RobotSide, RobotSide] = sides) -> Problem:
            both = list(sides)
            both[edited] = side
            return Problem(both[0], both[1], matching, problem.tolerance)

        goal = _goal(paired, solution, row, known, sides[edited])
        names = _names(problem, row, edited)
        found = rereading.edits(sides[edited], names, row.kind, goal, short)[:2]
        if not found:
            found = rereading.edits_together(sides[edited], names, row.kind, goal, short)
            together = together or bool(found)
        edits += found
    return replace(row, edits=tuple(edits), together=together)


def _goal(
    paired: Callable[[RobotSide], Problem],
    solution: FitSolution,
    row: PropertyRow,
    known: Collection[tuple[str, int]],
    side: RobotSide,
) -> EditGoal:
    """Return what an edit must achieve: this row agrees, and no other row than before disagrees."""

    def residual(edited: RobotSide) -> Array:
        return difference(paired(edited), solution, row.kind, row.index)

    def agrees(edited: RobotSide) -> bool:
        if len(edited.axes) != len(side.axes):
            return False
        pair = paired(edited)
        # the lines are as they were: also those that differ, beside this row
        before = paired(side).gap(solution.unknowns)
        after = pair.gap(solution.unknowns)
        if after.distances.max() > before.distances.max() + pair.tolerance:
            return False
        if after.angles.max() > before.angles.max() + pair.angle_tolerance:
            return False
        left = {(other.kind, other.index) for other in compare(pair, solution).rows if other.stated}
        return (row.kind, row.index) not in left and left <= set(known)

    def moved(edited: RobotSide) -> int:
        # an edit that makes other rows and frames agree as well is likelier
        pair = paired(edited)
        frames = sum(gap.differs(pair) for gap in gaps(pair, solution.unknowns))
        return frames + sum(other.stated for other in compare(pair, solution).rows)

    scale = 1.0
    start = residual(side)
    if start.size:
        scale = max(float(abs(start).max()), 1e-9)
    limits = {"limits": LIMIT, "centres of mass": CENTRE}
    return EditGoal(residual, agrees, moved, limits.get(row.kind, RELATIVE * scale))


def _names(problem: Problem, row: PropertyRow, edited: int) -> set[str]:
    """Return the plain names of the joint or the bodies of a row in one side."""
    side = (problem.first, problem.second)[edited]
    axes = (problem.axes, problem.second.axes)[edited]
    if row.kind not in ("masses", "centres of mass", "inertias"):
        return {plain(axes[row.index].name)}
    group = row.index
    if edited == 1:
        group = 0
        for i, axis in enumerate(problem.axes):
            if axis.child == row.index and not axis.closing:
                group = axes[i].child
    return {plain(body) for body in side.groups[group].bodies}
