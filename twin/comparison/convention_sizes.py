"""By how much base and zeros of a solution differ, and which of them differ by more than the tolerance."""

from __future__ import annotations

import numpy as np

from twin.comparison.evidence import LIMIT_TOLERANCE
from twin.comparison.fit_problem import FitProblem
from twin.comparison.side import ONE_COORDINATE_KINDS
from twin.comparison.unknowns import Unknowns


def moved_zeros(problem: FitProblem, unknowns: Unknowns) -> list[int]:
    """Return the joints whose zeros differ by more than the tolerance."""
    moved_joints = []
    for joint, axis in enumerate(problem.axes):
        if axis.kind not in ONE_COORDINATE_KINDS:
            continue
        shift = zero_of(problem, unknowns, joint)
        limit = problem.angle_tolerance if axis.is_angle else problem.tolerance
        if abs(shift) > limit:
            moved_joints.append(joint)
    return moved_joints


def zero_of(problem: FitProblem, unknowns: Unknowns, joint: int) -> float:
    """Return by how much the zero of a joint differs in m or rad.

    An angle in -pi..pi, or that plus the full turns with which the limits of both sides are the same.
    """
    shift = float(unknowns.zeros[joint])
    axis = problem.axes[joint]
    if not axis.is_angle:
        return shift
    shift = float(np.arctan2(np.sin(shift), np.cos(shift)))  # into -pi..pi
    limits = axis.limits
    target = problem.second.axes[joint].limits
    if limits is None or target is None or not np.isfinite([*limits, *target]).all():
        return shift
    sign = float(unknowns.signs[joint])
    # q_first = sign * q_second + shift: with another sign, the lower limit becomes the upper one
    low, high = np.sort(sign * (np.array(limits) - shift))
    turns = round((target[0] - low) / (2 * np.pi))
    low_gap = abs(low + turns * 2 * np.pi - target[0])
    high_gap = abs(high + turns * 2 * np.pi - target[1])
    if max(low_gap, high_gap) > LIMIT_TOLERANCE:
        return shift
    return shift - sign * turns * 2 * np.pi


def is_base_moved(problem: FitProblem, unknowns: Unknowns) -> bool:
    """Return whether the base frames differ."""
    turn = float(np.linalg.norm(unknowns.base[:3]))
    shift = float(np.linalg.norm(unknowns.base[3:]))
    return shift > problem.tolerance or turn > problem.angle_tolerance
