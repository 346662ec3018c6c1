"""The gaps of a joint that closes a loop, and their derivatives, from the motion of its second frame in the first.

Offset and rotation are those of the frame on the child in the frame on the parent. Along a locked axis, the gap is a
coordinate of the offset; about a locked axis it is a sine, times `ARM`: of the tilt of the z axes, or, where no turn is
free, of the rotation. Both are zero also after half a turn, which `Linkage.aligned` excludes.
"""

from __future__ import annotations

from twin.model.joint import Joint
from twin.proof.motion.taylor import TaylorModel, cross

ARM = 0.1
"""Length in m by which gaps of directions, in rad, are multiplied."""

_ANTISYMMETRIC = ((2, 1), (0, 2), (1, 0))
"""Entries of a rotation whose differences from their mirror images are its turns about x, y and z, twice the sines."""


def _locked_axes(joint: Joint) -> list[int]:
    """Return the axes x, y, z, by numbers, along which a joint does not let its child move."""
    return [axis for axis in range(3) if axis not in joint.free_axes]


def gap_rows(joint: Joint, offset: TaylorModel, R: TaylorModel) -> list[TaylorModel]:
    """Return the gaps of a loop joint along and about its locked axes."""
    rows = [offset[:, axis] for axis in _locked_axes(joint)]
    if joint.type in ("fixed", "prismatic"):
        for i, j in _ANTISYMMETRIC:
            rows.append((R[:, i, j] - R[:, j, i]) * (ARM / 2))
    elif joint.type in ("revolute", "cylindrical"):
        rows.append(R[:, 1, 2] * -ARM)
        rows.append(R[:, 0, 2] * ARM)
    return rows


def gap_derivatives(joint: Joint, offsets: TaylorModel, turns: TaylorModel, R: TaylorModel) -> list[TaylorModel]:
    """Return the derivatives (N, m) of the gaps of a loop joint.

    Args:
        joint: the joint.
        offsets: (N, m, 3) derivatives of the offset.
        turns: (N, m, 3) rotation of the second frame by each coordinate, in the first frame.
        R: (N, 3, 3) rotation of the second frame in the first.
    """
    rows = [offsets[..., axis] for axis in _locked_axes(joint)]
    if joint.type == "spherical":
        return rows
    changes = []  # (N, m, 3) derivatives of the columns of R
    for column in range(3):
        changes.append(cross(turns, R[:, None, :, column]))
    if joint.type in ("fixed", "prismatic"):
        for i, j in _ANTISYMMETRIC:
            rows.append((changes[j][..., i] - changes[i][..., j]) * (ARM / 2))
    else:
        rows.append(changes[2][..., 1] * -ARM)
        rows.append(changes[2][..., 0] * ARM)
    return rows
