"""The comparison of the joint lines of two sides, also of loops, and of mimic joints that replace loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.comparison.changed_text import with_memory
from twin.comparison.common_posture import in_common_posture
from twin.comparison.compared_items import ComparedItem, compared_items, frame_item, motion_text
from twin.comparison.differing_places import differing_places, place_items
from twin.comparison.edits import with_edits
from twin.comparison.fit_problem import ANGLE_PER_LENGTH, FitProblem
from twin.comparison.largest_difference import largest_difference
from twin.comparison.line_gaps import FitSolution
from twin.comparison.link_motions import PlaceDifference
from twin.comparison.loop_edits import loop_edits
from twin.comparison.loop_gaps import differing_gaps, open_loops
from twin.comparison.matching import Matching, match
from twin.comparison.merged_joints import with_merged_joints
from twin.comparison.mimic import MimicError, mimic_error
from twin.comparison.properties import PROPERTY_KINDS, Properties, PropertyRow, compare_properties, is_same_limit
from twin.comparison.property_edits import with_property_edits
from twin.comparison.recut import with_tree_of
from twin.comparison.search import fits_by_conventions, fits_by_deviations
from twin.comparison.side import UNLIMITED, RobotSide
from twin.comparison.side_pair import Kinematics, SidePair
from twin.core.errors import TwinError
from twin.core.quantity import moved

_MAX_TIES = 4
"""Maximum number of other explanations that are told."""


def compare_lines(first: RobotSide, second: RobotSide, tolerance: float) -> SidePair:
    """Compare the joint lines of two sides."""
    as_read = (first, second)
    first = with_merged_joints(as_read[0], as_read[1], tolerance)
    second = with_tree_of(with_merged_joints(as_read[1], as_read[0], tolerance), first)
    try:
        matching = match(first, second)
    except TwinError:
        mimic = mimic_error(first, second) or mimic_error(second, first)
        if mimic is None:
            raise
        return _pair_of_mimic(first, second, mimic, tolerance)
    problem = FitProblem(with_memory(first), with_memory(second), matching, tolerance)
    open_loop_items = differing_gaps(as_read, problem)
    if open_loop_items:
        return SidePair(first, second, "disagree", open_loop_items, (), None, None, problem, None)
    solutions = fits_by_conventions(problem)
    if not solutions and first.has_loops:
        # balls and bars between them have no coordinate that leads from one posture to another
        in_posture = in_common_posture(problem)
        if in_posture is not None:
            problem = FitProblem(*in_posture, matching, tolerance)
            solutions = fits_by_conventions(problem)
    if not solutions and first.has_loops:
        explanations = differing_places(problem)
        if explanations:
            return _pair_of_places(as_read, problem, explanations)
    if not solutions:
        solutions = fits_by_deviations(problem)
    if not solutions:
        return SidePair(first, second, "unexplained", (), (), None, None, problem, None)
    return _pair_of_solutions(first, second, problem, matching, solutions)


def _pair_of_mimic(first: RobotSide, second: RobotSide, mimic: MimicError, tolerance: float) -> SidePair:
    """Return the comparison of a linkage with a side whose mimic joints replace its loops."""
    conventions = mimic_conventions(mimic, tolerance)
    verdict: Kinematics = "agree after conventions" if conventions else "agree"
    if not mimic.is_within(tolerance, ANGLE_PER_LENGTH * tolerance):
        verdict = "disagree"
    # the motion of the linkage follows one place of each joint: it says nothing about the other link of an open one
    opened = [*open_loops(first, tolerance), *open_loops(second, tolerance)]
    if opened:
        verdict = "disagree"
    properties = mimic_properties(mimic, linkage_first=first.has_loops)
    items_of_pair = (*opened, *conventions)
    return SidePair(first, second, verdict, items_of_pair, (), properties, None, None, None, mimic=mimic)


def _pair_of_places(
    sides: tuple[RobotSide, RobotSide], problem: FitProblem, explanations: Sequence[Sequence[PlaceDifference]]
) -> SidePair:
    """Return the comparison of robots with loops of which some joints have other places on their links.

    `sides` are the sides as they were read.
    """
    differences = tuple(place_items(problem, explanations[0]))
    if len(differences) == 1:
        differences = (differences[0].with_edits(loop_edits(sides, problem, explanations)),)
    others = []
    for places in explanations[1 : 1 + _MAX_TIES]:
        others.append(_texts(place_items(problem, places)))
    return SidePair(problem.first, problem.second, "disagree", differences, tuple(others), None, None, problem, None)


def _texts(of_items: Sequence[ComparedItem]) -> tuple[str, ...]:
    """Return the texts of items."""
    return tuple(item.text for item in of_items)


def _pair_of_solutions(
    first: RobotSide, second: RobotSide, problem: FitProblem, matching: Matching, solutions: Sequence[FitSolution]
) -> SidePair:
    """Return the comparison by equally likely solutions, of which the first is told."""
    best = solutions[0]
    items_of_best = with_edits(problem, matching, best, compared_items(problem, matching, best))
    kinematics: Kinematics = "agree after conventions"
    if best.unknowns.deviating:
        kinematics = "disagree"
    if not items_of_best:
        kinematics = "agree"
    texts_of_best = _texts(items_of_best)
    ties: list[tuple[str, ...]] = []
    for other in solutions[1:]:
        texts = _texts(compared_items(problem, matching, other))
        # solutions that differ only in numbers below the digits of a text are told once
        if texts not in ties and texts != texts_of_best:
            ties.append(texts)
    largest = largest_difference(problem, best)
    properties = with_property_edits(problem, matching, best, compare_properties(problem, best))
    return SidePair(
        first=first,
        second=second,
        kinematics=kinematics,
        items=tuple(items_of_best),
        ties=tuple(ties[:_MAX_TIES]),
        properties=properties,
        worst=largest,
        problem=problem,
        solution=best,
    )


_Limits = tuple[float, float] | None
"""Range of a joint in m or rad; None if a side states nothing, as in `side.Axis`."""


def mimic_conventions(mimic: MimicError, tolerance: float) -> tuple[ComparedItem, ...]:
    """Return the frames that differ by more than a distance in m, or its angle."""
    text = f"the base frame of {mimic.linkage} is moved by {motion_text(mimic.base)} in that of {mimic.coupled}"
    candidates = [frame_item("base frame", text, mimic.base)]
    if mimic.tool is not None:
        text = f"the tool frame of {mimic.coupled} is moved by {motion_text(mimic.tool)} in that of {mimic.linkage}"
        candidates.append(frame_item("tool frame", text, mimic.tool))
    items = []
    for item in candidates:
        if item.shift > tolerance or item.turn > ANGLE_PER_LENGTH * tolerance:
            items.append(item)
    return tuple(items)


def mimic_properties(mimic: MimicError, linkage_first: bool) -> Properties:
    """Return the comparison of the limits of the driven joint, the only property that is compared."""
    first, second = mimic.limits
    if not linkage_first:
        first, second = second, first
    compared = dict.fromkeys(PROPERTY_KINDS, 0)
    texts = (_interval_text(first), _interval_text(second))
    if first is None or second is None:
        # a file that states no limits, and one that states that there are none, say the same
        if (first or UNLIMITED) == (second or UNLIMITED):
            return Properties((), compared)
        return Properties((PropertyRow("limits", mimic.leader, *texts, False),), compared)
    compared["limits"] = 1
    if is_same_limit(first[0], second[0]) and is_same_limit(first[1], second[1]):
        return Properties((), compared)
    return Properties((PropertyRow("limits", mimic.leader, *texts, True),), compared)


def _interval_text(limits: _Limits) -> str:
    """Return the range of a hinge as text."""
    if limits is None:
        return "-"
    if not np.isfinite(limits).any():
        return "no limits"
    return f"{moved(limits[0], True)} .. {moved(limits[1], True)}"
