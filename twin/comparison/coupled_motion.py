"""The motions that the couplings of a side allow: which joints move freely, and which follow them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin.comparison.side import Axis, RobotSide
from twin.core.spatial import Array

RATIO_TOLERANCE = 1e-4
"""Difference of ratios of couplings up to which they are equal, relative."""

SMALLEST_RATIO = 1e-9
"""Ratio of a coupling below which a joint does not move the follower."""


class CoupledFollower(NamedTuple):
    """How a joint follows those that move freely: q_joint = ratios @ q + offset.

    Attributes:
        ratios: (joints,) 0 for joints that do not move it, in the unit of the joint per unit of each.
        offset: in m or rad.
    """

    ratios: Array
    offset: float


def coupling_constraints(side: RobotSide, axes: Sequence[Axis]) -> tuple[Array, Array]:
    """Return (ratios (couplings, joints), totals (couplings,)) of a side, for joints in the order of `axes`.

    For all states that the couplings allow, ratios @ q = totals, in m and rad.
    """
    index = {}
    for i, axis in enumerate(axes):
        index[axis.name] = i
    ratios = []
    totals = []
    for coupling in side.couplings:
        if not coupling.ratios.keys() <= index.keys():
            continue
        row = np.zeros(len(axes))
        for name, ratio in coupling.ratios.items():
            row[index[name]] = ratio
        ratios.append(row)
        totals.append(coupling.total)
    return np.array(ratios).reshape(-1, len(axes)), np.array(totals)


def followers_by_elimination(ratios: Array, totals: Array, order: Sequence[int]) -> dict[int, CoupledFollower]:
    """Return {joint: how it follows} of the joints that others move.

    Of the joints of a coupling, the one that is first in `order` is moved. Gauss-Jordan elimination of the constraints,
    with the joints in this order as columns: the joints of its pivots follow the others.
    """
    constraint_rows = np.column_stack([ratios[:, list(order)], totals])
    pivot_columns: list[int] = []
    for column in range(len(order)):
        pivot = len(pivot_columns)
        below = constraint_rows[pivot:, column]
        if not len(below) or np.abs(below).max() < RATIO_TOLERANCE:
            continue
        largest = pivot + int(np.argmax(np.abs(below)))
        eliminate_column(constraint_rows, pivot, largest, column)
        pivot_columns.append(column)
    followers = {}
    for row, column in zip(constraint_rows, pivot_columns, strict=False):
        joint = order[column]
        ratios_of_leaders = np.zeros(len(order))
        ratios_of_leaders[list(order)] = -row[:-1]
        ratios_of_leaders[joint] = 0.0
        followers[joint] = CoupledFollower(ratios_of_leaders, float(row[-1]))
    return followers


def eliminate_column(rows: Array, pivot: int, largest: int, column: int) -> None:
    """Exchange two of the rows (k, n) in place, and subtract `pivot` from the others so that their `column` is 0."""
    rows[[pivot, largest]] = rows[[largest, pivot]]
    rows[pivot] /= rows[pivot, column]
    for other_row in range(len(rows)):
        if other_row != pivot:
            rows[other_row] -= rows[other_row, column] * rows[pivot]


def followers_of(side: RobotSide) -> dict[int, CoupledFollower]:
    """Return `followers_by_elimination` of the couplings of one side, for joints in the order of its axes."""
    # the followers of the file first, so that the elimination makes them follow where it can
    names = {coupling.follower for coupling in side.couplings}
    followers = []
    free_joints = []
    for i, axis in enumerate(side.axes):
        if axis.name in names:
            followers.append(i)
        else:
            free_joints.append(i)
    ratios, totals = coupling_constraints(side, side.axes)
    return followers_by_elimination(ratios, totals, [*followers, *free_joints])
