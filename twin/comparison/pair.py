"""The comparison of two sides: by their joint lines or, where a side has only poses, by poses of the tool.

A side has only poses if it is a measured table, or equations without joint lines. Loops are then judged by their gaps
at the drawn state, which are read from the description; of other joints that do not move the tool, poses say nothing:
they are named, and not compared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.comparison.compared_items import ComparedItem, frame_item, motion_text
from twin.comparison.fit_problem import ANGLE_PER_LENGTH
from twin.comparison.largest_difference import ToolDifference
from twin.comparison.line_pair import compare_lines
from twin.comparison.loop_gaps import open_loops
from twin.comparison.pose_comparison import PoseFit, compare_rows
from twin.comparison.side import RobotSide
from twin.comparison.side_pair import Kinematics, SidePair
from twin.comparison.tool_path import joints_beside_tool
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array

LARGEST_TOLERANCE = 0.1
"""Largest distance in m up to which joint lines may coincide; the angle is then 0.2 rad."""


def compare_pair(first: RobotSide, second: RobotSide, tolerance: float) -> SidePair:
    """Compare two sides; `tolerance` is the distance in m up to which two joint lines coincide.

    Raises:
        TwinError: the tolerance is out of range, the joints cannot be matched, or a joint has no common range.
    """
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        limit = f"give a number above 0 and up to {LARGEST_TOLERANCE:g} m"
        raise TwinError(f"tolerance {tolerance:g} m: {limit}: with more, all robots agree")
    rows = _side_with_rows(first, second)
    if rows is not None:
        return _compare_poses(first, second, rows, tolerance)
    return compare_lines(first, second, tolerance)


def _side_with_rows(first: RobotSide, second: RobotSide) -> RobotSide | None:
    """Return the side whose rows of poses are compared with the other side; None if joint lines are compared.

    A table has only rows. Equations also have joint lines if they are those of a chain, but a robot with loops, or with
    further joints, has others.
    """
    sampled: list[RobotSide] = []
    tables: list[RobotSide] = []
    for side in (first, second):
        if side.sample_poses is None:
            continue
        sampled.append(side)
        if not side.axes:
            tables.append(side)
    if not sampled:
        return None
    if len(tables) == 2:
        way_out = "compare each with a description: a file, or the CAD of a robot"
        raise TwinError(f"{first.label} and {second.label} both have only poses, at their own joint values: {way_out}")
    if tables:
        return tables[0]
    chain = sampled[0]
    other_side = second if chain is first else first
    if other_side.has_loops or len(other_side.axes) != len(chain.axes):
        return chain
    return None


def _compare_poses(first: RobotSide, second: RobotSide, table: RobotSide, tolerance: float) -> SidePair:
    """Compare the poses of one of two sides, `table`, with those of the other, and then with its joint lines.

    A loop of the robot that is open at the drawn state is a difference, whatever the poses say: the tool may not depend
    on it. `tolerance` is the distance in m up to which poses, and places of joints, coincide.
    """
    assert table.sample_poses is not None
    robot = second if table is first else first
    rows = table.sample_poses()
    compared = compare_rows(rows, table.label, robot, tolerance)
    fit = compared.fit
    # both sides stand at the joint values of one row
    largest = ToolDifference(robot.tool, fit.distance, fit.angle, compared.q, compared.q, fit.rows)
    beside_tool = tuple(axis.name for axis in joints_beside_tool(robot))
    if compared.identified is None:
        conventions: tuple[ComparedItem, ...] = ()
        # equations state their frames; those of a measuring device are always others
        if fit.agrees and rows.computed:
            conventions = _frame_conventions(table, robot, rows.T, fit, tolerance)
        open_loop_items = open_loops(robot, tolerance)
        kinematics: Kinematics = "agree"
        if open_loop_items or not fit.agrees:
            kinematics = "disagree"
        elif conventions:
            kinematics = "agree after conventions"
        items_of_pair = (*open_loop_items, *conventions)
        return SidePair(
            first, second, kinematics, items_of_pair, (), None, largest, None, None, fit, uncompared=beside_tool
        )
    if table is first:
        pair = compare_lines(compared.identified, robot, compared.tolerance)
    else:
        pair = compare_lines(robot, compared.identified, compared.tolerance)
    if pair.agrees and not pair.items:
        # the remainder is more than noise, but less than the tolerance of joint lines
        pair = replace(pair, kinematics="disagree")
    return replace(pair, first=first, second=second, worst=largest, properties=None, poses=fit, uncompared=beside_tool)


def _frame_conventions(
    table: RobotSide, robot: RobotSide, T_rows: Array, fit: PoseFit, tolerance: float
) -> tuple[ComparedItem, ...]:
    """Return the conventions of base and tool frame that a fit needs: one of the two where one is enough.

    `T_rows` (rows, 4, 4) are the poses of the side `table`.
    """
    # the robot's own poses, since T_row = base T_robot tool
    T_robot = spatial.inverse(fit.base) @ T_rows @ spatial.inverse(fit.tool)
    same = np.eye(4)
    # a moved frame is the same in all rows: the first row gives it
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
        text = f"the base frame of {robot.label} is moved by {motion_text(X)} in that of {table.label}"
        items.append(frame_item("base frame", text, X))
    if _is_moved(Y, tolerance):
        text = f"the tool frame of {table.label} is moved by {motion_text(Y)} in that of {robot.label}"
        items.append(frame_item("tool frame", text, Y))
    return tuple(items)


def _is_moved(T: Array, tolerance: float) -> bool:
    """Return whether one of the motions (..., 4, 4) exceeds the tolerance in m, or its angle."""
    shift = float(np.linalg.norm(T[..., :3, 3], axis=-1).max())
    turn = float(np.max(spatial.rotation_angle(T[..., :3, :3])))
    return shift > tolerance or turn > ANGLE_PER_LENGTH * tolerance
