"""Assign the joints of a file to those of a mechanism: by their names or, if these are unknown, by structure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from twin.exchange.audit.file_joints import ONE_COORDINATE, FileJoint
from twin.exchange.audit.mechanism_data import FileMechanism

_MAX_ASSIGNMENTS = 64
"""Maximum number of assignments of a file's joints to those of the mechanism that are compared."""

_MAX_STEPS = 20_000
"""Maximum number of steps in the search of assignments."""


def joint_assignments(mechanism: FileMechanism, truth: FileMechanism) -> list[dict[str, str]]:
    """Return assignments {joint of the file: joint of the mechanism}: the one by names, else those by structure.

    The assignment by names may lack joints; those by structure, at most `_MAX_ASSIGNMENTS`, have all `single_joints` of
    the file. Return [] if neither names nor structure fit.
    """
    file_joints = single_joints(mechanism)
    mechanism_joints = single_joints(truth)
    shared = {}
    for name, joint in file_joints.items():
        if name in mechanism_joints and mechanism_joints[name].kind == joint.kind:
            shared[name] = name
    # One name, such as "joint1", or a few of many may be shared by chance.
    if len(shared) >= 2 and 2 * len(shared) >= len(file_joints):
        return [shared]
    assignments: list[dict[str, str]] = []
    for steps, assignment in enumerate(_by_structure(mechanism, truth)):
        if assignment:
            assignments.append(assignment)
        # Symmetric robots have many assignments by structure: a search of all could take forever.
        if len(assignments) == _MAX_ASSIGNMENTS or steps == _MAX_STEPS:
            break
    return assignments


def single_joints(mechanism: FileMechanism) -> dict[str, FileJoint]:
    """Return {name: joint} of the joints with one coordinate, which all formats state by one name."""
    singles = {}
    for joint in mechanism.joints:
        if joint.kind in ONE_COORDINATE and len(joint.names) == 1 and joint.T is not None:
            singles[joint.names[0]] = joint
    return singles


def rigid_parts(mechanism: FileMechanism) -> dict[str, str]:
    """Return {link: name of its rigid part}; fixed joints connect the links of a part."""
    part_of_link = dict(zip(mechanism.links, mechanism.links, strict=True))
    for joint in mechanism.joints:
        part_of_link.setdefault(joint.parent, joint.parent)
        part_of_link.setdefault(joint.child, joint.child)
    for joint in mechanism.joints:
        if joint.kind == "fixed" and joint.parent and joint.child:
            kept_part = part_of_link[joint.parent]
            joined_part = part_of_link[joint.child]
            for link, name in part_of_link.items():
                if name == joined_part:
                    part_of_link[link] = kept_part
    return part_of_link


def base_link(mechanism: FileMechanism) -> str:
    """Return the link from which the joints lead outwards: the first that is held, else the first that is no child.

    Without such links, this is the first link; without links, "".
    """
    held_links = mechanism.fixed_to_world or ()
    for link in mechanism.links:
        if link in held_links:
            return link
    children = {joint.child for joint in mechanism.joints}
    for joint in mechanism.joints:
        if joint.parent and joint.parent not in children:
            return joint.parent
    if not mechanism.links:
        return ""
    return mechanism.links[0]


@dataclass(frozen=True)
class _TreeEdge:
    """A joint with one coordinate, between the rigid parts `near` and `far` of a tree, seen from its base."""

    name: str
    joint: FileJoint
    near: str
    far: str


def _by_structure(mechanism: FileMechanism, truth: FileMechanism) -> Iterator[dict[str, str]]:
    """Yield the assignments by structure, each complete; {} for a step of the search without a result."""
    file_parts = rigid_parts(mechanism)
    mechanism_parts = rigid_parts(truth)
    start = file_parts.get(base_link(mechanism), "")
    edges = _edges_outwards(mechanism, file_parts, start)
    singles = single_joints(truth)
    if not edges or len(edges) != len(set(file_parts.values())) - 1:
        return

    def search(edge_number: int, placed: dict[str, str], assignment: dict[str, str]) -> Iterator[dict[str, str]]:
        """Yield what assigns the edges from `edge_number` on; `placed` is {part of the file: that of the mechanism}."""
        if edge_number == len(edges):
            if set(placed.values()) == set(mechanism_parts.values()):
                yield dict(assignment)
            else:
                yield {}
            return
        yield {}
        edge = edges[edge_number]
        placed_part = placed[edge.near]
        for name, candidate in singles.items():
            ends = (mechanism_parts[candidate.parent], mechanism_parts[candidate.child])
            if candidate.kind != edge.joint.kind or placed_part not in ends or name in assignment.values():
                continue
            first, second = ends
            opposite_part = second if placed_part == first else first
            if opposite_part not in placed.values():
                yield from search(edge_number + 1, placed | {edge.far: opposite_part}, assignment | {edge.name: name})

    yield from search(0, {start: mechanism_parts.get(base_link(truth), "")}, {})


def _edges_outwards(mechanism: FileMechanism, part_of_link: Mapping[str, str], start: str) -> list[_TreeEdge]:
    """Return the joints of a tree from the part `start` outwards: each after the one that leads to its near part."""
    reached = {start}
    edges = []
    singles = single_joints(mechanism)
    has_grown = True
    while has_grown:
        has_grown = False
        for name, joint in singles.items():
            near = part_of_link[joint.parent]
            far = part_of_link[joint.child]
            if near in reached and far not in reached:
                edges.append(_TreeEdge(name, joint, near, far))
                reached.add(far)
                has_grown = True
    return edges
