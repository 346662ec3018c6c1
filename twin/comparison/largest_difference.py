"""The largest difference of the tool poses of two sides over their common range of joint values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.comparison.coupled_motion import followers_of
from twin.comparison.file_numbers import numbers
from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import FrameGap, leaf_frame_gaps
from twin.comparison.line_gaps import FitSolution
from twin.comparison.mapped_properties import mapped_limits
from twin.comparison.paths import relative_path
from twin.comparison.side import ONE_COORDINATE_KINDS, Axis, RobotSide, plain_name
from twin.comparison.unknowns import Unknowns, values_of, zero_columns
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.quantity import moved
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_STATE_COUNT = 2000
"""Number of joint states that are compared."""

_END_STATE_COUNT = _STATE_COUNT // 4
"""Number of further states in which each joint is at an end of its range."""

_SEED = 40
"""Seed of the joint states: the same files give the same differences."""

_ANGLE_WEIGHT = 1e-3
"""Distance in m that an angle of 1 rad counts: of equal distances, the larger angle is worse."""

_DEFAULT_HALF_ANGLE = np.pi
"""Half of the range in rad of a joint without limits."""

_DEFAULT_HALF_LENGTH = 0.1
"""Half of the range in m of a slide without limits."""


@dataclass(frozen=True)
class ToolDifference:
    """The largest difference of one frame.

    Attributes:
        frame: name of the frame in the second side.
        distance, angle: difference in m and rad at the worst state.
        q: {joint of the second side: value in m or rad} at that state.
        q_first: {joint of the first side: value} at the same state.
        states: number of compared states; 1 for robots with closed loops: the drawn state.
    """

    frame: str
    distance: float
    angle: float
    q: Mapping[str, float]
    q_first: Mapping[str, float]
    states: int

    def as_dict(self) -> JsonObject:
        """Return the difference as plain data, in mm and degrees; joint values in SI units."""
        return {
            "frame": self.frame,
            "distance_mm": self.distance / MM,
            "angle_deg": self.angle / DEG,
            "q": dict(self.q),
            "q_first": dict(self.q_first),
            "states": self.states,
        }


def common_range(problem: FitProblem, solution: FitSolution) -> Array:
    """Return the common range (joints, 2) of the joints in m or rad, as values of the second side.

    Raises:
        TwinError: the ranges of a joint do not overlap.
    """
    ranges = np.zeros((problem.count, 2))
    for i, axis in enumerate(problem.second.axes):
        if axis.kind not in ONE_COORDINATE_KINDS:
            continue
        limits_of_first = mapped_limits(problem, solution, i)
        low, high = _overlap(
            limits_of_first, axis.limits, _DEFAULT_HALF_ANGLE if axis.is_angle else _DEFAULT_HALF_LENGTH
        )
        if low > high:
            assert limits_of_first is not None
            assert axis.limits is not None
            in_first = _interval_text(limits_of_first, axis.is_angle)
            in_second = _interval_text(axis.limits, axis.is_angle)
            at_first = _limits_place_text(problem.first, problem.axes[i])
            at_second = _limits_place_text(problem.second, axis)
            raise TwinError(
                f"joint '{axis.name}' has no common range: {in_first} in {at_first} (as values of "
                f"{problem.second.label}), {in_second} in {at_second}. Correct the limits of a file."
            )
        ranges[i, 0] = low + 0.0  # without the sign of -0.0
        ranges[i, 1] = high + 0.0
    return ranges


def _overlap(first: tuple[float, float] | None, second: tuple[float, float] | None, half: float) -> tuple[float, float]:
    """Return what two ranges have in common; where neither ends, `half` of a range in m or rad from zero or the end.

    The first number is larger than the second if they do not overlap.
    """
    low = -half
    high = half
    if first is not None and second is not None:
        low = max(first[0], second[0])
        high = min(first[1], second[1])
    elif first is not None:
        low, high = first
    elif second is not None:
        low, high = second
    if not np.isfinite(low):
        low = min(-half, high - half)
    if not np.isfinite(high):
        high = max(half, low + half)
    return low, high


def _interval_text(limits: tuple[float, float], is_angle: bool) -> str:
    """Return a range in m or rad as text."""
    return f"{moved(limits[0], is_angle)} .. {moved(limits[1], is_angle)}"


def _limits_place_text(side: RobotSide, axis: Axis) -> str:
    """Return the label of a side, with file and line of the limits of a joint where they are known."""
    if side.dh_rows:  # the numbers of a table have no names
        return side.label
    for number in numbers(side, {plain_name(axis.name)}, "limits"):
        if "soft" in number.what or "safety" in number.what:
            continue
        return f"{side.label} ({relative_path(number.file or str(side.path))}:{number.line})"
    return side.label


def largest_difference(problem: FitProblem, solution: FitSolution) -> ToolDifference | None:
    """Return the largest difference of the tool frames without the deviations of the solution; None without a tool."""
    tools = leaf_frame_gaps(problem, solution.unknowns)
    if not tools:
        return None
    unknowns = solution.unknowns
    undeviated = replace(unknowns, deviating=(), deviations=None)
    if problem.first.has_loops:
        states = problem.target_drawn[None]
    else:
        states = _states(problem, common_range(problem, solution))
    largest = None
    for tool in tools:
        candidate = _difference_of(problem, undeviated, tool, states)
        if largest is None or (candidate.distance, candidate.angle) > (largest.distance, largest.angle):
            largest = candidate
    return largest


def _states(problem: FitProblem, ranges: Array) -> Array:
    """Return states (k, joints) of the second side in ranges (joints, 2) that its couplings allow."""
    rng = np.random.default_rng(_SEED)
    states = rng.uniform(ranges[:, 0], ranges[:, 1], (_STATE_COUNT, problem.count))
    # the ends of the ranges are where long arms differ most
    is_upper = rng.integers(0, 2, (_END_STATE_COUNT, problem.count)) == 1
    ends = np.where(is_upper, ranges[:, 1], ranges[:, 0])
    states = np.vstack([states, ends])
    for i, (ratios, offset) in followers_of(problem.second).items():
        states[:, i] = states @ ratios + offset
    return states


def _difference_of(problem: FitProblem, unknowns: Unknowns, tool: FrameGap, states: Array) -> ToolDifference:
    """Return the largest difference of a tool at states (k, joints) of the second side, without deviations."""
    group, T_first = problem.first.frames.get(tool.name, problem.first.frames[problem.first.tool])
    group_of_second, T_second = problem.second.frames[tool.name]
    # at the full solution, the tool of the second side is that of the first times Y
    T_tool = T_first @ spatial.inverse(tool.T)
    # the zeros are the only unknowns of `motions` that move joints: each state is a change of them
    values = np.repeat(values_of(unknowns)[None], len(states), axis=0)
    values[:, zero_columns(problem.count)] += unknowns.signs * (states - problem.target_drawn)
    _, _, motions = problem.motions(unknowns.signs, values, ())
    first = motions[:, group] @ T_tool
    tree = []
    for i, axis in enumerate(problem.second.axes):
        if not axis.closes_loop:
            tree.append(i)
    second = problem.second.group_motions((states - problem.target_drawn)[:, tree])[:, group_of_second] @ T_second
    distances = np.linalg.norm(first[:, :3, 3] - second[:, :3, 3], axis=1)
    angles = spatial.rotation_angle(np.swapaxes(first[:, :3, :3], 1, 2) @ second[:, :3, :3])
    worst_state = int(np.argmax(distances + _ANGLE_WEIGHT * angles))
    q = dict(zip(problem.second.joint_names, states[worst_state].tolist(), strict=True))
    names_of_first = [axis.name for axis in problem.axes]
    # the same posture in the conventions of the first side
    values_of_first = unknowns.signs * states[worst_state] + unknowns.zeros
    q_first = dict(zip(names_of_first, values_of_first.tolist(), strict=True))
    return ToolDifference(tool.name, float(distances[worst_state]), float(angles[worst_state]), q, q_first, len(states))
