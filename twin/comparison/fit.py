"""Conventions that map the joint lines of one side onto those of another, and the links that remain different.

The first side is moved by a base transform X, its joints are displaced, and its joints may turn the other way (signs).
If all its joint lines then lie on those of the second side, both have the same kinematics, because all motions follow
from the lines at one state. If no conventions do this, the smallest set of joints is searched whose place on their
parent link must change (`Unknowns.deviating`): these joints are the places of the disagreement.

All sets of signs with few changes are tried, fewest first; for each, the displacements come from closed forms along the
tree, and Gauss-Newton steps on all unknowns finish them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import cast

import numpy as np
from scipy import linalg

from twin.comparison.matching import Matching
from twin.comparison.side import ONE_COORDINATE, TURNING, RobotSide
from twin.core import spatial
from twin.core.spatial import Array

ANGLE_PER_LENGTH = 2.0
"""Tolerance of directions in rad for a tolerance of 1 m: a wrong direction moves points at half a metre as far."""

_STEP = 1e-7
"""Step of the unknowns in m and rad for derivatives by differences."""

_ROUNDS = 25
"""Maximum number of Gauss-Newton steps."""

_RANK = 1e-6
"""Size of a singular value, relative to the largest, below which the lines do not determine a direction.

Derivatives by differences have errors of about 1e-8: a smaller value would let such a direction run to kilometres.
"""

_STALLED = 1e-4
"""Part of the sum of squares that a step must remove where the lines are still far apart: else they stay apart."""

_FAR = 10.0
"""Factor of the tolerance from which lines are far apart."""

_LEAST_DAMPING = 1e-7
"""Smallest damping of a step that did not lower the residual."""

_FLAT = 1e-7
"""Amplitude of a cost below which an angle does not change it."""


@dataclass(frozen=True)
class Unknowns:
    """Signs and values of a fit.

    Attributes:
        signs: (joints,) 1 or -1 for each joint of the second side.
        base: (6,) rotation vector in rad and shift in m of the base transform X.
        zeros: (joints,) by how much the zero of each joint of the first side differs, see `Problem.shifted`.
        deviating: joints whose place on their parent link changes; `Problem.turned_axis` is the number of a joint whose
            axis alone is turned, while all links stay.
        deviations: (deviating, 6) their rotation vectors in rad and shifts in m, in the frame of the joint.
    """

    signs: Array
    base: Array
    zeros: Array
    deviating: tuple[int, ...] = ()
    deviations: Array | None = None

    @property
    def flips(self) -> tuple[int, ...]:
        """Indices of the joints that turn the other way."""
        return tuple(int(i) for i in np.flatnonzero(self.signs < 0))


@dataclass(frozen=True)
class FitGap:
    """What remains between the joint lines of both sides: (joints,) distances in m and angles in rad."""

    distances: Array
    angles: Array


@dataclass(frozen=True)
class FitSolution:
    """Unknowns with which all lines coincide within the tolerance, and the largest remaining distances."""

    unknowns: Unknowns
    gap: FitGap


class Problem:
    """The lines of two sides, by the joints of the second side.

    Attributes:
        first, second: the sides.
        axes: the joints of the first side, in the order of the second.
        directed: for each joint, whether both sides state which way along its line is positive.
        tolerance: distance in m up to which two lines coincide.
    """

    def __init__(self, first: RobotSide, second: RobotSide, matching: Matching, tolerance: float) -> None:
        self.first = first
        self.second = second
        self.tolerance = tolerance
        self.axes = [first.axes[i] for i in matching.pairs]
        self.count = len(self.axes)
        joints = tuple((axis.parent, axis.child, axis.closing) for axis in self.axes)
        self.order, self.below = _tree(joints)
        self.points = np.array([axis.point for axis in self.axes])
        self.directions = np.array([axis.direction for axis in self.axes])
        self.target_points = np.array([axis.point for axis in second.axes])
        self.target_directions = np.array([axis.direction for axis in second.axes])
        self.kinds = [axis.kind for axis in self.axes]
        both = zip(self.axes, second.axes, strict=True)
        self.directed = [one.directed and other.directed for one, other in both]
        self.signed = [i for i, axis in enumerate(self.axes) if axis.kind in ONE_COORDINATE and self.directed[i]]
        drawn = np.array([axis.drawn for axis in self.axes])
        target_drawn = np.array([axis.drawn for axis in second.axes])
        self.drawn = drawn
        self.target_drawn = target_drawn

    @cached_property
    def frames(self) -> Array:
        """(joints, 3, 3) frames of the joints of the first side, z along the axis; only deviations need them."""
        z = self.directions / np.linalg.norm(self.directions, axis=1, keepdims=True)
        x = np.eye(3)[np.abs(z).argmin(axis=1)]
        x = x - z * (z * x).sum(axis=1, keepdims=True)
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
        return np.stack([x, _cross(z, x), z], axis=-1)

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
        directed = [i for i, kind in enumerate(self.kinds) if kind not in ("free", "spherical")]
        placed = [i for i, kind in enumerate(self.kinds) if kind in TURNING]
        centred = [i for i, kind in enumerate(self.kinds) if kind == "spherical"]
        return directed, placed, centred

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

    def motions(self, signs: Array, values: Array, deviating: Sequence[int]) -> tuple[Array, Array, Array]:
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
        places = {joint: k for k, joint in enumerate(deviating)}
        for i in self.order:
            axis = self.axes[i]
            parent = groups[:, axis.parent]
            step = steps[:, i]
            if i in places:
                parent = parent @ deviations[:, places[i]]
            turned = self.turned_axis(i)
            if turned in places:
                turn = deviations[:, places[turned]]
                parent = parent @ turn
                step = step @ spatial.inverse(turn)
            parents[:, i] = parent
            if axis.closing:
                children[:, i] = groups[:, axis.child]
                continue
            children[:, i] = parent @ step
            groups[:, axis.child] = children[:, i]
        return parents, children, groups

    def _steps(self, signs: Array, values: Array, deviating: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return (base, joints, deviations) for `values` (k, unknowns).

        `base` (k, 4, 4) is the base transform, `joints` (k, joints, 4, 4) the motions about or along the lines,
        `deviations` (k, deviating, 4, 4) those of the deviating joints on their parent links. All their rotations are
        computed by one call: a call takes longer than a rotation.
        """
        moved = self.displacements(signs, values[:, 6 : 6 + self.count])
        joints = [joint % self.count for joint in deviating]
        in_frame = values[:, 6 + self.count :].reshape(len(values), len(joints), 2, 3)
        placed = in_frame
        if joints:
            placed = in_frame @ np.swapaxes(self.frames[joints], 1, 2)
        vectors = [values[:, None, :3], self._turns(moved), placed[:, :, 0]]
        R = spatial.exp_so3(np.concatenate(vectors, axis=1))
        joint_motions = self._about_lines(R[:, 1 : 1 + self.count], moved)
        R_deviations = R[:, 1 + self.count :]
        points = self.points[joints]
        shifts = points - np.squeeze(R_deviations @ points[..., None], -1) + placed[:, :, 1]
        base = spatial.pose(R[:, 0], values[:, 3:6])
        return base, joint_motions, spatial.pose(R_deviations, shifts)

    def _turns(self, moved: Array) -> Array:
        """Return the rotation vectors (..., joints, 3) of the displacements (..., joints)."""
        return (moved * self._turning)[..., None] * self.directions

    def _about_lines(self, R: Array, moved: Array) -> Array:
        """Return the motions (..., joints, 4, 4) of the displacements, whose rotations are R (..., joints, 3, 3)."""
        p = self.points - np.squeeze(R @ self.points[..., None], -1)
        p = p + (moved * self._sliding)[..., None] * self.directions
        return spatial.pose(R, p)

    def turned_axis(self, joint: int) -> int:
        """Return the number in `Unknowns.deviating` of a joint whose axis alone is turned."""
        return self.count + joint

    def free(self, deviating: Sequence[int]) -> Array:
        """Return which values (unknowns,) may change: all but the shifts of axes that are only turned."""
        free = np.ones(6 + self.count + 6 * len(deviating), bool)
        for k, joint in enumerate(deviating):
            if joint >= self.count:
                start = 6 + self.count + 6 * k
                free[start + 3 : start + 6] = False
        return free

    def residuals(self, signs: Array, values: Array, deviating: Sequence[int]) -> Array:
        """Return the residuals (k, rows) in m and rad for `values` (k, unknowns)."""
        parents, children, _ = self.motions(signs, values, deviating)
        return self.rows(signs, parents, children)

    def rows(self, signs: Array, parents: Array, children: Array) -> Array:
        """Return the residuals (k, rows) in m and rad for motions (k, joints, 4, 4) as in `motions`."""
        R = parents[:, :, :3, :3]
        points = np.squeeze(R @ self.points[..., None], -1) + parents[:, :, :3, 3]
        directions = signs[:, None] * np.squeeze(R @ self.directions[..., None], -1)
        for i, directed in enumerate(self.directed):
            if not directed:
                directions[:, i] = _ahead(directions[:, i], self.target_directions[i])
        to_lines = points - self.target_points
        with_direction, placed, centred = self._row_joints
        tables = [
            (directions - self.target_directions)[:, with_direction],
            _cross(to_lines[:, placed], self.target_directions[placed]),
            to_lines[:, centred],
        ]
        rows = [table.reshape(len(parents), -1) for table in tables]
        for i, axis in enumerate(self.axes):
            if axis.closing:
                rows += self._closing_rows(i, parents[:, i], children[:, i], signs)
        return np.concatenate(rows, axis=1)

    def _closing_rows(self, i: int, parent: Array, child: Array, signs: Array) -> list[Array]:
        """Return the rows of a joint that closes a loop: its line on the child coincides with that on the parent."""
        kind = self.kinds[i]
        point_on_parent, direction_on_parent = self._line(parent, i, signs)
        point_on_child, direction_on_child = self._line(child, i, signs)
        offset = point_on_child - point_on_parent
        target = self.target_directions[i]
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

    def _line(self, motion: Array, i: int, signs: Array) -> tuple[Array, Array]:
        R = motion[..., :3, :3]
        point = R @ self.points[i] + motion[..., :3, 3]
        direction = signs[i] * (R @ self.directions[i])
        if not self.directed[i]:
            direction = _ahead(direction, self.target_directions[i])
        return point, direction

    def gap(self, u: Unknowns) -> FitGap:
        """Return what remains between the lines."""
        values = values_of(u)[None]
        parents, children, _ = self.motions(u.signs, values, u.deviating)
        distances = np.zeros(self.count)
        angles = np.zeros(self.count)
        for i, axis in enumerate(self.axes):
            motions = [parents[0, i]]
            if axis.closing:
                motions.append(children[0, i])
            for motion in motions:
                point, direction = self._line(motion, i, u.signs)
                target = self.target_directions[i]
                to_line = point - self.target_points[i]
                if axis.kind == "spherical":
                    distances[i] = max(distances[i], float(np.linalg.norm(to_line)))
                    continue
                if axis.kind == "free":
                    continue
                tilt = np.linalg.norm(_cross(direction, target))
                angles[i] = max(angles[i], float(np.arctan2(tilt, direction @ target)))
                if axis.kind in TURNING:
                    distance = np.linalg.norm(_cross(to_line, target))
                    distances[i] = max(distances[i], float(distance))
            if axis.closing and axis.kind == "revolute":
                opened = self._closing_rows(i, parents[:, i], children[:, i], u.signs)[1]
                distances[i] = max(distances[i], float(np.linalg.norm(opened)))
        return FitGap(distances, angles)

    def holds(self, gap: FitGap) -> bool:
        """Return whether all lines coincide within the tolerance."""
        return bool(gap.distances.max() <= self.tolerance and gap.angles.max() <= self.angle_tolerance)

    # -- solving --------------------------------------------------------------------------------------

    def refine(
        self, u: Unknowns, free: Array | None = None, more: Callable[[Array, Array], Array] | None = None
    ) -> FitSolution:
        """Return the unknowns after damped Gauss-Newton steps.

        Args:
            u: values to begin with.
            free: (unknowns,) which values may change. None: see `free`.
            more: a function of values (k, unknowns), and of the motions (k, groups, 4, 4) of the groups of bodies with
                these values, that returns (k, rows) of further residuals in m and rad.
        """

        def residuals(values: Array) -> Array:
            parents, children, groups = self.motions(u.signs, values, u.deviating)
            lines = self.rows(u.signs, parents, children)
            if more is None:
                return lines
            return np.concatenate([lines, more(values, groups)], axis=1)

        x = values_of(u)
        if free is None:
            free = self.free(u.deviating)
        columns = np.flatnonzero(free)
        r = residuals(x[None])[0]
        damping = 0.0
        for _ in range(_ROUNDS):
            if not len(columns) or np.abs(r).max() < 1e-13:
                break
            moved = np.repeat(x[None], len(columns), axis=0)
            moved[np.arange(len(columns)), columns] += _STEP
            J = (residuals(moved) - r).T / _STEP
            step = _least_step(J, r, damping)
            tried = x.copy()
            tried[columns] += step
            r_tried = residuals(tried[None])[0]
            before = float(r @ r)
            after = float(r_tried @ r_tried)
            if after < before:
                x = tried
                r = r_tried
                damping = damping / 10 if damping > _LEAST_DAMPING else 0.0
                lowered = before - after
                if lowered < 1e-9 * before and before > 1e-20:
                    break
                if lowered < _STALLED * before and np.abs(r).max() > _FAR * self.tolerance:
                    break
            else:
                damping = max(100 * damping, _LEAST_DAMPING)
                if damping > 1e3:
                    break
        refined = with_values(u, x)
        return FitSolution(refined, self.gap(refined))

    def solve(self, signs: Array, deviating: tuple[int, ...] = ()) -> FitSolution:
        """Return the best fit with these signs and deviating joints, from two starts."""
        best: FitSolution | None = None
        for aligned in (False, True):
            if aligned and best is not None and self.holds(best.gap):
                break
            start = self.initial(signs, deviating, aligned)
            if start is None:
                continue
            fit = self.refine(start)
            if best is None or size_of(fit.gap) < size_of(best.gap):
                best = fit
        assert best is not None
        return best

    # -- start values ---------------------------------------------------------------------------------

    def initial(self, signs: Array, deviating: tuple[int, ...], aligned: bool) -> Unknowns | None:
        """Return start values: the base as it is or aligned with the first lines, then each joint from its children."""
        X = np.eye(4)
        if aligned:
            aligned_base = self._aligned_base(signs, deviating)
            if aligned_base is None:
                return None
            X = aligned_base
        groups: dict[int, Array] = {0: X}
        neutral = self.displacements(signs, np.zeros(self.count))
        displacements = neutral.copy()
        deviations = np.zeros((len(deviating), 6))
        for i in self.order:
            axis = self.axes[i]
            if axis.closing:
                continue
            parent = groups[axis.parent]
            if i in deviating:
                parent, values = self._placed_on_target(i, parent, signs)
                deviations[deviating.index(i)] = values
            if self.turned_axis(i) in deviating:
                _, values = self._placed_on_target(i, parent, signs)
                deviations[deviating.index(self.turned_axis(i)), :3] = values[:3]
                groups[axis.child] = parent
                continue
            displacements[i] = self._displacement(i, parent, signs, deviating, neutral[i])
            step = self._about_lines(spatial.exp_so3(self._turns(displacements)), displacements)[i]
            groups[axis.child] = parent @ step
        base = np.concatenate([spatial.log_so3(X[:3, :3]), X[:3, 3]])
        return Unknowns(signs, base, self.zeros(signs, displacements), deviating, deviations)

    def _deviates(self, joint: int, deviating: Sequence[int]) -> bool:
        return joint in deviating or self.turned_axis(joint) in deviating

    def _aligned_base(self, signs: Array, deviating: tuple[int, ...]) -> Array | None:
        """Return the base transform that maps the lines of the first two joints in a chain to their targets."""
        for i in self.order:
            if self._deviates(i, deviating) or self.axes[i].kind == "spherical":
                continue
            for k in (*self.below[i], *self.order):
                if k == i or self._deviates(k, deviating) or self.axes[k].parent not in (0, self.axes[i].child):
                    continue
                own = _pair_frame(
                    self.points[i], signs[i] * self.directions[i], self.points[k], signs[k] * self.directions[k]
                )
                target = _pair_frame(
                    self.target_points[i], self.target_directions[i], self.target_points[k], self.target_directions[k]
                )
                if own is not None and target is not None:
                    return target @ spatial.inverse(own)
        return None

    def _placed_on_target(self, i: int, parent: Array, signs: Array) -> tuple[Array, Array]:
        """Return (motion of the parent with the deviation, deviation (6,)) that puts line i on its target."""
        point, direction = self._line(parent, i, signs)
        target = self.target_directions[i]
        turn = _turn(direction, target)
        if self.kinds[i] == "spherical":
            turn = np.zeros(3)
        # to the nearest point of the target line
        to_line = self.target_points[i] - point
        shift = to_line - target * (to_line @ target)
        if self.kinds[i] == "spherical":
            shift = to_line
        if self.kinds[i] == "prismatic":
            shift = np.zeros(3)
        R = spatial.exp_so3(turn)
        moved = spatial.pose(R, point - R @ point + shift) @ parent
        local = spatial.inverse(parent) @ moved
        frame = self.frames[i]
        rotation = frame.T @ spatial.log_so3(local[:3, :3])
        own_point = self.points[i]
        shift_in_frame = frame.T @ (local[:3, :3] @ own_point + local[:3, 3] - own_point)
        return moved, np.concatenate([rotation, shift_in_frame])

    def _displacement(self, i: int, parent: Array, signs: Array, deviating: tuple[int, ...], neutral: float) -> float:
        """Return the displacement of joint i that best puts the lines of the joints on its child onto their targets."""
        kind = self.kinds[i]
        if kind not in ONE_COORDINATE:
            return neutral
        axis = parent[:3, :3] @ self.directions[i]
        below = self.below[i]
        while below:
            children = [k for k in below if not self._deviates(k, deviating)]
            if kind == "prismatic":
                displacement = self._slide(parent, axis, children)
            else:
                displacement = self._turned(i, parent, axis, children, signs)
            if displacement is not None:
                return displacement
            # no line of these joints changes, as behind a slide along the same axis: those behind them may
            below = [k for child in children for k in self.below[child]]
        return neutral

    def _turned(self, i: int, T: Array, axis: Array, children: list[int], signs: Array) -> float | None:
        """Return the angle about `axis` that brings the lines of the children nearest to their targets, or None."""
        centre = T[:3, :3] @ self.points[i] + T[:3, 3]
        # cost of the angle: constant - a cos - b sin, for directions and for moments about a point of the axis
        a = b = 0.0
        for k in children:
            point, direction = self._line(T, k, signs)
            target_direction = self.target_directions[k]
            vectors = []
            if self.kinds[k] != "spherical":
                vectors.append((direction, target_direction))
            if self.kinds[k] in TURNING:
                moment = _cross(point - centre, direction)
                target_moment = _cross(self.target_points[k] - centre, target_direction)
                vectors.append((moment, target_moment))
            if self.kinds[k] == "spherical":
                vectors.append((point - centre, self.target_points[k] - centre))
            for v, w in vectors:
                across = v - axis * (axis @ v)
                a += float(across @ w)
                b += float(_cross(axis, across) @ w)
        if np.hypot(a, b) < _FLAT:
            return None
        return float(np.arctan2(b, a))

    def _slide(self, T: Array, axis: Array, children: list[int]) -> float | None:
        """Return the displacement along `axis` that brings the lines of the children nearest to their targets."""
        a = b = 0.0
        for k in children:
            if self.kinds[k] not in TURNING and self.kinds[k] != "spherical":
                continue
            point = T[:3, :3] @ self.points[k] + T[:3, 3]
            to_target = self.target_points[k] - point
            direction = self.target_directions[k]
            along = _cross(axis, direction)
            needed = _cross(to_target, direction)
            if self.kinds[k] == "spherical":
                along = axis
                needed = to_target
            a += float(along @ along)
            b += float(along @ needed)
        if a < _FLAT:
            return None
        return b / a


def _ahead(directions: Array, target: Array) -> Array:
    """Return directions (..., 3), those turned around that point backward along a target direction (3,)."""
    backward = directions @ target < 0.0
    return np.where(np.asarray(backward)[..., None], -directions, directions)


def _cross(a: Array, b: Array) -> Array:
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


def open_directions(J: Array) -> Array:
    """Return orthonormal directions (unknowns, k) that the derivatives J (rows, unknowns) do not determine."""
    if not J.size:
        return np.eye(J.shape[1])
    Q, R, _ = cast(tuple[Array, Array, Array], linalg.qr(J.T, pivoting=True))
    strengths = np.abs(np.diag(R))
    rank = int(np.sum(strengths > _RANK * max(float(strengths[0]), 1e-12)))
    return Q[:, rank:]


@lru_cache(maxsize=64)
def _tree(joints: tuple[tuple[int, int, bool], ...]) -> tuple[list[int], list[list[int]]]:
    """Return (order, below) of joints (parent, child, closes a loop).

    `order` has the joints of the tree first, parents first; `below` for each joint those that start at its child,
    without those that close a loop. Edits make many problems with the same joints.
    """
    reached = {0}
    order: list[int] = []
    closing = [i for i, joint in enumerate(joints) if joint[2]]
    pending = [i for i, joint in enumerate(joints) if not joint[2]]
    while pending:
        ready = [i for i in pending if joints[i][0] in reached]
        if not ready:
            break
        for i in ready:
            order.append(i)
            reached.add(joints[i][1])
            pending.remove(i)
    order += closing
    below: list[list[int]] = []
    for _, child, closes in joints:
        below.append([k for k in order if joints[k][0] == child and not closes])
    return order, below


def _turn(direction: Array, target: Array) -> Array:
    """Return the rotation vector (3,) of the smallest rotation from one unit vector to another."""
    cross = _cross(direction, target)
    sine = float(np.linalg.norm(cross))
    cosine = float(direction @ target)
    if sine < 1e-12:
        if cosine > 0:
            return np.zeros(3)
        across = spatial.unit_across(direction)
        across = across - direction * (direction @ across)
        return np.pi * across / np.linalg.norm(across)
    return np.arctan2(sine, cosine) * cross / sine


def _pair_frame(p: Array, d: Array, q: Array, e: Array) -> Array | None:
    """Return a frame (4, 4) fixed to two lines (p, d) and (q, e); None if they are the same line."""
    normal = _cross(d, e)
    sine = np.linalg.norm(normal)
    between = q - p
    if sine > 1e-6:
        # foot of the common normal on the first line
        along = _cross(e, normal) @ between / sine**2
        return spatial.pose(spatial.frame_from_axes(d, normal), p + along * d)
    across = between - d * (d @ between)
    if np.linalg.norm(across) < 1e-6:
        return None
    return spatial.pose(spatial.frame_from_axes(d, across), p)


def values_of(u: Unknowns) -> Array:
    """Return the values (unknowns,) of a fit: base, zeros, deviations."""
    parts = [u.base, u.zeros]
    if u.deviations is not None:
        parts.append(u.deviations.ravel())
    return np.concatenate(parts)


def with_values(u: Unknowns, x: Array) -> Unknowns:
    """Return unknowns with other values (unknowns,), see `values_of`."""
    count = len(u.zeros)
    deviations = x[6 + count :].reshape(-1, 6)
    return replace(u, base=x[:6], zeros=x[6 : 6 + count], deviations=deviations)


def size_of(gap: FitGap) -> float:
    """Return the sum of all distances and angles of a gap."""
    return float(np.sum(gap.distances) + np.sum(gap.angles))
