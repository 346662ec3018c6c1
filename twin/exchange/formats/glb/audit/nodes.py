"""Read the tree of nodes of a glTF file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.motion import UNIT_TOL
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Measured, ReadError
from twin.exchange.formats.glb.audit.container import Gltf


@dataclass(frozen=True)
class Node:
    """A node of a glTF file.

    Attributes:
        index: number of the node in the file.
        name: name of the node, or "".
        parent: index of the node's parent; -1: the node has no parent.
        translation: (3,) in m, relative to the parent, at rest.
        rotation: quaternion (4,), x y z w, at rest.
        scale: (3,) at rest.
        matrix: T_parent_node (4, 4) at rest, which replaces translation, rotation and scale; None if the node has no
            matrix.
        spec: JSON object of the node.
        copied: whether the node's extras are copies of an ancestor's extras; some exporters copy extras to mesh nodes.
    """

    index: int
    name: str
    parent: int
    translation: Array
    rotation: Array
    scale: Array
    matrix: Array | None
    spec: JsonObject
    copied: bool = False

    @property
    def label(self) -> str:
        """The node's name, or its index if it has no name."""
        return self.name or f"node {self.index}"

    @property
    def is_link(self) -> bool:
        """Whether the node's extras mark it as a link of a robot."""
        extras = self.spec.get("extras")
        return isinstance(extras, dict) and bool(extras.get("link")) and not self.copied


def link_above(nodes: list[Node], node: Node) -> Node | None:
    """Return the node itself if it is a link, else its nearest ancestor that is a link; None if there is none."""
    while not node.is_link and node.parent >= 0:
        node = nodes[node.parent]
    return node if node.is_link else None


def local(node: Node, moved: dict[str, Array]) -> Array:
    """Return the matrices T_parent_node (k or 1, 4, 4) of a node; `moved` maps properties to their animated values."""
    if node.matrix is not None and not moved:
        return node.matrix[None]
    T = poses.pose(
        poses.rotation(np.atleast_2d(moved.get("rotation", node.rotation))),
        np.atleast_2d(moved.get("translation", node.translation)),
    )
    scale = np.atleast_2d(moved.get("scale", node.scale))
    if np.any(scale != 1):
        T = np.broadcast_to(T, (max(len(T), len(scale)), 4, 4)).copy()
        T[:, :3, :3] *= scale[:, None, :]
    return T


def read_nodes(file: Gltf) -> list[Node]:
    """Return the nodes of a file.

    Raises:
        ReadError: a child does not exist, or has two parents.
    """
    specs = file.items("nodes")
    parent = [-1] * len(specs)
    for i, spec in enumerate(specs):
        for child in spec.get("children", []):
            file.item("nodes", child)
            if parent[child] >= 0 or child == i:
                raise ReadError(f"node {child} has two parents, {parent[child]} and {i}", "gltf.tree")
            parent[child] = i
    out = []
    for i, spec in enumerate(specs):
        name = spec.get("name", "")
        matrix = None if "matrix" not in spec else numbers(spec["matrix"], 16, f"node {i}: matrix").reshape(4, 4).T
        t, r, s = (
            numbers(spec.get(key, default), len(default), f"node {i}: {key}")
            for key, default in (("translation", (0, 0, 0)), ("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1)))
        )
        copied = _repeats(specs, parent, i)
        out.append(Node(i, name if isinstance(name, str) else "", parent[i], t, r, s, matrix, spec, copied))
        size = float(np.linalg.norm(r))
        if abs(size - 1) > UNIT_TOL:
            text = f"the rotation quaternion of node '{out[-1].label}' has length {size:.6g}, not 1."
            file.ledger.wrong("gltf.quaternion", text, out[-1].label, size=Measured(size, 1.0))
    return out


def _repeats(specs: list[JsonObject], parent: list[int], i: int) -> bool:
    """Return whether an ancestor of node `i` is marked as the same link as the node."""
    link = _link_of(specs[i])
    seen = set()
    while link and parent[i] >= 0 and i not in seen:
        seen.add(i)
        i = parent[i]
        if _link_of(specs[i]) == link:
            return True
    return False


def _link_of(spec: JsonObject) -> Any:
    extras = spec.get("extras")
    return extras.get("link") if isinstance(extras, dict) else None


def numbers(value: Any, n: int, name: str) -> Array:
    """Return a JSON list of n finite numbers as an array (n,).

    Raises:
        ReadError: the value is not a list of n finite numbers.
    """
    try:
        out = np.array(value, float)
    except (TypeError, ValueError) as error:
        raise ReadError(f"{name} is not a list of {n} numbers", "gltf.json") from error
    if out.shape != (n,) or not np.all(np.isfinite(out)):
        raise ReadError(f"{name} is not a list of {n} finite numbers", "gltf.json")
    return out


def parents_first(nodes: list[Node]) -> list[int]:
    """Return the indices of the nodes, parents before children.

    Raises:
        ReadError: a node is its own ancestor.
    """
    children: dict[int, list[int]] = {}
    for n in nodes:
        children.setdefault(n.parent, []).append(n.index)
    out, pending = [], list(children.get(-1, []))
    while pending:
        i = pending.pop()
        out.append(i)
        pending += children.get(i, [])
    if len(out) < len(nodes):
        missing = min(set(range(len(nodes))) - set(out))
        raise ReadError(f"node {missing} is its own ancestor", "gltf.tree")
    return out
