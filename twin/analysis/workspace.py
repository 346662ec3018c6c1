"""Compute the workspace of a robot from a grid of poses or from joint samples, depending on its equations."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import numpy as np

from twin.analysis.cluster import Processes, cluster, require_keys
from twin.analysis.grid_workspace import UnreachedError, box, centre, over_grid
from twin.analysis.joint_samples import by_joints
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import Workspace
from twin.api.name_or_path import name_or_path
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError
from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.core.units import MM

_POSITIONS = 50_000_000
"""Maximum number of positions; each takes 16 bytes, in memory or on disk."""

_INTERVALS = 1e100
"""Largest number of steps along an edge for which the number of positions is a floating-point number."""

_TURNS = 1_000_000
"""Maximum number of orientations at each position."""


def workspace(
    robot: Robot | str | Path,
    count: int = 1_000_000,
    step: float | None = None,
    *,
    tilt: float = 0.0,
    turns: int = 1,
    by_joint_positions: bool = False,
    protocol: str | None = None,
    store: Path | None = None,
    progress: Progress = silent,
    **processes: Unpack[Processes],
) -> Workspace:
    """Return the workspace of the tool.

    If the equations have a closed-form inverse, positions on a grid are evaluated in one or more orientations. Joint
    values are sampled instead in each of three cases: there is no closed-form inverse, `by_joint_positions` is True, or
    the search for the extent of the grid finds no position that is reached, without `tilt` and `scheduler`. The third
    case occurs with planar robots, which reach a position only if it is in their plane and only in one orientation.

    Args:
        robot: a robot with CAD, its name or its folder; or a stage or description file.
        count: approximate number of poses, or number of joint samples.
        step: distance between neighbouring grid positions in m; default: computed from `count`.
        tilt: maximum rotation about each axis of base in rad.
        turns: number of orientations at each position.
        by_joint_positions: whether to sample joints even if there is a closed-form inverse.
        protocol: name of the protocol that sets the trocar positions; default: the robot's default protocol.
        store: folder for workspace.npy with the values of each position; default: memory only.
        progress: see `twin.api.Progress`.
        **processes: `scheduler` and `source`: where poses on a grid are evaluated, see `Processes`.

    Raises:
        TwinError: no position of the grid, or with `tilt` or `scheduler` none in the search for its extent, is reached;
            the grid has more than 5e7 positions, or more than 1e6 orientations at each; or joint values would have to
            be sampled with `scheduler`.

    Examples:
        >>> import twin
        >>> space = twin.workspace("sils", count=20_000)
        >>> bool(space.reached.any())
        True
    """
    require_keys("workspace", processes, Processes)
    if turns > _TURNS:
        raise TwinError(f"{turns} orientations at each position (--turns): give at most {_TURNS}")
    scheduler = processes.get("scheduler")
    source = ""
    if scheduler:
        source = processes.get("source") or name_or_path(robot)
    robot = loaded(robot)
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    closed = robot.files is not None and robot.files.has_equations and robot.kinematics().closed_inverse
    if by_joint_positions or not closed:
        if scheduler:
            raise TwinError(
                "--scheduler: joint samples run on this machine only; omit --scheduler, "
                "or omit --joints if the equations have a closed-form inverse"
            )
        return by_joints(robot, count, step, progress)
    progress("find the extent", 0.0)
    T = centre(robot)
    if not tilt:
        turns = 1
    try:
        low, high = box(robot, T, tilt, turns)
    except UnreachedError:
        if scheduler or tilt:
            raise
        return by_joints(robot, count, step, progress)
    grid = _grid(low, high, T_base_tool=T, count=count, step=step, tilt=tilt, turns=turns)

    def stored_values(shape: tuple[int, int]) -> np.ndarray:
        if store is None:
            return np.zeros(shape, np.float32)
        # On disk: the operating system caches as much of the file as fits in memory.
        return np.lib.format.open_memmap(store / "workspace.npy", "w+", np.float32, shape)

    if scheduler:
        with cluster(scheduler) as client:
            space = over_grid(robot, grid, stored_values, progress, client=client, source=source, protocol=protocol)
    else:
        space = over_grid(robot, grid, stored_values, progress)
    if not space.reached.any():
        x, y, z = (high - low) / MM
        size = f"{x:.3g} x {y:.3g} x {z:.3g}"
        text = f"none of {grid.positions} positions, {grid.step / MM:.3g} mm apart, is reached in a box of {size} mm"
        raise TwinError(f"{robot.name}: {text}: reduce --step-mm")
    return space


def _grid(
    low: Array, high: Array, T_base_tool: Array, count: int, step: float | None, tilt: float, turns: int
) -> PoseGrid:
    """Return the grid that fills the box from `low` (3,) to `high` (3,), with the orientation of a pose (4, 4).

    For `count`, `step`, `tilt` and `turns`, see `workspace`.

    Raises:
        TwinError: the grid has more than `_POSITIONS` positions.
    """
    if step is None:
        step = float((np.prod(high - low) * turns / count) ** (1 / 3))
    with np.errstate(over="ignore"):
        intervals = np.floor((high - low) / step)
    if (intervals > _INTERVALS).any():
        raise TwinError(f"a step of {step / MM:.3g} mm is too small: increase --step-mm, or reduce --count")
    # Integers of Python have no largest value, those of numpy have one.
    nx, ny, nz = map(int, (intervals + 1).tolist())
    grid = PoseGrid(low=low, step=step, shape=(nx, ny, nz), R_base_tool=T_base_tool[:3, :3], tilt=tilt, turns=turns)
    if grid.positions > _POSITIONS:
        raise TwinError(
            f"{grid.positions:.3g} positions; the limit is {_POSITIONS:.0e}. Increase --step-mm or reduce --count; or "
            "omit --step-mm and increase --turns, which reduces the number of positions"
        )
    return grid
