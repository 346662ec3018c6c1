"""Boxes of tool positions in which a mechanism is assembled, within its limits, and not singular, at every position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.proof import interval_pose, intervals, krawczyk
from twin.proof.frame_motion import ToolBox
from twin.proof.interval_pose import IntervalPose
from twin.proof.intervals import Certainty, Intervals
from twin.proof.krawczyk import Solutions
from twin.proof.limits import LinearLimit
from twin.proof.loops import ClosingConditions, Closure, are_lengths, independent_rows
from twin.proof.rigid_frame import rigid_frame

BATCH = 2048
"""Number of boxes at once."""


_ROUNDED_COUNT = 1e-9
"""Part of a brick by which a side may be longer than a whole number of them."""

CLOSED = 1e-9
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


@dataclass(frozen=True)
class RegularWorkspace:
    """What is proved of the boxes.

    Attributes:
        low, high: corners (k, 3) in m of the proved boxes.
        orientation: (3, 3) rotation of the tool in base, the same at all positions.
        volume: volume in m3 of the proved boxes, which do not overlap.
        outside: volume in m3 where a limit is certainly exceeded by the joint values of the equations, or by the
            assembly near them; another assembly may keep it.
        open: {reason: volume in m3} of the smallest boxes where nothing is proved.
        edges: (3,) edges in m of the smallest boxes.
        boxes: number of boxes that were examined.
        redundant: largest value of the closing conditions that follow from the others only if the CAD is ideal, in m
            or as a sine; 0 if there is none.
    """

    low: Array
    high: Array
    orientation: Array
    volume: float
    outside: float
    open: dict[str, float]
    edges: Array
    boxes: int
    redundant: float


@dataclass(eq=False)
class _Judged:
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

    def judge(self, low: Array, high: Array) -> _Judged:
        """Return the verdicts of boxes with corners low, high (n, 3) in m."""
        outside = self.equations.outside(low, high)
        proved = np.zeros(len(low), bool)
        candidates = np.flatnonzero(~outside)
        judged = _Judged(proved, outside, promising=np.zeros(len(low), bool))
        if len(candidates):
            self._prove(judged, candidates, low[candidates], high[candidates])
        return judged

    def _prove(self, judged: _Judged, numbers: np.ndarray, low: Array, high: Array) -> None:
        """Judge some of the boxes: those with `numbers` (n,) in `judged`, and with corners low, high (n, 3) in m."""
        m = self.equations.values(0.5 * (low + high))
        is_predicted = np.all(np.isfinite(m), axis=1)
        judged.reasons["no assembly"] = np.zeros(len(judged.proved), bool)
        judged.reasons["no assembly"][numbers[~is_predicted]] = True
        m = m[is_predicted]
        low = low[is_predicted]
        high = high[is_predicted]
        numbers = numbers[is_predicted]
        if not len(m):
            return
        judged.promising[numbers] = (m @ self.weights.T >= self.least).all(axis=1)
        tool = self._tool(low, high)
        assembled, x, values = self._assembled(m, tool)
        within = (values >= self.least).all(axis=1)
        outside = (values < self.least).any(axis=1)
        for joint, cosine in self.loops.cones(x, tool):
            limit = intervals.cosine(intervals.decimals(joint.cone or 0.0))
            within &= cosine >= limit
            outside |= cosine < limit
        redundant_sizes, closed = self._closed(x, tool)
        closed &= assembled
        if self.ideal is not None and closed.any():
            closed[closed] = self.ideal.closes(m[closed], low[closed], high[closed])
        reached = closed & within
        regular = np.zeros(len(low), bool)
        if reached.any():
            tool_there = ToolBox(IntervalPose(tool.pose.R[reached], tool.pose.p[reached]))
            regular[reached] = self._regular(x[reached], tool_there)
        # in a regular box the assembly stays the same; which one the equations prefer is evaluated at its middle and
        # its corners, with rounding: no proof
        preferred = np.ones(len(low), bool)
        for share in (0.5, *_grid(2, 2, 2)):  # as shares of the edges
            preferred &= self.equations.preferred(low + share * (high - low))
        proved = reached & regular & preferred
        judged.proved[numbers] = proved
        judged.outside[numbers] |= outside & assembled
        judged.redundant = float(np.max(redundant_sizes[proved], initial=0.0))
        reasons = {
            "no assembly": ~assembled,
            "other conditions": assembled & ~closed,
            "limit": closed & ~within,
            "singular": reached & ~regular,
            "other assembly": reached & regular & ~preferred,
        }
        for reason, holds in reasons.items():
            boxes_with_reason = judged.reasons.setdefault(reason, np.zeros(len(judged.proved), bool))
            boxes_with_reason[numbers] |= holds

    def _assembled(self, m: Array, tool: ToolBox) -> tuple[Certainty, Intervals, Intervals]:
        """Return where (n,) joint values near predictions m (n, k) fit; they (n, k); and sums of joints (n, limits)."""
        assembled = np.ones(len(m), bool)
        x = intervals.unknown(m.shape)
        x = Intervals(np.array(x.low), np.array(x.high))
        values = intervals.exactly(np.zeros((len(m), len(self.limits))))
        for group in self.groups:
            solutions = self._solutions(group, m, tool)
            assembled &= solutions.solved
            x.low[:, group.coordinates] = solutions.x.low
            x.high[:, group.coordinates] = solutions.x.high
            # a limit of joints of several groups is the sum of its parts
            values = values + solutions.functionals(m[:, group.coordinates], self.weights[:, group.coordinates])
        return assembled, x, values

    def closes(self, m: Array, low: Array, high: Array) -> Certainty:
        """Return where (n,) all loops close near predictions m (n, k), in boxes with corners low, high (n, 3) in m."""
        tool = self._tool(low, high)
        assembled, x, _ = self._assembled(m, tool)
        _, closed = self._closed(x, tool)
        return assembled & closed

    def _closed(self, x: Intervals, tool: ToolBox) -> tuple[Array, Certainty]:
        """Return the largest value (n,) of the conditions that are not among the independent ones, and if loops close.

        Conditions that do not follow from the others, as where a pose is impossible, are not small. Tolerances leave a
        gap of lengths; axes that are parallel stay so, hence the sines are as small as without tolerances.
        """
        lengths, sines = self._redundant(x, tool)
        closed = (lengths <= CLOSED + self.loops.play) & (sines <= CLOSED) & self.loops.aligned(x, tool)
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

    def _redundant(self, x: Intervals, tool: ToolBox) -> tuple[Array, Array]:
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


def cover(
    judge: BoxJudge,
    low: Array,
    high: Array,
    edge: float,
    halvings: int,
    progress: Progress = silent,
) -> RegularWorkspace:
    """Return the proved boxes in a box of tool positions.

    The box is cut into bricks with edges up to `edge` m times 2^halvings; a brick that is not proved is cut into eight,
    down to the edge.

    Args:
        judge: judges boxes.
        low: (3,) lower corner of the box in m, in base.
        high: (3,) upper corner.
        edge: largest edge of the smallest bricks in m.
        halvings: how often a brick is halved.
        progress: called with a label and the finished fraction.
    """
    # a side that is a whole number of bricks but for rounding gets no brick more
    counts = np.maximum(np.ceil((high - low) / (edge * 2**halvings) - _ROUNDED_COUNT).astype(int), 1)
    edges = (high - low) / (counts * 2**halvings)
    # corners in whole numbers of the smallest edges: neighbours share their faces exactly
    corners = _grid(*counts) * 2**halvings
    waiting = _batches(corners, halvings)
    total = float(np.prod(high - low))
    bricks = _Cover(low, edges)
    finished = 0.0
    octants = _grid(2, 2, 2)
    while waiting:
        numbers, level = waiting.pop()
        judged = judge.judge(low + edges * numbers, low + edges * (numbers + 2**level))
        volume = float(np.prod(edges * 2**level))
        undecided = ~(judged.proved | judged.outside)
        if level == 1:
            # of a brick whose middle is beyond a limit, less than half can be proved
            undecided &= judged.promising
        is_cut = np.zeros(len(numbers), bool)
        if level:
            is_cut = undecided
        bricks.keep(judged, numbers, level, volume, is_cut)
        if level and undecided.any():
            parts = (numbers[undecided][:, None] + octants * 2 ** (level - 1)).reshape(-1, 3)
            waiting += _batches(parts, level - 1)
            finished += volume * (~undecided).sum()
        else:
            finished += volume * len(numbers)
        progress(f"{bricks.boxes} boxes", min(finished / total, 1.0))
    return bricks.result(judge.R)


def _grid(*counts: int) -> np.ndarray:
    """Return the points (n, 3) of a grid of whole numbers from 0 to the counts along x, y and z, without these."""
    return np.moveaxis(np.indices(counts), 0, -1).reshape(-1, 3)


def _batches(corners: np.ndarray, level: int) -> list[tuple[np.ndarray, int]]:
    """Return (corners (n, 3), level) of at most `BATCH` bricks at a time."""
    batches = []
    for first in range(0, len(corners), BATCH):
        batches.append((corners[first : first + BATCH], level))
    return batches


class _Cover:
    """Collects the verdicts of bricks.

    Attributes:
        low: (3,) lower corner of the covered box in m.
        edges: (3,) edges in m of the smallest bricks.
        boxes: number of bricks that were examined.
        outside: volume in m3 where a limit is certainly exceeded.
        open: {reason: volume in m3} of the smallest bricks where nothing is proved.
        redundant: see `RegularWorkspace`.
    """

    def __init__(self, low: Array, edges: Array) -> None:
        self.low = low
        self.edges = edges
        self.boxes = 0
        self.outside = 0.0
        self.open: dict[str, float] = {}
        self.redundant = 0.0
        self._proved_low: list[Array] = []  # lower corners (n, 3) in m of the proved bricks of each call of `keep`
        self._proved_high: list[Array] = []

    def keep(self, judged: _Judged, corner_numbers: np.ndarray, level: int, volume: float, is_cut: Certainty) -> None:
        """Keep the verdicts of n bricks of one size.

        Args:
            judged: the verdicts.
            corner_numbers: (n, 3) lower corners, in smallest edges from `low`.
            level: how often the bricks can still be halved.
            volume: volume of each brick in m3.
            is_cut: (n,) which of them will be cut, so that their parts are judged in their place.
        """
        self.boxes += len(corner_numbers)
        self.outside += volume * float((judged.outside & ~judged.proved).sum())
        self.redundant = max(self.redundant, judged.redundant)
        corners = corner_numbers[judged.proved]
        self._proved_low.append(self.low + self.edges * corners)
        self._proved_high.append(self.low + self.edges * (corners + 2**level))
        undecided = ~(judged.outside | judged.proved | is_cut)
        for reason, which in judged.reasons.items():
            amount = volume * float((which & undecided).sum())
            self.open[reason] = self.open.get(reason, 0.0) + amount

    def result(self, R: Array) -> RegularWorkspace:
        """Return what is proved."""
        low = np.concatenate(self._proved_low)
        high = np.concatenate(self._proved_high)
        volume = float(np.prod(high - low, axis=1).sum())
        return RegularWorkspace(low, high, R, volume, self.outside, self.open, self.edges, self.boxes, self.redundant)
