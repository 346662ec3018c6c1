"""Limits, speeds, efforts, masses and couplings of two sides, each kind with its own verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin.comparison.compared_items import NumberEdit
from twin.comparison.convention_sizes import zero_of
from twin.comparison.coupled_motion import (
    RATIO_TOLERANCE,
    CoupledFollower,
    coupling_constraints,
    followers_by_elimination,
)
from twin.comparison.evidence import CENTRE_TOLERANCE, LIMIT_TOLERANCE, RELATIVE_TOLERANCE
from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import FitSolution
from twin.comparison.side import ONE_COORDINATE_KINDS, UNLIMITED, Axis, RobotSide
from twin.comparison.unknowns import values_of
from twin.core import format
from twin.core.json_types import JsonObject
from twin.core.quantity import moved
from twin.core.spatial import Array
from twin.model.inertia import Inertia

PROPERTY_KINDS: tuple[str, ...] = ("limits", "speeds", "efforts", "masses", "centres of mass", "inertias", "couplings")
"""Kinds of properties in the order of reports."""

BODY_KINDS = ("masses", "centres of mass", "inertias")
"""Kinds of properties of the bodies on a joint; the others are of the joint."""

_SIGNIFICANT_DIGITS = (4, 6, 9)
"""Numbers of significant digits with which two texts are tried until they differ."""

_SMALLEST_RATIO = 1e-9
"""Ratio of a coupling below which a joint does not move the follower."""


@dataclass(frozen=True)
class PropertyRow:
    """One compared value that differs, or that only one side states.

    Attributes:
        kind: one of `PROPERTY_KINDS`.
        where: name of the joint or link in the second side.
        first, second: the values as text, "-" if a side does not state it.
        stated: whether both sides state it, so that they disagree.
        index: the joint; for masses, centres and inertias the group of the first side.
        edits: edits that make both sides agree.
        together: whether all edits of one side are needed, not only one of them.
    """

    kind: str
    where: str
    first: str
    second: str
    stated: bool
    index: int = -1
    edits: tuple[NumberEdit, ...] = ()
    together: bool = False

    def as_dict(self) -> JsonObject:
        """Return the row as plain data."""
        return {
            "kind": self.kind,
            "where": self.where,
            "first": self.first,
            "second": self.second,
            "stated_by_both": self.stated,
            "edits": [edit.as_dict() for edit in self.edits],
            "edits_together": self.together,
        }


@dataclass(frozen=True)
class Properties:
    """Rows that differ, and for each kind how many values were compared."""

    rows: tuple[PropertyRow, ...]
    compared: dict[str, int]

    def verdict(self, kind: str) -> str:
        """Return "agree", "disagree" or "not stated" for one kind."""
        for row in self.rows:
            if row.kind == kind and row.stated:
                return "disagree"
        if self.compared[kind]:
            return "agree"
        return "not stated"


def compare_properties(problem: FitProblem, solution: FitSolution) -> Properties:
    """Compare the properties of two sides after the conventions of a solution."""
    return _PropertyComparison(problem, solution).result()


class _PropertyComparison:
    """The rows that differ, and how many values were compared, as they are collected."""

    def __init__(self, problem: FitProblem, solution: FitSolution) -> None:
        self.problem = problem
        self.solution = solution
        self.rows: list[PropertyRow] = []
        self.compared: dict[str, int] = dict.fromkeys(PROPERTY_KINDS, 0)

    def result(self) -> Properties:
        """Return the comparison of all kinds."""
        for i, axis in enumerate(self.problem.axes):
            if axis.kind in ONE_COORDINATE_KINDS:
                self._compare_limits(i)
                self._compare_drive(i)
            else:
                self._add_parts(i)
        self._compare_bodies()
        self._compare_couplings()
        return Properties(tuple(self.rows), self.compared)

    def _compare_limits(self, joint: int) -> None:
        """Compare the limits of a joint with one coordinate, those of the first side as values of the second."""
        axis = self.problem.second.axes[joint]
        mapped = mapped_limits(self.problem, self.solution, joint)
        texts = distinct_texts(
            lambda digits: (
                interval_text(mapped, axis.is_angle, digits),
                interval_text(axis.limits, axis.is_angle, digits),
            )
        )
        if mapped is None or axis.limits is None:
            # a file that states no limits, and one that states that there are none, say the same
            if (mapped or UNLIMITED) != (axis.limits or UNLIMITED):
                self.rows.append(PropertyRow("limits", axis.name, *texts, False))
            return
        self.compared["limits"] += 1
        if is_same_limit(mapped[0], axis.limits[0]) and is_same_limit(mapped[1], axis.limits[1]):
            return
        # no edit of a number makes limits of none: the type of the joint, or an attribute, is another
        bounded = np.array_equal(np.isfinite(mapped), np.isfinite(axis.limits))
        self.rows.append(PropertyRow("limits", axis.name, *texts, True, joint if bounded else -1))

    def _compare_drive(self, joint: int) -> None:
        """Compare the maximum speed and effort of a joint with one coordinate."""
        first = self.problem.axes[joint]
        second = self.problem.second.axes[joint]
        effort_of_first = self.problem.first.efforts.get(first.name)
        effort_of_second = self.problem.second.efforts.get(second.name)

        def speed(value: float) -> str:
            return speed_text(value, second)

        def effort(value: float) -> str:
            return effort_text(value, second)

        self._compare_number("speeds", joint, second.name, first.max_speed, second.max_speed, speed)
        self._compare_number("efforts", joint, second.name, effort_of_first, effort_of_second, effort)

    def _add_parts(self, joint: int) -> None:
        """Add what joints state of which one side has several: the other side has no partner to compare it with."""
        first = self.problem.axes[joint]
        second = self.problem.second.axes[joint]
        of_first = part_texts(first, self.problem.first)
        of_second = part_texts(second, self.problem.second)
        is_free_ball = _is_free_ball(first) or _is_free_ball(second)
        for kind in ("limits", "speeds", "efforts"):
            if of_first[kind] == of_second[kind]:
                continue
            # a ball that has no limits, as its file states, disagrees with limits of the hinges
            stated = kind == "limits" and is_free_ball
            text_of_none = "no limits" if stated else "-"
            text_of_first = ", ".join(of_first[kind]) or text_of_none
            text_of_second = ", ".join(of_second[kind]) or text_of_none
            self.rows.append(PropertyRow(kind, second.name, text_of_first, text_of_second, stated))

    def _compare_number(
        self,
        kind: str,
        index: int,
        where: str,
        first: float | None,
        second: float | None,
        text_of: Callable[[float], str],
    ) -> None:
        """Compare a value of both sides, None where a side does not state it; `text_of` returns a value as text."""
        if first is None and second is None:
            return
        text_of_first = "-" if first is None else text_of(first)
        text_of_second = "-" if second is None else text_of(second)
        if first is None or second is None:
            self.rows.append(PropertyRow(kind, where, text_of_first, text_of_second, False))
            return
        self.compared[kind] += 1
        if abs(first - second) > RELATIVE_TOLERANCE * max(abs(first), abs(second)):
            self.rows.append(PropertyRow(kind, where, text_of_first, text_of_second, True, index))

    def _compare_bodies(self) -> None:
        """Compare mass, centre and tensor of the bodies on each joint, the first side moved by the conventions."""
        motions = body_motions(self.problem, self.solution)
        for group, partner in partner_groups(self.problem).items():
            first = self.problem.first.groups[group].inertia
            second = self.problem.second.groups[partner].inertia
            where = self.problem.second.groups[partner].bodies[-1]
            mass_of_first = None if first is None else first.mass
            mass_of_second = None if second is None else second.mass
            self._compare_number("masses", group, where, mass_of_first, mass_of_second, mass_text)
            if first is not None and second is not None:
                self._compare_inertia(group, where, first.seen_from(motions[group]), second)

    def _compare_inertia(self, group: int, where: str, first: Inertia, second: Inertia) -> None:
        """Compare centre of mass and inertia tensor of the bodies of a group, both in the base of the second side."""
        self.compared["centres of mass"] += 1
        if np.linalg.norm(first.p_body_com - second.p_body_com) > CENTRE_TOLERANCE:
            texts = (point_text(first.p_body_com), point_text(second.p_body_com))
            self.rows.append(PropertyRow("centres of mass", where, *texts, True, group))
        self.compared["inertias"] += 1
        size = max(float(np.linalg.norm(first.I_com)), float(np.linalg.norm(second.I_com)))
        if np.linalg.norm(first.I_com - second.I_com) > RELATIVE_TOLERANCE * size:
            texts = (moments_text(first.I_com), moments_text(second.I_com))
            if texts[0] == texts[1]:  # the same moments about other axes
                texts = distinct_texts(
                    lambda digits: (tensor_text(first.I_com, digits), tensor_text(second.I_com, digits))
                )
            self.rows.append(PropertyRow("inertias", where, *texts, True, group))

    def _compare_couplings(self) -> None:
        """Compare the motions that the couplings allow, whichever joint of a coupling each side calls the leader."""
        coupled = coupled_sides(self.problem, self.solution)
        for i in coupled.order:
            first = coupled.first.get(i)
            second = coupled.second.get(i)
            if first is None and second is None:
                continue
            self.compared["couplings"] += 1
            if first is not None and second is not None and _is_same_motion(first, second):
                continue
            texts = distinct_texts(
                lambda digits, i=i, first=first, second=second: (
                    coupling_text(self.problem, i, first, digits),
                    coupling_text(self.problem, i, second, digits),
                )
            )
            self.rows.append(PropertyRow("couplings", self.problem.second.axes[i].name, *texts, True, i))


# -- differences as numbers ---------------------------------------------------------------------------


def property_difference(problem: FitProblem, solution: FitSolution, kind: str, index: int) -> Array:
    """Return what differs in a row of some kind, as numbers in SI units; `index` as in `PropertyRow`.

    (0,) if a side does not state the value.
    """
    if kind in BODY_KINDS:
        return _difference_of_bodies(problem, solution, kind, index)
    if kind == "couplings":
        return _difference_of_couplings(problem, solution, index)
    if kind == "limits":
        return _difference_of_limits(problem, solution, index)
    first = problem.axes[index]
    second = problem.second.axes[index]
    if kind == "efforts":
        return _difference_of_numbers(problem.first.efforts.get(first.name), problem.second.efforts.get(second.name))
    return _difference_of_numbers(first.max_speed, second.max_speed)


def _difference_of_numbers(first: float | None, second: float | None) -> Array:
    """Return the difference (1,) of two values; (0,) if a side does not state it."""
    if first is None or second is None:
        return np.zeros(0)
    return np.array([first - second])


def _difference_of_limits(problem: FitProblem, solution: FitSolution, joint: int) -> Array:
    """Return the differences (2,) of both ends of a range in m or rad."""
    mapped = mapped_limits(problem, solution, joint)
    limits = problem.second.axes[joint].limits
    if mapped is None or limits is None:
        return np.zeros(0)
    differences = np.zeros(2)
    for k in range(2):
        if mapped[k] != limits[k]:  # equal limits can be infinite
            differences[k] = mapped[k] - limits[k]
    return differences


def _difference_of_bodies(problem: FitProblem, solution: FitSolution, kind: str, group: int) -> Array:
    """Return the difference of mass (1,) in kg, centre (3,) in m or tensor (9,) in kg m2 of a group of bodies."""
    # an edit may have left no joint that carries the group
    partner = partner_groups(problem).get(group, 0)
    first = problem.first.groups[group].inertia
    second = problem.second.groups[partner].inertia
    if first is None or second is None:
        return np.zeros(0)
    first_moved = first.seen_from(body_motions(problem, solution)[group])
    if kind == "masses":
        return np.array([first_moved.mass - second.mass])
    if kind == "centres of mass":
        return first_moved.p_body_com - second.p_body_com
    return (first_moved.I_com - second.I_com).ravel()


def _difference_of_couplings(problem: FitProblem, solution: FitSolution, joint: int) -> Array:
    """Return the differences (joints + 1,) of the ratios with which a joint follows, then of its offset."""
    coupled = coupled_sides(problem, solution)
    first = coupled.first.get(joint)
    second = coupled.second.get(joint)
    if first is None or second is None:
        return np.zeros(0)
    return np.append(first.ratios - second.ratios, first.offset - second.offset)


# -- both sides in the terms of the second ------------------------------------------------------------


def mapped_limits(problem: FitProblem, solution: FitSolution, joint: int) -> tuple[float, float] | None:
    """Return the limits of the first side as values of the second in m or rad, or None."""
    limits = problem.axes[joint].limits
    if limits is None:
        return None
    sign = solution.unknowns.signs[joint]
    zero = zero_of(problem, solution.unknowns, joint)
    low, high = np.sort(sign * (np.array(limits) - zero)).tolist()
    return low, high


def partner_groups(problem: FitProblem) -> dict[int, int]:
    """Return {group of the first side: group of the second side}."""
    partners = {0: 0}
    for i, axis in enumerate(problem.axes):
        if not axis.closes_loop:
            partners[axis.child] = problem.second.axes[i].child
    return partners


def body_motions(problem: FitProblem, solution: FitSolution) -> Array:
    """Return the motions (groups, 4, 4) of the bodies of the first side onto those of the second."""
    unknowns = solution.unknowns
    _, _, motions = problem.motions(unknowns.signs, values_of(unknowns)[None], unknowns.deviating)
    return motions[0]


class CoupledSides(NamedTuple):
    """What follows in each side, as values of the second side, and the order in which joints are made followers."""

    first: dict[int, CoupledFollower]
    second: dict[int, CoupledFollower]
    order: list[int]


def coupled_sides(problem: FitProblem, solution: FitSolution) -> CoupledSides:
    """Return the followers of both sides, so that the same joints follow in both where the couplings allow it."""
    unknowns = solution.unknowns
    zeros = np.zeros(problem.count)
    for joint in range(problem.count):
        zeros[joint] = zero_of(problem, unknowns, joint)
    ratios, totals = coupling_constraints(problem.first, problem.axes)
    # q_first = sign * q_second + zero
    ratios_of_first = ratios * unknowns.signs
    totals_of_first = totals - ratios @ zeros
    ratios_of_second, totals_of_second = coupling_constraints(problem.second, problem.second.axes)
    order = _follower_order(problem)
    first = followers_by_elimination(ratios_of_first, totals_of_first, order)
    second = followers_by_elimination(ratios_of_second, totals_of_second, order)
    return CoupledSides(first, second, order)


def _followers(side: RobotSide) -> set[str]:
    """Return the names of the joints that a coupling lets follow others."""
    return {coupling.follower for coupling in side.couplings}


def _follower_order(problem: FitProblem) -> list[int]:
    """Return the joints: those that follow in the second side, then those that follow in the first, then all others."""
    first_followers = _followers(problem.first)
    second_followers = _followers(problem.second)
    order = []
    for i, axis in enumerate(problem.second.axes):
        if axis.name in second_followers:
            order.append(i)
    for i, axis in enumerate(problem.axes):
        if axis.name in first_followers and i not in order:
            order.append(i)
    for i in range(problem.count):
        if i not in order:
            order.append(i)
    return order


def is_same_limit(first: float, second: float) -> bool:
    """Return whether two ends of ranges in m or rad are equal; both may be infinite."""
    return first == second or abs(first - second) <= LIMIT_TOLERANCE


def _is_same_motion(first: CoupledFollower, second: CoupledFollower) -> bool:
    """Return whether a joint follows the same joints in the same way."""
    limits = RATIO_TOLERANCE * np.maximum(np.abs(first.ratios), np.abs(second.ratios)) + _SMALLEST_RATIO
    has_same_ratios = bool(np.all(np.abs(first.ratios - second.ratios) <= limits))
    return has_same_ratios and abs(first.offset - second.offset) <= LIMIT_TOLERANCE


# -- texts --------------------------------------------------------------------------------------------


def distinct_texts(texts_with: Callable[[int], tuple[str, str]]) -> tuple[str, str]:
    """Return the texts of two values with as few significant digits as make them differ: four, or more."""
    texts = texts_with(_SIGNIFICANT_DIGITS[0])
    for digits in _SIGNIFICANT_DIGITS:
        texts = texts_with(digits)
        if texts[0] != texts[1]:
            break
    return texts


def position_text(value: float, is_angle: bool, digits: int) -> str:
    """Return a value in m or rad as text in mm or degrees."""
    size = moved(value, is_angle)
    if digits == _SIGNIFICANT_DIGITS[0]:
        return str(size)
    return format.shown(size.value, size.unit, digits)


def interval_text(limits: tuple[float, float] | None, is_angle: bool, digits: int = _SIGNIFICANT_DIGITS[0]) -> str:
    """Return a range in m or rad as text in mm or degrees; "-" if a side states none."""
    if limits is None:
        return "-"
    if limits == UNLIMITED:
        return "no limits"
    return f"{position_text(limits[0], is_angle, digits)} .. {position_text(limits[1], is_angle, digits)}"


def part_texts(axis: Axis, side: RobotSide) -> dict[str, list[str]]:
    """Return {kind: texts} of the limits, speeds and efforts of the joints that a side writes instead of one."""
    texts: dict[str, list[str]] = {"limits": [], "speeds": [], "efforts": []}
    for part in axis.merged_axes:
        if part.limits is not None and part.limits != UNLIMITED:
            texts["limits"].append(f"{part.name} {interval_text(part.limits, part.is_angle)}")
        if part.max_speed is not None:
            texts["speeds"].append(f"{part.name} {speed_text(part.max_speed, part)}")
        if part.name in side.efforts:
            texts["efforts"].append(f"{part.name} {effort_text(side.efforts[part.name], part)}")
    return texts


def speed_text(value: float, axis: Axis) -> str:
    """Return a speed in m/s or rad/s as text."""
    return f"{moved(value, axis.is_angle)}/s"


def effort_text(value: float, axis: Axis) -> str:
    """Return a torque in N m, or a force in N, as text."""
    unit = "N m" if axis.is_angle else "N"
    return f"{value:g} {unit}"


def mass_text(value: float) -> str:
    """Return a mass in kg as text."""
    return f"{value:g} kg"


def point_text(p: Array) -> str:
    """Return a point (3,) in m as text in mm."""
    x, y, z = np.round(1e3 * p, 3) + 0.0
    return f"({x:g}, {y:g}, {z:g}) mm"


def _is_free_ball(axis: Axis) -> bool:
    """Return whether a joint that its file writes as one joint is stated to have no limits."""
    return not axis.merged_axes and axis.limits == UNLIMITED


def moments_text(tensor: Array) -> str:
    """Return the principal moments of an inertia tensor (3, 3) in kg m2 as text, smallest first."""
    # principal moments: a tensor in other axes shows the same three numbers
    values = map("{:.4g}".format, np.linalg.eigvalsh(tensor))
    return f"moments {', '.join(values)} kg m2"


def tensor_text(tensor: Array, digits: int) -> str:
    """Return the entries of an inertia tensor as text, in the base of the second side."""
    entries = []
    for row, column in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        entries.append(f"i{'xyz'[row]}{'xyz'[column]} {tensor[row, column]:.{digits}g}")
    return f"{', '.join(entries)} kg m2 in the base"


def coupling_text(problem: FitProblem, joint: int, follower: CoupledFollower | None, digits: int) -> str:
    """Return how joint i follows others as a sum, with the names of the second side."""
    if follower is None:
        return "moves freely"
    parts = []
    is_angle = problem.second.axes[joint].is_angle
    for k in np.flatnonzero(np.abs(follower.ratios) > _SMALLEST_RATIO):
        leader = problem.second.axes[k]
        unit = ""
        if leader.is_angle != is_angle:
            unit = " rad/m" if is_angle else " m/rad"
        parts.append(f"{follower.ratios[k]:g}{unit} × {leader.name}")
    if abs(follower.offset) > LIMIT_TOLERANCE or not parts:
        parts.append(position_text(follower.offset, is_angle, digits))
    return " + ".join(parts)
