"""The numbers of a file whose edit removes one convention or difference.

For each number that moves the joint or frame in question, the value is searched with which the two sides agree there,
while all other conventions and differences stay as they were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.comparison.fit import FitSolution, Problem, Unknowns, values_of
from twin.comparison.frames import gaps
from twin.comparison.items import ComparedItem, NumberEdit
from twin.comparison.matching import Matching
from twin.comparison.side import RobotSide
from twin.comparison.statements import NumberStatement, statements
from twin.core.spatial import Array

_ROUNDS = 8
"""Steps of the search for one value."""

_STEP = 1e-6
"""Step in m, rad or degrees for derivatives by differences."""

_DIGITS = range(1, 13)
"""Numbers of decimals that are tried, fewest first, for the text of a new value."""

_MOST = 6
"""Maximum number of edits that are told for one item and one side."""


@dataclass(frozen=True)
class _Case:
    """One item of one pair, without its own change: what an edit must achieve.

    Attributes:
        problem: the pair.
        matching: which joints are the same.
        u: the solution without the change of the item.
        edited: 0 if the first side is edited, 1 for the second.
    """

    problem: Problem
    matching: Matching
    u: Unknowns
    edited: int

    @property
    def side(self) -> RobotSide:
        """The side that is edited."""
        return (self.problem.first, self.problem.second)[self.edited]

    def with_side(self, side: RobotSide) -> Problem:
        """Return the pair with another side instead of the edited one."""
        sides = [self.problem.first, self.problem.second]
        sides[self.edited] = side
        return Problem(sides[0], sides[1], self.matching, self.problem.tolerance)

    def residual(self, side: RobotSide) -> Array:
        """Return what remains of lines and leaf frames, in m and rad."""
        problem = self.with_side(side)
        lines = problem.residuals(self.u.signs, values_of(self.u)[None], self.u.deviating)[0]
        parts = [lines]
        for gap in gaps(problem, self.u):
            if gap.leaf:
                parts.append((gap.T - np.eye(4))[:3].ravel())
        return np.concatenate(parts)

    def agrees(self, side: RobotSide, moved_tools: Sequence[int]) -> bool:
        """Return whether all lines coincide, and all leaf frames except those on the joints `moved_tools`."""
        problem = self.with_side(side)
        if not problem.holds(problem.gap(self.u)):
            return False
        for gap in gaps(problem, self.u):
            if gap.leaf and gap.joint not in moved_tools and gap.differs(problem):
                return False
        return True

    def moved_frames(self, statement: NumberStatement, values: Array) -> int:
        """Return the number of frames of inner links that still differ after an edit."""
        side = statement.applied(self.side, tuple(float(value) for value in values))
        assert side is not None
        problem = self.with_side(side)
        return sum(gap.differs(problem) for gap in gaps(problem, self.u))


def with_edits(
    problem: Problem, matching: Matching, solution: FitSolution, items: Sequence[ComparedItem]
) -> list[ComparedItem]:
    """Return the items, each with the edits of either side that remove it."""
    known = [statements(problem.first), statements(problem.second)]
    if not (known[0] or known[1]) or problem.first.looped:
        return list(items)
    moved_tools = [gap.joint for gap in gaps(problem, solution.unknowns) if gap.leaf and gap.differs(problem)]
    out = []
    for item in items:
        edits: list[NumberEdit] = []
        others = moved_tools
        if item.kind == "tool frame":
            joint = problem.second.index(item.joint)
            others = [tool for tool in moved_tools if tool != joint]
        u = _without(problem, solution.unknowns, item)
        if u is not None:
            for edited in (0, 1):
                case = _Case(problem, matching, u, edited)
                edits += _edits(case, known[edited], others)
        out.append(item.with_edits(edits))
    return out


def _without(problem: Problem, u: Unknowns, item: ComparedItem) -> Unknowns | None:
    """Return the unknowns without the change of an item; None if no number of a file is that change."""
    if item.kind == "base frame":
        return replace(u, base=np.zeros(6))
    if item.kind == "tool frame":
        return u
    if item.kind not in ("zero", "sign", "link"):
        return None
    joint = problem.second.index(item.joint)
    if item.kind == "zero":
        zeros = u.zeros.copy()
        zeros[joint] = 0.0
        return replace(u, zeros=zeros)
    if item.kind == "sign":
        signs = u.signs.copy()
        signs[joint] = 1.0
        return replace(u, signs=signs)
    assert u.deviations is not None
    kept = [k for k, deviating in enumerate(u.deviating) if deviating not in (joint, problem.turned_axis(joint))]
    return replace(u, deviating=tuple(u.deviating[k] for k in kept), deviations=u.deviations[kept])


def _edits(case: _Case, known: Sequence[NumberStatement], moved_tools: Sequence[int]) -> list[NumberEdit]:
    """Return the edits of one side that make it agree: of one number or, if there is none, of one attribute."""
    side = case.side
    before = case.residual(side)
    found: list[tuple[int, NumberEdit]] = []
    for statement in known:
        for k in range(len(statement.values)):
            values = _solved(case, statement, [k], before, moved_tools)
            if values is not None:
                found.append((case.moved_frames(statement, values), _edit(side, statement, k, values)))
    named = {(edit.file, edit.line, edit.what.partition("[")[0]) for _, edit in found}
    for statement in known:
        # another axis changes two numbers, and may be likelier than one angle that turns all links behind the joint
        if (found and statement.role != "axis") or (statement.file, statement.line, statement.what) in named:
            continue
        columns = list(range(len(statement.values)))
        values = _solved(case, statement, columns, before, moved_tools)
        if values is not None:
            found.append((case.moved_frames(statement, values), _edit(side, statement, None, values)))
    # frames of inner links that agree as well, and a round number, make an edit likelier
    found.sort(key=lambda pair: (pair[0], len(pair[1].new)))
    # a value that changes less than its text shows is no edit
    changes = [edit for _, edit in found if edit.old != edit.new]
    return changes[:_MOST]


def _solved(
    case: _Case, statement: NumberStatement, columns: Sequence[int], before: Array, moved_tools: Sequence[int]
) -> Array | None:
    """Return the values of a statement with which the sides agree, where only `columns` change; None if none do."""
    values = np.array(statement.values)
    if statement.role == "axis":
        opposite = values.copy()
        opposite[columns] *= -1.0
        if np.any(opposite != values) and _holds(case, statement, opposite, moved_tools):
            return opposite
        if len(columns) == 3:
            # a wrong axis is mostly one of the others, too far away for small steps
            for unit in (*np.eye(3), *-np.eye(3)):
                if _holds(case, statement, unit, moved_tools):
                    return unit + 0.0
    r = before
    for _ in range(_ROUNDS):
        J = _derivatives(case, statement, values, columns, r)
        if J is None or not np.abs(J).max() > 1e-9:
            return None
        step = np.linalg.lstsq(J, -r, rcond=1e-9)[0]
        tried = values.copy()
        tried[columns] += step
        side = statement.applied(case.side, tried)
        if side is None:
            return None
        r_tried = case.residual(side)
        if np.linalg.norm(r_tried) > 0.9 * np.linalg.norm(r) and np.linalg.norm(r) > 1e-9:
            return None
        values = tried
        r = r_tried
        if np.abs(step).max() < 1e-10:
            break
    if not _holds(case, statement, values, moved_tools):
        return None
    return _rounded(case, statement, values, columns, moved_tools)


def _derivatives(
    case: _Case, statement: NumberStatement, values: Array, columns: Sequence[int], r: Array
) -> Array | None:
    """Return the derivatives (rows, columns) of the residual by the values."""
    derivatives = []
    for k in columns:
        moved = values.copy()
        moved[k] += _STEP
        side = statement.applied(case.side, moved)
        if side is None:
            return None
        derivatives.append((case.residual(side) - r) / _STEP)
    return np.array(derivatives).T


def _holds(case: _Case, statement: NumberStatement, values: Array, moved_tools: Sequence[int]) -> bool:
    side = statement.applied(case.side, tuple(float(value) for value in values))
    return side is not None and case.agrees(side, moved_tools)


def _rounded(
    case: _Case, statement: NumberStatement, values: Array, columns: Sequence[int], moved_tools: Sequence[int]
) -> Array:
    """Return the values with as few decimals as are needed for agreement."""
    for digits in _DIGITS:
        rounded = values.copy()
        rounded[columns] = np.round(values[columns], digits)
        # half of the tolerance would be a coincidence: one more digit must not matter
        if np.abs(rounded - values).max() < 0.05 * case.problem.tolerance and _holds(
            case, statement, rounded, moved_tools
        ):
            return rounded + 0.0
    return values


def _edit(side: RobotSide, statement: NumberStatement, column: int | None, values: Array) -> NumberEdit:
    what = statement.what
    old = " ".join(f"{value:.12g}" for value in statement.values)
    new = " ".join(f"{value:.12g}" for value in values)
    if column is not None:
        what = f"{statement.what}[{column}]"
        old = f"{statement.values[column]:.12g}"
        new = f"{values[column]:.12g}"
    return NumberEdit(side.label, _short(statement.file), statement.line, what, old, new)


def _short(file: str) -> str:
    """Return a path relative to the working folder, if it is below it."""
    try:
        return str(Path(file).resolve().relative_to(Path.cwd()))
    except ValueError:
        return file
