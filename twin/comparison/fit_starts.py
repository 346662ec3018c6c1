"""The best fit for given signs and deviating joints, from start values in closed form.

Along the tree, the displacement of each joint brings the lines of the joints on its child nearest to their targets.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.comparison.fit_problem import FitProblem, cross
from twin.comparison.line_gaps import FitSolution, lines_coincide
from twin.comparison.refinement import refine
from twin.comparison.side import ONE_COORDINATE_KINDS, TURNING_KINDS
from twin.comparison.unknowns import JointDeviation, Unknowns
from twin.core import spatial
from twin.core.spatial import Array

_SMALLEST_AMPLITUDE = 1e-7
"""Amplitude of a cost below which an angle or a shift does not change it."""

_SAME_DIRECTION_SINE = 1e-12
"""Sine of the angle of two directions below which they are the same or opposite."""

_SAME_LINE = 1e-6
"""Sine of an angle, or distance in m, below which two lines are parallel, or the same."""


def fit_from_starts(problem: FitProblem, signs: Array, deviating: tuple[JointDeviation, ...] = ()) -> FitSolution:
    """Return the best fit with these signs (joints,) and deviating joints, from two starts."""
    best: FitSolution | None = None
    # the base as it is comes first: descriptions of one robot mostly have the same one
    for aligned in (False, True):
        if aligned and best is not None and lines_coincide(problem, best.gap):
            break
        start = _start_values(problem, signs, deviating, aligned)
        if start is None:
            continue
        solution = refine(problem, start)
        if best is None or solution.gap.size < best.gap.size:
            best = solution
    assert best is not None
    return best


def _start_values(
    problem: FitProblem, signs: Array, deviating: tuple[JointDeviation, ...], aligned: bool
) -> Unknowns | None:
    """Return start values: the base as it is or aligned with the first lines, then each joint from its children."""
    X = np.eye(4)
    if aligned:
        aligned_base = _aligned_base(problem, signs, deviating)
        if aligned_base is None:
            return None
        X = aligned_base
    groups: dict[int, Array] = {0: X}
    neutral = problem.displacements(signs, np.zeros(problem.count))
    displacements = neutral.copy()
    deviations = np.zeros((len(deviating), 6))
    for i in problem.order:
        axis = problem.axes[i]
        if axis.closes_loop:  # the joints of the tree already place both of its links
            continue
        parent = groups[axis.parent]
        place = JointDeviation(i)
        if place in deviating:
            parent, values = _placed_on_target(problem, i, parent, signs)
            deviations[deviating.index(place)] = values
        turned_axis = JointDeviation(i, axis_only=True)
        if turned_axis in deviating:
            _, values = _placed_on_target(problem, i, parent, signs)
            deviations[deviating.index(turned_axis), :3] = values[:3]
            groups[axis.child] = parent  # the axis alone is turned: the links behind it stay
            continue
        displacements[i] = _displacement(problem, i, parent, signs, deviating, float(neutral[i]))
        groups[axis.child] = parent @ problem.joint_motions(displacements)[i]
    base = np.concatenate([spatial.log_so3(X[:3, :3]), X[:3, 3]])
    return Unknowns(signs, base, problem.zeros_of(signs, displacements), deviating, deviations)


def _deviates(joint: int, deviating: Sequence[JointDeviation]) -> bool:
    """Return whether the place or the axis of a joint deviates."""
    return any(deviation.joint == joint for deviation in deviating)


def _aligned_base(problem: FitProblem, signs: Array, deviating: tuple[JointDeviation, ...]) -> Array | None:
    """Return the base transform (4, 4) that maps the lines of the first two joints in a chain to their targets.

    None if no two joints determine it.
    """
    for i in problem.order:
        axis = problem.axes[i]
        if _deviates(i, deviating) or axis.kind == "spherical":
            continue
        for k in (*problem.below[i], *problem.order):
            if k == i or _deviates(k, deviating):
                continue
            if problem.axes[k].parent not in (0, axis.child):
                continue
            directions = signs[:, None] * problem.directions
            first = _pair_frame(problem.points[i], directions[i], problem.points[k], directions[k])
            target = _pair_frame(
                problem.target_points[i],
                problem.target_directions[i],
                problem.target_points[k],
                problem.target_directions[k],
            )
            if first is not None and target is not None:
                return target @ spatial.inverse(first)
    return None


def _placed_on_target(problem: FitProblem, joint: int, parent: Array, signs: Array) -> tuple[Array, Array]:
    """Return (motion of the parent with the deviation, deviation (6,)) that puts line i on its target."""
    kind = problem.kinds[joint]
    point, direction = problem.line(parent, joint, signs)
    target = problem.target_directions[joint]
    turn = _smallest_rotation(direction, target)
    if kind == "spherical":  # a ball is a point without a direction
        turn = np.zeros(3)
    # to the nearest point of the target line
    to_line = problem.target_points[joint] - point
    shift = to_line - target * (to_line @ target)
    if kind == "spherical":
        shift = to_line
    if kind == "prismatic":  # only the direction of a slide counts, wherever its line is
        shift = np.zeros(3)
    R = spatial.exp_so3(turn)
    placed = spatial.pose(R, point - R @ point + shift) @ parent
    local = spatial.inverse(parent) @ placed
    frame = problem.frames[joint]
    rotation = frame.T @ spatial.log_so3(local[:3, :3])
    own_point = problem.points[joint]
    shift_in_frame = frame.T @ (local[:3, :3] @ own_point + local[:3, 3] - own_point)
    return placed, np.concatenate([rotation, shift_in_frame])


def _displacement(
    problem: FitProblem, joint: int, parent: Array, signs: Array, deviating: tuple[JointDeviation, ...], neutral: float
) -> float:
    """Return the displacement of joint i in m or rad that best puts the lines of the joints on its child in place.

    `parent` (4, 4) is the motion of its parent; `neutral` is returned if no line behind the joint determines it.
    """
    kind = problem.kinds[joint]
    if kind not in ONE_COORDINATE_KINDS:
        return neutral
    axis = parent[:3, :3] @ problem.directions[joint]
    below = problem.below[joint]
    while below:
        # a joint with a free place says nothing about where the joint above it stands
        children = []
        for k in below:
            if not _deviates(k, deviating):
                children.append(k)
        if kind == "prismatic":
            displacement = _best_shift(problem, parent, axis, children)
        else:
            displacement = _best_angle(problem, joint, parent, axis, children, signs)
        if displacement is not None:
            return displacement
        # no line of these joints changes, as behind a slide along the same axis: those behind them may
        further: list[int] = []
        for child in children:
            further += problem.below[child]
        below = further
    return neutral


def _best_angle(
    problem: FitProblem, joint: int, T: Array, axis: Array, children: Sequence[int], signs: Array
) -> float | None:
    """Return the angle about `axis` that brings the lines of the children nearest to their targets, or None."""
    centre = T[:3, :3] @ problem.points[joint] + T[:3, 3]
    # cost of the angle: constant - cosine_part cos - sine_part sin, for directions, and for moments about the axis
    cosine_part = 0.0
    sine_part = 0.0
    for k in children:
        point, direction = problem.line(T, k, signs)
        target_direction = problem.target_directions[k]
        vectors: list[tuple[Array, Array]] = []
        if problem.kinds[k] != "spherical":
            vectors.append((direction, target_direction))
        if problem.kinds[k] in TURNING_KINDS:
            moment = cross(point - centre, direction)
            target_moment = cross(problem.target_points[k] - centre, target_direction)
            vectors.append((moment, target_moment))
        if problem.kinds[k] == "spherical":
            vectors.append((point - centre, problem.target_points[k] - centre))
        for vector, target in vectors:
            across = vector - axis * (axis @ vector)
            cosine_part += float(across @ target)
            sine_part += float(cross(axis, across) @ target)
    if np.hypot(cosine_part, sine_part) < _SMALLEST_AMPLITUDE:
        return None
    return float(np.arctan2(sine_part, cosine_part))


def _best_shift(problem: FitProblem, T: Array, axis: Array, children: Sequence[int]) -> float | None:
    """Return the displacement along `axis` that brings the lines of the children nearest to their targets, or None."""
    # cost of the displacement s: square_part s^2 - 2 linear_part s + constant
    square_part = 0.0
    linear_part = 0.0
    for k in children:
        # the direction of a slide, all that it has, is the same after a shift
        if problem.kinds[k] not in TURNING_KINDS and problem.kinds[k] != "spherical":
            continue
        point = T[:3, :3] @ problem.points[k] + T[:3, 3]
        to_target = problem.target_points[k] - point
        direction = problem.target_directions[k]
        along = cross(axis, direction)
        needed = cross(to_target, direction)
        if problem.kinds[k] == "spherical":
            along = axis
            needed = to_target
        square_part += float(along @ along)
        linear_part += float(along @ needed)
    if square_part < _SMALLEST_AMPLITUDE:
        return None
    return linear_part / square_part


def _smallest_rotation(direction: Array, target: Array) -> Array:
    """Return the rotation vector (3,) of the smallest rotation from one unit vector to another."""
    normal = cross(direction, target)
    sine = float(np.linalg.norm(normal))
    cosine = float(direction @ target)
    if sine < _SAME_DIRECTION_SINE:
        if cosine > 0:
            return np.zeros(3)
        # half a turn, about any axis across
        across = spatial.unit_across(direction)
        across = across - direction * (direction @ across)
        return np.pi * across / np.linalg.norm(across)
    return np.arctan2(sine, cosine) * normal / sine


def _pair_frame(p_first: Array, d_first: Array, p_second: Array, d_second: Array) -> Array | None:
    """Return a frame (4, 4) fixed to two lines, each by a point and a direction; None if they are the same line."""
    normal = cross(d_first, d_second)
    sine = np.linalg.norm(normal)
    between = p_second - p_first
    if sine > _SAME_LINE:
        # foot of the common normal on the first line
        along = cross(d_second, normal) @ between / sine**2
        return spatial.pose(spatial.frame_from_axes(d_first, normal), p_first + along * d_first)
    across = between - d_first * (d_first @ between)
    if np.linalg.norm(across) < _SAME_LINE:
        return None
    return spatial.pose(spatial.frame_from_axes(d_first, across), p_first)
