"""Limits, speeds, efforts, masses and couplings of two sides, each kind with its own verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.comparison.compared_items import NumberEdit
from twin.comparison.coupled_motion import RATIO_TOLERANCE, SMALLEST_RATIO, CoupledFollower
from twin.comparison.evidence import CENTRE_TOLERANCE, LIMIT_TOLERANCE, RELATIVE_TOLERANCE
from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import FitSolution
from twin.comparison.mapped_properties import body_motions, coupled_sides, mapped_limits, partner_groups
from twin.comparison.property_texts import (
    coupling_text,
    distinct_texts,
    effort_text,
    interval_text,
    mass_text,
    moments_text,
    part_texts,
    point_text,
    speed_text,
    tensor_text,
)
from twin.comparison.side import ONE_COORDINATE_KINDS, UNLIMITED, Axis
from twin.core.json_types import JsonObject
from twin.model.inertia import Inertia

PROPERTY_KINDS: tuple[str, ...] = ("limits", "speeds", "efforts", "masses", "centres of mass", "inertias", "couplings")
"""Kinds of properties in the order of reports."""

BODY_KINDS = ("masses", "centres of mass", "inertias")
"""Kinds of properties of the bodies on a joint; the others are of the joint."""


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


def is_same_limit(first: float, second: float) -> bool:
    """Return whether two ends of ranges in m or rad are equal; both may be infinite."""
    return first == second or abs(first - second) <= LIMIT_TOLERANCE


def _is_same_motion(first: CoupledFollower, second: CoupledFollower) -> bool:
    """Return whether a joint follows the same joints in the same way."""
    limits = RATIO_TOLERANCE * np.maximum(np.abs(first.ratios), np.abs(second.ratios)) + SMALLEST_RATIO
    has_same_ratios = bool(np.all(np.abs(first.ratios - second.ratios) <= limits))
    return has_same_ratios and abs(first.offset - second.offset) <= LIMIT_TOLERANCE


def _is_free_ball(axis: Axis) -> bool:
    """Return whether a joint that its file writes as one joint is stated to have no limits."""
    return not axis.merged_axes and axis.limits == UNLIMITED
