"""Robots with loops in one posture: the first side moved to where the second is drawn.

A group is a link: bodies that are fixed to each other. Groups are counted as in the first side; group 0 is the base.
Joints are counted as in the second side: `FitProblem.axes` are their partners in the first side, in this order.
"""

from __future__ import annotations

from dataclasses import replace

from twin.comparison.fit_problem import FitProblem
from twin.comparison.link_motions import LinkMotions
from twin.comparison.side import ONE_COORDINATE_KINDS, Axis, JointGroup, RobotSide
from twin.core import spatial
from twin.core.spatial import Array


def in_common_posture(problem: FitProblem) -> tuple[RobotSide, RobotSide] | None:
    """Return both sides, the first in the posture in which the second is drawn; None if its links differ.

    The bodies of the first side stay where its base is. The spin of a bar between two balls is not known: neither side
    then has the inertia of the bar.
    """
    links = LinkMotions(problem)
    T = links.fitted_to_all()  # (groups, 4, 4): how each link of the first side moves onto that of the second
    if not links.places_agree(T, links.places):
        return None
    moves = spatial.inverse(T[0]) @ T  # relative to the base, which stays where it is
    axes: list[Axis] = []
    for axis in problem.first.axes:
        displacement = _displacement(axis, moves)
        if displacement is None:
            return None
        motion = moves[axis.parent]
        axes.append(replace(axis.moved_by(motion), drawn=axis.drawn + displacement))
    frames: dict[str, tuple[int, Array]] = {}
    for name, (group, frame) in problem.first.frames.items():
        frames[name] = (group, moves[group] @ frame)
    groups: list[JointGroup] = []
    for group, motion in zip(problem.first.groups, moves, strict=True):
        inertia = group.inertia
        if inertia is not None:
            inertia = inertia.seen_from(motion)
        groups.append(replace(group, inertia=inertia))
    partners = list(problem.second.groups)
    for i, axis in enumerate(problem.axes):
        if _spins(problem, axis.child):
            groups[axis.child] = replace(groups[axis.child], inertia=None)
            partner = problem.second.axes[i].child
            partners[partner] = replace(partners[partner], inertia=None)
    first = replace(problem.first, axes=tuple(axes), frames=frames, groups=tuple(groups))
    return first, replace(problem.second, groups=tuple(partners))


def _displacement(axis: Axis, moves: Array) -> float | None:
    """Return by how much a joint moves, in m or rad, if its links move by `moves` (groups, 4, 4).

    None if its child is turned around across its line, which no motion of the joint does.
    """
    T = spatial.inverse(moves[axis.parent]) @ moves[axis.child]
    R = T[:3, :3]
    turned_around = axis.direction @ R @ axis.direction < 0.0
    if turned_around and axis.kind not in ("spherical", "free"):
        return None
    if axis.kind not in ONE_COORDINATE_KINDS:
        return 0.0
    if axis.kind == "prismatic":
        moved_point = R @ axis.point + T[:3, 3]
        return float(axis.direction @ (moved_point - axis.point))
    return float(axis.direction @ spatial.log_so3(R))


def _spins(problem: FitProblem, group: int) -> bool:
    """Return whether a group is a bar between at most two balls, which can spin about its line."""
    kinds = []
    for axis in problem.axes:
        if group in (axis.parent, axis.child):
            kinds.append(axis.kind)
    return group != 0 and len(kinds) <= 2 and set(kinds) == {"spherical"}
