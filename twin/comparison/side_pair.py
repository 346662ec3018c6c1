"""The record of one comparison: two sides, the verdict on their joints and links, and what differs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from twin.comparison.compared_items import ComparedItem
from twin.comparison.fit_problem import FitProblem
from twin.comparison.largest_difference import ToolDifference
from twin.comparison.line_gaps import FitSolution
from twin.comparison.mimic import MimicError
from twin.comparison.pose_comparison import PoseFit
from twin.comparison.properties import PROPERTY_KINDS, Properties, PropertyRow
from twin.comparison.side import RobotSide
from twin.core.json_types import JsonObject

Kinematics = Literal["agree", "agree after conventions", "disagree", "unexplained"]


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
        uncompared: names of joints about whose places the poses say nothing; () where joint lines are compared.
    """

    first: RobotSide
    second: RobotSide
    kinematics: Kinematics
    items: tuple[ComparedItem, ...]
    ties: tuple[tuple[str, ...], ...]
    properties: Properties | None
    worst: ToolDifference | None
    problem: FitProblem | None = field(repr=False)
    solution: FitSolution | None = field(repr=False)
    poses: PoseFit | None = None
    mimic: MimicError | None = None
    uncompared: tuple[str, ...] = ()

    @property
    def conventions(self) -> tuple[ComparedItem, ...]:
        """Conventions that differ."""
        return tuple(item for item in self.items if item.kind != "link")

    @property
    def differences(self) -> tuple[ComparedItem, ...]:
        """Differences that no convention explains."""
        return tuple(item for item in self.items if item.kind == "link")

    @property
    def loops_alone(self) -> bool:
        """Whether the differences are open loops alone, which no fit of joint lines has shown."""
        return self.problem is None and bool(self.differences)

    @property
    def agrees(self) -> bool:
        """Whether joints and links agree, after conventions at most."""
        return self.kinematics in ("agree", "agree after conventions")

    def as_dict(self) -> JsonObject:
        """Return the comparison as plain data."""
        verdicts = {}
        rows = []
        if self.properties is not None:
            for kind in PROPERTY_KINDS:
                verdicts[kind] = self.properties.verdict(kind)
            rows = _as_dicts(self.properties.rows)
        largest = None if self.worst is None else self.worst.as_dict()
        poses = None if self.poses is None else self.poses.as_dict()
        mimic = None if self.mimic is None else self.mimic.as_dict()
        return {
            "first": self.first.label,
            "second": self.second.label,
            "kinematics": self.kinematics,
            "conventions": _as_dicts(self.conventions),
            "differences": _as_dicts(self.differences),
            "ties": list(map(list, self.ties)),
            "worst": largest,
            "poses": poses,
            "mimic": mimic,
            "properties": verdicts,
            "property_rows": rows,
        }


def _as_dicts(rows: Sequence[ComparedItem | PropertyRow]) -> list[JsonObject]:
    """Return items or rows as plain data."""
    return [row.as_dict() for row in rows]
