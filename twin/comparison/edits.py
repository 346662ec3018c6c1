"""The numbers of a file whose edit removes one convention or difference.

For each number that moves the joint or frame in question, the value is searched with which the two sides agree there,
while all other conventions and differences stay as they were found.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from twin.comparison import rereading
from twin.comparison.dh_edits import CellStatement
from twin.comparison.fit import FitSolution, Problem, Unknowns, values_of
from twin.comparison.frames import gaps, gaps_of, leaf_gaps
from twin.comparison.items import ComparedItem, NumberEdit
from twin.comparison.matching import Matching
from twin.comparison.rereading import EditGoal, FileNumber
from twin.comparison.side import RobotSide, plain
from twin.comparison.statements import NumberStatement, PlaceStatement, places, statements
from twin.core.spatial import Array

Statement = NumberStatement | PlaceStatement | CellStatement

_ROUNDS = 8
"""Steps of the search for one value."""

_OTHER_STARTS = 2
"""Number of other values from which a search starts, those with the least residual."""

_OTHER = 0.1
"""Change in m, rad or degrees that shows what a value moves."""

_SMALL = 1e-9
"""Residual that no step can decrease."""

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
        moved_tools: joints whose leaf frames differ by other conventions.
    """

    problem: Problem
    matching: Matching
    u: Unknowns
    edited: int
    moved_tools: Sequence[int]

    @property
    def side(self) -> RobotSide:
        """The side that is edited."""
        return (self.problem.first, self.problem.second)[self.edited]

    @cached_property
    def apart(self) -> frozenset[int]:
        """The joints whose lines are apart, as in `Problem.axes`."""
        gap = self.problem.gap(self.u)
        far = (gap.distances > self.problem.tolerance) | (gap.angles > self.problem.angle_tolerance)
        return frozenset(int(i) for i in np.flatnonzero(far))

    def moves_all(self, statement: Statement) -> bool:
        """Return whether a statement moves each joint whose line is apart, or a joint before it in the tree."""
        axes = (self.problem.axes, self.problem.second.axes)[self.edited]
        pending = [i for i, axis in enumerate(axes) if statement.moves(axis)]
        reached: set[int] = set()
        while pending:
            joint = pending.pop()
            reached.add(joint)
            pending += [k for k in self.problem.below[joint] if k not in reached]
        return self.apart <= reached

    def with_side(self, side: RobotSide) -> Problem:
        """Return the pair with another side instead of the edited one."""
        sides = [self.problem.first, self.problem.second]
        sides[self.edited] = side
        return Problem(sides[0], sides[1], self.matching, self.problem.tolerance)

    def residual(self, side: RobotSide) -> Array:
        """Return what remains of lines, and of leaf frames except those on the joints `moved_tools`, in m and rad."""
        problem = self.with_side(side)
        parents, children, groups = problem.motions(self.u.signs, values_of(self.u)[None], self.u.deviating)
        parts = [problem.rows(self.u.signs, parents, children)[0]]
        for gap in gaps_of(problem, groups, inner=False):
            if gap.joint not in self.moved_tools:
                parts.append((gap.T - np.eye(4))[:3].ravel())
        return np.concatenate(parts)

    def agrees(self, side: RobotSide) -> bool:
        """Return whether all lines coincide, and all leaf frames except those on the joints `moved_tools`."""
        problem = self.with_side(side)
        if not problem.holds(problem.gap(self.u)):
            return False
        for gap in leaf_gaps(problem, self.u):
            if gap.joint not in self.moved_tools and gap.differs(problem):
                return False
        return True

    def moved_frames(self, statement: Statement, values: Array) -> int:
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
    if problem.first.looped:
        return list(items)
    moved_tools = [gap.joint for gap in leaf_gaps(problem, solution.unknowns) if gap.differs(problem)]
    common = _common_edits(problem, matching, items, known)
    items_with_edits = []
    for item in items:
        edits: list[NumberEdit] = []
        others = moved_tools
        if item.kind == "tool frame":
            joint = problem.second.index(item.joint)
            others = [tool for tool in moved_tools if tool != joint]
        u = _without(problem, solution.unknowns, item)
        if u is not None:
            for edited in (0, 1):
                case = _Case(problem, matching, u, edited, others)
                edits_of_side = common[edited] + [
                    edit for edit in _edits(case, known[edited]) if edit not in common[edited]
                ]
                if not edits_of_side:
                    edits_of_side = _reread(case, [item], known[edited])
                edits += edits_of_side
        items_with_edits.append(item.with_edits(edits))
    return items_with_edits


def _common_edits(
    problem: Problem,
    matching: Matching,
    items: Sequence[ComparedItem],
    known: Sequence[Sequence[NumberStatement | CellStatement]],
) -> list[list[NumberEdit]]:
    """Return for each side the edits that remove all items at once: one wrong number is likelier than two."""
    moved = [item for item in items if item.kind not in ("name", "order")]
    if len(moved) < 2:
        return [[], []]
    edits_of_sides = []
    for edited in (0, 1):
        case = _Case(problem, matching, problem.start, edited, ())
        edits = _edits(case, known[edited], placed=False)
        if not edits and not known[edited]:
            edits = _reread(case, moved, ())
        edits_of_sides.append(edits)
    return edits_of_sides


def _reread(
    case: _Case, items: Sequence[ComparedItem], known: Sequence[NumberStatement | CellStatement]
) -> list[NumberEdit]:
    """Return the edits of one number of a text that is read again, for numbers that are no statements.

    The statements `known` were tried before: to read the text again with each of their values takes most of the time.
    """
    by_line: dict[int, list[NumberStatement | CellStatement]] = {}
    for statement in known:
        if statement.applied(case.side, statement.values) is not None:
            by_line.setdefault(statement.line, []).append(statement)

    def tried(number: FileNumber, value: float) -> bool:
        return any(_states(statement, number, value) for statement in by_line.get(number.line, ()))

    def moved(side: RobotSide) -> int:
        problem = case.with_side(side)
        return sum(gap.differs(problem) for gap in gaps(problem, case.u))

    def agrees(side: RobotSide) -> bool:
        return len(side.axes) == len(case.side.axes) and case.agrees(side)

    names: set[str] = set()
    for item in items:
        names |= _names(case, item)
    goal = EditGoal(case.residual, agrees, moved, case.problem.tolerance)
    return rereading.edits(case.side, names, "", goal, short, tried)[:_MOST]


def _states(statement: NumberStatement | CellStatement, number: FileNumber, value: float) -> bool:
    """Return whether a number of a text, on the line of a statement, is one of the numbers of this statement."""
    if isinstance(statement, CellStatement):
        # other numbers of a row, as in pi/2, are no values of it
        return abs(value - statement.values[0]) <= 1e-12 * max(abs(value), 1.0)
    if number.file and number.file != statement.file:
        return False
    attribute = number.what.rpartition("[")[0]
    return attribute.endswith(statement.what)


def _names(case: _Case, item: ComparedItem) -> set[str]:
    """Return the plain names of the joint, its links and the frames that an item is about, in the edited side."""
    problem = case.problem
    side = case.side
    names = {item.link}
    for i, axis in enumerate((problem.axes, problem.second.axes)[case.edited]):
        of_item = problem.second.axes[i].name == item.joint
        if item.kind == "base frame":
            of_item = axis.parent == 0
        if not of_item:
            continue
        names.add(axis.name)
        names |= {*side.groups[axis.child].bodies, *side.groups[axis.parent].bodies}
        if item.kind == "tool frame":
            names |= {side.tool, *(name for name, (group, _) in side.frames.items() if group == axis.child)}
    return {plain(name) for name in names if name}


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


def _edits(case: _Case, known: Sequence[NumberStatement | CellStatement], *, placed: bool = True) -> list[NumberEdit]:
    """Return the edits of one side that make it agree: of one number, else of one attribute, else of one place.

    Without `placed`, places are not tried.
    """
    side = case.side
    before = case.residual(side)
    ranked: list[tuple[int, NumberEdit]] = []
    for statement in known:
        for k in range(len(statement.values)):
            values = _solved(case, statement, [k], before)
            if values is not None:
                ranked.append((case.moved_frames(statement, values), _edit(side, statement, k, values)))
    of_one_number = bool(ranked)
    named = {(edit.file, edit.line, edit.what.partition("[")[0]) for _, edit in ranked}
    for statement in known:
        # another axis changes two numbers, and may be likelier than one angle that turns all links behind the joint
        if (of_one_number and statement.role != "axis") or (statement.file, statement.line, statement.what) in named:
            continue
        if len(statement.values) > 1:
            ranked += _whole(case, statement, before)
    if not ranked and placed:
        for place in places(known):
            ranked += _whole(case, place, before)
    # frames of inner links that agree as well, and a round number, make an edit likelier
    ranked.sort(key=lambda pair: (pair[0], len(pair[1].new)))
    # a value that changes less than its text shows is no edit
    changes = [edit for _, edit in ranked if edit.old != edit.new]
    return changes[:_MOST]


def _whole(case: _Case, statement: Statement, before: Array) -> list[tuple[int, NumberEdit]]:
    """Return the edit of all numbers of a statement, with the number of frames that still differ; [] without one."""
    values = _solved(case, statement, list(range(len(statement.values))), before)
    if values is None:
        return []
    return [(case.moved_frames(statement, values), _edit(case.side, statement, None, values))]


def _solved(case: _Case, statement: Statement, columns: Sequence[int], before: Array) -> Array | None:
    """Return the values of a statement with which the sides agree, where only `columns` change; None if none do."""
    if not case.moves_all(statement):
        return None
    # an axis along x, y or z only changes with its other components, or its sign
    if statement.role != "axis" and not _reaches(case, statement, columns, before):
        return None
    for start, r in _starts(case, statement, columns, before):
        values = _improved(case, statement, columns, start, r)
        if values is not None and _holds(case, statement, values):
            return _rounded(case, statement, _wrapped(statement, columns, values), columns)
    return None


def _reaches(case: _Case, statement: Statement, columns: Sequence[int], before: Array) -> bool:
    """Return whether all that remains depends on these numbers: what another value does not move, it cannot remove."""
    values = np.array(statement.values)
    values[columns] += _OTHER * np.arange(1, len(columns) + 1)
    side = statement.applied(case.side, values)
    if side is None:
        return False
    still = np.abs(case.residual(side) - before) < _SMALL * _OTHER
    return not np.any(still & (np.abs(before) > case.problem.tolerance))


def _starts(case: _Case, statement: Statement, columns: Sequence[int], before: Array) -> Iterator[tuple[Array, Array]]:
    """Yield values to start from, with their residuals: the stated ones, then the best of the usual other ones.

    From a rotation by 180 degrees no small step leads to the right one; lost signs and quarter turns are usual errors.
    """
    values = np.array(statement.values)
    yield values, before
    better = []
    for candidate in _candidates(statement, columns):
        side = statement.applied(case.side, candidate)
        if side is not None:
            r = case.residual(side)
            if np.linalg.norm(r) < np.linalg.norm(before):
                better.append((float(np.linalg.norm(r)), candidate, r))
    better.sort(key=lambda one: one[0])
    for _, candidate, r in better[:_OTHER_STARTS]:
        yield candidate, r


def _candidates(statement: Statement, columns: Sequence[int]) -> list[Array]:
    """Return the usual other values: opposite signs, directions along x, y and z, and quarter turns."""
    values = np.array(statement.values)
    candidates = []
    if statement.role == "shift":
        return candidates
    if statement.role != "place":
        opposite = values.copy()
        opposite[columns] *= -1.0
        candidates.append(opposite)
    if statement.role == "axis":
        if len(columns) == 3:
            candidates += [*np.eye(3), *-np.eye(3)]
        return candidates
    angles = _angles(statement, columns)
    if not angles:
        return candidates
    quarter = np.pi / 2 / _unit(statement)
    if len(angles) == 1:
        for turns in (1, -1, 2):
            turned = values.copy()
            turned[angles] += turns * quarter
            candidates.append(turned)
        return candidates
    for turns in itertools.product((0, 1, 2, -1), (0, 1, -1), (0, 1, 2, -1)):
        if turns[1] and turns[0]:
            continue  # at a pitch of 90 degrees, roll and yaw are turns about one line
        turned = values.copy()
        turned[angles] = np.array(turns) * quarter
        candidates.append(turned)
    return candidates


def _angles(statement: Statement, columns: Sequence[int]) -> list[int]:
    """Return which of some values are angles."""
    if isinstance(statement, CellStatement):
        return list(columns) if statement.is_angle else []
    if isinstance(statement, PlaceStatement):
        return [] if statement.turn.kind == "quat" else [3, 4, 5]
    if statement.role == "turn" and statement.kind != "quat":
        return list(columns)
    return []


def _unit(statement: Statement) -> float:
    """Return the unit of the angles of a statement in rad."""
    if isinstance(statement, PlaceStatement):
        return statement.turn.unit
    return statement.unit


def _wrapped(statement: Statement, columns: Sequence[int], values: Array) -> Array:
    """Return values whose changed angles are at most half a turn."""
    wrapped = values.copy()
    turn = 2 * np.pi / _unit(statement)
    for k in _angles(statement, columns):
        if abs(wrapped[k]) > turn / 2 * (1 + 1e-6):
            wrapped[k] -= turn * np.round(wrapped[k] / turn)
    return wrapped


def _improved(case: _Case, statement: Statement, columns: Sequence[int], start: Array, r: Array) -> Array | None:
    """Return the values to which Newton steps lead, or None if the residual does not decrease."""
    values = start
    for _ in range(_ROUNDS):
        if np.linalg.norm(r) < _SMALL:
            break
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
        if np.linalg.norm(r_tried) > 0.9 * np.linalg.norm(r):
            if np.linalg.norm(r) > case.problem.tolerance:
                return None
            break
        values = tried
        r = r_tried
        if np.abs(step).max() < 1e-10:
            break
    return values


def _derivatives(case: _Case, statement: Statement, values: Array, columns: Sequence[int], r: Array) -> Array | None:
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


def _holds(case: _Case, statement: Statement, values: Array) -> bool:
    side = statement.applied(case.side, tuple(float(value) for value in values))
    return side is not None and case.agrees(side)


def _rounded(case: _Case, statement: Statement, values: Array, columns: Sequence[int]) -> Array:
    """Return the values with as few decimals as are needed for agreement."""
    for digits in _DIGITS:
        rounded = values.copy()
        rounded[columns] = np.round(values[columns], digits)
        # half of the tolerance would be a coincidence: one more digit must not matter
        if np.abs(rounded - values).max() < 0.05 * case.problem.tolerance and _holds(case, statement, rounded):
            return rounded + 0.0
    return values


def _edit(side: RobotSide, statement: Statement, column: int | None, values: Array) -> NumberEdit:
    what = statement.what
    old = " ".join(f"{value:.12g}" for value in statement.values)
    new = " ".join(f"{value:.12g}" for value in values)
    if column is not None and len(statement.values) == 1:
        column = None
    if column is not None:
        what = f"{statement.what}[{column}]"
        old = f"{statement.values[column]:.12g}"
        new = f"{values[column]:.12g}"
    edit = NumberEdit(side.label, short(statement.file), statement.line, what, old, new)
    return rereading.hindered(side, edit, statement.file)


def short(file: str) -> str:
    """Return a path relative to the working folder, if it is below it."""
    try:
        return str(Path(file).resolve().relative_to(Path.cwd()))
    except ValueError:
        return file
