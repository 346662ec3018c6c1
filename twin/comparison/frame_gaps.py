"""Frames of both sides with the same name: where they are after the conventions of a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.comparison.fit_problem import FitProblem
from twin.comparison.unknowns import Unknowns, values_of
from twin.core import spatial
from twin.core.spatial import Array

BASE_CARRIER = -1
"""Index of no joint: a frame on the base."""


@dataclass(frozen=True)
class FrameGap:
    """A frame of the first side in the frame of the same name of the second side, after the conventions.

    Attributes:
        name: name of the frame in the second side.
        joint: index of the joint that carries it, or `BASE_CARRIER`.
        leaf: whether no further joint is on its bodies, as for a tool.
        T: (4, 4) T_second_first.
        T_base_second: (4, 4) the frame of the second side, at its drawn state.
    """

    name: str
    joint: int
    leaf: bool
    T: Array
    T_base_second: Array

    def differs(self, problem: FitProblem) -> bool:
        """Return whether the frames differ by more than the tolerance."""
        shift = float(np.linalg.norm(self.T[:3, 3]))
        turn = float(spatial.rotation_angle(self.T[:3, :3]))
        return shift > problem.tolerance or turn > problem.angle_tolerance


def leaf_frame_gaps(problem: FitProblem, unknowns: Unknowns) -> list[FrameGap]:
    """Return those of `frame_gaps` that are on leaf links."""
    return frame_gaps(problem, unknowns, inner=False)


def frame_gaps(problem: FitProblem, unknowns: Unknowns, *, inner: bool = True) -> list[FrameGap]:
    """Return the gaps of all frames and bodies with the same name in both sides, and of the two tools.

    Without `inner`, only of those on leaf links.
    """
    _, _, motions = problem.motions(unknowns.signs, values_of(unknowns)[None], unknowns.deviating)
    return frame_gaps_of_motions(problem, motions, inner=inner)


def frame_gaps_of_motions(problem: FitProblem, motions: Array, *, inner: bool = True) -> list[FrameGap]:
    """Return the same for the motions (1, groups, 4, 4) of the groups of bodies."""
    carrier = carrier_of_groups(problem)
    carrier[0] = BASE_CARRIER
    group_of_joint = {BASE_CARRIER: 0}
    for joint, axis in enumerate(problem.second.axes):
        group_of_joint[joint] = axis.child
    # a tool that a reader has chosen is no statement of the file
    guessed = set()
    for side in (problem.first, problem.second):
        if side.is_tool_guessed:
            guessed.add(side.tool)
    gaps = []
    for name, (group, T) in problem.first.frames.items():
        partner = problem.second.frames.get(name)
        joint = carrier.get(group)
        if partner is None or joint is None or group_of_joint[joint] != partner[0]:
            continue
        if name in guessed or not (inner or _is_on_leaf(problem, joint)):
            continue
        gaps.append(_frame_gap(problem, motions, name, joint, (group, T), partner))
    # a tool whose name both sides have is among the frames; others are compared also if their link has such frames
    named = problem.second.tool in problem.first.frames or problem.first.tool in problem.second.frames
    has_leaf_frame = any(gap.leaf for gap in gaps)
    if not guessed and not (named and has_leaf_frame):
        tool = _tool_gap(problem, motions, carrier)
        if tool is not None and (inner or tool.leaf):
            gaps.append(tool)
    return gaps


def carrier_of_groups(problem: FitProblem) -> dict[int, int]:
    """Return {group of the first side: joint that carries it}."""
    carrier = {}
    for i, axis in enumerate(problem.axes):
        if not axis.closes_loop:
            carrier[axis.child] = i
    return carrier


def _tool_gap(problem: FitProblem, motions: Array, carrier: dict[int, int]) -> FrameGap | None:
    """Return the gap of the two tool frames, whatever their names are; None if they are not on the same joint."""
    first = problem.first.frames.get(problem.first.tool)
    second = problem.second.frames.get(problem.second.tool)
    if first is None or second is None:
        return None
    joint = carrier.get(first[0])
    if joint is None or problem.second.axes[joint].child != second[0]:
        return None
    return _frame_gap(problem, motions, problem.second.tool, joint, first, second)


def _frame_gap(
    problem: FitProblem, motions: Array, name: str, joint: int, first: tuple[int, Array], second: tuple[int, Array]
) -> FrameGap:
    """Return the gap of a frame; `first` and `second` are its group and T_base_frame (4, 4) in each side."""
    group, T_first = first
    T_moved = motions[0, group] @ T_first
    T = spatial.inverse(second[1]) @ T_moved
    return FrameGap(name, joint, _is_on_leaf(problem, joint), T, second[1])


def _is_on_leaf(problem: FitProblem, joint: int) -> bool:
    """Return whether a joint carries a link on which no further joint is."""
    return joint != BASE_CARRIER and not problem.below[joint]
