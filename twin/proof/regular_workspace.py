"""Boxes of tool positions in which a mechanism is assembled, within its limits, and not singular, at every position.

A box of positions is cut into bricks. A brick that `box_judge` does not decide is cut into eight, down to a smallest
edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.proof.box_judge import BoxJudge, BoxVerdicts, grid_points
from twin.proof.intervals import Certainty

_BATCH = 2048
"""Number of boxes at once."""

_COUNT_ROUNDING = 1e-9
"""Part of a brick by which a side may be longer than a whole number of them."""


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
    counts = np.maximum(np.ceil((high - low) / (edge * 2**halvings) - _COUNT_ROUNDING).astype(int), 1)
    edges = (high - low) / (counts * 2**halvings)
    # corners in whole numbers of the smallest edges: neighbours share their faces exactly
    corners = grid_points(*counts) * 2**halvings
    waiting = _batches(corners, halvings)
    total = float(np.prod(high - low))
    bricks = _CoveredBricks(low, edges)
    finished = 0.0
    octants = grid_points(2, 2, 2)
    while waiting:
        numbers, level = waiting.pop()
        verdicts = judge.judge(low + edges * numbers, low + edges * (numbers + 2**level))
        volume = float(np.prod(edges * 2**level))
        undecided = ~(verdicts.proved | verdicts.outside)
        if level == 1:
            # of a brick whose middle is beyond a limit, less than half can be proved
            undecided &= verdicts.promising
        is_cut = np.zeros(len(numbers), bool)
        if level:
            is_cut = undecided
        bricks.add(verdicts, numbers, level, volume, is_cut)
        if level and undecided.any():
            parts = (numbers[undecided][:, None] + octants * 2 ** (level - 1)).reshape(-1, 3)
            waiting += _batches(parts, level - 1)
            finished += volume * (~undecided).sum()
        else:
            finished += volume * len(numbers)
        progress(f"{bricks.boxes} boxes", min(finished / total, 1.0))
    return bricks.result(judge.R)


def _batches(corners: np.ndarray, level: int) -> list[tuple[np.ndarray, int]]:
    """Return (corners (n, 3), level) of at most `_BATCH` bricks at a time."""
    batches = []
    for first in range(0, len(corners), _BATCH):
        batches.append((corners[first : first + _BATCH], level))
    return batches


class _CoveredBricks:
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
        self._proved_low: list[Array] = []  # lower corners (n, 3) in m of the proved bricks of each call of `add`
        self._proved_high: list[Array] = []

    def add(
        self, verdicts: BoxVerdicts, corner_numbers: np.ndarray, level: int, volume: float, is_cut: Certainty
    ) -> None:
        """Add the verdicts of n bricks of one size.

        Args:
            verdicts: the verdicts.
            corner_numbers: (n, 3) lower corners, in smallest edges from `low`.
            level: how often the bricks can still be halved.
            volume: volume of each brick in m3.
            is_cut: (n,) which of them will be cut, so that their parts are judged in their place.
        """
        self.boxes += len(corner_numbers)
        self.outside += volume * float((verdicts.outside & ~verdicts.proved).sum())
        self.redundant = max(self.redundant, verdicts.redundant)
        corners = corner_numbers[verdicts.proved]
        self._proved_low.append(self.low + self.edges * corners)
        self._proved_high.append(self.low + self.edges * (corners + 2**level))
        undecided = ~(verdicts.outside | verdicts.proved | is_cut)
        for reason, which in verdicts.reasons.items():
            amount = volume * float((which & undecided).sum())
            self.open[reason] = self.open.get(reason, 0.0) + amount

    def result(self, R: Array) -> RegularWorkspace:
        """Return what is proved."""
        low = np.concatenate(self._proved_low)
        high = np.concatenate(self._proved_high)
        volume = float(np.prod(high - low, axis=1).sum())
        return RegularWorkspace(low, high, R, volume, self.outside, self.open, self.edges, self.boxes, self.redundant)
