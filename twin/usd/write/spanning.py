"""Choose which joints form the tree of an export, and which close its loops."""

from __future__ import annotations

from dataclasses import dataclass

from twin.model.mechanism import Joint, Mechanism, reversed_joint

_KEPT = {"fixed": 0, "prismatic": 1, "cylindrical": 1, "free": 1, "revolute": 2, "spherical": 3}
"""Order of joint types in the choice of the tree.

Balls come last: a ball that closes a loop is three position constraints, exact in any engine, and a ball in the tree
has no single coordinate for a table of joint values.
"""


@dataclass(frozen=True)
class Spanning:
    """A spanning tree for export.

    Attributes:
        tree: joints, parents first; the child of a joint is the outer body, so that some joints are reversed.
        cut: joints that close loops, as in the mechanism.
    """

    tree: tuple[Joint, ...]
    cut: tuple[Joint, ...]


def spanning(mechanism: Mechanism) -> Spanning:
    """Return the spanning tree that prefers driven and coupled joints, then joints by type, then by file order.

    It may differ from `mechanism.tree`, which uses only the file order: of a loop with a slide and a ball, this tree
    contains the slide, and the ball closes the loop.
    """
    needed = {j.name for j in mechanism.active} | {name for c in mechanism.couplings for name in c.joints}
    order = sorted(mechanism.joints, key=lambda j: -1 if j.name in needed else _KEPT[j.type])
    group = {b.name: b.name for b in mechanism.bodies}

    def find(name: str) -> str:
        while group[name] != name:
            name = group[name]
        return name

    kept: list[Joint] = []
    for joint in order:  # Kruskal: the best joint that joins two parts which are still apart
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
