"""Differences of a comparison by loops that do not close: on one side only, or where the other side has no loops."""

from __future__ import annotations

from twin.comparison.compared_items import ComparedItem
from twin.comparison.fit_problem import ANGLE_PER_LENGTH, FitProblem
from twin.comparison.loop_edits import closing_edits
from twin.comparison.side import Axis, RobotSide
from twin.core.quantity import deg, mm


def differing_gaps(sides: tuple[RobotSide, RobotSide], problem: FitProblem) -> tuple[ComparedItem, ...]:
    """Return a difference for each joint that closes its loop on one side, and leaves it open on the other.

    `sides` are the sides as they were read.

    A loop that does not close at the drawn state closes nowhere near it: the line of its joint on one link says nothing
    about that on the other.
    """
    items_of_joints = []
    for i, (axis, partner) in enumerate(zip(problem.axes, problem.second.axes, strict=True)):
        distance, angle = axis.opening
        distance_of_partner, angle_of_partner = partner.opening
        shift = abs(distance - distance_of_partner)
        turn = abs(angle - angle_of_partner)
        if shift <= problem.tolerance and turn <= problem.angle_tolerance:
            continue
        in_first = f"{mm(distance)} and {deg(angle)} apart in {problem.first.label}"
        in_second = f"{mm(distance_of_partner)} and {deg(angle_of_partner)} apart in {problem.second.label}"
        places = f"its places on its two links are {in_first}, {in_second}"
        wider = axis
        if max(partner.opening) > max(axis.opening):
            wider = partner
        text = f"{_open_loop_text(partner.name, wider)}: {places}"
        link = problem.second.groups[partner.child].bodies[-1]
        item = ComparedItem("link", partner.name, text, link, shift, turn)
        items_of_joints.append(item.with_edits(closing_edits(sides, problem, i)))
    return tuple(items_of_joints)


def open_loops(side: RobotSide, tolerance: float) -> list[ComparedItem]:
    """Return a difference for each joint of a side that leaves its loop open, where the other side has no loops."""
    items_of_joints: list[ComparedItem] = []
    for axis in side.axes:
        shift, turn = axis.opening
        if shift <= tolerance and turn <= ANGLE_PER_LENGTH * tolerance:
            continue
        places = f"its places on its two links are {mm(shift)} and {deg(turn)} apart in {side.label}"
        text = f"{_open_loop_text(axis.name, axis)}: {places}"
        link = side.groups[axis.child].bodies[-1]
        items_of_joints.append(ComparedItem("link", axis.name, text, link, shift, turn))
    return items_of_joints


def _open_loop_text(joint: str, axis: Axis) -> str:
    """Return the sentence that a joint leaves its loop open, or that the weld does which closes the loop of it."""
    if axis.open_weld:
        return f"joint '{axis.open_weld}' does not close the loop of joint '{joint}'"
    return f"joint '{joint}' does not close its loop"
