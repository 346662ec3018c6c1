"""Loop closures as residuals on the spanning tree, for all loops and all samples at once, in NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.model.joint import Joint

LENGTH_SCALE = 0.1
"""Length in m by which angles in rad are multiplied in residuals."""

AXES = ("offset x", "offset y", "offset z", "turn x", "turn y", "turn z", "sum")
"""Directions locked by rows of the residual: along and about the axes of the loop joint's frame on its parent body."""


_SMALLEST_SINE = 1e-9
"""Sine of a locked rotation up to which it does not determine the axis of the rotation."""

_SMALLEST_DIVISOR = 1e-3
"""Smallest sine by which the derivative of the axis is divided: near half a turn, the axis turns arbitrarily fast."""

_ANGULAR_LINEAR_ANGULAR = np.array([3, 4, 5, 0, 1, 2, 3, 4, 5])
_LINEAR_ANGULAR_ANGULAR = np.array([0, 1, 2, 3, 4, 5, 3, 4, 5])
"""Places of the parts of motion vectors whose cross products make up `cross_motions`."""


@dataclass(frozen=True)
class TreeCoupling:
    """A linear coupling of tree joints: the sum of `ratios` times joint values equals `total`, in rad or m.

    `places` are the configuration indices of the joints, `columns` their velocity indices. `angle`: whether the first
    joint is an angle.
    """

    name: str
    places: Index
    columns: Index
    ratios: Array
    total: float
    angle: bool


class Loops:
    """Loop closures: the two frames of a loop joint may differ only in the free directions of the joint.

    Couplings are included.

    Rows of the residual: for each loop, in file order, the offsets in m along the locked directions, then the locked
    rotations in rad times `LENGTH_SCALE`; finally, one row for each coupling.

    Attributes:
        joints: the loop joints.
        names: names of loop joints and couplings, in the order used by `row_loop`.
        row_loop: (m,) index in `names` of the loop or coupling of each row.
        row_axis: (m,) index in `AXES` of the direction that each row locks ("sum": a coupling).
        joint_numbers: Pinocchio numbers of the tree joints that carry the two frames of each loop joint.
    """

    def __init__(
        self,
        joints: tuple[Joint, ...],
        body: Mapping[str, tuple[int, Array]],
        mask: Array,
        couplings: tuple[TreeCoupling, ...] = (),
    ) -> None:
        """Store where the frames of all loop joints are, and which rows of the residual exist.

        Args:
            joints: the loop joints.
            body: {body: (number of the tree joint that carries it, its pose (4, 4) in the frame of this joint)}.
            mask: (tree joints, nv) 1 where a velocity moves a tree joint, else 0.
            couplings: the couplings of tree joints.
        """
        self.joints = joints
        self.couplings = couplings
        names = []
        joint_numbers = []
        Ts_parent_joint = []
        Ts_child_joint = []
        locks_rotation = []
        locked = []
        for joint in joints:
            names.append(joint.name)
            parent_number, T_joint_parent = body[joint.parent]
            child_number, T_joint_child = body[joint.child]
            joint_numbers.append((parent_number, child_number))
            Ts_parent_joint.append(T_joint_parent @ joint.T_parent_joint)
            Ts_child_joint.append(T_joint_child @ joint.T_child_joint)
            locks_rotation.append(joint.type in ("fixed", "prismatic"))
            for axis in range(6):
                locked.append(axis not in joint.free_axes)
        for coupling in couplings:
            names.append(coupling.name)
        self.names = tuple(names)
        self._joint_pairs = np.array(joint_numbers, int).reshape(-1, 2)
        self.joint_numbers = set(self._joint_pairs.reshape(-1).tolist())
        self._Ts_parent_joint = _stack(Ts_parent_joint)
        self._Ts_child_joint = _stack(Ts_child_joint)
        # A velocity changes the gap of a loop if it moves one of the frames but not the other.
        moved_0 = mask[self._joint_pairs[:, 0]]
        moved_1 = mask[self._joint_pairs[:, 1]]
        self._moving_sign = (moved_1 - moved_0)[:, None, :]
        self._locks_rotation = np.array(locks_rotation, bool)
        self._locked = np.array(locked, bool)
        # Each loop has six possible rows, of which the locked ones remain; each coupling adds one row at the end.
        loop_of_row = np.repeat(np.arange(len(joints)), 6)[self._locked]
        axis_of_row = np.tile(np.arange(6), len(joints))[self._locked]
        coupled = np.arange(len(joints), len(self.names))
        self.row_loop = np.concatenate([loop_of_row, coupled])
        self.row_axis = np.concatenate([axis_of_row, np.full(len(coupled), 6)])

    def relative(self, poses: Array) -> tuple[Array, Array]:
        """Return (T_base_parent, T_parent_child) of the joint frames, each (k, loops, 4, 4)."""
        Ts_base_parent = poses[:, self._joint_pairs[:, 0]] @ self._Ts_parent_joint
        Ts_base_child = poses[:, self._joint_pairs[:, 1]] @ self._Ts_child_joint
        return Ts_base_parent, spatial.inverse(Ts_base_parent) @ Ts_base_child

    def evaluate(self, X: Array, poses: Array, J: Array) -> tuple[Array, Array]:
        """Return residuals (k, m) and Jacobians (k, m, nv).

        X (k, nq) are configurations; `poses` (k, joints, 4, 4) and J (k, 6, nv) come from `Tree.update` at X.
        """
        T0, T = self.relative(poses)
        return self.evaluate_at(X, T0, T, J)

    def evaluate_at(self, X: Array, T0: Array, T: Array, J: Array) -> tuple[Array, Array]:
        """Return what `evaluate` returns, for frames T0 and T (k, loops, 4, 4) of `relative`."""
        residual, turn = self._residual(T)
        k, count = T.shape[:2]
        nv = J.shape[-1]
        R0t = np.swapaxes(T0[..., :3, :3], -1, -2)
        p0 = T0[..., :3, 3]
        offset = T[..., :3, 3]
        # Matrix from a relative twist at the base origin to the rates of the offset and of the locked rotations.
        rates = np.zeros((k, count, 6, 6))
        rates[..., :3, :3] = R0t
        rates[..., :3, 3:] = -(R0t @ spatial.hat(p0)) - spatial.hat(offset) @ R0t
        rates[..., 3:, 3:] = LENGTH_SCALE * (turn @ R0t)
        A = rates @ (J[:, None] * self._moving_sign)
        A = A.reshape(k, 6 * count, nv)[:, self._locked]
        r = residual.reshape(k, 6 * count)[:, self._locked]
        if not self.couplings:
            return r, A
        coupled = np.zeros((k, len(self.couplings), nv))
        scale = np.ones(len(self.couplings))
        for i, coupling in enumerate(self.couplings):
            if coupling.angle:
                scale[i] = LENGTH_SCALE
            coupled[:, i, coupling.columns] = coupling.ratios * scale[i]
        sums = self._sums(X) * scale
        return np.concatenate([r, sums], axis=1), np.concatenate([A, coupled], axis=1)

    def drift(self, T0: Array, T: Array, twists: Array, biases: Array) -> Array:
        """Return the second time derivative (k, m) of the residual if all velocities of the tree are constant.

        Frame 0 of a loop joint is on its parent, frame 1 on its child. The motion of frame 1 is described as seen from
        frame 0, whose own motion is subtracted: its relative twist is x1 - x0, and the spatial acceleration relative to
        frame 0 is b1 - b0 - cross_motions(x0, x1), where x are twists and b spatial accelerations (Featherstone 2008,
        section 2.10). In the axes and at the origin of frame 0, with v, w of the relative twist and a, c of the
        relative acceleration, a point p of frame 1 moves by p' = v + w x p and p'' = a + c x p + w x p', a direction e
        of frame 1 by e' = w x e and e'' = c x e + w x e'.

        T0 and T (k, loops, 4, 4) are the frames of `relative`. `twists` (k, joints, 6) are the twists of the tree's
        joints, `biases` (k, joints, 6) the spatial accelerations of these joints at constant velocities; both are in
        base at the base origin, linear part first.
        """
        k, count = T.shape[:2]
        pairs = twists[:, self._joint_pairs]  # (k, loops, 2, 6), of frames 0 and 1
        bias_pairs = biases[:, self._joint_pairs]
        motions = np.zeros((k, count, 2, 2, 3))  # relative twist and acceleration; linear and angular part
        of_both = motions.reshape(k, count, 2, 6)
        of_both[:, :, 0] = pairs[:, :, 1] - pairs[:, :, 0]
        of_both[:, :, 1] = bias_pairs[:, :, 1] - bias_pairs[:, :, 0] - cross_motions(pairs[:, :, 0], pairs[:, :, 1])
        # to the origin of frame 0, then to its axes; a row times R0 is R0^T times a column
        motions[:, :, :, 0] += cross_products(motions[:, :, :, 1], T0[:, :, None, :3, 3])
        in_frame = motions.reshape(k, count, 4, 3) @ T0[..., :3, :3]
        v = in_frame[:, :, 0]
        w = in_frame[:, :, 1, None]
        a = in_frame[:, :, 2]
        c = in_frame[:, :, 3, None]
        # in frame 0, the origin of frame 1 and the direction of its z axis
        ends = T[..., :3, 3:1:-1].swapaxes(-1, -2)
        rates = cross_products(w, ends)
        rates[:, :, 0] += v
        changes = cross_products(c, ends) + cross_products(w, rates)
        changes[:, :, 0] += a
        rows = np.zeros((k, count, 6))
        rows[:, :, :3] = changes[:, :, 0]
        rows[:, :, 3] = -changes[:, :, 1, 1]  # see `_residual`
        rows[:, :, 4] = changes[:, :, 1, 0]
        if self._locks_rotation.any():
            columns = T[:, self._locks_rotation, :3, :3].swapaxes(-1, -2)  # the axes of frame 1, row by row
            w = w[:, self._locks_rotation]
            column_changes = cross_products(c[:, self._locks_rotation], columns)
            column_changes = column_changes + cross_products(w, cross_products(w, columns))
            rows[:, self._locks_rotation, 3:], _ = sine_of_rotation(column_changes.swapaxes(-1, -2))
        rows[:, :, 3:] *= LENGTH_SCALE
        rows = rows.reshape(k, 6 * count)[:, self._locked]
        if not self.couplings:
            return rows
        # the ratios of a coupling are constant: no drift
        return np.concatenate([rows, np.zeros((k, len(self.couplings)))], axis=1)

    def _sums(self, X: Array) -> Array:
        """Return the errors (k, couplings) in rad or m of the couplings: weighted sum of joints minus constant."""
        if not self.couplings:
            return np.zeros((len(X), 0))
        errors = []
        for coupling in self.couplings:
            total = X[:, coupling.places] @ coupling.ratios
            errors.append(total - coupling.total)
        return np.stack(errors, axis=1)

    def _residual(self, T: Array) -> tuple[Array, Array]:
        """Return (residuals (k, loops, 6), derivatives (k, loops, 3, 3) of the locked rotations).

        For a joint that only keeps its two z axes parallel, the rotation residual is the tilt between these axes,
        independent of the rotation about z. For a fixed or prismatic joint, which locks all three rotations, the
        residual is half the antisymmetric part of R: rotation axis times sine of the angle. Beyond 90°, where the sine
        decreases, the residual is continued as an increasing function, so that no joint converges to an inverted state.
        """
        R = T[..., :3, :3]
        # the z axis of frame 1 in frame 0; for small tilts, the rotations about x and y are -zy and zx
        zx = R[..., 0, 2]
        zy = R[..., 1, 2]
        zz = R[..., 2, 2]
        residual = np.zeros((*T.shape[:2], 6))
        residual[..., :3] = T[..., :3, 3]
        residual[..., 3] = -zy
        residual[..., 4] = zx
        turn = np.zeros((*T.shape[:2], 3, 3))
        turn[..., 0, 0] = zz
        turn[..., 1, 1] = zz
        turn[..., 0, 2] = -zx
        turn[..., 1, 2] = -zy
        if self._locks_rotation.any():
            sine, change = sine_of_rotation(R[:, self._locks_rotation])
            residual[:, self._locks_rotation, 3:] = sine
            turn[:, self._locks_rotation] = change
        cosine = self._cosine(R)
        beyond = cosine < 0  # 90 degrees
        if beyond.any():
            sine, change = _continued_beyond_right_angle(residual[beyond, 3:], turn[beyond], cosine[beyond])
            residual[beyond, 3:] = sine
            turn[beyond] = change
        residual[..., 3:] *= LENGTH_SCALE
        return residual, turn

    def _cosine(self, T: Array) -> Array:
        """Return the cosine (k, loops) of the locked rotation angle of T (k, loops, 3 or 4, 3 or 4)."""
        xx = T[..., 0, 0]
        yy = T[..., 1, 1]
        zz = T[..., 2, 2]
        trace = xx + yy + zz
        return np.where(self._locks_rotation, 0.5 * (trace - 1), zz)

    def gaps(self, X: Array, poses: Array) -> Array:
        """Return the gaps (k, names, 2): offset in m and rotation in rad in the locked directions; couplings last."""
        _, T = self.relative(poses)
        locked = self._locked.reshape(-1, 6)
        residual, _ = self._residual(T)
        residual = residual * locked
        offset = np.linalg.norm(residual[..., :3], axis=-1)
        size = np.linalg.norm(residual[..., 3:], axis=-1) / LENGTH_SCALE
        cosine = self._cosine(T)
        sine = np.where(cosine < 0, 2 - size, size)  # see `_residual`
        turns_locked = locked[:, 3:].any(axis=1)
        angle = np.where(turns_locked, np.arctan2(sine, cosine), 0.0)
        gaps = np.stack([offset, angle], axis=-1)
        if not self.couplings:
            return gaps
        error = np.abs(self._sums(X))
        is_angle = np.array([coupling.angle for coupling in self.couplings])
        coupled = np.stack([error * ~is_angle, error * is_angle], axis=-1)
        return np.concatenate([gaps, coupled], axis=1)

    def coordinates(self, poses: Array) -> dict[str, Array]:
        """Return {name: coordinate (k,) in m or rad} of the revolute and prismatic loop joints."""
        _, T = self.relative(poses)
        coordinates = {}
        for i, joint in enumerate(self.joints):
            if joint.type == "revolute":
                coordinates[joint.name] = joint.angle(T[:, i])
            elif joint.type == "prismatic":
                coordinates[joint.name] = T[:, i, 2, 3]
        return coordinates


def sine_of_rotation(R: Array) -> tuple[Array, Array]:
    """Return (axis times sine of the angle (..., 3) of R, its derivative (..., 3, 3) with respect to the rotation)."""
    x = R[..., 2, 1] - R[..., 1, 2]
    y = R[..., 0, 2] - R[..., 2, 0]
    z = R[..., 1, 0] - R[..., 0, 1]
    sine = 0.5 * np.stack([x, y, z], axis=-1)
    trace = np.trace(R, axis1=-2, axis2=-1)[..., None, None]
    return sine, 0.5 * (trace * np.eye(3) - R)


def _continued_beyond_right_angle(sine: Array, turn: Array, cosine: Array) -> tuple[Array, Array]:
    """Return axis times (2 - sine) for angles beyond 90°, and its derivative with respect to the rotation.

    `sine` (n, 3) is the axis times the sine of the angle, `turn` (n, 3, 3) its derivative, and `cosine` (n,) the cosine
    of the angle.
    """
    size = np.linalg.norm(sine, axis=-1)
    column = size[:, None]
    matrix = size[:, None, None]
    # At an angle of 180°, the sine does not determine the axis: use any axis.
    some_axis = np.eye(3)[0]
    axis = np.where(column > _SMALLEST_SINE, sine / np.maximum(column, _SMALLEST_SINE), some_axis)
    along = cosine[:, None, None] * axis[:, :, None] * axis[:, None, :]
    swing = (turn - along) / np.maximum(matrix, _SMALLEST_DIVISOR)
    return axis * (2 - column), (2 - matrix) * swing - along


def point_acceleration(twists: Array, biases: Array, p: Array) -> Array:
    """Return the accelerations (..., 3) of points p (..., 3) fixed to bodies.

    Twists and spatial accelerations (..., 6) are at the origin of the frame in which p is given, linear part first.
    Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 2.11.
    """
    w = twists[..., 3:]
    velocity = twists[..., :3] + cross_products(w, p)
    euler = cross_products(biases[..., 3:], p)
    acceleration = biases[..., :3] + euler + cross_products(w, velocity)
    return np.asarray(acceleration, float)


def cross_products(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3); for few vectors, in a third of the time of `numpy.cross`."""
    # each factor twice in a row, so that its cyclic permutations are slices
    aa = np.concatenate((a, a), axis=-1)
    bb = np.concatenate((b, b), axis=-1)
    return aa[..., 1:4] * bb[..., 2:5] - aa[..., 2:5] * bb[..., 1:4]


def cross_motions(a: Array, b: Array) -> Array:
    """Return the rates of change (..., 6) of motion vectors b (..., 6) that are fixed to bodies with twists a (..., 6).

    Linear parts are first. Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 2.9.
    """
    # the three products w x v, v x w and w x w at once
    of_a = a[..., _ANGULAR_LINEAR_ANGULAR].reshape(*a.shape[:-1], 3, 3)
    of_b = b[..., _LINEAR_ANGULAR_ANGULAR].reshape(*b.shape[:-1], 3, 3)
    products = cross_products(of_a, of_b)
    linear = products[..., 0, :] + products[..., 1, :]
    return np.concatenate((linear, products[..., 2, :]), axis=-1)


def _stack(poses: list[Array]) -> Array:
    return np.array(poses).reshape(-1, 4, 4)
