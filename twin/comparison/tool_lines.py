"""What the frames of a last link and the joint lines before it have in common, whatever zeros and base are chosen.

The frames of one link have the same places in each other at every state, so has the line of the joint that carries
them, and so has the foot, on this line, of the common normal with the line before. They show, before a fit, that no
conventions make all frames of two links equal.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from twin.comparison.fit_problem import FitProblem
from twin.comparison.frame_gaps import carrier_of_groups
from twin.comparison.invariants import ACCURATE_FOOT_SINE, FOOT_TOLERANCE_FACTOR, TOLERANCE_FACTOR, common_normal
from twin.comparison.side import ONE_COORDINATE_KINDS, TURNING_KINDS
from twin.comparison.unknowns import JointDeviation
from twin.core import spatial
from twin.core.spatial import Array


def may_frames_agree(
    problem: FitProblem,
    joint: int,
    Ts_first: Array,
    Ts_second: Array,
    signs: Array,
    deviating: Collection[JointDeviation],
) -> bool:
    """Return whether some base frame and zeros may make the frames of a link equal in both sides, and all lines.

    `joint` carries the frames, whose T_base_frame (frames, 4, 4) of each side at its drawn state are `Ts_first` and
    `Ts_second`; `signs` (joints,) and `deviating` are those of `Unknowns`.
    """
    if not _have_same_places(problem, Ts_first, Ts_second):
        return False
    for T_first, T_second in zip(Ts_first, Ts_second, strict=True):
        is_possible = _may_line_agree(problem, joint, T_first, T_second, signs, deviating)
        if not is_possible:
            return False
    return True


def _have_same_places(problem: FitProblem, Ts_first: Array, Ts_second: Array) -> bool:
    """Return whether the frames have the same places in the first of them."""
    in_first = spatial.inverse(Ts_first[0]) @ Ts_first
    in_second = spatial.inverse(Ts_second[0]) @ Ts_second
    T_gap = spatial.inverse(in_second) @ in_first
    turn = float(spatial.rotation_angle(T_gap[:, :3, :3]).max())
    if turn > TOLERANCE_FACTOR * problem.angle_tolerance:
        return False
    reach = np.linalg.norm(in_second[:, :3, 3], axis=1)
    limits = TOLERANCE_FACTOR * (problem.tolerance + problem.angle_tolerance * reach)
    return bool(np.all(np.linalg.norm(T_gap[:, :3, 3], axis=1) <= limits))


def _may_line_agree(
    problem: FitProblem,
    joint: int,
    T_first: Array,
    T_second: Array,
    signs: Array,
    deviating: Collection[JointDeviation],
) -> bool:
    """Return whether a frame may be equal in both sides, as seen from the line of its joint and the line before."""
    if problem.kinds[joint] not in ONE_COORDINATE_KINDS or not problem.directed[joint]:
        return True
    if JointDeviation(joint, axis_only=True) in deviating:
        return True
    p_first, d_first = _line_in_tool(T_first, problem.points[joint], signs[joint] * problem.directions[joint])
    p_second, d_second = _line_in_tool(T_second, problem.target_points[joint], problem.target_directions[joint])
    angle = np.arctan2(np.linalg.norm(np.cross(d_first, d_second)), d_first @ d_second)
    if angle > TOLERANCE_FACTOR * problem.angle_tolerance:
        return False
    if problem.kinds[joint] not in TURNING_KINDS:
        return True
    reach = float(np.linalg.norm(p_first) + np.linalg.norm(p_second))
    distance = np.linalg.norm(np.cross(p_first - p_second, d_second))
    if distance > TOLERANCE_FACTOR * (problem.tolerance + problem.angle_tolerance * reach):
        return False
    return _do_feet_agree(problem, joint, T_first[:3, 3], T_second[:3, 3], float(signs[joint]), deviating)


def _line_in_tool(T_base_tool: Array, point: Array, direction: Array) -> tuple[Array, Array]:
    """Return point and direction of a line in the tool frame."""
    R_tool_base = T_base_tool[:3, :3].T
    return R_tool_base @ (point - T_base_tool[:3, 3]), R_tool_base @ direction


def _do_feet_agree(
    problem: FitProblem,
    joint: int,
    tool_first: Array,
    tool_second: Array,
    sign: float,
    deviating: Collection[JointDeviation],
) -> bool:
    """Return whether both tools are equally far along the line from the foot of the normal to the line before."""
    before = carrier_of_groups(problem).get(problem.axes[joint].parent)
    if before is None or problem.kinds[before] not in TURNING_KINDS:
        return True
    if JointDeviation(joint) in deviating or JointDeviation(before, axis_only=True) in deviating:
        return True
    pair = (before, joint)
    first, sine = common_normal(problem.points, problem.directions, pair, joint, turning=True)
    second, sine_second = common_normal(problem.target_points, problem.target_directions, pair, joint, turning=True)
    steep = min(sine, sine_second)
    if first is None or second is None or first.foot is None or second.foot is None or steep < ACCURATE_FOOT_SINE:
        return True
    along_first = sign * float(problem.directions[joint] @ tool_first - first.foot)
    along_second = float(problem.target_directions[joint] @ tool_second - second.foot)
    return abs(along_first - along_second) <= FOOT_TOLERANCE_FACTOR * problem.tolerance / steep**2
