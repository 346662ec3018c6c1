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
from twin.analysis.workspace import CHUNK, Grid, Workspace, limit_facts, passive_check, shared_bounds
from twin.api.robot import Robot
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.kinematics.closed_loops.passive_limits import PassiveCheck

_FIRST = 50_000
"""Number of samples from which the extent of the grid is estimated."""

_FLAT = 1e-6
"""Extent along an axis, relative to the largest extent, below which all positions count as being in one plane."""

_PLACES, _STEP, _RANK = 15, 1e-5, 1e-3
"""For the rank of the position Jacobian: number of joint positions at which the rank is computed; step of the finite
differences, relative to the joint ranges; relative size above which a singular value counts as nonzero."""

_CELLS = 20_000_000
"""Maximum number of grid cells."""


def by_joints(
    robot: Robot,
    count: int,
    step: float | None = None,
    progress: Callable[[str, float], None] = lambda label, fraction: None,
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
    values, p = sample(0, min(_FIRST, count))
    p = p[(values[:, 0] > 0) & np.isfinite(p).all(axis=1)]
    if not len(p):
        raise TwinError(
            f"{robot.name}: the mechanism cannot be assembled at any of {min(_FIRST, count)} samples of its joints"
        )
    extent = np.ptp(p, axis=0)
    step = step or float(max(extent.max(), 1e-6)) / 64
    flat = (
        extent <= _FLAT * extent.max()
    )  # one layer of cells, because positions of a plane or a line differ by rounding
    margin = np.where(flat, 0, 0.05 * extent + 2 * step)
    low = p.min(axis=0) - margin
    shape = np.where(flat, 1, np.ceil((extent + 2 * margin) / step).astype(int) + 1)
    if shape.prod() > _CELLS:
        text = f"--step-mm {1e3 * step:.3g}: {shape.prod():.3g} cells; the limit is {_CELLS:.0g}: increase --step-mm"
        raise TwinError(text)
    nx, ny, nz = (int(n) for n in shape)
    grid = Grid(low, step, (nx, ny, nz), np.eye(3))
    cells = grid.positions
    hits, inverse = np.zeros(cells), np.zeros(cells)
    margins, singular = np.full(cells, -np.inf), np.full(cells, np.inf)
    outside = reached = 0
    for first in range(0, count, CHUNK):
        last = min(first + CHUNK, count)
        values, p = sample(first, last)
        good = (values[:, 0] > 0) & np.isfinite(p).all(axis=1)
        reached += int(good.sum())
        index = np.where(flat, 0, np.round((p[good] - low) / step)).astype(np.int64)
        inside = ((index >= 0) & (index < shape)).all(axis=1)
        outside += int((~inside).sum())
        at = index[inside] @ np.array([1, nx, nx * ny])
        of = values[good][inside]
        hits += np.bincount(at, minlength=cells)
        inverse += np.bincount(at, weights=of[:, 1], minlength=cells)
        np.maximum.at(margins, at, of[:, 2])
        np.fmin.at(singular, at, of[:, 3])
        progress(f"{count:.3g} joint samples", last / count)
    out = np.zeros((cells, 4), np.float32)
    out[:, 0] = hits > 0
    out[:, 1] = inverse / np.maximum(hits, 1)
    out[:, 2] = np.where(hits > 0, margins, 0)
    out[:, 3] = np.where(np.isfinite(singular), singular, np.nan)
    open_ended = [j.name for j in robot.mechanism.active if j.limits is None or not np.isfinite(j.limits).all()]
    facts: JsonObject = {"sampled": "joints", "samples": count, "assembled": reached / count}
    facts |= {"outside_of_box": outside, "without_limits": open_ended, **limit_facts(robot, passive)}
    return Workspace(robot.name, grid, out, facts, _dimension(robot, ranges, int((~flat).sum())))


def _dimension(robot: Robot, ranges: Array, most: int) -> int:
    """Return the dimension of the set of tool positions, at most `most`: the median rank of the position Jacobian.

    The Jacobian is computed by finite differences at random joint positions. If the mechanism cannot be assembled at
    any of these positions, the result is `most`.
    """
    n = len(ranges)
    places = ranges[:, 0] + np.ptp(ranges, axis=1) * np.random.default_rng(0).uniform(0.05, 0.95, (_PLACES, n))
    q = places[:, None] + np.vstack([np.zeros(n), _STEP * np.diag(np.ptp(ranges, axis=1))])
    p = robot.loops.forward_many(q.reshape(-1, n)).Ts_base_tool[:, :3, 3].reshape(_PLACES, n + 1, 3)
    J = p[:, 1:] - p[:, :1]
    J = J[np.isfinite(J).all(axis=(1, 2))]
    if not len(J):
        return most
    values = np.linalg.svd(J, compute_uv=False)
    ranks = (values > _RANK * values.max(initial=0)).sum(axis=1)
    return min(most, int(np.median(ranks)))


def _ranges(robot: Robot) -> Array:
    ranges = robot.mechanism.limits
    for joint, r in zip(robot.mechanism.active, ranges, strict=True):
        if not np.isfinite(r).all():
            if not joint.is_angle:
                raise TwinError(
                    f"{robot.name}: joint '{joint.name}' is prismatic and has no limits; add its [[limit]] to the CAD"
                )
            r[:] = -np.pi, np.pi
    return ranges


def _root(n: int) -> float:
    """Return the positive root x of x^(n + 1) = x + 1; evenly spread samples have the steps 1/x, 1/x^2, ..., 1/x^n."""
    x = 2.0
    for _ in range(60):
        x = (1 + x) ** (1 / (n + 1))
    return x


def _sampler(robot: Robot, ranges: Array, passive: PassiveCheck | None) -> Callable[[int, int], tuple[Array, Array]]:
    """Return a function of (first, last) that computes the samples with indices first to last - 1.

    The function returns the values (k, 4) of the samples, with the columns `measure.NAMES`, and the tool positions
    (k, 3) in m.
    """
    n = len(ranges)
    steps = _root(n) ** -np.arange(1, n + 1)

    def at(i: ca.SX) -> ca.SX:
        parts = [0.5 + i * s for s in steps]
        return ca.vertcat(*[lo + (hi - lo) * (x - ca.floor(x)) for x, (lo, hi) in zip(parts, ranges, strict=True)])

    if robot.name in robots.names() or (robot.files is not None and robot.files.has_equations):
        kin = robot.kinematics()
        if kin.closed_forward:
            bounds = shared_bounds(robot)
            kernel = measure.kernel(kin, ranges, at, bounds=bounds, passive=passive, from_joints=True)

            def by_equations(first: int, last: int) -> tuple[Array, Array]:
                *values, p = kernel(np.arange(first, last, dtype=np.float64)[None])
                return np.concatenate(values).T, p.T

            return by_equations
    loops, bounds = robot.loops, shared_bounds(robot)

    def by_mechanism(first: int, last: int) -> tuple[Array, Array]:
        x = 0.5 + np.arange(first, last)[:, None] * steps
        q = ranges[:, 0] + np.ptp(ranges, axis=1) * (x % 1)
        found = loops.forward_many(q)
        closed = np.isfinite(found.Ts_base_tool).all(axis=(1, 2))
        for bound in bounds:
            closed &= q @ bound.weights >= bound.least
        if passive is not None:
            closed &= passive.within(q, found.states)
        near = 2 * np.minimum(q - ranges[:, 0], ranges[:, 1] - q) / np.ptp(ranges, axis=1)
        values: Array = np.stack([closed.astype(float), 0 * found.offset, near.min(axis=1), found.margin], axis=1)
        return values, found.Ts_base_tool[:, :3, 3]

    return by_mechanism
