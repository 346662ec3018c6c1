"""Local planes: surfaces at a tool, approximated between two updates of the simulation that finds the contacts.

A simulation of contact or tissue updates a few planes in each of its steps: every few ms, or at 60 Hz. Between two
updates, the planes do not move, and the depth of the tool in a plane depends on the tool's pose alone. Therefore, the
force on the hand is computed at 1 kHz without waiting for the simulation (intermediate representation; Adachi, Kumano
and Ogino, IEEE VRAIS 1995).

The planes of a robot are a signal of `SIGNAL_SIZE` numbers, `PLANE_COUNT` rows of `PLANE_SIZE`; unused rows are zero. A
row is (lever (3), normal (3), arm (3), offset): see `LocalPlane`. All vectors are in the frame of the World, except the
arm, which is in the frame of the tool.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array

PLANE_COUNT = 4
"""Number of planes of a robot in one signal."""

PLANE_SIZE = 10
"""Number of values of a plane."""

SIGNAL_SIZE = PLANE_COUNT * PLANE_SIZE
"""Number of values in a signal with the planes of a robot."""


@dataclass(frozen=True)
class LocalPlane:
    """A plane that a part of a robot touches.

    The depth in m of the part in the plane is offset - lever . p - normal . (R arm), where p and R are position and
    rotation of the tool in the World. For a point that moves with the tool, the lever is the normal. For a point of the
    shaft, the lever is the displacement of the point along the normal per displacement of the tool; the arm is zero.

    Attributes:
        normal: (3,) unit vector out of the surface.
        lever: (3,) displacement along the normal per displacement of the tool.
        arm: (3,) point in m in the frame of the tool.
        offset: constant term of the depth in m.
    """

    normal: Array
    lever: Array
    arm: Array
    offset: float

    @classmethod
    def at_tool(cls, T_world_tool: Array, point: Array, normal: Array, depth: float) -> LocalPlane:
        """Return the plane of a point that moves with the tool.

        Args:
            T_world_tool: (4, 4) pose of the tool when the contact was found.
            point: (3,) deepest point of the tool in m in the World.
            normal: (3,) unit vector out of the surface, in the World.
            depth: depth of the point in the surface in m.
        """
        R = T_world_tool[:3, :3]
        p = T_world_tool[:3, 3]
        return cls(normal, normal, R.T @ (point - p), float(normal @ point) + depth)

    @classmethod
    def at_shaft(cls, T_world_tool: Array, lever: Array, normal: Array, depth: float) -> LocalPlane:
        """Return the plane for a contact on the shaft.

        T_world_tool, normal and depth are arguments of `at_tool`; lever (3,) is an attribute of `LocalPlane`.
        """
        return cls(normal, lever, np.zeros(3), float(lever @ T_world_tool[:3, 3]) + depth)

    def depth(self, T_world_tool: Array) -> float:
        """Return the depth in m at a pose (4, 4) of the tool; negative outside."""
        R = T_world_tool[:3, :3]
        p = T_world_tool[:3, 3]
        return float(self.offset - self.lever @ p - self.normal @ R @ self.arm)


def rows(planes: Sequence[LocalPlane], T_world_tool: Array) -> Array:
    """Return the signal (SIZE,) of at most `PLANE_COUNT` of the planes at T_world_tool (4, 4).

    The planes are selected one by one. The next plane is the one in which the tool is deepest when it has been moved
    out of the planes selected before. Thus similar planes on one side of the tool do not fill all rows.
    """
    plane_rows = np.zeros((PLANE_COUNT, PLANE_SIZE))
    depths = np.array([plane.depth(T_world_tool) for plane in planes])
    normals = np.array([plane.normal for plane in planes])
    for row in plane_rows[: len(planes)]:
        k = int(np.argmax(depths))
        plane = planes[k]
        row[:3] = plane.lever
        row[3:6] = plane.normal
        row[6:9] = plane.arm
        row[9] = plane.offset
        depths -= normals @ plane.normal * max(depths[k], 0.0)
        depths[k] = -np.inf  # selected only once
    return plane_rows.ravel()
