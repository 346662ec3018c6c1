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


@dataclass(frozen=True)
class Coupled:
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
        couplings: tuple[Coupled, ...] = (),
    ) -> None:
        self.joints, self.couplings = joints, couplings
        self.names = (*(j.name for j in joints), *(c.name for c in couplings))
        ends = [(body[j.parent], body[j.child]) for j in joints]
        self._ids = np.array([[a[0], b[0]] for a, b in ends], int).reshape(-1, 2)
        self.joint_numbers = set(self._ids.reshape(-1).tolist())
        self._T0 = _stack([a[1] @ j.T_parent_joint for j, (a, _) in zip(joints, ends, strict=True)])
        self._T1 = _stack([b[1] @ j.T_child_joint for j, (_, b) in zip(joints, ends, strict=True)])
        # A velocity changes the gap of a loop if it moves one of the frames but not the other.
        self._mask = (mask[self._ids[:, 1]] - mask[self._ids[:, 0]])[:, None, :]
        self._full = np.array([j.type in ("fixed", "prismatic") for j in joints], bool)
        locked = np.array([[axis not in j.free_axes for axis in range(6)] for j in joints], bool)
        self._locked = locked.reshape(-1)
        extra = np.arange(len(joints), len(self.names))
        self.row_loop = np.concatenate([np.repeat(np.arange(len(joints)), 6)[self._locked], extra])
        self.row_axis = np.concatenate([np.tile(np.arange(6), len(joints))[self._locked], np.full(len(extra), 6)])

    def relative(self, poses: Array) -> tuple[Array, Array]:
        """Return (T_base_parent, T_parent_child) of the joint frames, each (k, loops, 4, 4)."""
        T_base_0 = poses[:, self._ids[:, 0]] @ self._T0
        return T_base_0, spatial.inverse(T_base_0) @ (poses[:, self._ids[:, 1]] @ self._T1)

    def evaluate(self, X: Array, poses: Array, J: Array) -> tuple[Array, Array]:
        """Return residuals (k, m) and Jacobians (k, m, nv).

        X (k, nq) are configurations; `poses` (k, joints, 4, 4) and J (k, 6, nv) come from `Tree.update` at X.
        """
        T0, T = self.relative(poses)
        residual, turn = self._residual(T)
        k, count = T.shape[:2]
        R0t, p0 = np.swapaxes(T0[..., :3, :3], -1, -2), T0[..., :3, 3]
        # Matrix from a relative twist at the base origin to the rates of the offset and of the locked rotations.
        rows = np.zeros((k, count, 6, 6))
        rows[..., :3, :3] = R0t
        rows[..., :3, 3:] = -(R0t @ spatial.hat(p0)) - spatial.hat(T[..., :3, 3]) @ R0t
        rows[..., 3:, 3:] = LENGTH_SCALE * (turn @ R0t)
        A = rows @ (J[:, None] * self._mask)
        r, A = residual.reshape(k, 6 * count)[:, self._locked], A.reshape(k, 6 * count, J.shape[-1])[:, self._locked]
        if not self.couplings:
            return r, A
        rows = np.zeros((k, len(self.couplings), J.shape[-1]))
        for i, c in enumerate(self.couplings):
            rows[:, i, c.columns] = c.ratios * (LENGTH_SCALE if c.angle else 1.0)
        scale = np.array([LENGTH_SCALE if c.angle else 1.0 for c in self.couplings])
        return np.concatenate([r, self._sums(X) * scale], axis=1), np.concatenate([A, rows], axis=1)

    def drift(self, poses: Array, twists: Array, biases: Array) -> Array:
        """Return the second time derivative (k, m) of the residual of closed loops if all velocities are constant.

        Frame 0 of a loop joint is on its parent, frame 1 on its child. The residual contains the offset R0^T (p1 - p0)
        and the rotation R = R0^T R1, both in the axes of frame 0, which rotate with the angular velocity w0. The second
        derivative of R is (hat(dw/dt) + hat(w)^2) R, where w is the angular velocity of frame 1 relative to frame 0.
        `poses` (k, joints, 4, 4) come from `Tree.update`. `twists` (k, joints, 6) are the twists of the tree's joints,
        `biases` (k, joints, 6) the spatial accelerations of these joints at constant velocities; both are in base at
        the base origin, linear part first.
        """
        T0, T = self.relative(poses)
        (a, b), R0t = (self._ids[:, 0], self._ids[:, 1]), np.swapaxes(T0[..., :3, :3], -1, -2)
        p0 = T0[..., :3, 3]
        p1 = p0 + np.einsum("...ji,...j->...i", R0t, T[..., :3, 3])
        w0, w, d = twists[:, a, 3:], twists[:, b, 3:] - twists[:, a, 3:], p1 - p0
        speed = twists[:, b, :3] + _cross(twists[:, b, 3:], p1) - twists[:, a, :3] - _cross(w0, p0)
        gain = point_acceleration(twists[:, b], biases[:, b], p1)
        gain = gain - point_acceleration(twists[:, a], biases[:, a], p0)
        # In axes that rotate with w0: subtract the Euler, Coriolis and centrifugal accelerations.
        gain -= _cross(biases[:, a, 3:], d) + 2 * _cross(w0, speed) - _cross(w0, _cross(w0, d))
        change = biases[:, b, 3:] - biases[:, a, 3:] - _cross(w0, w)
        gain, w, change = (np.einsum("...ij,...j->...i", R0t, v) for v in (gain, w, change))
        spin = spatial.hat(w)
        R = (spatial.hat(change) + spin @ spin) @ T[..., :3, :3]
        turn = np.stack([-R[..., 1, 2], R[..., 0, 2], np.zeros(R.shape[:2])], axis=-1)
        turn[:, self._full] = sine_of_rotation(R[:, self._full])[0]
        rows = np.concatenate([gain, LENGTH_SCALE * turn], axis=-1).reshape(len(poses), -1)[:, self._locked]
        return np.concatenate([rows, np.zeros((len(rows), len(self.couplings)))], axis=1)

    def _sums(self, X: Array) -> Array:
        """Return the errors (k, couplings) in rad or m of the couplings: weighted sum of joints minus constant."""
        off = [X[:, c.places] @ c.ratios - c.total for c in self.couplings]
        return np.stack(off, axis=1) if off else np.zeros((len(X), 0))

    def _residual(self, T: Array) -> tuple[Array, Array]:
        """Return (residuals (k, loops, 6), derivatives (k, loops, 3, 3) of the locked rotations).

        For a joint that only keeps its two z axes parallel, the rotation residual is the tilt between these axes,
        independent of the rotation about z. For a fixed or prismatic joint, which locks all three rotations, the
        residual is half the antisymmetric part of R: rotation axis times sine of the angle. Beyond 90°, where the sine
        decreases, the residual is continued as an increasing function, so that no joint converges to an inverted state.
        """
        R = T[..., :3, :3]
        residual = np.zeros((*T.shape[:2], 6))
        residual[..., :3] = T[..., :3, 3]
        residual[..., 3], residual[..., 4] = -R[..., 1, 2], R[..., 0, 2]
        turn = np.zeros((*T.shape[:2], 3, 3))
        turn[..., 0, 0] = turn[..., 1, 1] = R[..., 2, 2]
        turn[..., 0, 2], turn[..., 1, 2] = -R[..., 0, 2], -R[..., 1, 2]
        if self._full.any():
            residual[:, self._full, 3:], turn[:, self._full] = sine_of_rotation(R[:, self._full])
        beyond = self._cosine(R) < 0
        if beyond.any():
            residual[beyond, 3:], turn[beyond] = _grown(residual[beyond, 3:], turn[beyond], self._cosine(R)[beyond])
        residual[..., 3:] *= LENGTH_SCALE
        return residual, turn

    def _cosine(self, T: Array) -> Array:
        """Return the cosine (k, loops) of the locked rotation angle of T (k, loops, 3 or 4, 3 or 4)."""
        trace = T[..., 0, 0] + T[..., 1, 1] + T[..., 2, 2]
        return np.where(self._full, 0.5 * (trace - 1), T[..., 2, 2])

    def gaps(self, X: Array, poses: Array) -> Array:
        """Return the gaps (k, names, 2): offset in m and rotation in rad in the locked directions; couplings last."""
        T = self.relative(poses)[1]
        locked = self._locked.reshape(-1, 6)
        residual = self._residual(T)[0] * locked
        offset = np.linalg.norm(residual[..., :3], axis=-1)
        size, cosine = np.linalg.norm(residual[..., 3:], axis=-1) / LENGTH_SCALE, self._cosine(T)
        sine = np.where(cosine < 0, 2 - size, size)  # see `_residual`
        angle = np.where(locked[:, 3:].any(axis=1), np.arctan2(sine, cosine), 0.0)
        out = np.stack([offset, angle], axis=-1)
        if not self.couplings:
            return out
        off = np.abs(self._sums(X))
        angle = np.array([c.angle for c in self.couplings])
        return np.concatenate([out, np.stack([off * ~angle, off * angle], axis=-1)], axis=1)

    def coordinates(self, poses: Array) -> dict[str, Array]:
        """Return {name: coordinate (k,) in m or rad} of the revolute and prismatic loop joints."""
        _, T = self.relative(poses)
        out = {}
        for i, joint in enumerate(self.joints):
            if joint.type == "revolute":
                out[joint.name] = joint.angle(T[:, i])
            elif joint.type == "prismatic":
                out[joint.name] = T[:, i, 2, 3]
        return out


def sine_of_rotation(R: Array) -> tuple[Array, Array]:
    """Return (axis times sine of the angle (..., 3) of R, its derivative (..., 3, 3) with respect to the rotation)."""
    sine = 0.5 * np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    trace = np.trace(R, axis1=-2, axis2=-1)[..., None, None]
    return sine, 0.5 * (trace * np.eye(3) - R)


def _grown(sine: Array, turn: Array, cosine: Array) -> tuple[Array, Array]:
    """Return axis times (2 - sine) for angles beyond 90°, and its derivative with respect to the rotation.

    `sine` (n, 3) is the axis times the sine of the angle, `turn` (n, 3, 3) its derivative, and `cosine` (n,) the cosine
    of the angle.
    """
    size = np.linalg.norm(sine, axis=-1)
    # At an angle of 180°, the sine does not determine the axis: use any axis.
    axis = np.where(size[:, None] > 1e-9, sine / np.maximum(size, 1e-9)[:, None], np.eye(3)[0])
    along = cosine[:, None, None] * axis[:, :, None] * axis[:, None, :]
    swing = (turn - along) / np.maximum(size, 1e-3)[:, None, None]
    return axis * (2 - size)[:, None], (2 - size)[:, None, None] * swing - along


def point_acceleration(twists: Array, biases: Array, p: Array) -> Array:
    """Return the accelerations (..., 3) of points p (..., 3) fixed to bodies.

    Twists and spatial accelerations (..., 6) are at the origin of the frame in which p is given, linear part first.
    Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 2.11.
    """
    w = twists[..., 3:]
    velocity = twists[..., :3] + _cross(w, p)
    return np.asarray(biases[..., :3] + _cross(biases[..., 3:], p) + _cross(w, velocity), float)


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3); faster than `numpy.cross` for few vectors."""
    return (spatial.hat(a) @ b[..., None])[..., 0]


def _stack(poses: list[Array]) -> Array:
    return np.array(poses).reshape(-1, 4, 4)
