"""Judge boxes of tool positions: whether the mechanism is assembled, within limits and regular at every position.

The equations predict joint values, which need no trust: that there are joint values near them follows from the closing
conditions of the mechanism alone, by Krawczyk's operator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.proof import interval_pose, intervals, krawczyk
from twin.proof.frame_motion import ToolBox
from twin.proof.interval_pose import IntervalPose
from twin.proof.intervals import Certainty, Intervals
from twin.proof.krawczyk import Solutions
from twin.proof.linear_limit import LinearLimit
from twin.proof.loops import ClosingConditions, Closure, are_lengths, independent_rows
from twin.proof.rigid_frame import rigid_frame

_CLOSED = 1e-9
"""Largest value, in m or as a sine, of a condition that follows from the others."""


class Prediction(Protocol):
    """What the equations say of boxes of tool positions."""

    def values(self, p: Array) -> Array:
        """Return joint values (n, k) in m and rad at tool positions (n, 3) in m; NaN where there are none."""
        ...

    def preferred(self, p: Array) -> Certainty:
        """Return where the assembly is the preferred one of the equations at tool positions (n, 3) in m."""
        ...

    def outside(self, low: Array, high: Array) -> Certainty:
        """Return where no position of boxes with corners low, high (n, 3) is within reach and limits."""
        ...


@dataclass(eq=False)
class BoxVerdicts:
    """The verdicts of n boxes.

    Attributes:
        proved: (n,) whether everything is proved.
        outside: (n,) whether a limit is certainly exceeded.
        promising: (n,) whether the predicted joint values in the middle are within all limits.
        reasons: {why a box is not proved: (n,) whether it is so}.
        redundant: largest value of the conditions that follow from the others, in proved boxes.
    """

    proved: Certainty
    outside: Certainty
    promising: Certainty
    reasons: dict[str, Certainty] = field(default_factory=dict)
    redundant: float = 0.0


@dataclass(frozen=True)
class LoopGroup:
    """Loops whose joint values follow from the tool pose without the other loops.

    Attributes:
        closures: their closing joints.
        coordinates: numbers of their coordinates.
        rows: numbers of independent conditions, as many as coordinates.
        redundant: numbers of the other conditions, which follow from these.
    """

    closures: list[Closure]
    coordinates: list[int]
    rows: list[int]
    redundant: list[int]


class BoxJudge:
    """Judges boxes of tool positions with one orientation.

    Attributes:
        loops: the closing conditions.
        R: (3, 3) orientation of the tool in base.
        limits: limits of joints.
        groups: the loops, in groups.
        ideal: if the loops have a tolerance, the judge of those without it; else None.
    """

    def __init__(
        self, loops: ClosingConditions, R: Array, limits: Sequence[LinearLimit], equations: Prediction, p: Array
    ) -> None:
        """Choose independent conditions at the position p (3,).

        Raises:
            TwinError: the equations have no joint values there, the loops leave joint values free, or the orientation
                is no rotation but for rounding.
        """
        self.loops = loops
        self.R = R
        self._orientation = interval_pose.fixed(
            rigid_frame(spatial.pose(R, np.zeros(3)), f"{loops.mechanism.name}: orientation of the tool")
        ).R
        self.limits = limits
        self.equations = equations
        x = equations.values(p[None])
        if not np.isfinite(x).all():
            place = np.round(p * 1e3, 3).tolist()
            raise TwinError(
                f"{loops.mechanism.name}: the equations have no joint values at {place} mm, so that no box near it "
                "can be proved: choose a box that the tool reaches"
            )
        tool = self._tool(p[None], p[None])
        count = len(loops.names)
        self.groups = []
        free = list(loops.names)
        for closures, coordinates in loops.groups:
            J = loops.jacobian(closures, intervals.exactly(x), tool, coordinates).middle[0]
            rows = independent_rows(J, range(len(coordinates)))
            redundant = sorted(set(range(len(J))) - set(rows))
            self.groups.append(LoopGroup(closures, coordinates, rows, redundant))
            for number in coordinates:
                free.remove(loops.names[number])
        if free:
            raise TwinError(f"no loop determines the values of {', '.join(free)} from the tool pose")
        # passive joints and the tool move while the active joints are at rest
        self.moving = [*np.flatnonzero(~loops.active).tolist(), *range(count, count + 6)]
        self.weights = np.zeros((len(limits), count))
        for i, limit in enumerate(limits):
            for name, weight in limit.weights.items():
                self.weights[i, loops.names.index(name)] = weight
        self.least = np.array([limit.least for limit in limits])
        self.ideal: BoxJudge | None = None
        if loops.tolerance:
            # a gap that tolerances may leave would hide that the loops of the CAD itself do not close
            self.ideal = BoxJudge(ClosingConditions(loops.mechanism), R, limits, equations, p)

    def _tool(self, low: Array, high: Array) -> ToolBox:
        """Return the tool in boxes with corners low, high (n, 3) in m, with the one orientation."""
        R = intervals.Intervals(
            np.broadcast_to(self._orientation.low, (len(low), 3, 3)),
            np.broadcast_to(self._orientation.high, (len(low), 3, 3)),
        )
        return ToolBox(IntervalPose(R, intervals.between(low, high)))

    def judge(self, low: Array, high: Array) -> BoxVerdicts:
        """Return the verdicts of boxes with corners low, high (n, 3) in m."""
        outside = self.equations.outside(low, high)
        proved = np.zeros(len(low), bool)
        candidates = np.flatnonzero(~outside)
        verdicts = BoxVerdicts(proved, outside, promising=np.zeros(len(low), bool))
        if len(candidates):
            self._prove(verdicts, candidates, low[candidates], high[candidates])
        return verdicts

    def _prove(self, verdicts: BoxVerdicts, numbers: np.ndarray, low: Array, high: Array) -> None:
        """Judge some of the boxes: those with `numbers` (n,) in `verdicts`, and with corners low, high (n, 3) in m.

        The verdicts are completed, in this order; what comes later is judged only where all before is proved:

        1. The equations predict joint values in the middle.
        2. Krawczyk's operator shows that joint values near them fulfil the independent conditions ("assembled").
        3. The other conditions are small, also without tolerances ("closed").
        4. All limits and cones are kept ("within").
        5. The derivatives are regular, so that the tool cannot move while the active joints are at rest.
        6. The assembly is the one that the equations prefer.
        """
        m = self.equations.values(0.5 * (low + high))
        is_predicted = np.all(np.isfinite(m), axis=1)
        verdicts.reasons["no assembly"] = np.zeros(len(verdicts.proved), bool)
        verdicts.reasons["no assembly"][numbers[~is_predicted]] = True
        m = m[is_predicted]
        low = low[is_predicted]
        high = high[is_predicted]
        numbers = numbers[is_predicted]
        if not len(m):
            return
        verdicts.promising[numbers] = (m @ self.weights.T >= self.least).all(axis=1)
        tool = self._tool(low, high)
        assembled, x, values = self._assembled(m, tool)
        within = (values >= self.least).all(axis=1)
        outside = (values < self.least).any(axis=1)
        for joint, cosine in self.loops.cones(x, tool):
            limit = intervals.cosine(intervals.decimals(joint.cone or 0.0))
            within &= cosine >= limit
            outside |= cosine < limit
        redundant_sizes, closed = self._redundant_sizes_and_closed(x, tool)
        closed &= assembled
        if self.ideal is not None and closed.any():
            closed[closed] = self.ideal.are_closed(m[closed], low[closed], high[closed])
        reached = closed & within
        regular = np.zeros(len(low), bool)
        if reached.any():
            tool_there = ToolBox(IntervalPose(tool.pose.R[reached], tool.pose.p[reached]))
            regular[reached] = self._regular(x[reached], tool_there)
        # in a regular box the assembly stays the same; which one the equations prefer is evaluated at its middle and
        # its corners, with rounding: no proof
        preferred = np.ones(len(low), bool)
        for share in (0.5, *grid_points(2, 2, 2)):  # as shares of the edges
            preferred &= self.equations.preferred(low + share * (high - low))
        proved = reached & regular & preferred
        verdicts.proved[numbers] = proved
        verdicts.outside[numbers] |= outside & assembled
        verdicts.redundant = float(np.max(redundant_sizes[proved], initial=0.0))
        reasons = {
            "no assembly": ~assembled,
            "other conditions": assembled & ~closed,
            "limit": closed & ~within,
            "singular": reached & ~regular,
            "other assembly": reached & regular & ~preferred,
        }
        for reason, holds in reasons.items():
            boxes_with_reason = verdicts.reasons.setdefault(reason, np.zeros(len(verdicts.proved), bool))
            boxes_with_reason[numbers] |= holds

    def _assembled(self, m: Array, tool: ToolBox) -> tuple[Certainty, Intervals, Intervals]:
        """Return where (n,) joint values near predictions m (n, k) fit; they (n, k); and sums of joints (n, limits)."""
        assembled = np.ones(len(m), bool)
        unknown = intervals.unknown(m.shape)
        x = Intervals(np.array(unknown.low), np.array(unknown.high))  # filled below, group by group
        values = intervals.exactly(np.zeros((len(m), len(self.limits))))
        for group in self.groups:
            solutions = self._solutions(group, m, tool)
            assembled &= solutions.solved
            x.low[:, group.coordinates] = solutions.x.low
            x.high[:, group.coordinates] = solutions.x.high
            # a limit of joints of several groups is the sum of its parts
            values = values + solutions.functionals(m[:, group.coordinates], self.weights[:, group.coordinates])
        return assembled, x, values

    def are_closed(self, m: Array, low: Array, high: Array) -> Certainty:
        """Return where (n,) all loops close near predictions m (n, k), in boxes with corners low, high (n, 3) in m."""
        tool = self._tool(low, high)
        assembled, x, _ = self._assembled(m, tool)
        _, closed = self._redundant_sizes_and_closed(x, tool)
        return assembled & closed

    def _redundant_sizes_and_closed(self, x: Intervals, tool: ToolBox) -> tuple[Array, Certainty]:
        """Return the largest value (n,) of the conditions that are not among the independent ones, and if loops close.

        Conditions that do not follow from the others, as where a pose is impossible, are not small. Tolerances leave a
        gap of lengths; axes that are parallel stay so, hence the sines are as small as without tolerances.
        """
        lengths, sines = self._largest_redundant(x, tool)
        are_small = (lengths <= _CLOSED + self.loops.largest_redundant_gap) & (sines <= _CLOSED)
        closed = are_small & self.loops.aligned(x, tool)
        return np.maximum(lengths, sines), closed

    def _solutions(self, group: LoopGroup, m: Array, tool: ToolBox) -> Solutions:
        """Return the joint values of a group around the predictions m (n, k)."""
        rows = np.array(group.rows)
        joint_values = Intervals(np.array(m), np.array(m))

        def with_values(part: Intervals) -> Intervals:
            joint_values.low[:, group.coordinates] = part.low
            joint_values.high[:, group.coordinates] = part.high
            return joint_values

        def residual(part: Intervals) -> Intervals:
            return self.loops.residual(group.closures, with_values(part), tool)[:, rows]

        def jacobian(part: Intervals) -> Intervals:
            return self.loops.jacobian(group.closures, with_values(part), tool, group.coordinates)[:, rows]

        return krawczyk.solve(residual, jacobian, m[:, group.coordinates])

    def _regular(self, x: Intervals, tool: ToolBox) -> Certainty:
        """Return where the tool cannot move while the active joints are at rest: regular derivatives."""
        blocks = []
        for group in self.groups:
            J = self.loops.jacobian(group.closures, x, tool, self.moving)
            blocks.append(J[:, np.array(group.rows)])
        derivatives = intervals.joined(blocks, axis=1)
        _, rows, columns = derivatives.shape
        if rows != columns:  # more motions than conditions, or fewer: nothing is known
            return np.zeros(len(derivatives), bool)
        return krawczyk.regular(derivatives)

    def _largest_redundant(self, x: Intervals, tool: ToolBox) -> tuple[Array, Array]:
        """Return the largest lengths and sines (n,) of the conditions that are not among the independent ones."""
        lengths = np.zeros(len(x))
        sines = np.zeros(len(x))
        for group in self.groups:
            if not group.redundant:
                continue
            condition_sizes = self.loops.residual(group.closures, x, tool).largest
            is_length = are_lengths(group.closures)
            for row in group.redundant:
                if is_length[row]:
                    lengths = np.maximum(lengths, condition_sizes[:, row])
                else:
                    sines = np.maximum(sines, condition_sizes[:, row])
        return lengths, sines


def grid_points(*counts: int) -> np.ndarray:
    """Return the points (n, 3) of a grid of whole numbers from 0 to the counts along x, y and z, without these."""
    return np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3)
