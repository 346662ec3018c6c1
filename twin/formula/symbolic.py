"""Rotations, poses and guarded roots in CasADi SX.

Every function takes and returns SX (or types convertible to SX). Derivatives are also finite where those of the
plain expression are NaN: for a norm at the zero vector, for the logarithm at the identity. Only this module has such
guards. Frames follow `twin.core.spatial`: T_a_b is the pose of b in a, twists have linear rows first, and angles are in
rad.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

SX = Any
"""A CasADi SX (MX where a rootfinder is called): scalar, vector or matrix; or a number.

The stubs of CasADi describe no operators, and an overload for each of these types that loses a mixture of them.
"""

_LARGEST_SERIES_ANGLE = 1e-6
"""Squared angle in rad^2 below which series replace quotients; the first omitted term is below 1e-20."""


def sqrt(x: SX) -> SX:
    """Return the square root of x; 0 with derivative 0 for x <= 0 (instead of NaN or an infinite derivative).

    Use this function for lengths that may be zero. Do not use it where NaN says that the joints have no value.
    """
    positive = x > 0
    # Both branches of a condition are evaluated and differentiated, so the argument is made positive first.
    return ca.if_else(positive, ca.sqrt(ca.if_else(positive, x, 1)), 0)


def norm(v: SX) -> SX:
    """Return the length of the column v; its gradient at v = 0 is 0 (`norm_2` gives NaN)."""
    return sqrt(ca.sumsqr(v))


def unit(v: SX) -> SX:
    """Return v / |v|, and 0 for v = 0."""
    squared = ca.sumsqr(v)
    # never 0: both branches of the last condition are evaluated and differentiated
    length = ca.sqrt(ca.if_else(squared > 0, squared, 1))
    return ca.if_else(squared > 0, v / length, 0 * v)


def hat(w: SX) -> SX:
    """Return the cross product matrix (3, 3) of w (3)."""
    return ca.skew(w)


def rotation_x(a: SX) -> SX:
    """Return the rotation (3, 3) about x by a in rad."""
    c = ca.cos(a)
    s = ca.sin(a)
    return _matrix([[1, 0, 0], [0, c, -s], [0, s, c]])


def rotation_y(a: SX) -> SX:
    """Return the rotation (3, 3) about y by a in rad."""
    c = ca.cos(a)
    s = ca.sin(a)
    return _matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rotation_z(a: SX) -> SX:
    """Return the rotation (3, 3) about z by a in rad."""
    c = ca.cos(a)
    s = ca.sin(a)
    return _matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def rotation_zyx(psi: SX, theta: SX, phi: SX) -> SX:
    """Return Rz(psi) Ry(theta) Rx(phi), (3, 3); angles in rad."""
    return rotation_z(psi) @ rotation_y(theta) @ rotation_x(phi)


def angles_zyx(R: SX) -> tuple[SX, SX, SX]:
    """Return (psi, theta, phi) in rad with R = Rz(psi) Ry(theta) Rx(phi); theta within +-pi/2.

    Only atan2 is used, so that theta has full precision near +-pi/2; psi and phi are undefined at exactly +-pi/2.
    """
    psi = ca.atan2(R[1, 0], R[0, 0])
    cos_theta = sqrt(R[0, 0] ** 2 + R[1, 0] ** 2)
    theta = ca.atan2(-R[2, 0], cos_theta)
    phi = ca.atan2(R[2, 1], R[2, 2])
    return psi, theta, phi


def pose(R: SX, p: SX) -> SX:
    """Return the pose (4, 4) with a rotation (3, 3) and a position (3) in m."""
    return ca.vertcat(ca.horzcat(R, ca.vertcat(p)), _matrix([[0, 0, 0, 1]]))


def flat(M: SX) -> SX:
    """Return the entries of M as a column, row by row: the memory order of a numpy array."""
    return ca.vec(ca.densify(ca.SX(M)).T)


def unflat(v: SX, rows: int, columns: int) -> SX:
    """Return the (rows, columns) matrix whose entries, row by row, are v."""
    return ca.reshape(v, columns, rows).T


def exp_so3(rotation_vector: SX) -> SX:
    """Return the rotation matrix (3, 3) of the rotation vector (3) in rad; smooth at 0."""
    squared_angle = ca.sumsqr(rotation_vector)
    small = squared_angle < _LARGEST_SERIES_ANGLE
    safe = ca.if_else(small, 1, squared_angle)
    angle = ca.sqrt(safe)
    half = ca.sin(angle / 2)
    a = ca.if_else(small, 1 - squared_angle / 6 + squared_angle**2 / 120, ca.sin(angle) / angle)
    # 2 sin(x/2)^2 avoids the cancellation in 1 - cos(x).
    b = ca.if_else(small, 0.5 - squared_angle / 24 + squared_angle**2 / 720, 2 * half**2 / safe)
    K = hat(rotation_vector)
    return ca.SX.eye(3) + a * K + b * K @ K


def quaternion_wxyz(R: SX) -> SX:
    """Return the unit quaternion (4), w first and w >= 0, of R (3, 3) by Shepperd's method."""
    diagonal = [R[0, 0], R[1, 1], R[2, 2]]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    x = R[2, 1] - R[1, 2]
    y = R[0, 2] - R[2, 0]
    z = R[1, 0] - R[0, 1]
    xy = R[0, 1] + R[1, 0]
    xz = R[0, 2] + R[2, 0]
    yz = R[1, 2] + R[2, 1]
    # each column is a multiple of the quaternion; the one with the largest entry is precise
    columns = [
        ca.vertcat(1 + trace, x, y, z),
        ca.vertcat(x, 1 + 2 * diagonal[0] - trace, xy, xz),
        ca.vertcat(y, xy, 1 + 2 * diagonal[1] - trace, yz),
        ca.vertcat(z, xz, yz, 1 + 2 * diagonal[2] - trace),
    ]
    best = trace
    q = columns[0]
    for i in range(3):
        q = ca.if_else(diagonal[i] > best, columns[i + 1], q)
        best = ca.fmax(best, diagonal[i])
    q = unit(q)
    return ca.if_else(q[0] < 0, -q, q)


def log_so3(R: SX) -> SX:
    """Return the rotation vector (3) in rad of R (3, 3); accurate near 0 and near pi, smooth at 0."""
    q = quaternion_wxyz(R)
    cosine = q[0]
    vector_part = q[1:4]
    squared_sine = ca.sumsqr(vector_part)
    small = squared_sine < _LARGEST_SERIES_ANGLE
    # both branches are evaluated and differentiated, so the arguments of the other branch are made harmless
    sine = ca.sqrt(ca.if_else(small, 1, squared_sine))
    squared_tangent = squared_sine / ca.if_else(small, cosine, 1) ** 2
    series = 2 / ca.if_else(small, cosine, 1) * (1 - squared_tangent / 3 + squared_tangent**2 / 5)
    quotient = 2 * ca.atan2(sine, cosine) / sine
    return vector_part * ca.if_else(small, series, quotient)


def retract(T: SX, xi: SX) -> SX:
    """Return the pose (4, 4) after the small twist xi = (v, w): position p + v, rotation exp(w) R.

    The twist (6) is in base axes, at the tool origin, linear rows first, as in all Jacobians of this package.
    """
    return pose(exp_so3(xi[3:6]) @ T[0:3, 0:3], T[0:3, 3] + xi[0:3])


def pose_residual(T: SX, T_target: SX) -> SX:
    """Return the 6 errors of T relative to T_target, in the axes of the target: position in m, rotation vector in rad.

    All errors are 0 only if the poses are equal. A task may omit errors. For example, the rotation errors
    about x and y are both 0 if, and only if, the z axes of the two poses agree.
    """
    R = T_target[0:3, 0:3].T
    offset = R @ (T[0:3, 3] - T_target[0:3, 3])
    rotation = log_so3(R @ T[0:3, 0:3])
    return ca.vertcat(offset, rotation)


def _matrix(rows: list[list[SX]]) -> SX:
    """Return the matrix with these rows of numbers and scalars."""
    lines = []
    for row in rows:
        entries = [ca.SX(entry) for entry in row]
        lines.append(ca.horzcat(*entries))
    return ca.vertcat(*lines)
