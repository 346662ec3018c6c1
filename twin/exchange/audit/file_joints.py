"""A joint between two links, as a file states it.

A joint has a pose and lines, both in the parent's frame. The pose is the pose of the child at zero coordinates. The
child moves along or about the lines. A tie is a pair of coinciding points; MJCF states closures of loops by ties.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.motion_lines import JointLine, kind_of_lines, meeting_point, turns_and_slides, unit
from twin.exchange.audit.new_names import renamed
from twin.exchange.audit.poses import Array

_MIN_TIE_DISTANCE = 1e-3
"""Minimum distance in m between two tied points of a hinge: nearer points let it tilt like a ball joint.

Also the minimum distance of a third point from the axis of the hinge that fixes the joint."""


WORLD = "world"
"""Name of the base in many files, and of the fixed body that every MJCF has."""

ONE_COORDINATE = ("revolute", "prismatic")
"""Kinds of joints with one coordinate, which all formats state by one name."""


@dataclass(frozen=True)
class FileJoint:
    """A joint between two links.

    Attributes:
        names: names of the joint's parts in the file; usually one.
        parent, child: names of the two links; "" if not stated.
        T: pose T_parent_child (4, 4) at zero coordinates; None if not stated.
        motions: lines along or about which the joint moves, in the parent's frame, from the parent outwards.
        drive: limits and drive of the joint.
        tied: for each tie, (point in the parent's frame, same point in the child's frame), both (3,) in m; empty
            unless the file states the joint only by ties (MJCF connect).
        stated_kind: kind of the joint, if the file states a kind but no axis (tracks, GLB); else "".
    """

    names: tuple[str, ...]
    parent: str
    child: str
    T: Array | None = None
    motions: tuple[JointLine, ...] = ()
    drive: FileDrive = field(default_factory=FileDrive)
    tied: tuple[tuple[Array, Array], ...] = ()
    stated_kind: str = ""

    def renamed(self, links: Mapping[str, str], joints: Mapping[str, str]) -> FileJoint:
        """Return the joint after renaming links and joints by {old: new}."""
        parent, child = renamed((self.parent, self.child), links)
        return replace(self, names=renamed(self.names, joints), parent=parent, child=child)

    @property
    def kind(self) -> str:
        """Fixed, revolute, prismatic, cylindrical, spherical, free, "chain of ..." (other motions), or "" (unknown)."""
        if self.stated_kind:
            return self.stated_kind
        if self.tied:
            return _kind_of_ties(self.tied)
        if self.T is None:
            return ""
        return kind_of_lines(self.motions)

    def end(self, link: str) -> tuple[Array, Array | None] | None:
        """Return (point (3,) in m, direction (3,) or None for a ball) of the joint in the frame of one of its links.

        Return None if the file does not state the position of the joint. Files may exchange parent and child; therefore
        the direction is reversed if the child's name comes before the parent's in alphabetical order. The direction of
        a tie has no defined sign.
        """
        sign = 1.0 if self.parent < self.child else -1.0
        at_parent = link == self.parent
        if self.tied:
            points = []
            for on_parent, on_child in self.tied:
                points.append(on_parent if at_parent else on_child)
            if len(points) < 2:
                return points[0], None
            # Also of two points that nearly meet: the place of the ball is then compared across the line, as of a pin.
            first, second = _ends_of_ties(self.tied)
            return points[0], sign * unit(points[second] - points[first])
        if self.T is None or not self.motions:
            return None
        turns, _ = turns_and_slides(self.motions)
        if self.kind == "spherical":
            center = meeting_point(turns)
            if not at_parent:
                center = _moved(center, poses.inverse(self.T))
            return center, None
        line = self.motions[-1]
        if turns:
            # In a cylindrical joint, both lines are the same; the axis of a turn has a place, that of a slide has none.
            line = turns[-1]
        if link == self.child:
            line = line.transformed(poses.inverse(self.T))
        return line.point, sign * line.direction

    def reversed(self) -> FileJoint:
        """Return the joint with parent and child exchanged; the signs of its coordinates do not change."""
        tied = []
        for on_parent, on_child in self.tied:
            tied.append((on_child, on_parent))
        drive = replace(self.drive, cone_axis=None)  # it is known in the frame of the other link
        exchanged = replace(self, parent=self.child, child=self.parent, tied=tuple(tied), drive=drive)
        if self.T is None:
            return exchanged
        T_child_parent = poses.inverse(self.T)
        motions = []
        for line in reversed(self.motions):
            # Seen from the child, the parent moves the other way: the same coordinate needs the opposite direction.
            motions.append(line.transformed(T_child_parent, -1.0))
        return replace(exchanged, T=T_child_parent, motions=tuple(motions))


def _kind_of_ties(tied: tuple[tuple[Array, Array], ...]) -> str:
    """Return the kind of a joint of tied points: points in one place are a ball, on one line a hinge, others fixed."""
    first, second = _ends_of_ties(tied)
    origin, _ = tied[first]
    end, _ = tied[second]
    if not np.linalg.norm(end - origin) > _MIN_TIE_DISTANCE:
        return "spherical"
    axis = unit(end - origin)
    for point, _ in tied:
        if np.linalg.norm(np.cross(axis, point - origin)) > _MIN_TIE_DISTANCE:
            return "fixed"
    return "revolute"


def _ends_of_ties(tied: tuple[tuple[Array, Array], ...]) -> tuple[int, int]:
    """Return the indices of the two tied points that are farthest apart, the lower one first; (0, 0) of one point."""
    ends = (0, 0)
    largest = -1.0
    for first, second in combinations(range(len(tied)), 2):
        distance = float(np.linalg.norm(tied[second][0] - tied[first][0]))
        if distance > largest:
            ends = (first, second)
            largest = distance
    return ends


def _moved(p: Array, T: Array) -> Array:
    return T[:3, :3] @ p + T[:3, 3]
