"""Conventions that map the joint lines of one side onto those of another, and the links that remain different.

The first side is moved by a base transform X, its joints are displaced, and its joints may turn the other way (signs).
If all its joint lines then lie on those of the second side, both have the same kinematics, because all motions follow
from the lines at one state. If no conventions do this, the smallest set of joints is searched whose place on their
parent link must change (`Unknowns.deviating`): these joints are the places of the disagreement.

Here are the residuals of given signs and deviating joints, and the Gauss-Newton steps that make them smallest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, cast

import numpy as np
from scipy import linalg

from twin.comparison.matching import Matching
from twin.comparison.side import ONE_COORDINATE, TURNING, Axis, RobotSide
from twin.comparison.unknowns import (
    BASE_VALUES,
    Deviation,
    Unknowns,
    convention_count,
    free_values,
    values_of,
    with_values,
    zero_columns,
)
from twin.core import spatial
from twin.core.spatial import Array, Index

ANGLE_PER_LENGTH = 2.0
"""Tolerance of directions in rad for a tolerance of 1 m: a wrong direction moves points at half a metre as far."""

STEP = 1e-7
"""Step of the unknowns in m and rad for derivatives by differences."""

_ROUNDS = 25
"""Maximum number of Gauss-Newton steps."""

_RANK = 1e-6
"""Size of a singular value, relative to the largest, below which the lines do not determine a direction.

Derivatives by differences have errors of about 1e-8: a smaller value would let such a direction run to kilometres.
"""

_NO_STRENGTH = 1e-12
"""Derivative that stands for 0 where nothing changes the lines: rounding alone would else determine a direction."""

_STALLED = 1e-4
"""Part of the sum of squares that a step must remove where the lines are still far apart: else they stay apart."""

_FAR = 10.0
"""Factor of the tolerance from which lines are far apart."""

_DAMPING_CUT = 10
_DAMPING_GROWTH = 100
"""Factors of the damping after a step that lowered the residual, and after one that did not."""

_LEAST_DAMPING = 1e-7
"""Smallest damping of a step that did not lower the residual."""

_LARGEST_DAMPING = 1e3
"""Damping above which steps no longer lead anywhere."""

_SOLVED = 1e-13
"""Largest residual in m and rad at which the steps end."""

_ENDED = 1e-9
"""Part of the sum of squares that a step must remove, or the steps end."""

_ROUNDING = 1e-20
"""Sum of squares in m and rad below which a small gain of a step is only rounding, and ends nothing."""


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
    """Unknowns with which all lines coincide within the tolerance, and the largest remaining distances."""

    unknowns: Unknowns
    gap: FitGap


class Problem:
    """The lines of two sides, by the joints of the second side.

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
    """

    def __init__(self, first: RobotSide, second: RobotSide, matching: Matching, tolerance: float) -> None:
        self.first = first
        self.second = second
        self.tolerance = tolerance
        self.axes = [first.axes[i] for i in matching.pairs]
        self.count = len(self.axes)
        ends = []
        for axis in self.axes:
            ends.append(_JointEnds(axis.parent, axis.child, axis.closing))
        self.order, self.below = _tree(tuple(ends))
        self.points, self.directions = _lines(self.axes)
        self.target_points, self.target_directions = _lines(second.axes)
        self.kinds = [axis.kind for axis in self.axes]
        self.directed: list[bool] = []
        self.signed: list[int] = []
        for i, (axis, target) in enumerate(zip(self.axes, second.axes, strict=True)):
            self.directed.append(axis.directed and target.directed)
            if axis.kind in ONE_COORDINATE and self.directed[i]:
                self.signed.append(i)
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
    def _turning(self) -> Array:
        """(joints,) 1 for each joint that turns about its line, else 0."""
        return np.array([kind in TURNING for kind in self.kinds], float)

    @cached_property
    def _sliding(self) -> Array:
        """(joints,) 1 for each joint that slides along its line, else 0."""
        return np.array([kind == "prismatic" for kind in self.kinds], float)

    @cached_property
    def _row_joints(self) -> tuple[list[int], list[int], list[int]]:
        """(joints with a direction, joints with a line that has a place, joints with a centre)."""
        with_direction: list[int] = []
        with_place: list[int] = []
        with_centre: list[int] = []
        for i, kind in enumerate(self.kinds):
            if kind == "spherical":
                with_centre.append(i)
            elif kind != "free":
                with_direction.append(i)
            if kind in TURNING:
                with_place.append(i)
        return with_direction, with_place, with_centre

    @property
    def angle_tolerance(self) -> float:
        """Angle in rad up to which two directions coincide."""
        return ANGLE_PER_LENGTH * self.tolerance

    @cached_property
    def start(self) -> Unknowns:
        """No change at all."""
        return Unknowns(np.ones(self.count), np.zeros(6), np.zeros(self.count))

    def displacements(self, signs: Array, zeros: Array) -> Array:
        """Return the displacements (..., joints) of the first side to the drawn state of the second.

        The coordinate of the first side is sign times that of the second plus the zero.
        """
        return signs * self.target_drawn + zeros - self.drawn

    def zeros(self, signs: Array, displacements: Array) -> Array:
        """Return the zeros (joints,) for displacements (joints,), the inverse of `displacements`."""
        return displacements + self.drawn - signs * self.target_drawn

    # -- residuals ------------------------------------------------------------------------------------

    def motions(self, signs: Array, values: Array, deviating: Sequence[Deviation]) -> tuple[Array, Array, Array]:
        """Return (parents, children, groups): the motions of the bodies of the first side for `values` (k, unknowns).

        `parents` and `children` (k, joints, 4, 4) map what is on the parent and on the child of each joint;
        `groups` (k, groups, 4, 4) the groups of bodies.
        """
        count = len(values)
        base, steps, deviations = self._steps(signs, values, deviating)
        groups = np.zeros((count, len(self.first.groups), 4, 4))
        groups[:] = base[:, None]
        parents = np.zeros((count, self.count, 4, 4))
        children = np.zeros((count, self.count, 4, 4))
        placed: dict[int, Array] = {}
        turned: dict[int, Array] = {}
        for k, deviation in enumerate(deviating):
            of_kind = turned if deviation.axis_only else placed
            of_kind[deviation.joint] = deviations[:, k]
        for i in self.order:
            axis = self.axes[i]
            parent = groups[:, axis.parent]
            step = steps[:, i]
            if i in placed:
                parent = parent @ placed[i]
            if i in turned:
                # the axis is turned about its point, and the links behind the joint stay: turned back after its motion
                parent = parent @ turned[i]
                step = step @ spatial.inverse(turned[i])
            parents[:, i] = parent
            if axis.closing:
                children[:, i] = groups[:, axis.child]
                continue
            children[:, i] = parent @ step
            groups[:, axis.child] = children[:, i]
        return parents, children, groups

    def _steps(self, signs: Array, values: Array, deviating: Sequence[Deviation]) -> tuple[Array, Array, Array]:
        """Return (base, joints, deviations) for `values` (k, unknowns).

        `base` (k, 4, 4) is the base transform, `joints` (k, joints, 4, 4) the motions about or along the lines,
        `deviations` (k, deviating, 4, 4) those of the deviating joints on their parent links. All their rotations are
        computed by one call: a call takes longer than a rotation.
        """
        displacements = self.displacements(signs, values[:, zero_columns(self.count)])
        joints = [deviation.joint for deviation in deviating]
        in_frame = values[:, convention_count(self.count) :].reshape(len(values), len(joints), 2, 3)
        placed = in_frame
        if joints:
            placed = in_frame @ np.swapaxes(self.frames[joints], 1, 2)
        vectors = [values[:, None, :3], self._turns(displacements), placed[:, :, 0]]
        R = spatial.exp_so3(np.concatenate(vectors, axis=1))
        joint_motions = self._about_lines(R[:, 1 : 1 + self.count], displacements)
        R_deviations = R[:, 1 + self.count :]
        points = self.points[joints]
        shifts = points - np.squeeze(R_deviations @ points[..., None], -1) + placed[:, :, 1]
        base = spatial.pose(R[:, 0], values[:, 3:BASE_VALUES])
        return base, joint_motions, spatial.pose(R_deviations, shifts)

    def steps(self, displacements: Array) -> Array:
        """Return the motions (joints, 4, 4) about or along the lines for displacements (joints,) in m or rad."""
        return self._about_lines(spatial.exp_so3(self._turns(displacements)), displacements)

    def _turns(self, displacements: Array) -> Array:
        """Return the rotation vectors (..., joints, 3) of the displacements (..., joints)."""
        return (displacements * self._turning)[..., None] * self.directions

    def _about_lines(self, R: Array, displacements: Array) -> Array:
        """Return the motions (..., joints, 4, 4) of the displacements, whose rotations are R (..., joints, 3, 3)."""
        p = self.points - np.squeeze(R @ self.points[..., None], -1)
        p = p + (displacements * self._sliding)[..., None] * self.directions
        return spatial.pose(R, p)

    def rows(self, signs: Array, parents: Array, children: Array) -> Array:
        """Return the residuals (k, rows) in m and rad for motions (k, joints, 4, 4) as in `motions`."""
        R = parents[:, :, :3, :3]
        points = np.squeeze(R @ self.points[..., None], -1) + parents[:, :, :3, 3]
        directions = signs[:, None] * np.squeeze(R @ self.directions[..., None], -1)
        for i, directed in enumerate(self.directed):
            if not directed:
                directions[:, i] = _ahead(directions[:, i], self.target_directions[i])
        to_lines = points - self.target_points
        with_direction, with_place, with_centre = self._row_joints
        tilts = (directions - self.target_directions)[:, with_direction]
        moments = cross(to_lines[:, with_place], self.target_directions[with_place])
        shifts = to_lines[:, with_centre]
        rows = []
        for residuals in (tilts, moments, shifts):
            rows.append(residuals.reshape(len(parents), -1))
        for i, axis in enumerate(self.axes):
            if axis.closing:
                # the tree does not bring the child of such a joint to its parent: both must be on the line
                rows += self._closing_rows(i, parents[:, i], children[:, i], signs)
        return np.concatenate(rows, axis=1)

    def _closing_rows(self, joint: int, parent: Array, child: Array, signs: Array) -> list[Array]:
        """Return the rows of a joint that closes a loop: its line on the child coincides with that on the parent."""
        kind = self.kinds[joint]
        point_on_parent, direction_on_parent = self.line(parent, joint, signs)
        point_on_child, direction_on_child = self.line(child, joint, signs)
        offset = point_on_child - point_on_parent
        target = self.target_directions[joint]
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

    def line(self, motion: Array, joint: int, signs: Array) -> tuple[Array, Array]:
        """Return (point (..., 3) in m, direction (..., 3)) of the line of joint i after a motion (..., 4, 4)."""
        R = motion[..., :3, :3]
        point = R @ self.points[joint] + motion[..., :3, 3]
        direction = signs[joint] * (R @ self.directions[joint])
        if not self.directed[joint]:
            direction = _ahead(direction, self.target_directions[joint])
        return point, direction

    def gap(self, unknowns: Unknowns) -> FitGap:
        """Return what remains between the lines."""
        values = values_of(unknowns)[None]
        parents, children, _ = self.motions(unknowns.signs, values, unknowns.deviating)
        distances = np.zeros(self.count)
        angles = np.zeros(self.count)
        for joint, axis in enumerate(self.axes):
            motions = [parents[0, joint]]
            if axis.closing:
                motions.append(children[0, joint])
            for motion in motions:
                point, direction = self.line(motion, joint, unknowns.signs)
                target = self.target_directions[joint]
                to_line = point - self.target_points[joint]
                if axis.kind == "spherical":
                    distances[joint] = max(distances[joint], float(np.linalg.norm(to_line)))
                    continue
                if axis.kind == "free":
                    continue
                tilt = np.linalg.norm(cross(direction, target))
                angles[joint] = max(angles[joint], float(np.arctan2(tilt, direction @ target)))
                if axis.kind in TURNING:
                    distance = np.linalg.norm(cross(to_line, target))
                    distances[joint] = max(distances[joint], float(distance))
            # both lines are on the target, but their points may be apart along it
            if axis.closing and axis.kind == "revolute":
                opened = self._closing_rows(joint, parents[:, joint], children[:, joint], unknowns.signs)[1]
                distances[joint] = max(distances[joint], float(np.linalg.norm(opened)))
        return FitGap(distances, angles)

    def holds(self, gap: FitGap) -> bool:
        """Return whether all lines coincide within the tolerance."""
        return bool(gap.distances.max() <= self.tolerance and gap.angles.max() <= self.angle_tolerance)

    # -- solving --------------------------------------------------------------------------------------

    def refine(
        self,
        unknowns: Unknowns,
        free: Array | None = None,
        further_residuals: Callable[[Array, Array], Array] | None = None,
    ) -> FitSolution:
        """Return the unknowns after damped Gauss-Newton steps.

        Args:
            unknowns: values to begin with.
            free: (unknowns,) which values may change. None: see `free_values`.
            further_residuals: a function of values (k, unknowns), and of the motions (k, groups, 4, 4) of the groups of
                bodies with these values, that returns (k, rows) of further residuals in m and rad.
        """

        def residuals(values: Array) -> Array:
            parents, children, groups = self.motions(unknowns.signs, values, unknowns.deviating)
            lines = self.rows(unknowns.signs, parents, children)
            if further_residuals is None:
                return lines
            return np.concatenate([lines, further_residuals(values, groups)], axis=1)

        x = values_of(unknowns)
        if free is None:
            free = free_values(self.count, unknowns.deviating)
        columns = np.flatnonzero(free)
        r = residuals(x[None])[0]
        damping = 0.0
        for _ in range(_ROUNDS):
            if not len(columns) or np.abs(r).max() < _SOLVED:
                break
            stepped = with_steps(x, columns)[:-1]  # without the last row, which is x
            J = (residuals(stepped) - r).T / STEP
            step = _least_step(J, r, damping)
            x_tried = x.copy()
            x_tried[columns] += step
            r_tried = residuals(x_tried[None])[0]
            before = float(r @ r)
            after = float(r_tried @ r_tried)
            if after < before:
                x = x_tried
                r = r_tried
                # back to plain Gauss-Newton steps, which end in few
                damping = damping / _DAMPING_CUT if damping > _LEAST_DAMPING else 0.0
                lowered = before - after
                if lowered < _ENDED * before and before > _ROUNDING:
                    break
                if lowered < _STALLED * before and np.abs(r).max() > _FAR * self.tolerance:
                    break
            else:
                # a shorter step, more along the gradient
                damping = max(_DAMPING_GROWTH * damping, _LEAST_DAMPING)
                if damping > _LARGEST_DAMPING:
                    break
        refined = with_values(unknowns, x)
        return FitSolution(refined, self.gap(refined))


def _lines(axes: Sequence[Axis]) -> tuple[Array, Array]:
    """Return points and directions (joints, 3) of the lines of joints."""
    points = np.array([axis.point for axis in axes])
    directions = np.array([axis.direction for axis in axes])
    return points, directions


def _ahead(directions: Array, target: Array) -> Array:
    """Return directions (..., 3), those turned around that point backward along a target direction (3,)."""
    backward = directions @ target < 0.0
    return np.where(np.asarray(backward)[..., None], -directions, directions)


def cross(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3); np.cross takes most of its time for a choice of axes."""
    product = np.zeros(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _least_step(J: Array, r: Array, damping: float) -> Array:
    """Return the smallest step (columns,) that lowers the residual r most; directions without effect stay at zero."""
    if damping > 0.0:
        J = np.concatenate([J, np.sqrt(damping) * np.eye(J.shape[1])])
        r = np.concatenate([r, np.zeros(J.shape[1])])
    # A pivoted QR decomposition takes a fifth of the time of singular values, whose threads also wait for each other.
    solution = linalg.lstsq(J, -r, cond=_RANK, lapack_driver="gelsy")
    assert solution is not None
    return np.asarray(solution[0], float)


def with_steps(x: Array, columns: Index) -> Array:
    """Return (columns + 1, unknowns): values x with one of the columns stepped in each row, and x in the last row."""
    stepped = np.repeat(x[None], len(columns) + 1, axis=0)
    stepped[np.arange(len(columns)), columns] += STEP
    return stepped


def open_directions(J: Array) -> Array:
    """Return orthonormal directions (unknowns, k) that the derivatives J (rows, unknowns) do not determine."""
    if not J.size:
        return np.eye(J.shape[1])
    Q, R, _ = cast(tuple[Array, Array, Array], linalg.qr(J.T, pivoting=True))
    strengths = np.abs(np.diag(R))
    rank = int(np.sum(strengths > _RANK * max(float(strengths[0]), _NO_STRENGTH)))
    return Q[:, rank:]


class _JointEnds(NamedTuple):
    """The groups of bodies that a joint connects, and whether it closes a loop."""

    parent: int
    child: int
    closing: bool


@lru_cache(maxsize=64)
def _tree(joints: tuple[_JointEnds, ...]) -> tuple[list[int], list[list[int]]]:
    """Return (order, below) of joints.

    `order` has the joints of the tree first, parents first; `below` for each joint those that start at its child,
    without those that close a loop. Edits make many problems with the same joints.
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
        if not ready:
            break
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
