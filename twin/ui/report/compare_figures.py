"""Draw both robots of the pair that differs most, at the joint values with the largest difference of their tools."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.comparison.comparison_result import Comparison
from twin.comparison.pose_comparison import PoseFit
from twin.comparison.side import RobotSide
from twin.comparison.side_pair import SidePair
from twin.core import spatial
from twin.core.format import quantity
from twin.core.quantity import mm
from twin.core.spatial import Array
from twin.core.units import MM
from twin.ui.report.style import BAND, PALETTE, styled, titled_figure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D


@styled()
def figure(comparison: Comparison) -> Figure:
    """Return a picture of both robots of the worst pair: lines from joint to joint, ending at the tool."""
    pair = max(comparison.pairs, key=_worst_distance)
    drawing = titled_figure(f"{pair.first.label} and {pair.second.label}", 6.5)
    ax = drawing.add_subplot(projection="3d")
    q_first: Mapping[str, float] = {}
    q_second: Mapping[str, float] = {}
    title = "at zero"
    if pair.worst is not None:
        q_first = pair.worst.q_first
        q_second = pair.worst.q
        angle = quantity(pair.worst.angle, "rad")
        title = f"largest difference of '{pair.worst.frame}': {mm(pair.worst.distance)}, {angle}"
    X = np.eye(4)
    if pair.solution is not None:
        base = pair.solution.unknowns.base
        X = spatial.pose(spatial.exp_so3(base[:3]), base[3:])
    first, lines_first = _points(pair.first, q_first, X)
    second, lines_second = _points(pair.second, q_second, np.eye(4))
    # equations tell where the line of a joint is, not where its parts are: draw it beside that of the other robot
    if len(first) == len(second):
        if pair.first.mechanism is None:
            first = _beside(first, lines_first, second)
        elif pair.second.mechanism is None:
            second = _beside(second, lines_second, first)
    first = first / MM
    second = second / MM
    if pair.poses is not None:
        if not pair.first.axes:
            first = _measured(pair.first, pair.poses) / MM
        if not pair.second.axes:
            second = _measured(pair.second, pair.poses) / MM
    styles = ["o-", "o--"]
    for k, side in enumerate((pair.first, pair.second)):
        if not side.axes:
            styles[k] = "."  # rows are no chain
    ax.plot(*first.T, styles[0], color=PALETTE[0], linewidth=4, alpha=0.6, label=pair.first.label)
    ax.plot(*second.T, styles[1], color=PALETTE[4], linewidth=2, label=pair.second.label)
    joints_first = _joint_points(pair.first, X) / MM
    joints_second = _joint_points(pair.second, np.eye(4)) / MM
    if len(joints_first) and len(joints_second):
        ax.plot(*joints_first.T, "s", color=PALETTE[0], markersize=9, alpha=0.6, label="joints, as drawn")
        ax.plot(*joints_second.T, "x", color=PALETTE[4], markersize=7)
    _equal_axes(ax, np.vstack([first, second, joints_first, joints_second]))
    ax.set_title(title)
    ax.legend(loc="upper left")
    return drawing


def _equal_axes(ax: Axes3D, points: Array) -> None:
    """Give the three axes one scale, with all points (n, 3) in mm inside, so that angles are drawn true."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = 0.5 * float(np.ptp(points, axis=0).max())
    for k, name in enumerate("xyz"):
        limits = (middle[k] - half, middle[k] + half)
        getattr(ax, f"set_{name}lim")(*limits)
        getattr(ax, f"set_{name}label")(f"{name} [mm]")
        getattr(ax, f"{name}axis").set_pane_color(BAND)  # which a dark page makes dark


def _worst_distance(pair: SidePair) -> float:
    """Return the largest difference of a frame in m; 0 where no poses were compared."""
    if pair.worst is None:
        return 0.0
    return pair.worst.distance


def _measured(side: RobotSide, fit: PoseFit) -> Array:
    """Return the tool positions (k, 3) in m of rows of poses, in the base frame of the robot."""
    assert side.sample_poses is not None
    T = spatial.inverse(fit.base) @ side.sample_poses().T @ spatial.inverse(fit.tool)
    return T[:, :3, 3]


def _beside(points: Array, lines: Array, others: Array) -> Array:
    """Return points (n, 3), each moved along its line, a direction (n, 3), to the place nearest to another point."""
    along = np.sum((others - points) * lines, axis=1, keepdims=True)
    return points + along * lines


def _joint_points(side: RobotSide, X: Array) -> Array:
    """Return the places (n, 3) in m, moved by X, of all joints of a robot with loops, as drawn; none without loops."""
    if not side.has_loops:
        return np.zeros((0, 3))
    points = np.array([axis.point for axis in side.axes])
    return points @ X[:3, :3].T + X[:3, 3]


def _points(side: RobotSide, q: Mapping[str, float], X: Array) -> tuple[Array, Array]:
    """Return base, joints of the chain to the tool, and tool (n, 3) in m, moved by X, and the directions of the lines.

    The direction of a base and of a tool is zero.
    """
    tree = side.tree
    displacements = np.zeros((1, len(tree)))
    for k, axis in enumerate(tree):
        displacements[0, k] = q.get(axis.name, axis.drawn) - axis.drawn
    motions = X @ side.group_motions(displacements)[0]
    group, T_tool = side.frames[side.tool]
    # from the tool down to the base
    above = {axis.child: axis for axis in tree}
    points = [(motions[group] @ T_tool)[:3, 3]]
    lines = [np.zeros(3)]
    while group in above:
        axis = above[group]
        motion = motions[axis.parent]
        # a slide is drawn where its child is: its own line can be anywhere
        if axis.kind == "prismatic":
            motion = motions[axis.child]
        points.append(motion[:3, :3] @ axis.point + motion[:3, 3])
        lines.append(motion[:3, :3] @ axis.direction)
        group = axis.parent
    points.append(X[:3, 3])
    lines.append(np.zeros(3))
    return np.array(points[::-1]), np.array(lines[::-1])
