"""Compute a workspace on a grid of positions, in several orientations near a central orientation.

Poses are not stored: in chunks of indices, a compiled kernel computes each pose from its index. Only a few values are
stored for each position. Hard limits of driven joints, motors, rails and passive joints are kept; collisions are not
checked.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from twin.analysis import measure
from twin.analysis.cluster import each
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import COLUMNS, Workspace
from twin.api.robot import Robot
from twin.api.robot_loading import load
from twin.core import compute_device
from twin.core.compute_device import Choice
from twin.core.errors import KinematicsError, TwinError
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.kinematics.closed_loops.bounds import Bound, bounds_of
from twin.kinematics.closed_loops.passive_limits import PassiveCheck, passive_limits

if TYPE_CHECKING:
    from distributed import Client

PoseKernel = Callable[[Array], tuple[Array, ...]]
"""Function of samples (size, k), see `twin.analysis.measure.kernel`."""

CHUNK = 1 << 18
"""Number of poses in a chunk; a chunk requires tens of milliseconds and a few MB."""

_FIRST_HALF_EDGE = 0.1
"""Half the edge length in m of the first box in the search for reached positions."""

_LAST_HALF_EDGE = 12.8
"""Half the edge length in m of the largest box in this search."""

_POSITIONS_PER_EDGE = 32
"""Number of positions along the longest edge in the search for the box."""

_COUNT_ROUNDING = 1e-9
"""Part of a step by which an extent may be longer than a whole number of steps."""

_MOST_REFINEMENTS = 5
"""Maximum number of refinements of the box."""


class UnreachedError(TwinError):
    """No position of a grid is reached in any of the grid's orientations."""


def shared_bounds(robot: Robot) -> tuple[Bound, ...]:
    """Return the limits of a robot that involve several joints."""
    return measure.shared(bounds_of(robot.mechanism, robot.gaps))


def passive_check(robot: Robot) -> PassiveCheck | None:
    """Return the check of limits of passive joints.

    The result is None in two cases: no passive joint has limits, or the equations do not describe the mechanism. In the
    second case, its loops do not close at poses of the equations; the central pose is tested.
    """
    if not passive_limits(robot.mechanism):
        return None
    check = robot.passive_check
    if robot.files is None or not robot.files.has_equations:
        return check
    kin = robot.kinematics()
    T = centre(robot)
    if kin.closed_inverse:
        closes = measure.agree(kin, check, T)
    else:
        q = _home(robot)[None]
        Ts = kin.forward_many(q)
        closes = np.isfinite(Ts).all() and check.unknowns_at_poses(q, Ts)[1].all()
    if not closes:
        return None
    return check


def limited_passive_joints(robot: Robot) -> list[str]:
    """Return the names of the passive joints with limits; a joint with several limits once."""
    names: list[str] = []
    for limit in passive_limits(robot.mechanism):
        if limit.joint.name not in names:
            names.append(limit.joint.name)
    return names


def limit_facts(robot: Robot, passive: PassiveCheck | None) -> dict[str, list[str]]:
    """Return the names of passive joints whose limits are kept, and of joints with limits that are not checked."""
    kept_joints: list[str] = []
    unchecked: list[str] = []
    soft = []
    if passive is None:
        unchecked = limited_passive_joints(robot)
    else:
        kept_joints = limited_passive_joints(robot)
    for joint in robot.mechanism.active:
        if joint.soft_limits is None:
            continue
        low, high = joint.limits or (-np.inf, np.inf)
        soft_low, soft_high = joint.soft_limits
        if soft_low > low or soft_high < high:
            soft.append(joint.name)
    return {
        "passive_limits_kept": kept_joints,
        "passive_limits_unchecked": unchecked,
        "soft_limits_unchecked": soft,
    }


def judge(robot: Robot, grid: PoseGrid) -> PoseKernel:
    """Return the function that decides which poses of a grid a robot can reach.

    Raises:
        KinematicsError: the robot's equations have no closed-form inverse.
    """
    kin = robot.kinematics()
    if not kin.closed_inverse:
        raise KinematicsError(
            f"{robot.name}: the equations have no closed-form inverse; a numerical inverse would take hours"
        )
    limits = robot.mechanism.limits
    return measure.kernel(kin, limits, grid.pose, bounds=shared_bounds(robot), passive=passive_check(robot))


def chunks(grid: PoseGrid) -> Iterator[tuple[int, int]]:
    """Yield (first position, last position + 1) of chunks of about `CHUNK` poses."""
    positions_per_chunk = max(1, CHUNK // grid.turns)
    for first in range(0, grid.positions, positions_per_chunk):
        yield first, min(first + positions_per_chunk, grid.positions)


def evaluate(kernel: PoseKernel, grid: PoseGrid, first: int, last: int) -> np.ndarray:
    """Return the values (last - first, 4) float32, in the order of `COLUMNS`, of the positions first to last - 1."""
    indices = np.arange(first * grid.turns, last * grid.turns, dtype=np.float64)[None]
    *values, _ = kernel(indices)
    by_position = [value.reshape(last - first, grid.turns) for value in values]
    reached, inverse, margin, singularity = by_position
    count = reached.sum(axis=1)
    values_of_positions = np.zeros((last - first, 4), np.float32)
    values_of_positions[:, 0] = count / grid.turns
    values_of_positions[:, 1] = inverse.sum(axis=1) / np.maximum(count, 1)
    values_of_positions[:, 2] = margin.max(axis=1)
    values_of_positions[:, 3] = np.fmin.reduce(singularity, axis=1)
    return values_of_positions


def centre(robot: Robot) -> Array:
    """Return T_base_tool (4, 4) in the posture `home`, else in the first posture, else in the rest poses."""
    return robot.loops.forward(_home(robot))


def _home(robot: Robot) -> Array:
    """Return the joint values (n,) of the posture `home`, else of the first posture, else of the rest poses."""
    postures = robot.mechanism.postures
    if "home" in postures:
        return robot.mechanism.posture("home")
    if postures:
        first = next(iter(postures))
        return robot.mechanism.posture(first)
    return robot.loops.q


def box(robot: Robot, T: Array, tilt: float = 0.0, turns: int = 1) -> tuple[Array, Array]:
    """Return the lower and the upper corner (3,) in m, in base, of a box around all reached positions.

    The search starts at the position of T (4, 4); the central orientation is that of T.

    Raises:
        UnreachedError: no position near the pose is reached.
    """
    half = _FIRST_HALF_EDGE
    middle = T[:3, 3]
    while True:
        positions, step = _reached(robot, low=middle - half, high=middle + half, T=T, tilt=tilt, turns=turns)
        # The outermost positions of the box are not reached: all reached positions are inside.
        surrounded = len(positions) > 0 and (np.abs(positions - middle) < half - 0.5 * step).all()
        if surrounded or half >= _LAST_HALF_EDGE:
            break
        half *= 2
    if not len(positions):
        raise UnreachedError(
            f"{robot.name}: with the tool's orientation in posture home, the tool reaches no position within {half:g} "
            "m of its position there; allow other orientations (--tilt-deg), or sample joint values (--joints)"
        )
    low = positions.min(axis=0) - 2 * step
    high = positions.max(axis=0) + 2 * step
    for _ in range(_MOST_REFINEMENTS):  # repeat on a finer grid: a coarse grid misses thin regions
        positions, step = _reached(robot, low=low, high=high, T=T, tilt=tilt, turns=turns)
        lowest = positions.min(axis=0)
        highest = positions.max(axis=0)
        touched = (lowest < low + step) | (highest > high - step)
        low = lowest - 2 * step
        high = highest + 2 * step
        if not touched.any():
            break
    return low, high


def _reached(robot: Robot, low: Array, high: Array, T: Array, tilt: float, turns: int) -> tuple[Array, float]:
    """Return (reached positions (k, 3), step) of a coarse grid between two corners, in m."""
    step = float((high - low).max() / (_POSITIONS_PER_EDGE - 1))
    # Without this, rounding could add a layer of positions beyond the upper corner.
    nx, ny, nz = (np.ceil((high - low) / step - _COUNT_ROUNDING).astype(int) + 1).tolist()
    grid = PoseGrid(low=low, step=step, shape=(nx, ny, nz), R_base_tool=T[:3, :3], tilt=tilt, turns=turns)
    values = evaluate(judge(robot, grid), grid, 0, grid.positions)
    return grid.position(np.flatnonzero(values[:, 0] > 0)), step


@lru_cache(maxsize=4)
def _judge_of(source: str, protocol: str | None, packed: bytes) -> tuple[PoseKernel, PoseGrid]:
    """Return the kernel of a robot, and the grid that is `packed`; each worker makes them once."""
    robot = load(source)
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    grid = pickle.loads(packed)
    return judge(robot, grid), grid


def _remote(
    source: str, protocol: str | None, packed: bytes, first: int, last: int, choice: Choice
) -> tuple[np.ndarray, str]:
    """Evaluate a chunk of positions; return the values, and what has computed them (`ComputeDevice.name`).

    This is called in a worker process, which caches the kernel for its next chunk.
    """
    with compute_device.computing_on(choice) as device:
        values = evaluate(*_judge_of(source, protocol, packed), first, last)
    return values, device.name


def over_grid(
    robot: Robot,
    grid: PoseGrid,
    store: Callable[[tuple[int, int]], np.ndarray] = lambda shape: np.zeros(shape, np.float32),
    progress: Progress = silent,
    *,
    client: Client | None = None,
    source: str = "",
    protocol: str | None = None,
) -> Workspace:
    """Return the workspace of a robot on a grid, computed with all processors of this machine or by a cluster.

    Args:
        robot: a robot with a closed-form inverse.
        grid: the positions and orientations to evaluate.
        store: function from a shape (positions, 4) to the array for the results, in memory or on disk.
        progress: called with a text on the current activity and the fraction done.
        client: client of a cluster; None: this machine.
        source: name or path by which the cluster's workers load the robot.
        protocol: name of the protocol that sets the trocar positions, or None.

    Raises:
        KinematicsError: the equations have no closed-form inverse.
    """
    values = store((grid.positions, len(COLUMNS)))
    label = f"{grid.poses:.3g} poses"
    if client is not None:
        parts = list(chunks(grid))
        packed = pickle.dumps(grid)
        choice = compute_device.current().choice
        tasks = []
        for first, last in parts:
            tasks.append((source, protocol, packed, first, last, choice))
        names: set[str] = set()
        for done, (i, (result, name)) in enumerate(each(client, _remote, tasks), 1):
            first, last = parts[i]
            values[first:last] = result
            names.add(name)
            progress(label, done / len(parts))
    else:
        kernel = judge(robot, grid)
        for first, last in chunks(grid):
            values[first:last] = evaluate(kernel, grid, first, last)
            progress(label, last / grid.positions)
        names = {compute_device.current().name}
    facts: JsonObject = {"device": ", ".join(sorted(names)), **limit_facts(robot, passive_check(robot))}
    return Workspace(robot.name, grid, values, facts)
