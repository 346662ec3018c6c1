"""The largest difference of the tool poses of two sides over their common range of joint values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.comparison.fit import FitSolution, Problem, Unknowns, values_of
from twin.comparison.frames import FrameGap, leaf_gaps
from twin.comparison.paths import short
from twin.comparison.properties import followed_of, mapped_limits
from twin.comparison.rereading import numbers
from twin.comparison.side import ONE_COORDINATE, Axis, RobotSide, plain
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.quantity import moved
from twin.core.spatial import Array
from twin.core.units import DEG, MM

_SAMPLES = 2000
"""Number of joint states that are compared."""

_SEED = 40

_TURN = np.pi
"""Half of the range in rad of a joint without limits."""

_SLIDE = 0.1
"""Half of the range in m of a slide without limits."""


@dataclass(frozen=True)
class Worst:
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


def common_range(problem: Problem, solution: FitSolution) -> Array:
    """Return the common range (joints, 2) of the joints in m or rad, as values of the second side.

    Raises:
        TwinError: the ranges of a joint do not overlap.
    """
    ranges = np.zeros((problem.count, 2))
    for i, axis in enumerate(problem.second.axes):
        if axis.kind not in ONE_COORDINATE:
            continue
        half = _TURN if axis.is_angle else _SLIDE
        low = -half
        high = half
        stated = [limits for limits in (mapped_limits(problem, solution, i), axis.limits) if limits is not None]
        if stated:
            lows = [limits[0] for limits in stated]
            highs = [limits[1] for limits in stated]
            low = max(lows)
            high = min(highs)
            low = low if np.isfinite(low) else min(-half, high - half)
            high = high if np.isfinite(high) else max(half, low + half)
        if low > high:
            texts = [f"{moved(a, axis.is_angle)} .. {moved(b, axis.is_angle)}" for a, b in stated]
            at_first = _stated_at(problem.first, problem.axes[i])
            at_second = _stated_at(problem.second, axis)
            raise TwinError(
                f"joint '{axis.name}' has no common range: {texts[0]} in {at_first} (as values of "
                f"{problem.second.label}), {texts[1]} in {at_second}. Correct the limits of a file."
            )
        ranges[i] = low + 0.0, high + 0.0  # without the sign of -0.0
    return ranges


def _stated_at(side: RobotSide, axis: Axis) -> str:
    """Return the label of a side, with file and line of the limits of a joint where they are known."""
    if side.rows:  # the numbers of a table have no names
        return side.label
    for number in numbers(side, {plain(axis.name)}, "limits"):
        if "soft" in number.what or "safety" in number.what:
            continue
        return f"{side.label} ({short(number.file or str(side.path))}:{number.line})"
    return side.label


def worst(problem: Problem, solution: FitSolution) -> Worst | None:
    """Return the largest difference of the tool frames without the deviations of the solution; None without a tool."""
    tools = leaf_gaps(problem, solution.unknowns)
    if not tools:
        return None
    u = solution.unknowns
    plain = replace(u, deviating=(), deviations=None)
    if problem.first.looped:
        states = problem.target_drawn[None]
    else:
        states = _states(problem, common_range(problem, solution))
    largest = None
    for tool in tools:
        candidate = _worst_of(problem, u, plain, tool, states)
        if largest is None or (candidate.distance, candidate.angle) > (largest.distance, largest.angle):
            largest = candidate
    return largest


def _states(problem: Problem, ranges: Array) -> Array:
    rng = np.random.default_rng(_SEED)
    states = rng.uniform(ranges[:, 0], ranges[:, 1], (_SAMPLES, problem.count))
    # the ends of the ranges are where long arms differ most
    corners = rng.integers(0, 2, (_SAMPLES // 4, problem.count))
    ends = np.where(corners == 1, ranges[:, 1], ranges[:, 0])
    states = np.vstack([states, ends])
    for i, (ratios, offset) in followed_of(problem.second).items():
        states[:, i] = states @ ratios + offset
    return states


def _worst_of(problem: Problem, u: Unknowns, plain: Unknowns, tool: FrameGap, states: Array) -> Worst:
    group, T_first = problem.first.frames.get(tool.name, problem.first.frames[problem.first.tool])
    group_of_second, T_second = problem.second.frames[tool.name]
    # at the full solution, the tool of the second side is that of the first times Y
    T_tool = T_first @ spatial.inverse(tool.T)
    values = np.repeat(values_of(plain)[None], len(states), axis=0)
    zeros = values[:, 6 : 6 + problem.count]
    displaced = u.signs * (states - problem.target_drawn)
    values[:, 6 : 6 + problem.count] = zeros + displaced
    _, _, motions = problem.motions(u.signs, values, ())
    first = motions[:, group] @ T_tool
    tree = [i for i, axis in enumerate(problem.second.axes) if not axis.closing]
    second = problem.second.poses((states - problem.target_drawn)[:, tree])[:, group_of_second] @ T_second
    distances = np.linalg.norm(first[:, :3, 3] - second[:, :3, 3], axis=1)
    angles = spatial.rotation_angle(np.swapaxes(first[:, :3, :3], 1, 2) @ second[:, :3, :3])
    k = int(np.argmax(distances + 1e-3 * angles))
    q = {axis.name: float(states[k, i]) for i, axis in enumerate(problem.second.axes)}
    mapped = u.signs * states[k] + u.zeros
    q_first = {axis.name: float(mapped[i]) for i, axis in enumerate(problem.axes)}
    return Worst(tool.name, float(distances[k]), float(angles[k]), q, q_first, len(states))
