"""One description of a robot as joint lines at a drawn state, and its forward kinematics by products of exponentials.

Bodies that are fixed to each other are one group. All lines and frames are in the base frame, in SI units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.model.inertia import Inertia
from twin.model.mechanism import Mechanism

TURNING_KINDS = ("revolute", "cylindrical")
"""Joint types that turn about a line."""

ONE_COORDINATE_KINDS = ("revolute", "prismatic")
"""Joint types with one coordinate, which has a sign and a zero."""

UNLIMITED = (-np.inf, np.inf)
"""Limits of a joint of which the file states that it has none."""


@dataclass(frozen=True)
class Axis:
    """A moving joint of a side.

    Attributes:
        name, kind: name and type of the joint, see `model.joint.FREE_AXES`.
        parent, child: indices of the groups of bodies that it connects.
        point, direction: (3,) a point on its line in m, and the unit vector along it, in base, at the drawn state.
        drawn: coordinate at the drawn state in m or rad.
        closes_loop: whether the joint closes a loop, and is not in the tree.
        active: whether a motor drives it.
        limits: range of the coordinate in m or rad; `UNLIMITED` if the file states that there are no limits; None if it
            states nothing.
        max_speed: as in `model.joint.Joint`.
        is_directed: whether the description states which way along the line is positive.
        opening: distance in m and angle in rad by which a joint that closes a loop leaves it open at the drawn state.
        open_weld: name of the weld, or other joint without an axis, that is so far apart; "": the joint itself.
        merged_axes: the joints that the description writes instead of this one, see the module `merged_joints`.
    """

    name: str
    kind: str
    parent: int
    child: int
    point: Array
    direction: Array
    drawn: float
    closes_loop: bool = False
    active: bool = True
    limits: tuple[float, float] | None = None
    max_speed: float | None = None
    is_directed: bool = True
    merged_axes: tuple[Axis, ...] = ()
    opening: tuple[float, float] = (0.0, 0.0)
    open_weld: str = ""

    @property
    def merged_names(self) -> tuple[str, ...]:
        """Plain names of the joints that the description writes instead of this one."""
        return tuple(plain_name(axis.name) for axis in self.merged_axes)

    @property
    def is_angle(self) -> bool:
        """Whether the coordinate is an angle."""
        return self.kind != "prismatic"

    def moved_by(self, motion: Array) -> Axis:
        """Return the joint with its line moved by a motion (4, 4) in base."""
        point = motion[:3, :3] @ self.point + motion[:3, 3]
        return replace(self, point=point, direction=motion[:3, :3] @ self.direction)


@dataclass(frozen=True)
class JointGroup:
    """Bodies fixed to each other: their names, and their common inertia in base at the drawn state, or None."""

    bodies: tuple[str, ...]
    inertia: Inertia | None = None


@dataclass(frozen=True)
class CouplingRow:
    """A coupling of the moving joints of a side: the sum of ratio times coordinate over its joints is constant.

    Attributes:
        follower: name of the joint that the others move.
        ratios: {joint: its ratio, in the unit of the follower per unit of the joint}; 1 for the follower.
        total: the constant sum in m or rad, the unit of the follower.
    """

    follower: str
    ratios: Mapping[str, float]
    total: float


@dataclass(frozen=True)
class DhTableRow:
    """A row of a table of Denavit-Hartenberg parameters.

    Attributes:
        file, line: where it stands.
        joint, link: names of its joint and of the body behind it.
        convention: "standard", "modified", "khalil" or "hayati".
        values: {parameter: its value in m or rad}.
        units: {parameter: unit of the file in m or rad}.
        joints_below, frames_below: names of the joints behind its body, and of the frames of its body and behind it.
    """

    file: str
    line: int
    joint: str
    link: str
    convention: str
    values: Mapping[str, float]
    units: Mapping[str, float]
    joints_below: frozenset[str] = frozenset()
    frames_below: frozenset[str] = frozenset()


@dataclass(frozen=True)
class PoseRows:
    """Joint values and the tool poses that were measured, or computed by equations, at them.

    Attributes:
        joints: names of the joints, in the order of the columns of q.
        angles: whether each joint is an angle.
        q: (k, joints) values in rad or m.
        T: (k, 4, 4) T_base_tool, in frames of the one who measured.
        rotations: whether the rotations are known.
        lines: lines of a table; () for computed rows.
        noise: standard deviations of a coordinate in m and of a rotation about an axis in rad; None: not stated.
        computed: whether equations compute the poses.
    """

    joints: tuple[str, ...]
    angles: tuple[bool, ...]
    q: Array
    T: Array
    rotations: bool = True
    lines: tuple[int, ...] = ()
    noise: tuple[float | None, float | None] = (None, None)
    computed: bool = False

    def selected(self, mask: NDArray[np.bool_]) -> PoseRows:
        """Return the rows of which the mask (k,) is true."""
        rows = np.flatnonzero(mask)
        lines = self.lines
        if lines:
            lines = tuple(np.array(lines)[rows].tolist())
        return replace(self, q=self.q[rows], T=self.T[rows], lines=lines)


@dataclass(frozen=True)
class RobotSide:
    """One description of a robot.

    Attributes:
        label: how the user named the side.
        name: name of the robot.
        axes: moving joints; those of the tree first, parents first.
        groups: groups of bodies; the first contains the base.
        frames: {name of a frame or body: (group, T_base_frame (4, 4) at the drawn state)}.
        tool: name of the tool frame.
        is_tool_guessed: whether the description names no tool, so that the tool is only the last body.
        couplings: the couplings of two or more moving joints.
        driven_joints: names of the driven joints, in the order of q.
        path: the file; None if there is none.
        text: the URDF that the file describes, if the file is a xacro; else None.
        xacro_places: {"joint/NAME/origin", ...: (file, line)} of that URDF in the xacro files.
        dh_rows: the rows, if the file is a table of Denavit-Hartenberg parameters.
        notes: texts on data that the reader left out.
        efforts: {joint: maximum effort in N or N m}.
        mechanism: the mechanism, for pictures; None if the side is only equations or poses.
        reread: a function that reads a changed text of the file, or of `text`; it raises a TwinError if it cannot.
        reread_closed: the same for a robot with loops, which are closed again: only few numbers can be tried.
            None for files without text.
        sample_poses: function that returns rows of poses, for measured poses and for equations; else None.
        tool_poses: function from q (k, order) to T_base_tool (k, 4, 4), for a robot with loops; NaN where they open.
    """

    label: str
    name: str
    axes: tuple[Axis, ...]
    groups: tuple[JointGroup, ...]
    frames: Mapping[str, tuple[int, Array]]
    tool: str = ""
    is_tool_guessed: bool = False
    couplings: tuple[CouplingRow, ...] = ()
    driven_joints: tuple[str, ...] = ()
    path: Path | None = None
    text: bytes | None = None
    xacro_places: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    dh_rows: tuple[DhTableRow, ...] = ()
    notes: tuple[str, ...] = ()
    efforts: Mapping[str, float] = field(default_factory=dict)
    mechanism: Mechanism | None = None
    reread: Callable[[bytes], RobotSide] | None = field(default=None, repr=False, compare=False)
    reread_closed: Callable[[bytes], RobotSide] | None = field(default=None, repr=False, compare=False)
    sample_poses: Callable[[], PoseRows] | None = None
    tool_poses: Callable[[Array], Array] | None = None

    @property
    def tree(self) -> tuple[Axis, ...]:
        """The joints of the tree, parents first."""
        return tuple(axis for axis in self.axes if not axis.closes_loop)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, in the order of `axes`."""
        return [axis.name for axis in self.axes]

    @property
    def has_loops(self) -> bool:
        """Whether the side has closed loops."""
        return any(axis.closes_loop for axis in self.axes)

    def index(self, name: str) -> int:
        """Return the index of a joint."""
        for i, axis in enumerate(self.axes):
            if axis.name == name:
                return i
        raise TwinError(f"{self.label}: {unknown('moving joint', name, self.joint_names)}")

    def group_motions(self, displacements: Array) -> Array:
        """Return the motions (k, groups, 4, 4) of the groups since the drawn state, for displacements (k, tree joints).

        The motion of a group maps its points at the drawn state to their places after the joints of the tree have
        moved by the displacements in m or rad, both in base.
        """
        count = len(displacements)
        motions = np.zeros((count, len(self.groups), 4, 4))
        motions[:] = np.eye(4)
        for i, axis in enumerate(self.tree):
            step = joint_motion(axis, displacements[:, i])
            # on the right: the line of the joint is that of the drawn state, before its parents moved
            motions[:, axis.child] = motions[:, axis.parent] @ step
        return motions


@lru_cache(maxsize=4096)
def plain_name(name: str) -> str:
    """Return a name without case, punctuation and spaces: readers change these to make identifiers.

    Signs between digits stay as "_": "j1_1" and "j_11" are two joints.
    """
    parted_numbers = re.sub(r"(?<=[0-9])[^a-z0-9]+(?=[0-9])", "_", name.lower())
    return re.sub(r"[^a-z0-9_]|(?<![0-9])_|_(?![0-9])", "", parted_numbers)


def common_prefix(names: Sequence[str]) -> str:
    """Return the letters with which all of some names begin."""
    # the names between these two in the alphabet share what the two share
    first = min(names)
    last = max(names)
    length = 0
    while length < min(len(first), len(last)) and first[length] == last[length]:
        length += 1
    return first[:length]


def joint_motion(axis: Axis, displacement: Array) -> Array:
    """Return the motions (k, 4, 4) of displacements (k,) in m or rad along or about the line of a joint."""
    if axis.kind == "prismatic":
        return spatial.pose(p=displacement[:, None] * axis.direction)
    if axis.kind in TURNING_KINDS:
        R = spatial.exp_so3(displacement[:, None] * axis.direction)
        return spatial.pose(R, axis.point - R @ axis.point)
    return spatial.pose(np.broadcast_to(np.eye(3), (len(displacement), 3, 3)))
