"""Conventions that map the joint lines of one side onto those of another, and the links that remain different.

The first side is moved by a base transform X, its joints are displaced, and its joints may turn the other way (signs).
If all its joint lines then lie on those of the second side, both have the same kinematics, because all motions follow
from the lines at one state. If no conventions do this, the smallest set of joints is searched whose place on their
parent link must change (`Unknowns.deviating`): these joints are the places of the disagreement.

Here are the lines, and how given unknowns move those of the first side. What then remains between the lines is in
`line_gaps`, the steps that make it smallest are in `refinement`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from twin.comparison.matching import Matching
from twin.comparison.side import ONE_COORDINATE_KINDS, TURNING_KINDS, Axis, RobotSide
from twin.comparison.unknowns import BASE_VALUES, JointDeviation, Unknowns, convention_count, zero_columns
from twin.core import spatial
from twin.core.spatial import Array

ANGLE_PER_LENGTH = 2.0
"""Tolerance of directions in rad for a tolerance of 1 m: a wrong direction moves points at half a metre as far."""


class FitProblem:
    """The lines of two sides that a fit brings together, by the joints of the second side.

    Attributes:
        first, second: the sides.
        tolerance: distance in m up to which two lines coincide.
        axes, kinds: the joints of the first side, in the order of the second, and their types.
        count: number of joints.
        order: the joints of the tree, parents first, then those that close loops.
        below: for each joint, the joints that start at its child.
        points, directions: (joints, 3) of the first side; `target_points`, `target_directions` of the second.
        drawn, target_drawn: (joints,) coordinates in m or rad at which the lines of the sides are compared.
        directed: for each joint, whether both sides state which way along its line is positive.
        signed: the joints that may turn or slide the other way.
        with_direction, with_place: the joints whose line has a direction, and those whose line has a place.
        with_centre: the joints that have a centre but no line.
    """

    def __init__(self, first: RobotSide, second: RobotSide, matching: Matching, tolerance: float) -> None:
        self.first = first
        self.second = second
        self.tolerance = tolerance
        self.axes = [first.axes[i] for i in matching.pairs]
        self.count = len(self.axes)
        ends = []
        for axis in self.axes:
            ends.append(_JointEnds(axis.parent, axis.child, axis.closes_loop))
        self.order, self.below = _joint_order(tuple(ends))
        self.points, self.directions = _lines(self.axes)
        self.target_points, self.target_directions = _lines(second.axes)
        self.kinds = [axis.kind for axis in self.axes]
        self.directed: list[bool] = []
        self.signed: list[int] = []
        for i, (axis, target) in enumerate(zip(self.axes, second.axes, strict=True)):
            self.directed.append(axis.is_directed and target.is_directed)
            if axis.kind in ONE_COORDINATE_KINDS and self.directed[i]:
                self.signed.append(i)
        self.with_direction: list[int] = []
        self.with_place: list[int] = []
        self.with_centre: list[int] = []
        for i, kind in enumerate(self.kinds):
            if kind == "spherical":
                self.with_centre.append(i)
            elif kind != "free":
                self.with_direction.append(i)
            if kind in TURNING_KINDS:
                self.with_place.append(i)
        self.drawn = np.array([axis.drawn for axis in self.axes])
        self.target_drawn = np.array([axis.drawn for axis in second.axes])

    @cached_property
    def frames(self) -> Array:
        """(joints, 3, 3) frames of the joints of the first side, z along the axis; only deviations need them."""
        z = self.directions / np.linalg.norm(self.directions, axis=1, keepdims=True)
        # the axis of the base that is least along z, so that the part across z is never short
        x = np.eye(3)[np.abs(z).argmin(axis=1)]
        x = x - z * (z * x).sum(axis=1, keepdims=True)
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
        return np.stack([x, cross(z, x), z], axis=-1)

    @cached_property
    def _is_turning(self) -> Array:
        """(joints,) 1 for each joint that turns about its line, else 0."""
        return np.array([kind in TURNING_KINDS for kind in self.kinds], float)

    @cached_property
    def _is_sliding(self) -> Array:
        """(joints,) 1 for each joint that slides along its line, else 0."""
        return np.array([kind == "prismatic" for kind in self.kinds], float)

    @property
    def angle_tolerance(self) -> float:
        """Angle in rad up to which two directions coincide."""
        return ANGLE_PER_LENGTH * self.tolerance

    @cached_property
    def unchanged(self) -> Unknowns:
        """No change at all."""
        return Unknowns(np.ones(self.count), np.zeros(BASE_VALUES), np.zeros(self.count))

    def displacements(self, signs: Array, zeros: Array) -> Array:
        """Return the displacements (..., joints) of the first side to the drawn state of the second.

        The coordinate of the first side is sign times that of the second plus the zero.
        """
        return signs * self.target_drawn + zeros - self.drawn

    def zeros_of(self, signs: Array, displacements: Array) -> Array:
        """Return the zeros (joints,) for displacements (joints,), the inverse of `displacements`."""
        return displacements + self.drawn - signs * self.target_drawn

    def motions(self, signs: Array, values: Array, deviating: Sequence[JointDeviation]) -> tuple[Array, Array, Array]:
        """Return (parents, children, groups): the motions of the bodies of the first side for `values` (k, unknowns).

        `parents` and `children` (k, joints, 4, 4) map what is on the parent and on the child of each joint;
        `groups` (k, groups, 4, 4) the groups of bodies.
        """
        count = len(values)
        base, steps, deviations = self._elementary_motions(signs, values, deviating)
        groups = np.zeros((count, len(self.first.groups), 4, 4))
        groups[:] = base[:, None]
        parents = np.zeros((count, self.count, 4, 4))
        children = np.zeros((count, self.count, 4, 4))
        place_motions: dict[int, Array] = {}
        axis_motions: dict[int, Array] = {}
        for k, deviation in enumerate(deviating):
            of_kind = axis_motions if deviation.axis_only else place_motions
            of_kind[deviation.joint] = deviations[:, k]
        for i in self.order:
            axis = self.axes[i]
            parent = groups[:, axis.parent]
            step = steps[:, i]
            if i in place_motions:
                parent = parent @ place_motions[i]
            if i in axis_motions:
                # the axis is turned about its point, and the links behind the joint stay: turned back after its motion
                parent = parent @ axis_motions[i]
                step = step @ spatial.inverse(axis_motions[i])
            parents[:, i] = parent
            if axis.closes_loop:
                children[:, i] = groups[:, axis.child]
                continue
            children[:, i] = parent @ step
            groups[:, axis.child] = children[:, i]
        return parents, children, groups

    def _elementary_motions(
        self, signs: Array, values: Array, deviating: Sequence[JointDeviation]
    ) -> tuple[Array, Array, Array]:
        """Return the motions (base, joints, deviations) of which `motions` consist, for `values` (k, unknowns).

        `base` (k, 4, 4) is the base transform, `joints` (k, joints, 4, 4) the motions about or along the lines,
        `deviations` (k, deviating, 4, 4) those of the deviating joints on their parent links. All their rotations are
        computed by one call: a call takes longer than a rotation.
        """
        displacements = self.displacements(signs, values[:, zero_columns(self.count)])
        joints = [deviation.joint for deviation in deviating]
        in_frame = values[:, convention_count(self.count) :].reshape(len(values), len(joints), 2, 3)
        in_base = in_frame
        if joints:
            in_base = in_frame @ np.swapaxes(self.frames[joints], 1, 2)
        vectors = [values[:, None, :3], self._rotation_vectors(displacements), in_base[:, :, 0]]
        R = spatial.exp_so3(np.concatenate(vectors, axis=1))
        joint_motions = self._motions_on_lines(R[:, 1 : 1 + self.count], displacements)
        R_deviations = R[:, 1 + self.count :]
        points = self.points[joints]
        shifts = points - np.squeeze(R_deviations @ points[..., None], -1) + in_base[:, :, 1]
        base = spatial.pose(R[:, 0], values[:, 3:BASE_VALUES])
        return base, joint_motions, spatial.pose(R_deviations, shifts)

    def joint_motions(self, displacements: Array) -> Array:
        """Return the motions (joints, 4, 4) about or along the lines for displacements (joints,) in m or rad."""
        return self._motions_on_lines(spatial.exp_so3(self._rotation_vectors(displacements)), displacements)

    def _rotation_vectors(self, displacements: Array) -> Array:
        """Return the rotation vectors (..., joints, 3) of the displacements (..., joints)."""
        return (displacements * self._is_turning)[..., None] * self.directions

    def _motions_on_lines(self, R: Array, displacements: Array) -> Array:
        """Return the motions (..., joints, 4, 4) of the displacements, whose rotations are R (..., joints, 3, 3)."""
        p = self.points - np.squeeze(R @ self.points[..., None], -1)
        p = p + (displacements * self._is_sliding)[..., None] * self.directions
        return spatial.pose(R, p)

    def line(self, motion: Array, joint: int, signs: Array) -> tuple[Array, Array]:
        """Return (point (..., 3) in m, direction (..., 3)) of the line of a joint after a motion (..., 4, 4)."""
        R = motion[..., :3, :3]
        point = R @ self.points[joint] + motion[..., :3, 3]
        direction = signs[joint] * (R @ self.directions[joint])
        if not self.directed[joint]:
            direction = turned_towards(direction, self.target_directions[joint])
        return point, direction


def _lines(axes: Sequence[Axis]) -> tuple[Array, Array]:
    """Return points and directions (joints, 3) of the lines of joints."""
    points = np.array([axis.point for axis in axes])
    directions = np.array([axis.direction for axis in axes])
    return points, directions


def turned_towards(directions: Array, target: Array) -> Array:
    """Return directions (..., 3), those turned around that point backward along a target direction (3,).

    For lines of which a side does not state which way is positive.
    """
    backward = directions @ target < 0.0
    return np.where(np.asarray(backward)[..., None], -directions, directions)


def cross(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3); np.cross takes most of its time for a choice of axes."""
    product = np.zeros(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


class _JointEnds(NamedTuple):
    """The groups of bodies that a joint connects, and whether it closes a loop."""

    parent: int
    child: int
    closing: bool


@lru_cache(maxsize=64)  # edits make many problems with the same joints
def _joint_order(joints: tuple[_JointEnds, ...]) -> tuple[list[int], list[list[int]]]:
    """Return (order, below) of joints.

    `order` has the joints of the tree first, parents first; `below` for each joint those that start at its child,
    without those that close a loop. The joints of a side's tree connect all its groups with the base, the group 0.
    """
    reached = {0}
    order: list[int] = []
    closing: list[int] = []
    pending: list[int] = []
    for i, joint in enumerate(joints):
        if joint.closing:
            closing.append(i)
        else:
            pending.append(i)
    while pending:
        # all at once: the joints of one level stay in the order of the side
        ready = []
        for i in pending:
            if joints[i].parent in reached:
                ready.append(i)
        assert ready, "a joint of the tree does not hang on the base"
        for i in ready:
            order.append(i)
            reached.add(joints[i].child)
            pending.remove(i)
    order += closing
    below: list[list[int]] = []
    for joint in joints:
        on_child: list[int] = []
        for k in order:
            if not joint.closing and joints[k].parent == joint.child:
                on_child.append(k)
        below.append(on_child)
    return order, below
