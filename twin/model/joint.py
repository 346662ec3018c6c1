"""A joint: a frame on the parent body and a frame on the child body, which move along or about their common z axis.

T_parent_child = T_parent_joint @ motion(q) @ inverse(T_child_joint)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import ROUNDING

JointType = Literal["fixed", "revolute", "prismatic", "cylindrical", "spherical", "free"]

FREE_AXES: dict[str, tuple[int, ...]] = {
    "fixed": (),
    "revolute": (5,),
    "prismatic": (2,),
    "cylindrical": (2, 5),
    "spherical": (3, 4, 5),
    "free": (0, 1, 2, 3, 4, 5),
}
"""Free directions of each joint type in the joint frame: 0..2 translation along x y z, 3..5 rotation about x y z."""


@dataclass(frozen=True)
class Drive:
    """A position drive: stiffness in N/m or N m/rad, damping in N s/m or N m s/rad, maximum effort in N or N m."""

    stiffness: float
    damping: float
    max_effort: float | None = None


@dataclass(frozen=True)
class Joint:
    """A joint between two bodies; its axis is z of both joint frames.

    Attributes:
        name, type, parent, child: identifiers; see `FREE_AXES` for the types.
        T_parent_joint, T_child_joint: (4, 4) poses of the two joint frames, in the parent body and in the child body.
        active: whether a motor drives the joint.
        limits: hard range of the coordinate in m or rad, or None.
        soft_limits: range outside which a warning is reported, in m or rad, or None.
        cone: maximum angle in rad between the two z axes of a spherical joint, or None.
        max_speed, max_acceleration, max_jerk: maximum absolute values in m or rad per s, s2 and s3, or None.
        drive: the position drive of an active joint that is driven directly, or None; see `Actuator`.
        mating: names of the two meshes that touch in this joint (pin and bore); contact between them is not checked.
    """

    name: str
    type: JointType
    parent: str
    child: str
    T_parent_joint: Array = field(default_factory=lambda: np.eye(4))
    T_child_joint: Array = field(default_factory=lambda: np.eye(4))
    active: bool = False
    limits: tuple[float, float] | None = None
    soft_limits: tuple[float, float] | None = None
    cone: float | None = None
    max_speed: float | None = None
    max_acceleration: float | None = None
    max_jerk: float | None = None
    drive: Drive | None = None
    mating: tuple[str, ...] = ()

    @property
    def free_axes(self) -> tuple[int, ...]:
        """Free directions in the joint frame; see `FREE_AXES`."""
        return FREE_AXES[self.type]

    @property
    def is_angle(self) -> bool:
        """Whether the (single) coordinate is an angle."""
        return self.type == "revolute"

    def relative(self, T_base_parent: Array, T_base_child: Array) -> Array:
        """Return the child's joint frame (..., 4, 4) in the parent's joint frame; identity means q = 0 and no gap."""
        return spatial.inverse(T_base_parent @ self.T_parent_joint) @ T_base_child @ self.T_child_joint

    def coordinate(self, T_base_parent: Array, T_base_child: Array) -> Array:
        """Return the coordinate (...) at two body poses (..., 4, 4): `angle` about z in rad, or shift along z in m."""
        return self._coordinate_of(self.relative(T_base_parent, T_base_child))

    def _coordinate_of(self, T: Array) -> Array:
        """Return the coordinate (...) of poses (..., 4, 4) from `relative`."""
        if self.is_angle:
            return self.angle(T)
        return T[..., 2, 3]

    def angle(self, T: Array) -> Array:
        """Return the angle about z in rad (...) of poses (..., 4, 4) from `relative`.

        A pose does not determine the number of full turns. The angle in -pi..pi is returned if it is within the limits;
        otherwise, the angle within half a turn of the middle of the limits is returned.
        """
        angle = spatial.angle_about_z(T)
        if self.type != "revolute" or self.limits is None or not np.isfinite(self.limits).all():
            return angle
        low, high = self.limits
        middle = 0.5 * (low + high)
        shifted = middle + np.mod(angle - middle + np.pi, 2 * np.pi) - np.pi
        # without the tolerance, a joint drawn at its limit 0 of 0..2 pi would be at 2 pi after a rounding error
        return np.where((angle >= low - ROUNDING) & (angle <= high + ROUNDING), angle, shifted)

    def beyond(self, T_base_parent: Array, T_base_child: Array) -> Array:
        """Return by how much (...) the joint exceeds its limits or its cone at two body poses (..., 4, 4).

        The result is in m or rad, and negative within the limits; without limits, it is minus infinity.
        """
        T = self.relative(T_base_parent, T_base_child)
        excess = np.full(T.shape[:-2], -np.inf)
        if self.cone is not None:
            # Not by the arc cosine of z, which loses half of the digits at a small tilt.
            tilt = np.arctan2(np.linalg.norm(T[..., :2, 2], axis=-1), T[..., 2, 2])
            excess = np.maximum(excess, tilt - self.cone)
        if self.limits is not None and len(self.free_axes) == 1:
            low, high = self.limits
            value = self._coordinate_of(T)
            excess = np.maximum(excess, np.maximum(low - value, value - high))
        return excess


def reversed_joint(joint: Joint) -> Joint:
    """Return the joint with parent and child swapped, and both frames rotated by 180 deg about x to keep the sign of q.

    T_child_parent = T_child_joint @ inverse(motion(q)) @ inverse(T_parent_joint), and a half turn H about x
    gives H @ motion(q) @ H = inverse(motion(q)) for motion along or about z.
    """
    half_turn = spatial.pose(np.diag([1.0, -1.0, -1.0]))
    return replace(
        joint,
        parent=joint.child,
        child=joint.parent,
        T_parent_joint=joint.T_child_joint @ half_turn,
        T_child_joint=joint.T_parent_joint @ half_turn,
    )
