"""Shapes of phases: exact poses and exact derivatives in the path parameter s in [0, 1].

A line has position and angles linear in s. A motion about the RCM P has angles and depth l linear in s, and the tip
follows from them, tip(s) = P + l(s) R(s) n with the shaft n fixed in the tool, so that the shaft passes through P at
every s by construction, not by correction. A phase type with another shape brings its own (`phases.circle`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array

RcmMode = Literal["enforced", "monitored"]
RotationOrder = Literal["zyx", "xyz"]
"""Intrinsic rotation axes in order: "zyx" is Rz Ry Rx."""

_AXES = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0]), "z": np.array([0.0, 0.0, 1.0])}


@dataclass(frozen=True)
class Motion:
    """A phase at k values of s; all in base, derivatives with respect to s.

    Attributes:
        Ts_base_tool: (k, 4, 4).
        p: (k, 3) origin of the moved frame ("tip") in m; `p1`, `p2` its derivatives.
        w1: (k, 3) rotation rate in rad per unit of s; `w2` its derivative.
        twists: (k, 6) rate of the tool frame, linear rows first.
    """

    Ts_base_tool: Array
    p: Array
    p1: Array
    p2: Array
    w1: Array
    w2: Array
    twists: Array


@dataclass(frozen=True)
class Course:
    """The two ends of a phase.

    Attributes:
        T_tool_frame: (4, 4) pose of the moved frame in the tool.
        n_tool_shaft: (3,) unit vector along the shaft towards the tip, in the tool.
        order: axes of the rotation angles.
        angles0, angles1: (3,) in rad at both ends, about the axes of `order`.
        tip0, tip1: (3,) origin of the moved frame at both ends, in base.
        rcm: (3,) RCM in base while it is registered, else None.
        rcm_mode: "enforced" or "monitored" while it is registered, else None.
        depth0, depth1: depth at both ends in m (NaN without RCM).
    """

    T_tool_frame: Array
    n_tool_shaft: Array
    order: RotationOrder
    angles0: Array
    angles1: Array
    tip0: Array
    tip1: Array
    rcm: Array | None
    rcm_mode: RcmMode | None
    depth0: float
    depth1: float

    def line(self, s: Array) -> Motion:
        """Return a straight motion at s (k,)."""
        R, w1, w2 = _turning(self.angles0, self.angles1 - self.angles0, s, self.order)
        step = self.tip1 - self.tip0
        p, p1 = self.tip0 + s[:, None] * step, np.broadcast_to(step, (len(s), 3))
        return self.moved(R, p, p1, np.zeros((len(s), 3)), w1, w2)

    def about(self, rcm: Array, s: Array) -> Motion:
        """Return a motion about an RCM (3,) at s (k,)."""
        R, w1, w2 = _turning(self.angles0, self.angles1 - self.angles0, s, self.order)
        n = R @ self.n_tool_shaft
        n1 = np.cross(w1, n)
        n2 = np.cross(w2, n) + np.cross(w1, n1)
        rate = self.depth1 - self.depth0
        depth = (self.depth0 + rate * s)[:, None]
        return self.moved(R, rcm + depth * n, rate * n + depth * n1, 2 * rate * n1 + depth * n2, w1, w2)

    def moved(self, R: Array, p: Array, p1: Array, p2: Array, w1: Array, w2: Array) -> Motion:
        """Return the motion of a frame with rotation R (k, 3, 3) at p (k, 3), and their derivatives; see `Motion`."""
        arm = R @ self.T_tool_frame[:3, 3]  # from the tool to the moved frame
        twists = np.concatenate([p1 - np.cross(w1, arm), w1], axis=1)
        return Motion(spatial.pose(R, p - arm), p, p1, p2, w1, w2, twists)


def rotation(angles: Array, order: RotationOrder) -> Array:
    """Return R (..., 3, 3) of angles (..., 3) in rad about the axes of `order`: "zyx" is Rz Ry Rx."""
    angles = np.asarray(angles)
    first, second, third = (spatial.exp_so3(angles[..., i, None] * _AXES[axis]) for i, axis in enumerate(order))
    return first @ second @ third


def angles_of(R: Array, order: RotationOrder, near: Array) -> Array:
    """Return the angles (3,) in rad of R (3, 3) about the axes of `order` that are nearest to `near` (3,).

    A phase is linear in the angles: other angles of the same rotation would turn the tool by a full turn.
    Where the middle angle is a right angle, the first one is that of `near`.
    """
    a, b, c = spatial.euler_angles(R, order, near[0])
    found = np.array([[a, b, c], [a + np.pi, np.pi - b, c + np.pi]])
    found -= 2 * np.pi * np.round((found - near) / (2 * np.pi))
    return min(found, key=lambda angles: float(np.linalg.norm(angles - near)))


def _turning(start: Array, rate: Array, s: Array, order: RotationOrder) -> tuple[Array, Array, Array]:
    """Return R (k, 3, 3), its rate (k, 3) and the derivative of the rate, all in base, angles linear in s."""
    angles = start + s[:, None] * rate
    e0, e1, e2 = (_AXES[axis] for axis in order)
    R = spatial.exp_so3(angles[:, :1] * e0)
    axis1 = R @ e1
    R = R @ spatial.exp_so3(angles[:, 1:2] * e1)
    axis2 = R @ e2
    R = R @ spatial.exp_so3(angles[:, 2:] * e2)
    turn0 = np.broadcast_to(rate[0] * e0, axis1.shape)
    turn1 = turn0 + rate[1] * axis1
    return R, turn1 + rate[2] * axis2, rate[1] * np.cross(turn0, axis1) + rate[2] * np.cross(turn1, axis2)
