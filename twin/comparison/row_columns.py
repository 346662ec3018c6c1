"""Which column of rows of poses is which driven joint of a robot, and the joint values in the order of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.comparison.coupled_motion import followers_of
from twin.comparison.side import Axis, PoseRows, RobotSide, plain_name
from twin.comparison.tool_path import path_to_tool
from twin.core.errors import TwinError
from twin.core.quantity import moved
from twin.core.spatial import Array

_PROBE_DISPLACEMENT = 0.01
"""Displacement in m or rad with which it is tried whether a joint moves the tool."""

_UNMOVED_CHANGE = 1e-9
"""Largest change of an entry of a pose, in m or of a rotation, by a joint that does not move the tool."""

_SMALLEST_RATIO = 1e-9
"""Ratio of a coupling below which a joint does not move the follower."""

_COUPLING_TOLERANCE = 1e-3
"""Largest distance in m or rad of a joint from the value that its coupling gives it."""

_KIND_TEXTS = {False: "a length", True: "an angle"}
"""{whether a coordinate is an angle: its kind as text}."""


def without_followers(rows: PoseRows, label: str, side: RobotSide) -> PoseRows:
    """Return the rows without the columns of joints that others move by a coupling, if they have the values of it.

    Args:
        rows: the rows.
        label: how the user named their side.
        side: the robot.

    Raises:
        TwinError: a value is not that of the coupling.
    """
    if side.has_loops:
        return rows
    column = _column_of_name(rows)
    values = np.full((len(rows.q), len(side.axes)), np.nan)
    for i, axis in enumerate(side.axes):
        if plain_name(axis.name) in column:
            values[:, i] = rows.q[:, column[plain_name(axis.name)]]
    kept_columns = list(range(len(rows.joints)))
    for i, (ratios, offset) in followers_of(side).items():
        name = side.axes[i].name
        leaders = np.flatnonzero(ratios)
        if name in side.driven_joints or plain_name(name) not in column or np.isnan(values[:, leaders]).any():
            continue
        followed = values[:, leaders] @ ratios[leaders] + offset
        gaps = np.abs(values[:, i] - followed)
        row = int(np.argmax(gaps))
        if gaps[row] > _COUPLING_TOLERANCE:
            stated = f"{name} = {values[row, i]:.6g}, but its coupling in {side.label} gives {followed[row]:.6g}"
            line = f":{rows.lines[row]}" if rows.lines else ""
            way_out = "Correct the value or the coupling, or remove the column"
            raise TwinError(
                f"{label}{line}: {stated} in rad or m (up to {_COUPLING_TOLERANCE:g} apart is allowed). {way_out}"
            )
        kept_columns.remove(column[plain_name(name)])
    joints = [rows.joints[k] for k in kept_columns]
    angles = [rows.angles[k] for k in kept_columns]
    return replace(rows, joints=tuple(joints), angles=tuple(angles), q=rows.q[:, kept_columns])


def _column_of_name(rows: PoseRows) -> dict[str, int]:
    """Return {plain name of a joint of the rows: its column}."""
    names = list(map(plain_name, rows.joints))
    return dict(zip(names, range(len(names)), strict=True))


def joint_values(rows: PoseRows, label: str, side: RobotSide) -> Array:
    """Return the joint values (k, joints) of the rows in the order of the driven joints of the robot's side.

    Joints that do not move the tool can be missing in the rows: their values are NaN.

    Raises:
        TwinError: the joints cannot be matched, or a length stands where the robot has an angle.
    """
    columns = _column_of_joint(rows, label, side)
    axes = _axis_of_name(side)
    q = np.full((len(rows.q), len(side.driven_joints)), np.nan)
    for i, name in enumerate(side.driven_joints):
        if name not in columns:
            continue
        column = columns[name]
        if name in axes:
            _require_unit(rows, column, label, axes[name], side)
        q[:, i] = rows.q[:, column]
    return q


def _column_of_joint(rows: PoseRows, label: str, side: RobotSide) -> dict[str, int]:
    """Return {driven joint of the robot: its column of the rows}, by names or, if all of them differ, by order.

    Raises:
        TwinError: it names the joints of both, and the way out.
    """
    column_of_name = _column_of_name(rows)
    driving = _driving_names(side)
    driving_joints = []
    for name in side.driven_joints:
        if name in driving:
            driving_joints.append(name)
    missing = []
    for name in driving_joints:
        if plain_name(name) in column_of_name:
            continue
        # which joints of loops move the tool is not read from the lines: the missing ones are tried
        if side.tool_poses is None or _moves_tool(side, name):
            missing.append(name)
    driven_names = set(map(plain_name, side.driven_joints))
    extra = []
    for name in rows.joints:
        if plain_name(name) not in driven_names:
            extra.append(name)
    if not missing and not extra:
        columns = {}
        for name in side.driven_joints:
            if plain_name(name) in column_of_name:
                columns[name] = column_of_name[plain_name(name)]
        return columns
    if len(rows.joints) == len(driving_joints) == len(missing):
        return dict(zip(driving_joints, range(len(driving_joints)), strict=True))
    stated = f"{label} has values of {len(rows.joints)} joints ({', '.join(rows.joints)})"
    needed = f"the tool of {side.label} is moved by {len(driving_joints)} ({', '.join(driving_joints)})"
    way_out = "Name the joints alike, or compare fewer with --only"
    passive = _passive_names(extra, side)
    if passive:
        way_out = f"Remove the columns of joints without a motor: {', '.join(passive)}"
    raise TwinError(f"the joints cannot be matched: {stated}, but {needed}. {way_out}")


def _require_unit(rows: PoseRows, column: int, label: str, axis: Axis, side: RobotSide) -> None:
    """Require that a column has angles for a joint that turns, and lengths for one that slides."""
    if axis.is_angle == rows.angles[column]:
        return
    stated = f"joint '{rows.joints[column]}' of {label} is {_KIND_TEXTS[rows.angles[column]]}"
    known_kind = f"'{axis.name}' of {side.label} is {_KIND_TEXTS[axis.is_angle]}"
    way_out = "Correct the unit in the heading, or the order of the columns"
    raise TwinError(f"{stated}, but {known_kind}. {way_out}")


def _axis_of_name(side: RobotSide) -> dict[str, Axis]:
    """Return {name: joint} of a side."""
    axis_of_name = {}
    for axis in side.axes:
        axis_of_name[axis.name] = axis
    return axis_of_name


def _passive_names(names: Sequence[str], side: RobotSide) -> list[str]:
    """Return which of the names are joints of the side without a motor."""
    undriven = set(map(plain_name, side.joint_names)) - set(map(plain_name, side.driven_joints))
    passive = []
    for name in names:
        if plain_name(name) in undriven:
            passive.append(name)
    return passive


def _moves_tool(side: RobotSide, name: str) -> bool:
    """Return whether a driven joint of a robot with loops moves its tool."""
    assert side.tool_poses is not None
    states = np.full((2, len(side.driven_joints)), np.nan)
    states[1, side.driven_joints.index(name)] = side.axes[side.index(name)].drawn + _PROBE_DISPLACEMENT
    at_rest, displaced = side.tool_poses(states)
    if not np.isfinite(at_rest).all():
        return False  # its loops are open wherever they stand: the rows will show it
    # where the loops open, the joint moves them, and the tool with them
    return bool(np.abs(displaced - at_rest).max() > _UNMOVED_CHANGE) or not np.isfinite(displaced).all()


def _driving_names(side: RobotSide) -> set[str]:
    """Return the names of the driven joints that move the tool; of a robot with loops, all."""
    if side.tool_poses is not None or side.has_loops:
        return set(side.driven_joints)
    coupled = followers_of(side)
    names = set()
    for axis in path_to_tool(side):
        i = side.index(axis.name)
        if i not in coupled:
            names.add(axis.name)
            continue
        ratios, _ = coupled[i]
        for leader in np.flatnonzero(np.abs(ratios) > _SMALLEST_RATIO):
            names.add(side.axes[leader].name)
    return names


def require_common_range(rows: PoseRows, q: Array, label: str, side: RobotSide) -> None:
    """Require that for each driven joint, the values q (k, joints) of the rows reach the range of its limits.

    Raises:
        TwinError: it names the joint, both ranges, and the way out.
    """
    axes = _axis_of_name(side)
    for i, name in enumerate(side.driven_joints):
        values = q[:, i]
        if name not in axes or not np.isfinite(values).all():
            continue
        axis = axes[name]
        if axis.limits is None:
            continue
        low, high = axis.limits
        if values.max() >= low and values.min() <= high:
            continue
        place = f"{label}:{rows.lines[0]}" if rows.lines else label
        smallest = moved(float(values.min()), axis.is_angle)
        largest = moved(float(values.max()), axis.is_angle)
        raise TwinError(
            f"{place}: joint '{name}' has no common range: {smallest} .. {largest} in {label}, "
            f"{moved(low, axis.is_angle)} .. {moved(high, axis.is_angle)} in {side.label}. "
            "Correct the unit, the zero or the limits"
        )
