"""Joints that one side writes as several, joined as the other side writes them.

Formats without ball joints write three hinges through one point; formats whose loops close only in points write a
hinge that closes a loop as two balls on its line, and number the names of these points. Such joints allow the same
motions as the joint that they stand for, so they are no difference of the robot.

    three hinges through one point, each at right angles to the next,
    with links that carry nothing else                                         a ball
    a hinge and a slide on one line, with a link that carries nothing else     a cylindrical joint
    two balls that close a loop between the same two links                     a hinge on the line through them
    the name of a closing joint with a number behind it ("s2_0")               the name without it

Joints are joined only where the other side has more joints of the new type: a wrist of three hinges that both sides
write as hinges stays as it is.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.comparison.fit_problem import ANGLE_PER_LENGTH
from twin.comparison.side import Axis, JointGroup, RobotSide, common_prefix, plain_name
from twin.core.errors import TwinError
from twin.core.spatial import Array

_SMALLEST_SEPARATION = 1e-3
"""Smallest distance in m of two points that determine the direction of a line."""

_NUMBER_SUFFIX = re.compile(r"_[0-9]+$")
"""End of the name of a closing joint that numbers its points."""


@dataclass(frozen=True)
class _JointParts:
    """Joints that stand for one: their indices, and the joint."""

    indices: tuple[int, ...]
    merged: Axis


def with_merged_joints(side: RobotSide, other_side: RobotSide, tolerance: float) -> RobotSide:
    """Return the side with its joints as the other side writes them.

    Args:
        side: the side whose joints are joined.
        other_side: the side that it is compared with.
        tolerance: distance in m up to which lines meet in a point.
    """
    joined_side = side
    # balls first: a hinge of a ball is no part of a cylinder
    for kind, parts_of in (
        ("spherical", _ball_candidates),
        ("cylindrical", _cylinder_candidates),
        ("revolute", _closing_hinge_candidates),
    ):
        joined_side = _with_merged(joined_side, other_side, kind, list(parts_of(joined_side, tolerance)), tolerance)
    reread_parts = side.reread
    if joined_side is side or reread_parts is None:
        return _without_name_numbers(joined_side, other_side)

    def reread(data: bytes) -> RobotSide:
        side_read_again = with_merged_joints(reread_parts(data), other_side, tolerance)
        if len(side_read_again.axes) != len(joined_side.axes):
            raise TwinError(f"{side.label}: with this number, joints are no longer parts of one")
        return side_read_again

    return _without_name_numbers(replace(joined_side, reread=reread), other_side)


def _with_merged(
    side: RobotSide, other_side: RobotSide, kind: str, candidates: Sequence[_JointParts], tolerance: float
) -> RobotSide:
    """Return the side with some of the candidates joined: as many as the other side has more joints of this type."""
    names = set()
    for axis in _axes_at(other_side, _of_kind(other_side, kind)):
        names.add(plain_name(axis.name))
    # those whose name the other side knows first
    ordered = sorted(candidates, key=lambda parts: plain_name(parts.merged.name) not in names)
    missing = _missing_count(side, other_side, kind)
    chosen: list[_JointParts] = []
    used_joints: set[int] = set()
    for parts in ordered:
        if len(chosen) < missing and used_joints.isdisjoint(parts.indices):
            chosen.append(parts)
            used_joints |= set(parts.indices)
    # by name: each replacement changes the indices
    replacements: list[tuple[list[str], Axis]] = []
    for parts in chosen:
        part_names = [side.axes[i].name for i in parts.indices]
        replacements.append((part_names, parts.merged))
    for part_names, merged_joint in replacements:
        if kind == "revolute":
            merged_joint = _parallel_to_neighbour(merged_joint, side, other_side, tolerance)
        side = _with_one_joint(side, part_names, merged_joint)
    return side


def _missing_count(side: RobotSide, other_side: RobotSide, kind: str) -> int:
    """Return how many joints of a type the other side has more."""
    missing = len(_of_kind(other_side, kind)) - len(_of_kind(side, kind))
    if kind != "revolute":
        return missing
    # the other side may close the same loops at other joints, or have more hinges in its tree for other reasons
    return max(missing, len(_closing_of_kind(other_side, kind)) - len(_closing_of_kind(side, kind)))


def _of_kind(side: RobotSide, kind: str) -> list[int]:
    """Return the indices of the joints of a type."""
    indices = []
    for i, axis in enumerate(side.axes):
        if axis.kind == kind:
            indices.append(i)
    return indices


def _closing_of_kind(side: RobotSide, kind: str) -> list[int]:
    """Return the indices of the joints of a type that close loops."""
    indices = []
    for i, axis in enumerate(side.axes):
        if axis.kind == kind and axis.closes_loop:
            indices.append(i)
    return indices


def _with_one_joint(side: RobotSide, parts: Sequence[str], merged_joint: Axis) -> RobotSide:
    """Return the side with one joint instead of several; the links between them are parts of the last link."""
    indices = [side.index(name) for name in parts]
    first = side.axes[indices[0]]
    last = side.axes[indices[-1]]
    # points that close a loop may name their two links in either order
    child = last.child
    inner_groups = []
    for i in indices[:-1]:
        inner_groups.append(side.axes[i].child)
    if merged_joint.closes_loop:
        child = first.child
        inner_groups = []  # points that close a loop have no links between them
    merged_joint = replace(merged_joint, parent=first.parent, child=child)
    axes = []
    for i, axis in enumerate(side.axes):
        if i == indices[0]:
            axes.append(merged_joint)
        elif i not in indices:
            axes.append(axis)
    driven_joints = [name for name in side.driven_joints if name not in parts]
    joined_side = replace(side, axes=tuple(axes), driven_joints=tuple(driven_joints))
    return _without_groups(joined_side, inner_groups, last.child)


def _without_groups(side: RobotSide, inner_groups: Sequence[int], last: int) -> RobotSide:
    """Return the side whose groups `inner_groups` are parts of the group `last`; frames on them are dropped."""
    number = {}
    groups = []
    for group, bodies in enumerate(side.groups):
        if group in inner_groups:
            continue
        number[group] = len(number)
        if group == last:
            for inner in inner_groups:
                bodies = _with_mass_of(bodies, side.groups[inner])
        groups.append(bodies)
    axes = []
    for axis in side.axes:
        axes.append(replace(axis, parent=number[axis.parent], child=number[axis.child]))
    frames = {}
    for name, (group, T) in side.frames.items():
        if group in number:
            frames[name] = (number[group], T)
    return replace(side, axes=tuple(axes), groups=tuple(groups), frames=frames)


def _with_mass_of(outer: JointGroup, inner: JointGroup) -> JointGroup:
    """Return a group with the mass of another; the names are those of the outer one."""
    inertia = outer.inertia
    if inertia is None:
        inertia = inner.inertia
    elif inner.inertia is not None:
        inertia = inertia + inner.inertia
    return JointGroup(outer.bodies, inertia)


# -- what can be joined -------------------------------------------------------------------------------


def _axes_at(side: RobotSide, indices: Sequence[int]) -> list[Axis]:
    return [side.axes[i] for i in indices]


def _link_chains(side: RobotSide, length: int) -> Iterator[tuple[int, ...]]:
    """Yield the indices of joints one behind another whose links between them carry nothing else."""
    coupled: set[str] = set()
    for coupling in side.couplings:
        coupled.update(coupling.ratios)
    touching: Counter[int] = Counter()  # {group: number of joints on it}
    for axis in side.axes:
        touching[axis.parent] += 1
        touching[axis.child] += 1
    # groups that carry something else than the two joints between which they are
    carrying = set()
    for group, count in touching.items():
        if count != 2:
            carrying.add(group)
    if side.tool in side.frames:
        tool_group, _ = side.frames[side.tool]
        carrying.add(tool_group)
    behind: dict[int, int] = {}
    for i, axis in enumerate(side.axes):
        if not axis.closes_loop:
            behind[axis.parent] = i
    for start, axis in enumerate(side.axes):
        if axis.closes_loop:
            continue
        chain = [start]
        while len(chain) < length:
            inner = side.axes[chain[-1]].child
            if inner in carrying or inner not in behind:
                break
            chain.append(behind[inner])
        # a coupled hinge follows others: a ball in its place would be free
        is_coupled = any(side.axes[i].name in coupled for i in chain)
        if len(chain) == length and not is_coupled:
            yield tuple(chain)


def _ball_candidates(side: RobotSide, tolerance: float) -> Iterator[_JointParts]:
    """Yield three hinges through one point, each at right angles to the next: they turn a link about all axes."""
    for chain in _link_chains(side, 3):
        axes = _axes_at(side, chain)
        if {axis.kind for axis in axes} != {"revolute"}:
            continue
        # Only with right angles on both middle links, which no posture changes, do three hinges reach every rotation.
        # The first and the third hinge may be parallel: that is a singular posture of a ball.
        first, second, third = axes
        cosine = abs(float(first.direction @ second.direction))
        cosine_behind = abs(float(second.direction @ third.direction))
        if max(cosine, cosine_behind) > ANGLE_PER_LENGTH * tolerance:
            continue
        centre = _nearest_point(axes)
        farthest = max(_distance_from_line(centre, axis) for axis in axes)
        if farthest > tolerance:
            continue
        yield _JointParts(chain, _merged_joint(axes, "spherical", centre, axes[0].direction))


def _cylinder_candidates(side: RobotSide, tolerance: float) -> Iterator[_JointParts]:
    """Yield a hinge and a slide on one line."""
    for chain in _link_chains(side, 2):
        axes = _axes_at(side, chain)
        hinge, slide = axes
        if hinge.kind == "prismatic":  # files write the two in either order
            hinge, slide = slide, hinge
        if (hinge.kind, slide.kind) != ("revolute", "prismatic"):
            continue
        # a slide moves along its direction from any point: only the directions must be parallel
        if np.linalg.norm(np.cross(hinge.direction, slide.direction)) > ANGLE_PER_LENGTH * tolerance:
            continue
        yield _JointParts(chain, _merged_joint(axes, "cylindrical", hinge.point, hinge.direction))


def _closing_hinge_candidates(side: RobotSide, tolerance: float) -> Iterator[_JointParts]:
    """Yield two balls that close a loop between the same two links."""
    pairs: dict[frozenset[int], list[int]] = {}
    for i in _closing_of_kind(side, "spherical"):
        axis = side.axes[i]
        pairs.setdefault(frozenset((axis.parent, axis.child)), []).append(i)
    for indices in pairs.values():
        if len(indices) != 2:  # with a third point that is not on the line, the links are fixed to each other
            continue
        axes = _axes_at(side, indices)
        # which way along this line is positive, no format says: `directed` is False
        between = axes[1].point - axes[0].point
        distance = float(np.linalg.norm(between))
        if distance < _SMALLEST_SEPARATION:
            continue
        middle = (axes[0].point + axes[1].point) / 2
        hinge = replace(_merged_joint(axes, "revolute", middle, between / distance), is_directed=False)
        yield _JointParts(tuple(indices), hinge)


def _parallel_to_neighbour(hinge: Axis, side: RobotSide, other_side: RobotSide, tolerance: float) -> Axis:
    """Return a hinge through two points, parallel to the hinge to which it is parallel in the other side.

    Rounded points that are near to each other say little about the direction of their line. Where the other side has
    two parallel hinges on a link, and both points are within the tolerance of such a line here, this line is meant.
    """
    distance = float(np.linalg.norm(hinge.merged_axes[1].point - hinge.merged_axes[0].point))
    own_hinges: dict[str, Axis] = {}
    for axis in _axes_at(side, _of_kind(side, "revolute")):
        own_hinges[plain_name(axis.name)] = axis
    other_hinges = _axes_at(other_side, _of_kind(other_side, "revolute"))
    partners = []
    for axis in other_hinges:
        if plain_name(axis.name) == plain_name(hinge.name):
            partners.append(axis)
    if len(partners) != 1:
        return hinge
    partner = partners[0]
    for axis in other_hinges:
        neighbour = own_hinges.get(plain_name(axis.name))
        if axis is partner or neighbour is None:
            continue
        if {axis.parent, axis.child}.isdisjoint((partner.parent, partner.child)):
            continue
        if {neighbour.parent, neighbour.child}.isdisjoint((hinge.parent, hinge.child)):
            continue
        parallel = float(np.linalg.norm(np.cross(axis.direction, partner.direction)))
        beside = float(np.linalg.norm(np.cross(neighbour.direction, hinge.direction))) * distance / 2
        if parallel <= ANGLE_PER_LENGTH * tolerance and beside <= tolerance:
            return replace(hinge, direction=neighbour.direction)
    return hinge


def _merged_joint(axes: Sequence[Axis], kind: str, point: Array, direction: Array) -> Axis:
    """Return the joint that several stand for, with the common beginning of their names."""
    first = axes[0]
    stem = common_prefix([axis.name for axis in axes])
    name = stem.rstrip("_") or first.name
    child = first.child if first.closes_loop else axes[-1].child
    active = any(axis.active for axis in axes)
    distance, angle = np.max([axis.opening for axis in axes], axis=0).tolist()
    open_weld = ""
    for axis in axes:
        open_weld = open_weld or axis.open_weld
    return Axis(
        name,
        kind,
        first.parent,
        child,
        point,
        direction,
        0.0,
        first.closes_loop,
        active,
        merged_axes=tuple(axes),
        opening=(distance, angle),
        open_weld=open_weld,
    )


def _nearest_point(axes: Sequence[Axis]) -> Array:
    """Return the point (3,) with the least squared distances to some lines that are not parallel."""
    total = np.zeros((3, 3))
    weighted = np.zeros(3)
    for axis in axes:
        across = np.eye(3) - np.outer(axis.direction, axis.direction)
        total += across
        weighted += across @ axis.point
    return np.asarray(np.linalg.solve(total, weighted), float)


def _distance_from_line(point: Array, axis: Axis) -> float:
    """Return the distance in m of a point (3,) from the line of a joint."""
    return float(np.linalg.norm(np.cross(point - axis.point, axis.direction)))


# -- names --------------------------------------------------------------------------------------------


def _without_name_numbers(side: RobotSide, other_side: RobotSide) -> RobotSide:
    """Return the side with the names of the other side for closing joints that differ only by a number behind it."""
    own_names = set(map(plain_name, side.joint_names))
    names_of_other: dict[str, str] = {}
    for name in other_side.joint_names:
        names_of_other[plain_name(name)] = name
    axes = []
    for axis in side.axes:
        stem = _NUMBER_SUFFIX.sub("", axis.name)
        partner = names_of_other.get(plain_name(stem))
        is_numbered = axis.closes_loop and stem != axis.name
        is_free = plain_name(axis.name) not in names_of_other and plain_name(stem) not in own_names
        if is_numbered and is_free and partner:
            axis = replace(axis, name=partner)
            own_names.add(plain_name(stem))
        axes.append(axis)
    return replace(side, axes=tuple(axes))
