"""Choose which joints form the tree of an exported robot, and which joints close its loops."""

from __future__ import annotations

from dataclasses import dataclass

from twin.model.joint import Joint, reversed_joint
from twin.model.mechanism import Mechanism

_KEPT = {"fixed": 0, "prismatic": 1, "cylindrical": 1, "free": 1, "revolute": 2, "spherical": 3}
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
    needed = {j.name for j in mechanism.active} | {name for c in mechanism.couplings for name in c.joints}
    order = sorted(mechanism.joints, key=lambda j: -1 if j.name in needed else _KEPT[j.type])
    group = {b.name: b.name for b in mechanism.bodies}

    def find(name: str) -> str:
        while group[name] != name:
            name = group[name]
        return name

    kept: list[Joint] = []
    for joint in order:  # Kruskal's algorithm: add the next joint that connects two separate groups of bodies
        a, b = find(joint.parent), find(joint.child)
        if a != b:
            group[a] = b
            kept.append(joint)
    names = {j.name for j in kept}
    reached, tree = {mechanism.base}, []
    pending = [j for j in mechanism.joints if j.name in names]
    while pending:
        joint = next(j for j in pending if j.parent in reached or j.child in reached)
        pending.remove(joint)
        tree.append(joint if joint.parent in reached else reversed_joint(joint))
        reached |= {joint.parent, joint.child}
    return Spanning(tuple(tree), tuple(j for j in mechanism.joints if j.name not in names))
