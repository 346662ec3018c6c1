"""The comparison of two sides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from twin.comparison.edits import with_edits
from twin.comparison.fit import ANGLE_PER_LENGTH, FitSolution, Problem
from twin.comparison.items import ComparedItem, items, placed
from twin.comparison.joined import joined
from twin.comparison.link_motions import PlaceDifference
from twin.comparison.links import differing_places, place_items
from twin.comparison.loop_edits import closing_edits, loop_edits
from twin.comparison.matching import Matching, match
from twin.comparison.mimic import MimicError, mimic_error
from twin.comparison.mimic_statements import mimic_conventions, mimic_properties
from twin.comparison.posed import posed
from twin.comparison.poses import PoseFit, compare_rows
from twin.comparison.properties import KINDS, Properties, compare
from twin.comparison.property_edits import with_property_edits
from twin.comparison.range import Worst, worst
from twin.comparison.recut import recut
from twin.comparison.rereading import remembering
from twin.comparison.search import conventions, deviations
from twin.comparison.side import Axis, RobotSide
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm
from twin.core.spatial import Array

Kinematics = Literal["agree", "agree after conventions", "disagree", "unexplained"]

LARGEST_TOLERANCE = 0.1
"""Largest distance in m up to which joint lines may coincide; the angle is then 0.2 rad."""

_TIES = 4
"""Maximum number of other explanations that are told."""


@dataclass(frozen=True)
class SidePair:
    """The comparison of two sides.

    Attributes:
        first, second: the sides.
        kinematics: the verdict on joints and links.
        items: conventions and differences.
        ties: other explanations with as many changes, each as texts.
        properties: limits, speeds, efforts, masses, couplings; None if the kinematics are unexplained, and for robots
            with loops whose links differ; only the limits of the driven joint where mimic joints replace loops.
        worst: the largest difference of the tools; None if there is none, or no tool.
        solution, problem: the fit; None for poses that are compared without joint lines.
        poses: the comparison of rows of poses, if one side is a table of poses, or equations of a robot with loops.
        mimic: the error of couplings that replace loops, if the joints correspond only in part; else None.
    """

    first: RobotSide
    second: RobotSide
    kinematics: Kinematics
    items: tuple[ComparedItem, ...]
    ties: tuple[tuple[str, ...], ...]
    properties: Properties | None
    worst: Worst | None
    problem: Problem | None = field(repr=False)
    solution: FitSolution | None = field(repr=False)
    poses: PoseFit | None = None
    mimic: MimicError | None = None

    @property
    def conventions(self) -> tuple[ComparedItem, ...]:
        """Conventions that differ."""
        return tuple(item for item in self.items if item.kind != "link")

    @property
    def differences(self) -> tuple[ComparedItem, ...]:
        """Differences that no convention explains."""
        return tuple(item for item in self.items if item.kind == "link")

    @property
    def agrees(self) -> bool:
        """Whether joints and links agree, after conventions at most."""
        return self.kinematics in ("agree", "agree after conventions")

    def as_dict(self) -> JsonObject:
        """Return the comparison as plain data."""
        verdicts = {}
        rows = []
        if self.properties is not None:
            verdicts = {kind: self.properties.verdict(kind) for kind in KINDS}
            rows = [row.as_dict() for row in self.properties.rows]
        largest = None if self.worst is None else self.worst.as_dict()
        poses = None if self.poses is None else self.poses.as_dict()
        mimic = None if self.mimic is None else self.mimic.as_dict()
        return {
            "first": self.first.label,
            "second": self.second.label,
            "kinematics": self.kinematics,
            "conventions": [item.as_dict() for item in self.conventions],
            "differences": [item.as_dict() for item in self.differences],
            "ties": [list(texts) for texts in self.ties],
            "worst": largest,
            "poses": poses,
            "mimic": mimic,
            "properties": verdicts,
            "property_rows": rows,
        }


def compare_pair(first: RobotSide, second: RobotSide, tolerance: float) -> SidePair:
    """Compare two sides; `tolerance` is the distance in m up to which two joint lines coincide.

    Raises:
        TwinError: the tolerance is out of range, the joints cannot be matched, or a joint has no common range.
    """
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        limit = f"give a number above 0 and up to {LARGEST_TOLERANCE:g} m"
        raise TwinError(f"tolerance {tolerance:g} m: {limit}: with more, all robots agree")
    rows = _by_rows(first, second)
    if rows is not None:
        return _compare_poses(first, second, rows, tolerance)
    return _compare_lines(first, second, tolerance)


def _by_rows(first: RobotSide, second: RobotSide) -> RobotSide | None:
    """Return the side whose rows of poses are compared with the other side; None if joint lines are compared.

    A table has only rows. Equations also have joint lines if they are those of a chain, but a robot with loops, or with
    further joints, has others.
    """
    sampled = [side for side in (first, second) if side.sampled is not None]
    if not sampled:
        return None
    tables = [side for side in sampled if not side.axes]
    if len(tables) == 2:
        way_out = "compare each with a description: a file, or the CAD of a robot"
        raise TwinError(f"{first.label} and {second.label} both have only poses, at their own joint values: {way_out}")
    if tables:
        return tables[0]
    chain = sampled[0]
    other = second if chain is first else first
    if other.looped or len(other.axes) != len(chain.axes):
        return chain
    return None


def _compare_poses(first: RobotSide, second: RobotSide, table: RobotSide, tolerance: float) -> SidePair:
    """Compare the rows of one side with the poses, and then with the joint lines, of the other."""
    assert table.sampled is not None
    robot = second if table is first else first
    rows = table.sampled()
    compared = compare_rows(rows, table.label, robot, tolerance)
    fit = compared.fit
    largest = Worst(robot.tool, fit.distance, fit.angle, compared.q, compared.q, fit.rows)
    if compared.identified is None:
        kinematics: Kinematics = "agree" if fit.agrees else "disagree"
        moved: tuple[ComparedItem, ...] = ()
        # equations state their frames; those of a measuring device are always others
        if fit.agrees and rows.computed:
            moved = _moved_frames(table, robot, rows.T, fit, tolerance)
        if moved:
            kinematics = "agree after conventions"
        return SidePair(first, second, kinematics, moved, (), None, largest, None, None, fit)
    if table is first:
        pair = _compare_lines(compared.identified, robot, compared.tolerance)
    else:
        pair = _compare_lines(robot, compared.identified, compared.tolerance)
    if pair.agrees and not pair.items:
        # the remainder is more than noise, but less than the tolerance of joint lines
        pair = replace(pair, kinematics="disagree")
    return replace(pair, first=first, second=second, worst=largest, properties=None, poses=fit)


def _moved_frames(
    table: RobotSide, robot: RobotSide, T_rows: Array, fit: PoseFit, tolerance: float
) -> tuple[ComparedItem, ...]:
    """Return the conventions of base and tool frame that a fit needs: one of the two where one is enough.

    `T_rows` (rows, 4, 4) are the poses of the side `table`.
    """
    T_robot = spatial.inverse(fit.base) @ T_rows @ spatial.inverse(fit.tool)
    same = np.eye(4)
    base = T_rows[0] @ spatial.inverse(T_robot[0])
    tool = spatial.inverse(T_robot[0]) @ T_rows[0]
    # the fewest moved frames first
    candidates = ((same, same), (base, same), (same, tool), (fit.base, fit.tool))
    for X, Y in candidates:
        remaining = spatial.inverse(X @ T_robot @ Y) @ T_rows
        if not _is_moved(remaining, tolerance):
            return _frame_items(table, robot, X, Y, tolerance)
    return ()


def _frame_items(table: RobotSide, robot: RobotSide, X: Array, Y: Array, tolerance: float) -> tuple[ComparedItem, ...]:
    """Return an item for each of the motions (4, 4) of base and tool frame that moves it."""
    items = []
    if _is_moved(X, tolerance):
        text = f"the base frame of {robot.label} is moved by {_placed(X)} in that of {table.label}"
        items.append(_frame_item("base frame", text, X))
    if _is_moved(Y, tolerance):
        text = f"the tool frame of {table.label} is moved by {_placed(Y)} in that of {robot.label}"
        items.append(_frame_item("tool frame", text, Y))
    return tuple(items)


def _is_moved(T: Array, tolerance: float) -> bool:
    """Return whether one of the motions (..., 4, 4) exceeds the tolerance in m, or its angle."""
    shift = float(np.linalg.norm(T[..., :3, 3], axis=-1).max())
    turn = float(np.max(spatial.rotation_angle(T[..., :3, :3])))
    return shift > tolerance or turn > ANGLE_PER_LENGTH * tolerance


def _placed(T: Array) -> str:
    return placed(T[:3, 3], spatial.log_so3(T[:3, :3]))


def _frame_item(kind: str, text: str, T: Array) -> ComparedItem:
    shift = float(np.linalg.norm(T[:3, 3]))
    return ComparedItem(kind, "", text, shift=shift, turn=float(spatial.rotation_angle(T[:3, :3])))


def _of_links(
    sides: tuple[RobotSide, RobotSide], problem: Problem, explanations: Sequence[Sequence[PlaceDifference]]
) -> SidePair:
    """Return the comparison of robots with loops of which some joints have other places on their links.

    `sides` are the sides as they were read.
    """
    differences = tuple(place_items(problem, explanations[0]))
    if len(differences) == 1:
        differences = (differences[0].with_edits(loop_edits(sides, problem, explanations)),)
    others = []
    for places in explanations[1 : 1 + _TIES]:
        others.append(tuple(item.text for item in place_items(problem, places)))
    return SidePair(problem.first, problem.second, "disagree", differences, tuple(others), None, None, problem, None)


def _opened(sides: tuple[RobotSide, RobotSide], problem: Problem) -> tuple[ComparedItem, ...]:
    """Return a difference for each joint that closes its loop on one side, and leaves it open on the other.

    `sides` are the sides as they were read.

    A loop that does not close at the drawn state closes nowhere near it: the line of its joint on one link says nothing
    about that on the other.
    """
    items_of_joints = []
    for i, (axis, partner) in enumerate(zip(problem.axes, problem.second.axes, strict=True)):
        distance, angle = axis.opened
        distance_of_partner, angle_of_partner = partner.opened
        shift = abs(distance - distance_of_partner)
        turn = abs(angle - angle_of_partner)
        if shift <= problem.tolerance and turn <= problem.angle_tolerance:
            continue
        in_first = f"{mm(distance)} and {deg(angle)} apart in {problem.first.label}"
        in_second = f"{mm(distance_of_partner)} and {deg(angle_of_partner)} apart in {problem.second.label}"
        places = f"its places on its two links are {in_first}, {in_second}"
        wider = axis
        if max(partner.opened) > max(axis.opened):
            wider = partner
        text = f"{_left_open(partner.name, wider)}: {places}"
        link = problem.second.groups[partner.child].bodies[-1]
        item = ComparedItem("link", partner.name, text, link, shift, turn)
        items_of_joints.append(item.with_edits(closing_edits(sides, problem, i)))
    return tuple(items_of_joints)


def _left_open(joint: str, axis: Axis) -> str:
    """Return the sentence that a joint leaves its loop open, or that the weld does which closes the loop of it."""
    if axis.opened_at:
        return f"joint '{axis.opened_at}' does not close the loop of joint '{joint}'"
    return f"joint '{joint}' does not close its loop"


def _opened_linkage(side: RobotSide, tolerance: float) -> list[ComparedItem]:
    """Return a difference for each joint of a side that leaves its loop open, where the other side has no loops."""
    items_of_joints: list[ComparedItem] = []
    for axis in side.axes:
        shift, turn = axis.opened
        if shift <= tolerance and turn <= ANGLE_PER_LENGTH * tolerance:
            continue
        places = f"its places on its two links are {mm(shift)} and {deg(turn)} apart in {side.label}"
        text = f"{_left_open(axis.name, axis)}: {places}"
        link = side.groups[axis.child].bodies[-1]
        items_of_joints.append(ComparedItem("link", axis.name, text, link, shift, turn))
    return items_of_joints


def _of_mimic(first: RobotSide, second: RobotSide, mimic: MimicError, tolerance: float) -> SidePair:
    """Return the comparison of a linkage with a side whose mimic joints replace its loops."""
    conventions = mimic_conventions(mimic, tolerance)
    verdict: Kinematics = "agree after conventions" if conventions else "agree"
    if not mimic.within(tolerance, ANGLE_PER_LENGTH * tolerance):
        verdict = "disagree"
    # the motion of the linkage follows one place of each joint: it says nothing about the other link of an open one
    opened = [*_opened_linkage(first, tolerance), *_opened_linkage(second, tolerance)]
    if opened:
        verdict = "disagree"
    properties = mimic_properties(mimic, linkage_first=first.looped)
    told = (*opened, *conventions)
    return SidePair(first, second, verdict, told, (), properties, None, None, None, mimic=mimic)


def _compare_lines(first: RobotSide, second: RobotSide, tolerance: float) -> SidePair:
    """Compare the joint lines of two sides."""
    as_read = (first, second)
    first = joined(as_read[0], as_read[1], tolerance)
    second = recut(joined(as_read[1], as_read[0], tolerance), first)
    try:
        matching = match(first, second)
    except TwinError:
        mimic = mimic_error(first, second) or mimic_error(second, first)
        if mimic is None:
            raise
        return _of_mimic(first, second, mimic, tolerance)
    problem = Problem(remembering(first), remembering(second), matching, tolerance)
    opened = _opened(as_read, problem)
    if opened:
        return SidePair(first, second, "disagree", opened, (), None, None, problem, None)
    solutions = conventions(problem)
    if not solutions and first.looped:
        # balls and bars between them have no coordinate that leads from one posture to another
        in_posture = posed(problem)
        if in_posture is not None:
            problem = Problem(*in_posture, matching, tolerance)
            solutions = conventions(problem)
    if not solutions and first.looped:
        explanations = differing_places(problem)
        if explanations:
            return _of_links(as_read, problem, explanations)
    if not solutions:
        solutions = deviations(problem)
    if not solutions:
        return SidePair(first, second, "unexplained", (), (), None, None, problem, None)
    return _of_solutions(first, second, problem, matching, solutions)


def _of_solutions(
    first: RobotSide, second: RobotSide, problem: Problem, matching: Matching, solutions: Sequence[FitSolution]
) -> SidePair:
    """Return the comparison by equally likely solutions, of which the first is told."""
    best = solutions[0]
    items_of_best = with_edits(problem, matching, best, items(problem, matching, best))
    kinematics: Kinematics = "agree after conventions"
    if best.unknowns.deviating:
        kinematics = "disagree"
    if not items_of_best:
        kinematics = "agree"
    told = tuple(item.text for item in items_of_best)
    ties: list[tuple[str, ...]] = []
    for other in solutions[1:]:
        texts = tuple(item.text for item in items(problem, matching, other))
        if texts not in ties and texts != told:
            ties.append(texts)
    largest = worst(problem, best)
    properties = with_property_edits(problem, matching, best, compare(problem, best))
    return SidePair(
        first=first,
        second=second,
        kinematics=kinematics,
        items=tuple(items_of_best),
        ties=tuple(ties[:_TIES]),
        properties=properties,
        worst=largest,
        problem=problem,
        solution=best,
    )
