"""Read the tree of nodes of a glTF file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.json_types import JsonObject
from twin.exchange.audit import poses
from twin.exchange.audit.clip_checks import UNIT_LENGTH_TOL
from twin.exchange.audit.ledger import Measured, ReadError
from twin.exchange.audit.poses import Array
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
    def extras(self) -> JsonObject:
        """The data of the application; {} if the node has none."""
        return _extras(self.spec)

    @property
    def is_link(self) -> bool:
        """Whether the node's extras mark it as a link of a robot."""
        return bool(self.extras.get("link")) and not self.copied


def link_above(nodes: list[Node], node: Node) -> Node | None:
    """Return the node itself if it is a link, else its nearest ancestor that is a link; None if there is none."""
    while not node.is_link and node.parent >= 0:
        node = nodes[node.parent]
    return node if node.is_link else None


def local_matrices(node: Node, animated_values: dict[str, Array]) -> Array:
    """Return the matrices T_parent_node (k or 1, 4, 4) of a node; `animated_values` is {property: values (k, n)}."""
    if node.matrix is not None and not animated_values:
        return node.matrix[None]
    xyzw = np.atleast_2d(animated_values.get("rotation", node.rotation))
    translation = np.atleast_2d(animated_values.get("translation", node.translation))
    scale = np.atleast_2d(animated_values.get("scale", node.scale))
    T = poses.pose(poses.rotation(xyzw), translation)
    if np.any(scale != 1):
        # The scale may be animated while the pose is not.
        count = max(len(T), len(scale))
        T = np.broadcast_to(T, (count, 4, 4)).copy()
        T[:, :3, :3] *= scale[:, None, :]
    return T


def read_nodes(file: Gltf) -> list[Node]:
    """Return the nodes of a file.

    Raises:
        ReadError: a child does not exist, or has two parents.
    """
    specs = file.items("nodes")
    parents = _parents(file, specs)
    nodes = []
    for index, spec in enumerate(specs):
        node = _node(index, spec, parents[index], _is_copy_of_ancestor(specs, parents, index))
        nodes.append(node)
        length = float(np.linalg.norm(node.rotation))
        if abs(length - 1) > UNIT_LENGTH_TOL:
            text = f"the rotation quaternion of node '{node.label}' has length {length:.6g}, not 1."
            file.ledger.wrong("gltf.quaternion", text, node.label, size=Measured(length, 1.0))
    return nodes


def _parents(file: Gltf, specs: list[JsonObject]) -> list[int]:
    """Return the index of each node's parent; -1 for nodes without parent."""
    parents = [-1] * len(specs)
    for index, spec in enumerate(specs):
        for child in spec.get("children", []):
            file.item("nodes", child)
            if parents[child] >= 0 or child == index:
                raise ReadError(f"node {child} has two parents, {parents[child]} and {index}", "gltf.tree")
            parents[child] = index
    return parents


def _node(index: int, spec: JsonObject, parent: int, copied: bool) -> Node:
    name = spec.get("name", "")
    if not isinstance(name, str):
        name = ""
    label = f"node {index}"
    matrix = None
    if "matrix" in spec:
        columns = numbers(spec["matrix"], 16, f"{label}: matrix").reshape(4, 4)
        matrix = columns.T  # glTF stores matrices by columns
    translation = numbers(spec.get("translation", (0, 0, 0)), 3, f"{label}: translation")
    rotation = numbers(spec.get("rotation", (0, 0, 0, 1)), 4, f"{label}: rotation")
    scale = numbers(spec.get("scale", (1, 1, 1)), 3, f"{label}: scale")
    return Node(index, name, parent, translation, rotation, scale, matrix, spec, copied)


def _is_copy_of_ancestor(specs: list[JsonObject], parents: list[int], index: int) -> bool:
    """Return whether an ancestor of node `index` is marked as the same link as the node."""
    link = _extras(specs[index]).get("link")
    visited = set()  # the nodes may be their own ancestors, which `parents_first` reports
    while link and parents[index] >= 0 and index not in visited:
        visited.add(index)
        index = parents[index]
        if _extras(specs[index]).get("link") == link:
            return True
    return False


def _extras(spec: JsonObject) -> JsonObject:
    extras = spec.get("extras")
    return extras if isinstance(extras, dict) else {}


def numbers(value: object, count: int, name: str) -> Array:
    """Return a JSON list of n finite numbers as an array (n,).

    Raises:
        ReadError: the value is not a list of n finite numbers.
    """
    try:
        array = np.array(value, float)
    except (TypeError, ValueError) as error:
        raise ReadError(f"{name} is not a list of {count} numbers", "gltf.json") from error
    if array.shape != (count,) or not np.all(np.isfinite(array)):
        raise ReadError(f"{name} is not a list of {count} finite numbers", "gltf.json")
    return array


def parents_first(nodes: list[Node]) -> list[int]:
    """Return the indices of the nodes, parents before children.

    Raises:
        ReadError: a node is its own ancestor.
    """
    children: dict[int, list[int]] = {}
    for node in nodes:
        children.setdefault(node.parent, []).append(node.index)
    order: list[int] = []
    pending = list(children.get(-1, []))
    while pending:
        index = pending.pop()
        order.append(index)
        pending += children.get(index, [])
    if len(order) < len(nodes):
        # A cycle has no root, and is never reached.
        missing = min(set(range(len(nodes))) - set(order))
        raise ReadError(f"node {missing} is its own ancestor", "gltf.tree")
    return order
