"""A robot with loops as a tree that is cut at the same joints as that of the other side.

Which joint of a loop closes it, and which of its two links is called the parent, is a choice of the format and of its
writer. A joint whose parent and child change places turns its axis around; its coordinate stays the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from twin.comparison.matching import pairs_by_links, pairs_by_name
from twin.comparison.side import Axis, RobotSide


def with_tree_of(side: RobotSide, other_side: RobotSide) -> RobotSide:
    """Return the side with the tree of the other side, if both have loops and the same joints between the same links.

    The joints are matched by their names, see `matching.pairs_by_name`, or by their links, see
    `matching.pairs_by_links`. Without such a match the side is returned as it is.
    """
    if not (side.has_loops and other_side.has_loops) or len(side.axes) != len(other_side.axes):
        return side
    possible_pairs = list(pairs_by_name(side, other_side))
    by_links = pairs_by_links(side, other_side)
    if by_links is not None:
        possible_pairs.append(by_links)
    for pairs in possible_pairs:
        partners = [side.axes[i] for i in pairs]
        axes = _with_tree(partners, other_side)
        if axes is not None:
            return replace(side, axes=tuple(axes))
    return side


def _with_tree(partners: Sequence[Axis], other_side: RobotSide) -> list[Axis] | None:
    """Return the joints of one side with the ends and cuts of the other; None if they connect other links."""
    partner_of = {0: 0}  # group of the other side: group of this side
    axes = []
    for axis, model in zip(partners, other_side.axes, strict=True):
        if model.parent not in partner_of:
            return None
        start = partner_of[model.parent]
        if start == axis.child and start != axis.parent:
            axis = replace(axis, parent=axis.child, child=axis.parent, direction=-axis.direction)
        if axis.parent != start or partner_of.setdefault(model.child, axis.child) != axis.child:
            return None
        axes.append(replace(axis, closes_loop=model.closes_loop))
    return axes
