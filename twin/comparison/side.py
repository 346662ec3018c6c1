"""One description of a robot as joint lines at a drawn state, and its forward kinematics by products of exponentials.

Bodies that are fixed to each other are one group. All lines and frames are in the base frame, in SI units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

TURNING = ("revolute", "cylindrical")
"""Joint types that turn about a line."""

ONE_COORDINATE = ("revolute", "prismatic")
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
        closing: whether the joint closes a loop, and is not in the tree.
        active: whether a motor drives it.
        limits: range of the coordinate in m or rad; `UNLIMITED` if the file states that there are no limits; None if it
            states nothing.
        max_speed: as in `model.joint.Joint`.
        directed: whether the description states which way along the line is positive.
        opened: distance in m and angle in rad by which a joint that closes a loop leaves it open at the drawn state.
        joined: the joints that the description writes instead of this one, see the module `joined`.
    """

    name: str
    kind: str
    parent: int
    child: int
    point: Array
    direction: Array
    drawn: float
    closing: bool = False
    active: bool = True
    limits: tuple[float, float] | None = None
    max_speed: float | None = None
    directed: bool = True
    joined: tuple[Axis, ...] = ()
    opened: tuple[float, float] = (0.0, 0.0)

    @property
    def parts(self) -> tuple[str, ...]:
        """Plain names of the joints that the description writes instead of this one."""
        return tuple(plain(axis.name) for axis in self.joined)

    @property
    def is_angle(self) -> bool:
        """Whether the coordinate is an angle."""
        return self.kind != "prismatic"


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
class TableLine:
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

    def chosen(self, kept: NDArray[np.bool_]) -> PoseRows:
        """Return some of the rows (k,), given as bool."""
        rows = np.flatnonzero(kept)
        lines = tuple(self.lines[k] for k in rows) if self.lines else ()
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
        guessed_tool: whether the description names no tool, so that the tool is only the last body.
        couplings: the couplings of two or more moving joints.
        order: names of the driven joints, in the order of q.
        path: the file; None if there is none.
        text: the URDF that the file describes, if the file is a xacro; else None.
        places: {"joint/NAME/origin", ...: (file, line)} of that URDF in the xacro files.
        rows: the rows, if the file is a table of Denavit-Hartenberg parameters.
        notes: texts on data that the reader left out.
        efforts: {joint: maximum effort in N or N m}.
        mechanism: the mechanism, for pictures; None if the side is only equations or poses.
        reread: a function that reads a changed text of the file, or of `text`; it raises a TwinError if it cannot.
        reread_closed: the same for a robot with loops, which are closed again: only few numbers can be tried.
            None for files without text.
        sampled: function that returns rows of poses, for measured poses and for equations; else None.
        tool_poses: function from q (k, order) to T_base_tool (k, 4, 4), for a robot with loops; NaN where they open.
    """

    label: str
    name: str
    axes: tuple[Axis, ...]
    groups: tuple[JointGroup, ...]
    frames: Mapping[str, tuple[int, Array]]
    tool: str = ""
    guessed_tool: bool = False
    couplings: tuple[CouplingRow, ...] = ()
    order: tuple[str, ...] = ()
    path: Path | None = None
    text: bytes | None = None
    places: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    rows: tuple[TableLine, ...] = ()
    notes: tuple[str, ...] = ()
    efforts: Mapping[str, float] = field(default_factory=dict)
    mechanism: Mechanism | None = None
    reread: Callable[[bytes], RobotSide] | None = field(default=None, repr=False, compare=False)
    reread_closed: Callable[[bytes], RobotSide] | None = field(default=None, repr=False, compare=False)
    sampled: Callable[[], PoseRows] | None = None
    tool_poses: Callable[[Array], Array] | None = None

    @property
    def tree(self) -> tuple[Axis, ...]:
        """The joints of the tree, parents first."""
        return tuple(axis for axis in self.axes if not axis.closing)

    @property
    def looped(self) -> bool:
        """Whether the side has closed loops."""
        return any(axis.closing for axis in self.axes)

    def index(self, name: str) -> int:
        """Return the index of a joint."""
        for i, axis in enumerate(self.axes):
            if axis.name == name:
                return i
        raise TwinError(f"{self.label}: {unknown('moving joint', name, [axis.name for axis in self.axes])}")

    def poses(self, displacements: Array) -> Array:
        """Return the motions (k, groups, 4, 4) of the groups since the drawn state, for displacements (k, tree joints).

        The motion of a group maps its points at the drawn state to their places after the joints of the tree have
        moved by the displacements in m or rad, both in base.
        """
        count = len(displacements)
        motions = np.zeros((count, len(self.groups), 4, 4))
        motions[:] = np.eye(4)
        for i, axis in enumerate(self.tree):
            step = joint_motion(axis, displacements[:, i])
            motions[:, axis.child] = motions[:, axis.parent] @ step
        return motions


@lru_cache(maxsize=4096)
def plain(name: str) -> str:
    """Return a name without case, signs and spaces: readers change these to make identifiers.

    Signs between digits stay as "_": "j1_1" and "j_11" are two joints.
    """
    kept = re.sub(r"(?<=[0-9])[^a-z0-9]+(?=[0-9])", "_", name.lower())
    return re.sub(r"[^a-z0-9_]|(?<![0-9])_|_(?![0-9])", "", kept)


def joint_motion(axis: Axis, displacement: Array) -> Array:
    """Return the motions (k, 4, 4) of displacements (k,) in m or rad along or about the line of a joint."""
    if axis.kind == "prismatic":
        return spatial.pose(p=displacement[:, None] * axis.direction)
    if axis.kind in TURNING:
        R = spatial.exp_so3(displacement[:, None] * axis.direction)
        return spatial.pose(R, axis.point - R @ axis.point)
    return spatial.pose(np.broadcast_to(np.eye(3), (len(displacement), 3, 3)))


_CARRIER = 1.001e-3
"""Mass in kg up to which a link between a joint and a weld is no part of the robot, see `_carriers`."""


def drawn_poses(mechanism: Mechanism) -> tuple[dict[str, Array], dict[str, float]]:
    """Return ({body: T_base_body}, {joint: coordinate}) at the state at which lines are compared.

    This is the state with all coordinates zero or, for a robot with closed loops, the drawn state, which closes them.
    """
    if mechanism.loops:
        poses = dict(mechanism.rest)
        coordinates = {}
        for joint in mechanism.joints:
            if len(joint.free_axes) == 1:
                coordinates[joint.name] = float(joint.coordinate(poses[joint.parent], poses[joint.child]))
        return poses, coordinates
    poses = {mechanism.base: np.eye(4)}
    for joint in mechanism.tree:
        poses[joint.child] = poses[joint.parent] @ joint.T_parent_joint @ spatial.inverse(joint.T_child_joint)
    return poses, {}


def from_mechanism(
    mechanism: Mechanism,
    label: str,
    *,
    path: Path | None = None,
    only: Collection[str] = (),
    guessed_tool: bool = False,
    notes: Sequence[str] = (),
    efforts: Mapping[str, float] | None = None,
    unlimited: Collection[str] = (),
) -> RobotSide:
    """Return the side of a mechanism.

    Args:
        mechanism: the mechanism.
        label: how the user named the side.
        path: its file, if it is one file.
        only: names of the joints to compare; all others are held at the drawn state. (): all joints.
        guessed_tool: whether the tool frame is only a guess of the reader.
        notes: texts on data that the reader left out.
        efforts: maximum efforts that are not in the drives of the joints.
        unlimited: joints of which the file states that they have no limits.
    """
    poses, coordinates = drawn_poses(mechanism)
    moving = _moving(mechanism, only, label)
    group_of = _groups(mechanism, moving)
    axes: list[Axis] = []
    reached = {0}
    for joint in (*mechanism.tree, *mechanism.loops):
        group = group_of[joint.child]
        if joint.name in moving and group_of[joint.parent] != group:
            # a joint of the tree closes a loop if its child is welded to a link that other joints already reach
            closing = group in reached
            reached.add(group)
            axis = replace(_axis(joint, poses, coordinates, group_of, closing), opened=_opened(joint, poses))
            if axis.limits is None and axis.name in unlimited:
                axis = replace(axis, limits=UNLIMITED)
            axes.append(axis)
    axes.sort(key=lambda axis: axis.closing)
    if only:
        _refuse_locked(mechanism, moving - {axis.name for axis in axes}, group_of, label)
    frames: dict[str, tuple[int, Array]] = {}
    for body in mechanism.bodies:
        frames[body.name] = (group_of[body.name], poses[body.name])
    for frame in mechanism.frames:
        frames[frame.name] = (group_of[frame.body], poses[frame.body] @ frame.T_body_frame)
    stated_efforts = dict(efforts or {})
    for joint in mechanism.joints:
        if joint.drive is not None and joint.drive.max_effort is not None:
            stated_efforts[joint.name] = joint.drive.max_effort
    return RobotSide(
        label=label,
        name=mechanism.name,
        axes=tuple(axes),
        groups=_bodies(mechanism, group_of, poses),
        frames=frames,
        tool=mechanism.tool,
        guessed_tool=guessed_tool,
        couplings=_couplings(mechanism, moving, coordinates),
        order=tuple(joint.name for joint in mechanism.active if joint.name in moving),
        path=path,
        notes=tuple(notes),
        efforts=stated_efforts,
        mechanism=mechanism,
    )


def _moving(mechanism: Mechanism, only: Collection[str], label: str) -> set[str]:
    """Return the names of the joints that move in the comparison."""
    # a floating robot is compared with one on a stand: where its base is says nothing about its kinematics
    names = {joint.name for joint in mechanism.joints if joint.type not in ("fixed", "free")}
    if not only:
        return names
    chosen = set()
    for name in only:
        alike = [known for known in names if plain(known) == plain(name)]
        if name in names:
            alike = [name]
        if len(alike) != 1:
            raise TwinError(f"{label}: {unknown('moving joint', name, names)}")
        chosen.add(alike[0])
    return chosen


def _refuse_locked(mechanism: Mechanism, locked: Collection[str], group_of: Mapping[str, int], label: str) -> None:
    """Raise an error for a joint to compare that held joints lock: to move it would open their loop.

    Raises:
        TwinError: it names the joint, and the joints that must be compared with it.
    """
    for name in sorted(locked):
        group = group_of[mechanism.joint(name).child]
        held = []
        for joint in mechanism.joints:
            ends = {group_of[joint.parent], group_of[joint.child]}
            if joint.name not in locked and joint.type not in ("fixed", "free") and ends == {group}:
                held.append(joint.name)
        raise TwinError(
            f"{label}: joint '{name}' cannot move while the other joints of its loop are held: it would open the loop. "
            f"Add joints of the loop to --only ({', '.join(held)}), or leave '{name}' out."
        )


def _groups(mechanism: Mechanism, moving: Collection[str]) -> dict[str, int]:
    """Return {body: index of its group}; the group of the base is 0.

    A fixed joint that closes a loop (a weld), and one that is held, makes one group of two: the loop stays closed. The
    group of a lower index remains: its joints come first in the tree.
    """
    group_of = {mechanism.base: 0}
    count = 1
    for joint in mechanism.tree:
        if joint.name in moving:
            group_of[joint.child] = count
            count += 1
        else:
            group_of[joint.child] = group_of[joint.parent]
    for joint in mechanism.loops:
        if joint.name in moving or joint.type == "free":
            continue
        kept, welded = sorted((group_of[joint.parent], group_of[joint.child]))
        for body, group in group_of.items():
            if group == welded:
                group_of[body] = kept
    number = {group: k for k, group in enumerate(sorted(set(group_of.values())))}
    return {body: number[group] for body, group in group_of.items()}


def _opening(joint: Joint, poses: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return (shift (3,) in m, pose (4, 4)) of a joint's frame on the child in that on the parent.

    The shift is that in the directions in which the joint does not let move.
    """
    T_base_joint = poses[joint.parent] @ joint.T_parent_joint
    M = spatial.inverse(T_base_joint) @ poses[joint.child] @ joint.T_child_joint
    shift = M[:3, 3].copy()
    for k in joint.free_axes:
        if k < 3:
            shift[k] = 0.0
    return shift, M


def _opened(joint: Joint, poses: Mapping[str, Array]) -> tuple[float, float]:
    """Return by how much the two frames of a joint are apart in what it does not let move, in m and rad."""
    shift, M = _opening(joint, poses)
    angle = 0.0
    if 3 not in joint.free_axes:
        angle = float(np.arctan2(np.linalg.norm(M[:2, 2]), M[2, 2]))  # of the two axes z
        if 5 not in joint.free_axes:
            angle = float(spatial.rotation_angle(M[:3, :3]))
    return float(np.linalg.norm(shift)), angle


def openings(mechanism: Mechanism) -> Array:
    """Return (6 loops,) by how much each loop is open where it is drawn: a shift in m, and the tilt of its axes."""
    poses, _ = drawn_poses(mechanism)
    rows = [np.zeros(0)]
    for joint in mechanism.loops:
        shift, M = _opening(joint, poses)
        tilt = np.zeros(3)
        if 3 not in joint.free_axes:
            tilt = M[:3, 2] - np.array([0.0, 0.0, 1.0])
        rows += [shift, tilt]
    return np.concatenate(rows)


def _axis(
    joint: Joint,
    poses: Mapping[str, Array],
    coordinates: Mapping[str, float],
    group_of: Mapping[str, int],
    closing: bool,
) -> Axis:
    T_base_joint = poses[joint.parent] @ joint.T_parent_joint
    return Axis(
        name=joint.name,
        kind=joint.type,
        parent=group_of[joint.parent],
        child=group_of[joint.child],
        point=T_base_joint[:3, 3],
        direction=T_base_joint[:3, 2],
        drawn=coordinates.get(joint.name, 0.0),
        closing=closing,
        active=joint.active,
        limits=joint.limits,
        max_speed=joint.max_speed,
    )


def _carriers(mechanism: Mechanism) -> set[str]:
    """Return the bodies that only connect a joint to a weld: a format that closes loops in points writes a slide so.

    Such a body is given a mass of up to 1 g, because a simulator needs one.
    """
    ends = [body for joint in mechanism.joints for body in (joint.parent, joint.child)]
    carriers = set()
    for joint in mechanism.loops:
        for name in (joint.parent, joint.child):
            if joint.type != "fixed" or ends.count(name) != 2 or name == mechanism.base:
                continue
            inertia = mechanism.body(name).inertia
            if inertia is not None and inertia.mass <= _CARRIER:
                carriers.add(name)
    return carriers


def _bodies(mechanism: Mechanism, group_of: Mapping[str, int], poses: Mapping[str, Array]) -> tuple[JointGroup, ...]:
    count = max(group_of.values()) + 1
    carriers = _carriers(mechanism)
    names: list[list[str]] = [[] for _ in range(count)]
    inertias: list[Inertia | None] = [None] * count
    for body in mechanism.bodies:
        group = group_of[body.name]
        names[group].append(body.name)
        if body.inertia is None or body.name in carriers:
            continue
        seen = body.inertia.seen_from(poses[body.name])
        sum_before = inertias[group]
        inertias[group] = seen if sum_before is None else sum_before + seen
    groups = []
    for bodies, inertia in zip(names, inertias, strict=True):
        groups.append(JointGroup(tuple(bodies), inertia))
    return tuple(groups)


def _couplings(
    mechanism: Mechanism, moving: Collection[str], coordinates: Mapping[str, float]
) -> tuple[CouplingRow, ...]:
    """Return the couplings of the moving joints; `coordinates` are those of the drawn state, 0 without one."""
    rows = []
    for coupling in mechanism.couplings:
        total = coupling.total
        ratios: dict[str, float] = {}
        partner_held = False
        for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
            if ratio == 0.0:
                continue
            if name in moving:
                ratios[name] = ratio
                continue
            # a joint that is held at the drawn state adds a constant to the sum
            total -= ratio * coordinates.get(name, 0.0)
            partner_held = True
        # a joint that is compared while all its partners are held is compared as if it moved freely
        if not ratios or (partner_held and len(ratios) < 2):
            continue
        follower = _follower(mechanism, list(ratios))
        scale = ratios[follower]
        scaled = {name: ratio / scale for name, ratio in ratios.items()}
        rows.append(CouplingRow(follower, scaled, total / scale))
    return tuple(rows)


def _follower(mechanism: Mechanism, joints: Sequence[str]) -> str:
    """Return the joint of a coupling that the others move: the first without a motor, or else the first."""
    for name in joints:
        if not mechanism.joint(name).active:
            return name
    return joints[0]
