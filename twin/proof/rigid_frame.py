"""The frames of a CAD as rigid frames: numbers, and how far a true rotation may be from them.

The rotation of a frame is written in numbers that are rounded, so that it is orthogonal to about 1e-15 only. A proof is
about the nearest rotation: every entry of it is within `R_radius` of the number. Derivatives and inverses may then use
that rotations are orthogonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.proof.rounding import UNIT_ROUNDOFF

_PRODUCT_ROUNDINGS = 8
"""Bound of the number of roundings in a scalar product of three terms: 3 products and 2 sums, with a margin."""

_MARGIN = 1 + 1e-12
"""Factor by which radii are enlarged, because they are rounded themselves."""

_LARGEST_DEFECT = 1e-12
"""Largest entry of R^T R - 1 of a rotation R whose numbers count as rounded."""


@dataclass(frozen=True, eq=False)
class RigidFrame:
    """A pose whose rotation is known within a radius.

    Attributes:
        T: (4, 4) the numbers.
        R_radius: largest difference of an entry of the rotation from its number.
        p_radius: (3,) largest differences of the position in m.
    """

    T: Array
    R_radius: float
    p_radius: Array

    def inverse(self) -> RigidFrame:
        """Return the inverse pose; its radius contains the rounding."""
        p = np.abs(self.T[:3, 3])
        R = np.abs(self.T[:3, :3])
        # -R^T p: an error of each entry of R, one of p, and the rounding of the product
        from_rotation = self.R_radius * (p + self.p_radius).sum()
        from_position = R.T @ self.p_radius
        rounding = _PRODUCT_ROUNDINGS * UNIT_ROUNDOFF * (R.T @ p)
        radius = (from_rotation + rounding + from_position) * _MARGIN
        return RigidFrame(spatial.inverse(self.T), self.R_radius, radius)


def rigid_frame(T: Array, name: str) -> RigidFrame:
    """Return the pose whose numbers are T (4, 4), with the nearest rotation.

    The nearest rotation differs from R by at most the norm of R^T R - 1, which is at most 3 times its largest entry.

    Raises:
        TwinError: the numbers are not those of a rotation; `name` says of which frame.
    """
    numbers = np.asarray(T, float)
    R = numbers[:3, :3]
    if np.array_equal(R, np.round(R)) and np.array_equal(R.T @ R, np.eye(3)):
        return RigidFrame(numbers, 0.0, np.zeros(3))  # 0 and 1 are exact
    defect = float(np.abs(R.T @ R - np.eye(3)).max())
    if not defect <= _LARGEST_DEFECT:
        raise TwinError(
            f"{name}: the rotation is orthogonal to {defect:.1e} only; a proof needs {_LARGEST_DEFECT:.0e}: write its "
            "numbers with 15 digits"
        )
    # the columns have the length 1, so that the rounding of the defect has this bound
    largest_defect = defect + _PRODUCT_ROUNDINGS * UNIT_ROUNDOFF
    return RigidFrame(numbers, 3.0 * largest_defect * _MARGIN, np.zeros(3))


def joint_frames(mechanism_name: str, joint_name: str, parent: Array, child: Array) -> tuple[RigidFrame, RigidFrame]:
    """Return the frames of a joint on its parent and on its child.

    Raises:
        TwinError: the numbers of one are not those of a rotation.
    """
    text = f"{mechanism_name}: joint {joint_name}, frame on its"
    return rigid_frame(parent, f"{text} parent"), rigid_frame(child, f"{text} child")
