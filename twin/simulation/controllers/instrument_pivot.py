"""An instrument in a port: a hand controls either its tip or its outer end; the two move in opposite directions.

The port is the fulcrum of a lever. If the hand controls the outer end ("direct"), as a hand outside the patient does, a
motion to the right moves the tip to the left by this motion times inner length / outer length. If the hand controls the
tip ("compensated"), the controller computes the motion of the outer end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, length
from twin.core.units import DEG, MM

Fulcrum = Literal["compensated", "direct"]

FULCRUMS: tuple[Fulcrum, ...] = ("compensated", "direct")
"""What the hand controls: the tip or the outer end. The index of an item is its value in `<device>.fulcrum`."""

SHORTEST_PART = 20 * MM
"""Smallest length in m of an instrument on each side of its port, so that neither end reaches it; ASSUMED."""

LARGEST_ANGLE = 60 * DEG
"""Largest angle in rad between an instrument and its direction at the start; ASSUMED, for the abdominal wall."""


@dataclass(frozen=True)
class InstrumentPivot:
    """An instrument as a straight line from its tip through its port to its outer end.

    Attributes:
        p_port: (3,) the port in m in the robot's base.
        axis: (3,) unit vector from the port to the tip at the start, in the robot's base.
        length: distance in m from the tip to the outer end.
        guided: whether `tool` turns the z axis of the tool into the line of the instrument; needed if no mechanism
            keeps the instrument in the port.
    """

    p_port: Array
    axis: Array
    length: float
    guided: bool

    def outer(self, T: Array) -> Array:
        """Return the pose (4, 4) of the outer end for a tool pose T (4, 4), both in base, with the same orientation."""
        inner = T[:3, 3] - self.p_port  # from the port to the tip
        depth = max(length(inner), 1e-9)
        return spatial.pose(T[:3, :3], self.p_port - inner * ((self.length - depth) / depth))

    def tool(self, T: Array, direct: bool) -> Array:
        """Return the tool pose (4, 4) in base for the pose that the hand controls.

        It is limited by `SHORTEST_PART` and `LARGEST_ANGLE`.

        Args:
            T: (4, 4) pose in base that the hand controls: of the outer end if `direct`, else of the tool.
            direct: whether the hand controls the outer end.
        """
        line = T[:3, 3] - self.p_port
        if direct:
            line = self.p_port - T[:3, 3]  # the outer end is on the other side of the port
        distance = length(line)
        depth = self.length - distance if direct else distance
        depth = min(max(depth, SHORTEST_PART), self.length - SHORTEST_PART)
        a = self.axis  # a pose in the port gives no direction
        if distance > 1e-9:
            a = self._in_cone(line / distance)
        R = T[:3, :3]
        if self.guided:
            R = turned(R[:, 2], a) @ R
        return spatial.pose(R, self.p_port + depth * a)

    def _in_cone(self, a: Array) -> Array:
        """Return the unit vector in the cone about `axis` that is nearest to the unit vector a (3,)."""
        along = float(a @ self.axis)
        if along >= np.cos(LARGEST_ANGLE):
            return a
        across = a - along * self.axis
        size = length(across)
        if size < 1e-9:
            return self.axis  # opposite to the axis: no edge of the cone is nearest
        return np.cos(LARGEST_ANGLE) * self.axis + np.sin(LARGEST_ANGLE) * across / size


def turned(a: Array, b: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns the unit vector a (3,) into b (3,)."""
    # Two reflections: exact also near half a turn, where the usual formula divides two differences that cancel.
    middle = a + b
    size = length(middle)
    if size < 1e-8:  # half a turn about any axis across a
        across = spatial.frame_from_axes(a, spatial.unit_across(a))[:, 0]
        return spatial.exp_so3(np.pi * across)
    across_a = np.eye(3) - np.outer(a, 2 * a)
    across_middle = np.eye(3) - np.outer(middle, 2 / size**2 * middle)
    return across_middle @ across_a
