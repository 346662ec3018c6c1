"""What an edit of one side must achieve: the two sides agree without one change of their fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.comparison.dh_statements import CellStatement
from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import frame_gaps, frame_gaps_of_motions, leaf_frame_gaps
from twin.comparison.line_gaps import line_gap, line_residuals, lines_coincide
from twin.comparison.matching import Matching
from twin.comparison.side import RobotSide
from twin.comparison.statements import NumberStatement, PlaceStatement
from twin.comparison.unknowns import Unknowns, values_of
from twin.core.spatial import Array

Statement = NumberStatement | PlaceStatement | CellStatement


@dataclass(frozen=True)
class EditCase:
    """One item of one pair, without its own change: what an edit must achieve.

    Attributes:
        problem: the pair.
        matching: which joints are the same.
        unknowns: the solution without the change of the item.
        edited_side_index: 0 if the first side is edited, 1 for the second.
        moved_tools: joints whose leaf frames differ by other conventions.
    """

    problem: FitProblem
    matching: Matching
    unknowns: Unknowns
    edited_side_index: int
    moved_tools: Sequence[int]

    @property
    def side(self) -> RobotSide:
        """The side that is edited."""
        return (self.problem.first, self.problem.second)[self.edited_side_index]

    @cached_property
    def differing_joints(self) -> frozenset[int]:
        """The joints whose lines are apart, as in `FitProblem.axes`."""
        gap = line_gap(self.problem, self.unknowns)
        is_apart = (gap.distances > self.problem.tolerance) | (gap.angles > self.problem.angle_tolerance)
        return frozenset(np.flatnonzero(is_apart).tolist())

    def moves_all(self, statement: Statement) -> bool:
        """Return whether a statement moves each joint whose line is apart, or a joint before it in the tree."""
        axes = (self.problem.axes, self.problem.second.axes)[self.edited_side_index]
        pending: list[int] = []
        for i, axis in enumerate(axes):
            if statement.moves(axis):
                pending.append(i)
        reached: set[int] = set()
        while pending:
            joint = pending.pop()
            reached.add(joint)
            pending += set(self.problem.below[joint]) - reached
        return self.differing_joints <= reached

    def with_side(self, side: RobotSide) -> FitProblem:
        """Return the pair with another side instead of the edited one."""
        sides = [self.problem.first, self.problem.second]
        sides[self.edited_side_index] = side
        return FitProblem(sides[0], sides[1], self.matching, self.problem.tolerance)

    def residual(self, side: RobotSide) -> Array:
        """Return what remains of lines, and of leaf frames except those on the joints `moved_tools`, in m and rad."""
        problem = self.with_side(side)
        unknowns = self.unknowns
        parents, children, groups = problem.motions(unknowns.signs, values_of(unknowns)[None], unknowns.deviating)
        parts = [line_residuals(problem, unknowns.signs, parents, children)[0]]
        for gap in frame_gaps_of_motions(problem, groups, inner=False):
            if gap.joint not in self.moved_tools:
                parts.append((gap.T - np.eye(4))[:3].ravel())
        return np.concatenate(parts)

    def agrees(self, side: RobotSide) -> bool:
        """Return whether all lines coincide, and all leaf frames except those on the joints `moved_tools`."""
        problem = self.with_side(side)
        if not lines_coincide(problem, line_gap(problem, self.unknowns)):
            return False
        for gap in leaf_frame_gaps(problem, self.unknowns):
            if gap.joint not in self.moved_tools and gap.differs(problem):
                return False
        return True

    def differing_frames(self, side: RobotSide) -> int:
        """Return the number of frames of inner links that differ."""
        problem = self.with_side(side)
        count = 0
        for gap in frame_gaps(problem, self.unknowns):
            count += gap.differs(problem)
        return count
