"""Which joints lie between the base and the tool of a robot, and which carry nothing that moves the tool."""

from __future__ import annotations

from twin.comparison.side import Axis, RobotSide


def path_to_tool(side: RobotSide) -> list[Axis]:
    """Return the joints from the base to the tool."""
    above = {}
    for axis in side.tree:
        above[axis.child] = axis
    group, _ = side.frames[side.tool]
    path = []
    while group in above:
        path.append(above[group])
        group = above[group].parent
    return path[::-1]


def joints_beside_tool(side: RobotSide) -> list[Axis]:
    """Return the joints that no path from the base to the tool contains, in the order of `axes`.

    Poses of the tool say nothing about the places of these joints. A path visits no group of bodies twice: a loop that
    hangs on one group, as that of a gripper on the hand, is beside it.
    """
    tool_group, _ = side.frames[side.tool]
    hanging: set[int] = set()
    for group in range(len(side.groups)):
        # what one group cuts off from both the base and the tool hangs on this group
        reached = _connected_groups(side, {0, tool_group} - {group}, without=group)
        hanging |= set(range(len(side.groups))) - reached - {group}
    beside = []
    for axis in side.axes:
        if axis.parent in hanging or axis.child in hanging:
            beside.append(axis)
    return beside


def _connected_groups(side: RobotSide, starts: set[int], *, without: int) -> set[int]:
    """Return the groups that joints connect with some groups, if one group is taken out."""
    reached = set(starts)
    grows = True
    while grows:
        grows = False
        for axis in side.axes:
            ends = {axis.parent, axis.child}
            if without not in ends and len(ends & reached) == 1:
                reached |= ends
                grows = True
    return reached
