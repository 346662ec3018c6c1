"""Edits that make two sides agree in a property: limits, speeds, efforts, masses, centres, inertias, couplings."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

from twin.comparison import rereading
from twin.comparison.evidence import CENTRE, LIMIT, RELATIVE
from twin.comparison.fit import FitSolution, Problem
from twin.comparison.frames import gaps
from twin.comparison.items import NumberEdit
from twin.comparison.matching import Matching
from twin.comparison.paths import short
from twin.comparison.properties import Properties, PropertyRow, compare, difference
from twin.comparison.rereading import EditGoal
from twin.comparison.side import RobotSide, plain
from twin.core.spatial import Array

_MOST = 12
"""Maximum number of rows for which edits are searched: robots that differ in more are not one edit apart."""


def with_property_edits(
    problem: Problem, matching: Matching, solution: FitSolution, properties: Properties
) -> Properties:
    """Return the properties, each row that disagrees with the edits of either side.

    A wrong mass moves the centre of mass of welded bodies, and changes their inertia: where the edit of a mass makes
    these agree as well, it is their edit.
    """
    rows = []
    searched = 0
    healed: dict[tuple[str, int], list[NumberEdit]] = {}
    for row in properties.rows:
        if row.stated and row.index >= 0 and searched < _MOST:
            searched += 1
            row = _with_edits(problem, matching, solution, properties, row, healed)
        rows.append(row)
    return replace(properties, rows=tuple(rows))


def _with_edits(
    problem: Problem,
    matching: Matching,
    solution: FitSolution,
    properties: Properties,
    row: PropertyRow,
    healed: dict[tuple[str, int], list[NumberEdit]],
) -> PropertyRow:
    """Return a row with its edits, and add them to `healed` for each other row that they make agree."""
    known = {(other.kind, other.index) for other in properties.rows if other.stated}
    edits: list[NumberEdit] = []
    together = False
    for edited in (0, 1):
        sides = (problem.first, problem.second)
        own_edits = [edit for edit in healed.get((row.kind, row.index), ()) if edit.side == sides[edited].label]
        if own_edits:
            edits += own_edits
            continue

        def paired(side: RobotSide, edited: int = edited, sides: tuple[RobotSide, RobotSide] = sides) -> Problem:
            both = list(sides)
            both[edited] = side
            return Problem(both[0], both[1], matching, problem.tolerance)

        goal = _goal(paired, solution, row, known, sides[edited])
        names = _names(problem, row, edited)
        found = rereading.edited_sides(sides[edited], names, row.kind, goal, short)[:2]
        edits += [edit for edit, _ in found]
        for edit, side in found:
            remaining = {(other.kind, other.index) for other in compare(paired(side), solution).rows if other.stated}
            for other in known - remaining - {(row.kind, row.index)}:
                healed.setdefault(other, []).append(edit)
        if not found and not _welded_with_wrong_mass(sides[edited], known, row, names):
            several = rereading.edits_together(sides[edited], names, row.kind, goal, short)
            edits += several
            together = together or bool(several)
    return replace(row, edits=tuple(edits), together=together)


def _welded_with_wrong_mass(
    side: RobotSide, known: Collection[tuple[str, int]], row: PropertyRow, names: Collection[str]
) -> bool:
    """Return whether a row is about welded bodies whose mass differs: it must be right before numbers are found."""
    if row.kind not in ("centres of mass", "inertias") or ("masses", row.index) not in known:
        return False
    if side.mechanism is None:
        return len(names) > 1
    with_mass = 0
    for body in side.mechanism.bodies:
        with_mass += body.inertia is not None and plain(body.name) in names
    return with_mass > 1


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
        # the reader leaves out what no body can have: its other bodies would then agree by chance
        if not set(edited.notes) <= set(side.notes):
            return False
        pair = paired(edited)
        # the lines are as they were: also those that differ, beside this row
        before = paired(side).gap(solution.unknowns)
        after = pair.gap(solution.unknowns)
        if after.distances.max() > before.distances.max() + pair.tolerance:
            return False
        if after.angles.max() > before.angles.max() + pair.angle_tolerance:
            return False
        remaining = {(other.kind, other.index) for other in compare(pair, solution).rows if other.stated}
        return (row.kind, row.index) not in remaining and remaining <= set(known)

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
