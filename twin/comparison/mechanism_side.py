"""The side of a mechanism: its joint lines, bodies, frames and couplings at the drawn state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from twin.comparison.openings import joint_opening, with_weld_openings
from twin.comparison.side import UNLIMITED, Axis, CouplingRow, JointGroup, RobotSide, plain_name
from twin.core import spatial
from twin.core.errors import TwinError, unknown
from twin.core.spatial import Array
from twin.model.inertia import Inertia
from twin.model.mechanism import Mechanism

_MAX_CARRIER_MASS = 1.001e-3
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
    moving = _moving_joint_names(mechanism, only, label)
    group_of = _group_of_body(mechanism, moving)
    axes: list[Axis] = []
    for axis in _moving_axes(mechanism, moving, poses, coordinates, group_of):
        if axis.limits is None and axis.name in unlimited:
            axis = replace(axis, limits=UNLIMITED)
        axes.append(axis)
    if only:
        moving_joints = {axis.name for axis in axes}
        _refuse_locked(mechanism, moving - moving_joints, group_of, label)
    frames: dict[str, tuple[int, Array]] = {}
    for body in mechanism.bodies:
        frames[body.name] = (group_of[body.name], poses[body.name])
    for frame in mechanism.frames:
        frames[frame.name] = (group_of[frame.body], poses[frame.body] @ frame.T_body_frame)
    stated_efforts = dict(efforts or {})
    for joint in mechanism.joints:
        if joint.drive is not None and joint.drive.max_effort is not None:
            stated_efforts[joint.name] = joint.drive.max_effort
    driven_names = []
    for joint in mechanism.active:
        if joint.name in moving:
            driven_names.append(joint.name)
    return RobotSide(
        label=label,
        name=mechanism.name,
        axes=tuple(axes),
        groups=_joint_groups(mechanism, group_of, poses),
        frames=frames,
        tool=mechanism.tool,
        is_tool_guessed=guessed_tool,
        couplings=_coupling_rows(mechanism, moving, coordinates),
        driven_joints=tuple(driven_names),
        path=path,
        notes=tuple(notes),
        efforts=stated_efforts,
        mechanism=mechanism,
    )


def _moving_joint_names(mechanism: Mechanism, only: Collection[str], label: str) -> set[str]:
    """Return the names of the joints that move in the comparison."""
    # a floating robot is compared with one on a stand: where its base is says nothing about its kinematics
    names = set()
    for joint in mechanism.joints:
        if joint.type not in ("fixed", "free"):
            names.add(joint.name)
    if not only:
        return names
    chosen = set()
    for name in only:
        alike = []
        for name_of_joint in names:
            if plain_name(name_of_joint) == plain_name(name):
                alike.append(name_of_joint)
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
        holding_joints = []
        for joint in mechanism.joints:
            ends = {group_of[joint.parent], group_of[joint.child]}
            if joint.name not in locked and joint.type not in ("fixed", "free") and ends == {group}:
                holding_joints.append(joint.name)
        raise TwinError(
            f"{label}: joint '{name}' cannot move while the other joints of its loop are held: it would open the loop. "
            f"Add joints of the loop to --only ({', '.join(holding_joints)}), or leave '{name}' out."
        )


def _group_of_body(mechanism: Mechanism, moving: Collection[str]) -> dict[str, int]:
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
        # the lower number remains, so that the group of the base stays 0
        kept_group, welded = sorted((group_of[joint.parent], group_of[joint.child]))
        for body, group in group_of.items():
            if group == welded:
                group_of[body] = kept_group
    # without the numbers of the welded groups
    kept_groups = sorted(set(group_of.values()))
    number = dict(zip(kept_groups, range(len(kept_groups)), strict=True))
    for body, group in group_of.items():
        group_of[body] = number[group]
    return group_of


def _moving_axes(
    mechanism: Mechanism,
    moving: Collection[str],
    poses: Mapping[str, Array],
    coordinates: Mapping[str, float],
    group_of: Mapping[str, int],
) -> list[Axis]:
    """Return the joints that move and connect two groups of bodies: those of the tree, then those that close loops."""
    axes: list[Axis] = []
    reached = {0}
    for joint in (*mechanism.tree, *mechanism.loops):
        parent = group_of[joint.parent]
        child = group_of[joint.child]
        if joint.name not in moving or parent == child:
            continue
        T_base_joint = poses[joint.parent] @ joint.T_parent_joint
        axis = Axis(
            name=joint.name,
            kind=joint.type,
            parent=parent,
            child=child,
            point=T_base_joint[:3, 3],
            direction=T_base_joint[:3, 2],
            drawn=coordinates.get(joint.name, 0.0),
            # a joint of the tree closes a loop if its child is welded to a link that other joints already reach
            closes_loop=child in reached,
            active=joint.active,
            limits=joint.limits,
            max_speed=joint.max_speed,
            opening=joint_opening(joint, poses),
        )
        reached.add(child)
        axes.append(axis)
    axes.sort(key=lambda axis: axis.closes_loop)  # stable: the joints of the tree stay parents first
    return with_weld_openings(mechanism, axes, group_of, poses)


def _carriers(mechanism: Mechanism) -> set[str]:
    """Return the bodies that only connect a joint to a weld: a format that closes loops in points writes a slide so.

    Such a body is given a mass of up to 1 g, because a simulator needs one.
    """
    joints_on: Counter[str] = Counter()
    for joint in mechanism.joints:
        joints_on[joint.parent] += 1
        joints_on[joint.child] += 1
    carriers = set()
    for joint in mechanism.loops:
        for name in (joint.parent, joint.child):
            # with a third joint on it, the body is a link of the robot
            if joint.type != "fixed" or joints_on[name] != 2 or name == mechanism.base:
                continue
            inertia = mechanism.body(name).inertia
            if inertia is not None and inertia.mass <= _MAX_CARRIER_MASS:
                carriers.add(name)
    return carriers


def _joint_groups(
    mechanism: Mechanism, group_of: Mapping[str, int], poses: Mapping[str, Array]
) -> tuple[JointGroup, ...]:
    """Return the groups of bodies: their names, and their common inertia in base at the drawn state."""
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


def _coupling_rows(
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
        # a file may state the sum of a coupling in any multiple
        scale = ratios[follower]
        scaled = {}
        for name, ratio in ratios.items():
            scaled[name] = ratio / scale
        rows.append(CouplingRow(follower, scaled, total / scale))
    return tuple(rows)


def _follower(mechanism: Mechanism, joints: Sequence[str]) -> str:
    """Return the joint of a coupling that the others move: the first without a motor, or else the first."""
    for name in joints:
        if not mechanism.joint(name).active:
            return name
    return joints[0]
