"""Local planes: surfaces at a tool, approximated between two updates of the simulation that finds the contacts.

A simulation of contact or tissue updates a few planes whenever it steps: every 2 ms, or at 60 Hz. Between two updates,
a plane does not move, and the depth of the tool in it depends on the tool's pose alone. The hand at 1 kHz therefore
never waits for the simulation (intermediate representation; Adachi, Kumano and Ogino, IEEE VRAIS 1995).

The planes of a robot are a signal of `SIZE` numbers, `COUNT` rows of `WIDTH`; unused rows are zero. A row is (lever
(3), normal (3), arm (3), offset): see `LocalPlane`. Everything is in the frame of the World, except the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core.spatial import Array

COUNT, WIDTH = 4, 10
"""Number of planes of a robot in one signal; number of values of a plane."""

SIZE = COUNT * WIDTH
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
        offset: in m.
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
        R, p = T_world_tool[:3, :3], T_world_tool[:3, 3]
        return cls(normal, normal, R.T @ (point - p), float(normal @ point) + depth)

    @classmethod
    def at_shaft(cls, T_world_tool: Array, lever: Array, normal: Array, depth: float) -> LocalPlane:
        """Return the plane of a point of the shaft; arguments as in `at_tool` and `LocalPlane`."""
        return cls(normal, lever, np.zeros(3), float(lever @ T_world_tool[:3, 3]) + depth)

    def depth(self, T_world_tool: Array) -> float:
        """Return the depth in m at a pose (4, 4) of the tool; negative outside."""
        R, p = T_world_tool[:3, :3], T_world_tool[:3, 3]
        return float(self.offset - self.lever @ p - self.normal @ R @ self.arm)


def rows(planes: Sequence[LocalPlane], T_world_tool: Array) -> Array:
    """Return the signal (SIZE,) of planes, at most `COUNT`: those that are deepest at T_world_tool (4, 4)."""
    out = np.zeros((COUNT, WIDTH))
    deepest = sorted(planes, key=lambda plane: -plane.depth(T_world_tool))[:COUNT]
    for row, plane in zip(out, deepest, strict=False):
        row[:3], row[3:6], row[6:9], row[9] = plane.lever, plane.normal, plane.arm, plane.offset
    return out.ravel()


def proxy(planes: ca.SX, T_world_tool: ca.SX, sweeps: int = 12) -> tuple[ca.SX, ca.SX]:
    """Return the expressions (way (3,), pull (3,)) of the nearest point outside all planes, the proxy of the tool.

    The way in m is from the point in contact to its proxy, the smallest displacement that leaves all planes (Zilles
    and Salisbury, IROS 1995; solved by Hildreth's method). Two planes with the same normal count once. The pull in m is
    the same sum over planes, with levers instead of normals: the force at the tool acts along the pull.

    Args:
        planes: (k, WIDTH) rows.
        T_world_tool: (4, 4) pose of the tool.
        sweeps: number of iterations over all planes; one is enough for two planes that are parallel or perpendicular.
    """
    p, R, count = T_world_tool[:3, 3], T_world_tool[:3, :3], planes.shape[0]
    n = [planes[i, 3:6].T for i in range(count)]
    g = [planes[i, :3].T for i in range(count)]
    x = [planes[i, 9] - ca.dot(g[i], p) - ca.dot(n[i], R @ planes[i, 6:9].T) for i in range(count)]
    push = [ca.SX(0) for _ in range(count)]
    way = ca.SX.zeros(3)
    for _ in range(sweeps):
        for i in range(count):
            new = ca.fmax(push[i] + x[i] - ca.dot(n[i], way), 0)  # an unused row is zero: it never pushes
            way, push[i] = way + n[i] * (new - push[i]), new
    pull = ca.SX.zeros(3)
    for a, b in zip(g, push, strict=True):
        pull += a * b
    return way, pull
