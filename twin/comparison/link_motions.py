"""The links of one robot, each moved as a rigid body onto the link of another robot that carries the same joints.

All links together must bring the lines of all joints together, on the parent and on the child: then both robots are the
same up to conventions. All joints are treated alike, also those that close loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from twin.comparison.fit_problem import FitProblem
from twin.comparison.side import ONE_COORDINATE_KINDS, TURNING_KINDS
from twin.core import spatial
from twin.core.spatial import Array

Where = Literal["parent", "child", "both"]


class JointPlace(NamedTuple):
    """Number of a joint, and the link or links on which its place is meant."""

    joint: int
    where: Where


_MAX_STEPS = 12
"""Maximum number of Gauss-Newton steps."""

_CONVERGED_STEP = 1e-12
"""Step in m and rad that is no longer made."""

_DAMPING = 1e-11
"""Damping, relative to the largest diagonal element, of motions that do not change the lines: a bar between balls."""


@dataclass(frozen=True)
class PlaceDifference:
    """By how much the place of a joint on its parent, its child, or both differs.

    Attributes:
        joint: number of the joint, as in `FitProblem.axes`.
        where: the link or links.
        shift: (3,) in m.
        turn: (3,) in rad.
    """

    joint: int
    where: Where
    shift: Array
    turn: Array


class LinkMotions:
    """The motions of the links of the first side onto those of the second."""

    def __init__(self, problem: FitProblem) -> None:
        self.problem = problem
        self.group_count = len(problem.first.groups)
        self.places: list[JointPlace] = []
        for i, kind in enumerate(problem.kinds):
            if kind == "free":
                continue
            self.places.append(JointPlace(i, "parent"))
            self.places.append(JointPlace(i, "child"))
            if kind in ONE_COORDINATE_KINDS:
                self.places.append(JointPlace(i, "both"))

    def residual(self, T: Array, joint: int, where: Where) -> tuple[Array, Array]:
        """Return (residual (rows,), derivatives (rows, 6 groups)) of the place of a joint.

        For "both", see `_shared_residual`. `T` (groups, 4, 4) are the motions. The derivatives of a link are by a
        rotation about the origin in rad, then by a shift in m.
        """
        axis = self.problem.axes[joint]
        if where == "both":
            return self._shared_residual(T, joint)
        group = axis.parent if where == "parent" else axis.child
        return self._place_residual(T, joint, group)

    def _shared_residual(self, T: Array, joint: int) -> tuple[Array, Array]:
        """Return residual and derivatives of what the places of a joint on its two links have in common.

        Of a hinge (1 row): how far its two points are apart along its line, in m. Of a slide (6 rows): the rotation
        between its links in rad, and how far its points are apart across its direction, in m: a slide may begin
        anywhere, but the child moves only along it.
        """
        axis = self.problem.axes[joint]
        along = self.problem.target_directions[joint]
        on_parent, d_on_parent = self._moved_point(T, joint, axis.parent)
        on_child, d_on_child = self._moved_point(T, joint, axis.child)
        offset = on_parent - on_child
        d_apart = d_on_parent - d_on_child
        if self.problem.kinds[joint] != "prismatic":
            return np.array([float(along @ offset)]), (along @ d_apart)[None]
        between = T[axis.parent, :3, :3] @ T[axis.child, :3, :3].T
        rotation = spatial.log_so3(between)
        # exact if the links are not rotated against each other; otherwise an approximation, which needs more steps
        d_rotation = np.zeros((3, 6 * self.group_count))
        d_rotation[:, 6 * axis.parent : 6 * axis.parent + 3] = np.eye(3)
        d_rotation[:, 6 * axis.child : 6 * axis.child + 3] = -np.eye(3)
        across = np.asarray(np.cross(offset, along), float)
        d_across = -spatial.hat(along) @ d_apart
        return np.concatenate([rotation, across]), np.vstack([d_rotation, d_across])

    def _moved_point(self, T: Array, joint: int, group: int) -> tuple[Array, Array]:
        """Return the point (3,) of a joint on a link, and its derivatives (3, 6 groups)."""
        point = T[group, :3, :3] @ self.problem.points[joint] + T[group, :3, 3]
        d_point = np.zeros((3, 6 * self.group_count))
        d_point[:, 6 * group : 6 * group + 3] = -spatial.hat(point)
        d_point[:, 6 * group + 3 : 6 * group + 6] = np.eye(3)
        return point, d_point

    def _place_residual(self, T: Array, joint: int, group: int) -> tuple[Array, Array]:
        """Return residual and derivatives of the place of a joint on one link, against that in the second side.

        Of a ball: its point in m. Of other joints: their direction, and if they turn, the distance from their line.
        """
        kind = self.problem.kinds[joint]
        point, d_point = self._moved_point(T, joint, group)
        to_line = point - self.problem.target_points[joint]
        if kind == "spherical":
            return to_line, d_point
        target = self.problem.target_directions[joint]
        direction = T[group, :3, :3] @ self.problem.directions[joint]
        if direction @ target < 0.0:  # which way is positive is a convention
            direction = -direction
        d_direction = np.zeros((3, 6 * self.group_count))
        d_direction[:, 6 * group : 6 * group + 3] = -spatial.hat(direction)
        rows = [direction - target]
        derivatives = [d_direction]
        if kind in TURNING_KINDS:
            rows.append(np.cross(to_line, target))
            derivatives.append(-spatial.hat(target) @ d_point)
        return np.concatenate(rows), np.vstack(derivatives)

    def fitted(self, places: Sequence[JointPlace], weights: Sequence[float], start: Array) -> Array:
        """Return the motions (groups, 4, 4) that bring the kept places together, in the sense of least squares."""
        T = start.copy()
        for _ in range(_MAX_STEPS):
            residuals: list[Array] = []
            derivatives: list[Array] = []
            for weight, (i, where) in zip(weights, places, strict=True):
                residual, d_residual = self.residual(T, i, where)
                residuals.append(weight * residual)
                derivatives.append(weight * d_residual)
            r = np.concatenate(residuals)
            J = np.vstack(derivatives)
            normal = J.T @ J
            damping = _DAMPING * float(normal.diagonal().max())
            steps = np.linalg.solve(normal + damping * np.eye(len(normal)), -J.T @ r)
            step = steps.reshape(self.group_count, 6)
            # on the left: the derivatives are by rotations about the origin of the base
            T = spatial.pose(spatial.exp_so3(step[:, :3]), step[:, 3:]) @ T
            if np.abs(step).max() < _CONVERGED_STEP:
                break
        return T

    def misfit(self, T: Array, joint: int, where: Where) -> float:
        """Return by how much a place differs, in units of the tolerance."""
        kind = self.problem.kinds[joint]
        r, _ = self.residual(T, joint, where)
        # a ball is a point, and the places of a hinge share a shift along its line: lengths without an angle
        if kind == "spherical" or (kind == "revolute" and where == "both"):
            return float(np.linalg.norm(r)) / self.problem.tolerance
        turn = float(np.linalg.norm(r[:3])) / self.problem.angle_tolerance
        shift = float(np.linalg.norm(r[3:])) / self.problem.tolerance
        return max(turn, shift)

    def places_agree(self, T: Array, places: Sequence[JointPlace]) -> bool:
        """Return whether the kept places agree within the tolerance."""
        misfits = [self.misfit(T, joint, where) for joint, where in places]
        return max(misfits) <= 1.0

    def fitted_to_all(self) -> Array:
        """Return the motions (groups, 4, 4) that bring all places together, in the sense of least squares."""
        identity = np.tile(np.eye(4), (self.group_count, 1, 1))
        return self.fitted(self.places, np.ones(len(self.places)).tolist(), identity)

    def places_without(self, left_out: Sequence[JointPlace]) -> list[JointPlace]:
        """Return the places without some: leaving a place out leaves out what it shares with the other one."""
        left_out_links: dict[int, set[Where]] = {}
        for place in left_out:
            left_out_links.setdefault(place.joint, set()).add(place.where)
        other_places: list[JointPlace] = []
        for place in self.places:
            links = left_out_links.get(place.joint, set())
            is_left_out = place.where == "both" or "both" in links or place.where in links
            if not links or not is_left_out:
                other_places.append(place)
        return other_places

    def differences_without(self, left_out: Sequence[JointPlace], start: Array) -> tuple[PlaceDifference, ...] | None:
        """Return by how much the places that are left out differ, if all others agree without them; else None."""
        remaining = self.places_without(left_out)
        T = self.fitted(remaining, np.ones(len(remaining)).tolist(), start)
        if not self.places_agree(T, remaining):
            return None
        differences = []
        for joint, where in left_out:
            differences.append(self._difference(T, joint, where))
        return tuple(differences)

    def _difference(self, T: Array, joint: int, where: Where) -> PlaceDifference:
        """Return how the place of a joint in the first side differs from that in the second."""
        axis = self.problem.axes[joint]
        group = axis.child if where == "child" else axis.parent
        point, _ = self._moved_point(T, joint, group)
        target = self.problem.target_directions[joint]
        shift = point - self.problem.target_points[joint]
        turn = np.zeros(3)
        kind = self.problem.kinds[joint]
        if kind != "spherical":
            direction = T[group, :3, :3] @ self.problem.directions[joint]
            if direction @ target < 0.0:  # as in `_place_residual`
                direction = -direction
            across = np.cross(target, direction)
            sine = float(np.linalg.norm(across))
            if sine > 0.0:  # parallel directions have no axis of a turn
                turn = np.arctan2(sine, target @ direction) * across / sine
            # a line has no place along itself
            shift = shift - target * (shift @ target)
        if kind == "prismatic":
            shift = np.zeros(3)  # a slide has no place by itself, but its two links have one across it
        # on one link alone, the difference from the other link counts as well, see `_shared_residual`
        if kind in ONE_COORDINATE_KINDS and where != "both":
            other_group = axis.parent if where == "child" else axis.child
            offset = point - self._moved_point(T, joint, other_group)[0]
            along = target * (target @ offset)
            if kind == "revolute":
                shift = shift + along
            else:
                shift = shift + (offset - along)
        return PlaceDifference(joint, where, shift, turn)
