"""What a path is judged by, enclosed on every cell of time: limits, speeds, RCM, gaps and determinant.

Each value is a Taylor model on a cell; its range is proved, with the rounding of what computes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof.motion import value_groups as groups
from twin.proof.motion.closure import ClosedLinkage
from twin.proof.motion.enclosure import Enclosure
from twin.proof.motion.linkage import Linkage, PlacedFrame
from twin.proof.motion.loop_determinant import log_determinant, start_log_determinant
from twin.proof.motion.path import TimedPath
from twin.proof.motion.rates import rates
from twin.proof.motion.taylor import TaylorModel, cross
from twin.proof.motion.time_cells import TimeCells
from twin.proof.rigid_frame import rigid_frame
from twin.proof.rounding import UNIT_ROUNDOFF

_AXIS_ERROR = 1e-12
"""Bound of the relative difference of the length of a shaft's axis from 1."""

_SCALE_ERROR = 1e-15
"""Bound of the relative rounding error of a speed that is divided by its limit."""

_LARGEST_DEFECT = 0.5
"""Largest norm of 1 - M X with which the rounding of the inverse X of a motor matrix M is bounded; below 1."""

_FUNCTION_ERROR = 4e-15
"""Bound of the error of NumPy's inverse functions for angles within a turn, in rad."""

_QUOTIENT_ERROR = 8 * _FUNCTION_ERROR
"""Bound in rad of the error of the arc tangent of a rounded quotient of sine and cosine, added to the middle angle."""

_ROOT_ERROR = 4 * UNIT_ROUNDOFF
"""Bound of the relative error of a rounded square root."""

_INVERSE_MARGIN = 1.0 + 1e-9
"""Factor that exceeds the rounding of the bound of an inverse matrix."""


def enclosures(
    linkage: Linkage, path: TimedPath, cells: TimeCells, q: TaylorModel, slopes: TaylorModel, closed: ClosedLinkage
) -> Iterator[Enclosure]:
    """Yield every value of a path on its cells.

    Args:
        linkage: the mechanism.
        path: the path.
        cells: M cells of N pieces.
        q: (N, n) driven coordinates.
        slopes: (N, n) their derivatives with respect to s.
        closed: the mechanism on the pieces.
    """
    yield from _driven_values(linkage, path, cells, q, slopes)
    is_closed = closed.closed[cells.piece]
    for enclosure in _mechanism_values(linkage, path, cells, slopes, closed):
        low = np.where(is_closed, enclosure.low, -np.inf)
        high = np.where(is_closed, enclosure.high, np.inf)
        yield replace(enclosure, low=low, high=high)


# ------------------------------------------------------------------------------------------- driven joints


def _driven_values(
    linkage: Linkage, path: TimedPath, cells: TimeCells, q: TaylorModel, slopes: TaylorModel
) -> Iterator[Enclosure]:
    """Yield limits and speeds of driven joints and motors, and gaps between carriages."""
    mechanism = linkage.mechanism
    values = cells.of(q)
    rate = cells.of(slopes)
    for j, joint in enumerate(mechanism.active):
        unit = "rad" if joint.is_angle else "m"
        if joint.limits is not None and np.isfinite(joint.limits).any():
            yield _margin(joint.name, groups.JOINT_LIMIT, unit, values[:, j].range(), joint.limits)
        low, high = _speed(rate[:, j], cells)
        limit = _or_infinite(joint.max_speed)
        yield Enclosure(joint.name, groups.JOINT_SPEED, f"{unit}/s", low, high, limit, smallest=False)
    rows, row_errors = _motor_rows(mechanism)
    actuators = {actuator.name: actuator for actuator in mechanism.actuators}
    for row, row_error, name in zip(rows, row_errors, mechanism.motor_names, strict=True):
        if name not in actuators:
            continue
        actuator = actuators[name]
        unit = "rad" if actuator.is_angle else "m"
        if actuator.limits is not None:
            motor = (values @ row[:, None])[:, 0].widened(values.sizes() @ row_error)
            yield _margin(name, groups.MOTOR_LIMIT, unit, motor.range(), actuator.limits)
        motor_rate = (rate @ row[:, None])[:, 0].widened(rate.sizes() @ row_error)
        low, high = _speed(motor_rate, cells)
        limit = _or_infinite(actuator.max_speed)
        yield Enclosure(name, groups.MOTOR_SPEED, f"{unit}/s", low, high, limit, smallest=False)
    for gap in path.gaps:
        low, high = _absolute((values[:, gap.first] - values[:, gap.second]).range())
        yield Enclosure(gap.name, groups.GAP, "m", low, high, gap.smallest, smallest=True)


def _or_infinite(limit: float | None) -> float:
    """Return a limit; infinity if there is none."""
    if limit is None:
        return np.inf
    return limit


def _motor_rows(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return (rows (n, n) from joint to motor coordinates, bounds (n, n) of their rounding).

    The rows X are the inverse of the motor matrix M but for rounding: with E = 1 - M X and |E| < 1, the inverse differs
    from X by X E + X E^2 + ..., at most |X| |E| / (1 - |E|) in the norm of the largest sum of a row.
    """
    M = mechanism.motor_matrix
    X = mechanism.motors(np.eye(len(M))).T
    if np.array_equal(M, np.eye(len(M))):
        return X, np.zeros_like(X)
    # a sum of n products has n roundings of its terms and sums; doubled, with room for the difference from 1
    roundings = 2 * (len(M) + 4)
    rounding = roundings * UNIT_ROUNDOFF * (np.abs(M) @ np.abs(X) + np.eye(len(M)))
    E = np.abs(np.eye(len(M)) - M @ X) + rounding
    norm = float(E.sum(axis=1).max())
    if not norm < _LARGEST_DEFECT:
        return X, np.full_like(X, np.inf)
    # |X| |E|, and the terms after it are at most the norms of X and E^2 / (1 - E)
    further_terms = float(np.abs(X).sum(axis=1).max()) * norm**2 / (1.0 - norm)
    return X, (np.abs(X) @ E + further_terms) * _INVERSE_MARGIN


def _margin(name: str, group: str, unit: str, bounds: tuple[Array, Array], limits: tuple[float, float]) -> Enclosure:
    """Return the distance of a value from the nearer limit."""
    low, high = bounds
    lower, upper = limits
    smallest = np.minimum(low - lower, upper - high)
    largest = np.minimum(high - lower, upper - low)
    # one subtraction is rounded
    spread = 2 * UNIT_ROUNDOFF * (np.abs(smallest) + np.abs(low) + np.abs(high))
    return Enclosure(name, group, unit, smallest - spread, largest + spread, 0.0, smallest=True)


def _speed(slope: TaylorModel, cells: TimeCells) -> tuple[Array, Array]:
    """Return bounds (M,) of |dq/dt| from models of dq/ds."""
    return _root((slope * slope * cells.square).range())


def _root(bounds: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return bounds of the root of a value that is not negative."""
    low = np.sqrt(np.maximum(bounds[0], 0.0)) * (1.0 - _ROOT_ERROR)
    high = np.sqrt(np.maximum(bounds[1], 0.0)) * (1.0 + _ROOT_ERROR)
    return low, high


def _absolute(bounds: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return bounds of the absolute value of a value with these bounds."""
    low, high = bounds
    smallest = np.maximum(np.maximum(low, -high), 0.0)
    return smallest, np.maximum(np.abs(low), np.abs(high))


# ------------------------------------------------------------------------------------------- the mechanism


def _mechanism_values(
    linkage: Linkage, path: TimedPath, cells: TimeCells, slopes: TaylorModel, closed: ClosedLinkage
) -> Iterator[Enclosure]:
    """Yield limits of passive joints, distance from the RCM, speeds of the tool, gaps and determinant of the loops."""
    mechanism = linkage.mechanism
    for joint in mechanism.limited:
        yield from _passive_limits(linkage, cells, closed, joint)
    tool = mechanism.frame(mechanism.tool)
    in_tool = rigid_frame(path.T_tool_frame, f"{path.protocol}: pose of the moved frame")
    tool_frame = closed.placed.frames[tool.body].then(linkage.tool).then(in_tool)
    yield from _rcm_distances(path, cells, tool_frame)
    yield from _tool_speeds(linkage, path, cells, slopes, closed, tool_frame)
    if linkage.closes:
        gap = closed.gap[cells.piece]
        yield Enclosure(groups.LOOPS, groups.LOOP_GAP, "m", 0.0 * gap, gap, np.inf, smallest=False)
    determinant = log_determinant(closed)
    if determinant is not None:
        logs, error = determinant
        lowest_start, highest_start = start_log_determinant(logs, error)
        low, high = cells.of(logs).range()
        error = error[cells.piece]
        ratio_low = low - error - highest_start
        ratio_high = high + error - lowest_start
        yield Enclosure(groups.LOOPS, groups.DETERMINANT, "1", ratio_low, ratio_high, -np.inf, smallest=True)


def _passive_limits(linkage: Linkage, cells: TimeCells, closed: ClosedLinkage, joint: Joint) -> Iterator[Enclosure]:
    """Yield the distances of a passive joint from its limits and its cone."""
    name = joint.name
    spanning = [tree_joint.name for tree_joint in linkage.mechanism.tree]
    _, _, offset, R = linkage.relative(closed.placed, joint)
    if joint.cone is not None:
        low, high = cells.of(R[:, 2, 2]).range()
        largest = np.arccos(np.clip(low, -1.0, 1.0)) + _FUNCTION_ERROR
        smallest = np.arccos(np.clip(high, -1.0, 1.0)) - _FUNCTION_ERROR
        # the cosine of a rotation that is rounded may be 1 and a little more
        yield Enclosure(
            name, groups.PASSIVE_LIMIT, "rad", joint.cone - largest, joint.cone - smallest, 0.0, smallest=True
        )
    if joint.limits is None or len(joint.free_axes) != 1:
        return
    if joint.type == "prismatic":
        yield _margin(name, groups.PASSIVE_LIMIT, "m", cells.of(offset[:, 2]).range(), joint.limits)
        return
    if name in spanning:
        coordinate = closed.coordinates[:, linkage.index(joint.name)]
        yield _margin(name, groups.PASSIVE_LIMIT, "rad", cells.of(coordinate).range(), joint.limits)
        return
    yield _margin(name, groups.PASSIVE_LIMIT, "rad", _angle_of_rotation(joint, cells, R), joint.limits)


def _angle_of_rotation(joint: Joint, cells: TimeCells, R: TaylorModel) -> tuple[Array, Array]:
    """Return bounds (M,) of the angle about z of rotations R (N, 3, 3), within half a turn of the joint's limits."""
    on_cells = cells.of(R)
    middle = np.asarray(joint.angle(_as_poses(on_cells.c[0])), float)
    # sine and cosine of the difference from the angle in the middle of the cell
    sine_middle = np.sin(middle)
    cosine_middle = np.cos(middle)
    sine = (on_cells[:, 1, 0] - on_cells[:, 0, 1]) * 0.5
    cosine = (on_cells[:, 0, 0] + on_cells[:, 1, 1]) * 0.5
    across = sine * cosine_middle - cosine * sine_middle
    along = cosine * cosine_middle + sine * sine_middle
    low, high = across.range()
    nearest, farthest = along.range()
    with np.errstate(divide="ignore", invalid="ignore"):
        lower = np.arctan(np.minimum(low / nearest, low / farthest)) - _QUOTIENT_ERROR
        upper = np.arctan(np.maximum(high / nearest, high / farthest)) + _QUOTIENT_ERROR
    is_bounded = nearest > 0
    return np.where(is_bounded, middle + lower, -np.inf), np.where(is_bounded, middle + upper, np.inf)


def _as_poses(R: Array) -> Array:
    """Return poses (k, 4, 4) with rotations (k, 3, 3)."""
    return spatial.pose(R, np.zeros((len(R), 3)))


def _rcm_distances(path: TimedPath, cells: TimeCells, tool_frame: PlacedFrame) -> Iterator[Enclosure]:
    """Yield the distance of the shaft from the RCM, separately where it is enforced and where it is monitored."""
    axis = cells.of((tool_frame.R @ path.shaft_axis[:, None])[..., 0])
    tip = cells.of(tool_frame.p)
    for enforced in (True, False):
        with_rcm = np.zeros(len(cells.phase), bool)
        places = np.zeros((len(cells.phase), 3))
        for k, phase in enumerate(path.phases):
            if phase.rcm is None or phase.enforced != enforced:
                continue
            in_phase = cells.phase == k
            with_rcm |= in_phase
            places[in_phase] = phase.rcm
        if not with_rcm.any():
            continue
        distance = cross(tip - places, axis)
        low, high = _root((distance * distance).total().range())
        # the axis is a unit vector but for rounding
        low = np.where(with_rcm, low * (1.0 - _AXIS_ERROR), -np.inf)
        high = np.where(with_rcm, high * (1.0 + _AXIS_ERROR), -np.inf)
        name = groups.ENFORCED if enforced else groups.MONITORED
        yield Enclosure(name, groups.RCM, "m", low, high, path.rcm_tolerance, smallest=False)


def _tool_speeds(
    linkage: Linkage,
    path: TimedPath,
    cells: TimeCells,
    slopes: TaylorModel,
    closed: ClosedLinkage,
    tool_frame: PlacedFrame,
) -> Iterator[Enclosure]:
    """Yield the speeds of the moved frame, as fractions of the limits of their phases."""
    body = linkage.mechanism.frame(linkage.mechanism.tool).body
    velocity, turning = linkage.twist(closed.placed, body, tool_frame.p, rates(closed, linkage, slopes))
    tip_limits = np.array([phase.tip_speed for phase in path.phases])
    rotation_limits = np.array([phase.rotation_speed for phase in path.phases])
    for name, vector, limits in ((groups.TIP, velocity, tip_limits), (groups.ROTATION, turning, rotation_limits)):
        scale = 1.0 / limits[cells.phase]
        on_cells = cells.of(vector)
        low, high = _root(((on_cells * on_cells).total() * cells.square).range())
        yield Enclosure(
            name,
            groups.TOOL_SPEED,
            "1",
            low * scale * (1.0 - _SCALE_ERROR),
            high * scale * (1.0 + _SCALE_ERROR),
            1.0,
            smallest=False,
        )
