"""What given unknowns leave between the joint lines of two sides: as residuals, and as distances and angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.comparison.fit_problem import FitProblem, cross, turned_towards
from twin.comparison.side import TURNING_KINDS
from twin.comparison.unknowns import Unknowns, values_of
from twin.core import spatial
from twin.core.spatial import Array


@dataclass(frozen=True)
class FitGap:
    """What remains between the joint lines of both sides: (joints,) distances in m and angles in rad."""

    distances: Array
    angles: Array

    @property
    def size(self) -> float:
        """Sum of all distances in m and angles in rad."""
        return float(np.sum(self.distances) + np.sum(self.angles))


@dataclass(frozen=True)
class FitSolution:
    """Unknowns after a fit, and what they leave between the lines; `lines_coincide` tells whether that is nothing."""

    unknowns: Unknowns
    gap: FitGap


def line_residuals(problem: FitProblem, signs: Array, parents: Array, children: Array) -> Array:
    """Return the residuals (k, rows) in m and rad for motions (k, joints, 4, 4) as in `FitProblem.motions`."""
    R = parents[:, :, :3, :3]
    points = np.squeeze(R @ problem.points[..., None], -1) + parents[:, :, :3, 3]
    directions = signs[:, None] * np.squeeze(R @ problem.directions[..., None], -1)
    for i, directed in enumerate(problem.directed):
        if not directed:
            directions[:, i] = turned_towards(directions[:, i], problem.target_directions[i])
    to_lines = points - problem.target_points
    tilts = (directions - problem.target_directions)[:, problem.with_direction]
    moments = cross(to_lines[:, problem.with_place], problem.target_directions[problem.with_place])
    shifts = to_lines[:, problem.with_centre]
    rows = []
    for residuals in (tilts, moments, shifts):
        rows.append(residuals.reshape(len(parents), -1))
    for i, axis in enumerate(problem.axes):
        if axis.closes_loop:
            # the tree does not bring the child of such a joint to its parent: both must be on the line
            rows += _closing_rows(problem, i, parents[:, i], children[:, i], signs)
    return np.concatenate(rows, axis=1)


def _closing_rows(problem: FitProblem, joint: int, parent: Array, child: Array, signs: Array) -> list[Array]:
    """Return the rows of a joint that closes a loop: its line on the child coincides with that on the parent."""
    kind = problem.kinds[joint]
    point_on_parent, direction_on_parent = problem.line(parent, joint, signs)
    point_on_child, direction_on_child = problem.line(child, joint, signs)
    offset = point_on_child - point_on_parent
    target = problem.target_directions[joint]
    if kind == "spherical":
        return [offset]
    if kind == "revolute":
        return [direction_on_child - direction_on_parent, offset]
    if kind == "cylindrical":
        return [direction_on_child - direction_on_parent, offset @ spatial.hat(target)]
    if kind == "prismatic":
        turned = parent[:, :3, :3] - child[:, :3, :3]
        return [turned.reshape(len(parent), 9), offset @ spatial.hat(target)]
    return []


def line_gap(problem: FitProblem, unknowns: Unknowns) -> FitGap:
    """Return what remains between the lines, of a joint that closes a loop the larger of its lines on both links."""
    values = values_of(unknowns)[None]
    parents, children, _ = problem.motions(unknowns.signs, values, unknowns.deviating)
    distances = np.zeros(problem.count)
    angles = np.zeros(problem.count)
    for joint, axis in enumerate(problem.axes):
        motions = [parents[0, joint]]
        if axis.closes_loop:
            motions.append(children[0, joint])
        for motion in motions:
            point, direction = problem.line(motion, joint, unknowns.signs)
            target = problem.target_directions[joint]
            to_line = point - problem.target_points[joint]
            if axis.kind == "spherical":
                distances[joint] = max(distances[joint], float(np.linalg.norm(to_line)))
                continue
            if axis.kind == "free":
                continue
            tilt = np.linalg.norm(cross(direction, target))
            angles[joint] = max(angles[joint], float(np.arctan2(tilt, direction @ target)))
            if axis.kind in TURNING_KINDS:
                distance = np.linalg.norm(cross(to_line, target))
                distances[joint] = max(distances[joint], float(distance))
        # both lines are on the target, but their points may be apart along it
        if axis.closes_loop and axis.kind == "revolute":
            opened = _closing_rows(problem, joint, parents[:, joint], children[:, joint], unknowns.signs)[1]
            distances[joint] = max(distances[joint], float(np.linalg.norm(opened)))
    return FitGap(distances, angles)


def lines_coincide(problem: FitProblem, gap: FitGap) -> bool:
    """Return whether all lines coincide within the tolerance."""
    return bool(gap.distances.max() <= problem.tolerance and gap.angles.max() <= problem.angle_tolerance)
