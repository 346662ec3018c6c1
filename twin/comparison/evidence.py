"""What two sides state beyond their joint lines: base frame, zeros, tool frames, limits and inertias.

Lines leave some values open: the zero of the first joint and a turn of the base move the same lines, and so do the zero
of the last joint and a turn of the tool. Each piece of evidence can fix such a value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import FrameGap, leaf_frame_gaps
from twin.comparison.side import ONE_COORDINATE_KINDS
from twin.comparison.tool_lines import may_frames_agree
from twin.comparison.unknowns import BASE_VALUES, JointDeviation, Unknowns, values_of, zero_column
from twin.core import spatial
from twin.core.spatial import Array

EvidenceKind = Literal["base", "zero", "limits", "tool", "inertia"]

LIMIT_TOLERANCE = 1e-4
"""Difference of limits in rad or m up to which they are equal: files round them to four or five digits."""

RELATIVE_TOLERANCE = 1e-3
"""Relative difference of speeds, efforts, masses and inertias up to which they are equal."""

CENTRE_TOLERANCE = 1e-4
"""Distance in m of centres of mass up to which they are equal."""

CONVENTION_COST = 1.0
"""Cost of a convention that differs: a moved base, zero or tool, or a sign."""

LIMITS_COST = 1.5
"""Cost of limits that differ.

One more convention that makes them equal is likelier than an error; two more conventions are not.
"""

INERTIA_COST = 1.7
"""The same for inertias: a zero that moves against the limits turns no inertia."""

_SMALLEST_TENSOR = 1e-12
"""Size of an inertia tensor in kg m2 that stands for 0 in a quotient."""


@dataclass(frozen=True)
class Evidence:
    """One piece of evidence.

    Attributes:
        kind: what is compared.
        index: the joint, or for "inertia" the group of the first side; 0 for the base.
        weight: cost if it differs.
    """

    kind: EvidenceKind
    index: int
    weight: float


class StatedEvidence:
    """The evidence of a problem, for given signs and deviating joints.

    Attributes:
        problem: the two sides.
    """

    def __init__(self, problem: FitProblem) -> None:
        self.problem = problem
        self._possible_tools: dict[tuple[int, tuple[float, ...], tuple[JointDeviation, ...]], bool] = {}

    @cached_property
    def compared_frames(self) -> tuple[FrameGap, ...]:
        """The frames of leaf links without any change; on a link with the tool frame, only this frame.

        Where a file puts the frame of a link is of no consequence, also on the last one.
        """
        leaves = leaf_frame_gaps(self.problem, self.problem.unchanged)
        tools = (self.problem.first.tool, self.problem.second.tool)
        with_tool = set()
        for gap in leaves:
            if gap.name in tools:
                with_tool.add(gap.joint)
        frames = []
        for gap in leaves:
            if gap.joint not in with_tool or gap.name in tools:
                frames.append(gap)
        return tuple(frames)

    @cached_property
    def partners(self) -> dict[int, int]:
        """{group of the first side: group of the second side}."""
        partners = {0: 0}
        for i, axis in enumerate(self.problem.axes):
            if not axis.closes_loop:
                partners[axis.child] = self.problem.second.axes[i].child
        return partners

    def satisfiable(self, signs: Array) -> list[Evidence]:
        """Return the pieces of evidence that some values of the conventions make equal."""
        problem = self.problem
        evidence = [Evidence("base", 0, CONVENTION_COST)]
        for i in problem.signed:
            evidence.append(Evidence("zero", i, CONVENTION_COST))
            if self.limit_zero(i, signs) is not None:
                evidence.append(Evidence("limits", i, LIMITS_COST))
        joints_with_frames = {gap.joint for gap in self.compared_frames}
        for joint in sorted(joints_with_frames):
            evidence.append(Evidence("tool", joint, CONVENTION_COST))
        for group in self._comparable_inertias:
            evidence.append(Evidence("inertia", group, INERTIA_COST))
        return evidence

    def limit_zero(self, joint: int, signs: Array) -> float | None:
        """Return the zero in m or rad with which the limits of a joint are equal; None if there is none."""
        limits = self.problem.axes[joint].limits
        target = self.problem.second.axes[joint].limits
        if limits is None or target is None or not np.isfinite([*limits, *target]).all():
            return None
        # twice, because both ends are rounded
        if abs((limits[1] - limits[0]) - (target[1] - target[0])) > 2 * LIMIT_TOLERANCE:
            return None
        # the middles of both ranges coincide: q_first = sign * q_second + zero
        return 0.5 * (sum(limits) - float(signs[joint]) * sum(target))

    @cached_property
    def _comparable_inertias(self) -> list[int]:
        """Groups of the first side whose inertias could be equal: same mass, same principal moments."""
        groups = []
        for group, partner in self.partners.items():
            first = self.problem.first.groups[group].inertia
            second = self.problem.second.groups[partner].inertia
            if first is None or second is None:
                continue
            if abs(first.mass - second.mass) > RELATIVE_TOLERANCE * max(first.mass, second.mass):
                continue
            # no convention changes principal moments: they tell whether the tensors can be equal
            moments = np.linalg.eigvalsh(first.I_com)
            moments_of_second = np.linalg.eigvalsh(second.I_com)
            size = max(np.linalg.norm(moments), np.linalg.norm(moments_of_second))
            if np.linalg.norm(moments - moments_of_second) <= RELATIVE_TOLERANCE * size:
                groups.append(group)
        return groups

    def residuals(
        self, pieces: Sequence[Evidence], signs: Array, values: Array, deviating: Sequence[JointDeviation]
    ) -> Array:
        """Return (k, rows) of pieces of evidence in m and rad for `values` (k, unknowns)."""
        _, _, motions = self.problem.motions(signs, values, deviating)
        return self.residuals_of(pieces, signs, values, motions)

    def residuals_of(self, pieces: Sequence[Evidence], signs: Array, values: Array, motions: Array) -> Array:
        """Return the same for the motions (k, groups, 4, 4) of the groups of bodies with these values."""
        parts = [np.zeros((len(values), 0))]
        for evidence in pieces:
            parts.append(self._evidence_rows(evidence, signs, values, motions))
        return np.concatenate(parts, axis=1)

    def _evidence_rows(self, evidence: Evidence, signs: Array, values: Array, motions: Array) -> Array:
        """Return (k, rows) of one piece of evidence, see `residuals_of`."""
        index = evidence.index
        if evidence.kind == "base":
            return values[:, :BASE_VALUES]
        if evidence.kind == "zero":
            return self._zero_difference(index, values[:, zero_column(index)])[:, None]
        if evidence.kind == "limits":
            zero = self.limit_zero(index, signs)
            assert zero is not None
            return self._zero_difference(index, values[:, zero_column(index)] - zero)[:, None]
        if evidence.kind == "tool":
            frame_rows = []
            for gap in self._frames_on(index):
                frame_rows.append(self._frame_rows(gap, motions))
            return np.concatenate(frame_rows, axis=1)
        return self._inertia_rows(index, motions)

    def _inertia_rows(self, group: int, motions: Array) -> Array:
        """Return (k, 12) of the difference of an inertia: its centre in m, and its tensor relative to its size."""
        first = self.problem.first.groups[group].inertia
        second = self.problem.second.groups[self.partners[group]].inertia
        assert first is not None
        assert second is not None
        R = motions[:, group, :3, :3]
        centre = R @ first.p_body_com + motions[:, group, :3, 3] - second.p_body_com
        # relative, so that the tensors of a finger and of a base weigh alike
        size = max(float(np.linalg.norm(second.I_com)), _SMALLEST_TENSOR)
        tensor = (R @ first.I_com @ np.swapaxes(R, 1, 2) - second.I_com) / size
        return np.concatenate([centre, tensor.reshape(len(motions), 9)], axis=1)

    def _frames_on(self, joint: int) -> list[FrameGap]:
        """Return the compared frames of the leaf link on a joint."""
        on_joint = []
        for gap in self.compared_frames:
            if gap.joint == joint:
                on_joint.append(gap)
        return on_joint

    def _frame_rows(self, gap: FrameGap, motions: Array) -> Array:
        """Return (k, 12) of the difference of a frame of both sides."""
        T = spatial.inverse(gap.T_base_second) @ motions[:, self._group_of(gap)] @ self._frames_of_first[gap.name]
        return (T - np.eye(4))[:, :3].reshape(len(motions), 12)

    def _group_of(self, gap: FrameGap) -> int:
        """Return the group of bodies of the first side that carries a frame."""
        return self.problem.axes[gap.joint].child

    @cached_property
    def _frames_of_first(self) -> dict[str, Array]:
        """{name of a frame: T_base_frame (4, 4) of the first side at its drawn state}."""
        start = self.problem.unchanged
        _, _, motions = self.problem.motions(start.signs, values_of(start)[None], ())
        placed = {}
        for gap in self.compared_frames:
            placed[gap.name] = spatial.inverse(motions[0, self._group_of(gap)]) @ gap.T_base_second @ gap.T
        return placed

    def may_be_equal(self, evidence: Evidence, unknowns: Unknowns) -> bool:
        """Return whether some base frame and zeros may make a piece of evidence equal, and all lines as well."""
        if evidence.kind != "tool":
            return True
        key = (evidence.index, tuple(unknowns.signs), unknowns.deviating)
        # a search asks for the same signs and deviations many times
        possible = self._possible_tools.get(key)
        if possible is None:
            frames = self._frames_on(evidence.index)
            Ts_first = np.zeros((len(frames), 4, 4))
            Ts_second = np.zeros((len(frames), 4, 4))
            for k, gap in enumerate(frames):
                Ts_first[k] = self._frames_of_first[gap.name]
                Ts_second[k] = gap.T_base_second
            possible = may_frames_agree(
                self.problem, evidence.index, Ts_first, Ts_second, unknowns.signs, unknowns.deviating
            )
            self._possible_tools[key] = possible
        return possible

    def _zero_difference(self, joint: int, difference: Array) -> Array:
        """Return a difference of zeros in m or rad, for angles without full turns."""
        if not self.problem.axes[joint].is_angle:
            return difference
        return np.arctan2(np.sin(difference), np.cos(difference))

    def violated(self, pieces: Sequence[Evidence], unknowns: Unknowns) -> list[Evidence]:
        """Return the pieces of evidence in which the two sides differ."""
        values = values_of(unknowns)[None]
        _, _, motions = self.problem.motions(unknowns.signs, values, unknowns.deviating)
        violated = []
        for evidence in pieces:
            if not self._is_equal(evidence, self._evidence_rows(evidence, unknowns.signs, values, motions)[0]):
                violated.append(evidence)
        return violated

    def row_count(self, evidence: Evidence) -> int:
        """Return the number of rows of a piece of evidence in `residuals`."""
        if evidence.kind == "base":
            return BASE_VALUES
        if evidence.kind == "tool":
            return 12 * len(self._frames_on(evidence.index))
        if evidence.kind == "inertia":
            return 12
        return 1

    def _is_equal(self, evidence: Evidence, rows: Array) -> bool:
        """Return whether a piece of evidence is equal, for its rows (rows,)."""
        problem = self.problem
        if evidence.kind == "base":
            turn = float(np.linalg.norm(rows[:3]))
            return float(np.linalg.norm(rows[3:])) <= problem.tolerance and turn <= problem.angle_tolerance
        if evidence.kind == "zero":
            is_angle = problem.axes[evidence.index].is_angle
            limit = problem.angle_tolerance if is_angle else problem.tolerance
            return bool(abs(rows[0]) <= limit)
        if evidence.kind == "limits":
            return bool(abs(rows[0]) <= 2 * LIMIT_TOLERANCE)
        if evidence.kind == "tool":
            Ts = rows.reshape(-1, 3, 4)
            # the rows are those of T - 1
            turns = spatial.rotation_angle(Ts[:, :, :3] + np.eye(3))
            shifts = np.linalg.norm(Ts[:, :, 3], axis=1)
            return bool(shifts.max() <= problem.tolerance and turns.max() <= problem.angle_tolerance)
        return bool(np.linalg.norm(rows[:3]) <= CENTRE_TOLERANCE and np.linalg.norm(rows[3:]) <= RELATIVE_TOLERANCE)

    def fixed_values(self, evidence: Evidence, signs: Array) -> dict[int, float]:
        """Return {index of an unknown: value} that a piece of evidence states; {} for one that is a condition."""
        if evidence.kind == "base":
            return dict.fromkeys(range(BASE_VALUES), 0.0)
        if evidence.kind == "zero":
            return {zero_column(evidence.index): 0.0}
        if evidence.kind == "limits":
            zero = self.limit_zero(evidence.index, signs)
            assert zero is not None
            return {zero_column(evidence.index): zero}
        return {}


def rotation_columns(problem: FitProblem) -> list[int]:
    """Return the indices of the unknowns that turn: rotation of the base, zeros of joints that turn."""
    columns = [0, 1, 2]
    for i in problem.signed:
        if problem.kinds[i] in ONE_COORDINATE_KINDS and problem.axes[i].is_angle:
            columns.append(zero_column(i))
    return columns
