"""Lines along or about which a joint of a file moves, and the kind of joint that they make."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array

_COINCIDENCE_TOL = 1e-5
"""Tolerance in m and in components of unit vectors, within which lines coincide or meet in a point."""


_MIN_SPANNED_VOLUME = 1e-3
"""Volume that three unit vectors must span to be in no common plane: in a plane, they cannot turn a body everywhere."""


@dataclass(frozen=True)
class JointLine:
    """Line of a joint's motion, in the frame of the joint's parent: the child turns about it, or slides along it.

    Attributes:
        kind: "turn" or "slide".
        point: point (3,) on the line in m.
        direction: unit vector (3,).
    """

    kind: str
    point: Array
    direction: Array

    def transformed(self, T: Array, sign: float = 1.0) -> JointLine:
        """Return the line transformed by the pose T (4, 4), with its direction multiplied by `sign`."""
        return JointLine(self.kind, T[:3, :3] @ self.point + T[:3, 3], sign * T[:3, :3] @ self.direction)

    def motion(self, q: Array | float) -> Array:
        """Return the motion (..., 4, 4) of the child, in the parent's frame, for q (...) in m or rad."""
        if self.kind == "slide":
            return poses.pose(None, np.multiply.outer(q, self.direction))
        T_at_point = poses.pose(None, self.point)
        return T_at_point @ poses.pose(poses.about(self.direction, q)) @ poses.inverse(T_at_point)


_KIND_BY_COUNTS = {(0, 0): "fixed", (1, 0): "revolute", (0, 1): "prismatic", (3, 3): "free"}
"""Kinds of joints that the numbers of their turns and slides determine."""


def kind_of_lines(motions: tuple[JointLine, ...]) -> str:
    """Return the kind of a joint with these lines, as in `FileJoint.kind`."""
    turns, slides = turns_and_slides(motions)
    count = (len(turns), len(slides))
    if count in _KIND_BY_COUNTS:
        return _KIND_BY_COUNTS[count]
    if count == (1, 1):
        sine = np.linalg.norm(np.cross(turns[0].direction, slides[0].direction))
        if sine < _COINCIDENCE_TOL:
            return "cylindrical"
    if count == (3, 0) and _meet_in_a_point(turns):
        return "spherical"
    return f"chain of {len(turns)} turns and {len(slides)} slides"


def turns_and_slides(motions: tuple[JointLine, ...]) -> tuple[list[JointLine], list[JointLine]]:
    """Return (lines about which the child turns, lines along which it slides), each in their order."""
    turns = []
    slides = []
    for line in motions:
        if line.kind == "turn":
            turns.append(line)
        else:
            slides.append(line)
    return turns, slides


def _meet_in_a_point(turns: list[JointLine]) -> bool:
    """Return whether three lines, which are not in one plane, meet in a point."""
    directions = [line.direction for line in turns]
    if not abs(np.linalg.det(directions)) > _MIN_SPANNED_VOLUME:
        return False
    point = meeting_point(turns)
    for line in turns:
        moment = np.cross(line.direction, point - line.point)
        if not np.linalg.norm(moment) < _COINCIDENCE_TOL:
            return False
    return True


def meeting_point(lines: Collection[JointLine]) -> Array:
    """Return the point (3,) in m with the minimum sum of squared distances from the lines."""
    # normal equations of the sum of |P (x - p)|^2, with the projector P across each line and a point p on it
    A = np.zeros((3, 3))
    b = np.zeros(3)
    for line in lines:
        projector = np.eye(3) - np.outer(line.direction, line.direction)  # onto the plane normal to the line
        A += projector
        b += projector @ line.point
    # Parallel lines leave A singular; of all nearest points, least squares gives that nearest to the origin.
    solution, *_ = np.linalg.lstsq(A, b, rcond=None)
    return solution


def unit(v: Array) -> Array:
    """Return the unit vector of v (3,); a zero vector is unchanged."""
    size = float(np.linalg.norm(v))
    if size > 0:
        return v / size
    return v


def motion_lines(kind: str, T: Array, axis: int = 2) -> tuple[JointLine, ...]:
    """Return the lines along or about which a joint moves, in the parent's frame; () if `kind` has no lines.

    T (4, 4) is the pose T_parent_joint of the joint's frame; `axis` 0, 1 or 2 is the x, y or z axis of this frame.
    """
    point = T[:3, 3]
    axes = T[:3, :3].T
    if kind in ("revolute", "prismatic", "cylindrical"):
        axes = axes[axis, None]  # the only axis, as rows (1, 3)
    lines: list[JointLine] = []
    # Slides before turns: after a turn, the lines of the slides would be rotated by it.
    if kind in ("prismatic", "cylindrical", "free"):
        for direction in axes:
            lines.append(JointLine("slide", point, direction))
    if kind in ("revolute", "cylindrical", "spherical", "free"):
        for direction in axes:
            lines.append(JointLine("turn", point, direction))
    return tuple(lines)
