"""The numbers of a file whose edit brings a joint of a loop to its place in the other side.

The text is read again with each number, and its loops are closed again. That takes long, so only the numbers of the
joints that are told are tried, attribute by attribute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.comparison.attribute_edits import attribute_edits
from twin.comparison.compared_items import NumberEdit
from twin.comparison.edit_goal import EditGoal
from twin.comparison.fit_problem import FitProblem
from twin.comparison.link_motions import LinkMotions, PlaceDifference
from twin.comparison.matching import match
from twin.comparison.mechanism_side import drawn_poses
from twin.comparison.merged_joints import with_merged_joints
from twin.comparison.openings import loop_openings
from twin.comparison.paths import relative_path
from twin.comparison.recut import with_tree_of
from twin.comparison.side import Axis, RobotSide, plain_name
from twin.core.errors import TwinError
from twin.core.spatial import Array

_MAX_EXPLANATIONS = 4
"""Maximum number of explanations whose joints are tried."""


def loop_edits(
    sides: tuple[RobotSide, RobotSide], problem: FitProblem, explanations: Sequence[Sequence[PlaceDifference]]
) -> list[NumberEdit]:
    """Return edits of one attribute of either side, each of which makes all links of both sides agree.

    Args:
        sides: the sides as they were read.
        problem: the same with joints and loops as the other side writes them.
        explanations: the places that differ; only explanations by one place are tried.
    """
    joints: list[int] = []
    for places in explanations[:_MAX_EXPLANATIONS]:
        if len(places) == 1 and places[0].joint not in joints:
            joints.append(places[0].joint)
    edits: list[NumberEdit] = []
    for edited in (0, 1):
        closed = sides[edited].reread_closed
        if closed is None:
            continue
        side = replace(sides[edited], reread=closed)
        names: set[str] = set()
        for joint in joints:
            axis = (problem.axes, problem.second.axes)[edited][joint]
            names |= {plain_name(axis.name), *axis.merged_names}
        edits += attribute_edits(side, names, _links_goal(sides, edited, problem.tolerance), relative_path)
    return edits


def closing_edits(sides: tuple[RobotSide, RobotSide], problem: FitProblem, joint: int) -> list[NumberEdit]:
    """Return edits of one attribute that close a loop which only one side leaves open, and make all links agree.

    `sides` are the sides as they were read, and `joint` closes the loop.
    """
    axes = (problem.axes[joint], problem.second.axes[joint])
    is_open = [_is_open(problem, axis) for axis in axes]
    if sum(is_open) != 1:  # open on both sides: neither says where the loop closes
        return []
    edited = is_open.index(True)
    closed = sides[edited].reread_closed
    if closed is None:
        return []
    links_agree = _links_goal(sides, edited, problem.tolerance).agrees

    def residual(side: RobotSide) -> Array:
        if side.mechanism is None:
            return np.zeros(0)
        poses, _ = drawn_poses(side.mechanism)
        return loop_openings(side.mechanism, poses)

    def agrees(side: RobotSide) -> bool:
        # an edit that closes this loop may open another
        for axis in side.axes:
            if _is_open(problem, axis):
                return False
        return links_agree(side)

    goal = EditGoal(residual, agrees, lambda _: 0, problem.tolerance)
    axis = axes[edited]
    side = replace(sides[edited], reread=closed)
    edits = attribute_edits(side, {plain_name(axis.name), *axis.merged_names}, goal, relative_path)
    # the places of the two ends of a weld are written at its bodies; each body has its own number of tries
    for body in _bodies_of(side, axis.open_weld):
        for edit in attribute_edits(side, {plain_name(body)}, goal, relative_path):
            if edit not in edits:
                edits.append(edit)
    return edits


def _is_open(problem: FitProblem, axis: Axis) -> bool:
    """Return whether a joint that closes a loop is open by more than the tolerance in m or rad."""
    distance, angle = axis.opening
    return distance > problem.tolerance or angle > problem.angle_tolerance


def _bodies_of(side: RobotSide, weld: str) -> tuple[str, ...]:
    """Return the names of the two bodies of a weld; () if `weld` is ""."""
    if not weld or side.mechanism is None:
        return ()
    joint = side.mechanism.joint(weld)
    return (joint.parent, joint.child)


def _links_goal(sides: tuple[RobotSide, RobotSide], edited: int, tolerance: float) -> EditGoal:
    """Return the goal that all links of both sides agree."""

    def links_of(side: RobotSide) -> tuple[LinkMotions, Array]:
        sides_with_edit = list(sides)
        sides_with_edit[edited] = side
        first = with_merged_joints(sides_with_edit[0], sides_with_edit[1], tolerance)
        second = with_tree_of(with_merged_joints(sides_with_edit[1], sides_with_edit[0], tolerance), first)
        links = LinkMotions(FitProblem(first, second, match(first, second), tolerance))
        return links, links.fitted_to_all()

    def residual(side: RobotSide) -> Array:
        try:
            links, T = links_of(side)
        except TwinError:  # with this number, it is no robot of the same kind
            return np.zeros(0)
        residuals: list[Array] = []
        for i, where in links.places:
            residual_of_place, _ = links.residual(T, i, where)
            residuals.append(residual_of_place)
        return np.concatenate(residuals)

    def agrees(side: RobotSide) -> bool:
        try:
            links, T = links_of(side)
        except TwinError:
            return False
        return links.places_agree(T, links.places)

    return EditGoal(residual, agrees, lambda _: 0, tolerance)
