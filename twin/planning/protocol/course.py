"""Shapes of phases: exact poses and exact derivatives in the path parameter s in [0, 1].

On a line, position and angles are linear in s. In a motion about the RCM P, angles and depth l are linear in s, and the
tip is tip(s) = P + l(s) R(s) n. The shaft direction n is fixed in the tool; therefore the shaft passes exactly through
P at every s. Phase types with other shapes define their own motion (`phases.circle`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array

RcmMode = Literal["enforced", "monitored"]
RotationOrder = Literal["zyx", "xyz"]
"""Intrinsic rotation axes in their order: "zyx" is Rz Ry Rx."""

_AXES = {
    "x": np.array([1.0, 0.0, 0.0]),
    "y": np.array([0.0, 1.0, 0.0]),
    "z": np.array([0.0, 0.0, 1.0]),
}


@dataclass(frozen=True)
class Motion:
    """Motion of a phase at k values of s, in base; derivatives are with respect to s.

    Attributes:
        Ts_base_tool: (k, 4, 4) tool poses.
        p: (k, 3) origin of the moved frame (the tip) in m; `p1` and `p2` are its first and second derivative.
        w1: (k, 3) rotation rate in rad per unit of s; `w2` is its derivative.
        twists: (k, 6) twist of the tool frame per unit of s, linear part first.
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
    """Start and end of a phase.

    Attributes:
        T_tool_frame: (4, 4) pose of the moved frame in the tool frame.
        n_tool_shaft: (3,) unit vector along the shaft towards the tip, in the tool frame.
        order: axes of the rotation angles.
        angles0, angles1: (3,) angles in rad at both ends, about the axes of `order`.
        tip0, tip1: (3,) origin of the moved frame at both ends, in m, in base.
        rcm: (3,) registered RCM in m, in base; None if there is none.
        rcm_mode: "enforced" or "monitored"; None without RCM.
        depth0, depth1: depth in m at both ends; NaN without RCM.
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
        """Return the motion along a straight line, at the path parameters s (k,)."""
        R, w1, w2 = _turning(self.angles0, self.angles1 - self.angles0, s, self.order)
        step = self.tip1 - self.tip0
        p = self.tip0 + s[:, None] * step
        p1 = np.broadcast_to(step, (len(s), 3))
        p2 = np.zeros((len(s), 3))
        return self.moved(R, p, p1, p2, w1, w2)

    def about(self, rcm: Array, s: Array) -> Motion:
        """Return the motion about an RCM (3,) (in m, in base) at the path parameters s (k,)."""
        R, w1, w2 = _turning(self.angles0, self.angles1 - self.angles0, s, self.order)
        # shaft direction and its derivatives: n is fixed in the tool
        n = R @ self.n_tool_shaft
        n1 = np.cross(w1, n)
        n2 = np.cross(w2, n) + np.cross(w1, n1)
        rate = self.depth1 - self.depth0
        depth = (self.depth0 + rate * s)[:, None]
        p = rcm + depth * n
        p1 = rate * n + depth * n1
        p2 = 2 * rate * n1 + depth * n2
        return self.moved(R, p, p1, p2, w1, w2)

    def moved(self, R: Array, p: Array, p1: Array, p2: Array, w1: Array, w2: Array) -> Motion:
        """Return the motion for rotations R (k, 3, 3), tip positions p (k, 3) and their derivatives; see `Motion`."""
        arm = R @ self.T_tool_frame[:3, 3]  # from the tool's origin to the moved frame's origin, in base
        # The twist is that of the tool frame's origin, which lies `arm` behind the tip.
        twists = np.concatenate([p1 - np.cross(w1, arm), w1], axis=1)
        return Motion(spatial.pose(R, p - arm), p, p1, p2, w1, w2, twists)


def rotation(angles: Array, order: RotationOrder) -> Array:
    """Return rotation matrices R (..., 3, 3) for angles (..., 3) in rad about the axes of `order`."""
    angles = np.asarray(angles)
    R = np.eye(3)
    for i, axis in enumerate(order):
        R = R @ spatial.exp_so3(angles[..., i, None] * _AXES[axis])
    return R


def angles_of(R: Array, order: RotationOrder, reference: Array) -> Array:
    """Return the angles (3,) in rad of R (3, 3) about the axes of `order` that are the nearest to `reference`.

    The angles change linearly in a phase: a difference of 2 pi would rotate the tool by a full turn. If the middle
    angle is a right angle, the first angle is taken from `reference`, (3,) in rad.
    """
    a, b, c = spatial.euler_angles(R, order, reference[0])
    # the same rotation with the other sign of the middle angle's cosine
    solutions = np.array([[a, b, c], [a + np.pi, np.pi - b, c + np.pi]])
    full_turns = np.round((solutions - reference) / (2 * np.pi))
    solutions -= 2 * np.pi * full_turns
    return min(solutions, key=lambda angles: float(np.linalg.norm(angles - reference)))


def _turning(start: Array, rate: Array, s: Array, order: RotationOrder) -> tuple[Array, Array, Array]:
    """Return R (k, 3, 3), its rate (k, 3) and the derivative of the rate (k, 3), in base, for angles linear in s."""
    angles = start + s[:, None] * rate
    e0, e1, e2 = (_AXES[axis] for axis in order)
    R = spatial.exp_so3(angles[:, :1] * e0)
    axis1 = R @ e1
    R = R @ spatial.exp_so3(angles[:, 1:2] * e1)
    axis2 = R @ e2
    R = R @ spatial.exp_so3(angles[:, 2:] * e2)
    # each axis moves with the rotations before it: its derivative is their rate x the axis
    turn0 = np.broadcast_to(rate[0] * e0, axis1.shape)
    turn1 = turn0 + rate[1] * axis1
    w1 = turn1 + rate[2] * axis2
    w2 = rate[1] * np.cross(turn0, axis1) + rate[2] * np.cross(turn1, axis2)
    return R, w1, w2
