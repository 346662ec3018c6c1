"""Quaternions, matrices and poses, implemented again because the audit must share no code with the writers.

Poses are float64 (4, 4) and act on column vectors; quaternions are x, y, z, w. All functions are vectorised over
leading axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray

R_Z_UP_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation (3, 3) from a world with y up to a world with z up: y becomes z, z becomes -y."""

_ZERO_SQUARED = 1e-24
"""Square of the length of a quaternion up to which it is zero, and no rotation."""

_SMALL_SINE = 1e-6
"""Sine of half the rotation between two quaternions up to which they are interpolated linearly."""


def rotation(xyzw: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) of quaternions (..., 4) of any length; a zero quaternion gives the identity."""
    q = np.asarray(xyzw, float)
    squared = np.sum(q * q, axis=-1, keepdims=True)
    usable = np.isfinite(squared) & (squared > _ZERO_SQUARED)
    q = np.where(usable, q, [0.0, 0.0, 0.0, 1.0])
    q = q / np.sqrt(np.where(usable, squared, 1.0))
    v = q[..., :3]
    w = q[..., 3, None, None]
    # R = (w^2 - v'v) 1 + 2 v v' + 2 w [v]x, for a unit quaternion (v, w)
    outer = v[..., :, None] * v[..., None, :]
    inner = np.sum(v * v, axis=-1)[..., None, None]
    return (w * w - inner) * np.eye(3) + 2 * outer + 2 * w * cross_matrix(v)


def cross_matrix(v: ArrayLike) -> Array:
    """Return the skew-symmetric matrices K (..., 3, 3) of v (..., 3), with K u = v x u."""
    v = np.asarray(v, float)
    matrices = np.zeros((*v.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[..., i, j] = -v[..., k]
        matrices[..., j, i] = v[..., k]
    return matrices


def about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) by angles (...) in rad about one axis (3,)."""
    direction = np.asarray(axis, float) / np.linalg.norm(axis)
    half = np.asarray(angle, float)[..., None] / 2
    xyzw = np.concatenate([direction * np.sin(half), np.cos(half)], axis=-1)
    return rotation(xyzw)


def pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """Return poses (..., 4, 4) of rotations R (..., 3, 3) and positions p (..., 3); default: R = identity, p = 0."""
    R = np.eye(3) if R is None else np.asarray(R, float)
    p = np.zeros(3) if p is None else np.asarray(p, float)
    shape = np.broadcast_shapes(R.shape[:-2], p.shape[:-1])
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def from_seven(rows: ArrayLike) -> Array:
    """Return poses (..., 4, 4) from (..., 7): x y z in m, then the quaternion x y z w."""
    rows = np.asarray(rows, float)
    return pose(rotation(rows[..., 3:]), rows[..., :3])


def inverse(T: ArrayLike) -> Array:
    """Return the inverse of rigid poses (..., 4, 4)."""
    T = np.asarray(T, float)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    turned = Rt @ T[..., :3, 3, None]
    return pose(Rt, -turned[..., 0])


def angle(A: ArrayLike, B: ArrayLike) -> Array:
    """Return the angles (...) in rad between rotations (..., 3, 3); accurate from 0 to pi.

    The Frobenius norm of the difference of two rotations is 2 sqrt(2) sin(angle / 2); an arc cosine would be inaccurate
    for small angles.
    """
    difference = np.asarray(A, float) - np.asarray(B, float)
    size = np.linalg.norm(difference, axis=(-2, -1))
    return 2 * np.arcsin(np.clip(size / np.sqrt(8), 0.0, 1.0))  # clip: rounding may exceed 1 at half a turn


def split(M: ArrayLike) -> tuple[Array, Array]:
    """Return (poses (..., 4, 4), scales (..., 3)) of affine matrices (..., 4, 4); if mirrored, the x scale is < 0."""
    M = np.asarray(M, float)
    A = M[..., :3, :3]
    size = np.linalg.norm(A, axis=-2)
    # A mirror image is no rotation: it goes into the scale, as a negative factor of x.
    mirrored = np.linalg.det(A) < 0
    size = size * np.where(mirrored[..., None], [-1.0, 1.0, 1.0], 1.0)
    divisor = np.where(size == 0, 1.0, size)
    R = A / divisor[..., None, :]
    return pose(R, M[..., :3, 3]), size


def slerp(a: Array, b: Array, u: Array) -> Array:
    """Return quaternions (k, 4), interpolated along the shorter rotation from a to b (k, 4) at fractions u (k,)."""
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(cosine < 0, -b, b)  # q and -q are one rotation: the nearer one gives the shorter way
    half = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(half)
    nearly_equal = sine < _SMALL_SINE  # equal quaternions: the arc has no direction, and its chord is exact enough
    sine = np.where(nearly_equal, 1.0, sine)
    u = np.asarray(u)[:, None]
    chord = (1 - u) * a + u * b
    arc = (np.sin((1 - u) * half) * a + np.sin(u * half) * b) / sine
    return np.where(nearly_equal, chord, arc)


def rpy(angles: ArrayLike) -> Array:
    """Return the rotation (3, 3) of roll, pitch, yaw in rad about the fixed axes x, y, z (URDF)."""
    roll, pitch, yaw = np.asarray(angles, float)
    return about([0, 0, 1], yaw) @ about([0, 1, 0], pitch) @ about([1, 0, 0], roll)


def quaternion(R: ArrayLike) -> Array:
    """Return quaternions (..., 4), x y z w, of rotations (..., 3, 3); their sign is arbitrary.

    Each quaternion is the normalised longest column of a symmetric 4 x 4 matrix of rank one.
    """
    R = np.asarray(R, float)
    K = np.zeros((*R.shape[:-2], 4, 4))
    trace = np.trace(R, axis1=-2, axis2=-1)
    for first in range(3):
        second = (first + 1) % 3
        k = (first + 2) % 3
        K[..., first, first] = 1 + 2 * R[..., first, first] - trace
        symmetric = R[..., first, second] + R[..., second, first]
        K[..., first, second] = symmetric
        K[..., second, first] = symmetric
        antisymmetric = R[..., k, second] - R[..., second, k]
        K[..., first, 3] = antisymmetric
        K[..., 3, first] = antisymmetric
    K[..., 3, 3] = 1 + trace
    diagonal = np.einsum("...ii->...i", K)
    best = np.argmax(diagonal, axis=-1)
    column = np.take_along_axis(K, best[..., None, None], axis=-1)[..., 0]
    return column / np.linalg.norm(column, axis=-1, keepdims=True)
