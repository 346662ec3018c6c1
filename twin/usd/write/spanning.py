"""Choose which joints form the tree of an exported robot, and which joints close its loops."""

from __future__ import annotations

from dataclasses import dataclass

from twin.model.joint import Joint, reversed_joint
from twin.model.mechanism import Mechanism

_TREE_PRIORITY = {"fixed": 0, "prismatic": 1, "cylindrical": 1, "free": 1, "revolute": 2, "spherical": 3}
"""Priority of joint types for the tree; joints with a lower number are chosen first.

Ball joints have the highest number. As a loop closure, a ball joint is three position constraints, which are exact in
all engines; in the tree, it has no single coordinate for a table of joint values.
"""


@dataclass(frozen=True)
class Spanning:
    """A spanning tree for export.

    The joints of `tree` are in order, parents first, and reversed where necessary so that the child is the outer body;
    the joints of `cut` close loops and are unchanged.
    """

    tree: tuple[Joint, ...]
    cut: tuple[Joint, ...]


def spanning(mechanism: Mechanism) -> Spanning:
    """Return the spanning tree; driven and coupled joints are chosen first, then joints by type, then by file order.

    The tree may differ from `mechanism.tree`, which uses only the file order: in a loop with a slide and a ball joint,
    the tree contains the slide, and the ball joint closes the loop.
    """
    group = {body.name: body.name for body in mechanism.bodies}

    def find(name: str) -> str:
        while group[name] != name:
            name = group[name]
        return name

    tree_names: set[str] = set()
    for joint in _by_priority(mechanism):  # Kruskal: add the next joint that connects two separate groups of bodies
        parent_group = find(joint.parent)
        child_group = find(joint.child)
        if parent_group != child_group:
            group[parent_group] = child_group
            tree_names.add(joint.name)
    pending: list[Joint] = []
    cut: list[Joint] = []
    for joint in mechanism.joints:
        if joint.name in tree_names:
            pending.append(joint)
        else:
            cut.append(joint)
    return Spanning(_outwards(mechanism.base, pending), tuple(cut))


def _by_priority(mechanism: Mechanism) -> list[Joint]:
    """Return the joints in the order in which they are chosen for the tree."""
    needed = {joint.name for joint in mechanism.active}
    for coupling in mechanism.couplings:
        needed.update(coupling.joints)

    def priority(joint: Joint) -> int:
        # Engines with reduced coordinates have those of the tree alone, and drives and couplings act on coordinates.
        if joint.name in needed:
            return -1
        return _TREE_PRIORITY[joint.type]

    # `sorted` is stable: joints of one priority stay in the order of the file.
    return sorted(mechanism.joints, key=priority)


def _outwards(base: str, pending: list[Joint]) -> tuple[Joint, ...]:
    """Return the joints of a tree, parents first, each with the outer body as its child; `pending` is emptied."""
    tree: list[Joint] = []
    reached = {base}
    while pending:
        joint = _next(pending, reached)
        pending.remove(joint)
        if joint.parent in reached:
            tree.append(joint)
        else:
            tree.append(reversed_joint(joint))
        reached |= {joint.parent, joint.child}
    return tuple(tree)


def _next(pending: list[Joint], reached: set[str]) -> Joint:
    """Return the first joint that connects to the bodies reached; a spanning tree always has one."""
    for joint in pending:
        if joint.parent in reached or joint.child in reached:
            return joint
    raise AssertionError("the bodies of a mechanism are connected")
