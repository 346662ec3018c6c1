"""Compute a workspace from samples of the joint ranges, for robots whose equations have no closed-form inverse.

Joint values are spread evenly over their ranges, and the resulting tool positions are counted in grid cells. For a
robot without equations, the positions are computed by closing the loops of the mechanism. In this case, there is no
condition number, and the margin of the loops to a singularity replaces the singularity measure.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from twin import robots
from twin.analysis import measure
from twin.analysis.grid_workspace import CHUNK, limit_facts, passive_check, shared_bounds
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import Workspace
from twin.api.robot import Robot
from twin.core import compute_device
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.spatial import Array
from twin.kinematics.closed_loops.passive_limits import PassiveCheck

_FIRST_SAMPLES = 50_000
"""Number of samples from which the extent of the grid is estimated."""

_FLAT_EXTENT = 1e-6
"""Extent along an axis, relative to the largest extent, below which all positions count as being in one plane."""

_PLACES = 15
"""Number of joint positions at which the rank of the position Jacobian is computed."""

_STEP = 1e-5
"""Step of the finite differences of this Jacobian, relative to the joint ranges."""

_RANK = 1e-3
"""Relative size above which a singular value of this Jacobian counts as nonzero."""

_CELLS_PER_EDGE = 64
"""Number of cells along the largest extent, unless a step is given."""

_SMALLEST_EXTENT = 1e-6
"""Extent in m of a workspace that is a point, so that its cell has an edge."""

_BORDER = 0.05
"""Share of the extent of the first samples by which the grid is larger on each side, besides two cells."""

_MOST_CELLS = 20_000_000
"""Maximum number of grid cells."""

_ROOT_STEPS = 60
"""Number of steps of a fixed-point iteration, which has all digits of double precision after fewer."""


def by_joints(
    robot: Robot,
    count: int,
    step: float | None = None,
    progress: Progress = silent,
) -> Workspace:
    """Return the workspace of a robot from samples of its joint ranges.

    `count` is the number of samples. `step` is the edge length of a grid cell in m; default: 1/64 of the largest extent
    of the workspace along an axis.

    Raises:
        TwinError: a prismatic joint has no limits, there are too many cells, or no sample can be assembled.
    """
    ranges = _ranges(robot)
    passive = passive_check(robot)
    sample = _sampler(robot, ranges, passive)
    first_count = min(_FIRST_SAMPLES, count)
    values, positions = sample(0, first_count)
    positions = positions[_assembled(values, positions)]
    if not len(positions):
        raise TwinError(
            f"{robot.name}: the mechanism cannot be assembled at any of {first_count} samples of its joints"
        )
    extent = np.ptp(positions, axis=0)
    flat = extent <= _FLAT_EXTENT * extent.max()
    grid = _grid(positions.min(axis=0), extent, flat, step)
    nx, ny, _ = grid.shape
    cells = grid.positions
    hits = np.zeros(cells)
    inverse = np.zeros(cells)
    margins = np.full(cells, -np.inf)
    singular = np.full(cells, np.inf)
    outside = 0
    reached = 0
    for first in range(0, count, CHUNK):
        last = min(first + CHUNK, count)
        values, positions = sample(first, last)
        assembled = _assembled(values, positions)
        reached += int(assembled.sum())
        index = np.where(flat, 0, np.round((positions[assembled] - grid.low) / grid.step)).astype(np.int64)
        inside = ((index >= 0) & (index < np.array(grid.shape))).all(axis=1)
        outside += int((~inside).sum())
        cell = index[inside] @ np.array([1, nx, nx * ny])
        counted = values[assembled][inside]
        hits += np.bincount(cell, minlength=cells)
        inverse += np.bincount(cell, weights=counted[:, 1], minlength=cells)
        np.maximum.at(margins, cell, counted[:, 2])
        np.fmin.at(singular, cell, counted[:, 3])
        progress(f"{count:.3g} joint samples", last / count)
    grid_values = np.zeros((cells, 4), np.float32)
    grid_values[:, 0] = hits > 0
    grid_values[:, 1] = inverse / np.maximum(hits, 1)
    grid_values[:, 2] = np.where(hits > 0, margins, 0)
    grid_values[:, 3] = np.where(np.isfinite(singular), singular, np.nan)
    open_ended = []
    for joint in robot.mechanism.active:
        if joint.limits is None or not np.isfinite(joint.limits).all():
            open_ended.append(joint.name)
    facts: JsonObject = {
        "sampled": "joints",
        "samples": count,
        "device": compute_device.current().name,
        "assembled": reached / count,
        "outside_of_box": outside,
        "without_limits": open_ended,
        **limit_facts(robot, passive),
    }
    return Workspace(
        robot.name, grid=grid, values=grid_values, facts=facts, dimension=_dimension(robot, ranges, int((~flat).sum()))
    )


def _grid(low: Array, extent: Array, flat: np.ndarray, step: float | None) -> PoseGrid:
    """Return a grid around positions with the lower corner (3,) and the extent (3,) in m.

    Along a `flat` axis (3,), the grid has one layer of cells, because positions of a plane or a line differ by
    rounding.

    Raises:
        TwinError: there are too many cells.
    """
    step = step or float(max(extent.max(), _SMALLEST_EXTENT)) / _CELLS_PER_EDGE
    # The first samples do not reach the border of the workspace.
    margin = np.where(flat, 0, _BORDER * extent + 2 * step)
    # As floats, the numbers of cells have no largest value.
    shape = np.where(flat, 1.0, np.ceil((extent + 2 * margin) / step) + 1)
    if shape.prod() > _MOST_CELLS:
        raise TwinError(
            f"--step-mm {1e3 * step:.3g}: {shape.prod():.3g} cells; the limit is {_MOST_CELLS:.0g}: increase --step-mm"
        )
    nx, ny, nz = shape.astype(int).tolist()
    return PoseGrid(low - margin, step, (nx, ny, nz), np.eye(3))


def _dimension(robot: Robot, ranges: Array, most: int) -> int:
    """Return the dimension of the set of tool positions, at most `most`: the median rank of the position Jacobian.

    The Jacobian is computed by finite differences at random joint positions. If the mechanism cannot be assembled at
    any of these positions, the result is `most`.
    """
    joint_count = len(ranges)
    span = np.ptp(ranges, axis=1)
    rng = np.random.default_rng(0)
    centres = ranges[:, 0] + span * rng.uniform(0.05, 0.95, (_PLACES, joint_count))
    # at each place, first the place itself, then a step of each joint
    steps = np.vstack([np.zeros(joint_count), _STEP * np.diag(span)])
    q = centres[:, None] + steps
    Ts = robot.loops.forward_many(q.reshape(-1, joint_count)).Ts_base_tool
    p = Ts[:, :3, 3].reshape(_PLACES, joint_count + 1, 3)
    J = p[:, 1:] - p[:, :1]
    J = J[np.isfinite(J).all(axis=(1, 2))]
    if not len(J):
        return most
    values = np.linalg.svd(J, compute_uv=False)
    ranks = (values > _RANK * values.max(initial=0)).sum(axis=1)
    return min(most, int(np.median(ranks)))


def _ranges(robot: Robot) -> Array:
    """Return the ranges (n, 2) of the active joints in m or rad; without limits, a joint makes a full turn.

    Raises:
        TwinError: a prismatic joint has no limits.
    """
    ranges = robot.mechanism.limits
    for i, joint in enumerate(robot.mechanism.active):
        if np.isfinite(ranges[i]).all():
            continue
        if not joint.is_angle:
            raise TwinError(
                f"{robot.name}: joint '{joint.name}' is prismatic and has no limits; add its [[limit]] to the CAD"
            )
        ranges[i] = (-np.pi, np.pi)
    return ranges


def _assembled(values: Array, p: Array) -> np.ndarray:
    """Return (k,) bool: whether samples are reached, at finite tool positions p (k, 3); see `_sampler`."""
    return (values[:, 0] > 0) & np.isfinite(p).all(axis=1)


def _root(n: int) -> float:
    """Return the positive root x of x^(n + 1) = x + 1; evenly spread samples have the steps 1/x, 1/x^2, ..., 1/x^n."""
    x = 2.0
    for _ in range(_ROOT_STEPS):
        x = (1 + x) ** (1 / (n + 1))
    return x


def _sampler(robot: Robot, ranges: Array, passive: PassiveCheck | None) -> Callable[[int, int], tuple[Array, Array]]:
    """Return a function of (first, last) that computes the samples with indices first to last - 1.

    The function returns the values (k, 4) of the samples, with the columns `measure.NAMES`, and the tool positions
    (k, 3) in m.
    """
    joint_count = len(ranges)
    steps = _root(joint_count) ** -np.arange(1, joint_count + 1)

    def joints_of(i: ca.SX) -> ca.SX:
        parts = []
        for part_step in steps:
            parts.append(0.5 + i * part_step)
        q = []
        for part, (low, high) in zip(parts, ranges, strict=True):
            q.append(low + (high - low) * (part - ca.floor(part)))  # the fractional part, which is spread evenly
        return ca.vertcat(*q)

    bounds = shared_bounds(robot)
    if robot.name in robots.names() or (robot.files is not None and robot.files.has_equations):
        kin = robot.kinematics()
        if kin.closed_forward:
            kernel = measure.kernel(kin, ranges, joints_of, bounds=bounds, passive=passive, from_joints=True)

            def by_equations(first: int, last: int) -> tuple[Array, Array]:
                *values, p = kernel(np.arange(first, last, dtype=np.float64)[None])
                return np.concatenate(values).T, p.T

            return by_equations
    loops = robot.loops
    low, high = ranges.T
    span = np.ptp(ranges, axis=1)

    def by_mechanism(first: int, last: int) -> tuple[Array, Array]:
        parts = 0.5 + np.arange(first, last)[:, None] * steps
        q = low + span * (parts % 1)
        solution = loops.forward_many(q)
        closed = np.isfinite(solution.Ts_base_tool).all(axis=(1, 2))
        for bound in bounds:
            closed &= q @ bound.weights >= bound.least
        if passive is not None:
            closed &= passive.keeps_limits(q, solution.states)
        margins = (2 * np.minimum(q - low, high - q) / span).min(axis=1)
        no_condition = 0 * solution.offset  # without equations, there is no condition number
        values: Array = np.stack([closed.astype(float), no_condition, margins, solution.margin], axis=1)
        return values, solution.Ts_base_tool[:, :3, 3]

    return by_mechanism
