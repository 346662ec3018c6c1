"""Loop closures as residuals over the tree: all loops and all samples at once, in numpy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin import spatial
from twin.mechanism import Joint
from twin.spatial import Array

LENGTH_SCALE = 0.1
"""Metres of misfit that weigh as much as one radian of it."""

AXES = ("offset x", "offset y", "offset z", "turn x", "turn y", "turn z")
"""What a row of the residual locks, along and about the axes of the loop joint's frame on its parent."""


class Loops:
    """Loop closures: the relative pose of a loop joint's two frames must be free motion only.

    Rows of the residual, in file order of the loops: offset in m along the locked translations, then the
    locked rotations in rad times `LENGTH_SCALE`.

    Attributes:
        joints: the loop joints.
        row_loop: number of the loop of each row (m,).
        row_axis: which of `AXES` each row locks (m,).
        joint_numbers: Pinocchio's numbers of the joints that carry the ends.
    """

    def __init__(self, joints: tuple[Joint, ...], body: Mapping[str, tuple[int, Array]], mask: Array) -> None:
        self.joints = joints
        ends = [(body[j.parent], body[j.child]) for j in joints]
        self._ids = np.array([[a[0], b[0]] for a, b in ends], int).reshape(-1, 2)
        self.joint_numbers = set(self._ids.reshape(-1).tolist())
        self._T0 = _stack([a[1] @ j.T_parent_joint for j, (a, _) in zip(joints, ends, strict=True)])
        self._T1 = _stack([b[1] @ j.T_child_joint for j, (_, b) in zip(joints, ends, strict=True)])
        # A velocity moves the loop's gap if it moves one end but not the other, or both apart.
        self._mask = (mask[self._ids[:, 1]] - mask[self._ids[:, 0]])[:, None, :]
        self._full = np.array([j.type in ("fixed", "prismatic") for j in joints], bool)
        locked = np.array([[axis not in j.free_axes for axis in range(6)] for j in joints], bool)
        self._locked = locked.reshape(-1)
        self.row_loop = np.repeat(np.arange(len(joints)), 6)[self._locked]
        self.row_axis = np.tile(np.arange(6), len(joints))[self._locked]

    def relative(self, poses: Array) -> tuple[Array, Array]:
        """Return the parent joint frames in base and the child joint frames in them, each (k, loops, 4, 4)."""
        T_base_0 = poses[:, self._ids[:, 0]] @ self._T0
        return T_base_0, spatial.inverse(T_base_0) @ (poses[:, self._ids[:, 1]] @ self._T1)

    def evaluate(self, poses: Array, J: Array) -> tuple[Array, Array]:
        """Return residuals (k, m) and Jacobians (k, m, nv) for the poses and Jacobians of the tree."""
        T0, T = self.relative(poses)
        residual, turn = self._residual(T)
        k, count = T.shape[:2]
        R0t, p0 = np.swapaxes(T0[..., :3, :3], -1, -2), T0[..., :3, 3]
        # From a relative twist at the base origin to the rates of the offset and of the locked rotations.
        rows = np.zeros((k, count, 6, 6))
        rows[..., :3, :3] = R0t
        rows[..., :3, 3:] = -(R0t @ spatial.hat(p0)) - spatial.hat(T[..., :3, 3]) @ R0t
        rows[..., 3:, 3:] = LENGTH_SCALE * (turn @ R0t)
        A = rows @ (J[:, None] * self._mask)
        return residual.reshape(k, 6 * count)[:, self._locked], A.reshape(k, 6 * count, J.shape[-1])[:, self._locked]

    def _residual(self, T: Array) -> tuple[Array, Array]:
        """Return residuals (k, loops, 6) and the derivative (k, loops, 3, 3) of the locked rotations.

        Two axes must be parallel: the tilt of z is the residual, whatever the turn about it. A fixed or
        prismatic joint locks all three: half the antisymmetric part of R, the sine of the angle.
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
        residual[..., 3:] *= LENGTH_SCALE
        return residual, turn

    def gaps(self, poses: Array) -> Array:
        """Return (k, loops, 2): offset in m and misalignment in rad in the locked directions."""
        residual, _ = self._residual(self.relative(poses)[1])
        residual = residual * self._locked.reshape(-1, 6)
        offset = np.linalg.norm(residual[..., :3], axis=-1)
        return np.stack([offset, np.linalg.norm(residual[..., 3:], axis=-1) / LENGTH_SCALE], axis=-1)

    def coordinates(self, poses: Array) -> dict[str, Array]:
        """Return the coordinate (k,) in m or rad of each loop joint that has one."""
        _, T = self.relative(poses)
        out = {}
        for i, joint in enumerate(self.joints):
            if joint.type == "revolute":
                out[joint.name] = about_z(T[:, i])
            elif joint.type == "prismatic":
                out[joint.name] = T[:, i, 2, 3]
        return out


def about_z(T: Array) -> Array:
    """Return the angle (...) in rad about z of poses (..., 4, 4) that turn about z, nearly."""
    return np.arctan2(T[..., 1, 0] - T[..., 0, 1], T[..., 0, 0] + T[..., 1, 1])


def sine_of_rotation(R: Array) -> tuple[Array, Array]:
    """Return axis times sine of the angle (..., 3) of R, and its derivative (..., 3, 3) by the rotation."""
    sine = 0.5 * np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    trace = np.trace(R, axis1=-2, axis2=-1)[..., None, None]
    return sine, 0.5 * (trace * np.eye(3) - R)


def _stack(poses: list[Array]) -> Array:
    return np.array(poses).reshape(-1, 4, 4)
