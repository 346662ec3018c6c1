"""By how much the loops of a mechanism are open where it is drawn, and the moving joints to which this is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.comparison.side import Axis
from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

_ROTATION_X = 3
"""Number of the rotation about x among the six `free_axes` of a joint, which are shifts first."""

_ROTATION_Z = 5
"""Number of the rotation about z among the six `free_axes` of a joint."""


def joint_opening(joint: Joint, poses: Mapping[str, Array]) -> tuple[float, float]:
    """Return by how much the two frames of a joint are apart in what it does not let move, in m and rad."""
    shift, T_gap = _locked_gap(joint, poses)
    angle = 0.0  # a ball lets turn about all axes
    if _ROTATION_X not in joint.free_axes:
        angle = float(np.arctan2(np.linalg.norm(T_gap[:2, 2]), T_gap[2, 2]))  # of the two axes z
        if _ROTATION_Z not in joint.free_axes:
            angle = float(spatial.rotation_angle(T_gap[:3, :3]))
    return float(np.linalg.norm(shift)), angle


def loop_openings(mechanism: Mechanism, poses: Mapping[str, Array]) -> Array:
    """Return (6 loops,) by how much each loop is open at the poses: a shift in m, and a turn or the tilt of its axes.

    `poses` are {body: T_base_body (4, 4)}.
    """
    rows = [np.zeros(0)]
    for joint in mechanism.loops:
        shift, T_gap = _locked_gap(joint, poses)
        tilt = np.zeros(3)
        if _ROTATION_X not in joint.free_axes:
            tilt = T_gap[:3, 2] - np.array([0.0, 0.0, 1.0])
            if _ROTATION_Z not in joint.free_axes:
                tilt = spatial.log_so3(T_gap[:3, :3])
        rows += [shift, tilt]
    return np.concatenate(rows)


def with_weld_openings(
    mechanism: Mechanism, axes: Sequence[Axis], group_of: Mapping[str, int], poses: Mapping[str, Array]
) -> list[Axis]:
    """Return the axes, each with the gap of the joints without an axis that close its loop, if that gap is larger.

    The bodies that a weld connects are one group, in which its gap is no longer seen: where a slide closes its loop by
    a weld, the slide itself is never open. The same holds for a joint that is held, and for one between two bodies of
    one group.

    Args:
        mechanism: the mechanism.
        axes: its moving joints that connect two groups.
        group_of: {body: index of its group}.
        poses: {body: T_base_body (4, 4)} at the drawn state.
    """
    axes = list(axes)
    moving_joints = {axis.name for axis in axes}
    for weld in mechanism.loops:
        # where the base of a floating robot is says nothing about its kinematics
        if weld.name in moving_joints or weld.type == "free":
            continue
        distance, angle = joint_opening(weld, poses)
        closed_by = _axis_closed_by(weld, mechanism, axes, group_of)
        if closed_by is None:
            continue
        axis = axes[closed_by]
        own_distance, own_angle = axis.opening
        if distance > own_distance or angle > own_angle:
            larger_opening = (max(distance, own_distance), max(angle, own_angle))
            axes[closed_by] = replace(axis, opening=larger_opening, open_weld=weld.name)
    return axes


def _axis_closed_by(weld: Joint, mechanism: Mechanism, axes: Sequence[Axis], group_of: Mapping[str, int]) -> int | None:
    """Return the index of the moving joint whose loop a weld closes; None if no joint moves there.

    This is a joint that carries one of the bodies of the weld, if possible one that counts as closing; a weld between
    two bodies that no joint carries is told at the first joint on their group.
    """
    names = [axis.name for axis in axes]
    index_of = dict(zip(names, range(len(names)), strict=True))
    carried_by: dict[str, int | None] = {mechanism.base: None}
    for joint in mechanism.tree:
        carried_by[joint.child] = index_of.get(joint.name, carried_by[joint.parent])
    carrying: list[int] = []
    for body in (weld.child, weld.parent):
        index = carried_by[body]
        if index is not None:
            carrying.append(index)
    for index in carrying:
        if axes[index].closes_loop:
            return index
    if carrying:
        return carrying[0]
    for index, axis in enumerate(axes):
        if group_of[weld.child] in (axis.parent, axis.child):
            return index
    return None


def _locked_gap(joint: Joint, poses: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return (shift (3,) in m, pose (4, 4)) of a joint's frame on the child in that on the parent.

    The shift is that in the directions in which the joint does not let move.
    """
    T_base_joint = poses[joint.parent] @ joint.T_parent_joint
    T_gap = spatial.inverse(T_base_joint) @ poses[joint.child] @ joint.T_child_joint
    shift = T_gap[:3, 3].copy()
    for k in joint.free_axes:
        if k < _ROTATION_X:
            shift[k] = 0.0
    return shift, T_gap
