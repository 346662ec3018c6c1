"""Check the nodes of a glTF file: the scene that shows them, their names, matrices and scales."""

from __future__ import annotations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array
from twin.exchange.formats.glb.audit.container import Gltf
from twin.exchange.formats.glb.audit.nodes import Node

_SCALE_TOL = 1e-4
"""Maximum difference between a scale and 1 that counts as a rounding error."""


def check_scene(file: Gltf, nodes: list[Node], order: list[int], ledger: Ledger) -> None:
    """Report links, frames and shapes outside of the scene that viewers show; `order` has parents before children."""
    scenes = file.items("scenes")
    number = file.json.get("scene", 0)
    roots: object = []
    if isinstance(number, int) and 0 <= number < len(scenes):
        roots = scenes[number].get("nodes", [])
    inside: set[int] = set()
    if isinstance(roots, list):
        for root in roots:
            if isinstance(root, int):
                inside.add(root)
        if len(inside) < len(roots):
            text = f"the scene lists one of its {len(roots)} root nodes twice: glTF requires that each is there once."
            ledger.wrong("gltf.scene", text, "scene")
    for index in order:
        if nodes[index].parent in inside:
            inside.add(index)
    absent: list[str] = []
    for node in nodes:
        is_named_part = node.is_link or node.extras.get("frame")
        if node.index not in inside and (is_named_part or "mesh" in node.spec):
            absent.append(node.label)
    if absent:
        text = f"{len(absent)} links, frames or shapes, such as '{absent[0]}', are not in the scene that viewers show."
        ledger.wrong("gltf.scene", text, absent[0], suggestion="make each the child of a node of the scene")


def check_names(file: Gltf, nodes: list[Node], animated: set[int]) -> None:
    """Report names that two nodes share, animated nodes without a name, and links that are named otherwise."""
    ledger = file.ledger
    first_nodes: dict[str, Node] = {}
    for node in nodes:
        if not node.name:
            continue
        first_node = first_nodes.setdefault(node.name, node)
        if first_node is node:
            continue
        moves = {node.index, first_node.index} & animated or node.is_link or first_node.is_link
        severity = "disagreement" if moves else "warning"
        text = (
            f"nodes {first_node.index} and {node.index} are both named '{node.name}': players that find nodes by name "
            "may move the wrong node."
        )
        ledger.add("gltf.duplicate_name", severity, text, node.name)
    for index in sorted(animated):
        if not nodes[index].name:
            ledger.add("gltf.unnamed", "warning", f"animated node {index} has no name.", f"node {index}")
    for node in nodes:
        if not node.is_link:
            continue
        link = node.extras["link"]
        if isinstance(link, str) and link != node.name:
            text = f"node '{node.label}' has the link name '{link}' in its extras: the two names must be equal."
            ledger.wrong("gltf.link_name", text, node.label, suggestion="give the node the name of its link")


def check_matrices(nodes: list[Node], animated: set[int], ledger: Ledger) -> None:
    """Report animated nodes that state their pose by a matrix."""
    for node in nodes:
        if node.matrix is not None and node.index in animated:
            text = (
                f"node '{node.label}' is animated and has a matrix: some players use the matrix, others the animation."
            )
            ledger.wrong("gltf.matrix", text, node.label)


def check_scales(nodes: list[Node], world: list[Array], animated: set[int], ledger: Ledger) -> None:
    """Report mirrored links and meshes, and scaled links; without links, scaled nodes that are animated."""
    has_links = any(node.is_link for node in nodes)
    for node in nodes:
        M_world_node = world[node.index][0]
        _, scale = poses.split(M_world_node)
        deviation = np.abs(scale - 1)
        if np.linalg.det(M_world_node[:3, :3]) < 0 and (node.is_link or "mesh" in node.spec):
            text = f"node '{node.label}' is mirrored, which is not a rigid motion."
            severity = "disagreement" if node.is_link else "warning"
            advice = "mirror the points of the mesh and reverse its faces"
            ledger.add("gltf.mirrored", severity, text, node.label, size=Measured(-1.0, 0.0), suggestion=advice)
            continue
        moves = node.is_link if has_links else node.index in animated
        if moves and np.max(deviation) > _SCALE_TOL:
            x, y, z = scale
            text = f"node '{node.label}' is scaled by {x:.5g}, {y:.5g}, {z:.5g} in the world."
            severity = "disagreement" if node.is_link else "info"
            size = Measured(float(scale[np.argmax(deviation)]), 1.0)
            ledger.add("gltf.scale", severity, text, node.label, size=size)
