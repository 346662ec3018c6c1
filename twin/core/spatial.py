"""SE(3) and SO(3) with NumPy, and the distance from a point to a line.

Poses are float64 (..., 4, 4); `T_a_b` is the pose of b in a. Rotation vectors are axis times angle in rad. In twists,
the linear rows are first. In the shapes, `...` stands for any leading batch axes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

Index = NDArray[np.intp]
"""Array of integer indices (of samples, joints, ...)."""

_IDENTITY = np.eye(3)
_IDENTITY.flags.writeable = False

_SMALL_ANGLE = 1e-8
"""Angle in rad below which series replace quotients; the first omitted term is below double precision."""


def length(v: Array) -> float:
    """Return the Euclidean norm of a vector (n,).

    For blocks of a World, which run beside threads that send and receive: `np.linalg.norm` and `ndarray.dot` let other
    threads run before they return, which can take 100 times as long as the computation. `@` of small arrays does not.
    """
    return math.sqrt(v @ v)


def near_coordinates(coordinates: Array, near: Array | float, is_angle: Array) -> Array:
    """Return coordinates (n,) with their angles changed by full turns, to the values nearest to `near` (n,).

    The coordinates of a pose are angles within half a turn of 0; with them alone, a tool that passes half a turn would
    jump by a full one.
    """
    full_turns = np.where(is_angle, np.rint((coordinates - near) / (2 * np.pi)), 0.0)
    if not full_turns.any():  # the usual case, without a rounding
        return coordinates
    return coordinates - 2 * np.pi * full_turns


def hat(w: ArrayLike) -> Array:
    """Return the cross product matrix (..., 3, 3) of w (..., 3)."""
    w = np.asarray(w, float)
    matrix = np.zeros((*w.shape[:-1], 3, 3))
    matrix[..., 0, 1] = -w[..., 2]
    matrix[..., 0, 2] = w[..., 1]
    matrix[..., 1, 2] = -w[..., 0]
    matrix[..., 1, 0] = w[..., 2]
    matrix[..., 2, 0] = -w[..., 1]
    matrix[..., 2, 1] = w[..., 0]
    return matrix


def exp_so3(w: ArrayLike) -> Array:
    """Return the rotation matrix (..., 3, 3) of the rotation vector w (..., 3) in rad (Rodrigues)."""
    w = np.asarray(w, float)
    angle = np.sqrt(np.add.reduce(w * w, axis=-1))[..., None, None]  # a third of the time of np.linalg.norm
    small = angle < _SMALL_ANGLE
    K = hat(w)
    if np.count_nonzero(small):
        safe = np.where(small, 1.0, angle)
        a = np.where(small, 1.0, np.sin(safe) / safe)
        b = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    else:
        a = np.sin(angle) / angle
        b = (1 - np.cos(angle)) / angle**2
    return _IDENTITY + a * K + b * K @ K


def log_so3(R: ArrayLike) -> Array:
    """Return the rotation vector (..., 3) in rad of R (..., 3, 3); angles near 0 and near pi are also accurate."""
    q = quat_from_matrix_wxyz(R)
    w = q[..., 0]
    v = q[..., 1:]
    n = np.linalg.norm(v, axis=-1)
    angle = 2 * np.arctan2(n, w)
    small = n < _SMALL_ANGLE
    scale = np.where(small, 2.0, angle / np.where(small, 1.0, n))
    return v * scale[..., None]


def rotation_angle(R: ArrayLike) -> Array:
    """Return the rotation angle (...) in rad of R (..., 3, 3), accurate for small angles."""
    return np.linalg.norm(log_so3(R), axis=-1)


def pose_difference(T: Array, T_other: Array) -> tuple[float, float]:
    """Return the distance in m and the angle in rad between two poses (4, 4)."""
    shift = float(np.linalg.norm(T[:3, 3] - T_other[:3, 3]))
    return shift, float(rotation_angle(T[:3, :3].T @ T_other[:3, :3]))


def quat_from_matrix_wxyz(R: ArrayLike) -> Array:
    """Return unit quaternions (..., 4), w first and w >= 0, of rotation matrices (..., 3, 3).

    Shepperd's method divides by the largest of four candidates, so that no rotation is ill-conditioned.
    """
    R = np.asarray(R, float)
    m = R.reshape(-1, 3, 3)
    t = np.trace(m, axis1=1, axis2=2)
    candidates = np.column_stack([t, m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]])
    largest = np.argmax(candidates, axis=1)
    q = np.zeros((len(m), 4))
    for case in range(4):
        rows = largest == case
        if not np.count_nonzero(rows):
            continue  # for a single matrix, three of the four cases are empty
        if case == 0:
            q[rows, 0] = 1 + t[rows]
            q[rows, 1] = m[rows, 2, 1] - m[rows, 1, 2]
            q[rows, 2] = m[rows, 0, 2] - m[rows, 2, 0]
            q[rows, 3] = m[rows, 1, 0] - m[rows, 0, 1]
            continue
        # axis of the largest diagonal entry, and the two axes that follow it cyclically
        i = case - 1
        j = (i + 1) % 3
        k = (i + 2) % 3
        q[rows, 0] = m[rows, k, j] - m[rows, j, k]
        q[rows, 1 + i] = 1 + m[rows, i, i] - m[rows, j, j] - m[rows, k, k]
        q[rows, 1 + j] = m[rows, j, i] + m[rows, i, j]
        q[rows, 1 + k] = m[rows, k, i] + m[rows, i, k]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q[q[:, 0] < 0] *= -1
    return q.reshape(*R.shape[:-2], 4)


def matrix_from_quat_wxyz(q: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of quaternions (..., 4), w first; the quaternions are normalised first."""
    raw = np.asarray(q, float)
    unit = raw / np.linalg.norm(raw, axis=-1, keepdims=True)
    w = unit[..., :1, None]
    v = unit[..., 1:]
    v_squared = np.sum(v**2, axis=-1)[..., None, None]
    outer = v[..., :, None] * v[..., None, :]
    return (w**2 - v_squared) * np.eye(3) + 2 * outer + 2 * w * hat(v)


def continuous_signs(q: ArrayLike) -> Array:
    """Return quaternions (k, 4) with signs chosen so that the dot product of consecutive quaternions is at least 0.

    Many motion players interpolate the four numbers regardless of their signs; a change of sign would then be visible
    as a jump of up to 180 degrees.
    """
    q = np.asarray(q, float)
    flips = np.sum(q[1:] * q[:-1], axis=1) < 0
    flips_before = np.concatenate([[0], np.cumsum(flips)])
    signs = np.where(flips_before % 2, -1.0, 1.0)
    return q * signs[:, None]


def pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """Return poses (..., 4, 4) from rotations (..., 3, 3) and positions (..., 3) in m; default: identity, origin."""
    R = np.eye(3) if R is None else np.asarray(R, float)
    p = np.zeros(3) if p is None else np.asarray(p, float)
    if R.ndim == 2 and p.ndim == 1:  # for one pose, broadcasting would take most of the time
        T = np.zeros((4, 4))
        T[:3, :3] = R
        T[:3, 3] = p
        T[3, 3] = 1.0
        return T
    shape = np.broadcast_shapes(R.shape[:-2], p.shape[:-1])
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def inverse(T: ArrayLike) -> Array:
    """Return the inverses of poses (..., 4, 4)."""
    T = np.asarray(T, float)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return pose(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def is_pose(T: ArrayLike, tolerance: float = 1e-9) -> bool:
    """Return whether T (..., 4, 4) is finite, orthonormal, right-handed and has the last row (0, 0, 0, 1)."""
    T = np.asarray(T, float)
    if T.shape[-2:] != (4, 4) or not np.all(np.isfinite(T)):
        return False
    R = T[..., :3, :3]
    return bool(
        np.all(np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)) < tolerance)
        and np.all(np.linalg.det(R) > 0)
        and np.all(T[..., 3, :] == [0, 0, 0, 1])
    )


def rotation_z(angle: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) about z by angle (...) in rad."""
    a = np.asarray(angle, float)
    return exp_so3(a[..., None] * np.array([0.0, 0.0, 1.0]))


def angle_about_z(T: ArrayLike) -> Array:
    """Return angles (...) in rad about z of rotations (..., 3, 3) or poses (..., 4, 4) that turn (nearly) about z."""
    R = np.asarray(T, float)
    return np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1])


def euler_angles(R: ArrayLike, order: str, first: float = 0.0) -> Array:
    """Return the angles (..., 3) in rad of three rotations about the axes `order` with the product R ("zyx": Rz Ry Rx).

    The product equals R to 1e-12 in every orientation. In gimbal lock the first angle is `first`.
    """
    R = np.asarray(R, float)
    i, j, last = map("xyz".index, order)
    k = 3 - i - j  # the axis that is neither the first nor the second
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    if i == last:
        level = np.hypot(R[..., j, i], R[..., k, i])
        a = np.arctan2(R[..., j, i], -sign * R[..., k, i])
        b = np.arctan2(level, R[..., i, i])
    else:
        level = np.hypot(R[..., j, k], R[..., k, k])
        a = np.arctan2(-sign * R[..., j, k], R[..., k, k])
        b = np.arctan2(sign * R[..., i, k], level)
    a = np.where(level > 1e-12, a, first)
    # The last angle is computed from R and the first two: near gimbal lock, it compensates the first angle's error.
    axes = np.eye(3)
    first_two = exp_so3(a[..., None] * axes[i]) @ exp_so3(b[..., None] * axes[j])
    rest = np.swapaxes(first_two, -1, -2) @ R
    m = (last + 1) % 3
    n = (last + 2) % 3
    c = np.arctan2(rest[..., n, m] - rest[..., m, n], rest[..., m, m] + rest[..., n, n])
    return np.stack([a, b, c], axis=-1) + 0.0


def cubic(s: Array | float, a: Array, b: Array, slope_a: Array, slope_b: Array) -> Array:
    """Return the cubic at s (0..1) with value a and slope slope_a at s = 0, and value b and slope slope_b at s = 1."""
    return a + s * (slope_a + s * (3 * (b - a) - 2 * slope_a - slope_b + s * (2 * (a - b) + slope_a + slope_b)))


def unit_across(direction: ArrayLike) -> Array:
    """Return the axis x, y or z (3,) that is most nearly perpendicular to a direction; of equal ones the first."""
    nearest = int(np.argmin(np.abs(np.asarray(direction, float))))
    return np.eye(3)[nearest]


def frame_from_axes(z: ArrayLike, x: ArrayLike) -> Array:
    """Return the rotation (3, 3) whose third column is along z, and first column along the component of x normal to z.

    Raises:
        ValueError: z is zero, or x is parallel to z.
    """
    z = np.asarray(z, float)
    x = np.asarray(x, float)
    if not np.linalg.norm(z) > 0:
        raise ValueError("z is a zero vector")
    z = z / np.linalg.norm(z)
    x = x - z * (z @ x)
    n = np.linalg.norm(x)
    if not n > 1e-9:
        raise ValueError("x is parallel to z")
    x = x / n
    return np.column_stack([x, np.cross(z, x), z])


def point_to_line(point: ArrayLike, origin: ArrayLike, direction: ArrayLike) -> Array:
    """Return the distance (...) in m from points (..., 3) to lines origin + s * direction (..., 3)."""
    d = np.asarray(direction, float)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    w = np.asarray(point, float) - np.asarray(origin, float)
    return np.linalg.norm(w - np.sum(w * d, axis=-1, keepdims=True) * d, axis=-1)
